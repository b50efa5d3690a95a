"""Gaps, normalised scales, and the closed form over all ordered ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit.model.scale import dot, gaps, normalise, order_bounds, values_of
from tests.thoroughness import examples

floats = st.floats(-1e6, 1e6)
vectors = st.integers(2, 8).flatmap(lambda k: st.lists(floats, min_size=k, max_size=k))


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
