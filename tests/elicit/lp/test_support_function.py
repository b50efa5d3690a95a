"""Bounds that hold for all differences at once, and draws of plausible scales: against other
solvers and by hand.
"""

import numpy as np
import pytest
from scipy.optimize import linprog

from elicit import (
    AlwaysAsk,
    Answers,
    Dominance,
    InconsistentAnswers,
    PolytopeComparator,
    simultaneous_bounds,
)
from elicit.comparators.polytope import plausible_set
from elicit.lp.support_function import greatest
from elicit.model.comparator_parts import bounds_after, bounds_on_trial
from tests.scale_arithmetic import tail_sums


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
        -tail_sums(d),
        cuts,
        np.zeros(len(cuts)),
        np.ones((1, p)),
        [1.0],
        [(margin, None)] * p,
        method="highs-ds",
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


def test_bounds_on_more_rows_than_vertices_are_kept_need_no_other_solver():
    # a row's vertex may have made room for another's before anybody looks: that alone must not send
    # it to Clarabel
    rng = np.random.default_rng(5)
    comparator = PolytopeComparator(10).update(truthful(rng, 20, 10))
    d = differences(rng, 3000, 10)
    high = comparator.simultaneous_bounds(d)[0]
    assert (high > 0).sum() > 1000  # many times as many as vertices
    assert comparator.solves <= 10  # not hundreds
    np.testing.assert_allclose(high[:200], comparator.bounds(d[:200])[1], atol=1e-8)


def test_a_polytopes_bounds_hold_where_the_set_is_thin():
    # answers in thousands leave a sliver, where vertices are hard to invert: then another solver is
    # asked
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


@pytest.mark.parametrize(("k", "tie"), [(2, 0.0), (4, 0.02), (9, 0.0), (14, 0.0)])
def test_bounds_above_a_limit_are_those_of_a_set_without_memory(k, tie, monkeypatch):
    rng, walked = np.random.default_rng(k), []
    monkeypatch.setattr(
        plausible_set, "greatest", lambda d, known: walked.append(len(d)) or greatest(d, known)
    )
    known, answers = PolytopeComparator(k, tie=tie), truthful(rng, 2 * k, k)
    d = differences(rng, 80, k)
    for i in range(len(answers)):
        before, known = known, known.update(Answers(answers.d[i : i + 1], answers.y[i : i + 1]))
        d = 0.999 * d + 0.001 * differences(
            rng, len(d), k
        )  # as one policy's differ from the last's
        d[rng.integers(len(d), size=3)] = differences(rng, 3, k)
        enough = 0.01 if i % 2 else rng.uniform(0.005, 0.02, len(d))
        found, confidence = known.bounds_above(d, enough)
        fresh = PolytopeComparator(k, tie=tie).update(known.answers)
        tight, room = fresh.simultaneous_bounds(d)[0], 1e-9
        assert confidence == 1
        assert (found >= np.where(tight > 0, tight, -np.inf) - room).all()
        if i % 8 == 0:  # below 0 the others need not be tight either
            assert (found >= fresh.bounds(d)[1] - room).all()
        assert (found <= np.maximum(tight, enough) + room).all()
        np.testing.assert_array_equal(known.bounds_above(d, enough)[0], found)  # now from memory
        if i % 3 == 0:  # nor does memory make what must be tight loose, here or in an older set
            both = np.maximum(known.simultaneous_bounds(d)[0], 0), np.maximum(tight, 0)
            np.testing.assert_allclose(*both, atol=room)
            old = PolytopeComparator(k, tie=tie).update(before.answers)
            both = (x.simultaneous_bounds(d)[0].clip(0) for x in (before, old))
            np.testing.assert_allclose(*both, atol=room)
    walked.clear()
    known.bounds_above(d + 1e-6 * differences(rng, len(d), k), 0.01)
    closed = int((tight <= 0.009).sum())
    assert sum(walked) <= len(d) - closed  # nothing that was clearly closed is looked at again


def after(known, asked, verdict, d):
    """The greatest d.e (n,) that an answer leaves, by HiGHS; -inf if it contradicts the others."""
    told = known.answers + Answers(asked[None], [verdict])
    try:
        known.update(Answers(asked[None], [verdict]))
    except InconsistentAnswers:
        return np.full(len(d), -np.inf)
    return np.array([greatest_by_highs(row, told, known.margin) for row in d])


@pytest.mark.parametrize(("k", "n"), [(3, 0), (3, 2), (6, 12), (12, 20), (30, 40)])
def test_bounds_foreseen_after_an_answer_are_the_optima_of_highs(k, n):
    rng = np.random.default_rng(k)
    known = PolytopeComparator(k).update(truthful(rng, n, k)) if n else PolytopeComparator(k)
    before = known.simultaneous_bounds(d := differences(rng, 12, k))[0]
    gaps = known.draws.gaps
    open_ones = differences(rng, 400, k)
    open_ones = open_ones[(np.sign(tail_sums(open_ones) @ gaps).min(axis=1) < 0)][:3]
    contradicted = np.eye(k)[-1:] - np.eye(k)[:1]  # nobody prefers the worst level
    asked = np.concatenate([open_ones, contradicted])
    found = known.bounds_after(asked, d, 0.0)
    assert found.shape == (len(asked), 2, len(d))
    for i, row in enumerate(asked):
        for part, verdict in enumerate((-1, 1)):
            exact = after(known, row, verdict, d)
            matters = exact > 1e-9
            np.testing.assert_allclose(found[i, part, matters], exact[matters], atol=1e-7)
            assert (found[i, part, ~matters] <= 1e-7).all()
    again = known.bounds_after(asked, d, enough := 0.5 * np.maximum(before, 0.0))
    np.testing.assert_allclose(np.maximum(again, enough), np.maximum(found, enough), atol=1e-9)
    np.testing.assert_array_equal(known.simultaneous_bounds(d)[0], before)


def test_bounds_foreseen_by_trial_are_the_same():
    rng = np.random.default_rng(1)
    known = PolytopeComparator(6).update(truthful(rng, 8, 6))
    asked, d = differences(rng, 5, 6), differences(rng, 20, 6)
    tried, found = bounds_on_trial(known, asked, d), bounds_after(known, asked, d, 0.0)
    np.testing.assert_allclose(np.maximum(found, 0), np.maximum(tried, 0), atol=1e-9)
    one_wrong = PolytopeComparator(6, wrong=1).update(known.answers)
    by_cells = bounds_after(one_wrong, asked, d, 0.0)
    assert (by_cells >= tried - 1e-9).all()
    assert (by_cells <= one_wrong.simultaneous_bounds(d)[0] + 1e-9).all()


def test_draws_from_an_uncut_simplex_are_uniform():
    gaps = PolytopeComparator(3, margin=0.0).draws.gaps
    # uniform on [0, 1], of which 256 independent draws have a Kolmogorov-Smirnov distance beyond
    # .122 in one of 1,000
    ranks = np.sort(gaps[0])
    assert np.abs(ranks - (np.arange(len(ranks)) + 0.5) / len(ranks)).max() < 0.122


def test_comparators_that_learn_nothing_bound_by_the_order_alone():
    d = differences(np.random.default_rng(4), 8, 5)

    class Plain:
        k = 5

        def bounds(self, d):
            return np.full(len(d), -np.inf), np.append(np.full(len(d) - 1, np.inf), -0.25)

    for comparator in (Dominance(5), AlwaysAsk(5)):
        high, confidence = simultaneous_bounds(comparator, d)
        np.testing.assert_allclose(high, tail_sums(d).max(axis=1))
        assert confidence == 1
    high, confidence = simultaneous_bounds(
        Plain(), d
    )  # what it says row by row, where the order says no more
    np.testing.assert_allclose(high[:-1], tail_sums(d[:-1]).max(axis=1))
    assert high[-1] == -0.25
    assert np.isnan(confidence)
