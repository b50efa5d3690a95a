"""Facts from before the first answer are kept in the log, and read for the same facts only."""

from typing import Any

import numpy as np
import pytest

from elicit import Query
from elicit.person.course.start import START, Before, Start
from elicit.tutors.answer_log import Asked

FACTS = (("Problem", "care"), ("Comparator", "polytope"))
QUERY = Query("q", np.array([0.0, 1.0, 0.0]), np.array([0.5, 0.0, 0.5]))


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
