"""Differences: checked, turned into tail sums, and brought to order one, in NumPy and compiled."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import elicit
from elicit import as_differences
from elicit.model.difference import MOST, as_vectors, dominance, of_order_one, tail_sums
from elicit.model.difference_kernel import by_dominance, tail_sums_into, to_order_one
from tests.lp_cases import exact
from tests.scale_arithmetic import dot
from tests.thoroughness import examples

Floats = np.ndarray[Any, Any]
floats = st.floats(-1e6, 1e6)
small = st.integers(2, 8).flatmap(lambda k: st.lists(floats, min_size=k, max_size=k))
wild = st.one_of(
    st.floats(-MOST, MOST),
    st.sampled_from([0.0, -0.0, 5e-324, -5e-324, MOST, -MOST, 1e300, 1e-300, 1.0]),
)
vectors = st.lists(wild, min_size=2, max_size=9)


@pytest.mark.parametrize(
    ("bad", "k", "complaint"),
    [
        ([[1, 2, 3]], 4, r"\(n, 4\).*\(1, 3\)"),
        ([1], None, "k >= 2"),
        ([], None, "k >= 2"),
        (np.zeros((1, 2, 3)), None, "shape"),
        ([[1, 2], [3, np.nan]], None, "row 1, level 2 is nan"),
        ([[1, -np.inf]], None, "row 0, level 2 is -inf"),
        ([[1, 2], [3]], None, "numbers"),
        (["a", "b"], None, "numbers"),
        ([1j, 2], None, "numbers"),
        (None, None, "shape|finite"),
    ],
)
def test_bad_vectors(bad, k, complaint):
    with pytest.raises(ValueError, match=complaint):
        as_vectors(bad, k)


def test_one_vector_becomes_one_row():
    assert [as_vectors(given).shape for given in ([1, 2, 3], np.zeros((0, 4)))] == [(1, 3), (0, 4)]
    assert as_vectors([[1, 2], [3, 4]], 2).dtype == np.float64


@given(small)
@examples(200)
def test_tail_sums_are_sequential_from_the_best_level(d):
    wanted, total = [], 0.0
    for x in reversed(d[1:]):
        total += x
        wanted.append(total)
    d = np.array(d)
    assert tail_sums(d).tolist() == wanted[::-1]
    assert (tail_sums(np.stack([d, -d])) == np.outer([1, -1], wanted[::-1])).all()
    assert (tail_sums(d * 2.0**40) == tail_sums(d) * 2.0**40).all()


@given(small)
@examples(200)
def test_the_two_coordinates_agree(d):
    """d.e = t.g for e_1 = 0, in exact arithmetic up to the rounding of the tail sums."""
    d = np.array(d)
    e = np.concatenate([[0.0], np.cumsum(np.arange(1.0, len(d)))]) / 64
    g = np.diff(e)
    exact = sum(Fraction(x) * Fraction(v) for x, v in zip(d.tolist(), e.tolist(), strict=True))
    assert float(dot(tail_sums(d), g)) == pytest.approx(
        float(exact), abs=1e-12 * (1 + np.abs(d).sum())
    )


@given(small)
@examples(200)
def test_dominance_is_agreement_of_all_scales(d):
    """Equation (4) holds exactly where d.e has one sign at every corner of the ordered scales."""
    t = tail_sums(np.array(d))
    corners = t.tolist()  # the scale with its whole range in gap j gives d.e = t_j
    up, down = any(x > 0 for x in corners), any(x < 0 for x in corners)
    code = int(dominance(t))
    assert code == (2 if up and down else up - down)
    assert int(dominance(-t)) == (2 if code == 2 else -code)


def test_dominance_of_many():
    t = np.array([[0, 0], [1, 0], [0, -1], [1, -1], [0.0, -0.0]])
    assert dominance(t).tolist() == [0, 1, -1, 2, 0]
    assert dominance(t).dtype == np.int8
    assert dominance(np.empty((0, 3))).shape == (0,)


def sums_of(d: Floats) -> Floats:
    t = np.empty(d.shape[1] - 1)
    tail_sums_into(d, len(d) - 1, t)
    return t


@examples(300)
@given(vectors)
@example([0.0, MOST, MOST, -MOST, 5e-324])
@example([1.0, 5e-324, -5e-324, -0.0])
def test_compiled_tail_sums_are_the_same(d: list[float]) -> None:
    both = np.array([np.zeros(len(d)), d])
    t = tail_sums(both)[1]
    assert sums_of(both).tolist() == t.tolist()  # but for the sign of zero
    assert by_dominance(t.copy()) == dominance(t)


def test_compiled_tail_sums_are_the_same_even_where_they_are_minus_zero() -> None:
    d = np.array([[0.0, -0.0, -0.0]])
    assert sums_of(d).tobytes() == np.ascontiguousarray(tail_sums(d)[0]).tobytes()


@examples(300)
@given(vectors)
@example([1e300, 1e-300])
@example([1.0, 5e-324])
@example([5e-324, -1e-320, 0.0])
@example([0.5, -0.75])
@example([0.0, -0.0])
def test_scaling_loses_no_bit(numbers: list[float]) -> None:
    t = np.array(numbers)
    size, _ = to_order_one(t)
    assert size == np.abs(t).max()
    before, largest = exact(numbers), max(map(abs, numbers))
    exponent = math.frexp(largest)[1]
    wanted = [x / Fraction(2) ** exponent for x in before]
    if largest > 0 and not 0.5 <= size < 1:  # left as it was, since some bit has no place
        assert exact(t) == before
        assert any(
            Fraction(math.ldexp(x, -exponent)) != w for x, w in zip(numbers, wanted, strict=True)
        )
    else:
        assert exact(t) == wanted


def loses_bits(d: list[float]) -> bool:
    """Return whether some number is lost to floats once the largest tail sum is below 1."""
    t = tail_sums(np.array(d)).tolist()
    power = Fraction(2) ** math.frexp(max(map(abs, t)))[1]
    return any(Fraction(float(x / power)) != x / power for x in exact([*t, *d[1:]]))


@examples(300)
@given(vectors)
@example([0.0, 0.0])
@example([1e308, 0.5, -0.75])
def test_order_one_is_exact_or_refused(numbers: list[float]) -> None:
    d = np.array([numbers])
    if loses_bits(numbers):
        with pytest.raises(ValueError, match="both huge and tiny"):
            of_order_one(d)
        return
    found = of_order_one(d)
    power = Fraction(2) ** int(found.exponent[0])
    assert [x * power for x in exact(found.t[0])] == exact(tail_sums(d)[0])
    assert [x * power for x in exact(found.d[0, 1:])] == exact(d[0, 1:])
    size = np.abs(found.t).max()
    assert size == 0 or 0.5 <= size < 1
    t = np.ascontiguousarray(tail_sums(d)[0])
    assert to_order_one(t) == (size, found.exponent[0])
    assert (t == found.t[0]).all()


def test_the_row_that_holds_both_huge_and_tiny_numbers_is_named() -> None:
    with pytest.raises(ValueError, match=r"row 1 of the answers holds both huge and tiny"):
        of_order_one(np.array([[0, 1.0, 0.5], [0, 1e300, 1e-300]]), "the answers")


@pytest.mark.parametrize("k", [2, 40])
def test_the_stated_range(k: int) -> None:
    d = np.zeros((2, k))
    d[1, 1:] = MOST
    assert np.isfinite(tail_sums(as_differences(d, k))).all()
    assert elicit.PolytopeComparator(k).compare(d).tolist() == [0, 1]
    d[1, -1] = -2 * MOST
    with pytest.raises(ValueError, match=rf"must lie between .* row 1, level {k} is -2.1.*e\+301"):
        as_differences(d, k)
    with pytest.raises(ValueError, match="must lie between"):
        elicit.Answers(d, [0, 1])
    d[:, 0] = 1.7e308  # level 1 never enters
    d[1, -1] = 0.0
    as_differences(d, k)
