"""Cheap proofs about the sign of t.g over K_t, one difference at a time, in code that numba can compile.

In the order that pays: dominance; one known row lifted over t (dominance after adding an answer); the closed
form over K_0; known points of both signs; and last a walk from vertex to vertex of K_t (the primal simplex
method, started at the best vertex known). A walk ends at a point that shows t.g < 0, or at multipliers
y >= 0 whose bound, less every rounding, shows t.g > 0. What it cannot show it leaves UNSETTLED: nothing here
is a guess, and nothing kept between two calls changes a verdict.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from elicit._support.jit import compiled
from elicit.lp.primal_simplex import bound_of, walk
from elicit.lp.vertices import (
    BEST,
    CERTAIN_POINT,
    CORNER,
    DOUBTFUL_CORNER,
    ROW,
    SMALL,
    USED,
    Known,
    doubt_at,
    multipliers,
)
from elicit.model.tail_sums_kernel import (
    BETTER,
    EQUAL,
    UNKNOWN,
    UNSETTLED,
    WORSE,
    by_dominance,
    tail_sums_into,
)

BY_EQUAL, BY_DOMINANCE, BY_SCREEN, BY_SIMPLEX = 0, 1, 2, 3  # the codes of Tier


@compiled
def settle_all(d: Any, known: Known, verdicts: Any, tiers: Any) -> int:
    """Verdicts (n,) and tiers (n,) of differences d (n, k), written into the last two arguments; returns how
    many are left UNSETTLED."""
    # the arrays one by one: to hand over all of `known` for every row would cost more than most rows do
    inside, opened = known.inside, known.open
    if screen_all(d, opened, (inside, known.rows, known.lifted, known.masks, known.counts), verdicts, tiers) == 0:
        return 0
    corners = known.margin, known.cuts, known.limits, known.points, known.inverses, known.active, known.kind
    p = d.shape[1] - 1
    t, work = np.empty(p), (np.empty(len(known.kind)), np.empty(p), np.empty(p))
    left = 0
    for i in range(len(d)):
        if verdicts[i] == UNSETTLED:
            tail_sums_into(d, i, t)
            for j in range(p):
                t[j] *= opened[j]
            doubt = doubt_at(p, to_unit(t))
            verdict, tier = glance(t, doubt, side_of(t, inside, doubt), known.counts, corners, work)
            if verdict == UNSETTLED:
                verdict, tier = search(t, known)
                left += verdict == UNSETTLED
            verdicts[i], tiers[i] = verdict, tier
    return left


@compiled
def screen_all(d: Any, opened: Any, some: Any, verdicts: Any, tiers: Any) -> int:
    """The same by dominance and by one known row; ``some`` are those of ``Known``'s arrays that ``screen`` needs."""
    inside, rows, lifted, masks, counts = some
    t = np.empty(d.shape[1] - 1)
    left = 0
    for i in range(len(d)):
        tail_sums_into(d, i, t)
        by_order = by_dominance(t)
        verdict, tier = by_order, BY_EQUAL if by_order == EQUAL else BY_DOMINANCE
        if verdict != EQUAL:
            for j in range(len(t)):
                t[j] *= opened[j]
            verdict = by_dominance(t)
            if verdict != by_order:
                tier = BY_SCREEN
        if verdict == UNKNOWN:
            verdict, tier = screen(t, to_unit(t), inside, rows, lifted, masks, counts), BY_SCREEN
            left += verdict == UNSETTLED
        verdicts[i], tiers[i] = verdict, tier
    return left


@compiled
def settle(t: Any, known: Known) -> int:
    """The verdict (or UNSETTLED) on tail sums t (p,) of order 1."""
    by_order = by_dominance(t)
    if by_order != UNKNOWN:
        return by_order
    verdict = screen(t, 1.0, known.inside, known.rows, known.lifted, known.masks, known.counts)
    return search(t, known)[0] if verdict == UNSETTLED else verdict


@compiled
def screen(t: Any, size: float, inside: Any, rows: Any, lifted: Any, masks: Any, counts: Any) -> int:
    """The verdict on tail sums t (p,) up to ``size``, or UNSETTLED, by one known row."""
    side = side_of(t, inside, doubt_at(len(t), size))
    return side if side != 0 and lifts_some_row(t, side, rows, lifted, masks, counts) else UNSETTLED


@compiled
def glance(t: Any, doubt: float, side: int, counts: Any, corners: Any, work: Any) -> tuple[int, int]:
    """Verdict and tier by the known corners where t.g is least and greatest: they have both signs, or one of them
    proves to be the best of all. ``corners`` are ``Known``'s arrays about them, ``work`` three to write in."""
    margin, cuts, limits, points, inverses, active, kind = corners
    at, y, rest = work
    p, used = len(t), counts[USED]
    for q in range(used):
        at[q] = 0.0
    for j in range(p):
        for q in range(used):
            at[q] += points[j, q] * t[j]
    lowest, highest = 0, 0
    for q in range(1, used):
        lowest = q if at[q] < at[lowest] else lowest
        highest = q if at[q] > at[highest] else highest
    if used == 0 or kind[lowest] != CORNER or kind[highest] != CORNER:
        return UNSETTLED, BY_SCREEN
    above, below = side > 0 or at[highest] > doubt, side < 0 or at[lowest] < -doubt
    if above and below:
        return UNKNOWN, BY_SCREEN
    if above == below:
        return UNSETTLED, BY_SCREEN
    sign, best = (1.0, lowest) if above else (-1.0, highest)
    for j in range(p):
        rest[j] = sign * t[j]
    if multipliers(rest, inverses, best, y) >= 0 or not bound_of(rest, y, active, best, margin, cuts, limits) > 0.0:
        return UNSETTLED, BY_SCREEN
    counts[BEST] = best
    return (BETTER if above else WORSE), BY_SIMPLEX


@compiled
def search(t: Any, known: Known) -> tuple[int, int]:
    """Verdict and tier of tail sums t (p,) of order 1, by the closed form over K_0 and by walks between corners."""
    p = len(t)
    if known.margin == 0.0 and len(known.limits) == 0:
        return UNKNOWN, BY_SCREEN
    size, total, least, greatest = 0.0, 0.0, t[0], t[0]
    for j in range(p):
        size = max(size, abs(t[j]))
        total += t[j]
        least = min(least, t[j])
        greatest = max(greatest, t[j])
    if not math.isfinite(total):  # t too large to be summed: nothing follows
        return UNSETTLED, BY_SIMPLEX
    doubt = doubt_at(p, size)
    free = 1.0 - p * known.margin
    if known.margin * total + free * least > doubt:
        return BETTER, BY_SCREEN
    if known.margin * total + free * greatest < -doubt:
        return WORSE, BY_SCREEN
    return by_corners(t, doubt, side_of(t, known.inside, doubt), known)


@compiled
def to_unit(t: Any) -> float:
    """Scale t by a power of two to a largest entry in [1/2, 1), where no bit is lost by it; returns that entry."""
    size = 0.0
    for j in range(len(t)):
        size = max(size, abs(t[j]))
    fraction, exponent = math.frexp(size)
    if exponent == 0:
        return size
    for j in range(len(t)):
        scaled = math.ldexp(t[j], -exponent)
        if exponent > 0 and math.ldexp(scaled, exponent) != t[j]:
            for i in range(j):
                t[i] = math.ldexp(t[i], exponent)
            return size
        t[j] = scaled
    return fraction


@compiled
def side_of(t: Any, g: Any, doubt: float) -> int:
    """The certain sign of t.g at a point g, else 0."""
    at = 0.0
    for j in range(len(t)):
        at += t[j] * g[j]
    if at > doubt:
        return 1
    return -1 if at < -doubt else 0


@compiled
def lifts_some_row(t: Any, side: int, rows: Any, lifted: Any, masks: Any, counts: Any) -> bool:
    """Whether side * t >= lambda w for a known row w and some lambda >= 0: first the row that settled last."""
    negative = np.uint64(0)  # w can only help where it is negative wherever side * t is
    for j in range(min(len(t), 64)):
        if side * t[j] < 0.0:
            negative |= np.uint64(1) << np.uint64(j)
    last = counts[ROW]
    if last < len(masks) and not masks[last] & negative and lifts(t, side, last, rows, lifted):
        return True
    for i in range(len(masks)):
        if not masks[i] & negative and lifts(t, side, i, rows, lifted):
            counts[ROW] = i
            return True
    return False


@compiled
def lifts(t: Any, side: int, row: int, rows: Any, lifted: Any) -> bool:
    """Whether side * t >= lambda w, rounding included, for row w and the least lambda
    that lifts the negative entries."""
    least = 0.0
    for j in range(len(t)):
        entry = side * t[j]
        if entry < 0.0:
            if rows[row, j] >= 0.0:
                return False
            least = max(least, entry / rows[row, j])
    if not least > SMALL:
        return False
    # lambda = 1 needs no multiplication, hence no rounding: it settles an answered pair met again
    for j in range(len(t)):
        lift = rows[row, j] if least == 1.0 else least * lifted[row, j]
        if not side * t[j] >= lift:
            return False
    return True


@compiled
def by_corners(t: Any, doubt: float, side: int, known: Known) -> tuple[int, int]:
    """Verdict and tier by the known corners, and by walks from the best of them."""
    n = known.counts[USED]
    at = np.zeros(n)
    for j in range(len(t)):
        for q in range(n):
            at[q] += known.points[j, q] * t[j]
    above, below = side > 0, side < 0
    lowest, highest = -1, -1
    for q in range(n):
        if known.kind[q] != DOUBTFUL_CORNER:
            above = above or at[q] > doubt
            below = below or at[q] < -doubt
        if known.kind[q] != CERTAIN_POINT:
            if lowest < 0 or at[q] < at[lowest]:
                lowest = q
            if highest < 0 or at[q] > at[highest]:
                highest = q
    if above and below:
        return UNKNOWN, BY_SCREEN
    if lowest < 0:
        return UNSETTLED, BY_SIMPLEX
    nothing = np.zeros(0, dtype=np.bool_)
    if not below:
        found = walk(t, lowest, known, nothing, 0.0)
        if found > 0:
            return BETTER, BY_SIMPLEX
        below = found < 0
    if not above:
        for j in range(len(t)):
            t[j] = -t[j]
        found = walk(t, highest, known, nothing, 0.0)
        for j in range(len(t)):
            t[j] = -t[j]
        if found > 0:
            return WORSE, BY_SIMPLEX
        above = found < 0
    return (UNKNOWN if above and below else UNSETTLED), BY_SIMPLEX
