"""docs/paper.md names functions and tests that exist, and the claims it leads to are those of the
committed runs.
"""

import importlib
import re
from pathlib import Path

import pandas as pd
import pytest

from benchmarks import quotes, stamps
from qlearn.paper.claims import claims_page

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
NAMES = sorted(set(re.findall(r"`((?:elicit|qlearn|benchmarks)(?:\.\w+)+)", PAGE)))
TESTS = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)))
LINKS = sorted(set(re.findall(r"\]\(([^)#:]+)\)", PAGE)))


def test_there_is_something_to_check() -> None:
    assert len(NAMES) > 25
    assert len(TESTS) > 25
    assert {"assumptions.md", "literal.md", "exploration.md", "claims.md"} <= set(LINKS)


@pytest.mark.parametrize("name", NAMES)
def test_every_function_named_exists(name: str) -> None:
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        for part in parts[n:]:
            found = getattr(found, part)
        return
    raise AssertionError(f"there is no {name}")


@pytest.mark.parametrize(("file", "name"), TESTS)
def test_every_test_named_exists(file: str, name: str) -> None:
    assert re.search(rf"^def {name}\(", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("link", LINKS)
def test_every_link_leads_somewhere(link: str) -> None:
    assert (ROOT / "docs" / link).exists()


def test_every_equation_and_line_has_a_place() -> None:
    for number in range(1, 8):
        assert f"| ({number}) " in PAGE
    assert "Algorithm 1, lines 1 to 18" in PAGE
    assert "Algorithm 2, lines 1 to 19" in PAGE


def test_the_claims_are_those_of_the_committed_runs() -> None:
    rows = pd.read_csv(ROOT / "notebooks" / "data" / "figures.csv")
    assert stamps.without((ROOT / "docs" / "claims.md").read_text(encoding="utf-8")) == claims_page(
        rows
    )
    of_runs = {"paper-claims", "paper-few-questions", *(f"paper-figure-{n}" for n in (2, 3, 4))}
    assert of_runs <= {name for name, _ in quotes.BLOCK.findall(PAGE)}
    assert quotes.renewed(PAGE) == PAGE
