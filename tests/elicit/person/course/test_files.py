"""Tables to keep are read back as they were written."""

import csv
import io
import json

import pytest

from elicit.person.course.files import as_csv, as_json

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
