"""Tail sums, gaps and dominance: the coordinates in which everything else is written."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit.model.scale import (
    as_vectors,
    dominance,
    dot,
    gaps,
    normalise,
    order_bounds,
    tail_sums,
    values_of,
)
from tests.thoroughness import examples

floats = st.floats(-1e6, 1e6)
vectors = st.integers(2, 8).flatmap(lambda k: st.lists(floats, min_size=k, max_size=k))


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


@given(vectors)
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


@given(vectors)
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


@pytest.mark.parametrize(
    "d", [[0, 1e308, 1e308, -1e308], [0, -1.7e308, -1.7e308], [5, 1e308, 1e300]]
)
def test_huge_entries_keep_their_signs(d):
    t = tail_sums(np.array(d))
    assert np.isfinite(t).all()
    exact = [sum(Fraction(x) for x in map(float, d[j:])) for j in range(1, len(d))]
    assert np.sign(t).tolist() == [(x > 0) - (x < 0) for x in exact]
    small = np.array([[1.0, 2.0, 3.0]])
    both = tail_sums(np.concatenate([small, [[0.0, 1e308, 1e308]]]))
    assert (both[0] == tail_sums(small)[0]).all(), "a huge neighbour must not scale a row"


@given(vectors)
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


@given(st.integers(2, 7), st.floats(0, 1), st.data())
@examples(150)
def test_bounds_over_all_ordered_scales(k, part, data):
    """The closed form is reached at a corner of K_0, and no scale inside does better."""
    t = np.array(data.draw(st.lists(st.floats(-10, 10), min_size=k - 1, max_size=k - 1)))
    margin = part / (k - 1)
    low, high = order_bounds(t, margin)
    corners = [np.full(k - 1, margin) + (1 - (k - 1) * margin) * axis for axis in np.eye(k - 1)]
    products = [float(t @ g) for g in corners]
    assert (low, high) == pytest.approx((min(products), max(products)), abs=1e-9)
    g = margin + (1 - (k - 1) * margin) * np.random.default_rng(0).dirichlet(np.ones(k - 1))
    assert low - 1e-9 <= float(t @ g) <= high + 1e-9


def test_dot_does_not_depend_on_the_batch():
    rng = np.random.default_rng(0)
    t, g = rng.standard_normal((200, 19)), rng.dirichlet(np.ones(19))
    together = dot(t, g)
    assert all(float(dot(row, g)) == x for row, x in zip(t, together, strict=True))
    assert (dot(t[::-1], g) == together[::-1]).all()
    assert (dot(-t, g) == -together).all()


@given(st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=12), st.floats(-1e3, 1e3))
@examples(100)
def test_normalise(steps, start):
    values = start + np.concatenate([[0.0], np.cumsum(steps)])
    e = normalise(values)
    assert (e[0], e[-1]) == (0, 1)
    assert (np.diff(e) > 0).all()
    assert (normalise(e) == e).all()
    assert (normalise(values * 8) == e).all()
    assert np.allclose(values_of(gaps(values)), e, atol=1e-12)
    assert gaps(values).sum() == pytest.approx(1)


@pytest.mark.parametrize(
    "values", [[-1.7e308, 0, 1.7e308], [1e-300, 2e-300, 3e-300], [1e16, 1e16 + 2, 1e16 + 4]]
)
def test_normalise_extremes(values):
    assert normalise(values) == pytest.approx([0, 0.5, 1], abs=1e-15)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ([1, 2, 2], "value 2 is 2 and value 3 is 2"),
        ([2, 1], "increase"),
        ([1], "k >= 2"),
        ([[1, 2]], r"\(1, 2\)"),
        ([1, np.nan], "finite"),
        (3.0, "shape"),
        ([0, 5e-324], "too close"),
        ([0, 1e-300, 1e300], "too close"),
    ],
)
def test_bad_values(values, complaint):
    with pytest.raises(ValueError, match=complaint):
        normalise(values)
