"""The linear programs of section 3.1: Clarabel's bounds, the readable twin, and what makes a bound
rigorous.
"""

from fractions import Fraction
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import strategies as st

from elicit import Answers, PolytopeComparator
from elicit.lp.analytic_centre import analytic_centre
from elicit.lp.clarabel_programs import Programs, Solved
from elicit.lp.rounding import certified_bound, pull_inside, strictly_inside
from tests.lp_cases import Oracle, exact, exactly, region, shares
from tests.scale_arithmetic import Floats, tail_sums


def truthful(
    k: int, n: int, seed: int = 0, margin: float = 1e-4
) -> tuple[PolytopeComparator, Floats]:
    rng = np.random.default_rng(seed)
    g = 0.9 * rng.dirichlet(np.ones(k - 1)) + 0.1 / (k - 1)
    d = shares(rng, k, n)
    y = np.sign(d @ np.concatenate([[0.0], np.cumsum(g)])).astype(int)
    return PolytopeComparator(k, margin=margin).update(Answers(d, y)), d * y[:, None]


def least_cvxpy(d: Floats, answers: Floats, margin: float) -> float:
    """Section 3.1's program as printed: min d.e subject to K_t, for d (k,) and answered differences
    (n, k).
    """
    k = len(d)
    e = cp.Variable(k)
    constraints = [e[0] == 0, e[k - 1] == 1, cp.diff(e) >= margin]  # K_0
    if len(answers):
        constraints.append(answers @ e >= 0)  # K_t: one inequality an answer
    problem = cp.Problem(cp.Minimize(d @ e), constraints)
    problem.solve(solver=cp.CLARABEL)
    assert problem.status == cp.OPTIMAL
    return float(problem.value)


@pytest.mark.parametrize(("k", "n"), [(2, 0), (3, 2), (5, 10), (10, 50), (10, 0), (20, 100)])
def test_three_statements_of_one_program(k: int, n: int) -> None:
    comparator, cuts = truthful(k, n)
    oracle = Oracle(exactly(comparator.region))
    for d in shares(np.random.default_rng(1), k, 5):
        low, high = (x[0] for x in comparator.bounds(d))
        assert low <= high
        assert least_cvxpy(d, cuts, 1e-4) == pytest.approx(low, abs=1e-7)
        assert -least_cvxpy(-d, cuts, 1e-4) == pytest.approx(high, abs=1e-7)
        assert float(oracle.least(exact(tail_sums(d)))) == pytest.approx(low, abs=1e-7)


finite = st.floats(min_value=-1.0, max_value=1.0)


def test_good_multipliers_give_a_tight_bound() -> None:
    comparator, _ = truthful(8, 40)
    r = comparator.region
    oracle, programs = Oracle(exactly(r)), Programs(r)
    for t in tail_sums(shares(np.random.default_rng(5), 8, 10)):
        found = programs.solve(t)
        assert found is not None
        bound = certified_bound(t, found.y, r)
        assert 0 <= float(oracle.least(exact(t)) - Fraction(bound)) < 1e-9
        assert float(t @ found.g) == pytest.approx(bound, abs=1e-8)
    assert programs.solves == 10


def test_a_bound_that_is_not_tight_is_not_given(monkeypatch: pytest.MonkeyPatch) -> None:
    comparator, _ = truthful(6, 30)
    r = comparator.region
    oracle, inside = Oracle(exactly(r)), analytic_centre(r)
    honest = Programs._vertex

    def loosely(self: Programs, t: Any) -> Solved:
        """Return the right point with multipliers that say little."""
        found = honest(self, t)
        return Solved(found.g, np.zeros_like(found.y))

    monkeypatch.setattr(Programs, "solve", loosely)
    monkeypatch.setattr(Programs, "_vertex", loosely)
    for t in (np.array([-1.0, -0.9, -0.8, -0.7, -0.1]), np.array([1.0, 0.4, 0.8, 0.7, 0.1])):
        low = Programs(r).least(t, inside)
        assert 0 <= float(oracle.least(exact(t)) - Fraction(low)) < 1e-9


@pytest.mark.parametrize("answer", ["none", "nonsense", "infinite"])
def test_a_solver_that_fails_costs_time_only(answer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Programs, t: Any) -> Solved | None:
        p, m = self.region.p, len(self.region.rows)
        if answer == "none":
            return None
        bad = np.nan if answer == "infinite" else 3.7
        return Solved(np.full(p, bad), np.full(m, abs(bad)))

    comparator, _ = truthful(6, 30)
    d = shares(np.random.default_rng(6), 6, 8)
    expected, verdicts = comparator.bounds(d), comparator.compare(d)
    monkeypatch.setattr(Programs, "solve", fail)
    again, _ = truthful(6, 30)
    for got, want in zip(again.bounds(d), expected, strict=True):
        assert got == pytest.approx(want, abs=1e-9)
    assert (again.compare(d) == verdicts).all()


def test_an_objective_can_be_replaced_after_a_failure() -> None:
    """A region so thin that the solver may give up, then another objective."""
    rows = [[1.0, -1.0, 1e-9], [-1.0, 1.0, 1e-9]]
    r = region(rows, margin=1e-3)
    programs = Programs(r)
    oracle = Oracle(exactly(r))
    for t in np.random.default_rng(0).normal(size=(20, 3)):
        assert 0 <= float(oracle.least(exact(t)) - Fraction(programs.least(t, None))) < 1e-9


def test_pulling_a_point_inside_moves_it_little() -> None:
    comparator, _ = truthful(8, 60)
    r = comparator.region
    centre = analytic_centre(r)
    for t in tail_sums(shares(np.random.default_rng(9), 8, 10)):
        found = Programs(r).solve(t)
        assert found is not None
        point = pull_inside(found.g, centre, r)
        assert point is not None
        assert strictly_inside(point, r)
        assert np.abs(point - found.g).max() < 1e-6
    outside = np.full(7, 1 / 7)
    outside[:2] += [5.0, -5.0]
    pulled = pull_inside(outside, centre, r)
    assert pulled is None or strictly_inside(pulled, r)
    assert pull_inside(np.full(7, np.nan), centre, r) is None
