"""Bounds that hold for all differences at once, and draws of plausible scales: against other solvers and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from elicit.comparators.baselines import AlwaysAsk, Dominance
from elicit.comparators.bradley_terry.bootstrap_comparator import BradleyTerryComparator
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.comparators.polytope.relaxed_comparator import RelaxedPolytopeComparator
from elicit.model.comparator import simultaneous_bounds
from elicit.model.query import Answers
from elicit.model.scale import tail_sums


def differences(rng, n, k):
    return rng.dirichlet(np.ones(k), n) - rng.dirichlet(np.ones(k), n)


def truthful(rng, n, k):
    """Answers about random pairs under a random scale."""
    d = differences(rng, n, k)
    values = np.sort(rng.random(k))
    return Answers(d, np.sign(d @ values).astype(int))


def greatest_by_highs(d, answers, margin):
    """max d.e over K_t, in the gaps, by HiGHS."""
    p = answers.k - 1
    cuts = -tail_sums(answers.d) * answers.y[:, None]
    found = linprog(
        -tail_sums(d), cuts, np.zeros(len(cuts)), np.ones((1, p)), [1.0], [(margin, None)] * p, method="highs-ds"
    )
    return -found.fun


@pytest.mark.parametrize("k", [2, 3, 6, 12])
def test_a_polytopes_bounds_are_the_optima_of_highs(k):
    rng = np.random.default_rng(k)
    comparator = PolytopeComparator(k).update(answers := truthful(rng, 3 * k, k))
    d = differences(rng, 25, k)
    high, confidence = comparator.simultaneous_bounds(d)
    assert confidence == 1
    exact = np.array([greatest_by_highs(row, answers, 1e-6) for row in d])
    assert (high >= exact - 1e-9).all()
    # where every scale says "worse" the bound need not be tight; it is no use to a guarantee
    np.testing.assert_allclose(high[exact > 0], exact[exact > 0], atol=1e-8)
    np.testing.assert_allclose(high, comparator.bounds(d)[1], atol=1e-8)


def test_a_polytopes_bounds_hold_where_the_set_is_thin():
    # answers in thousands leave a sliver, where corners are hard to invert: then another solver is asked
    rng = np.random.default_rng(3)
    comparator = PolytopeComparator(8).update(truthful(rng, 1500, 8))
    d = differences(rng, 40, 8)
    high, lower = comparator.simultaneous_bounds(d)[0], comparator.bounds(d)
    assert (high >= lower[1] - 1e-9).all()
    open_ones = lower[1] > 1e-8
    np.testing.assert_allclose(high[open_ones], lower[1][open_ones], atol=1e-7)


@pytest.mark.parametrize("k", [2, 3, 5, 10])
def test_draws_from_a_polytope_satisfy_its_answers_and_spread(k):
    rng = np.random.default_rng(k)
    comparator = PolytopeComparator(k).update(truthful(rng, 2 * k, k))
    gaps, weights, precision = comparator.draws
    np.testing.assert_allclose(gaps.sum(axis=0), 1.0)
    assert weights.sum() == pytest.approx(1.0)
    assert np.isinf(precision).all()
    assert (gaps > 0).all()
    assert (comparator.region.rows @ gaps >= -1e-12).all()
    again = PolytopeComparator(k).update(comparator.answers).draws.gaps
    assert again.tobytes() == gaps.tobytes()  # a function of the answers
    if k > 2:
        d = differences(rng, 10, k)
        low, high = comparator.bounds(d)
        scores = tail_sums(d) @ gaps
        assert ((scores.max(axis=1) - scores.min(axis=1)) > 0.4 * (high - low)).all()


def test_draws_from_an_uncut_simplex_are_uniform():
    gaps = PolytopeComparator(3, margin=0.0).draws.gaps
    # uniform on [0, 1], of which 256 independent draws have a Kolmogorov-Smirnov distance beyond .122 in one of 1,000
    ranks = np.sort(gaps[0])
    assert np.abs(ranks - (np.arange(len(ranks)) + 0.5) / len(ranks)).max() < 0.122


def test_a_posteriors_bounds_hold_jointly_for_its_level():
    rng = np.random.default_rng(0)
    comparator = PosteriorComparator(6, seed=1).update(truthful(rng, 12, 6))
    d = differences(rng, 30, 6)
    high, confidence = comparator.simultaneous_bounds(d)
    gaps, weights, _ = comparator.draws
    holds = (tail_sums(d) @ gaps <= high[:, None] + 1e-12).all(axis=0)
    assert confidence == comparator.level == 0.95
    assert weights @ holds >= 0.95 - 1e-9
    # one by one the quantiles are lower: together they hold less often
    alone = comparator.bounds(d)[1]
    assert weights @ (tail_sums(d) @ gaps <= alone[:, None]).all(axis=0) < 0.95
    assert (high >= alone - 1e-12).mean() > 0.8
    # for one difference the two are the same quantile
    np.testing.assert_allclose([comparator.simultaneous_bounds(row[None])[0][0] for row in d], alone, atol=1e-12)


def test_an_ensemble_leaves_out_whole_fits_and_says_nothing_before_it_can():
    rng = np.random.default_rng(1)
    fresh = BradleyTerryComparator(4)
    d = differences(rng, 9, 4)
    np.testing.assert_allclose(fresh.simultaneous_bounds(d)[0], Dominance(4).bounds(d)[1])
    assert fresh.simultaneous_bounds(d)[1] == 1.0
    assert fresh.draws is None
    comparator = fresh.update(truthful(rng, 40, 4))
    high, confidence = comparator.simultaneous_bounds(d)
    at = tail_sums(d) @ comparator.draws.gaps
    kept = (at <= high[:, None] + 1e-12).all(axis=0)
    assert confidence == 0.95
    assert kept.sum() == 101 - 5  # m fits and the point estimate, less a twentieth
    box = BradleyTerryComparator(4, region="box").update(comparator.answers)
    np.testing.assert_allclose(box.simultaneous_bounds(d)[0], Dominance(4).bounds(d)[1])


def test_a_relaxed_polytope_states_a_confidence_only_while_its_answers_agree():
    rng = np.random.default_rng(2)
    answers = truthful(rng, 10, 5)
    d = differences(rng, 20, 5)
    relaxed = RelaxedPolytopeComparator(5, slack=0.01).update(answers)
    high, confidence = relaxed.simultaneous_bounds(d)
    assert confidence == 1
    assert (high >= PolytopeComparator(5).update(answers).bounds(d)[1] - 1e-9).all()
    assert (high >= relaxed.bounds(d)[1] - 1e-8).all()
    assert high.max() == pytest.approx(relaxed.bounds(d)[1].max(), abs=1e-7)
    torn = relaxed.update(Answers(answers.d[:3], -answers.y[:3]))
    high, confidence = torn.simultaneous_bounds(d)
    assert np.isnan(confidence) == (torn.violation > 0)
    assert (high >= torn.bounds(d)[1] - 1e-8).all()
    scores = tail_sums(d) @ torn.draws.gaps
    assert (scores <= high[:, None] + 1e-7).all()


def test_comparators_that_learn_nothing_bound_by_the_order_alone():
    d = differences(np.random.default_rng(4), 8, 5)

    class Silent:
        k = 5

    for comparator in (Dominance(5), AlwaysAsk(5), Silent()):
        high, confidence = simultaneous_bounds(comparator, d)
        np.testing.assert_allclose(high, tail_sums(d).max(axis=1))
        assert confidence == 1
