"""A scale of which one step of the order is open, held to linear programs over each order."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

import elicit
import qlearn
from elicit import Answer, Answers, InconsistentAnswers, OpenOrderComparator, Verdict
from elicit.person.findings import scale_rows
from elicit.testing import check_comparator
from qlearn.mdp.planning import optimal_policy
from tests.thoroughness import covering, examples, scaled

MARGIN = 1e-6


def shares(rng: np.random.Generator, k: int) -> Any:
    """A whole-number bag of 20 as shares."""
    return rng.multinomial(20, rng.dirichlet(np.ones(k))) / 20


def extremes(d: Any, known: Answers, order: tuple[int, ...]) -> tuple[float, float] | None:
    """Return the least and the greatest d.e over the scales of one order, by HiGHS; None if there
    are none.
    """
    k = len(order)
    rows, limits = [], []
    for worse, better in pairwise(order):
        row = np.zeros(k)
        row[worse], row[better] = 1.0, -1.0
        rows.append(row)
        limits.append(-MARGIN)
    for row, y in zip(known.d, known.y.tolist(), strict=True):
        rows.append(-y * row)
        limits.append(0.0)
    ends = np.zeros((2, k))
    ends[0, order[0]] = ends[1, order[-1]] = 1.0
    found = [
        linprog(sign * d, np.array(rows), limits, ends, [0.0, 1.0], (0.0, 1.0))
        for sign in (1.0, -1.0)
    ]
    if any(one.status for one in found):  # HiGHS may say so of one only, where there is no room
        return None
    return found[0].fun, -found[1].fun


def scale(rng: np.random.Generator, k: int, unordered: tuple[int, int], swap: bool) -> Any:
    """A hidden scale of either order, from 0 to 1."""
    values = np.concatenate([[0.0], np.cumsum(rng.dirichlet(np.ones(k - 1)))])
    if swap:
        values[list(unordered)] = values[list(unordered)[::-1]]
    return values


def says(values: Any, d: Any) -> int:
    """Return the answer of a tutor of these values to a difference."""
    return int(np.sign(np.round(d @ values, 12)))


@pytest.mark.parametrize("unordered", [(0, 1), (2, 3)])
def test_it_conforms(unordered: tuple[int, int]) -> None:
    check_comparator(OpenOrderComparator(4, unordered))


@examples(80)
@given(st.integers(0, 10**6), st.integers(3, 5), st.booleans())
def test_bounds_and_verdicts_are_those_of_both_orders_together(
    seed: int, k: int, swap: bool
) -> None:
    rng = np.random.default_rng(seed)
    low = int(rng.integers(k - 1))
    comparator: OpenOrderComparator = OpenOrderComparator(k, (low, low + 1), MARGIN)
    truth = scale(rng, k, comparator.unordered, swap)
    for i in range(4):
        d = shares(rng, k) - shares(rng, k)
        if says(truth, d):
            comparator = comparator.update(Answers([d], [says(truth, d)], [f"q{i}"]))
    rows = np.array([shares(rng, k) - shares(rng, k) for _ in range(5)])
    low_bounds, high_bounds = comparator.bounds(rows)
    most, confidence = comparator.simultaneous_bounds(rows)
    verdicts = comparator.compare(rows)
    assert confidence == 1.0
    every = OpenOrderComparator(k, comparator.unordered, MARGIN).orders
    for row, least, greatest, upper, verdict in zip(
        rows, low_bounds, high_bounds, most, verdicts, strict=True
    ):
        found = [
            one for order in every if (one := extremes(row, comparator.answers, order)) is not None
        ]
        assert len(found) >= len(comparator.orders)  # HiGHS allows for a little more
        assert least == pytest.approx(min(one[0] for one in found), abs=1e-6)
        assert greatest == pytest.approx(max(one[1] for one in found), abs=1e-6)
        assert upper >= greatest - 1e-9
        if verdict != Verdict.UNKNOWN:
            assert verdict * says(truth, row) >= 0
        elif greatest - least > 1e-6:
            assert least < 1e-9
            assert greatest > -1e-9


def test_dominance_counts_only_where_both_orders_agree() -> None:
    known = OpenOrderComparator(4, (0, 1))
    up, swapped = np.array([[0, -1, 1, 0], [-1, 1, 0, 0]]) / 2
    assert known.compare([up, swapped]).tolist() == [Verdict.BETTER, Verdict.UNKNOWN]
    assert elicit.PolytopeComparator(4).compare(swapped)[0] == Verdict.BETTER
    assert known.bounds(swapped)[0][0] == pytest.approx(-0.5, abs=1e-5)


def test_an_order_that_an_answer_rules_out_goes() -> None:
    known = OpenOrderComparator(3)
    worse = known.update(Answers([[1, -1, 0]], [1], ["dead is better"]))
    assert worse.orders == ((1, 0, 2),)
    assert worse.values[1] == 0.0 < worse.values[0]
    assert "1 of 2 orders left" in repr(worse)
    assert known.orders == ((0, 1, 2), (1, 0, 2))
    assert worse.retract("dead is better").orders == known.orders
    with pytest.raises(InconsistentAnswers, match="in either order") as found:
        worse.update(Answers([[0, 1, -1], [1, -1, 0]], [1, 1], ["nonsense", "again"]))
    assert found.value.answers == ((1, "nonsense"),)
    assert found.value.margin  # the two levels could be equal but for the margin
    gamble = np.array([0.5, -1, 0.5])
    with pytest.raises(InconsistentAnswers) as found:
        known.update(Answers([gamble, gamble], [1, -1], ["yes", "no"]))
    assert found.value.answers == ((0, "yes"), (1, "no"))


@pytest.mark.parametrize("unordered", [(0, 2), (3, 4), (-1, 0), (0,), "01"])
def test_what_are_no_two_neighbours_is_refused(unordered: Any) -> None:
    with pytest.raises(ValueError, match="two neighbouring levels"):
        OpenOrderComparator(4, unordered)


@pytest.mark.parametrize("swap", [False, True])
def test_a_choice_finds_the_best_for_a_tutor_of_either_order(swap: bool) -> None:
    rng = np.random.default_rng(3)
    for _ in range(scaled(4, 8)):
        truth = scale(rng, 5, (0, 1), swap)
        vectors = np.array([shares(rng, 5) for _ in range(6)])
        choosing = elicit.choose(vectors, OpenOrderComparator(5, margin=0.0, tie=0.0), order=True)
        while queries := choosing.ask():
            choosing.tell([Answer(q, Verdict(says(truth, q.d))) for q in queries])
        choice = choosing.result()
        worth = np.round(vectors @ truth, 12)
        assert worth[choice.best] == worth.max()
        assert (np.diff(worth[list(choice.order or ())]) <= 0).all()
        assert choice.loss_bound <= 1e-9


def test_a_report_says_what_each_level_may_be_worth() -> None:
    labels = ["died", "bedridden", "disabled", "well"]
    rows = scale_rows(OpenOrderComparator(4, (0, 1)), labels)
    assert [(row.low, row.high) for row in rows[::3]] == [(100.0, 100.0), (0.0, 100.0)]
    worse = OpenOrderComparator(4, (0, 1)).update(Answers([[1, -1, 0, 0]], [1], ["a"]))
    died, bedridden = scale_rows(worse, labels)[:1:-1]
    assert (bedridden.low, bedridden.high, bedridden.value) == (0.0, 0.0, 0.0)
    assert died.low == 0.0 < died.value < died.high == 100.0
    rows = scale_rows(OpenOrderComparator(4, (2, 3)), labels)
    assert rows[0].low < 100.0
    assert rows[-1].high == 0.0


def test_other_learners_refuse_it_and_say_why() -> None:
    mdp, _ = qlearn.random_mdp(n_states=5, n_actions=2, n_levels=3, seed=1)
    for learner in (qlearn.InteractiveQLearning, qlearn.InteractiveValueIteration):
        with pytest.raises(ValueError, match="order of levels 1 and 2 open, and this learner"):
            learner(mdp, OpenOrderComparator(3))
    with pytest.raises(ValueError, match="exact must be None or True with OpenOrderComparator"):
        qlearn.InteractivePolicyIteration(mdp, OpenOrderComparator(3), exact=False)


def lost(mdp: qlearn.OrdinalMDP, policy: Any, values: Any) -> float:
    """Return the loss of a policy at the worst state, by values that need not rise."""
    start = np.argmax(mdp.admissible, axis=1)
    best = optimal_policy(mdp, values, start)
    gap = qlearn.evaluate_policy(mdp, best) - qlearn.evaluate_policy(mdp, policy)
    return float((gap @ values).max())


@pytest.mark.parametrize(
    ("unordered", "swap"), covering([(0, 1), (1, 2), (3, 4)], [True, False], together=1)
)
def test_policy_iteration_proves_a_policy_for_a_tutor_of_either_order(
    unordered: tuple[int, int], swap: bool
) -> None:
    for seed in range(scaled(1, 2)):
        mdp, _ = qlearn.random_mdp(10, 3, 5, discount=0.9, seed=seed)
        truth = scale(np.random.default_rng(seed), 5, unordered, swap)
        known = OpenOrderComparator(5, unordered)
        learner = qlearn.InteractivePolicyIteration(mdp, known, tolerance=0.01)
        bounds = []
        while queries := learner.ask():
            bounds.append(learner.result())
            learner.tell([Answer(q, Verdict(says(truth, q.d))) for q in queries])
        result = learner.result()
        assert result.status is elicit.Status.CONVERGED
        assert result.confidence == 1.0
        for one in (*bounds, result):
            assert lost(mdp, one.policy, truth) <= one.loss_bound + 1e-9
        assert result.loss_bound <= 0.01


def test_draws_are_scales_of_either_order_that_agree_with_the_answers() -> None:
    asked = np.array([[0.5, -1.0, 0.5, 0.0], [0.0, 0.5, -1.0, 0.5]])
    known = OpenOrderComparator(4).update(Answers(asked, [1, -1], ["a", "b"]))
    values = np.vstack([np.zeros(known.draws.gaps.shape[1]), np.cumsum(known.draws.gaps, axis=0)])
    said = asked @ values
    assert (said[0] >= -1e-9).all()
    assert (said[1] <= 1e-9).all()
    assert 0.05 < known.draws.weights[values[1] < values[0]].sum() < 0.95
    np.testing.assert_allclose(np.ptp(values, axis=0), 1.0)


def test_a_plan_can_be_made_while_the_order_is_open() -> None:
    mdp, _ = qlearn.random_mdp(n_states=8, n_actions=2, n_levels=4, seed=1)
    plan = qlearn.expected_bounds(mdp, OpenOrderComparator(4), 3, runs=3, seed=1, tolerance=0.01)
    assert plan.least <= plan.median <= plan.most <= plan.before


def test_two_levels_of_unknown_order_have_the_scale_of_the_given_order():
    known = elicit.OpenOrderComparator(2)
    np.testing.assert_array_equal(known.values, [0, 1])
    np.testing.assert_allclose(known.bounds([[-1, 1]]), [[-1], [1]])
    other = known.update(elicit.Answers([[-1.0, 1.0]], [-1]))
    np.testing.assert_array_equal(other.values, [1, 0])
