"""The code in the pages of docs/ runs as printed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.interpreter import run
from tests.thoroughness import thorough

DOCS = Path(__file__).resolve().parents[2] / "docs"
BLOCK = re.compile(r"```(python|text)\n(.*?)```", re.DOTALL)
PAGES = [
    page for page in sorted(DOCS.glob("*.md")) if "```python" in page.read_text(encoding="utf-8")
]
assert PAGES
COSTLY = {"before-you-ask", "families", "panel", "people"}  # whole runs, fits to each person
EACH = """
import contextlib, io, json, traceback
printed = []
for code in json.loads(CODES):
    with contextlib.redirect_stdout(io.StringIO()) as said:
        try:
            exec(code, {"__name__": "__main__"})
        except Exception:
            traceback.print_exc(file=said)
    printed.append(said.getvalue())
print(json.dumps(printed))
"""


def blocks_of(page: Path, kind: str) -> str:
    """All code of a page, or all that it prints."""
    return "".join(
        text for found, text in BLOCK.findall(page.read_text(encoding="utf-8")) if found == kind
    )


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the output of each page's code.

    One interpreter runs all pages, since most of the time goes into starting it.
    """
    pages = [page for page in PAGES if thorough() or page.stem not in COSTLY]
    codes = json.dumps([blocks_of(page, "python") for page in pages])
    (shown,) = run(EACH.replace("CODES", repr(codes)), tmp_path_factory.mktemp("pages"))
    return dict(zip([page.stem for page in pages], json.loads(shown), strict=True))


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=page.stem, marks=[pytest.mark.slow] if page.stem in COSTLY else [])
        for page in PAGES
    ],
)
def test_the_code_of_a_page_prints_what_stands_below_it(
    page: Path, printed: dict[str, str]
) -> None:
    shown = blocks_of(page, "text")
    assert shown
    assert printed[page.stem] == shown
