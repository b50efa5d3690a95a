"""The primal simplex method over K_t in floats, with results that are proven.

It walks from vertex to vertex, and updates the inverse of the active constraints at each pivot.
Rounding cannot make a result wrong. A point counts only if it is inside K_t by more than any
rounding. Multipliers count only by a bound that holds for any multipliers.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import compiled
from elicit.lp.rounding import EPS, bound_of, pulled_inside, score_doubt, slacks_of
from elicit.model.difference_kernel import largest
from elicit.model.scale import Floats

CERTAIN_POINT, VERTEX, DOUBTFUL_VERTEX = 0, 1, 2
"""The three uses of a known vertex: its point alone, its point and its basis, or its basis alone. A
later cut may have removed the vertex itself, and left the point beside it. So a basis is a place to
start from, and proves nothing."""
# counters: vertices in use, the next to be replaced, the row that decided last, and the number of
# rows of K_t when redundant ones were last removed
USED, SLOT, ROW, PRUNED = range(4)

NEARLY = 1e-12  # multipliers this far below zero are set to zero, which keeps the bound valid


class Known(NamedTuple):
    """Facts about K_t = {g >= margin, sum g = 1, rows g >= limits}, as plain arrays.

    There are p gaps and m rows. The arrays about vertices, and the counters, change as walks find
    new vertices.
    """

    margin: float
    cuts: Floats  # (p, m) the rows, transposed
    limits: Floats  # (m,)
    rows: Floats  # (r, p) rows w with w.g >= 0 on K_t
    # (r, p) a little larger: t >= lambda * lifted, in floats, implies t >= lambda * w; else nan
    lifted: Floats
    masks: NDArray[np.uint64]  # (r,) bit j: entry j is not negative (of the first 64)
    inside: Floats  # (p,) a point strictly inside K_t; nan if none is known
    room: Floats  # (p + m,) its distances to the constraints
    points: Floats  # (p, q) the vertices' points
    inverses: Floats  # (q, p, p) of [1; active constraints]
    active: NDArray[np.int64]  # (q, p - 1) j < p: g_j >= margin; p + i: row i
    kind: NDArray[np.int8]  # (q,)
    age: NDArray[np.int64]  # (q,) pivots since the inverse was computed afresh
    counts: NDArray[np.int64]  # (4,)


def nothing_known(margin: float, rows: Floats, limits: Floats, vertices: int) -> Known:
    """Return the arrays of facts about K_t before any vertex is known.

    K_t is given by rows (m, p) and limits (m,). There is room for ``vertices`` vertices.
    """
    p = rows.shape[1]
    return Known(
        margin=margin,
        cuts=np.ascontiguousarray(rows.T),
        limits=limits,
        rows=np.empty((0, p)),
        lifted=np.empty((0, p)),
        masks=np.empty(0, dtype=np.uint64),
        inside=np.full(p, np.nan),
        room=np.full(p + len(rows), np.nan),
        points=np.zeros((p, vertices)),
        inverses=np.zeros((vertices, p, p)),
        active=np.zeros((vertices, max(0, p - 1)), dtype=np.int64),
        kind=np.zeros(vertices, dtype=np.int8),
        age=np.zeros(vertices, dtype=np.int64),
        counts=np.array([0, 0, 0, len(rows)], dtype=np.int64),
    )


@compiled
def walk(s: Any, start: int, known: Known, out: Any, target: float) -> int:
    """Return 1 if s.g > target is proven on K_t, -1 if a point of K_t shows s.g < 0, else 0.

    The walk goes from vertex ``start`` along edges on which s.g falls. Each is the steepest, and
    ends by Harris's ratio test. The vertex where the walk ends is stored.

    If ``out`` (m,) is not empty, it marks rows to be ignored. Then -1 means that some vertex seems
    to have s.g < target. That proves nothing, and no vertex is stored.
    """
    p, m = len(s), len(known.limits)
    inverse, active = (
        known.inverses[start : start + 1].copy(),
        known.active[start : start + 1].copy(),
    )
    is_active = np.zeros(p + m, dtype=np.bool_)
    for i in range(len(out)):
        is_active[p + i] = out[i]  # never met
    for i in range(p - 1):
        is_active[active[0, i]] = True
    y, rest, g = np.empty(p), np.empty(p), np.empty(p)
    slack, rate = np.empty(p + m), np.empty(p + m)
    vertex_of(inverse[0], active[0], known, g)
    slacks_of(g, known.margin, known.cuts, known.limits, slack)
    tried = False
    for step in range(50 + 10 * p):
        value = 0.0
        for j in range(p):
            value += s[j] * g[j]
        leaving = multipliers(s, inverse, 0, y)
        if value < target - 1e-11 and (leaving < 0 or not tried):
            if len(out) > 0:
                return -1
            tried = True
            if keep(s, g, slack, inverse[0], active[0], known.age[start] + step, known):
                return -1
        if leaving < 0:
            for j in range(p):
                rest[j] = s[j]
            proven = bound_of(rest, y, active, 0, known.margin, known.cuts, known.limits) > target
            if proven and len(out) == 0 and step > 0:
                keep(s, g, slack, inverse[0], active[0], known.age[start] + step, known)
            return 1 if proven else 0
        rates_of(inverse[0], leaving + 1, known, rate)
        entering = blocking(slack, rate, is_active)
        if entering < 0:
            return 0
        length = max(slack[entering], 0.0) / -rate[entering]
        for j in range(p):
            g[j] += length * inverse[0, j, leaving + 1]
        for c in range(p + m):
            slack[c] += length * rate[c]
        is_active[active[0, leaving]] = False
        is_active[entering] = True
        active[0, leaving] = entering
        pivot(inverse[0], leaving + 1, entering, known)
    return 0


@compiled
def redundant(known: Known) -> Any:
    """Return flags (m,) of rows of K_t that can be removed, because the others imply them.

    The latest rows are tested first.
    """
    p, m = known.cuts.shape
    out = np.zeros(m, dtype=np.bool_)
    for i in range(m - 1, -1, -1):
        out[i] = True
        row = known.cuts[:, i].copy()
        best, least = -1, math.inf
        for q in range(known.counts[USED]):
            at, usable = 0.0, known.kind[q] != CERTAIN_POINT
            for j in range(p):
                at += row[j] * known.points[j, q]
            for j in range(p - 1):
                usable = usable and (known.active[q, j] < p or not out[known.active[q, j] - p])
            if usable and at < least:
                best, least = q, at
        out[i] = best >= 0 and walk(row, best, known, out, known.limits[i]) > 0
    return out


@compiled
def keep(s: Any, g: Any, slack: Any, inverse: Any, active: Any, age: int, known: Known) -> bool:
    """Store a vertex, and a point near it that is certainly in K_t.

    Return whether that point was found, and s.g < 0 there.
    """
    p = len(g)
    point = np.empty(p)
    certain = pulled_inside(
        g, slack, known.inside, known.room, known.margin, known.cuts, known.limits, point
    )
    if age > 40:
        if not inverse_of(active, known, inverse):
            return False
        age = 0
    q = next_slot(known)
    value = 0.0
    for j in range(p):
        known.points[j, q] = point[j] if certain else g[j]
        value += s[j] * known.points[j, q]
        for i in range(p):
            known.inverses[q, j, i] = inverse[j, i]
    for i in range(len(active)):
        known.active[q, i] = active[i]
    known.kind[q] = VERTEX if certain else DOUBTFUL_VERTEX
    known.age[q] = age
    return certain and value < -score_doubt(p, largest(s))


@compiled
def next_slot(known: Known) -> int:
    """Return the place for the next vertex: that of the oldest if all are taken."""
    q: int = known.counts[SLOT]
    known.kind[q] = (
        DOUBTFUL_VERTEX  # until it is complete, lest an interruption leave a false point
    )
    known.counts[SLOT] = (q + 1) % len(known.kind)
    known.counts[USED] = max(known.counts[USED], q + 1)
    return q


@compiled
def vertex_of(inverse: Any, active: Any, known: Known, g: Any) -> None:
    """Write into g (p,) the vertex where the active constraints hold with equality."""
    p = len(g)
    for j in range(p):
        g[j] = inverse[j, 0]
    for i in range(p - 1):
        limit = known.margin if active[i] < p else known.limits[active[i] - p]
        if limit != 0.0:
            for j in range(p):
                g[j] += inverse[j, i + 1] * limit


@compiled
def rates_of(inverse: Any, column: int, known: Known, rate: Any) -> None:
    """Write into ``rate`` (p + m,) how fast each slack grows along the edge of this column."""
    p, m = inverse.shape[0], len(known.limits)
    for j in range(p):
        rate[j] = inverse[j, column]
    for i in range(m):
        rate[p + i] = 0.0
    for j in range(p):
        step = inverse[j, column]
        if step != 0.0:
            for i in range(m):
                rate[p + i] += known.cuts[j, i] * step


@compiled
def multipliers(s: Any, inverses: Any, q: int, y: Any) -> int:
    """Write the multipliers of the objective s at vertex q into y (p,), and choose an edge.

    The first multiplier is that of sum g = 1. Those of the active constraints follow. Return the
    number of the active constraint with a negative multiplier whose edge is steepest, or -1 if none
    is negative, within rounding.
    """
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
    """Return the constraint that ends an edge, or -1 if the edge meets none.

    If it meets several at once, within rounding, the steepest of them is returned.
    """
    reach = math.inf
    for c in range(len(slack)):
        room, speed = max(slack[c], 0.0) + 1e-13, -rate[c]
        # the product excludes most constraints, so that few need a division
        if room <= reach * speed * (1.0 + 8.0 * EPS) and speed > 1e-11 and not is_active[c]:
            reach = min(reach, room / speed)
    best = -1
    for c in range(len(slack)):
        met = not is_active[c] and rate[c] < -1e-11 and max(slack[c], 0.0) <= reach * -rate[c]
        if met and (best < 0 or rate[c] < rate[best]):
            best = c
    return best


@compiled
def pivot(inverse: Any, column: int, entering: int, known: Known) -> None:
    """Replace the active constraint of a column of the inverse by the constraint ``entering``."""
    w = np.empty(inverse.shape[0])
    row_at(inverse, entering, known, w)
    exchange(inverse, column, w)


@compiled
def row_at(inverse: Any, constraint: int, known: Known, w: Any) -> None:
    """Write into w (p,) how fast a constraint's slack grows along each edge of the vertex."""
    p = inverse.shape[0]
    for i in range(p):
        w[i] = inverse[constraint, i] if constraint < p else 0.0
    if constraint >= p:
        for j in range(p):
            factor = known.cuts[j, constraint - p]
            if factor != 0.0:
                for i in range(p):
                    w[i] += factor * inverse[j, i]


@compiled
def exchange(inverse: Any, column: int, w: Any) -> None:
    """Update the inverse: the new constraint of a column has the rates w (p,) along the edges."""
    p = inverse.shape[0]
    for j in range(p):
        share = inverse[j, column] / w[column]
        if share != 0.0:
            for i in range(p):
                inverse[j, i] -= share * w[i]
        inverse[j, column] = share


@compiled
def inverse_of(active: Any, known: Known, inverse: Any) -> bool:
    """Compute the inverse (p, p) of the matrix [1; active constraints] by Gauss-Jordan elimination.

    Return False if the constraints are linearly dependent, as far as floats can tell.
    """
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
