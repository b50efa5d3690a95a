"""What is already proven about K_t, kept to settle later comparisons without a linear program.

Points of K_t show on which side of zero some d.e lies; rows w with w.g >= 0 on all of K_t show that
t.g >= 0 wherever t >= lambda w for some lambda >= 0 (dominance after adding one known answer); and the
active rows of an optimal vertex prove a bound for every t whose multipliers there are non-negative.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit.query import Verdict
from elicit.scale import Floats, order_bounds
from elicit.simplex import Region, rounding
from elicit.vertices import MOST as _MOST_VERTICES
from elicit.vertices import Vertices

_MOST_POINTS = 64
_SMALL = 2.0**-500  # a product of two numbers above this cannot underflow
_MOST_ROWS = 64  # rows proven in rationals; the rows of the region always stay
_CHUNK = 1 << 20  # numbers in a working array


_UNKNOWN, _UNSETTLED = np.int8(Verdict.UNKNOWN), np.int8(3)


class Sides(NamedTuple):
    """Whether a known point has t.g certainly > 0, and one certainly < 0; (n,) each."""

    above: NDArray[np.bool_]
    below: NDArray[np.bool_]


class Proofs:
    """Points (n, p) of K_t and rows (m, p) that are non-negative on it. Grows as programs are solved."""

    UNSETTLED: ClassVar[int] = int(_UNSETTLED)
    """Beside the codes of Verdict: these proofs cannot tell."""

    def __init__(self, margin: float, points: Floats, rows: Floats, given: int, vertices: Vertices) -> None:
        self.margin = margin
        self.points = points
        self.rows = rows
        self.given = given  # the first rows are the region's own
        self.vertices = vertices
        self._not_negative, self._lifted = _screen_of(rows)

    @staticmethod
    def start(region: Region) -> Proofs:
        """What is known before any program is solved: the region's rows, and K_0's centre where it is K_t."""
        p = region.p
        points = np.full((1, p), 1.0 / p) if not len(region.rows) and region.margin * p < 1 - 1e-9 else np.empty((0, p))
        return Proofs(
            region.margin, points, _homogeneous(region.rows, region.rhs), len(region.rows), Vertices(p, region.margin)
        )

    def cut(self, rows: Floats, rhs: Floats) -> Proofs:
        """The same proofs after the region was cut: every row still holds, and the points that certainly do."""
        keep = np.ones(len(self.points), dtype=bool)
        with np.errstate(all="ignore"):
            for row, limit in zip(rows, rhs, strict=True):
                # the last term: a point's components total 1 only to about 1e-12
                doubt = rounding(len(row), np.abs(row) @ self.points.T + abs(limit)) + 1e-11 * abs(limit)
                keep &= row @ self.points.T - limit > doubt
        known = [self.rows[: self.given], _homogeneous(rows, rhs), self.rows[self.given :]]
        return Proofs(
            self.margin, self.points[keep], np.concatenate(known), self.given + len(rows), self.vertices.copy()
        )

    def add_point(self, g: Floats) -> None:
        """Keep a point of K_t (each component right to its last bits)."""
        self.points = np.concatenate([self.points[-_MOST_POINTS + 1 :], g[None, :]])

    def add_row(self, row: Floats) -> None:
        """Keep a row (p,) with row.g >= 0 on K_t."""
        derived = np.concatenate([self.rows[self.given :][-_MOST_ROWS + 1 :], row[None, :]])
        self.rows = np.concatenate([self.rows[: self.given], derived])
        self._not_negative, self._lifted = _screen_of(self.rows)

    def sides(self, t: Floats) -> Sides:
        """On which sides of zero known points prove t.g to lie, for t (n, p)."""
        if not len(self.points):
            return Sides(np.zeros(len(t), dtype=bool), np.zeros(len(t), dtype=bool))
        at = t @ self.points.T
        doubt = rounding(t.shape[1], 2.0 * np.abs(t).max(initial=0.0))  # a point's components total 1
        return Sides(at.max(axis=1) > doubt, at.min(axis=1) < -doubt)

    def screen(self, t: Floats) -> NDArray[np.int8]:
        """Verdicts, or UNSETTLED, for t (n, p) of order 1, none of them of one sign throughout."""
        above, below = self.sides(t)
        # BETTER = 1 needs a point above and none known below, WORSE = -1 the reverse
        sign = above.view(np.int8) - below.view(np.int8)
        out = np.where(above & below, _UNKNOWN, _UNSETTLED)
        one_sided = sign.nonzero()[0]
        if len(one_sided):
            facing = sign[one_sided]
            proven = self._non_negative(t[one_sided] * facing[:, None])
            out[one_sided[proven]] = facing[proven]
        left = (out == _UNSETTLED).nonzero()[0]
        if len(left):
            least, greatest = order_bounds(t[left], self.margin)
            doubt = rounding(t.shape[1], 4.0 * np.abs(t[left]).max(axis=1))
            out[left[least > doubt]] = Verdict.BETTER
            out[left[greatest < -doubt]] = Verdict.WORSE
        return out

    def _non_negative(self, t: Floats) -> NDArray[np.bool_]:
        """Marks rows t (n, p) with t >= lambda w for a known row w and some lambda >= 0, and rows that a
        known vertex proves."""
        out = np.zeros(len(t), dtype=bool)
        step = max(1, _CHUNK // ((len(self.rows) + _MOST_VERTICES) * t.shape[1]))
        for first in range(0, len(t), step):
            part = slice(first, first + step)
            out[part] = self._dominates_some(t[part])
            left = (~out[part]).nonzero()[0]
            if len(left):
                out[first + left] = self.vertices.prove(t[first + left])
        return out

    def _dominates_some(self, t: Floats) -> NDArray[np.bool_]:
        """Marks t (n, p) with t >= lambda w, rounding included, for a row w and the least lambda that lifts
        the negative entries of t."""
        negative = t < 0
        out = np.zeros(len(t), dtype=bool)
        # w can only help where it is negative wherever t is: count the places where it is not
        i, j = (negative.astype(np.float32) @ self._not_negative == 0).nonzero()
        if len(i):
            t, w = t[i], self.rows[j]
            with np.errstate(all="ignore"):
                least = np.divide(t, w, out=np.zeros_like(t), where=negative[i]).max(axis=1)
                share = least[:, None] * self._lifted[j]
            # lambda = 1 needs no multiplication, hence no rounding: it settles an answered pair met again
            share = np.where((least == 1.0)[:, None], w, share)
            proven = (t >= share).all(axis=1) & (least > _SMALL)
            out[i[proven]] = True
        return out


def _homogeneous(rows: Floats, rhs: Floats) -> Floats:
    """Rows w with w.g >= 0 from rows.g >= rhs and sum g = 1, rounded up where rounding is needed."""
    moved = rows - rhs[:, None] + rounding(2, np.abs(rows) + np.abs(rhs)[:, None])
    return np.asarray(np.where((rhs == 0)[:, None], rows, moved))


def _screen_of(rows: Floats) -> tuple[NDArray[np.float32], Floats]:
    """What ``_dominates_some`` needs of rows (m, p). First, 1 where an entry is not negative (p, m), as floats
    for a fast product of small whole numbers; rows with nonzero entries so small that products with them
    could underflow count as positive throughout. Then the rows (m, p), a little larger where negative and
    larger still where positive, so that t >= lambda times that implies t >= lambda (1 + 2^-48) row."""
    tiny = ((rows != 0) & (np.abs(rows) < _SMALL)).any(axis=1)
    not_negative = np.ascontiguousarray(((rows >= 0) | tiny[:, None]).T, dtype=np.float32)
    return not_negative, rows * np.where(rows > 0, 1.0 + 2.0**-48 + 2.0**-50, 1.0 + 2.0**-48 - 2.0**-50)
