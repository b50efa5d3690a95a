"""What learners and their results look like where people read them: short, and without being computed for it."""

import re
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

import elicit
import qlearn
from elicit import (
    Answer,
    Answers,
    Bags,
    BradleyTerryTutor,
    FlippingTutor,
    PolytopeComparator,
    ReplayTutor,
    TruthfulTutor,
)

MDP, VALUES = qlearn.random_mdp(8, 3, 4, discount=0.9, seed=0)
LEARNERS = [qlearn.InteractiveQLearning, qlearn.InteractiveValueIteration, qlearn.InteractivePolicyIteration]


@pytest.mark.parametrize("kind", LEARNERS)
def test_a_learner(kind: Any) -> None:
    learner = kind(MDP, PolytopeComparator(4), seed=7)
    shown = f"{kind.__name__}(PolytopeComparator, k=4, asked="
    assert repr(learner) == shown + "0, pending=0, seed=7)"
    assert learner.ask()
    assert repr(learner) == shown + "0, pending=1, seed=7)"


@pytest.mark.parametrize("kind", LEARNERS)
def test_a_result_says_what_its_policy_may_lose_once_that_is_known(kind: Any) -> None:
    settings = {"steps": 2000} if kind is qlearn.InteractiveQLearning else {}
    result = qlearn.drive(kind(MDP, PolytopeComparator(4), **settings), TruthfulTutor(VALUES))
    assert repr(result) == f"Result(status={result.status.name}, asked={result.asked})"
    bound = result.loss_bound
    shown = f"Result(status={result.status.name}, asked={result.asked}, loss_bound={bound:.3g}, confidence=1)"
    assert repr(result) == shown
    unsure = qlearn.drive(kind(MDP, PolytopeComparator(4), **settings), lambda query: Answer(query, None))
    assert f"cannot_tell={unsure.cannot_tell}" in repr(unsure)


NAMED = replace(
    MDP,
    labels=tuple("abcd"),
    state_names=[f"ward {s}" for s in range(8)],
    action_names=["operate", "wait", "send home"],
)
ALL = [
    *LEARNERS,
    qlearn.LateValueIteration,
    partial(qlearn.LateQLearning, steps=300),
    partial(qlearn.InteractivePolicyIteration, bags=Bags(days=4)),
]


@pytest.mark.parametrize("kind", ALL)
def test_a_question_names_state_actions_and_levels(kind: Any) -> None:
    (query,) = kind(NAMED, PolytopeComparator(4)).ask()
    assert query.labels == ("a", "b", "c", "d")
    bag = "bags" in getattr(kind, "keywords", {})
    wanted = (
        r"of 4 days: .*"
        if bag
        else r"state ward \d: action (operate|wait|send home) \(left\) or \w+( home)? \(right\)\?"
    )
    assert re.fullmatch(wanted, query.about)
    assert re.search(r"left:  .*\d% [abcd]", str(query))
    if not bag:
        (plain,) = kind(replace(NAMED, state_names=None, action_names=None), PolytopeComparator(4)).ask()
        assert plain.id == query.id
        assert re.fullmatch(r"state \d: action \d \(left\) or action \d \(right\)\?", plain.about)


def test_answers_without_their_queries_cannot_be_replayed_or_drawn() -> None:
    bare = Answers([[1, -1]], [1])
    for takes in (ReplayTutor, elicit.graph.preference_graph):
        with pytest.raises(TypeError, match=r"a log holds entries or Answers, not AnswerRow\("):
            takes(bare)


def test_tutors() -> None:
    assert repr(TruthfulTutor([0, 1, 2])) == "TruthfulTutor(k=3)"
    assert repr(TruthfulTutor([0, 1, 2], tie=0.01)) == "TruthfulTutor(k=3, tie=0.01)"
    assert repr(FlippingTutor([0, 1, 2], 0.1)) == "FlippingTutor(k=3, error_rate=0.1, seed=0)"
    assert repr(BradleyTerryTutor([0, 1, 2], 5, seed=3)) == "BradleyTerryTutor(k=3, precision=5, seed=3)"
    assert repr(ReplayTutor([])) == "ReplayTutor(0 answers)"
