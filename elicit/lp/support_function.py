"""The support function of K_t: proven greatest t.g for many t at once, in code numba can compile.

Each maximum starts at the best vertex known and walks on from there (``walk``). The result is no
vertex's value, but the bound that its multipliers prove, rounding included.
"""

import math
from typing import Any

import numpy as np

from elicit._support.jit import compiled, expect
from elicit.lp.primal_simplex import (
    CERTAIN_POINT,
    SLOT,
    USED,
    Known,
    corner_of,
    multipliers,
    walk,
)
from elicit.lp.rounding import bound_of, rounding, slacks_of
from elicit.lp.sign_proofs import NOWHERE, outermost, signs_at_points
from elicit.model.difference import tail_sums
from elicit.model.difference_kernel import to_order_one
from elicit.model.scale import Floats, order_bounds

OUTSIDE = 1e-11  # a corner that violates a constraint by at most this lies in K_t up to rounding


def greatest(d: Floats, known: Known) -> tuple[Floats, Floats]:
    """Return upper bounds (n,) on d.e over K_t, and d.e (n,) where the walks ended.

    If the set is too flat for floats to have vertices, the bounds are those that the order of the
    levels gives. A walk ends in a point of K_t, up to rounding; where none is found the second
    number is -inf. Where the two are the same, the bound is tight.

    Parameters
    ----------
    d : (n, k)
    known : Known

    Returns
    -------
    bounds, reached : (n,) each
    """
    t = tail_sums(d)
    high: Floats = order_bounds(t, known.margin)[1]
    high = high + rounding(t.shape[1] + 1, 4.0 * np.abs(t).max(axis=1, initial=0.0))
    reached = np.full(len(t), -np.inf)
    expect(greatest_all, 4e-6 * d.size * d.shape[1])
    with np.errstate(all="ignore"):
        greatest_all(np.ascontiguousarray(t), known, high, reached)
    return high, reached


@compiled
def greatest_all(t: Any, known: Known, high: Any, reached: Any) -> None:
    """Lower each upper bound (n,) on t.g, t (n, p), to the bound that the best vertex's multipliers
    prove, and write t.g at that vertex into ``reached`` (n,) if it lies in K_t up to rounding.
    """
    n, p = t.shape
    s, rest, y, g = np.empty(p), np.empty(p), np.empty(p), np.empty(p)
    slack = np.empty(p + len(known.limits))
    nothing = np.zeros(0, dtype=np.bool_)
    for i in range(n):
        for j in range(p):
            s[j] = -t[i, j]
        size, exponent = to_order_one(s)
        if size == 0.0 or not math.isfinite(size):
            continue
        at = np.empty(known.counts[USED])
        signs_at_points(s, 0.0, 0, known.points, known.kind, at)
        start, _ = outermost(at, known.kind, True)
        if start == NOWHERE:
            continue
        before = known.counts[SLOT]
        walk(s, start, known, nothing, -math.inf)
        found, best = -math.inf, -1
        for q in (start, before):  # a walk that moved has put its last vertex into the next slot
            if known.kind[q] == CERTAIN_POINT or (q == before and known.counts[SLOT] == before):
                continue
            multipliers(s, known.inverses, q, y)
            for j in range(p):
                rest[j] = s[j]
            proven = bound_of(rest, y, known.active, q, known.margin, known.cuts, known.limits)
            if proven > found:
                found, best = proven, q
        if best < 0:
            continue
        unit = math.ldexp(1.0, exponent)
        high[i] = min(high[i], -found * unit + 4e-16 * abs(found) * unit)
        corner_of(known.inverses[best], known.active[best], known, g)
        slacks_of(g, known.margin, known.cuts, known.limits, slack)
        if slack.min() >= -OUTSIDE:
            reached[i] = 0.0
            for j in range(p):
                reached[i] += t[i, j] * g[j]
