"""Learners and their results as text: short, and without being computed for it."""

import math
import re
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

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
from elicit.person.findings import certainty

MDP, VALUES = qlearn.random_mdp(8, 3, 4, discount=0.9, seed=0)
LEARNERS = [
    qlearn.InteractiveQLearning,
    qlearn.InteractiveValueIteration,
    qlearn.InteractivePolicyIteration,
]


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
    shown = (
        f"Result(status={result.status.name}, asked={result.asked}, loss_bound={bound:.3g}, "
        "confidence=1)"
    )
    assert repr(result) == shown
    unsure = qlearn.drive(
        kind(MDP, PolytopeComparator(4), **settings), lambda query: Answer(query, None)
    )
    assert f"cannot_tell={unsure.cannot_tell}" in repr(unsure)


def test_a_printed_result_says_what_its_bound_is_a_share_of_and_the_bound_in_units_of_return() -> (
    None
):
    mdp, values = qlearn.random_mdp(30, 3, 5, seed=1)
    result = qlearn.solve(mdp, TruthfulTutor(values), "polytope")
    status, asked, share, loss = str(result).splitlines()
    assert status == "Finished: the bound on the policy's loss is within the tolerance."
    assert asked == f"{result.asked} questions were asked."
    said = re.fullmatch(
        r"The policy loses at most (\S+)% of the value range at the worst state "
        r"\(proven, if the answers are right\)\.",
        share,
    )
    assert said is not None
    assert result.loss_bound <= float(said[1]) / 100 <= 1.01 * result.loss_bound
    said = re.fullmatch(
        r"That is as bad as a chance of (\S+)%, at every step, of 'level 1' in place of "
        r"'level 5'\. Or as (\S+) steps at 'level 1' right away, since later steps "
        r"count less, by the discount of 0\.95\.",
        loss,
    )
    assert said is not None
    assert result.loss_bound <= float(said[1]) / 100 <= 1.01 * result.loss_bound
    assert result.return_loss_bound == result.loss_bound / (1 - mdp.discount)
    assert result.return_loss_bound <= float(said[2]) <= 1.01 * result.return_loss_bound


def test_the_loss_of_return_is_what_another_library_would_find() -> None:
    result = qlearn.solve(MDP, TruthfulTutor(VALUES), "polytope", tolerance=0.2, max_queries=1)
    rewards = MDP.rewards((VALUES - VALUES[0]) / (VALUES[-1] - VALUES[0]))

    def greatest_return(actions: NDArray[np.bool_]) -> NDArray[np.float64]:
        v = np.zeros(MDP.n_states)
        for _ in range(500):
            q = rewards + MDP.discount * (MDP.probabilities * v[MDP.successors]).sum(axis=2)
            v = np.where(actions, q, -np.inf).max(axis=1)
        return v

    own = np.arange(MDP.n_actions) == result.policy[:, None]
    lost = greatest_return(MDP.admissible) - greatest_return(own)
    assert 0 <= lost.max() <= result.return_loss_bound + 1e-9


@pytest.mark.parametrize(
    ("bound", "confidence", "words"),
    [
        (
            0.01,
            1.0,
            ["1% of the value range", "(proven, if the answers are right)", "as 0.1 steps"],
        ),
        (
            0.01001,
            0.95,
            [
                "1.01%",
                "(with probability 0.95, on average over the values and tutors that the "
                "comparator assumes)",
                "0.101 steps",
            ],
        ),
        (1e-16, math.nan, ["0.0001%", "(with unknown confidence)", "as 1e-05 steps"]),
        (0.0, 1.0, [" 0% of", "as 0 steps"]),
        (1.0, 1.0, ["100%", "as 10 steps"]),
        (math.nan, math.nan, ["No bound on the policy's loss can be given."]),
    ],
)
def test_a_printed_bound_is_rounded_up_and_says_how_sure_it_is(
    bound: float, confidence: float, words: list[str]
) -> None:
    some = qlearn.solve(MDP, TruthfulTutor(VALUES), "polytope", max_queries=1)
    shown = str(replace(some, guarantee=lambda: qlearn.Guarantee(bound, confidence)))
    assert "\n1 question was asked.\n" in shown
    assert all(word in shown for word in words), shown


@pytest.mark.parametrize(
    ("wrong", "words"),
    [(1, "even if one of the answers is wrong"), (2, "even if 2 of the answers are wrong")],
)
def test_a_bound_that_survives_wrong_answers_says_so(wrong: int, words: str) -> None:
    some = qlearn.solve(
        MDP, TruthfulTutor(VALUES), PolytopeComparator(MDP.k, wrong=wrong), max_queries=1
    )
    assert f"(proven, {words})" in str(some)
    assert certainty(some.comparator) == words.replace("the answers", "your answers")


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
        (plain,) = kind(
            replace(NAMED, state_names=None, action_names=None), PolytopeComparator(4)
        ).ask()
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
    assert (
        repr(BradleyTerryTutor([0, 1, 2], 5, seed=3))
        == "BradleyTerryTutor(k=3, precision=5, seed=3)"
    )
    assert repr(ReplayTutor([])) == "ReplayTutor(0 answers)"


@pytest.mark.parametrize("kind", LEARNERS)
def test_a_printed_result_names_what_the_policy_does(kind: Any) -> None:
    settings = {"steps": 2000} if kind is qlearn.InteractiveQLearning else {}
    named = replace_names(MDP, states=[f"s{i}" for i in range(8)], actions=["wait", "cut", "burn"])
    result = qlearn.drive(kind(named, PolytopeComparator(4), **settings), TruthfulTutor(VALUES))
    listed = [f"s{s}: {named.action_name(a)}" for s, a in enumerate(result.policy)]
    said = f"What it does in each state with a choice: {'; '.join(listed)}."
    assert said in str(result).splitlines()
    plain = qlearn.drive(kind(MDP, PolytopeComparator(4), **settings), TruthfulTutor(VALUES))
    assert "What it does" not in str(plain)


def test_a_long_policy_is_counted_by_action_where_there_is_a_choice() -> None:
    mdp = qlearn.problems.FAMILIES["rover"](0)
    values = qlearn.draw_values(mdp.k, seed=0)
    result = qlearn.solve(mdp, TruthfulTutor(values), comparator="polytope", seed=0)
    choices = ~mdp.terminal & (mdp.admissible.sum(axis=1) > 1)
    names = [mdp.action_name(a) for a in result.policy[choices]]
    (said,) = re.findall(r"Of (\d+) states with a choice, it takes (.*)\.", str(result))
    assert int(said[0]) == choices.sum() > 12
    counted = dict(part.rsplit(" in ", 1) for part in said[1].split(", "))
    assert counted == {name: f"{names.count(name):,}" for name in names}


def test_a_result_without_a_question_says_that_none_was_needed() -> None:
    same = qlearn.OrdinalMDP([[[0], [0]]], [[[1.0], [1.0]]], [[1, 0]], 0.5, ("bad", "good"))
    result = qlearn.solve(same, TruthfulTutor([0, 1]), seed=0)
    assert result.asked == 0
    assert "No question was asked: this policy was good enough before any answer." in str(result)


def replace_names(
    mdp: qlearn.OrdinalMDP, states: list[str], actions: list[str]
) -> qlearn.OrdinalMDP:
    return qlearn.OrdinalMDP(
        mdp.successors,
        mdp.probabilities,
        mdp.levels,
        mdp.discount,
        mdp.labels,
        state_names=states,
        action_names=actions,
    )
