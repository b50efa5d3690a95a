"""Linear algebra of a fixed order agrees with NumPy's, and compiled with interpreted to the last
bit.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elicit._support import fixed_order
from elicit._support.fixed_order import (
    LeastSquares,
    null_basis,
    principal_axes,
    product,
    sums_to_zero,
)
from elicit._support.jit import compiling


@given(st.integers(1, 12), st.integers(1, 13), st.integers(1, 9), st.integers(0, 999))
@settings(max_examples=40, deadline=None)
def test_products(n: int, p: int, m: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((n, p)), rng.standard_normal((p, m))
    found = product(a, b)
    np.testing.assert_allclose(found, a @ b, rtol=0, atol=1e-13)
    into = np.zeros((n, m))
    fixed_order._product_of_arrays(a, b, into)
    np.testing.assert_array_equal(found, into)
    with compiling():
        np.testing.assert_array_equal(product(a, b), found)
    np.testing.assert_array_equal(
        product(a[0], b), found[0]
    )  # a row does not depend on its neighbours
    np.testing.assert_array_equal(product(np.asfortranarray(a), b.copy(order="F")), found)
    np.testing.assert_allclose(product(a, b[:, 0]), a @ b[:, 0], rtol=0, atol=1e-13)


@given(st.integers(2, 12), st.integers(0, 4), st.integers(0, 999))
@settings(max_examples=30, deadline=None)
def test_bases(p: int, m: int, seed: int) -> None:
    rows = np.random.default_rng(seed).standard_normal((min(m, p - 1), p))
    for basis, wanted, matrix in (
        (sums_to_zero(p), p - 1, np.ones((1, p))),
        (null_basis(rows), p - len(rows), rows),
        (null_basis(np.concatenate([rows, rows])), p - len(rows), rows),
    ):
        assert basis.shape == (p, wanted)
        np.testing.assert_allclose(basis.T @ basis, np.eye(wanted), rtol=0, atol=1e-12)
        np.testing.assert_allclose(matrix @ basis, 0, rtol=0, atol=1e-12)


@given(st.integers(1, 8), st.integers(0, 20), st.integers(0, 999), st.booleans())
@settings(max_examples=40, deadline=None)
def test_least_squares(q: int, more: int, seed: int, uneven: bool) -> None:
    rng = np.random.default_rng(seed)
    matrix, target = rng.standard_normal((q + more, q)), rng.standard_normal(q + more)
    if uneven:  # as rows are that are scaled by slacks of very different sizes
        matrix *= 10.0 ** rng.uniform(-6, 6, q + more)[:, None]
    if np.linalg.cond(matrix) > 1e9:
        return
    factors = LeastSquares(matrix)
    wanted = np.linalg.lstsq(matrix, target, rcond=None)[0]
    scale = 1e-9 * max(1.0, float(np.abs(wanted).max()))
    np.testing.assert_allclose(
        factors.solve(target), wanted, rtol=0, atol=scale * np.linalg.cond(matrix) ** 0.5
    )
    inverse = np.linalg.inv(matrix.T @ matrix) if not uneven else None
    if inverse is not None and np.linalg.cond(matrix) < 1e4:
        np.testing.assert_allclose(
            factors.shape @ factors.shape.T, inverse, rtol=1e-6, atol=1e-8 * inverse.max()
        )


def test_a_flat_matrix_has_no_infinite_solution() -> None:
    matrix = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    assert np.isfinite(LeastSquares(matrix).solve(np.ones(3))).all()
    assert np.isfinite(LeastSquares(np.zeros((3, 2))).shape).all()


@pytest.mark.parametrize("p", [1, 2, 5, 19])
def test_principal_axes(p: int) -> None:
    rng = np.random.default_rng(p)
    half = rng.standard_normal((p, 3 * p)) * 10.0 ** rng.uniform(-5, 0, p)[:, None]
    matrix = half @ half.T
    axes = principal_axes(matrix)
    np.testing.assert_allclose(axes.T @ axes, np.eye(p), rtol=0, atol=1e-12)
    turned = axes.T @ matrix @ axes
    np.testing.assert_allclose(
        turned, np.diag(np.diag(turned)), rtol=0, atol=1e-11 * np.abs(matrix).max()
    )
    np.testing.assert_allclose(
        np.sort(np.diag(turned)),
        np.linalg.eigvalsh(matrix),
        rtol=0,
        atol=1e-11 * np.abs(matrix).max(),
    )
