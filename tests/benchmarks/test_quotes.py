"""Numbers that prose quotes from a page of results are those of the page."""

import re
from pathlib import Path

import pytest

from benchmarks import quotes
from qlearn.cli.main import parser

ROOT = quotes.ROOT
RESULTS = """\
# Results

| figure | who | slope | answer |
| --- | --- | ---: | --- |
| 2 | box | +1.87 | rises |
| 3 | box | -0.00 | not told |

Text.

| choice | slope |
|---|---|
| default | 13.7 ± 6.2 |
| 1 / n: slow | -1.7 |
| many | 1,234.56 ± 9 |
"""

TABLE = "| who | slope |\n|---|---|\n| box | 1.5 |\n"
EDITED = "<!-- begin one -->\nold\n<!-- end one -->"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "results.md").write_text(RESULTS)
    (tmp_path / "benchmarks" / "blocks").mkdir(parents=True)
    return tmp_path


def block(folder: Path, name: str, text: str) -> None:
    (folder / "benchmarks" / "blocks" / f"{name}.md").write_text(text)


def test_a_block_is_its_text_with_the_cells_and_all_else_stays(folder):
    block(folder, "one", "It asks {{results.md: default: slope}}.\n")
    text = "Before.\n\n<!-- begin one -->\nold\n<!-- end one -->\n\nAfter {{results.md}}.\n"
    new = quotes.renewed(text, folder)
    assert new == (
        "Before.\n\n<!-- begin one -->\n\nIt asks 13.7 ± 6.2.\n\n<!-- end one -->\n\n"
        "After {{results.md}}.\n"
    )
    assert quotes.renewed(new, folder) == new
    with pytest.raises(FileNotFoundError):
        quotes.renewed(EDITED.replace("one", "two"), folder)


def test_a_cell_is_named_by_its_first_cells_and_may_have_a_colon(folder):
    text = "{{results.md: 2, box: slope}} {{results.md: 3, box: answer}}"
    assert quotes.filled(text, folder) == "+1.87 not told"
    assert quotes.filled("{{results.md: 1 / n: slow: slope}}", folder) == "-1.7"


@pytest.mark.parametrize(
    ("text", "digits", "shown"),
    [("default", 0, "14"), ("default", 1, "13.7"), ("many", 1, "1,234.6"), ("many", 0, "1,235")],
)
def test_a_number_may_be_rounded_and_is_then_without_its_interval(folder, text, digits, shown):
    assert quotes.filled(f"{{{{results.md: {text}: slope ~{digits}}}}}", folder) == shown


def test_what_is_no_number_cannot_be_rounded(folder):
    with pytest.raises(ValueError, match="'rises' has no number to round"):
        quotes.filled("{{results.md: 2, box: answer ~1}}", folder)


def test_a_table_is_copied_with_the_columns_that_are_wanted(folder):
    text = "{{results.md: all lines: who, slope}}"
    wanted = "| who | slope |\n|---|---|\n| box | +1.87 |\n| box | -0.00 |"
    assert quotes.filled(text, folder) == wanted
    with pytest.raises(ValueError, match=r"results\.md has 2 tables with the columns slope"):
        quotes.filled("{{results.md: all lines: slope}}", folder)


def test_a_table_can_be_named_by_the_heading_above_it(folder):
    (folder / "sizes.md").write_text(
        f"# Sizes\n\n## 10 states\n\n{TABLE}\n## 100 states\n\n{TABLE.replace('1', '2')}"
    )
    text = "{{sizes.md#100 states: box: slope}} and {{sizes.md#10 states: box: slope}}"
    assert quotes.filled(text, folder) == "2.5 and 1.5"
    for heading, many in (("1", "2"), ("1,000", "no")):
        with pytest.raises(
            ValueError, match=f"sizes.md has {many} headings that begin with '{heading}'"
        ):
            quotes.filled(f"{{{{sizes.md#{heading}: box: slope}}}}", folder)
    with pytest.raises(ValueError, match="has no cells"):
        quotes.filled("{{sizes.md#Sizes: box: slope}}", folder)


def test_a_whole_heading_goes_before_longer_ones_and_may_have_a_colon(folder):
    page = f"## Pairs: even\n\n{TABLE}\n## Pairs: even, later\n\n{TABLE.replace('1.5', '2.5')}"
    (folder / "pairs.md").write_text(page)
    for heading, found in (("Pairs: even", "1.5"), ("Pairs: even, l", "2.5")):
        assert quotes.filled(f'{{{{pairs.md#"{heading}": box: slope}}}}', folder) == found


@pytest.mark.parametrize(
    ("line", "column"), [("default", "answer"), ("nobody", "slope"), ("box", "slope")]
)
def test_what_is_not_there_cannot_be_quoted(folder, line, column):
    with pytest.raises(
        ValueError, match=f"results.md has no cells in the line '{line}' and the column '{column}'"
    ):
        quotes.filled(f"{{{{results.md: {line}: {column}}}}}", folder)


def test_a_line_that_can_be_two_cannot_be_quoted(folder):
    (folder / "results.md").write_text(RESULTS + "| default | 14 |\n")
    with pytest.raises(ValueError, match="has 2 cells in the line 'default'"):
        quotes.filled("{{results.md: default: slope}}", folder)


def test_the_options_of_a_command_are_those_of_its_parser():
    table = quotes.command_options("qlearn log merge").splitlines()
    assert table[:2] == ["| option | meaning [default] |", "|---|---|"]
    assert [row.split("|")[1].strip() for row in table[2:]] == [
        "`FILE`",
        "`--out` NEW",
        "`--salvage`",
    ]
    assert "[0.01]" in quotes.command_options("qlearn teach")  # a default


def test_every_command_is_on_the_page_on_commands():
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    commands = next(
        action.choices for action in parser()._actions if isinstance(action.choices, dict)
    )
    assert len(commands) >= 5
    for name in commands:
        assert f"## `qlearn {name}`" in page, name
        if name != "log":  # which has commands of its own
            assert f"{{{{qlearn {name} --help}}}}" in "".join(
                path.read_text(encoding="utf-8") for path in quotes.BLOCKS.glob("*.md")
            ), name


def test_the_pages_quote_what_is_there_now():
    for page in quotes.PAGES:
        text = page.read_text(encoding="utf-8")
        assert quotes.renewed(text) == text, page


def test_every_text_of_a_block_is_used_and_every_reference_in_it_is_read():
    used = [name for page in quotes.PAGES for name, _ in quotes.BLOCK.findall(page.read_text())]
    texts = {path.stem: path.read_text(encoding="utf-8") for path in quotes.BLOCKS.glob("*.md")}
    assert len(texts) > 5
    assert {*used} == texts.keys()
    for name, text in texts.items():
        left = text
        for reference in (quotes.REFERENCE, quotes.RUNS, quotes.COMMAND):
            left = reference.sub("", left)
        assert left != text, name
        assert "{{" not in left, name


def test_there_is_no_other_comment_in_the_pages():
    for page in quotes.PAGES:
        text = quotes.BLOCK.sub("", page.read_text(encoding="utf-8"))
        assert "<!--" not in text, page


WRITTEN = re.compile(r"[Ww]ritten by `|^Made ", re.MULTILINE)  # a page of results, by a command
END = r"[-+]?\d[\d.,]*(?<![.,])%?"
EXACT = re.compile(
    rf"\d[\d.,]* ± \d[\d.]*\d|\d[\d.,]* ± \d|\[{END}, {END}\]|\({END} to\s+{END}(?=[);,])"
)
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+\.md)")


def stands(interval: str, text: str) -> bool:
    """Return whether an interval is in the text; a to b may be written there as [a, b]."""
    if "±" in interval:
        return interval in text
    low, high = (re.escape(end.rstrip("%")) for end in re.findall(END, interval))
    return re.search(rf"[\[(]{low}%?(?:,| to) {high}(?![\d.,]*\d)", text) is not None


def test_an_interval_in_prose_stands_on_a_page_that_its_page_links():
    assert EXACT.findall(
        "it asks 2.0 ± 0.1 [0.4, 2.0], 20 ± 3 (-0.1 to\n1.5) (3% to 10%; more)"
    ) == [
        "2.0 ± 0.1",
        "[0.4, 2.0]",
        "20 ± 3",
        "(-0.1 to\n1.5",
        "(3% to 10%",
    ]
    assert stands("(-0.1 to\n1.5", "10 [-0.1, 1.5]")
    assert stands("(3% to 10%", "5 (3 to 10%)")
    assert not stands("(3% to 10%", "5 [3, 10.5]")
    for page in quotes.PAGES:
        whole = page.read_text(encoding="utf-8")
        if WRITTEN.search(whole):
            continue
        text = re.sub(r"```.*?```|`[^`\n]*`", "", quotes.BLOCK.sub("", whole), flags=re.DOTALL)
        behind = "\n".join(
            (page.parent / to).read_text(encoding="utf-8") for to in set(LINK.findall(whole))
        )
        numbers = EXACT.findall(text)
        assert not {number for number in numbers if not stands(number, behind)}, page


def test_a_page_written_elsewhere_changes_no_other(folder, monkeypatch):
    prose = folder / "prose.md"
    prose.write_text(EDITED)
    block(folder, "one", "{{results.md: default: slope}}")
    monkeypatch.setattr(quotes, "PAGES", (prose,))
    monkeypatch.setattr(quotes, "ROOT", folder)
    monkeypatch.setattr(quotes, "BLOCKS", folder / "benchmarks" / "blocks")
    quotes.renew_beside(folder / "elsewhere" / "results.md")
    assert "13.7" not in prose.read_text()
    quotes.renew_beside(folder / "results.md")
    assert "13.7 ± 6.2" in prose.read_text()
