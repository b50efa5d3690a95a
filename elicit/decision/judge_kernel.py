"""The one judge: what a comparator's rule says of a difference, in compiled code.

``judge_all`` serves ``compare``, an elicitation and whole arrays; ``judge`` serves the loops that
compare by the million, one pair at a time. What a rule leaves open (an optimum that is 0, or
nearly; a comparator without a rule) comes back UNSETTLED, and the comparator itself settles it
(``decision.verdicts``).
"""

import math
from typing import Any

import numpy as np

from elicit._support.jit import compiled
from elicit.decision.comparator_rule import (
    ASKING,
    BOX,
    ENSEMBLE,
    OUTER,
    PROVEN,
    SILENT,
    WEIGHTED,
    Rule,
)
from elicit.decision.votes import by_box, by_count, by_weight, spare_score
from elicit.lp.primal_simplex import doubt_at, largest
from elicit.lp.sign_proofs import (
    BY_DOMINANCE,
    BY_EQUAL,
    BY_SCREEN,
    BY_SIMPLEX,
    NOWHERE,
    glance,
    lifting_row,
    search,
    side_of,
    signs_at_points,
    to_unit,
)
from elicit.lp.vertices import EPS, SMALL, USED, Known
from elicit.model.comparator import Tier
from elicit.model.tail_sums_kernel import EQUAL, UNKNOWN, UNSETTLED, by_dominance, tail_sums_into

BY_MODEL = int(Tier.MODEL)
NEAR = 1e-12  # of the largest tail sum: what is no farther from 0 at a point inside may be 0
LARGE = (
    2.0**900
)  # votes on differences beyond it, or below its inverse, are cast on multiples of them


@compiled
def judge_all(d: Any, rule: Rule, verdicts: Any, tiers: Any) -> int:
    """Verdicts (n,) and tiers (n,) of differences d (n, k), dominance included, written into the
    last two arguments. Returns how many are left UNSETTLED."""
    # proofs with the arrays one by one: to hand over the whole rule for every row would cost half
    # as much again
    k, kind, known = d.shape[1], rule.kind, rule.known
    inside, rows, lifted, masks, counts = (
        known.inside,
        known.rows,
        known.lifted,
        known.masks,
        known.counts,
    )
    corners = (
        known.margin,
        known.cuts,
        known.limits,
        known.points,
        known.inverses,
        known.active,
        known.kind,
    )
    row, t, y, rest, nothing = (
        np.empty(k),
        np.empty(k - 1),
        np.empty(k - 1),
        np.empty(k - 1),
        np.empty(0),
    )
    at, left = np.empty(len(known.kind)), 0
    for i in range(len(d)):
        tail_sums_into(d, i, t)
        verdict = by_dominance(t)
        tier = BY_EQUAL if verdict == EQUAL else BY_DOMINANCE
        if verdict == UNKNOWN or (verdict != EQUAL and not rule.dominance):
            if kind == PROVEN:
                size = to_unit(t)
                doubt = doubt_at(k - 1, size)
                side = side_of(t, inside, doubt)
                if side != 0 and lifting_row(t, side, rows, lifted, masks, counts) != NOWHERE:
                    verdict, tier = side, BY_SCREEN
                else:
                    verdict, corner = glance(t, doubt, side, counts[USED], corners, at, y, rest)
                    tier = BY_SCREEN if corner == NOWHERE else BY_SIMPLEX
                    if verdict == UNSETTLED:
                        verdict, tier = search(t, known)
            else:
                if kind in (BOX, ENSEMBLE):
                    in_range(d, i, row, t)
                verdict, tier, _ = judge(row, t, 0.0, nothing, rule)
            left += verdict == UNSETTLED
        verdicts[i], tiers[i] = verdict, tier
    return left


@compiled
def judge(d: Any, t: Any, shift: float, certificate: Any, rule: Rule) -> tuple[int, int, bool]:
    """Verdict (or UNSETTLED) and tier of a difference d (k,) with tail sums t (p,), on which
    dominance is silent; and whether there is a certificate. Overwrites t.

    ``shift`` judges the sign of d.e + shift in place of that of d.e. ``certificate`` is (p,) to
    write in, or (0,) where none is wanted: whatever lies above one has the same verdict
    (``certifies``), while the answers stay as they are; of a rule that is PROVEN, for ever.
    """
    kind = rule.kind
    if kind in (PROVEN, OUTER):
        verdict, tier, certified = by_proofs(t, shift, certificate, rule.known)
        if (
            kind == OUTER
            and verdict == UNKNOWN
            and not (shift == 0.0 and both_signs(t, rule.scales))
        ):
            verdict = UNSETTLED
        return verdict, tier, certified
    if kind == WEIGHTED:
        return by_votes(t, shift, certificate, rule.scales, rule.weights, rule.level)
    if kind == ENSEMBLE:
        return by_count(t, shift, rule.scales, int(rule.level)), BY_MODEL, False
    if kind == BOX:
        return by_box(d, shift, rule.scales), BY_MODEL, False
    if kind == ASKING and shift == 0.0:
        return UNKNOWN, BY_MODEL, False
    if kind in (SILENT, ASKING):
        for j in range(len(t)):
            t[j] += shift
        return by_dominance(t), BY_MODEL, False
    return UNSETTLED, BY_MODEL, False


@compiled
def within(d: Any, t: Any, indifference: float, rule: Any) -> int:
    """EQUAL where |d.e| is proven not to exceed the indifference, else UNKNOWN; UNSETTLED as
    ``judge`` has it. Overwrites t with nothing of use."""
    copy, nothing = t.copy(), np.empty(0)
    for side in (1, -1):
        least = 0.0
        for j in range(len(t)):
            t[j] = copy[j]
            least = min(least, side * t[j])
        if least >= -indifference:  # for every ordered scale
            continue
        verdict = judge(d, t, side * indifference, nothing, rule)[0]
        if verdict == UNSETTLED:
            return UNSETTLED
        if verdict != side and verdict != EQUAL:
            return UNKNOWN
    return EQUAL


@compiled
def certifies(certificates: Any, row: int, side: int, t: Any) -> bool:
    """Whether t (p,), with the sign of ``side``, lies above one row of the certificates (n, p),
    that of an earlier verdict of that sign, which then is that of t too."""
    sign, above = (1.0 if side > 0 else -1.0), True
    for j in range(len(t)):
        above = above and sign * t[j] >= certificates[row, j]
    return above


@compiled
def by_proofs(t: Any, shift: float, certificate: Any, known: Known) -> tuple[int, int, bool]:
    """By the proofs of ``lp.sign_proofs``, cheapest first; a certificate is wanted of those first
    that give wide ones. Since the gaps total 1, t.g + shift is (t + shift).g."""
    p = len(t)
    for j in range(p):
        t[j] += shift
    size = largest(t)
    if shift != 0.0:
        verdict = by_dominance(t)
        if verdict != UNKNOWN:
            return verdict, BY_SCREEN, False
    scaled = to_unit(t)
    doubt, wanted, row = doubt_at(p, scaled), len(certificate) > 0 and shift == 0.0, NOWHERE
    side = side_of(t, known.inside, doubt)
    if not wanted and side != 0:
        row = lifting_row(t, side, known.rows, known.lifted, known.masks, known.counts)
    if row != NOWHERE:
        return side, BY_SCREEN, False
    corners = (
        known.margin,
        known.cuts,
        known.limits,
        known.points,
        known.inverses,
        known.active,
        known.kind,
    )
    at, y, rest, certified = np.empty(len(known.kind)), np.empty(p), np.empty(p), False
    verdict, corner = glance(t, doubt, side, known.counts[USED], corners, at, y, rest)
    tier = BY_SCREEN if corner == NOWHERE else BY_SIMPLEX
    if wanted and corner != NOWHERE:
        certified = below_by_corner(t, verdict, y, rest, corner, known, certificate)
    elif wanted and verdict == UNSETTLED and side != 0:
        row = lifting_row(t, side, known.rows, known.lifted, known.masks, known.counts)
        if row != NOWHERE:
            verdict, certified = (
                side,
                below_by_row(t, side, row, known.rows, known.lifted, certificate),
            )
    if verdict == UNSETTLED:
        verdict, tier = search(t, known)
    if certified:
        for j in range(p):
            certificate[j] *= size / scaled  # a power of two
    return verdict, tier, certified


@compiled
def both_signs(t: Any, gaps: Any) -> bool:
    """Whether t.g is certainly positive at one of the points gaps (p, m), and certainly negative at
    another.
    """
    m = gaps.shape[1]
    above, below = signs_at_points(t, NEAR * largest(t), 0, gaps, np.zeros(m, np.int8), np.empty(m))
    return above and below


@compiled
def by_votes(
    t: Any, shift: float, certificate: Any, gaps: Any, weights: Any, level: float
) -> tuple[int, int, bool]:
    """By the weight of either sign among scales of gaps (p, m) and weights (m,)."""
    at = np.empty(len(weights))
    verdict = by_weight(t, shift, gaps, weights, level, at)
    if verdict != UNKNOWN and len(certificate) > 0 and shift == 0.0:
        spare = spare_score(at, verdict, weights, level)
        if spare > 0.0:
            for j in range(len(t)):
                certificate[j] = verdict * t[j] - spare
            return verdict, BY_MODEL, True
    return verdict, BY_MODEL, False


@compiled
def below_by_row(t: Any, side: int, row: int, rows: Any, lifted: Any, certificate: Any) -> bool:
    """A certificate from the row that settled t: of the multiples of it that lie below side * t,
    the middle one.
    """
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
        certificate[j] = factor * lifted[row, j]
        if not side * t[j] >= certificate[j]:
            return False
    return True


@compiled
def below_by_corner(
    t: Any, side: int, y: Any, rest: Any, corner: int, known: Known, certificate: Any
) -> bool:
    """A certificate from the multipliers y (p,) of a corner, which leave ``rest`` (p,) of side * t:
    that may sink until half of its least entry is gone."""
    p = len(t)
    size, gained, weight, least = largest(t), 0.0, 0.0, rest[0]
    for j in range(p):
        least = min(least, rest[j])
    for i in range(p - 1):
        active = known.active[corner, i]
        if active >= p and y[i + 1] > 0.0:
            weight += y[i + 1]
            gained += y[i + 1] * known.limits[active - p]
    if not (gained >= 0.0 and least > 16.0 * (2 * p + 8) * EPS * (4.0 * size + 6.0 * weight)):
        return False
    for j in range(p):
        certificate[j] = side * t[j] - rest[j] + 0.5 * least
    return True


@compiled
def in_range(d: Any, i: int, row: Any, t: Any) -> None:
    """Row i of d (n, k) into row (k,), and its tail sums into t (p,): times a power of two if it is
    very large or very small, so that no product with it overflows or vanishes."""
    size = largest(d[i, 1:])
    power = -math.frexp(size)[1] if size > LARGE or size < 1.0 / LARGE else 0
    for j in range(len(row)):
        row[j] = math.ldexp(d[i, j], power) if power != 0 else d[i, j]
    if power != 0:
        row[0] = 0.0  # level 1 never enters
        tail_sums_into(row.reshape(1, len(row)), 0, t)
