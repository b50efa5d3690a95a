"""Verdicts on differences by a comparator's rule, in compiled code.

``all_by_rule`` works on whole arrays, for ``compare`` and for elicitations. ``by_rule`` works on a
single difference, for loops that compare millions of pairs. A difference is LEFT_OPEN if the rule
cannot decide it: for example if d.e is exactly 0 at its optimum, or nearly, or if the comparator
has no rule. The comparator itself then decides it (``decision.verdicts``).
"""

import math
from typing import Any

import numpy as np

from elicit._support.jit import compiled
from elicit.decision.comparator_rule import (
    ALWAYS_ASK,
    BOX,
    ENSEMBLE,
    ORDER_ONLY,
    PROVEN,
    WEIGHTED,
    Rule,
)
from elicit.decision.votes import by_box, by_count, by_weight, spare_score
from elicit.lp.sign_proofs import BY_DOMINANCE, BY_EQUAL, BY_SCREEN, prove
from elicit.model.comparator import Tier
from elicit.model.difference_kernel import (
    EQUAL,
    LEFT_OPEN,
    UNKNOWN,
    by_dominance,
    tail_sums_into,
    to_order_one,
)

BY_MODEL = int(Tier.MODEL)
BLOCK = 256  # differences whose tail sums are held at once


@compiled
def all_by_rule(d: Any, rule: Rule, verdicts: Any, tiers: Any) -> int:
    """Write a rule's verdicts (n,) and tiers (n,) of differences d (n, k) into arrays.

    Dominance is included. Return the number of differences LEFT_OPEN.
    """
    n, k = d.shape
    t, row, nothing, left = np.empty((BLOCK, k - 1)), np.empty(k), np.empty(0), 0
    for start in range(0, n, BLOCK):
        stop = min(n, start + BLOCK)
        for i in range(start, stop):
            sums = t[i - start]
            tail_sums_into(d, i, sums)
            verdict = by_dominance(sums)
            tiers[i] = BY_EQUAL if verdict == EQUAL else BY_DOMINANCE
            verdicts[i] = verdict if verdict == EQUAL or rule.dominance else UNKNOWN
        if rule.kind == PROVEN:
            prove(t, nothing, rule.known, verdicts[start:stop], tiers[start:stop])
        for i in range(start, stop):
            if rule.kind != PROVEN and verdicts[i] == UNKNOWN:
                sums = t[i - start]
                _, exponent = to_order_one(sums)
                for j in range(k if rule.kind == BOX else 0):
                    row[j] = math.ldexp(d[i, j], -exponent)
                verdicts[i], tiers[i], _ = by_rule(row, sums, 0.0, nothing, rule)
            left += verdicts[i] == LEFT_OPEN
    return left


@compiled
def by_rule(d: Any, t: Any, shift: float, certificate: Any, rule: Rule) -> tuple[int, int, bool]:
    """Return a rule's verdict on the sign of d.e + shift, its tier, and whether it is certified.

    The difference d (k,) has the tail sums t (p,), which are overwritten. The caller has tested
    dominance. The verdict may be LEFT_OPEN.

    A certificate is a vector (p,): all tail sums that lie above it, entry by entry, have the same
    verdict (see ``certifies``). It holds until an answer is added, and for ever if the rule is
    PROVEN. It is written into ``certificate`` (p,). Give an array (0,) if you want none.
    """
    kind = rule.kind
    if kind == PROVEN:
        if shift != 0.0:  # since the gaps total 1, t.g + shift is (t + shift).g
            for j in range(len(t)):
                t[j] += shift
            verdict = by_dominance(t)
            if verdict != UNKNOWN:
                return verdict, BY_SCREEN, False
            certificate = certificate[:0]
        # called from here, since each call that hands on ``known`` takes as long as a proof
        found = np.empty(2, dtype=np.int8)
        found[0] = UNKNOWN
        one = t.reshape(1, len(t))
        certified = prove(one, certificate, rule.known, found[:1], found[1:])
        return int(found[0]), int(found[1]), certified
    if kind == WEIGHTED:
        return by_votes(t, shift, certificate, rule.scales, rule.weights, rule.level)
    if kind == ENSEMBLE:
        return by_count(t, shift, rule.scales, int(rule.level)), BY_MODEL, False
    if kind == BOX:
        return by_box(d, shift, rule.scales), BY_MODEL, False
    if kind == ALWAYS_ASK and shift == 0.0:
        return UNKNOWN, BY_MODEL, False
    if kind in (ORDER_ONLY, ALWAYS_ASK):
        for j in range(len(t)):
            t[j] += shift
        return by_dominance(t), BY_MODEL, False
    return LEFT_OPEN, BY_MODEL, False


@compiled
def within(d: Any, t: Any, indifference: float, rule: Any) -> int:
    """Return EQUAL if |d.e| is proven not to exceed the indifference, else UNKNOWN.

    The result is LEFT_OPEN if ``by_rule`` cannot decide. t is overwritten.
    """
    copy, nothing = t.copy(), np.empty(0)
    for side in (1, -1):
        least = 0.0
        for j in range(len(t)):
            t[j] = copy[j]
            least = min(least, side * t[j])
        if least >= -indifference:  # proven for every ordered scale
            continue
        verdict = by_rule(d, t, side * indifference, nothing, rule)[0]
        if verdict == LEFT_OPEN:
            return LEFT_OPEN
        if verdict != side and verdict != EQUAL:
            return UNKNOWN
    return EQUAL


@compiled
def certifies(certificates: Any, row: int, side: int, t: Any) -> bool:
    """Return whether a certificate shows the verdict of t (p,): t lies above it, entry by entry.

    The certificate is a row of ``certificates`` (n, p), of an earlier verdict with the sign
    ``side``. For -1, it is -t that must lie above.
    """
    sign, above = (1.0 if side > 0 else -1.0), True
    for j in range(len(t)):
        above = above and sign * t[j] >= certificates[row, j]
    return above


@compiled
def by_votes(
    t: Any, shift: float, certificate: Any, gaps: Any, weights: Any, level: float
) -> tuple[int, int, bool]:
    """Return a verdict by the scales' weights, its tier, and whether there is a certificate.

    It is on the sign of t.g + shift. The scales have gaps (p, m) and weights (m,). For certificates
    see ``by_rule``.
    """
    at = np.empty(len(weights))
    verdict = by_weight(t, shift, gaps, weights, level, at)
    if verdict != UNKNOWN and len(certificate) > 0 and shift == 0.0:
        spare = spare_score(at, verdict, weights, level)
        if spare > 0.0:
            for j in range(len(t)):
                certificate[j] = verdict * t[j] - spare
            return verdict, BY_MODEL, True
    return verdict, BY_MODEL, False
