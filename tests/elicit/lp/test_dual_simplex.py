"""The dual simplex: floats propose, integers decide. Held to an independent exact method and to its
own proofs.
"""

import time
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from elicit.lp.dual_simplex import End, Vertex, minimise, minimise_exactly
from elicit.lp.region import Region
from tests.lp_cases import cases, dot, exact, exactly, is_empty, least_from_scratch, region
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import on_any_processor, quick_first


def check_optimal(t: Any, r: Region, found: Vertex) -> None:
    """Feasible, and the multipliers prove that nothing is lower (weak duality), all in
    rationals.
    """
    assert found.end is End.OPTIMAL
    t, g, y = exact(t), list(found.g), list(found.y)
    assert exactly(r).contains(g)
    assert found.value == dot(t, g)
    assert min(y, default=Fraction(0)) >= 0
    columns = [exact(column) for column in r.rows.T]
    rest = [a - dot(y, column) for a, column in zip(t, columns, strict=True)]
    margin = r.exact_margin
    bound = margin * sum(rest) + (1 - r.p * margin) * min(rest)
    assert bound + dot(y, exact(r.rhs)) == found.value


@pytest.mark.parametrize("seed", quick_first(range(6), 2))
def test_the_exact_optimum_is_proven_and_agrees_with_another_method(seed: int) -> None:
    for case in cases([11, seed], 28, asks=1, most_levels=12, most_answers=60):
        r = case.known().region
        for t in tail_sums(case.ask):
            found = minimise_exactly(t, r)
            check_optimal(t, r, found)
            assert found.value == least_from_scratch(exact(t), exactly(r))


def test_floats_are_nearly_right_on_ordinary_regions() -> None:
    rng = np.random.default_rng(3)
    for p, n in [(1, 0), (4, 10), (9, 100), (24, 300)]:
        g = rng.dirichlet(np.ones(p))
        rows = tail_sums(rng.normal(size=(n, p + 1)))
        r = region(rows * np.sign(rows @ g)[:, None], margin=g.min() / 2)
        for t in rng.normal(size=(20, p)):
            found, right = minimise(t, r), minimise_exactly(t, r)
            assert found.end is End.OPTIMAL
            assert found.value == pytest.approx(float(right.value), abs=1e-10)
            assert len(found.basis) == p - 1


def test_no_rows() -> None:
    t = np.array([0.25, -1.0, 0.5])
    found = minimise_exactly(t, region(np.empty((0, 3)), margin=0.125))
    assert found.value == Fraction(0.125) * Fraction(-0.25) + Fraction(5, 8) * -1
    assert list(found.g) == [Fraction(1, 8), Fraction(3, 4), Fraction(1, 8)]
    assert minimise_exactly(
        np.array([-0.5]), region(np.empty((0, 1)), margin=0.5)
    ).value == Fraction(-1, 2)


def test_a_margin_of_one_over_p_is_the_point_of_equal_gaps() -> None:
    for p in range(1, 50):  # 1/p is rounded up for some p, down for others
        r = region(np.empty((0, p)), margin=1.0 / p)
        assert r.exact_margin == Fraction(1, p)
        found = minimise_exactly(np.arange(p, dtype=np.float64), r)
        assert list(found.g) == [Fraction(1, p)] * p
    assert region(np.empty((0, 3)), margin=0.1).exact_margin == Fraction(0.1)


@pytest.mark.parametrize("seed", range(4))
def test_an_empty_region_comes_with_a_proof(seed: int) -> None:
    rng = np.random.default_rng(seed)
    empty = 0
    for _ in range(40):
        p, n = int(rng.integers(2, 8)), int(rng.integers(2, 20))
        r = region(
            rng.normal(size=(n, p)),
            margin=float(rng.choice([0, 0.01])),
            rhs=rng.normal(size=n) * 0.1,
        )
        found = minimise_exactly(rng.normal(size=p), r)
        assert (found.end is End.EMPTY) == is_empty(exactly(r))
        if found.end is End.EMPTY:
            empty += 1
            assert is_empty(exactly(r.take(np.array(found.support))))
            assert len(found.support) <= p + 1
    assert empty > 10


def test_a_row_of_zeros() -> None:
    zeros = np.zeros((1, 3))
    assert minimise_exactly(np.ones(3), region(zeros, rhs=[1e-300])).support == (0,)
    assert minimise_exactly(np.ones(3), region(zeros, rhs=[-1e-300])).end is End.OPTIMAL


@on_any_processor
def test_indifferent_differences_do_not_stall() -> None:
    """Objectives and rows of few distinct numbers have ties everywhere."""
    rng = np.random.default_rng(0)
    p, n = 24, 300
    g = rng.integers(1, 9, size=p).astype(np.float64)
    rows = rng.integers(-1, 2, size=(n, p)).astype(np.float64)
    r = region(np.where(rows @ g < 0, -1, 1)[:, None] * rows)
    begin = time.perf_counter()
    for t in [
        np.zeros(p),
        np.ones(p),
        -np.eye(p)[3],
        np.eye(p)[3],
        rows[0],
        -rows[1],
        rows[2] + rows[3],
    ]:
        check_optimal(t, r, minimise_exactly(t, r))
    assert time.perf_counter() - begin < 20.0  # it was minutes without the tie-break


def test_the_smallest_index_rule_ends_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rule that takes over after many steps, from the first step, without a proposal from
    floats.
    """
    from elicit.lp import dual_simplex as simplex

    violated = simplex._IntegerVertex.violated
    monkeypatch.setattr(
        simplex._IntegerVertex, "violated", lambda self, by_index: violated(self, True)
    )
    monkeypatch.setattr(simplex._IntegerVertex, "at", lambda region, basis: None)
    for case in cases(12, 28, asks=1, most_levels=8, most_answers=30):
        r = case.known().region
        for t in tail_sums(case.ask):
            check_optimal(t, r, minimise_exactly(t, r))


def test_wild_numbers() -> None:
    """Rows and objectives of 1e300 and 1e-300 at once cost only bits."""
    rows = np.array([[1e300, -1e-300, 1.0], [-5e-324, 5e-324, 0.0], [1.0, -1e-17, -1e-17]])
    r = region(rows, margin=1e-6)
    for t in np.array([[1e300, -1e-300, 0.0], [5e-324, -5e-324, 0.0], [-1e-17, 1e300, -1e300]]):
        assert minimise(t, r).end in End
        check_optimal(t, r, minimise_exactly(t, r))


def test_take_and_plus() -> None:
    r = region([[1.0, -1.0], [0.5, -1.0]], margin=0.1)
    less = r.take(np.array([False, True]), margin=0.0)
    assert (less.margin, less.owner.tolist(), less.rows.tolist()) == (0.0, [1], [[0.5, -1.0]])
    more = less.plus(np.array([[0.0, 1.0]]), np.array([0.25]), np.array([7]))
    assert (more.owner.tolist(), more.rhs.tolist(), more.p) == ([1, 7], [0.0, 0.25], 2)
