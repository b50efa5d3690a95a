"""What is known of K_t as plain arrays, and the linear algebra of its corners, for code that numba can compile."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import compiled
from elicit.model.scale import Floats

CERTAIN_POINT, CORNER, DOUBTFUL_CORNER = 0, 1, 2
"""What a known corner is good for: its point alone, its point and its basis, its basis alone. A later cut may have
taken the corner itself, by a hair, and left the point beside it: a basis is where to start, no proof of its own."""
USED, SLOT, ROW = 0, 1, 2  # counters: corners in use, the next to be replaced, the row that settled last

EPS = 2.0**-52
TINY = 2.0**-1000
SMALL = 2.0**-500  # a product of two numbers above this cannot underflow
NEARLY = 1e-12  # multipliers this far below zero are set to zero, which keeps the bound valid


class Known(NamedTuple):
    """What is known of K_t = {g >= margin, sum g = 1, rows g >= limits}, as plain arrays; p gaps, m rows.

    The corners' arrays and the counters change as walks find new corners.
    """

    margin: float
    cuts: Floats  # (p, m) the rows, transposed
    limits: Floats  # (m,)
    rows: Floats  # (r, p) rows w with w.g >= 0 on K_t
    lifted: Floats  # (r, p) a little larger: t >= lambda * lifted, in floats, implies t >= lambda * w; else nan
    masks: NDArray[np.uint64]  # (r,) bit j: entry j is not negative (of the first 64)
    inside: Floats  # (p,) a point strictly inside K_t; not a number where none is known
    room: Floats  # (p + m,) its distances to the constraints
    points: Floats  # (p, q) the corners' points
    inverses: Floats  # (q, p, p) of [1; active constraints]
    active: NDArray[np.int64]  # (q, p - 1) j < p: g_j >= margin; p + i: row i
    kind: NDArray[np.int8]  # (q,)
    age: NDArray[np.int64]  # (q,) pivots since the inverse was computed afresh
    counts: NDArray[np.int64]  # (3,)


@compiled
def corner_of(inverse: Any, active: Any, known: Known, g: Any) -> None:
    """The corner g (p,) where the active constraints hold with equality."""
    p = len(g)
    for j in range(p):
        g[j] = inverse[j, 0]
    for i in range(p - 1):
        limit = known.margin if active[i] < p else known.limits[active[i] - p]
        if limit != 0.0:
            for j in range(p):
                g[j] += inverse[j, i + 1] * limit


@compiled
def slacks_of(g: Any, known: Known, slack: Any) -> None:
    """By how much g exceeds each constraint's limit (p + m,)."""
    p, m = len(g), len(known.limits)
    for j in range(p):
        slack[j] = g[j] - known.margin
    for i in range(m):
        slack[p + i] = -known.limits[i]
    for j in range(p):
        for i in range(m):
            slack[p + i] += known.cuts[j, i] * g[j]


@compiled
def rates_of(inverse: Any, column: int, known: Known, rate: Any) -> None:
    """How fast each slack (p + m,) grows along an edge, a column of the inverse."""
    p, m = inverse.shape[0], len(known.limits)
    for j in range(p):
        rate[j] = inverse[j, column]
    for i in range(m):
        rate[p + i] = 0.0
    for j in range(p):
        step = inverse[j, column]
        for i in range(m):
            rate[p + i] += known.cuts[j, i] * step


@compiled
def multipliers(s: Any, inverses: Any, q: int, y: Any) -> int:
    """The multipliers y (p,) of the objective s at corner q: that of sum g = 1, then the active constraints'.
    Returns the place among these of the negative one whose edge is steepest, -1 where none is, within rounding."""
    p = len(s)
    for i in range(p):
        y[i] = 0.0
    for j in range(p):
        for i in range(p):
            y[i] += s[j] * inverses[q, j, i]
    worst, steepest = -1, 0.0
    for i in range(p - 1):
        if y[i + 1] < -NEARLY:
            size = 0.0
            for j in range(p):
                size += inverses[q, j, i + 1] * inverses[q, j, i + 1]
            slope = y[i + 1] * y[i + 1] / size
            if worst < 0 or slope > steepest:
                worst, steepest = i, slope
    return worst


@compiled
def blocking(slack: Any, rate: Any, is_active: Any) -> int:
    """The constraint that ends an edge: among those met first, within rounding, the one it meets most steeply;
    -1 where none is met."""
    reach = math.inf
    for c in range(len(slack)):
        if not is_active[c] and rate[c] < -1e-11:
            reach = min(reach, (max(slack[c], 0.0) + 1e-13) / -rate[c])
    best = -1
    for c in range(len(slack)):
        met = not is_active[c] and rate[c] < -1e-11 and max(slack[c], 0.0) <= reach * -rate[c]
        if met and (best < 0 or rate[c] < rate[best]):
            best = c
    return best


@compiled
def pivot(inverse: Any, column: int, entering: int, known: Known) -> None:
    """Exchange the constraint of a column of the inverse for another."""
    p = inverse.shape[0]
    w = np.zeros(p)
    if entering < p:
        for i in range(p):
            w[i] = inverse[entering, i]
    else:
        for j in range(p):
            for i in range(p):
                w[i] += known.cuts[j, entering - p] * inverse[j, i]
    for j in range(p):
        share = inverse[j, column] / w[column]
        for i in range(p):
            inverse[j, i] -= share * w[i]
        inverse[j, column] = share


@compiled
def inverse_of(active: Any, known: Known, inverse: Any) -> bool:
    """The inverse (p, p) of [1; active constraints] afresh (Gauss and Jordan, with row exchanges); False where
    they are linearly dependent, as far as floats can tell."""
    p = inverse.shape[0]
    matrix = np.zeros((p, p))
    for j in range(p):
        matrix[0, j] = 1.0
    for i in range(p - 1):
        if active[i] < p:
            matrix[i + 1, active[i]] = 1.0
        else:
            for j in range(p):
                matrix[i + 1, j] = known.cuts[j, active[i] - p]
    inverse[:] = 0.0
    for j in range(p):
        inverse[j, j] = 1.0
    for c in range(p):
        best = c
        for r in range(c + 1, p):
            if abs(matrix[r, c]) > abs(matrix[best, c]):
                best = r
        if not abs(matrix[best, c]) > 1e-13:
            return False
        for j in range(p):
            matrix[c, j], matrix[best, j] = matrix[best, j], matrix[c, j]
            inverse[c, j], inverse[best, j] = inverse[best, j], inverse[c, j]
        factor = matrix[c, c]
        for j in range(p):
            matrix[c, j] /= factor
            inverse[c, j] /= factor
        for r in range(p):
            factor = matrix[r, c]
            if r != c and factor != 0.0:
                for j in range(p):
                    matrix[r, j] -= factor * matrix[c, j]
                    inverse[r, j] -= factor * inverse[c, j]
    return True


@compiled
def largest(t: Any) -> float:
    """The size of the largest entry."""
    size = 0.0
    for j in range(len(t)):
        size = max(size, abs(t[j]))
    return size


@compiled
def doubt_at(p: int, size: float) -> float:
    """More than the rounding error of t.g at a known point, where no entry of t exceeds ``size``."""
    return (p + 8) * EPS * 4.0 * size + TINY


@compiled
def doubt_of(limit: float, p: int) -> float:
    """More than the rounding error of a row's slack at a point whose components total 1 to within 1e-12."""
    return 4.0 * ((p + 8) * EPS * (1.0 + abs(limit)) + TINY) + 1e-11 * abs(limit)
