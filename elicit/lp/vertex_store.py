"""The upkeep of facts about K_t: made from a region, cut by answers, without redundant rows.

All functions work on the arrays of ``primal_simplex.Known``. A cut makes new arrays, so that an
older comparator still decides as before. A compiled loop can make the usual kind of cut by itself
(``cut_at_once``).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import compiled, compiled_beside, compiled_in_parts
from elicit.lp.analytic_centre import analytic_centre
from elicit.lp.dual_simplex import minimise
from elicit.lp.primal_simplex import (
    CERTAIN_POINT,
    DOUBTFUL_VERTEX,
    PRUNED,
    ROW,
    SLOT,
    USED,
    Known,
    inverse_of,
    keep,
    next_slot,
    nothing_known,
    redundant,
    vertex_of,
)
from elicit.lp.region import Region
from elicit.lp.rounding import (
    SMALL,
    rounding_of,
    slacks_of,
    strictly_inside,
    surely_inside,
)
from elicit.lp.sign_proofs import sign_of
from elicit.model.difference_kernel import UNKNOWN
from elicit.model.pairs import NEAR
from elicit.model.scale import Floats

MOST_VERTICES = 128
MOST_NUMBERS = 1_000_000  # in all their inverses: with very many levels, fewer vertices are kept
MOST_ROWS = 16  # rows proven beside the region's own
# Rows of opposite answers are each other's negative, up to NEAR in each entry. So a point that
# satisfies both, and whose entries total 1, satisfies neither by more than this.
UNOPPOSED = 2.0 * NEAR


def start(region: Region) -> Known:
    """Return the facts about a region that are known before any comparison.

    They are the region's rows, and those vertices of K_0, all ordered scales, that lie in the
    region.
    """
    p, rows, limits = region.p, region.rows, region.rhs
    vertices = max(8, min(MOST_VERTICES, MOST_NUMBERS // (p * p)))
    known = _with_rows(nothing_known(region.margin, rows, limits, vertices), rows, limits)
    if not region.margin * p < 1 - 1e-9:  # K_0 is a point, or nearly
        return known
    _recentre_dearly(known, region)
    if p > 1 and not len(region.rows):
        for best in range(min(p, vertices)):
            add_vertex(known, tuple(j for j in range(p) if j != best))
    _find_some_vertex(known, region)
    return known


def _cut_of_arrays(known: Known, row: Floats, limit: float) -> Known:
    """Compute ``cut`` with whole arrays in NumPy."""
    given, limits = len(known.limits), np.array([limit])
    new = _with_rows(known, row[None], limits)
    stays = np.empty(known.counts[USED], dtype=np.bool_)
    beyond_doubt(known, row, limit, stays)
    after = _only_vertices(known, np.flatnonzero(stays))
    after.counts[ROW] = 0
    return after._replace(
        cuts=np.ascontiguousarray(np.concatenate([known.cuts, row[:, None]], axis=1)),
        limits=np.append(known.limits, limits),
        inside=known.inside.copy(),
        room=np.full(len(row) + given + 1, np.nan),
        rows=_inserted(known.rows, given, new.rows),
        lifted=_inserted(known.lifted, given, new.lifted),
        masks=_inserted(known.masks, given, new.masks),
    )


@compiled_beside(_cut_of_arrays)
def cut(known: Known, row: Any, limit: float) -> Known:
    """Return the facts about K_t after a cut: row.g >= limit, for a row (p,).

    All known rows still hold. Vertices stay if the cut certainly keeps them. The inner point is not
    updated: call ``recentre`` or ``refresh``.
    """
    (p, m), r, slots = known.cuts.shape, len(known.masks), len(known.kind)
    new = Known(
        known.margin,
        np.empty((p, m + 1)),
        np.empty(m + 1),
        np.empty((r + 1, p)),
        np.empty((r + 1, p)),
        np.empty(r + 1, np.uint64),
        known.inside.copy(),
        np.full(p + m + 1, np.nan),
        np.zeros((p, slots)),
        np.empty((slots, p, p)),
        np.zeros((slots, p - 1), np.int64),
        np.zeros(slots, np.int8),
        np.zeros(slots, np.int64),
        np.zeros(4, np.int64),
    )
    new.counts[PRUNED] = known.counts[PRUNED]
    for j in range(p):
        for i in range(m):
            new.cuts[j, i] = known.cuts[j, i]
        new.cuts[j, m] = row[j]
    for i in range(m):
        new.limits[i] = known.limits[i]
    new.limits[m] = limit
    for i in range(r):  # the region's own rows come first, and the new one last among them
        at = i if i < m else i + 1
        new.masks[at] = known.masks[i]
        for j in range(p):
            new.rows[at, j], new.lifted[at, j] = known.rows[i, j], known.lifted[i, j]
    know_row(new, m, row, limit)
    stays = np.empty(known.counts[USED], dtype=np.bool_)
    beyond_doubt(known, row, limit, stays)
    n = 0
    for q in range(len(stays)):
        if stays[q]:
            copy_vertex(known, q, new, n)
            n += 1
    new.counts[USED], new.counts[SLOT] = n, n % slots
    return new


@compiled_in_parts
def cut_at_once(known: Known, row: Any) -> tuple[bool, Known]:
    """Return whether compiled code can cut by a row (p,), row.g >= 0, and the facts after the cut.

    If it can, the facts are those that ``PlausibleSet.cut`` would have. If it cannot, they are
    returned unchanged, and Python must make the cut. It cannot if the sign of row.g is decided
    already, if floats find no inner point or no vertex to start walks from, or if the row may be
    the negative of an earlier answer's row.
    """
    if sign_of(row, known) != UNKNOWN:
        return False, known
    after = cut(known, row, 0.0)
    if not (has_point(after) and has_basis(after) and recentre(after, row, 0.0)):
        return False, known
    excess = 0.0
    for j in range(len(row)):
        excess += row[j] * after.inside[j]
    if not excess > UNOPPOSED:
        return False, known
    if has_grown(after):
        after = without_redundant(after)
        if not has_basis(after):
            return False, known
    return True, after


@compiled
def copy_vertex(known: Known, q: int, new: Known, n: int) -> None:
    """Copy the vertex in place q to place n of other facts, ``new``."""
    for j in range(known.inverses.shape[1]):
        new.points[j, n] = known.points[j, q]
        for i in range(known.inverses.shape[2]):
            new.inverses[n, j, i] = known.inverses[q, j, i]
    for i in range(known.active.shape[1]):
        new.active[n, i] = known.active[q, i]
    new.kind[n], new.age[n] = known.kind[q], known.age[q]


def refresh(known: Known, region: Region) -> Known:
    """Give the facts about a non-empty region an inner point and a vertex to start walks from."""
    if not recentre(known, region.rows[-1], region.rhs[-1]):
        _recentre_dearly(known, region)
    _find_some_vertex(known, region)
    return known


@compiled
def beyond_doubt(known: Known, row: Any, limit: float, stays: Any) -> None:
    """Mark the vertices (q,) that a new row cannot cut off: row.g >= limit there, beyond rounding.

    A vertex whose point is doubtful, so that only its basis counts, stays if it does not violate
    the row by more than 1e-9.
    """
    p = len(row)
    for q in range(len(stays)):
        excess, size = -limit, abs(limit)
        for j in range(p):
            excess += row[j] * known.points[j, q]
            size += abs(row[j] * known.points[j, q])
        # the last term: a point's components total 1 only to about 1e-12
        doubt = rounding_of(p, size) + 1e-11 * abs(limit)
        stays[q] = excess > (-1e-9 if known.kind[q] == DOUBTFUL_VERTEX else doubt)


@compiled
def know_rows(known: Known, rows: Any, limits: Any) -> None:
    """Replace the known rows by those that follow from rows.g >= limits, for rows (r, p)."""
    for i in range(len(limits)):
        know_row(known, i, rows[i], limits[i])


@compiled
def know_row(known: Known, place: int, row: Any, limit: float) -> None:
    """Store a row w (p,) with w.g >= 0 on K_t in a place, and a bit mask of its entries >= 0.

    w is the row minus the limit, rounded up: since sum g = 1, w.g >= 0 follows from row.g >= limit.
    A second version, ``lifted``, has entries that are slightly larger in absolute value. If t >=
    lambda * lifted holds in floats, then t >= lambda w holds exactly.
    """
    mask, tiny = np.uint64(0), False
    for j in range(len(row)):
        w = row[j]
        if limit != 0.0:
            w += -limit + rounding_of(2, abs(w) + abs(limit))
        known.rows[place, j] = w
        known.lifted[place, j] = w * (1.0 + 2.0**-48 + (2.0**-50 if w > 0.0 else -(2.0**-50)))
        tiny = tiny or (w != 0.0 and abs(w) < SMALL)
        if j < 64 and w >= 0.0:
            mask |= np.uint64(1) << np.uint64(j)
    known.masks[place] = mask
    if tiny:  # products with such entries underflow and prove nothing
        for j in range(len(row)):
            known.lifted[place, j] = math.nan


@compiled
def recentre(known: Known, row: Any, limit: float) -> bool:
    """Move the inner point to the right side of a new row, and return whether that succeeded.

    The old inner point is first moved across the cut, towards the mean of the known points. The
    point half-way between the two is tried first, then the mean itself. The result is False if
    neither is certainly inside.
    """
    p, n = len(known.inside), 0
    mean = np.zeros(p)
    for q in range(known.counts[USED]):
        if known.kind[q] != DOUBTFUL_VERTEX:
            n += 1
            for j in range(p):
                mean[j] += known.points[j, q]
    if n == 0:
        return False
    share, old = 0.0, known.inside.copy()
    short, gain = limit, -limit
    for j in range(p):
        short -= row[j] * old[j]
        gain += row[j] * mean[j] / n
    if short > 0.0 and short + gain > 0.0:
        share = (short + gain / 2.0) / (short + gain)
    for weight in (0.5 + share / 2.0, 1.0):
        total = 0.0
        for j in range(p):
            known.inside[j] = (
                mean[j] / n if weight == 1.0 else (1.0 - weight) * old[j] + weight * mean[j] / n
            )
            total += known.inside[j]
        for j in range(p):
            known.inside[j] /= total
        if surely_inside(known.inside, known.margin, known.cuts, known.limits, known.room):
            add_point(known, known.inside)
            return True
    return False


@compiled
def add_point(known: Known, g: Any) -> None:
    """Store a point of K_t, each component of which is exact up to its last bits."""
    q = next_slot(known)
    for j in range(len(g)):
        known.points[j, q] = g[j]
    known.kind[q] = CERTAIN_POINT
    known.active[q] = 0


@compiled
def has_point(known: Known) -> bool:
    """Return whether some point is certainly in K_t."""
    points = 0
    for q in range(known.counts[USED]):
        points += known.kind[q] != DOUBTFUL_VERTEX
    return points > 0


@compiled
def has_basis(known: Known) -> bool:
    """Return whether there is a vertex to start walks from."""
    bases = 0
    for q in range(known.counts[USED]):
        bases += known.kind[q] != CERTAIN_POINT
    return bases > 0


@compiled
def has_grown(known: Known) -> bool:
    """Return whether K_t has so many new rows that redundant ones are to be removed again."""
    return len(known.limits) > int(known.counts[PRUNED] * 1.3 + 2)


def prune(known: Known, region: Region) -> tuple[Known, Region]:
    """Remove redundant rows. Return the facts about the same set, and its region with fewer rows.

    If no vertex to start walks from is left, a new one is looked for.
    """
    known = without_redundant(known)
    region = rows_left(region, known)
    _find_some_vertex(known, region)
    return known, region


def rows_left(region: Region, known: Known) -> Region:
    """Return the region with only those of its rows that are still known, in the same order."""
    every, left = (
        zip(map(np.ndarray.tobytes, rows), limits.tolist(), strict=True)
        for rows, limits in ((region.rows, region.rhs), (known.cuts.T, known.limits))
    )
    numbered = enumerate(every)
    return region.take(np.array([next(i for i, b in numbered if b == a) for a in left], np.intp))


@compiled
def without_redundant(known: Known) -> Known:
    """Return the facts about the same set, without the rows that follow from the others.

    The removed rows still serve in proofs, since they hold on K_t. Vertices that depend on them
    lose their basis. The arrays of vertices are shared with ``known`` and changed, so ``known``
    must not be used afterwards.
    """
    (p, m), r, out = known.cuts.shape, len(known.masks), redundant(known)
    n, place = 0, np.empty(m, np.int64)  # the number of rows that stay, and their new places
    for i in range(m):
        place[i] = n
        n += not out[i]
    known.counts[PRUNED] = n
    if n == m:
        return known
    order, dropped = np.empty(r, np.int64), r - (m - n)  # rows that stay, others known, dropped
    for i in range(r):
        if i >= m:
            order[n + i - m] = i
        elif out[i]:
            order[dropped] = i
            dropped += 1
        else:
            order[place[i]] = i
    forgotten = max(0, r - n - MOST_ROWS)
    new = Known(
        known.margin,
        np.empty((p, n)),
        np.empty(n),
        np.empty((r - forgotten, p)),
        np.empty((r - forgotten, p)),
        np.empty(r - forgotten, np.uint64),
        known.inside,
        np.empty(p + n),
        known.points,
        known.inverses,
        known.active,
        known.kind,
        known.age,
        known.counts,
    )
    for i in range(r - forgotten):
        row = order[i if i < n else i + forgotten]
        new.masks[i] = known.masks[row]
        for j in range(p):
            new.rows[i, j], new.lifted[i, j] = known.rows[row, j], known.lifted[row, j]
    for j in range(p):
        new.room[j] = known.room[j]
        for i in range(n):
            new.cuts[j, i] = known.cuts[j, order[i]]
    for i in range(n):
        new.limits[i], new.room[p + i] = known.limits[order[i]], known.room[p + order[i]]
    kept = 0
    for q in range(known.counts[USED]):
        based = True
        for i in range(p - 1):
            active = known.active[q, i]
            based = based and (active < p or not out[active - p])
        if based or known.kind[q] != DOUBTFUL_VERTEX:
            if kept != q:
                copy_vertex(known, q, new, kept)
            for i in range(p - 1):
                active = known.active[q, i]
                renumbered = active if active < p else p + place[active - p]
                new.active[kept, i] = renumbered if based else 0
            if not based:
                new.kind[kept] = CERTAIN_POINT
            kept += 1
    new.counts[USED], new.counts[SLOT] = kept, kept % len(known.kind)
    return new


def add_row(known: Known, row: Floats) -> Known:
    """Return the facts with one more known row: row.g >= 0 on K_t."""
    return _with_latest_rows(known, np.concatenate([known.rows, row[None, :]]))


def add_vertex(known: Known, basis: tuple[int, ...]) -> None:
    """Store the vertex with these active constraints, if floats can invert their matrix."""
    p = len(known.inside)
    active, inverse = np.array(basis, dtype=np.int64), np.zeros((p, p))
    g, slack = np.zeros(p), np.zeros(len(known.room))
    if p > 1 and inverse_of(active, known, inverse):
        vertex_of(inverse, active, known, g)
        slacks_of(g, known.margin, known.cuts, known.limits, slack)
        keep(np.zeros(p), g, slack, inverse, active, 0, known)


def _with_rows(known: Known, rows: Floats, limits: Floats) -> Known:
    """Return a copy whose known rows follow from rows.g >= limits, for rows (r, p)."""
    known = known._replace(
        rows=np.empty(rows.shape), lifted=np.empty(rows.shape), masks=np.empty(len(rows), np.uint64)
    )
    know_rows(known, np.ascontiguousarray(rows), limits)
    return known


def _inserted(array: NDArray[Any], at: int, part: NDArray[Any]) -> NDArray[Any]:
    """Return the array with further rows inserted from place ``at`` on."""
    return np.concatenate([array[:at], part, array[at:]])


def _with_latest_rows(known: Known, rows: Floats) -> Known:
    """Return a copy with these known rows (r, p); if there are too many, the oldest are dropped.

    The region's own rows come first and all stay.
    """
    given = len(known.limits)
    rows = np.concatenate([rows[:given], rows[given:][-MOST_ROWS:]])
    return _with_rows(known, rows, np.zeros(len(rows)))


def _only_vertices(known: Known, stay: NDArray[np.intp]) -> Known:
    """Return a copy with only the vertices in these places."""
    n = len(stay)
    points, inverses = np.zeros_like(known.points), np.empty_like(known.inverses)
    active, kind, age = (
        np.zeros_like(known.active),
        np.zeros_like(known.kind),
        np.zeros_like(known.age),
    )
    points[:, :n], active[:n] = known.points[:, stay], known.active[stay]
    np.take(
        known.inverses, stay, axis=0, out=inverses[:n], mode="clip"
    )  # mode "raise" would copy them twice
    kind[:n], age[:n] = known.kind[stay], known.age[stay]
    counts = known.counts.copy()
    counts[USED], counts[SLOT] = n, n % len(kind)
    return known._replace(
        points=points, inverses=inverses, active=active, kind=kind, age=age, counts=counts
    )


def _recentre_dearly(known: Known, region: Region) -> None:
    """Set the inner point to the analytic centre; clear it if that is not strictly interior."""
    centre = analytic_centre(region)
    known.inside[:] = centre if strictly_inside(centre, region) else np.nan
    if not np.isnan(known.inside[0]):
        slacks_of(known.inside, known.margin, known.cuts, known.limits, known.room)
        add_point(known, centre)


def _find_some_vertex(known: Known, region: Region) -> None:
    """Store a vertex to start walks from, if there is none yet and floats find one."""
    if region.p > 1 and not has_basis(known):
        add_vertex(known, minimise(np.zeros(region.p), region).basis)
