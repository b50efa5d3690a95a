"""The programs over K_t as cvxpy problems: their optima are the comparator's bounds, their labels
say what is what.
"""

from __future__ import annotations

import re

import cvxpy as cp
import numpy as np
import pytest

import elicit
from elicit import Answers, PolytopeComparator
from tests.lp_cases import shares
from tests.thoroughness import quick_first

SOLVERS = [
    solver for solver in (cp.CLARABEL, cp.SCIPY, cp.HIGHS) if solver in cp.installed_solvers()
]
assert len(SOLVERS) >= 2
NEAR = 2e-6  # what the solvers' own tolerances leave


def drawn(seed):
    """Levels, a margin, prior texts and answers, of which some are ties."""
    rng = np.random.default_rng(seed)
    k = int(rng.integers(2, 9))
    truth = np.concatenate([[0.0], np.cumsum(rng.dirichlet(np.full(k - 1, 0.7)))])
    truth[-1] = 1.0
    d = shares(rng, k, max(0, int(rng.integers(-3, 14))))
    if k > 2 and len(d) > 2:  # one that is a tie, by the truth
        d[0, 1:] = np.append(np.zeros(k - 3), [1.0, -truth[-2]])
        d[0, 0] = -d[0].sum()
    if len(d) > 3:
        d[1] *= 1e-7  # and one whose vectors are close
    value = d @ truth
    y = np.where(np.abs(value) < 1e-12, 0, np.sign(value)).astype(int)
    rng.random(len(y))  # keeps the draws that follow
    prior = (
        [f"e{k} - e{k - 1} >= {0.9 * (1 - truth[-2]):.6f}"]
        if k > 2 and rng.random() < 0.5
        else None
    )
    margin = float(min(np.diff(truth).min() / 2, 1e-3)) if rng.random() < 0.5 else 0.0
    return k, margin, prior, Answers(d, y), shares(rng, k, 3)


def ends(comparator, d, solver):
    return [float(problem.solve(solver=solver)) for problem in comparator.problems(d)]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("seed", quick_first(range(25), 5, older=1))
def test_the_optima_are_the_bounds(seed, solver):
    k, margin, prior, answers, ask = drawn(seed)
    comparator = PolytopeComparator(k, margin, prior).update(answers)
    for d in ask:
        low, high = comparator.bounds(d)
        assert ends(comparator, d, solver) == pytest.approx([low[0], high[0]], abs=NEAR)


def test_cases_cover_priors_ties_and_no_answers():
    seen = [drawn(seed) for seed in range(25)]
    assert any(prior for _, _, prior, _, _ in seen)
    assert any((answers.y == 0).any() for *_, answers, _ in seen)
    assert any(len(answers) == 0 for *_, answers, _ in seen)


D = [[-0.5, 0.9, -0.6, 0.2], [0.0, 0.0, 0.0, 0.0], [0.3, -0.7, 0.5, -0.1], [-0.4, 0.5, 0.0, -0.1]]


def test_every_constraint_is_labelled_by_where_it_comes_from():
    e = elicit.scale_variable(4)
    prior = [(e[3] >= 2 * e[1]).set_label("well is twice poor"), "e3 >= e2 + 0.05"]
    comparator = PolytopeComparator(4, 1e-3, prior).update(Answers(D, [-1, 0, 1, 0]))
    least, greatest = comparator.problems([0.1, 0.2, -0.7, 0.4])
    # the second answer's vectors are the same: it says nothing
    labels = [
        "worst level",
        "best level",
        "order",
        *comparator.prior.names,
        "answer 1",
        "answer 3",
        "answer 4",
    ]
    assert labels[3:5] == ["well is twice poor", "e3 >= e2 + 0.05"]
    for problem, goal in ((least, "minimize"), (greatest, "maximize")):
        assert [constraint.label for constraint in problem.constraints] == labels
        lines = [line.strip() for line in str(problem).splitlines()]
        assert lines[0] == f"{goal} [0.1, 0.2, -0.7, 0.4] @ e"
        assert "order: 0.001 <= e[1:4] + -(e[0:3])" in lines
        assert "well is twice poor: 0.0 <= [0, -2, 0, 1] @ e" in lines
        assert "answer 1: 0.0 <= [0.5, -0.9, 0.6, -0.2] @ e" in lines  # "worse", so turned round
        assert (
            "answer 3: 0.0 <= [0.6, -1.4, 1, -0.2] @ e" in lines
        )  # in its own unit, a power of two
        assert lines[-1].startswith("answer 4: norm1([-0.8, 1, 0, -0.2] @ e) <= ")
        assert len(lines) == 1 + len(labels)  # however many levels, one line each


def test_many_levels_are_still_one_line_a_constraint():
    rng = np.random.default_rng(0)
    comparator = PolytopeComparator(25).update(Answers(shares(rng, 25, 1), [1]))
    assert len(str(comparator.problems(shares(rng, 25, 1)[0])[0]).splitlines()) == 1 + 3 + 1


def test_of_a_tie_both_sides_are_kept():
    comparator = PolytopeComparator(4).update(Answers(D[3:], [0]))
    found = ends(comparator, D[3], cp.CLARABEL)
    low, high = comparator.bounds(D[3])
    assert found == pytest.approx([low[0], high[0]], abs=NEAR)
    assert ends(PolytopeComparator(4), D[3], cp.CLARABEL) == pytest.approx([-0.1, 0.4], abs=1e-4)


def test_the_problems_share_the_variable_and_nothing_else():
    comparator = PolytopeComparator(4).update(Answers(D[:1], [1]))
    least, greatest = comparator.problems([0.1, 0.2, -0.7, 0.4])
    (e,), (other,) = least.variables(), greatest.variables()
    assert e is other
    assert (e.name(), e.shape) == ("e", (4,))
    assert not {constraint.id for constraint in least.constraints} & {
        c.id for c in greatest.constraints
    }
    least.solve(solver=cp.CLARABEL)
    held = [np.copy(constraint.dual_value) for constraint in least.constraints]
    greatest.solve(solver=cp.CLARABEL)
    for constraint, dual in zip(least.constraints, held, strict=True):
        assert np.array_equal(constraint.dual_value, dual)


def test_a_cone_and_a_penalty_extend_them():
    comparator = PolytopeComparator(4).update(Answers(D[:1], [-1]))
    d, guess = np.array([0.1, 0.2, -0.7, 0.4]), np.array([0, 0.2, 0.7, 1])
    least, greatest = comparator.problems(d)
    e = least.variables()[0]
    inner = [
        cp.Problem(problem.objective, [*problem.constraints, cp.norm(e - guess) <= 0.1]).solve(
            solver=cp.CLARABEL
        )
        for problem in (least, greatest)
    ]
    low, high = comparator.bounds(d)
    assert low[0] + 0.01 < inner[0] < inner[1] < high[0] - 0.01
    cp.Problem(cp.Minimize(cp.sum_squares(e - guess)), least.constraints).solve(solver=cp.CLARABEL)
    assert e.value == pytest.approx(guess, abs=1e-4)  # which fits
    assert PolytopeComparator(4, prior=least.constraints).bounds(d)[0] == pytest.approx(
        low, abs=1e-9
    )


def test_only_one_difference_at_a_time():
    comparator = PolytopeComparator(4)
    with pytest.raises(ValueError, match=re.escape("d must have shape (n, 4)")):
        comparator.problems([0.5, -0.5])
    with pytest.raises(
        ValueError, match=re.escape("problems takes one difference of shape (4,), not 2 of them")
    ):
        comparator.problems(D[:2])
