"""The vectors that policies may have, as far as trainings tell: a polytope.

A training shows one reachable vector, but bounds all of them. If its result is within a gap of its
optimum, then at its own scale no policy is better by more than the gap (outer approximation:
Roijers 2015, "Multi-objective decision-theoretic planning"). Vectors are held as tail sums t, so
that their value under a scale with gaps g is t.g.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.fixed_order import product
from elicit._support.validation import require
from elicit.model.comparator import check_levels
from elicit.model.difference import as_vectors
from elicit.model.scale import Floats

MOST_CORNERS = 4_000
"""A cut that would leave more vertices than this is left out. The set is then larger than
necessary, and bounds over it still hold."""

_ON = 1e-9  # a point this near to an inequality's limit is on it, for sizes of about 1
_SAME = 10  # vertices that agree to this many decimals are the same


@dataclass(frozen=True, eq=False)
class ReachableSet:
    """A polytope {t : facets t <= limits} that contains every policy's vector, as tail sums t (p,).

    ``corners`` (c, p) are all of its vertices, up to rounding. A row of ``facets`` (f, p) with its
    entry of ``limits`` (f,) is one linear inequality. ``tight`` (c, f) flags the inequalities that
    hold with equality at each vertex.
    """

    corners: Floats
    facets: Floats
    limits: Floats
    tight: NDArray[np.bool_]
    full: bool = False  # True if a cut was left out

    @staticmethod
    def of(corners: Floats, facets: Floats, limits: Floats) -> ReachableSet:
        """Return the set with these vertices and inequalities."""
        return ReachableSet(
            corners, facets, limits, np.abs(corners @ facets.T - limits) <= 10 * _ON
        )

    @staticmethod
    def shares(k: int) -> ReachableSet:
        """Return the set of all share vectors of k levels: 1 >= t_1 >= ... >= t_p >= 0."""
        p = check_levels(k) - 1
        facets = np.concatenate([np.eye(p), np.zeros((1, p))]) - np.concatenate(
            [np.zeros((1, p)), np.eye(p)]
        )
        return ReachableSet.of(np.tri(k, p, -1), facets, np.eye(k)[0])

    @staticmethod
    def box(low: ArrayLike, high: ArrayLike) -> ReachableSet:
        """Return the set of all vectors of m objectives from ``low`` to ``high``.

        It is for ``elicit.objectives``.

        Parameters
        ----------
        low, high : (m,)

        Returns
        -------
        ReachableSet

        Raises
        ------
        ValueError
            If these are not valid bounds.
        """
        least, most = (
            np.atleast_1d(np.asarray(low, np.float64)),
            np.atleast_1d(np.asarray(high, np.float64)),
        )
        alike = least.ndim == 1 and least.shape == most.shape
        fits = alike and bool((np.isfinite(most - least) & (least < most)).all())
        require(fits, "low and high", "numbers (m,), each low below its high", (low, high))
        m = len(least)
        require(
            m <= 14,
            "the number of objectives",
            "at most 14, for a box of m objectives has 2^m corners",
            m,
        )
        ends = np.stack(np.meshgrid(*[[0, 1]] * m, indexing="ij"), axis=-1).reshape(-1, m)
        facets = np.concatenate([np.eye(m), -np.eye(m)])
        return ReachableSet.of(np.where(ends, most, least), facets, np.concatenate([most, -least]))

    @property
    def vectors(self) -> Floats:
        """The vertices (c, k) as vectors of total 1, rather than as tail sums."""
        t = self.corners
        return np.concatenate([1.0 - t[:, :1], t[:, :-1] - t[:, 1:], t[:, -1:]], axis=1)

    def excess(self, t: Floats) -> float:
        """Return by how much tail sums t (p,) violate the worst inequality; negative inside."""
        return float((product(self.facets, t) - self.limits).max())

    def greatest(self, gaps: Floats) -> Floats:
        """Return the greatest t.g (m,) over the set, for each of m scales with gaps (p, m)."""
        return np.asarray(product(self.corners, gaps).max(axis=0))

    def cut_by(self, cuts: Sequence[tuple[Floats, float]]) -> ReachableSet:
        """Return the part of the set with t.g <= limit for each cut, a pair of gaps (p,) and limit.

        If the vertices would be too many, the earlier cuts are left out rather than the later ones.
        Each cut is from a training, and the later trainings are at scales that fit more answers.
        """
        reach = self
        for gaps, limit in cuts:
            reach = reach.cut(gaps, limit)
        if reach.full:
            reach = self
            for gaps, limit in reversed(cuts):
                reach = reach.cut(gaps, limit)
        return reach

    def cut(self, gaps: Floats, limit: float) -> ReachableSet:
        """Return the part of the set with t.g <= limit, for a scale with these gaps.

        Vertices outside are replaced by the points where edges cross the limit.
        """
        beyond = product(self.corners, gaps) - limit
        outside, inside = np.flatnonzero(beyond > _ON), np.flatnonzero(beyond < -_ON)
        if not len(outside) or len(outside) == len(beyond):
            return self
        # the ends of an edge are on p - 1 common facets; other such pairs only add points of the
        # set
        common = self.tight[inside].astype(np.float32) @ self.tight[outside].T.astype(np.float32)
        i, o = np.nonzero(common >= self.facets.shape[1] - 1)
        i, o = inside[i], outside[o]
        share = (beyond[o] / (beyond[o] - beyond[i]))[:, None]
        met = share * self.corners[i] + (1.0 - share) * self.corners[o]
        corners = np.concatenate([self.corners[beyond <= _ON], met])
        corners = corners[np.unique(np.round(corners, _SAME), axis=0, return_index=True)[1]]
        if len(corners) > MOST_CORNERS:
            return replace(self, full=True)
        return replace(
            ReachableSet.of(
                corners, np.concatenate([self.facets, gaps[None, :]]), np.append(self.limits, limit)
            ),
            full=self.full,
        )


def as_shares(shares: ArrayLike, k: int) -> tuple[Floats, float]:
    """Return shares (k,) scaled to a total of 1, and the share that was missing to 1.

    The missing share is taken to be spread over the levels as the rest is.

    Parameters
    ----------
    shares : (k,)
    k : int

    Returns
    -------
    shares : (k,)
    missing : float

    Raises
    ------
    ValueError
        If the total is above 1 or not above 0, or there are not k finite numbers.
    """
    given = as_vectors(shares, k, name="shares")
    require(len(given) == 1, "shares", f"one vector of {k} shares", shares)
    total = float(given.sum())
    require(
        0 < total <= 1 + 1e-6, "shares", "of a total of 1, or less where runs were cut off", shares
    )
    return given[0] / total, 1.0 - total if total < 1.0 - _ON else 0.0
