"""Reach of a certificate with a tutor who errs: against simulated answers, and stated in time."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

import elicit
import qlearn
from elicit import Status
from qlearn.certificates.within_reach import (
    ENOUGH_ANSWERS,
    out_of_reach,
    tolerance_within_reach,
)


class Learned:
    """A comparator as far as it is looked at."""

    def __init__(self, precision: float, lapse: float = 0.0, answers: int = 40) -> None:
        self.precision, self.lapse, self.answers = precision, lapse, [None] * answers


def test_the_formula_is_the_halfwidth_that_a_maximum_likelihood_fit_has() -> None:
    """One number e, and n questions whether it exceeds what the answers so far make of it."""
    c, n, truth = 20.0, 400, 0.3
    rng, found = np.random.default_rng(0), []
    for _ in range(400):
        said = rng.random(n) < expit(c * (truth - 0.3))
        share = np.clip(said.mean(), 0.01, 0.99)
        found.append(0.3 + math.log(share / (1 - share)) / c)
    halfwidth = (np.quantile(found, 0.95) - np.quantile(found, 0.05)) / 2
    known: elicit.Comparator = Learned(c)  # type: ignore[assignment]
    assert tolerance_within_reach(known, n) == pytest.approx(halfwidth, rel=0.1)


def test_it_grows_with_errors_and_falls_with_questions() -> None:
    def reach(questions: int, *how: float) -> float:
        return tolerance_within_reach(Learned(*how), questions)  # type: ignore[arg-type]

    assert reach(100, 20.0) == pytest.approx(2 * reach(400, 20.0))
    assert reach(100, 20.0, 0.5) == pytest.approx(2 * reach(100, 20.0))
    assert reach(100, 0.0) == 1.0
    assert math.isnan(tolerance_within_reach(elicit.PolytopeComparator(4), 100))
    assert math.isnan(reach(0, 20.0))


def test_few_answers_say_nothing() -> None:
    hopeless: elicit.Comparator = Learned(1.0, 0.2, ENOUGH_ANSWERS)  # type: ignore[assignment]
    early: elicit.Comparator = Learned(1.0, 0.2, ENOUGH_ANSWERS - 1)  # type: ignore[assignment]
    assert out_of_reach(hopeless, 0.01, 200)
    assert not out_of_reach(early, 0.01, 200)
    assert not out_of_reach(elicit.PolytopeComparator(4), 0.01, 200)


def test_a_hopeless_tutor_is_told_early_and_a_steady_one_never() -> None:
    mdp, values = qlearn.random_mdp(40, 4, 8, seed=5)
    for precision in (2.0, 1e4):
        said: dict[int, str] = {}
        learner = qlearn.InteractivePolicyIteration(
            mdp, elicit.PosteriorComparator(8, particles=300), tolerance=0.01, max_queries=60
        )
        result = qlearn.drive(
            learner,
            elicit.BradleyTerryTutor(values, precision, seed=2),
            progress=lambda result, said=said: said.update({result.asked: result.outlook}),  # type: ignore[misc]
        )
        assert not any(said[asked] for asked in said if asked < ENOUGH_ANSWERS)
        if precision == 2.0:
            first = min(asked for asked in said if said[asked])
            assert first < 45
            assert "1% is out of reach within 60 questions" in said[first]
            assert result.outlook in str(result)
            assert result.loss_bound > 0.02
        else:
            assert not any(said.values())
            assert result.status is Status.CONVERGED


def test_without_a_budget_nothing_is_said() -> None:
    mdp, _ = qlearn.random_mdp(8, 2, 4, seed=1)
    known = elicit.PosteriorComparator(4, particles=200)
    learner = qlearn.InteractivePolicyIteration(mdp, known, tolerance=0.01)
    while len(learner.result().answers) < 32 and (queries := learner.ask()):
        learner.tell([elicit.Answer(query, (-1) ** i) for i, query in enumerate(queries)])
    assert learner.result().outlook == ""


def test_a_tutor_who_tells_nothing_is_not_promised_a_percentage() -> None:
    mdp, _ = qlearn.random_mdp(8, 2, 4, seed=1)
    learner = qlearn.InteractivePolicyIteration(
        mdp, elicit.PosteriorComparator(4, particles=200), tolerance=0.01, max_queries=40
    )
    hopeless = Learned(0.5, 0.2, ENOUGH_ANSWERS)
    result = replace(learner.result(), comparator=hopeless, status=Status.EXHAUSTED)
    assert result.outlook.endswith("within 40 questions: no useful bound can be had.")
