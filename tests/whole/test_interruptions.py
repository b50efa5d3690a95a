"""Ctrl+C inside ``tell``, at any line: nothing has changed, or everything."""

import copy
from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np
import pytest

from elicit import (
    Answer,
    AnswerLog,
    BradleyTerryTutor,
    PolytopeComparator,
    Query,
    Session,
    StaleAnswer,
    choose,
)
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    InteractiveTraining,
    InteractiveValueIteration,
    LateQLearning,
    LateValueIteration,
    OrdinalMDP,
    evaluate_policy,
    random_mdp,
    value_iteration,
)
from tests.interruptions import interrupted_at_each_line
from tests.thoroughness import quick_first

K = 4
MDP: OrdinalMDP
MDP, VALUES = random_mdp(4, 3, K, rng=2, discount=0.8)
HARDER, _ = random_mdp(
    12, 3, K, rng=5, discount=0.9
)  # policy iteration asks too little of the other
VECTORS = np.random.default_rng(0).dirichlet(np.ones(K), 5)


def says(query: Query) -> Answer:
    """Without memory, so that a run that is told again goes as before."""
    return BradleyTerryTutor(VALUES, 30.0, seed=3)(query)


def training(known: Any = ()) -> InteractiveTraining:
    return InteractiveTraining(
        PolytopeComparator(K, tie=0),
        discount=MDP.discount,
        tolerance=0.02,
        optimality_gap=0.0,
        known=known,
    )


def comparator() -> PolytopeComparator:
    return PolytopeComparator(K, tie=0)


ASKERS: dict[str, Callable[..., Any]] = {
    "Q-learning": lambda known=(): InteractiveQLearning(
        MDP, comparator(), steps=100, audit=0.2, known=known
    ),
    "Q-learning asking late": lambda known=(): LateQLearning(
        MDP, comparator(), steps=300, known=known
    ),
    "value iteration": lambda known=(): InteractiveValueIteration(
        MDP, comparator(), tolerance=0.05, audit=0.2, batch=2, known=known
    ),
    "value iteration asking late": lambda known=(): LateValueIteration(
        MDP, comparator(), tolerance=0.05, known=known
    ),
    "policy iteration": lambda known=(): InteractivePolicyIteration(
        HARDER, comparator(), tolerance=0.001, audit=0.2, known=known
    ),
    "choose": lambda known=(): choose(VECTORS, comparator(), order=True, known=known),
    "training": training,
}


def ahead(asker: Any) -> tuple[Query, ...]:
    """The next questions, after all that needs no tutor."""
    while True:
        queries: tuple[Query, ...] = asker.ask()
        if queries or not isinstance(asker, InteractiveTraining) or asker.finished:
            return queries
        values = asker.to_train()
        _, policy = value_iteration(MDP, values)
        asker.add(policy, MDP.initial @ evaluate_policy(MDP, policy))


def told(asker: Any, queries: tuple[Query, ...]) -> None:
    asker.tell([says(query) for query in queries], "drop")


def run(asker: Any) -> list[str]:
    """The ids of the questions to the end."""
    ids = []
    while queries := ahead(asker):
        ids += [query.id for query in queries]
        told(asker, queries)
    return ids


def outcome(asker: Any) -> str:
    """Return the result of an asker and all its counts, to the last bit."""
    found = asker.result()
    best = found.best if hasattr(found, "best") else found.policy
    parts = (
        best,
        found.status,
        found.asked,
        found.cannot_tell,
        found.answers.ids,
        found.comparator.values.tobytes(),
    )
    more = [getattr(found, name, None) for name in ("order", "decided", "audits")]
    return repr(parts) + repr(
        [more[0], more[1], [(a.query.id, a.expected, a.answer) for a in more[2] or ()]]
    )


def at_question(make: Callable[[], Any], number: int) -> Any:
    """An asker that waits for the answer to this question, or the last one."""
    asker = make()
    for _ in range(number):
        before, queries = copy.deepcopy(asker), ahead(asker)
        told(asker, queries)
        if not ahead(asker):
            asker = before
            break
    assert ahead(asker)
    return asker


@pytest.mark.parametrize("name", ASKERS)
def test_an_interrupted_tell_has_changed_nothing_or_all(name: str) -> None:
    asker = at_question(ASKERS[name], 2)
    queries = ahead(asker)
    rest = copy.deepcopy(asker)
    ids, wanted = run(rest), outcome(rest)
    ends = set()
    for broken_off in interrupted_at_each_line(
        lambda: copy.deepcopy(asker), lambda one: told(one, queries)
    ):
        pending = ahead(broken_off)
        unchanged = [query.id for query in pending] == [query.id for query in queries]
        if not unchanged:
            with pytest.raises(StaleAnswer):
                told(broken_off, queries)
        ends.add(unchanged)
        assert run(broken_off) == (ids if unchanged else ids[len(queries) :])
        assert outcome(broken_off) == wanted
    assert ends == {True, False}


@pytest.mark.parametrize("name", quick_first(["value iteration", "policy iteration", "choose"], 1))
def test_an_interrupted_answer_to_a_session_is_logged_and_told_or_neither(
    name: str, tmp_path: Any
) -> None:
    number = count()

    def begun() -> Session:
        session = Session(ASKERS[name], tmp_path / f"{next(number)}.jsonl", clock=lambda: 0.0)
        answered(session)
        session.question()
        return session

    def answered(session: Session) -> str:
        query = session.question()
        assert query is not None
        session.answer(query.id, says(query).verdict)
        return query.id

    def finished(session: Session) -> list[str]:
        ids = []
        while session.question() is not None:
            ids.append(answered(session))
        return ids

    undisturbed = begun()
    asked = undisturbed.question()
    assert asked is not None
    ids, wanted = finished(undisturbed), outcome(undisturbed)
    undisturbed.close()
    folders = (
        "elicit/person",
        "elicit/tutors",
        "elicit/asking",
        "qlearn/learners",
    )  # the others only compute
    for session in interrupted_at_each_line(begun, answered, folders):
        unchanged = len(session.log) == 1
        query = session.question()
        assert (query is not None and query.id == asked.id) is unchanged
        session.answer(asked.id, says(asked).verdict)  # as somebody does who saw nothing happen
        assert len(session.log) == 2
        assert finished(session) == ids[1:]
        assert outcome(session) == wanted
        session.close()
        read = AnswerLog.read(session.log.path)
        assert [entry.answer.query.id for entry in read][1:] == ids
        assert read.restarted == 0
