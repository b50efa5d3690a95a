"""Forecasts of what a budget of questions will prove, against sessions that are run by hand."""

from __future__ import annotations

import numpy as np
import pytest

import elicit
import qlearn
from tests.thoroughness import on_any_processor


@pytest.fixture(scope="module")
def mdp() -> qlearn.OrdinalMDP:
    return qlearn.problems.FAMILIES["surgery"](seed=0)


def ended(mdp: qlearn.OrdinalMDP, values: np.ndarray, questions: int) -> float:
    """The loss bound after so many questions to a truthful tutor of these values."""
    learner = qlearn.InteractivePolicyIteration(mdp, elicit.PolytopeComparator(mdp.k), seed=5)
    tutor = elicit.TruthfulTutor(values)
    for _ in range(questions):
        learner.tell([tutor(query) for query in learner.ask()])
    return learner.result().loss_bound


@on_any_processor
def test_more_questions_prove_more_and_no_session_is_worse_than_none(
    mdp: qlearn.OrdinalMDP,
) -> None:
    known = elicit.PolytopeComparator(mdp.k)
    few, many = (qlearn.expected_bounds(mdp, known, n, runs=6, seed=1) for n in (1, 6))
    for plan, most in ((few, 1), (many, 6)):
        assert (np.diff(plan.bounds) >= 0).all()
        assert plan.most <= plan.before + 1e-9
        assert (plan.asked <= most).all()
        assert len(plan.bounds) == 6
    assert many.median < few.median
    assert known.answers.d.shape == (0, mdp.k)


@pytest.mark.slow
def test_the_range_holds_for_scales_as_drawn(mdp: qlearn.OrdinalMDP) -> None:
    plan = qlearn.expected_bounds(mdp, elicit.PolytopeComparator(mdp.k), 3, runs=12, seed=2)
    found = [ended(mdp, qlearn.hidden_scales("even", mdp.k, seed), 3) for seed in range(12)]
    inside = [plan.least - 1e-9 <= bound <= plan.most + 1e-9 for bound in found]
    assert plan.coverage == pytest.approx(11 / 13)
    assert sum(inside) >= 7  # 85% are expected; fewer than 7 of 12 has a chance of a thousandth


def test_a_seed_gives_the_same_sessions_and_an_answer_changes_them(
    mdp: qlearn.OrdinalMDP,
) -> None:
    known = elicit.PolytopeComparator(mdp.k)
    one, same = (qlearn.expected_bounds(mdp, known, 2, runs=4, seed=3) for _ in range(2))
    assert one.bounds.tolist() == same.bounds.tolist()
    learner = qlearn.InteractivePolicyIteration(mdp, known)
    (query,) = learner.ask()
    told = known.update(elicit.Answers.of([elicit.Answer(query, elicit.Verdict.BETTER)], mdp.k))
    later = qlearn.expected_bounds(mdp, told, 2, runs=4, seed=3)
    assert later.before < one.before


def test_it_says_what_it_found(mdp: qlearn.OrdinalMDP) -> None:
    bounds, asked = np.array([0.002, 0.031, 0.2]), np.array([4, 10, 10])
    plan = qlearn.ExpectedBounds(10, 1.0, bounds, asked)
    assert str(plan) == (
        "10 questions bounded the loss by 3.1% of the value range in half of 3 simulated "
        "sessions, and by 0.2% to 20% in all of them. Without any question the bound is 100%. "
        "Yours ends in this range with a chance of about 50%, if your scale is like those that "
        "were drawn. 1 of the sessions needed fewer questions."
    )


@on_any_processor
def test_a_tutor_who_may_err_is_simulated_so(mdp: qlearn.OrdinalMDP) -> None:
    known = elicit.PosteriorComparator(mdp.k, seed=0)
    plan = qlearn.expected_bounds(mdp, known, 2, runs=3, seed=0)
    assert 0 < plan.most <= 1


@pytest.mark.parametrize(("name", "value"), [("questions", 0), ("runs", 2), ("questions", 1.5)])
def test_what_cannot_be_planned_is_refused(mdp: qlearn.OrdinalMDP, name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        qlearn.expected_bounds(mdp, elicit.PolytopeComparator(mdp.k), **{name: value})  # type: ignore[arg-type]


def test_the_simulated_tutor_errs_as_often_as_the_comparator_assumes(
    mdp: qlearn.OrdinalMDP, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of the answers given at random are right."""
    rates = []

    def made(values: np.ndarray, rate: float, seed: int) -> elicit.FlippingTutor:
        rates.append(rate)
        return elicit.FlippingTutor(values, rate, seed)

    monkeypatch.setattr("qlearn.learners.expected_bounds.FlippingTutor", made)
    known = elicit.PosteriorComparator(mdp.k, lapse=0.2, particles=100)
    qlearn.expected_bounds(mdp, known, 1, runs=3, seed=1)
    assert rates == [0.1] * 3
