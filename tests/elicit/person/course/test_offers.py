"""Stopping is offered after enough answers and checks, and not again at once."""

from dataclasses import replace

import pytest

from elicit.person.course.conclusion import NearlyEnough
from elicit.person.course.conduct import Conduct
from elicit.person.course.offers import (
    NEARLY_AGAIN,
    NEARLY_FROM,
    after_plan,
    after_unsure,
    may_be_near,
    nearly_is_due,
)

SAID = Conduct(answered=9, with_verdict=9, checks=3, differed=0, last="a", in_a_row=1, repeated=3)


@pytest.mark.parametrize(
    ("answered", "offered", "due"),
    [
        (NEARLY_FROM - 4, 0, False),
        (NEARLY_FROM - 3, 0, True),
        (NEARLY_FROM - 3, 3, False),  # 3 of the answers are repeats
        (NEARLY_AGAIN, 3, True),
        (NEARLY_FROM + NEARLY_AGAIN - 4, NEARLY_FROM, False),
        (NEARLY_FROM + NEARLY_AGAIN - 3, NEARLY_FROM, True),
    ],
)
def test_the_end_is_offered_after_some_answers_and_then_after_some_more(
    answered: int, offered: int, due: bool
) -> None:
    assert nearly_is_due(replace(SAID, answered=answered), offered) is due


@pytest.mark.parametrize(
    ("how", "may"),
    [
        ({}, True),
        ({"checks": 0}, False),  # nothing has been checked
        ({"checks": 1}, False),  # half of those who answer by chance do as well
        ({"differed": 1}, False),
        ({"checks": 5, "differed": 1}, True),
        ({"checks": 11, "differed": 2}, True),
        ({"in_a_row": 12}, False),  # always the same side
        ({"checks": 4, "differed": 3}, False),  # like guesses
        ({"with_verdict": 4}, False),
    ],
)
def test_little_loss_is_said_only_of_answers_that_were_checked(
    how: dict[str, int], may: bool
) -> None:
    assert may_be_near(replace(SAID, **how), 5) is may  # type: ignore[arg-type]


def test_other_offers_say_it_too() -> None:
    nearly = NearlyEnough("X and Y are nearly equal to you", "You lose at most 2.", "Much.")
    for offer in (after_unsure(3, nearly), after_plan("You planned 3", nearly)):
        assert "X and Y are nearly equal to you. You lose at most 2. " in offer["text"]
    assert after_unsure(3, None)["text"] == "That is fine. What would you like to do?"
