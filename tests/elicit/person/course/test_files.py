"""Tables to keep are read back as they were written."""

import csv
import io
import json

import pytest

from elicit import Answer, AnswerLog, Query, Verdict
from elicit.person.course.files import answer_row, as_csv, as_json, use_of
from elicit.person.showing import show
from elicit.tutors.answer_log import EXPECTED, REPEATS

ROWS = [{"level": "a, b", "value": 1.5, "low": None}, {"level": 'c "d"', "value": 2, "low": 0}]


def test_json_and_csv_are_read_back() -> None:
    assert json.loads(as_json(ROWS)) == ROWS
    assert [*csv.reader(io.StringIO(as_csv(ROWS)))] == [
        ["level", "value", "low"],
        ["a, b", "1.5", ""],
        ['c "d"', "2", "0"],
    ]
    assert as_csv([]) == ""


@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t"])
def test_a_name_is_no_formula_in_a_spreadsheet(start: str) -> None:
    text = as_csv([{"level": f"{start}1+1", "value": -1.0}])
    assert [*csv.reader(io.StringIO(text, newline=""))][1] == [f"'{start}1+1", "-1.0"]


def test_a_carriage_return_does_not_end_a_line() -> None:
    text = as_csv([{"level": "a\rb"}])
    assert [*csv.reader(io.StringIO(text, newline=""))] == [["level"], ["a b"]]


def test_a_row_of_an_answer_has_a_column_for_each_level_and_says_how_it_is_used() -> None:
    query = Query("q", [0, 1, 0], [0.4, 0, 0.6], labels=("died", "ill", "well"))
    log = AnswerLog(k=3)
    log.append(Answer(query, Verdict.BETTER))
    log.append(Answer(Query("r", query.left, query.right), None))
    again = Answer(Query("q again", query.left, query.right), Verdict.WORSE)
    log.append(again, used=False, **{REPEATS: "q", EXPECTED: 1})
    row = answer_row(1, log[0], show(query), "ill rather")
    for side in "ab":
        counts = show(query).record()[side]
        assert [row[f"{side}: {label}"] for label in ("died", "ill", "well")] == counts
    assert row["used"] == "yes"
    assert use_of(log[0], in_conflict=True) == "yes, though it contradicts others"
    assert use_of(log[1]) == "no: it says cannot tell"
    assert use_of(log[2]).startswith("check: it differs from the first answer")
    log.retract("q")
    assert use_of(log[0]) == "no: taken back"
