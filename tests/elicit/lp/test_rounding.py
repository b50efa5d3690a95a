"""Bounds on rounding errors, beside exact arithmetic."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit.lp.dual_simplex import minimise_exactly
from elicit.lp.region import Region
from elicit.lp.rounding import bound_of, certified_bound, rounding, strictly_inside
from tests.lp_cases import cases, dot, exact, exactly, least_from_scratch, region
from tests.thoroughness import examples, scaled

NO_NUMBERS = (math.nan, math.inf, -math.inf)
finite = st.floats(min_value=-1.0, max_value=1.0)
numbers = st.floats(
    allow_nan=False, allow_infinity=False, min_value=-(2.0**400), max_value=2.0**400
)


@examples(150)
@given(st.data())
def test_any_multipliers_give_a_bound_on_any_region(data: st.DataObject) -> None:
    p, m = data.draw(st.integers(1, 4)), data.draw(st.integers(0, 4))
    vectors = st.lists(finite, min_size=p, max_size=p)
    rows = np.array([data.draw(vectors) for _ in range(m)]).reshape(m, p)
    rhs = np.array([data.draw(st.floats(-1.0, 0.5)) for _ in range(m)])
    y = np.array([data.draw(st.floats(0.0, 1e300)) for _ in range(m)])
    t = np.array(data.draw(vectors))
    r = Region(data.draw(st.floats(0.0, 1.0 / p)), rows, rhs, np.arange(m))
    bound = certified_bound(t, y, r)
    least = least_from_scratch(exact(t), exactly(r))
    if least is not None:
        assert bound == -np.inf or Fraction(bound) <= least


def test_strictly_inside_is_a_proof() -> None:
    rng = np.random.default_rng(8)
    inside = 0
    for case in cases(22, scaled(28, 84), asks=1, most_levels=9):
        r, e = case.known().region, case.region()
        for _ in range(10):
            g = (
                rng.dirichlet(np.full(r.p, 3.0))
                if rng.random() < 0.5
                else np.array([float(x) for x in case.truth])
            )
            if strictly_inside(g, r):
                inside += 1
                total = sum(exact(g))
                assert e.contains([x / total for x in exact(g)]), case.kind
    assert inside > 20


def test_the_border_is_not_inside() -> None:
    r = region([[1.0, -1.0]], margin=0.0)
    assert strictly_inside(np.array([0.6, 0.4]), r)
    assert not strictly_inside(np.array([0.5, 0.5]), r)
    assert not strictly_inside(np.array([1.0, 0.0]), r)
    assert not strictly_inside(np.array([0.7, 0.4]), r)  # of another total
    assert not strictly_inside(np.array([np.nan, 0.5]), r)


@examples(200)
@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=30))
def test_rounding_bounds_the_error_of_a_float_sum(pairs: list[tuple[float, float]]) -> None:
    a, b = np.array(pairs).T
    magnitude = float(np.abs(a) @ np.abs(b))
    error = abs(Fraction(float(a @ b)) - dot(exact(a), exact(b)))
    assert error <= Fraction(rounding(len(pairs), magnitude))


@examples(400)
@given(st.data())
def test_any_multipliers_of_any_constraints_give_a_bound(data: st.DataObject) -> None:
    """Numbers of any size give a valid bound; nan and overflow prove nothing."""
    p, m = data.draw(st.integers(1, 4)), data.draw(st.integers(0, 3))
    entry = st.one_of(st.floats(-1.0, 1.0), st.sampled_from([1.0, -1.0, 0.5]))
    rows = np.array([data.draw(st.lists(entry, min_size=p, max_size=p)) for _ in range(m)]).reshape(
        m, p
    )
    r = region(
        rows,
        data.draw(st.floats(0.0, 1.0 / p)),
        [data.draw(st.floats(-2.0, 0.4)) for _ in range(m)],
    )
    s = np.array(
        data.draw(st.lists(st.one_of(entry, st.sampled_from(NO_NUMBERS)), min_size=p, max_size=p))
    )
    s = s * 2.0 ** data.draw(st.sampled_from([0, 0, -1000, -1040, 990, 1021]))
    active = np.array(
        data.draw(st.lists(st.integers(0, p + m - 1), min_size=p - 1, max_size=p - 1)),
        dtype=np.int64,
    )
    weight = st.one_of(st.floats(width=64), st.sampled_from([0.0, 1e-12, 1.0, 1e12]))
    y = np.array(data.draw(st.lists(weight, min_size=p, max_size=p)))
    with np.errstate(all="ignore"):
        bound = bound_of(
            s.copy(), y, active[None], 0, r.margin, np.ascontiguousarray(rows.T), r.rhs
        )
    if not np.isfinite(s).all() or not math.isfinite(bound):
        assert not bound > 0
        return
    vertex = minimise_exactly(s, r)
    assert (
        vertex.support or Fraction(bound) <= vertex.value
    )  # of an empty region every bound is true


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # where it is not compiled
def test_a_sum_that_overflows_proves_nothing() -> None:
    s = np.array([-4e307, 4e307, 4e307, 4e307, 4e307, 4e307, 4e307])
    nothing = np.zeros((7, 0)), np.zeros(0)
    assert (
        not bound_of(s, np.zeros(7), np.arange(6)[None], 0, 1e-3, *nothing) > 0
    )  # least: -4e307 * 0.994...
