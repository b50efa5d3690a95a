"""The tables of docs/paper.md on the paper's figures say what docs/claims.md and the runs say."""

import re

import pandas as pd
import pytest

from benchmarks import quotes
from benchmarks.claim_tables import part
from benchmarks.quotes import table_rows

RUNS = quotes.ROOT / "notebooks" / "data" / "figures.csv"
CLAIMS = table_rows((quotes.ROOT / "docs" / "claims.md").read_text(encoding="utf-8"))
MEASURED = {
    "figure 2, of all comparisons": "% asked of all",
    "figure 2, of those dominance leaves open": "% asked of open",
    "figure 3, of all comparisons": "% asked of all",
    "figure 3, of those dominance leaves open": "% asked of open",
    "figure 4, the formula": "paper loss",
    "figure 4, true policy loss": "excess loss",
}
CODE = {"box, rescaled": "box-rescaled"}


@pytest.mark.parametrize(("name", "measured"), MEASURED.items())
def test_every_cell_has_the_numbers_and_the_answer_of_the_claims(name, measured):
    (_, *tutors), *rows = table_rows(part(RUNS, name))
    cells = 0
    for comparator, *of in rows:
        for tutor, cell in zip(tutors, of, strict=True):
            key = [name[len("figure ")], CODE.get(comparator, comparator), tutor, measured]
            told = [row[4:] for row in CLAIMS if row[:4] == key]
            assert len(told) == bool(cell)
            if cell:
                (estimate, interval, answer), (said, numbers) = told[0], cell.split("<br>")
                assert answer.startswith(said)
                shown = map(float, re.findall(r"-?\d+\.\d+", numbers))
                wanted = map(float, [estimate, *interval.split(" to ")])
                for one, other in zip(shown, wanted, strict=False):
                    assert one == pytest.approx(other, abs=0.0056)
                cells += 1
    assert cells >= 14


def test_verdicts_count_the_cases_of_both_boxes_and_exceptions_name_them():
    for figure in (2, 3, 4):
        verdicts = part(RUNS, f"figure {figure}, verdicts").split("<br>")
        exceptions = part(RUNS, f"figure {figure}, exceptions")
        for line in verdicts:
            cases, *counts = map(int, re.findall(r"(\d+)(?= cases|,|$)", line.split(", ", 1)[1]))
            assert cases == 10 == sum(counts)
        named = [tutor for arm in re.findall(r"\(([^)]*)\)", exceptions) for tutor in arm.split()]
        others = re.findall(r"(?:does not hold|inconclusive) in (\d+)", "<br>".join(verdicts))
        assert len(named) == sum(map(int, others)) > 0


def test_few_questions_are_means_of_the_runs():
    head, *rows = table_rows(part(RUNS, "few questions"))
    assert head[2:4] == ["asked at k = 5", "asked at k = 25"]
    assert [row[0] for row in rows] == ["polytope", "posterior", "box, rescaled", "box"]
    runs = pd.read_csv(RUNS)
    runs = runs[(runs.comparator == "box") & (runs.states == 100) & (runs.errs == "10%")]
    few, many = (runs[runs.levels == k] for k in (5, 25))
    asked = [f"{few.asked_percent_all.mean():.1f}%", f"{many.asked_percent_all.mean():.0f}%"]
    assert rows[-1][1:4] == ["10%", *asked]
    assert rows[-1][4].startswith(f"{100 * many.excess_loss.mean():.2f} ± ")


def test_a_part_that_is_not_there_cannot_be_quoted():
    with pytest.raises(ValueError, match=r"of figures\.csv there is no 'figure 5': there are"):
        quotes.filled("{{notebooks/data/figures.csv: figure 5}}")


def test_the_runs_are_a_source_of_the_blocks():
    assert {"notebooks/data/figures.csv", "docs/claims.md"} <= quotes.sources()
