"""Numbers in prose: tables and sentences that pages of prose take from pages of results.

    python -m benchmarks.quotes            renews them in all pages

A page of prose has two lines of comment, `<!-- begin NAME -->` and `<!-- end NAME -->`. Between
them stands the text of benchmarks/blocks/NAME.md, in which each reference to a cell has become the
cell. So text is edited there, and no number is copied by hand.

In such a text `{{docs/assumptions.md: m = 100: % of all}}` is the cell of the line "m = 100" in the
column "% of all" of the tables in docs/assumptions.md. A line is named by its first cell, or by as
many of its first cells as it takes, with commas: "2, box, 10%, % asked of open". Where several
tables have the line, `benchmarks/RESULTS.md#10,000 states` is the part under the heading that is or
begins so; a heading with a colon is put in quotation marks. `~1` after the column rounds the number
to one decimal, without its interval. The line `all lines` stands for the whole table, with the
columns that are named.

Two references are not to cells. `{{qlearn log merge --help}}` is a table of the options of a
command, made from its parser. `{{notebooks/data/figures.csv: figure 2, of all comparisons}}` is a
table or a sentence on the runs of the paper's figures, which ``claim_tables`` writes.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from benchmarks.reporting import markdown

ROOT = Path(__file__).resolve().parent.parent
BLOCKS = ROOT / "benchmarks" / "blocks"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
ALL = "all lines"
BLOCK = re.compile(r"^<!-- begin (\S+) -->\n(.*?)^<!-- end \1 -->$", re.DOTALL | re.MULTILINE)
REFERENCE = re.compile(
    r'\{\{(\S+?\.md)(#"[^"]+"|#[^:{}]+)?: ([^{}]+?): ([^:{}~]+?)(?: ~(\d))?\}\}', re.DOTALL
)
RUNS = re.compile(r"\{\{(\S+?\.csv): ([^{}]+?)\}\}")
COMMAND = re.compile(r"\{\{(qlearn(?: \w+)*) --help\}\}")
NUMBER = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?")


def renewed(text: str, root: Path = ROOT) -> str:
    """Return a page's text with every block as its pages of results have it now.

    Parameters
    ----------
    text : str
        The page.
    root : Path
        The folder that references start from. The blocks' texts are in its benchmarks/blocks.

    Raises
    ------
    ValueError
        If a page of results has no such cell, or several that differ.
    FileNotFoundError
        If a block has no text.
    """
    folder = root / "benchmarks" / "blocks"

    def written(match: re.Match[str]) -> str:
        name = match[1]
        told = filled((folder / f"{name}.md").read_text(encoding="utf-8").strip(), root)
        return f"<!-- begin {name} -->\n\n{told}\n\n<!-- end {name} -->"

    return BLOCK.sub(written, text)


def filled(text: str, root: Path = ROOT) -> str:
    """Return the text with cells, and the other parts, in place of its references to them.

    Raises ValueError where a page has no such cell, or several that differ, and where there is no
    such part.
    """

    def found(match: re.Match[str]) -> str:
        page, heading, line, column, digits = match.groups(default="")
        whole = (root / page).read_text(encoding="utf-8")
        there, name = tables(under(whole, page, heading[1:].strip('"'))), page + heading
        if line == ALL:
            return columns(there, name, column)
        one = cell(there, name, line, column)
        return rounded(one, int(digits)) if digits else one

    text = RUNS.sub(lambda match: of_runs(root / match[1], match[2]), REFERENCE.sub(found, text))
    return COMMAND.sub(lambda match: command_options(match[1]), text)


def of_runs(runs: Path, name: str) -> str:
    """Return a table or a sentence on the runs of the paper's figures: ``claim_tables.part``."""
    from benchmarks.claim_tables import part

    return part(runs, name)


def command_options(command: str) -> str:
    """Return the options of a command of the project, such as "qlearn log merge", as a table."""
    from qlearn.cli.main import parser

    at = parser()
    for word in command.split()[1:]:
        at = next(
            action.choices[word]
            for action in at._actions
            if isinstance(action, argparse._SubParsersAction)
        )
    rows = []
    for action in at._actions:
        if isinstance(action, (argparse._HelpAction, argparse._SubParsersAction)):
            continue
        names = ", ".join(f"`{name}`" for name in action.option_strings) or f"`{action.metavar}`"
        told = at._get_formatter()._expand_help(action) if action.help else ""
        kind = str(action.metavar or action.dest.upper())
        choices = kind[1:-1].split(",") if kind.startswith("{") else action.choices or ()
        if choices:
            told += f". One of {', '.join(f'`{choice}`' for choice in choices)}"
        elif action.option_strings and action.nargs != 0:
            names += f" {kind}"
        rows.append([names.replace("|", r"\|"), told.replace("|", r"\|")])
    return "\n".join(markdown(["option", "meaning [default]"], rows, 2))


def rounded(text: str, digits: int) -> str:
    """Return the first number of a cell, rounded."""
    first = NUMBER.search(text)
    if first is None:
        raise ValueError(f"the cell {text!r} has no number to round")
    return f"{float(first[0].replace(',', '')):,.{digits}f}"


def under(text: str, page: str, begins: str) -> str:
    """Return the part of a page under the heading that is so, or else begins so, up to the next.

    It is all of the page if ``begins`` is empty.
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
    """Return the cell of a page's tables in this line and column."""
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
    """Return these columns, named with commas, of the page's table that has them, as Markdown."""
    wanted = names.split(", ")
    having = [table for table in found if {*wanted} <= {*table[0]}]
    if len(having) != 1:
        raise ValueError(
            f"{page} has {len(having) or 'no'} tables with the columns {names}: 1 is quoted"
        )
    places = [having[0][0].index(name) for name in wanted]
    head, *rows = ([row[place] for place in places] for row in having[0])
    return "\n".join(markdown(head, rows, len(wanted)))


def tables(text: str) -> list[list[list[str]]]:
    """Return the tables of a page of Markdown.

    Each is a list of the cells of its lines, the head first, without the rule.
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


def table_rows(text: str) -> list[list[str]]:
    """Return the cells of every line of a page's tables, heads included, rules not."""
    return [row for table in tables(text) for row in table]


def renew() -> None:
    """Renew the blocks of all ``PAGES``."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if (new := renewed(text, ROOT)) != text:
            page.write_text(new, encoding="utf-8")


def renew_beside(written: Path) -> None:
    """Renew all pages if this page or table, which was just written, is one that they quote."""
    if written.resolve() in {ROOT / page for page in sources()}:
        renew()


def sources() -> set[str]:
    """Return the pages and tables of results, from the root, that the blocks refer to."""
    texts = [path.read_text(encoding="utf-8") for path in BLOCKS.glob("*.md")]
    return {match[1] for of in (REFERENCE, RUNS) for text in texts for match in of.finditer(text)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.quotes", description=(__doc__ or "").splitlines()[0]
    )
    parser.parse_args(arguments)
    renew()


if __name__ == "__main__":
    main()
