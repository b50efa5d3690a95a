"""Whole numbers that are asked in place of odd shares are those that are logged and learned."""

from typing import Any

import numpy as np
import pytest

from elicit import AnswerLog, Interview, PolytopeComparator, Query, Session, Subject, TruthfulTutor
from elicit.person.showing import near_in_whole_numbers, show
from qlearn import InteractivePolicyIteration, draw_values, policy_loss, random_mdp
from tests.thoroughness import quick_first, scaled

MDP, _ = random_mdp(12, 3, 5, discount=0.9, seed=3)
SUBJECT = Subject(MDP.labels, least=0)


def make(known: Any) -> Any:
    """A learner that asks about odd shares, not about bags."""
    return InteractivePolicyIteration(MDP, PolytopeComparator(5), tolerance=0.002, known=known)


def answer_one(interview: Interview, screen: dict[str, Any], values: Any) -> dict[str, Any]:
    """The answer that is right of what is shown."""
    shown = interview.shown
    assert shown is not None
    assert shown.exact
    verdict = TruthfulTutor(values)(Query("as shown", *shown.vectors)).verdict
    choice = "equal" if verdict == 0 else "a" if (verdict == 1) != shown.swapped else "b"
    return interview.handle({"do": "answer", "id": screen["question"]["id"], "choice": choice})


def answered(log: AnswerLog, values: Any, most: int = 100) -> Any:
    """The result after so many answers."""
    with Session(make, log) as session, Interview(session, SUBJECT) as interview:
        screen = interview.handle({"do": "practised", "choice": "a"})
        for _ in range(most):
            if screen["stage"] == "end":
                break
            screen = answer_one(interview, screen, values)
        return session.result()


@pytest.mark.parametrize("seed", quick_first(range(6), 3))
def test_the_end_is_reached_and_the_bound_holds(seed):
    values, log = draw_values(5, seed), AnswerLog()
    result = answered(log, values)
    assert len(log) > 2
    assert all(show(entry.answer.query).exact for entry in log)
    assert all(entry.used for entry in log)
    assert result.answers.ids == tuple(entry.answer.query.id for entry in log)
    assert result.loss_bound < 0.01
    assert policy_loss(MDP, result.policy, values).max() <= result.loss_bound
    with Session(make, log) as session, Interview(session, SUBJECT) as interview:
        assert interview.handle({"do": "state"})["stage"] == "end"


def test_killed_before_and_after_every_answer_and_undone_it_is_the_same(tmp_path):
    values, whole = draw_values(5, 1), AnswerLog()
    answered(whole, values)
    ids = [entry.answer.query.id for entry in whole]
    path, undone = tmp_path / "log.jsonl", 0
    for i, entry in enumerate(whole):
        with AnswerLog(path) as log:
            assert [each.answer.query.id for each in log if not each.retracted] == ids[:i]
            log.append(entry.answer)  # and was killed before the asker was made anew
        if i % scaled(3, 1) and entry is not whole[-1]:
            continue
        undone += 1
        with Session(make, path) as session, Interview(session, SUBJECT) as interview:
            screen = interview.handle({"do": "state"})
            assert (screen["question"] and screen["question"]["id"]) == (
                ids[i + 1] if i + 1 < len(ids) else None
            )
            screen = interview.handle({"do": "undo", "id": ids[i]})
            assert screen["question"]["id"] == ids[i]
            assert screen["question"]["rows"] == _rows(interview)
            answer_one(interview, screen, values)
            assert session.status().withdrawn == undone
    assert [e.answer.query.id for e in AnswerLog.read(path) if not e.retracted] == ids


def _rows(interview: Interview) -> Any:
    assert interview.shown is not None
    return [row._asdict() for row in interview.shown.rows]


def test_those_near_another_are_shown_exactly_and_differ_by_a_tenth_at_most():
    chance = np.random.default_rng(0)
    for size in (1, 0.1, 1e-3, 1e-4):
        left, right = chance.dirichlet(np.ones(4), 2)
        query = Query("q", left, left + size * (right - left))
        near = [*near_in_whole_numbers(query)]
        assert [one.id for one in near] == [f"q of {10**n}" for n in range(7 - len(near), 7)]
        assert near
        for one in near:
            assert show(one).exact
            assert np.abs(one.d - query.d).max() <= 0.1 * np.abs(query.d).max()
    for left, right in (
        ([0.3, 0.7], [0.3 + 1e-9, 0.7 - 1e-9]),
        ([0.3, 19.7], [10.1, 9.9]),
        ([-0.1, 1.1], [0.5, 0.5]),
    ):
        assert not [*near_in_whole_numbers(Query("q", left, right))]


def test_where_every_number_was_asked_the_session_ends():
    """An asker that goes on about one pair, whatever is said."""

    class Stubborn:
        comparator = PolytopeComparator(2)

        def __init__(self, known: Any) -> None:
            self.query = Query("q", [np.sqrt(0.1), 1 - np.sqrt(0.1)], [0.7, 0.3])

        def ask(self) -> Any:
            return (self.query,)

        def tell(self, answers: Any, on_conflict: Any = "raise") -> None:
            raise AssertionError

        def result(self) -> Any:
            return None

    log = AnswerLog()
    with (
        Session(Stubborn, log) as session,
        Interview(session, Subject(("bad", "good"), least=0)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        while screen["stage"] == "question":
            screen = answer_one(interview, screen, [0, 1])
        assert screen["end"]["open"].startswith("There is no finer question in whole numbers.")
    assert [entry.answer.query.id for entry in log] == [f"q of {10**n}" for n in range(2, 7)]
