"""Tutors who call equal what is close: bounds that hold, learners that end, and not one question
more for others.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from elicit import (
    AlwaysAsk,
    Answer,
    Answers,
    BradleyTerryComparator,
    InconsistentAnswers,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    Tier,
    TruthfulTutor,
    Verdict,
)
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    InteractiveValueIteration,
    LateQLearning,
    LateValueIteration,
    Result,
    Status,
    drive,
    policy_loss,
    random_mdp,
)
from tests.thoroughness import on_any_processor, quick_first, scaled

LEARNERS = {
    "policy iteration": InteractivePolicyIteration,
    "value iteration": InteractiveValueIteration,
    "late value iteration": LateValueIteration,
    "Q-learning": partial(InteractiveQLearning, steps=6000),
    "late Q-learning": partial(LateQLearning, steps=6000),
}


def run(
    learner: Any, k: int, tie: float, seed: int, comparator: Any = None, **settings: Any
) -> tuple[Result, float]:
    """The result with a tutor who calls equal what lies within ``tie``, and what its policy truly
    loses.
    """
    mdp, values = random_mdp(40, 4, k, rng=seed)
    made = learner(mdp, PolytopeComparator(k) if comparator is None else comparator, **settings)
    result = drive(made, TruthfulTutor(values, tie=tie))
    return result, float(policy_loss(mdp, result.policy, values).max())


def check_bound(result: Result, loss: float) -> None:
    assert result.confidence == 1
    assert loss <= result.loss_bound + 1e-12, (
        f"it loses {loss}, but was to lose {result.loss_bound} at most"
    )


@pytest.mark.parametrize("tie", [0.005, 0.02])
@pytest.mark.parametrize("name", quick_first(LEARNERS, 3))
def test_no_bound_is_broken_by_a_tutor_who_calls_equal_what_is_close(name, tie):
    for k, seed in ((5, 1), (8, 3))[: scaled(1, 2)]:
        check_bound(*run(LEARNERS[name], k, tie, seed))


@pytest.mark.slow
@pytest.mark.parametrize("k", [5, 8, 12])
@pytest.mark.parametrize("tie", [0.002, 0.005, 0.01, 0.02])
@pytest.mark.parametrize("name", ["policy iteration", "value iteration"])
def test_no_bound_is_broken_in_two_hundred_runs(name, tie, k):
    for seed in range(17):
        check_bound(*run(LEARNERS[name], k, tie, 100 + seed))


@on_any_processor
def test_a_tie_of_zero_takes_equal_at_its_word_and_breaks_the_bound():
    """Why the tie is part of what an answer means: the same runs, with a comparator that takes
    "equal" for equal.
    """
    broken = 0
    for seed in range(10):
        try:
            result, loss = run(
                InteractivePolicyIteration, 5, 0.005, seed, PolytopeComparator(5, tie=0.0)
            )
        except ValueError:  # the answers contradict each other
            continue
        broken += loss > result.loss_bound
        if broken:
            break
    assert broken > 0


@pytest.mark.parametrize("name", quick_first(LEARNERS, 3))
def test_a_tutor_who_answers_sharply_is_asked_not_one_question_more(name):
    told = [
        run(LEARNERS[name], 6, 0.0, 7, PolytopeComparator(6, tie=tie))[0]
        for tie in scaled((0.0, 0.3), (0.0, 0.01, 0.3))
    ]
    for result in told[1:]:
        assert result.answers.ids == told[0].answers.ids
        assert (result.answers.d == told[0].answers.d).all()
        assert (result.policy == told[0].policy).all()
        assert result.status is told[0].status


@pytest.mark.parametrize("name", quick_first(LEARNERS, 3))
def test_a_learner_ends_where_all_that_is_left_is_called_equal_and_says_so(name):
    for seed in range(scaled(1, 3)):
        result, _ = run(LEARNERS[name], 8, 0.01, seed, max_queries=500)
        assert result.asked < 250
        assert result.status is Status.CALLED_EQUAL
        assert result.decided["guess"] == 0 or name.startswith("late")
    assert "equal" in str(Status.CALLED_EQUAL.value)


def test_who_never_says_equal_is_asked_to_the_end():
    result, loss = run(InteractivePolicyIteration, 5, 0.0, 1)
    assert result.status is Status.CONVERGED
    assert loss <= result.loss_bound <= 0.001


def test_value_iteration_within_its_tolerance_all_the_same_has_converged():
    result, loss = run(
        InteractiveValueIteration, 5, 0.0005, 0, PolytopeComparator(5, tie=0.0005), tolerance=0.2
    )
    assert (result.answers.y == 0).any()
    assert result.status is Status.CONVERGED
    assert loss <= result.loss_bound <= 0.2


def test_the_polytope_that_allows_for_a_wrong_answer_keeps_its_bound_too():
    check_bound(*run(InteractivePolicyIteration, 5, 0.01, 3, PolytopeComparator(5, wrong=1)))


def test_always_ask_is_the_oracle_and_asks_on():
    mdp, values = random_mdp(20, 3, 4, rng=1)
    learner = InteractiveValueIteration(mdp, AlwaysAsk(4), max_queries=400)
    asked = 0
    while (queries := learner.ask()) and asked < 300:
        learner.tell([TruthfulTutor(values, tie=0.5)(query) for query in queries])
        asked += 1
    assert learner.result().decided["indifferent"] == 0


def test_what_was_called_equal_is_not_asked_again():
    result, _ = run(InteractivePolicyIteration, 8, 0.01, 5)
    rows = {np.abs(d).tobytes() for d in result.answers.d}
    assert len(rows) == len(result.answers)
    assert result.decided[Tier.TUTOR.name.lower()] == result.asked


def test_a_bootstrap_promises_nothing_of_what_is_called_equal():
    def all_equal(query: Query) -> Answer:
        return Answer(query, Verdict.EQUAL)

    mdp, _ = random_mdp(10, 3, 4, seed=0)
    result = drive(
        InteractiveValueIteration(mdp, BradleyTerryComparator(4, region="ensemble")), all_equal
    )
    assert result.status is Status.CALLED_EQUAL
    assert np.isnan(result.confidence)
    sharp = drive(
        InteractiveValueIteration(mdp, BradleyTerryComparator(4, region="ensemble")),
        TruthfulTutor([0, 1, 2, 4]),
    )
    assert sharp.confidence == 0.95


@on_any_processor
def test_the_posterior_keeps_its_promise_to_a_tutor_who_calls_equal_what_lies_within_the_tie():
    broken = 0
    for seed in range(scaled(10, 30)):
        result, loss = run(
            InteractivePolicyIteration, 3, 0.01, seed, PosteriorComparator(3, seed=seed)
        )
        assert result.confidence == 0.95
        broken += loss > result.loss_bound
    assert broken <= scaled(
        1, 4
    )  # of 10 or 30, at 95%; with a width of at most the tie it was a fifth


def test_contradicting_ties_name_the_tie():
    told = Answers([[0.48, -1, 0.52], [0.52, -1, 0.48]], [0, 0])
    with pytest.raises(InconsistentAnswers, match="a wider tie may make room"):
        PolytopeComparator(3).update(told)
    assert len(PolytopeComparator(3, tie=0.02).update(told).answers) == 2
