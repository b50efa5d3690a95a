"""The benchmark of the ranges that an interview shows."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import shown_ranges as ranges


@pytest.mark.parametrize("law", [setting.scales for setting in ranges.SETTINGS[:4]])
def test_hidden_scales_increase_from_0_to_1(law: str) -> None:
    for number in range(5):
        values = ranges.scale(law, 6, number)
        assert values.shape == (6,)
        assert (values[0], values[-1]) == (0.0, 1.0)
        assert (np.diff(values) > 0).all()
    assert not np.array_equal(values, ranges.scale(law, 6, 0))


@pytest.mark.parametrize("person", [ranges.careful, ranges.as_people])
def test_simulated_people_mostly_take_what_is_worth_more(person) -> None:
    rows = [{"level": 1, "a": 10, "b": 0}, {"level": 0, "a": 0, "b": 10}]
    question = {"rows": rows, "of": 10}
    says = person(np.array([0.0, 0.9, 1.0]), 0)
    assert [says(question) for _ in range(50)].count("a") > 25


def test_people_who_seldom_err_call_small_differences_equal() -> None:
    question = {"rows": [{"level": 1, "a": 1, "b": 0}, {"level": 0, "a": 0, "b": 1}], "of": 10}
    says = ranges.careful(np.array([0.0, 0.2, 1.0]), 0)
    assert [says(question) for _ in range(50)].count("equal") > 45


def test_a_line_counts_the_values_that_lie_in_their_ranges() -> None:
    narrow, wide = np.array([[0.1, 0.5], [0.2, 0.6]]), np.array([[0.0, 0.4], [0.3, 0.9]])
    values, known = np.array([0.25, 0.55]), np.array([True, False])
    found = ranges.Found(values, narrow, narrow, wide, known, values, 7)
    line = ranges.row_of(("list", "uniform", "few"), 2, [found])
    assert len(line) == len(ranges.HEAD)
    assert line[:6] == ["list", "uniform", "few", "1 of 2", "7.0", "2"]
    numbers = [cell.split()[0] for cell in line[6:]]
    assert numbers == ["50.0", "50.0", "100.0", "10", "40", "50%", "0.0", "100.0"]
    assert ranges.row_of(("list", "uniform", "few"), 2, [])[3:5] == ["0 of 2", "none"]


@pytest.mark.slow
def test_an_interview_ends_with_the_ranges_on_its_screen(tmp_path: Path) -> None:
    ranges.write_lists(tmp_path)
    found = ranges.interview("list of 6, 4 levels", ranges.SETTINGS[0], 0, tmp_path)
    assert found is not None
    assert found.shown.shape == found.once.shape == (2, 2)
    assert (found.shown[0] <= found.whole[0]).all()
    assert (found.whole[0] <= found.once[0]).all()
    assert (found.shown[1] >= found.whole[1]).all()
