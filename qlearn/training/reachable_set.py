"""What policies can reach at most, as far as trainings tell: a polytope of vectors, known by its corners.

No training names the vectors that policies can reach, but each bounds them: one that came within a gap of its optimum
says that no policy is better at its own scale by more than that (outer approximation: Roijers 2015, "Multi-objective
decision-theoretic planning"). Vectors are held as tail sums t, in which a scale with gaps g makes t.g of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.fixed_order import product
from elicit._support.validation import require
from elicit.model.comparator import check_levels
from elicit.model.scale import Floats, as_vectors

MOST_CORNERS = 4_000
"""A cut that would leave more is left out: the set is then larger than it might be, and bounds over it still hold."""

_ON = 1e-9  # from a facet, of sizes about 1: on it
_SAME = 10  # decimals by which corners are told apart


@dataclass(frozen=True, eq=False)
class ReachableSet:
    """{t : facets t <= limits}: ``corners`` (c, p), among them all of its corners and no points outside, but for
    rounding; ``facets`` (f, p), ``limits`` (f,), and which facets each corner is on, ``tight`` (c, f)."""

    corners: Floats
    facets: Floats
    limits: Floats
    tight: NDArray[np.bool_]

    @staticmethod
    def of(corners: Floats, facets: Floats, limits: Floats) -> ReachableSet:
        """The set with these corners and facets."""
        return ReachableSet(corners, facets, limits, np.abs(corners @ facets.T - limits) <= 10 * _ON)

    @staticmethod
    def shares(k: int) -> ReachableSet:
        """All share vectors of k levels: 1 >= t_1 >= ... >= t_p >= 0."""
        p = check_levels(k) - 1
        facets = np.concatenate([np.eye(p), np.zeros((1, p))]) - np.concatenate([np.zeros((1, p)), np.eye(p)])
        return ReachableSet.of(np.tri(k, p, -1), facets, np.eye(k)[0])

    @staticmethod
    def box(low: ArrayLike, high: ArrayLike) -> ReachableSet:
        """All vectors of m objectives from ``low`` to ``high`` (m,), for ``elicit.objectives``. Raises ValueError."""
        least, most = np.atleast_1d(np.asarray(low, np.float64)), np.atleast_1d(np.asarray(high, np.float64))
        alike = least.ndim == 1 and least.shape == most.shape
        fits = alike and bool((np.isfinite(most - least) & (least < most)).all())
        require(fits, "low and high", "numbers (m,), each low below its high", (low, high))
        m = len(least)
        require(m <= 14, "the number of objectives", "at most 14, for a box of m objectives has 2^m corners", m)
        ends = np.stack(np.meshgrid(*[[0, 1]] * m, indexing="ij"), axis=-1).reshape(-1, m)
        facets = np.concatenate([np.eye(m), -np.eye(m)])
        return ReachableSet.of(np.where(ends, most, least), facets, np.concatenate([most, -least]))

    @property
    def vectors(self) -> Floats:
        """(c, k) the corners as vectors of total 1."""
        t = self.corners
        return np.concatenate([1.0 - t[:, :1], t[:, :-1] - t[:, 1:], t[:, -1:]], axis=1)

    def excess(self, t: Floats) -> float:
        """How far tail sums t (p,) lie outside, at most; negative inside."""
        return float((product(self.facets, t) - self.limits).max())

    def greatest(self, gaps: Floats) -> Floats:
        """The greatest t.g (m,) under each of the gaps (p, m)."""
        return np.asarray(product(self.corners, gaps).max(axis=0))

    def cut(self, gaps: Floats, limit: float) -> ReachableSet:
        """The part of it with t.g <= limit: corners outside give way to points on the edges that lead outside."""
        beyond = product(self.corners, gaps) - limit
        outside, inside = np.flatnonzero(beyond > _ON), np.flatnonzero(beyond < -_ON)
        if not len(outside) or len(outside) == len(beyond):
            return self
        # the ends of an edge are on p - 1 common facets; other pairs that are only add points of the set
        common = self.tight[inside].astype(np.float32) @ self.tight[outside].T.astype(np.float32)
        i, o = np.nonzero(common >= self.facets.shape[1] - 1)
        i, o = inside[i], outside[o]
        share = (beyond[o] / (beyond[o] - beyond[i]))[:, None]
        met = share * self.corners[i] + (1.0 - share) * self.corners[o]
        corners = np.concatenate([self.corners[beyond <= _ON], met])
        corners = corners[np.unique(np.round(corners, _SAME), axis=0, return_index=True)[1]]
        if len(corners) > MOST_CORNERS:
            return self
        return ReachableSet.of(corners, np.concatenate([self.facets, gaps[None, :]]), np.append(self.limits, limit))


def as_shares(shares: ArrayLike, k: int) -> tuple[Floats, float]:
    """A vector (k,) of total 1, and the share of it that was missing, which is taken to be as the rest is. Raises
    ValueError for a total above 1 or no more than 0, and for what is no vector of k finite numbers."""
    given = as_vectors(shares, k, name="shares")
    require(len(given) == 1, "shares", f"one vector of {k} shares", shares)
    total = float(given.sum())
    require(0 < total <= 1 + 1e-6, "shares", "of a total of 1, or less where runs were cut off", shares)
    return given[0] / total, 1.0 - total if total < 1.0 - _ON else 0.0
