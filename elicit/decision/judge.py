"""One judgement at a time from a comparator's rule, in code that numba can compile.

What only Python can tell (an optimum that is 0, or nearly; a comparator without a rule) comes back UNSETTLED, and
``Comparator.compare`` decides. Both always agree.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from elicit._support.jit import compiled, loosely
from elicit.comparators.bradley_terry.smc import shared_sign
from elicit.decision.rule import BOX, ENSEMBLE, OUTER, PROVEN, SILENT, WEIGHTED, Rule
from elicit.lp.sign import BY_SCREEN, BY_SIMPLEX, glance, screen, search, side_of, to_unit
from elicit.lp.vertices import BEST, EPS, ROW, SMALL, Known, doubt_at
from elicit.model.comparator import Tier
from elicit.model.tail_sums_kernel import BETTER, EQUAL, UNKNOWN, UNSETTLED, WORSE, by_dominance

BY_MODEL = int(Tier.MODEL)
FLOORED = 32  # added to a tier


@compiled
def judge_known(t: Any, shift: float, floor: Any, known: Known) -> tuple[int, int]:
    """By the proofs of ``settle``, cheapest first. Since the gaps total 1, t.g + shift is (t + shift).g."""
    p, inside, opened = len(t), known.inside, known.open
    some_closed = False
    size = 0.0
    for j in range(p):
        some_closed = some_closed or opened[j] == 0.0
        t[j] = (t[j] + shift) * opened[j]
        size = max(size, abs(t[j]))
    if some_closed or shift != 0.0:
        verdict = by_dominance(t)
        if verdict != UNKNOWN:
            return verdict, BY_SCREEN
    scaled = to_unit(t)
    wanted = len(floor) > 0 and not some_closed and shift == 0.0
    doubt = doubt_at(p, scaled)
    if not wanted:
        verdict = screen(t, scaled, inside, known.rows, known.lifted, known.masks, known.counts)
        if verdict != UNSETTLED:
            return verdict, BY_SCREEN
    corners = known.margin, known.cuts, known.limits, known.points, known.inverses, known.active, known.kind
    work = np.empty(len(known.kind)), np.empty(p), np.empty(p)
    verdict, tier = glance(t, doubt, side_of(t, inside, doubt), known.counts, corners, work)
    if not wanted:
        return search(t, known) if verdict == UNSETTLED else (verdict, tier)
    if tier == BY_SIMPLEX and verdict != UNSETTLED:
        if lower_by_corner(t, verdict, known.counts[BEST], known.active, known.limits, work, floor):
            rescale(floor, size / scaled)
            tier += FLOORED
        return verdict, tier
    if verdict != UNSETTLED:
        return verdict, tier
    verdict = screen(t, scaled, inside, known.rows, known.lifted, known.masks, known.counts)
    if verdict == UNSETTLED:
        return search(t, known)
    if lower_by_row(t, verdict, known.counts[ROW], known.rows, known.lifted, floor):
        rescale(floor, size / scaled)
        return verdict, FLOORED + BY_SCREEN
    return verdict, BY_SCREEN


@compiled
def rescale(floor: Any, factor: float) -> None:
    """Times a power of two."""
    for j in range(len(floor)):
        floor[j] *= factor


@compiled
def lower_by_row(t: Any, side: int, row: int, rows: Any, lifted: Any, floor: Any) -> bool:
    """A floor from the row that settled t: of the multiples of it that lie below side * t, the middle one."""
    least, most = 0.0, math.inf
    for j in range(len(t)):
        entry, w = side * t[j], rows[row, j]
        if w < 0.0:
            least = max(least, entry / w)
        elif w > 0.0:
            most = min(most, entry / w)
    if not most < 1e9 * least:
        most = 2.0 * least
    factor = 0.5 * (least + most)
    if not (least > SMALL and least < most):
        return False
    for j in range(len(t)):
        floor[j] = factor * lifted[row, j]
        if not side * t[j] >= floor[j]:
            return False
    return True


@compiled
def lower_by_corner(t: Any, side: int, q: int, active: Any, limits: Any, work: Any, floor: Any) -> bool:
    """A floor from the multipliers y of corner q: side * t may sink until half of what y leaves of it is gone."""
    _, y, rest = work
    p = len(t)
    size, gained, weight, least = 0.0, 0.0, 0.0, rest[0]
    for j in range(p):
        size = max(size, abs(t[j]))
        least = min(least, rest[j])
    for i in range(p - 1):
        if active[q, i] >= p and y[i + 1] > 0.0:
            weight += y[i + 1]
            gained += y[i + 1] * limits[active[q, i] - p]
    if not (gained >= 0.0 and least > 16.0 * (2 * p + 8) * EPS * (4.0 * size + 6.0 * weight)):
        return False
    for j in range(p):
        floor[j] = side * t[j] - rest[j] + 0.5 * least
    return True


@compiled
def judge_weighted(t: Any, shift: float, floor: Any, gaps: Any, weights: Any, level: float) -> tuple[int, int]:
    """By the weight of either sign."""
    at = np.empty(len(weights))
    side = shared_sign(t, shift, gaps, weights, level, at)
    if side == 0:
        return UNKNOWN, BY_MODEL
    if len(floor) > 0 and shift == 0.0:
        radius = reach(at, side, weights, level)
        if radius > 0.0:
            for j in range(len(t)):
                floor[j] = side * t[j] - radius
            return side, FLOORED + BY_MODEL
    return side, BY_MODEL


@loosely
def reach(at: Any, side: int, weights: Any, level: float) -> float:
    """A distance by which all scores may sink, the weight of those that keep their sign still reaching the level."""
    mean = 0.0
    for q in range(len(at)):
        mean += weights[q] * at[q]
    for share in (0.5, 0.2, 0.05):
        limit, weight = share * abs(mean), 0.0
        for q in range(len(at)):
            weight += weights[q] if side * at[q] > limit else 0.0
        if weight >= level:
            return limit - 1e-12  # what scores are computed to
    return 0.0


@compiled
def holds(t: Any, side: int, floor: Any) -> bool:
    """Whether side * t lies above the floor of an earlier verdict, which then is that of t too."""
    above = True
    for j in range(len(t)):
        above = above and side * t[j] >= floor[j]
    return above


@compiled
def judge_ensemble(t: Any, shift: float, gaps: Any, left_out: int) -> int:
    """By the number of scales of either sign."""
    p, last = gaps.shape[0], gaps.shape[1] - 1
    point = t[0] * gaps[0, last]
    for j in range(1, p):
        point += t[j] * gaps[j, last]
    point += shift
    if point == 0.0:
        return UNKNOWN
    sign = 1.0 if point > 0.0 else -1.0
    against = 0
    for q in range(last):
        at = t[0] * gaps[0, q]
        for j in range(1, p):
            at += t[j] * gaps[j, q]
        if not sign * (at + shift) > 0.0:
            against += 1
            if against > left_out:
                return UNKNOWN
    return BETTER if sign > 0.0 else WORSE


@compiled
def judge_box(d: Any, shift: float, ends: Any) -> int:
    """By the least and the greatest d.e over the box."""
    least, greatest = 0.0, 0.0
    for j in range(len(ends)):
        low, high = d[j + 1] * ends[j, 0], d[j + 1] * ends[j, 1]
        least += min(low, high)
        greatest += max(low, high)
    if least + shift > 0.0:
        return BETTER
    return WORSE if greatest + shift < 0.0 else UNKNOWN


@compiled
def judge(d: Any, t: Any, shift: float, floor: Any, rule: Rule) -> tuple[int, int]:
    """Verdict (or UNSETTLED) and tier of a difference d (k,) with tail sums t (p,), on which dominance is silent.

    ``shift`` judges the sign of d.e + shift in place of that of d.e. Overwrites t. ``floor`` is (p,) to write in, or
    (0,): where the tier comes back with FLOORED added to it, every t' with verdict * t' >= floor (which ``holds``
    says) has the same verdict, while the answers stay as they are; what is PROVEN, for ever.
    """
    kind = rule.kind
    if kind == PROVEN:
        return judge_known(t, shift, floor, rule.known)
    if kind == OUTER:
        verdict, tier = judge_known(t, shift, floor, rule.known)
        return (UNSETTLED if verdict == UNKNOWN else verdict), tier
    if kind == WEIGHTED:
        return judge_weighted(t, shift, floor, rule.scales, rule.weights, rule.level)
    if kind == ENSEMBLE:
        return judge_ensemble(t, shift, rule.scales, int(rule.level)), BY_MODEL
    if kind == BOX:
        return judge_box(d, shift, rule.scales), BY_MODEL
    if kind == SILENT and shift == 0.0:
        return UNKNOWN, BY_MODEL
    if kind == SILENT:
        for j in range(len(t)):
            t[j] += shift
        return by_dominance(t), BY_MODEL
    return UNSETTLED, BY_MODEL


@compiled
def within(d: Any, t: Any, indifference: float, rule: Any) -> int:
    """EQUAL where |d.e| is proven not to exceed the indifference, else UNKNOWN; UNSETTLED as ``judge`` has it.
    Overwrites t with nothing of use."""
    copy, nowhere = t.copy(), np.empty(0)
    for side in (1, -1):
        least = 0.0
        for j in range(len(t)):
            t[j] = copy[j]
            least = min(least, side * t[j])
        if least >= -indifference:  # for every ordered scale
            continue
        verdict = judge(d, t, side * indifference, nowhere, rule)[0]
        if verdict == UNSETTLED:
            return UNSETTLED
        if verdict != side and verdict != EQUAL:
            return UNKNOWN
    return EQUAL
