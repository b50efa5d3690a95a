"""Pages of results say what made them; those of older code are told; rows made again have the
digits of their page.

A row that differs means that the code now does something else than what its page shows: ``make
evidence`` makes the page again, where the change was meant.
"""

import re

import pytest

from benchmarks import stamps
from benchmarks.evidence import HOLDING, PAGES, ROOT, missing
from benchmarks.rows_again import NOT_AGAIN, SAMPLES, alike, any_like, differing
from tests.thoroughness import thorough

PAGE = {page.name: page for page in PAGES}


def test_every_page_of_results_is_in_the_table_once_and_stamped():
    found = {
        *ROOT.glob("benchmarks/RESULTS*.md"),
        *ROOT.glob("notebooks/*.ipynb"),
        *ROOT.glob("notebooks/data/*.csv"),
    }
    written = re.compile(r"[Ww]ritten by `|^Made ", re.MULTILINE)
    found |= {
        page for page in ROOT.glob("docs/*.md") if written.search(page.read_text(encoding="utf-8"))
    }
    assert sorted(path.relative_to(ROOT).as_posix() for path in found) == sorted(
        page.path for page in PAGES
    )
    assert len(PAGE) == len(PAGES)
    assert not [page.path for page in PAGES if stamps.of(ROOT / page.path) is None]
    places = [
        PAGES.index(PAGE[name])
        for name in ("figures", "ablation", "crowd", "dqn_terrain", "01_two_tutors")
    ]
    assert places == sorted(places)  # notebooks read tables


def test_the_page_on_evidence_leads_to_every_page():
    text = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")
    leads = [
        page.path.removeprefix("docs/").replace("benchmarks/", "../benchmarks/") for page in PAGES
    ]
    assert not [path for path in leads if path.endswith(".md") and f"]({path})" not in text]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_is_of_the_code_of_today(page):
    """Expected to fail while code is worked on: ``-rx`` lists the pages to make again."""
    state = page.state
    if state not in HOLDING:
        pytest.xfail(f"{page.path} is {state}: make evidence")


def test_some_rows_of_every_page_are_made_again_or_it_is_said_why_not():
    names = {sample.page for sample in SAMPLES}
    assert names | NOT_AGAIN.keys() == PAGE.keys()
    assert not names & NOT_AGAIN.keys()


@pytest.mark.parametrize(
    ("name", "again"),
    [
        pytest.param(name, again, marks=() if quick else pytest.mark.slow, id=name)
        for name, again, quick in SAMPLES
    ],
)
def test_rows_made_again_have_the_digits_of_their_page(name, again):
    page = PAGE[name]
    if page.stale and not thorough():  # its rows may well differ: no news
        pytest.xfail(f"{page.path} is {page.state}: make evidence")
    if extras := missing(page):
        pytest.skip(f"needs {', '.join(extras)}")
    other = differing(page, again)
    if other and page.stale:
        pytest.xfail(f"rows of {page.path} differ, which is {page.state}: make evidence")
    assert not other


def test_another_digit_is_noticed():
    rows = [["k = 5", "1.0", "7 ms"]]
    assert any_like(["k = 5", "1.0", None], rows)
    assert not any_like(["k = 5", "1.1", None], rows)
    assert not any_like(["k = 5", "1.0"], rows)
    assert alike("0.001640921411100429", "0.001640921411100349")
    assert not alike("0.001640921411100429", "0.001640921511100349")
