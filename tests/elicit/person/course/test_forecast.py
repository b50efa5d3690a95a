"""Forecasts of questions left do not jump, and a loss that rose says why."""

import pytest

from elicit.person.course.forecast import QuestionsLeft, Stated, rise


def test_a_forecast_counts_down_and_changes_only_if_it_is_off_by_much() -> None:
    left = QuestionsLeft()
    assert left.shown(None, 0, 9) is None
    assert left.shown((8, 18), 0, 9) == (9, 18)
    assert left.shown((6, 16), 1, 8) == (8, 17)  # off by one
    assert left.shown(None, 2, 7) == (7, 16)
    assert left.shown((2, 9), 3, 6) == (6, 9)  # off by six
    assert left.shown((6, 10), 4, 5) == (5, 8)  # off by two
    assert left.shown((6, 11), 5, 4) == (6, 11)  # off by four


def test_a_forecast_is_never_below_what_must_come() -> None:
    left = QuestionsLeft()
    assert left.shown((0, 1), 0, 5) == (5, 5)
    for put, least in ((1, 4), (2, 5), (3, 0), (9, 2)):
        shown = left.shown(None, put, least)
        assert shown is None or shown[1] >= max(least, shown[0])
    assert QuestionsLeft().shown((3, 4), 10, 0) == (3, 4)


@pytest.mark.parametrize("checked", [False, True])
def test_a_loss_that_rose_says_why(checked: bool) -> None:
    for loss, before in ((None, 0.1), (0.1, None), (0.02, 0.02), (0.02, 0.03)):
        assert rise(loss, Stated(before, checked)) is None
    assert "varies a little" in str(rise(0.0301, Stated(0.03, checked)))
    said = str(rise(0.04, Stated(0.03, checked)))
    assert "more values are plausible than it seemed" in said
    assert said.endswith("The check in between did not change it.") == checked
    exact = str(rise(0.0301, Stated(0.03, checked), exact=True))
    assert "changed the plan" in exact
    assert "estimated" not in exact
