"""The code in the pages of docs/ runs as printed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.interpreter import printed_here, run
from tests.thoroughness import thorough

DOCS = Path(__file__).resolve().parents[2] / "docs"
BLOCK = re.compile(r"```(python|text)\n(.*?)```", re.DOTALL)
PAGES = [
    page for page in sorted(DOCS.glob("*.md")) if "```python" in page.read_text(encoding="utf-8")
]
assert PAGES
COSTLY = {"before-you-ask", "families", "panel"}  # whole runs, fits to each person
LONG = {"medical-scales": "counts = []"}  # a part of it, by some of its words
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


def parts_of(page: Path) -> list[tuple[str, str]]:
    """The code of a page, part by part, and what stands below each part.

    A quick run leaves out the parts that take long.
    """
    parts: list[tuple[str, str]] = []
    for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        code, shown = parts.pop() if parts and (kind == "text" or not parts[-1][1]) else ("", "")
        parts.append((code, shown + text) if kind == "text" else (code + text, shown))
    long = LONG.get(page.stem)
    assert long is None or sum(long in code for code, _ in parts) == 1
    return [part for part in parts if thorough() or long is None or long not in part[0]]


def code_of(page: Path) -> str:
    return "".join(code for code, _ in parts_of(page))


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the output of each page's code, of a fresh interpreter for all of them.

    A quick run does without, since most of the time goes into starting it.
    """
    if not thorough():
        return {}
    codes = json.dumps([code_of(page) for page in PAGES])
    (shown,) = run(EACH.replace("CODES", repr(codes)), tmp_path_factory.mktemp("pages"))
    return dict(zip([page.stem for page in PAGES], json.loads(shown), strict=True))


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=page.stem, marks=[pytest.mark.slow] if page.stem in COSTLY else [])
        for page in PAGES
    ],
)
def test_the_code_of_a_page_prints_what_stands_below_it(
    page: Path, printed: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shown = "".join(text for _, text in parts_of(page))
    assert shown
    assert (printed[page.stem] if printed else printed_here(code_of(page))) == shown
