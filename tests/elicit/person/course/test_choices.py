"""Choices come back from a log as they were kept, whatever else its lines say."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import AnswerLog, Query
from elicit.person.course.choices import CHOICES, Choices
from elicit.tutors.answer_log import Asked

QUERY = Query("q", np.array([0.0, 1, 0]), np.array([0.5, 0, 0.5]))
COUNTS = st.integers(0, 10_000)
CHOSEN = st.builds(
    Choices,
    budget=st.none() | st.integers(1, 9999),
    minutes=st.none() | st.integers(1, 9999),
    offered=COUNTS,
    heard=COUNTS,
    stopped=st.booleans(),
    more=st.booleans(),
    other=st.booleans(),
    slowed=st.booleans(),
    passed=st.lists(st.lists(st.text(max_size=4)).map(tuple), max_size=3).map(tuple),
)


@given(CHOSEN)
def test_what_a_line_keeps_is_read_again(chosen: Choices) -> None:
    log = AnswerLog()
    log.append_asked(QUERY)
    assert Choices.of(log.asked) == Choices()
    log.append_asked(QUERY, **{CHOICES: chosen.record()})
    log.append_asked(QUERY)  # which says nothing of them
    assert Choices.of(log.asked) == chosen


@pytest.mark.parametrize(
    "kept",
    [
        *(None, 3, "x", []),
        *({"budget": 0}, {"budget": True}, {"budget": "9"}, {"offered": -1}, {"stopped": 1}),
        {"passed": "x", "unheard of": 1},
    ],
)
def test_what_is_not_of_its_kind_is_as_at_the_start(kept: Any) -> None:
    assert Choices.of([Asked(QUERY, metadata={CHOICES: kept})]) == Choices()


def test_a_conflict_that_was_left_is_known_in_any_order() -> None:
    chosen = Choices()
    chosen.leave(["b", "a"])
    chosen.leave(["a", "b"])
    assert chosen.leaves(["a", "b"])
    assert not chosen.leaves(["a"])
    assert len(chosen.passed) == 1
