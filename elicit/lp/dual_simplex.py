"""A small dual simplex method over K_t, in floats and in exact integers.

It starts at the vertex that is best if only the order of the levels is known, and adds the most
violated row until none is violated (Lemke 1954). The method in floats only proposes: a caller must
prove its result. The exact method starts from the basis that floats propose. It pivots in integers
over one common denominator (Edmonds 1967), in a fiftieth of the CPU time of the same steps in
fractions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit.lp.region import Region
from elicit.lp.rounding import rounding
from elicit.model.scale import Floats

Numbers = NDArray[Any]  # float64, or object holding ints or Fractions
_TOLERANCE = 1e-12
_NUDGE = 1e-12  # how far floats follow the tie-break, relative to the largest entry of t


class End(Enum):
    """The way in which a run of the simplex method ended."""

    OPTIMAL = "a vertex that no constraint and no multiplier contradicts"
    EMPTY = "no point satisfies the rows in `support`"
    GAVE_UP = "too many steps in floating point: only the exact method can tell"


@dataclass(frozen=True, eq=False)
class Vertex:
    """The least t.g over a region, and the vertex where it is reached.

    Attributes
    ----------
    end : End
    value : number
        The least t.g.
    g : (p,)
        A minimiser.
    y : (m,)
        Multipliers >= 0 of the rows.
    basis : tuple of int
        The active constraints: j < p stands for g_j >= margin, and p + i for row i.
    support : tuple of int
        If the region is empty, rows that together contradict the order of the levels.
    """

    end: End
    value: Any
    g: Numbers
    y: Numbers
    basis: tuple[int, ...]
    support: tuple[int, ...] = ()


def minimise(t: Floats, region: Region) -> Vertex:
    """Return a vertex of the region with the least t.g, computed in floats.

    The value has rounding errors, and the vertex may be wrong: the caller must prove it. If none
    was found, ``end`` says so.
    """
    p, m = region.p, len(region.rows)
    constraints, limits = region.constraints
    scale = np.maximum(np.abs(constraints).max(axis=1), 2.0**-1000)
    with np.errstate(all="ignore"):
        goal = t + _NUDGE * np.abs(t).max() * _tie_break(p) if t.any() else _tie_break(p)
        active, inverse = _order_vertex(int(np.argmin(goal)), p, 1.0)
        for _ in range(50 + 10 * p):
            g = product(inverse, np.concatenate([[1.0], limits[active]]))
            relative = (product(constraints, g) - limits) / scale
            entering = int(np.argmin(relative))
            if not relative[entering] < -_TOLERANCE:
                weights = np.zeros(p + m)
                weights[active] = product(t, inverse)[1:]
                return Vertex(End.OPTIMAL, product(t, g), g, weights[p:], tuple(active))
            w, y = product(constraints[entering], inverse), product(goal, inverse)
            tolerance = _TOLERANCE * scale[entering]
            ratios = [
                (max(y[i + 1], 0.0) / w[i + 1], c, i)
                for i, c in enumerate(active)
                if w[i + 1] > tolerance
            ]
            if not ratios:
                return Vertex(End.EMPTY, 0.0, g, np.zeros(m), tuple(active))
            leaving = min(ratios)[2]
            pivot = inverse[:, leaving + 1] / w[leaving + 1]
            inverse = inverse - np.outer(pivot, w)
            inverse[:, leaving + 1] = pivot
            active[leaving] = entering
    return Vertex(End.GAVE_UP, 0.0, np.zeros(p), np.zeros(m), tuple(active))


def minimise_exactly(t: Floats, region: Region) -> Vertex:
    """Return the least t.g over the region in rationals (Fractions).

    The method starts from the basis that floats propose. An empty region gives End.EMPTY, and
    ``support`` holds the proof.
    """
    p, m = region.p, len(region.rows)
    goal, unit = _integers(t)
    goals = np.stack([goal, _integers(_tie_break(p))[0]])
    vertex = _IntegerVertex.at(region, minimise(t, region).basis)
    if vertex is None or any((y, z) < (0, 0) for y, z in (goals @ vertex.inverse)[:, 1:].T):
        vertex = _IntegerVertex(region, min(range(p), key=lambda j: tuple(goals[:, j])))
    weights = np.full(m, Fraction(0))
    for step in count():
        by_index = step > 50 + 10 * p
        entering = vertex.violated(by_index)
        if entering is None:
            break
        w, prices = (
            vertex.row(entering)[0] @ vertex.inverse,
            goals[: 1 if by_index else 2] @ vertex.inverse,
        )
        active = vertex.active
        keys = {
            i: [*(prices[:, i + 1] * Fraction(1, w[i + 1])), c]
            for i, c in enumerate(active)
            if w[i + 1] > 0
        }
        if not keys:  # row = sum of w_i * active_i with w_i <= 0: it can nowhere reach its limit
            blamed = [c for i, c in enumerate(active) if w[i + 1] < 0] + [entering]
            support = tuple(sorted(c - p for c in blamed if c >= p))
            return Vertex(
                End.EMPTY, Fraction(0), np.full(p, Fraction(0)), weights, tuple(active), support
            )
        vertex.pivot(entering, min(keys, key=keys.__getitem__))
    for c, weight in zip(vertex.active, (goal @ vertex.inverse)[1:], strict=True):
        if c >= p:
            weights[c - p] = Fraction(weight * vertex.row(c)[2], vertex.denominator * unit)
    numerators, denominator = vertex.point()
    g: Numbers = np.array([Fraction(x, denominator) for x in numerators], dtype=object)
    return Vertex(End.OPTIMAL, goal @ g / unit, g, weights, tuple(vertex.active))


class _IntegerVertex:
    """A vertex, where p - 1 of the constraints are active, in exact integers.

    The inverse of the matrix of active constraints is ``inverse`` / ``denominator``, with integer
    entries and ``denominator`` > 0. Limits are integers over the margin's denominator.
    """

    def __init__(self, region: Region, best: int) -> None:
        self.region = region
        self.active, self.inverse = _order_vertex(best, region.p, 1)
        self.denominator = 1
        self._margin, self._unit = region.exact_margin.as_integer_ratio()
        self._constraints, self._limits = region.constraints
        self._rows: dict[int, tuple[Numbers, int, int]] = {}

    @staticmethod
    def at(region: Region, basis: tuple[int, ...]) -> "_IntegerVertex | None":
        """Return the vertex of these active constraints, or None if they are linearly dependent."""
        p = region.p
        gaps = {c for c in basis if c < p}
        vertex = _IntegerVertex(region, min(set(range(p)) - gaps))
        for c in basis:
            if c >= p:
                w = vertex.row(c)[0] @ vertex.inverse
                free = [
                    i
                    for i, old in enumerate(vertex.active)
                    if old < p and old not in gaps and w[i + 1] != 0
                ]
                if not free:
                    return None
                vertex.pivot(c, free[0])
        return vertex

    def row(self, c: int) -> tuple[Numbers, int, int]:
        """Return constraint c, multiplied so that it is in integers, and the factor.

        These are the coefficients (p,), the limit, and the power of two that multiplied them.
        """
        if c not in self._rows:
            whole, unit = _integers(
                [*self._constraints[c], self._limits[c] if c >= self.region.p else 0.0]
            )
            self._rows[c] = (
                whole[:-1],
                whole[-1] * self._unit if c >= self.region.p else self._margin,
                unit,
            )
        return self._rows[c]

    def pivot(self, entering: int, leaving: int) -> None:
        """Replace the active constraint in place ``leaving`` by the constraint ``entering``.

        Every division is exact.
        """
        w = self.row(entering)[0] @ self.inverse
        column, new = self.inverse[:, leaving + 1].copy(), int(w[leaving + 1])
        self.inverse = (self.inverse * new - np.outer(column, w)) // self.denominator
        self.inverse[:, leaving + 1] = column
        self.denominator = new
        if new < 0:
            self.inverse, self.denominator = -self.inverse, -new
        self.active[leaving] = entering

    def point(self) -> tuple[Numbers, int]:
        """Return the vertex g (p,) as integers over a common denominator."""
        g = self.inverse @ np.array(
            [self._unit, *(self.row(c)[1] for c in self.active)], dtype=object
        )
        return g, self.denominator * self._unit

    def violated(self, by_index: bool) -> int | None:
        """Return a constraint that this vertex violates, or None.

        It is the most violated one, or with ``by_index`` the first one, by which the method cannot
        cycle (Bland 1977). Constraints that floats show to hold are not computed exactly.
        """
        g, unit = self.point()
        most = 10**300 * unit
        point = np.array([min(max(x, -most), most) / unit for x in g])
        with np.errstate(all="ignore"):
            slack = product(self._constraints, point) - self._limits
            magnitude = product(np.abs(self._constraints), np.abs(point)) + np.abs(self._limits)
            doubtful = np.flatnonzero(~(slack > rounding(len(g), magnitude)))
            if not by_index:
                size = np.maximum(
                    np.abs(self._constraints[doubtful]).max(axis=1, initial=0.0), 2.0**-1000
                )
                doubtful = doubtful[np.argsort(slack[doubtful] / size, kind="stable")]
        for c in doubtful:
            row, limit, _ = self.row(int(c))
            if row @ g < limit * self.denominator:
                return int(c)
        return None


def _tie_break(p: int) -> Floats:
    """Return a second objective (p,), which decides where the first one has ties.

    Without it, differences with many equal tail sums stall the method (Charnes 1952).
    """
    return np.asarray((np.arange(1, p + 1) * 40503 % 65536) / 65536.0)


def _order_vertex(best: int, p: int, one: Any) -> tuple[list[int], Numbers]:
    """Return the vertex of K_0, all ordered scales, where only the gap ``best`` is large.

    It is given by its active constraints and by the inverse of their matrix, in the type of
    ``one``. The matrix has the row sum g = 1, then g_j = margin for each other j.
    """
    active = [j for j in range(p) if j != best]
    inverse: Numbers = np.full(
        (p, p), 0 * one, dtype=object if isinstance(one, int) else np.float64
    )
    inverse[best, 0] = one
    for i, j in enumerate(active):
        inverse[j, i + 1], inverse[best, i + 1] = one, -one
    return active, inverse


def _integers(numbers: Floats | Sequence[float]) -> tuple[Numbers, int]:
    """Return finite floats as integers over a common power of two."""
    ratios = [float(x).as_integer_ratio() for x in numbers]
    unit = max(d for _, d in ratios)
    return np.array([n * (unit // d) for n, d in ratios], dtype=object), unit
