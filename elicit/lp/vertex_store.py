"""The upkeep of what is known of K_t: made from a region, cut by answers, pruned of what follows from the rest.

Everything here works on the arrays of ``corner.Known``; a cut makes new ones, so that an older comparator still
answers as before.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import compiled
from elicit.lp.analytic_centre import analytic_centre
from elicit.lp.dual_simplex import minimise
from elicit.lp.primal_simplex import keep, next_slot, redundant, surely_inside
from elicit.lp.region import Region, strictly_inside
from elicit.lp.vertices import (
    CERTAIN_POINT,
    DOUBTFUL_CORNER,
    EPS,
    SLOT,
    SMALL,
    TINY,
    USED,
    Known,
    corner_of,
    inverse_of,
    slacks_of,
)
from elicit.model.scale import Floats

MOST_CORNERS = 128
MOST_NUMBERS = 1_000_000  # in all their inverses: with very many levels, fewer corners are kept
MOST_ROWS = 16  # rows proven beside the region's own


def start(region: Region) -> Known:
    """What is known before any comparison: the region's rows, and the corners of K_0 that lie in it."""
    p, m = region.p, len(region.rows)
    corners = max(8, min(MOST_CORNERS, MOST_NUMBERS // max(p * p, 1)))
    known = _of_region(region)._replace(
        rows=np.empty((m, p)),
        lifted=np.empty((m, p)),
        masks=np.empty(m, dtype=np.uint64),
        points=np.zeros((p, corners)),
        inverses=np.zeros((corners, p, p)),
        active=np.zeros((corners, max(p - 1, 0)), dtype=np.int64),
        kind=np.zeros(corners, dtype=np.int8),
        age=np.zeros(corners, dtype=np.int64),
    )
    for i in range(m):
        know_row(known, i, region.rows[i], region.rhs[i])
    if not region.margin * p < 1 - 1e-9:  # K_0 is a point, or nearly
        return known
    _recentre_dearly(known, region)
    if p > 1 and not m:
        for best in range(min(p, corners)):
            add_corner(known, tuple(j for j in range(p) if j != best))
    _find_some_corner(known, region)
    return known


def cut(known: Known, region: Region, new: int) -> Known:
    """The same for a region whose last ``new`` rows were not among its rows before: all rows that held still
    hold, and the corners that no new row may cut off stay. Its inner point is still the old one: ``refresh``."""
    size, used = len(known.rows) + new, len(known.kind)
    after = _of_region(region)._replace(
        rows=np.empty((size, region.p)),
        lifted=np.empty((size, region.p)),
        masks=np.empty(size, dtype=np.uint64),
        inside=known.inside.copy(),
        points=np.zeros((region.p, used)),
        inverses=np.empty((used, region.p, region.p)),
        active=np.zeros((used, region.p - 1), dtype=np.int64),
        kind=np.zeros(used, dtype=np.int8),
        age=np.zeros(used, dtype=np.int64),
    )
    hand_on(known, after, region.rows[-new:], region.rhs[-new:])
    return after


def refresh(known: Known, region: Region, new: int) -> Known:
    """With a point strictly inside and a corner to start from, for a region that is not empty."""
    if not recentre(known, region.rows[-new:], region.rhs[-new:]):
        _recentre_dearly(known, region)
    _find_some_corner(known, region)
    return known


@compiled
def hand_on(old: Known, new: Known, rows: Any, limits: Any) -> None:
    """Fill ``new`` with what still holds of ``old`` once ``rows`` cut K_t: all known rows, the new ones among them,
    and the corners that lie beyond doubt on the right side."""
    p, given, more = len(old.inside), len(old.limits), len(limits)
    for i in range(len(old.rows)):
        at = i if i < given else i + more
        new.rows[at] = old.rows[i]
        new.lifted[at] = old.lifted[i]
        new.masks[at] = old.masks[i]
    for i in range(more):
        know_row(new, given + i, rows[i], limits[i])
    n = 0
    for q in range(old.counts[USED]):
        stays = True
        for i in range(more):
            excess, size = -limits[i], abs(limits[i])
            for j in range(p):
                excess += rows[i, j] * old.points[j, q]
                size += abs(rows[i, j] * old.points[j, q])
            # the last term: a point's components total 1 only to about 1e-12
            doubt = (p + 8) * EPS * size + TINY + 1e-11 * abs(limits[i])
            stays = stays and excess > (-1e-9 if old.kind[q] == DOUBTFUL_CORNER else doubt)
        if stays:
            new.points[:, n] = old.points[:, q]
            new.inverses[n] = old.inverses[q]
            new.active[n] = old.active[q]
            new.kind[n] = old.kind[q]
            new.age[n] = old.age[q]
            n += 1
    new.counts[USED] = n
    new.counts[SLOT] = n % len(new.kind)


@compiled
def know_row(known: Known, i: int, row: Any, limit: float) -> None:
    """Known row i becomes a row w with w.g >= 0, from row.g >= limit and sum g = 1, rounded up where rounding is
    needed; with its lifted version, a little larger where negative and larger still where positive, so that
    t >= lambda times that implies t >= lambda (1 + 2^-48) w; and its mask."""
    mask, tiny = np.uint64(0), False
    for j in range(len(row)):
        w = row[j]
        if limit != 0.0:
            w += -limit + (10 * EPS * (abs(row[j]) + abs(limit)) + TINY)
        known.rows[i, j] = w
        known.lifted[i, j] = w * (1.0 + 2.0**-48 + (2.0**-50 if w > 0.0 else -(2.0**-50)))
        tiny = tiny or (w != 0.0 and abs(w) < SMALL)
        if j < 64 and w >= 0.0:
            mask |= np.uint64(1) << np.uint64(j)
    # of a row with entries so small that products with them underflow nothing can be concluded
    known.masks[i] = mask
    if tiny:
        known.lifted[i] = math.nan


@compiled
def recentre(known: Known, rows: Any, limits: Any) -> bool:
    """Move the inner point to the right side of new rows: half-way between the mean of the known points and the old
    inner point, which is first moved across the cuts towards that mean; or to the mean. False where neither is
    certainly inside."""
    p, n = len(known.inside), 0
    mean = np.zeros(p)
    for q in range(known.counts[USED]):
        if known.kind[q] != DOUBTFUL_CORNER:
            n += 1
            for j in range(p):
                mean[j] += known.points[j, q]
    if n == 0:
        return False
    share, old = 0.0, known.inside.copy()
    for i in range(len(limits)):
        short, gain = limits[i], -limits[i]
        for j in range(p):
            short -= rows[i, j] * old[j]
            gain += rows[i, j] * mean[j] / n
        if short > 0.0 and short + gain > 0.0:
            share = max(share, (short + gain / 2.0) / (short + gain))
    for weight in (0.5 + share / 2.0, 1.0):
        total = 0.0
        for j in range(p):
            known.inside[j] = mean[j] / n if weight == 1.0 else (1.0 - weight) * old[j] + weight * mean[j] / n
            total += known.inside[j]
        for j in range(p):
            known.inside[j] /= total
        if surely_inside(known.inside, known, known.room):
            add_point(known, known.inside)
            return True
    return False


@compiled
def add_point(known: Known, g: Any) -> None:
    """Know a point of K_t (each component right to its last bits)."""
    q = next_slot(known)
    for j in range(len(g)):
        known.points[j, q] = g[j]
    known.kind[q] = CERTAIN_POINT
    known.active[q] = 0


def has_point(known: Known) -> bool:
    """Whether some point is certainly in K_t."""
    return bool((known.kind[: known.counts[USED]] != DOUBTFUL_CORNER).any())


def prune(known: Known, region: Region) -> tuple[Known, Region]:
    """The same set without rows that follow from the others; they stay among the rows that are known to hold.
    Corners that rest on them lose their basis."""
    out = redundant(known)
    if not out.any():
        return known, region
    given, p = len(out), region.p
    rows = np.concatenate([known.rows[:given][~out], known.rows[given:], known.rows[:given][out]])
    renumbered = np.concatenate([np.arange(p), p + np.cumsum(~out) - 1])
    resting = np.concatenate([np.zeros(p, dtype=bool), out])[known.active].any(axis=1)
    lost = (resting & (known.kind == DOUBTFUL_CORNER))[: known.counts[USED]]
    known.kind[resting], known.active[resting] = CERTAIN_POINT, 0
    known.active[:] = renumbered[known.active]
    known = _only_corners(known, np.flatnonzero(~lost))
    region = region.take(~out)
    fresh = _of_region(region)
    known = known._replace(
        cuts=fresh.cuts, limits=fresh.limits, room=known.room[np.append(np.ones(p, dtype=bool), ~out)]
    )
    known = _with_rows(known, _latest(rows, len(region.rows)))
    _find_some_corner(known, region)
    return known, region


def add_row(known: Known, given: int, row: Floats) -> Known:
    """Know that row.g >= 0 on K_t; the first ``given`` rows are the region's own."""
    return _with_rows(known, _latest(np.concatenate([known.rows, row[None, :]]), given))


def add_corner(known: Known, basis: tuple[int, ...]) -> None:
    """Know the corner with these active constraints, if floats can invert them."""
    p = len(known.inside)
    active, inverse, g, slack = (
        np.array(basis, dtype=np.int64),
        np.zeros((p, p)),
        np.zeros(p),
        np.zeros(len(known.room)),
    )
    if p > 1 and inverse_of(active, known, inverse):
        corner_of(inverse, active, known, g)
        slacks_of(g, known, slack)
        keep(np.zeros(p), g, slack, inverse, active, 0, known)


def _of_region(region: Region) -> Known:
    """The arrays that the region gives; the others are empty."""
    p, none = region.p, np.empty((0, region.p))
    return Known(
        margin=region.margin,
        cuts=np.ascontiguousarray(region.rows.T),
        limits=region.rhs,
        rows=none,
        lifted=none,
        masks=np.empty(0, dtype=np.uint64),
        inside=np.full(p, np.nan),
        room=np.full(p + len(region.rows), np.nan),
        points=none,
        inverses=none[:, :, None],
        active=np.empty((0, p - 1), dtype=np.int64),
        kind=np.empty(0, dtype=np.int8),
        age=np.empty(0, dtype=np.int64),
        counts=np.zeros(3, dtype=np.int64),
    )


def _with_rows(known: Known, rows: Floats) -> Known:
    """Other known rows (r, p)."""
    known = known._replace(rows=np.empty(rows.shape), lifted=np.empty(rows.shape), masks=np.empty(len(rows), np.uint64))
    for i, row in enumerate(rows):
        know_row(known, i, row, 0.0)
    return known


def _only_corners(known: Known, stay: NDArray[np.intp]) -> Known:
    """A copy of the corners, only those of these numbers."""
    n = len(stay)
    points, inverses = np.zeros_like(known.points), np.empty_like(known.inverses)
    active, kind, age = np.zeros_like(known.active), np.zeros_like(known.kind), np.zeros_like(known.age)
    points[:, :n], inverses[:n], active[:n] = known.points[:, stay], known.inverses[stay], known.active[stay]
    kind[:n], age[:n] = known.kind[stay], known.age[stay]
    counts = known.counts.copy()
    counts[USED], counts[SLOT] = n, n % len(kind)
    return known._replace(points=points, inverses=inverses, active=active, kind=kind, age=age, counts=counts)


def _recentre_dearly(known: Known, region: Region) -> None:
    """With the analytic centre as the inner point if it is strictly inside, else with none."""
    centre = analytic_centre(region)
    known.inside[:] = centre if strictly_inside(centre, region) else np.nan
    if not np.isnan(known.inside[0]):
        slacks_of(known.inside, known, known.room)
        add_point(known, centre)


def _find_some_corner(known: Known, region: Region) -> None:
    """With a corner to start walks from, where floats find one."""
    if region.p > 1 and not (known.kind[: known.counts[USED]] != CERTAIN_POINT).any():
        add_corner(known, minimise(np.zeros(region.p), region).basis)


def _latest(rows: Floats, given: int) -> Floats:
    """The region's own rows, which come first, and the latest of the others."""
    return np.concatenate([rows[:given], rows[given:][-MOST_ROWS:]])
