"""``qlearn.solve`` is the run that one would write by hand, and refuses what cannot work with a
sentence.
"""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import elicit
import qlearn
from elicit import (
    Answer,
    AnswerLog,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    TruthfulTutor,
)
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    InteractiveValueIteration,
    drive,
    solve,
)

MDP, VALUES = qlearn.random_mdp(8, 3, 4, discount=0.9, seed=0)


def asked_of(result: qlearn.Result) -> list[Any]:
    return [
        result.policy.tolist(),
        result.asked,
        result.answers.d.tolist(),
        result.answers.y.tolist(),
    ]


def test_by_default_it_is_policy_iteration_with_the_posterior() -> None:
    by_hand = drive(
        InteractivePolicyIteration(MDP, PosteriorComparator(4, seed=3), tolerance=0.01, seed=3),
        FlippingTutor(VALUES, 0.1, seed=1),
    )
    result = solve(MDP, FlippingTutor(VALUES, 0.1, seed=1), seed=3)
    assert asked_of(result) == asked_of(by_hand)
    assert result.loss_bound == by_hand.loss_bound <= 0.01
    assert qlearn.policy_loss(MDP, result.policy, VALUES).max() <= 0.01


@pytest.mark.parametrize("name", ["posterior", "polytope", "ensemble", "box-rescaled", "box"])
def test_every_comparator_by_name(name: Any) -> None:
    tutor = TruthfulTutor(VALUES)
    result = solve(MDP, tutor, name, tolerance=0.05, seed=1, max_queries=6)
    assert result.comparator.k == 4
    assert result.asked <= 6
    assert asked_of(solve(MDP, tutor, name, tolerance=0.05, seed=1, max_queries=6)) == asked_of(
        result
    )


@pytest.mark.parametrize(
    ("name", "made"),
    [
        (
            "policy-iteration",
            lambda known: InteractivePolicyIteration(MDP, known, tolerance=0.02, seed=5),
        ),
        (
            "value-iteration",
            lambda known: InteractiveValueIteration(MDP, known, tolerance=0.02, seed=5),
        ),
        ("q-learning", lambda known: InteractiveQLearning(MDP, known, seed=5)),
    ],
)
def test_every_learner_by_name(name: Any, made: Any) -> None:
    tutor = TruthfulTutor(VALUES)
    result = solve(MDP, tutor, PolytopeComparator(4), tolerance=0.02, seed=5, learner=name)
    assert asked_of(result) == asked_of(drive(made(PolytopeComparator(4)), tutor))


def test_a_tutor_may_return_a_verdict_and_sees_only_queries() -> None:
    seen: list[Query] = []

    def verdict(query: Query) -> int:
        seen.append(query)
        return int(np.sign(query.d @ VALUES))

    result = solve(MDP, verdict, "polytope")
    assert asked_of(result) == asked_of(solve(MDP, TruthfulTutor(VALUES), "polytope"))
    assert len(seen) == result.asked
    assert asked_of(
        solve(MDP, lambda query: elicit.Verdict(verdict(query)), "polytope")
    ) == asked_of(result)
    assert asked_of(solve(MDP, lambda query: np.int8(verdict(query)), "polytope")) == asked_of(
        result
    )


@pytest.mark.parametrize("seed", [None, np.random.SeedSequence(4), np.random.default_rng(4)])
def test_any_seed(seed: Any) -> None:
    assert solve(MDP, TruthfulTutor(VALUES), seed=seed, max_queries=3).asked <= 3


def test_what_a_log_holds_is_not_asked_again() -> None:
    log, rounds = AnswerLog(), list[int]()
    first = solve(
        MDP,
        TruthfulTutor(VALUES),
        "polytope",
        log=log,
        progress=lambda so_far: rounds.append(so_far.asked),
    )
    assert first.asked == len(log) == len(rounds) > 0

    def nobody(query: Query) -> Answer:
        raise AssertionError(query)

    again = solve(MDP, nobody, "polytope", log=log)
    assert (again.asked, again.policy.tolist()) == (0, first.policy.tolist())


def test_the_parameters_of_its_own_are_at_most_nine() -> None:
    assert len(inspect.signature(solve).parameters) <= 9


TRUTH = TruthfulTutor(VALUES)


@pytest.mark.parametrize(
    ("arguments", "settings", "error", "message"),
    [
        (
            ((MDP, VALUES), TRUTH),
            {},
            TypeError,
            "mdp must be a qlearn.OrdinalMDP, not a tuple: it holds one",
        ),
        ((VALUES, TRUTH), {}, TypeError, "mdp must be a qlearn.OrdinalMDP, not a ndarray$"),
        ((MDP, "ann"), {}, TypeError, "'ann' cannot be called"),
        ((MDP, TruthfulTutor), {}, TypeError, "not the class TruthfulTutor: make one"),
        (
            (MDP, TruthfulTutor([0, 1, 2])),
            {},
            ValueError,
            "about 4 levels, but the tutor was made for 3",
        ),
        (
            (MDP, TRUTH, "postrior"),
            {},
            ValueError,
            "one of .*'posterior', .*, or a Comparator, not 'postrior'",
        ),
        (
            (MDP, TRUTH, PolytopeComparator(5)),
            {},
            ValueError,
            "has 4 levels, .* made for k = 5: make it with k = 4",
        ),
        ((MDP, TRUTH, PolytopeComparator), {}, TypeError, "a comparator is wanted"),
        ((MDP, TRUTH, None), {}, TypeError, "a comparator is wanted"),
        ((MDP, TRUTH), {"learner": "ivi"}, ValueError, "one of .*'policy-iteration', not 'ivi'"),
        ((MDP, TRUTH), {"learner": InteractiveQLearning}, ValueError, "learner must be one of"),
        ((MDP, TRUTH), {"tolerance": 1.5}, ValueError, "tolerance must be a share .*, not 1.5"),
        (
            (MDP, TRUTH),
            {"max_queries": -1},
            ValueError,
            "max_queries must be None or a whole number .*, not -1",
        ),
        (
            (MDP, TRUTH),
            {"log": "answers.jsonl"},
            TypeError,
            r"an elicit.AnswerLog, such as .*, not 'answers.jsonl'",
        ),
        ((MDP, TRUTH), {"progress": 3}, TypeError, "progress must be None or a function.*not 3"),
        ((MDP, TRUTH), {"tolerence": 0.1}, TypeError, "'tolerence'. The nearest is 'tolerance'"),
        ((MDP, TRUTH), {"seed": "one"}, TypeError, "a seed must be"),
        ((MDP, lambda query: None), {}, TypeError, r"None is no answer: give elicit"),
        ((MDP, lambda query: 0.5), {}, TypeError, r"0\.5 is no answer: give elicit"),
        (
            (MDP, lambda query: True),
            {},
            TypeError,
            "a comparison of two numbers is written 1 if left > right else -1 if",
        ),
        ((MDP, lambda query: 2), {}, ValueError, "or 0 \\(equal\\), not 2; of a pair"),
    ],
)
def test_what_is_refused_and_what_to_do(
    arguments: Any, settings: Any, error: Any, message: str
) -> None:
    with pytest.raises(error, match=message):
        solve(*arguments, **settings)


@pytest.mark.parametrize(
    ("comparator", "meant"),
    [
        (PolytopeComparator(4), "at most 2% of"),
        (PosteriorComparator(4, seed=0), "is learned from these answers"),
        (PosteriorComparator(4, tie=0.0, seed=0), "do not differ at all"),
    ],
)
def test_a_result_warns_where_many_answers_are_equal(comparator: Any, meant: str) -> None:
    result = solve(MDP, lambda _: 0, comparator, tolerance=0.001, seed=0, max_queries=6)
    assert (result.answers.y == 0).sum() >= 3
    assert meant in result.tie_warning
    assert result.tie_warning in str(result)
    exact = solve(MDP, TruthfulTutor(VALUES), seed=0, max_queries=8)
    assert exact.tie_warning == ""


@pytest.mark.parametrize(("asked", "warned"), [(2, False), (3, True)])
def test_a_result_of_few_answers_warns_from_three_equal_ones_on(asked: int, warned: bool) -> None:
    comparator = PosteriorComparator(4, seed=0)
    result = solve(MDP, lambda _: 0, comparator, tolerance=0.001, seed=0, max_queries=asked)
    assert (result.answers.y == 0).sum() == asked
    assert bool(result.tie_warning) == warned


def test_a_tutor_may_return_the_sign_of_a_float() -> None:
    mdp, _ = qlearn.random_mdp(6, 2, len(VALUES), seed=3)
    whole = qlearn.solve(mdp, lambda query: int(np.sign(query.d @ VALUES)), "polytope", seed=0)
    signs = qlearn.solve(mdp, lambda query: np.sign(query.d @ VALUES), "polytope", seed=0)
    assert signs.asked == whole.asked > 0
    assert (signs.policy == whole.policy).all()
    with pytest.raises(TypeError, match=r"0\.5 is no answer: .* may return 1"):
        qlearn.solve(mdp, lambda query: 0.5, "polytope", seed=0)


def test_without_an_answer_the_bound_is_said_to_be_about_scales_not_about_a_tutor() -> None:
    mdp = qlearn.OrdinalMDP.from_dense([[[1.0]]], [[0]], 0.9, ["bad", "good"])
    said = str(qlearn.solve(mdp, lambda query: 1, seed=0))
    assert "No question was asked: this policy was good enough before any answer." in said
    assert "tutors" not in said
    assert "over the values that the comparator takes for possible" in said


LEARNER = InteractivePolicyIteration(MDP, PolytopeComparator(4))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((TRUTH, LEARNER), r"the learner and the tutor are swapped: write drive\(learner, tutor\)"),
        ((MDP, TRUTH), r"wants a learner first, .*but OrdinalMDP\(.*\) has no ask"),
        ((InteractivePolicyIteration, TRUTH), "is the class of one: make one"),
        (
            (LEARNER, TRUTH, "answers.jsonl"),
            "log must be None or an elicit.AnswerLog.*not 'answers",
        ),
        ((LEARNER, TRUTH, None, 3), "progress must be None or a function.*not 3"),
    ],
)
def test_what_drive_refuses_before_it_asks(given: tuple[Any, ...], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        drive(*given)


def test_a_result_has_its_problem_and_its_discount() -> None:
    result = solve(MDP, TRUTH, "polytope", seed=0)
    assert result.mdp is MDP
    assert result.discount == MDP.discount
