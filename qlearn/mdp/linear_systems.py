"""Discounted totals in a Markov chain, with the same result on every processor.

They are solutions of linear systems. A library's solution has rounding errors that differ between
processors. So the solution is refined until it is the exact one, rounded once. For that its
residual is computed without rounding: numbers are cut into parts of so few bits that their products
and sums are exact (Ozaki, Ogita, Oishi and Rump 2012). Then the system is solved for the residual.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy import sparse
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse.linalg import bicgstab, splu

from elicit.model.scale import Floats

_DENSE = 400  # up to this many states LAPACK is faster than an iteration
_SPARSE = 50_000  # up to this many, factors of a sparse matrix that fills up still fit into memory
_RESIDUAL = 1e-14  # leaves an error of at most this divided by 1 - discount
# largest number of sweeps beside a constant; the factor by which each must reduce the residual;
# and the factor by which it may rise at first
_SWEEPS, _FALLS, _AT_FIRST = 100, 0.7, 30.0
# bits of a part: products of two have 40, and sums of 2^13 of these still fit into the 53 bits of
# a float
_BITS = 20
_SMALL = 2.0**-42  # after a correction of this size the remaining error is far below the last bit
_CORRECTIONS = 6

Solver = Callable[[Floats], Floats]


def discounted_totals(chain: sparse.csr_array, inflow: Floats, discount: float) -> Floats:
    """Return x (n, m) with x = inflow + discount * chain @ x, as if rounded only once.

    The chain (n, n) is (sub)stochastic.
    """
    flows = (discount * chain).tocsr()
    solve = _dense(flows) if len(inflow) <= _DENSE else _sparse(flows, discount)
    x = solve(inflow)
    size = float(np.abs(x).max(initial=0.0))
    if size == 0.0 or not np.isfinite(size):
        return x
    unit = 2.0 ** -np.frexp(size)[1]
    high, low = _refined(flows, x * unit, inflow * unit, solve)
    return np.asarray((high + low) / unit)


def _refined(
    flows: sparse.csr_array, high: Floats, inflow: Floats, solve: Solver
) -> tuple[Floats, Floats]:
    """Refine an approximate solution; return it as high + low, with twice the digits of a float."""
    low = np.zeros_like(high)
    residual = _exact_residual(flows, inflow)
    for _ in range(_CORRECTIONS):
        left = residual(high, low)
        size = float(np.abs(left).max(initial=0.0))
        if size == 0.0:
            break
        step = low + solve(left / size) * size
        total = high + step
        low = step - (total - high)  # exact, because the step is the smaller one (Dekker 1971)
        high = total
        if np.abs(step).max() <= _SMALL:
            break
    return high, low


def _exact_residual(flows: sparse.csr_array, inflow: Floats) -> Callable[[Floats, Floats], Floats]:
    """Return a function that gives inflow + flows @ (high + low) - (high + low).

    Its error is far below the last bit.
    """
    first = _with_data(flows, _leading(flows.data, _BITS))
    rest = flows.data - first.data
    second = _with_data(flows, _leading(rest, 2 * _BITS))
    third = _with_data(flows, rest - second.data)
    rest = _with_data(flows, rest)
    inflow_high = _leading(inflow, 2 * _BITS)
    inflow_low, m = inflow - inflow_high, inflow.shape[1]

    def residual(high: Floats, low: Floats) -> Floats:
        x = _leading(high, _BITS)
        y = _leading(high - x, 2 * _BITS)
        z = ((high - x) - y) + low
        by_first = first @ np.concatenate([x, y, z], axis=1)
        by_second, by_third = (part @ np.concatenate([x, y], axis=1) for part in (second, third))
        exact = (by_first[:, :m] - x - y + inflow_high) + (
            by_first[:, m : 2 * m] + by_second[:, :m]
        )
        small = (by_first[:, 2 * m :] + by_second[:, m:] + by_third[:, :m]) - z + inflow_low
        return np.asarray(exact + small + (rest @ z + by_third[:, m:]))

    return residual


def _leading(x: Floats, bits: int) -> Floats:
    """Return x rounded to a number of bits behind the binary point."""
    return np.asarray(np.round(x * 2.0**bits) * 2.0**-bits)


def _with_data(matrix: sparse.csr_array, data: Floats) -> sparse.csr_array:
    """Return a matrix of the same pattern with other entries."""
    return sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


def _dense(flows: sparse.csr_array) -> Solver:
    """Return a solver that uses a dense LU factorisation."""
    factors = lu_factor(
        np.eye(flows.shape[0]) - flows.toarray(), check_finite=False, overwrite_a=True
    )
    return partial(lu_solve, factors, check_finite=False)


def _sparse(flows: sparse.csr_array, discount: float) -> Solver:
    """Return a solver for a sparse chain, which tries four methods and keeps the first that works.

    The first two are quick on chains that mix: sweeps with a constant correction, and Krylov steps.
    The third is a factorisation, which would fill up on such chains. If it does not fit into
    memory, plain sweeps are used.
    """
    n = flows.shape[0]
    matrix = sparse.eye_array(n, format="csr") - flows

    def by_factors() -> Solver:
        by_sweeps = partial(_swept, flows, discount=discount)
        return by_sweeps if n > _SPARSE else splu(matrix.tocsc()).solve

    left: list[Callable[[], Callable[[Floats], Floats | None]]] = [
        lambda: partial(_swept_beside_a_constant, flows),
        lambda: partial(_by_krylov_steps, matrix),
        by_factors,
    ]
    method = left.pop(0)()

    def solve(inflow: Floats) -> Floats:
        nonlocal method
        while (x := method(inflow)) is None:
            method = left.pop(0)()
        return x

    return solve


def _swept_beside_a_constant(flows: sparse.csr_array, inflow: Floats) -> Floats | None:
    """Return the solution by sweeps with a constant correction, or None if they are too slow.

    Sweeps reduce the error as fast as the chain mixes, apart from an error that is the same in all
    states: this they reduce only slowly if the discount is near 1. So each sweep also adds the
    constant that makes the mean residual 0.
    """
    leak = 1.0 - float(flows.sum()) / flows.shape[0]  # the share of a constant that a sweep loses
    x, first = inflow.copy(), np.inf
    for sweep in range(_SWEEPS):
        residual = inflow + flows @ x
        residual -= x
        size = float(np.abs(residual).max(initial=0.0))
        if size <= _RESIDUAL * max(1.0, float(np.abs(x).max(initial=0.0))):
            return x
        first = size if sweep == 0 else first
        if not size <= _AT_FIRST * first * _FALLS**sweep:
            return None
        residual += residual.mean(axis=0) * ((1.0 - leak) / leak)
        x += residual
    return None


def _by_krylov_steps(matrix: sparse.csr_array, inflow: Floats) -> Floats | None:
    """Return the solution by Krylov steps, column by column, or None if they do not converge."""
    x = inflow.copy()
    for column in x.T:
        target = column.copy()
        for _ in range(6):
            residual = target - matrix @ column
            if np.abs(residual).max() <= _RESIDUAL * max(1.0, np.abs(column).max()):
                break
            with np.errstate(
                all="ignore"
            ):  # if it diverges until numbers overflow, factors are taken
                column += bicgstab(matrix, residual, rtol=1e-6, maxiter=100)[0]
        else:
            return None
    return x


def _swept(flows: sparse.csr_array, inflow: Floats, discount: float) -> Floats:
    """Solve by sweeps, each of which multiplies the error by ``discount``.

    That is slow, but takes no memory.
    """
    x = inflow.copy()
    for _ in range(int(np.ceil(np.log(_RESIDUAL) / np.log(discount))) if discount > 0 else 1):
        before, x = x, inflow + flows @ x
        if np.abs(x - before).max() <= _RESIDUAL * max(1.0, np.abs(x).max()):
            break
    return x
