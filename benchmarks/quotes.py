"""Figures that a page of prose quotes from a page of results: copied by this program, never by
hand.

    python -m benchmarks.quotes            writes them anew in all pages

In prose, `<!-- assumptions.md: m = 100: % of all -->+0.9 ± 1.1<!-- -->` is the cell of the line "m
= 100" in the column "% of all" of the tables in docs/assumptions.md; the comments are not seen
where the page is read. A line is named by its first cell, or by as many of its first cells as it
takes, with commas: "2, box, 10%, % asked of open". Where several tables have the line,
`RESULTS.md#10,000 states` is what stands under the heading that is or begins so; a heading with a
colon is put in quotation marks.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from benchmarks.reporting import markdown

ROOT = Path(__file__).resolve().parent.parent
PAGES = (
    ROOT / "README.md",
    *(
        ROOT / "docs" / f"{name}.md"
        for name in (
            "before-you-ask",
            "choosing",
            "contest",
            "evidence",
            "families",
            "options",
            "paper",
        )
    ),
)
ALL = "all lines"
QUOTE = re.compile(
    r'<!-- (\S+?\.md)(#"[^"]+"|#[^:]+)?: (.+?): ([^:]+?) -->(.*?)<!-- -->', re.DOTALL
)


def renewed(text: str, folder: Path) -> str:
    """The text with every quote as its page, found from the folder, has it now. Raises ValueError
    where a page has no such cell, or several that differ."""
    pages: dict[str, str] = {}

    def written(match: re.Match[str]) -> str:
        page, heading, line, column, _ = match.groups(default="")
        if page not in pages:
            pages[page] = (folder / page).read_text(encoding="utf-8")
        there, name = tables(under(pages[page], page, heading[1:].strip('"'))), page + heading
        found = columns(there, name, column) if line == ALL else cell(there, name, line, column)
        return f"<!-- {name}: {line}: {column} -->{found}<!-- -->"

    return QUOTE.sub(written, text)


def under(text: str, page: str, begins: str) -> str:
    """What stands under the heading that is so, or else begins so, up to the next; all, if it
    begins with nothing.
    """
    if not begins:
        return text
    every = re.split(r"^#+ ", text, flags=re.MULTILINE)[1:]
    whole = [part for part in every if part.splitlines()[0] == begins]
    parts = whole or [part for part in every if part.startswith(begins)]
    if len(parts) != 1:
        raise ValueError(
            f"{page} has {len(parts) or 'no'} headings that begin with {begins!r}: 1 is quoted from"
        )
    return parts[0]


def cell(found: list[list[list[str]]], page: str, line: str, column: str) -> str:
    """The cell of a page's tables in this line and column."""
    cells = {
        row[head.index(column)]
        for head, *rows in found
        if column in head
        for row in rows
        if line in {", ".join(row[:n]) for n in range(1, len(row))}
    }
    if len(cells) != 1:
        raise ValueError(
            f"{page} has {len(cells) or 'no'} cells in the line {line!r} and the column "
            f"{column!r}: 1 is quoted"
        )
    return cells.pop()


def columns(found: list[list[list[str]]], page: str, names: str) -> str:
    """These columns, named with commas, of the page's table that has them, as a table of Markdown
    with a line before it and after it."""
    wanted = names.split(", ")
    having = [table for table in found if {*wanted} <= {*table[0]}]
    if len(having) != 1:
        raise ValueError(
            f"{page} has {len(having) or 'no'} tables with the columns {names}: 1 is quoted"
        )
    places = [having[0][0].index(name) for name in wanted]
    head, *rows = ([row[place] for place in places] for row in having[0])
    return "\n".join(["\n", *markdown(head, rows, len(wanted)), "\n"])


def tables(text: str) -> list[list[list[str]]]:
    """The tables of a page of Markdown: for each the cells of its lines, the head first, without
    the rule.
    """
    found: list[list[list[str]]] = []
    before = ""
    for line in text.splitlines():
        if line.startswith("|"):
            cells = [each.strip() for each in line.strip().strip("|").split("|")]
            if not before.startswith("|"):
                found.append([])
            if not set("".join(cells)) <= set("-:"):
                found[-1].append(cells)
        before = line
    return found


def renew() -> None:
    """Write the quotes of all ``PAGES`` anew."""
    for page in PAGES:
        page.write_text(renewed(page.read_text(encoding="utf-8"), page.parent), encoding="utf-8")


def renew_beside(written: Path) -> None:
    """``renew`` if this page, which was just written, is one that they quote from."""
    if written.resolve() in {
        (page.parent / one[1]).resolve() for page in PAGES for one in quotes_in(page)
    }:
        renew()


def quotes_in(page: Path) -> list[re.Match[str]]:
    """The quotes of a page."""
    return [*QUOTE.finditer(page.read_text(encoding="utf-8"))]


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.quotes", description=(__doc__ or "").splitlines()[0]
    )
    parser.parse_args(arguments)
    renew()


if __name__ == "__main__":
    main()
