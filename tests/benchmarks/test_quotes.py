"""What prose quotes of a page of results is what stands there."""

import pytest

from benchmarks import quotes

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
"""

TABLE = "| who | slope |\n|---|---|\n| box | 1.5 |\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "results.md").write_text(RESULTS)
    return tmp_path


def test_quotes_are_copied_and_all_else_stays(folder):
    text = (
        "It asks <!-- results.md: default: slope -->1<!-- --> and\n| <!-- results.md: 2, box: "
        "slope -->old <!-- --> |"
    )
    assert quotes.renewed(text, folder) == (
        "It asks <!-- results.md: default: slope -->13.7 ± 6.2<!-- --> and\n"
        "| <!-- results.md: 2, box: slope -->+1.87<!-- --> |"
    )
    again = (
        "<!-- results.md: 3, box: answer --><!-- --> <!-- results.md: 1 / n: slow: slope --><!-- "
        "-->"
    )
    assert quotes.renewed(again, folder) == (
        "<!-- results.md: 3, box: answer -->not told<!-- --> <!-- results.md: 1 / n: slow: slope "
        "-->-1.7<!-- -->"
    )


def test_a_table_is_copied_with_the_columns_that_are_wanted(folder):
    text = "Before\n\n<!-- results.md: all lines: who, slope -->\n\nold\n\n<!-- -->\nAfter"
    assert quotes.renewed(text, folder) == (
        "Before\n\n<!-- results.md: all lines: who, slope -->\n\n| who | slope |\n|---|---|\n| box "
        "| +1.87 |\n"
        "| box | -0.00 |\n\n<!-- -->\nAfter"
    )
    with pytest.raises(ValueError, match=r"results\.md has 2 tables with the columns slope"):
        quotes.renewed("<!-- results.md: all lines: slope --><!-- -->", folder)


def test_a_table_can_be_named_by_the_heading_above_it(folder):
    (folder / "sizes.md").write_text(
        f"# Sizes\n\n## 10 states\n\n{TABLE}\n## 100 states\n\n{TABLE.replace('1', '2')}"
    )
    text = (
        "<!-- sizes.md#100 states: box: slope --><!-- --> and <!-- sizes.md#10 states: box: slope "
        "--><!-- -->"
    )
    assert quotes.renewed(text, folder).count("-->2.5<!--") == 1
    assert quotes.renewed(text, folder).endswith(
        "<!-- sizes.md#10 states: box: slope -->1.5<!-- -->"
    )
    for heading, many in (("1", "2"), ("1,000", "no")):
        with pytest.raises(
            ValueError, match=f"sizes.md has {many} headings that begin with '{heading}'"
        ):
            quotes.renewed(f"<!-- sizes.md#{heading}: box: slope --><!-- -->", folder)
    with pytest.raises(ValueError, match="has no cells"):
        quotes.renewed("<!-- sizes.md#Sizes: box: slope --><!-- -->", folder)


@pytest.mark.parametrize(
    ("line", "column"), [("default", "answer"), ("nobody", "slope"), ("box", "slope")]
)
def test_what_is_not_there_cannot_be_quoted(folder, line, column):
    with pytest.raises(
        ValueError, match=f"results.md has no cells in the line '{line}' and the column '{column}'"
    ):
        quotes.renewed(f"<!-- results.md: {line}: {column} -->1<!-- -->", folder)


def test_a_line_that_can_be_two_cannot_be_quoted(folder):
    (folder / "results.md").write_text(RESULTS + "| default | 14 |\n")
    with pytest.raises(ValueError, match="has 2 cells in the line 'default'"):
        quotes.renewed("<!-- results.md: default: slope --><!-- -->", folder)


def test_the_pages_quote_what_is_there_now():
    for page in quotes.PAGES:
        text = page.read_text(encoding="utf-8")
        assert quotes.QUOTE.search(text), page
        assert quotes.renewed(text, page.parent) == text


def test_a_page_written_elsewhere_changes_no_other(folder, monkeypatch):
    prose = folder / "prose.md"
    prose.write_text("<!-- results.md: default: slope --><!-- -->")
    monkeypatch.setattr(quotes, "PAGES", (prose,))
    quotes.renew_beside(folder / "elsewhere" / "results.md")
    assert "13.7" not in prose.read_text()
    quotes.renew_beside(folder / "results.md")
    assert "13.7 ± 6.2" in prose.read_text()


def test_a_whole_heading_goes_before_longer_ones_and_may_have_a_colon(folder):
    page = f"## Pairs: even\n\n{TABLE}\n## Pairs: even, later\n\n{TABLE.replace('1.5', '2.5')}"
    (folder / "pairs.md").write_text(page)
    for heading, found in (("Pairs: even", "1.5"), ("Pairs: even, l", "2.5")):
        quote = f'<!-- pairs.md#"{heading}": box: slope -->'
        assert quotes.renewed(f"{quote}?<!-- -->", folder) == f"{quote}{found}<!-- -->"
