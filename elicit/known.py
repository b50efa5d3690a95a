"""The upkeep of what is known of K_t: made from a region, cut by answers, pruned of what follows from the rest.

Everything here works on the arrays of ``settle.Known``; a cut makes new ones, so that an older comparator still
answers as before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elicit.centre import analytic_centre
from elicit.corner import CERTAIN_POINT, DOUBTFUL_CORNER, SLOT, SMALL, USED, Known, corner_of, inverse_of, slacks_of
from elicit.lp import strictly_inside
from elicit.scale import Floats
from elicit.simplex import Region, minimise, rounding
from elicit.walk import keep, redundant

MOST_CORNERS = 128
MOST_NUMBERS = 1_000_000  # in all their inverses: with very many levels, fewer corners are kept
MOST_ROWS = 16  # rows proven beside the region's own


def start(region: Region) -> Known:
    """What is known before any comparison: the region's rows, and the corners of K_0 that lie in it."""
    p = region.p
    room_for = max(8, min(MOST_CORNERS, MOST_NUMBERS // max(p * p, 1)))
    known = _with_rows(_of_region(region, np.full(p, np.nan)), _homogeneous(region.rows, region.rhs))
    known = known._replace(
        points=np.zeros((p, room_for)),
        inverses=np.zeros((room_for, p, p)),
        active=np.zeros((room_for, max(p - 1, 0)), dtype=np.int64),
        kind=np.zeros(room_for, dtype=np.int8),
        age=np.zeros(room_for, dtype=np.int64),
    )
    if not region.margin * p < 1 - 1e-9:  # K_0 is a point, or nearly
        return known
    known = _with_inside(known, region, np.full(p, 1.0 / p))
    if p > 1 and not len(region.rows):
        for best in range(p):
            add_corner(known, tuple(j for j in range(p) if j != best))
    return _with_some_corner(known, region)


def cut(known: Known, region: Region, new: int) -> Known:
    """The same for a region whose last ``new`` rows were not among its rows before: all rows that held still
    hold, and the corners that no new row may cut off stay. Its inner point is still the old one: ``refresh``."""
    rows, rhs = region.rows[-new:], region.rhs[-new:]
    old = len(region.rows) - new
    used = int(known.counts[USED])
    with np.errstate(all="ignore"):
        excess = rows @ known.points[:, :used] - rhs[:, None]
        # the last term: a point's components total 1 only to about 1e-12
        doubt = rounding(region.p, np.abs(rows) @ np.abs(known.points[:, :used]) + np.abs(rhs)[:, None])
        doubt = doubt + 1e-11 * np.abs(rhs)[:, None]
        stay = np.where(known.kind[:used] == DOUBTFUL_CORNER, excess > -1e-9, excess > doubt).all(axis=0)
    holding = np.concatenate([known.rows[:old], _homogeneous(rows, rhs), known.rows[old:]])
    return _with_rows(_only_corners(_of_region(region, known.inside, known), np.flatnonzero(stay)), holding)


def refresh(known: Known, region: Region, new: int) -> Known:
    """With a point strictly inside and a corner to start from, for a region that is not empty."""
    known = _with_inside(known, region, *_moved_inside(known, region, new))
    return _with_some_corner(known, region)


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
    region, room = region.take(~out), np.delete(known.room, p + np.flatnonzero(out))
    known = _of_region(region, known.inside, known)._replace(room=room)
    return _with_some_corner(_with_rows(known, _latest(rows, len(region.rows))), region), region


def add_row(known: Known, given: int, row: Floats) -> Known:
    """Know that row.g >= 0 on K_t; the first ``given`` rows are the region's own."""
    return _with_rows(known, _latest(np.concatenate([known.rows, row[None, :]]), given))


def add_point(known: Known, g: Floats) -> None:
    """Know a point of K_t (each component right to its last bits)."""
    slot = _next_slot(known)
    known.points[:, slot], known.kind[slot], known.active[slot] = g, CERTAIN_POINT, 0


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


def _next_slot(known: Known) -> int:
    slot = int(known.counts[SLOT])
    known.counts[SLOT] = (slot + 1) % len(known.kind)
    known.counts[USED] = max(int(known.counts[USED]), slot + 1)
    return slot


def _of_region(region: Region, inside: Floats, like: Known | None = None) -> Known:
    """The arrays that the region gives, the others as they are in ``like``."""
    p, none = region.p, np.empty((0, region.p))
    fresh = Known(
        margin=region.margin,
        cuts=np.ascontiguousarray(region.rows.T),
        limits=region.rhs,
        open=np.ones(p),
        rows=none,
        lifted=none,
        masks=np.empty(0, dtype=np.uint64),
        inside=inside,
        room=np.full(p + len(region.rows), np.nan),
        points=none,
        inverses=none[:, :, None],
        active=np.empty((0, p - 1), dtype=np.int64),
        kind=np.empty(0, dtype=np.int8),
        age=np.empty(0, dtype=np.int64),
        counts=np.zeros(3, dtype=np.int64),
    )
    if like is None:
        return fresh
    return like._replace(**{name: getattr(fresh, name) for name in ("cuts", "limits", "open", "room")})


def _with_rows(known: Known, rows: Floats) -> Known:
    """Other known rows (r, p). ``lifted`` is a little larger where negative and larger still where positive,
    so that t >= lambda times that implies t >= lambda (1 + 2^-48) row."""
    lifted = rows * np.where(rows > 0, 1.0 + 2.0**-48 + 2.0**-50, 1.0 + 2.0**-48 - 2.0**-50)
    bits = np.uint64(1) << np.arange(min(rows.shape[1], 64), dtype=np.uint64)
    masks = np.where(rows[:, :64] >= 0, bits, np.uint64(0)).sum(axis=1, dtype=np.uint64)
    # of rows with entries so small that products with them underflow nothing can be concluded
    masks[((rows != 0) & (np.abs(rows) < SMALL)).any(axis=1)] = ~np.uint64(0)
    return known._replace(rows=np.ascontiguousarray(rows), lifted=lifted, masks=masks)


def _homogeneous(rows: Floats, rhs: Floats) -> Floats:
    """Rows w with w.g >= 0 from rows.g >= rhs and sum g = 1, rounded up where rounding is needed."""
    moved = rows - rhs[:, None] + rounding(2, np.abs(rows) + np.abs(rhs)[:, None])
    return np.asarray(np.where((rhs == 0)[:, None], rows, moved))


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


def _moved_inside(known: Known, region: Region, new: int) -> list[Floats]:
    """Guesses at a point strictly inside after the last ``new`` rows were added: half-way between the mean of the
    corners and the old inner point, which is first moved across the cuts towards that mean."""
    points = known.points[:, : known.counts[USED]][:, known.kind[: known.counts[USED]] != DOUBTFUL_CORNER]
    if not points.shape[1]:
        return []
    rows, rhs = region.rows[-new:], region.rhs[-new:]
    mean, old = points.mean(axis=1), known.inside
    with np.errstate(all="ignore"):
        short, gain = rhs - rows @ old, rows @ mean - rhs
        share = float(np.where(short > 0, (short + gain / 2) / (short + gain), 0.0).max())
    moved = (1 - share) * old + share * mean
    return [guess / guess.sum() for guess in ((moved + mean) / 2, mean)]


def _with_inside(known: Known, region: Region, *guesses: Floats) -> Known:
    """With the first guess that is strictly inside, else with the analytic centre if that is, else with none."""
    inside = next((guess for guess in guesses if strictly_inside(guess, region)), None)
    if inside is None:
        inside = analytic_centre(region)
        if not strictly_inside(inside, region):
            return known._replace(inside=np.full(region.p, np.nan))
    known = known._replace(inside=inside)
    slacks_of(inside, known, known.room)
    add_point(known, inside)
    return known


def _with_some_corner(known: Known, region: Region) -> Known:
    """With a corner to start walks from, where floats find one."""
    if region.p > 1 and not (known.kind[: known.counts[USED]] != CERTAIN_POINT).any():
        add_corner(known, minimise(np.zeros(region.p), region).basis)
    return known


def _latest(rows: Floats, given: int) -> Floats:
    """The region's own rows, which come first, and the latest of the others."""
    return np.concatenate([rows[:given], rows[given:][-MOST_ROWS:]])
