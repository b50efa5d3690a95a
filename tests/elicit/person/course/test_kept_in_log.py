"""Choices, and facts from before the first answer, come back from a log as they were kept."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import AnswerLog, Query
from elicit.person.course.kept_in_log import CHOICES, START, Before, Choices, Start
from elicit.tutors.answer_log import Asked
from tests.thoroughness import scaled

QUERY = Query("q", np.array([0.0, 1, 0]), np.array([0.5, 0, 0.5]))
FACTS = (("Problem", "care"), ("Comparator", "polytope"))
COUNTS = st.integers(0, 10_000)
# in a quick run a few letters: hypothesis takes seconds to make a table of all
TEXTS = scaled(st.text('a,"\\\n\0 é€\u2028\U0001f600', max_size=4), st.text(max_size=4))
CHOSEN = st.builds(
    Choices,
    budget=st.none() | st.integers(1, 9999),
    minutes=st.none() | st.integers(1, 9999),
    offered=COUNTS,
    heard=COUNTS,
    stopped=st.booleans(),
    width=st.none() | st.floats(1, 100),
    other=st.booleans(),
    slowed=st.booleans(),
    passed=st.lists(st.lists(TEXTS).map(tuple), max_size=3).map(tuple),
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


@pytest.mark.parametrize(
    ("kept", "width"),
    [
        ({"more": True, "values": True}, 2.0),
        ({"more": True}, 2.0),
        ({"values": True}, 40.0),
        ({"more": False, "values": False}, None),
        ({"width": 40}, 40.0),
        ({"width": -1}, None),
        ({"width": True}, None),
    ],
)
def test_records_of_earlier_versions_say_how_far_questions_go_on(kept: Any, width: Any) -> None:
    assert Choices.of([Asked(QUERY, metadata={CHOICES: kept})]).width == width


def test_a_conflict_that_was_left_is_known_in_any_order() -> None:
    chosen = Choices()
    chosen.leave(["b", "a"])
    chosen.leave(["a", "b"])
    assert chosen.leaves(["a", "b"])
    assert not chosen.leaves(["a"])
    assert len(chosen.passed) == 1


def asked(start: Any) -> list[Asked]:
    return [Asked(QUERY), Asked(QUERY, metadata={START: start}), Asked(QUERY)]


@pytest.mark.parametrize("before", [Before(0.25, False), Before(None, True)])
def test_it_is_read_as_it_was_kept(before: Before) -> None:
    kept = asked(before.record(FACTS))
    assert Before.kept(kept, FACTS) == before
    assert Before.kept(kept, (*FACTS, ("Seed", "1"))) is None
    assert Before.kept([Asked(QUERY)], FACTS) is None


@pytest.mark.parametrize("wrong", [None, 3, {"loss": "1"}, {"finished": 0}])
def test_what_is_no_record_is_passed_over(wrong: Any) -> None:
    whole = Before(0.25, False).record(FACTS)
    assert (
        Before.kept(asked({**whole, **wrong} if isinstance(wrong, dict) else wrong), FACTS) is None
    )


class Counts:
    """An asker that counts what it is asked for."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def ask(self) -> list[Query]:
        self.calls.append("ask")
        return [QUERY]

    def tell(self, answers: Any, on_conflict: str = "raise") -> None: ...

    def result(self) -> Any:
        self.calls.append("result")
        return Before(0.5, False)


def test_only_what_is_needed_is_computed() -> None:
    asker = Counts()
    start = Start(asker)  # type: ignore[arg-type]
    assert start.loss is None  # this result has no bound on a loss
    assert start.computed() is None
    assert not start.finished
    assert start.computed() == Before(None, False)
    assert asker.calls == ["result", "ask"]
