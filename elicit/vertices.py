"""Optimal vertices of K_t, kept as proofs: their active rows bound t.g for every t that has them as minimiser.

Where the multipliers of t at a vertex are non-negative, the vertex is optimal for t too and its active rows
prove the optimum. A vertex that a later answer cuts off still proves a bound: its rows still hold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elicit.scale import Floats
from elicit.simplex import Region, rounding

MOST = 192
_NEARLY = 1e-12  # multipliers this far below zero are set to zero, which keeps the bound valid


class Vertices:
    """A growing collection of vertices, each by its p - 1 active constraints beside sum g = 1."""

    def __init__(self, p: int, margin: float) -> None:
        self.margin = margin
        self._inverses = np.empty((p, p - 1, 0))  # (p, p-1, v): t @ inverse is the active constraints' multipliers
        self._rows = np.empty((0, p - 1, p))  # the active rows; zero where a gap's own constraint is active
        self._rhs = np.empty((0, p - 1))

    def copy(self) -> Vertices:
        """Another collection of the same vertices."""
        new = Vertices(self._rows.shape[2], self.margin)
        new._inverses, new._rows, new._rhs = self._inverses, self._rows, self._rhs
        return new

    def add(self, region: Region, basis: tuple[int, ...], t: Floats) -> bool:
        """Keep the vertex of this basis if it proves that t.g > 0, and say whether it does."""
        p = region.p
        matrix, rows, rhs = np.ones((p, p)), np.zeros((p - 1, p)), np.zeros(p - 1)
        for i, c in enumerate(basis):
            matrix[i + 1] = np.eye(p)[c] if c < p else region.rows[c - p]
            if c >= p:
                rows[i], rhs[i] = region.rows[c - p], region.rhs[c - p]
        try:
            inverse: Floats = np.asarray(np.linalg.inv(matrix), dtype=np.float64)[:, 1:]
        except np.linalg.LinAlgError:
            return False
        if not self._bound(t, t @ inverse, rows, rhs) > 0:
            return False
        self._inverses = np.concatenate([self._inverses[:, :, -MOST + 1 :], inverse[:, :, None]], axis=2)
        self._rows = np.concatenate([self._rows[-MOST + 1 :], rows[None]])
        self._rhs = np.concatenate([self._rhs[-MOST + 1 :], rhs[None]])
        return True

    def prove(self, t: Floats) -> NDArray[np.bool_]:
        """Marks t (n, p) with t.g > 0 on K_t, proven by the first vertex whose multipliers fit."""
        n, v, p = len(t), len(self._rhs), t.shape[1]
        if not n or not v:
            return np.zeros(n, dtype=bool)
        y = (t @ self._inverses.reshape(p, -1)).reshape(n, p - 1, v)
        at = np.logical_and.reduce(y >= -_NEARLY, axis=1).argmax(axis=1)  # the first that fits, else 0: no harm
        out: NDArray[np.bool_] = self._bound(t, y[np.arange(n), :, at], self._rows[at], self._rhs[at]) > 0
        return out

    def _bound(self, t: Floats, y: Floats, rows: Floats, rhs: Floats) -> Floats:
        """A lower bound (...) on t.g for any multipliers y (..., p-1), negative ones set to zero: the closed
        form over K_0 of t - y rows, plus y.rhs, less every rounding. Rows are at most 1, right-hand sides 2."""
        y = np.maximum(y, 0.0)
        with np.errstate(all="ignore"):
            rest = t - np.matmul(y[..., None, :], rows)[..., 0, :]
            magnitude = 4.0 * np.abs(t).max(axis=-1) + 6.0 * y.sum(axis=-1)
            least = self.margin * rest.sum(axis=-1) + (1.0 - t.shape[-1] * self.margin) * rest.min(axis=-1)
            bound: Floats = least + (y * rhs).sum(axis=-1) - rounding(2 * t.shape[-1], magnitude)
        return bound  # never wrongly positive: what overflows is not a number
