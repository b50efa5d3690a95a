"""The greatest t.g over K_t, proven, for many t at once: the support function of K_t, in code that numba can compile.

Each maximum starts at the best corner known and walks on from there (``walk``); what is handed back is no corner's
value but the bound that its multipliers prove, rounding included.
"""

import math
from typing import Any

import numpy as np

from elicit._support.jit import compiled, expect
from elicit.lp.primal_simplex import bound_of, largest, multipliers, walk
from elicit.lp.region import rounding
from elicit.lp.sign_proofs import NOWHERE, outermost, signs_at_points, to_unit
from elicit.lp.vertices import CERTAIN_POINT, SLOT, USED, Known
from elicit.model.scale import Floats, order_bounds, tail_sums


def greatest(d: Floats, known: Known) -> Floats:
    """Upper bounds (n,) on d.e over K_t for valid differences d (n, k), tight but for rounding; of a set too flat
    for floats to have corners, those that the order of the levels gives."""
    t = tail_sums(d)
    high: Floats = order_bounds(t, known.margin)[1]
    high = high + rounding(t.shape[1] + 1, 4.0 * np.abs(t).max(axis=1, initial=0.0))
    expect(greatest_all, 1e-4 * len(t))
    with np.errstate(all="ignore"):
        greatest_all(np.ascontiguousarray(t), known, high)
    return high


@compiled
def greatest_all(t: Any, known: Known, high: Any) -> None:
    """Lower each upper bound (n,) on t.g, t (n, p), to what multipliers at the best corner found prove."""
    n, p = t.shape
    s, rest, y = np.empty(p), np.empty(p), np.empty(p)
    nothing = np.zeros(0, dtype=np.bool_)
    for i in range(n):
        for j in range(p):
            s[j] = -t[i, j]
        size = to_unit(s)
        if size == 0.0 or not math.isfinite(size):
            continue
        at = np.empty(known.counts[USED])
        signs_at_points(s, 0.0, 0, known.points, known.kind, at)
        start, _ = outermost(at, known.kind, True)
        if start == NOWHERE:
            continue
        before = known.counts[SLOT]
        walk(s, start, known, nothing, -math.inf)
        found = -math.inf
        for q in (start, before):  # the walk has put its last corner, if it moved at all, into the next slot
            if known.kind[q] == CERTAIN_POINT or (q == before and known.counts[SLOT] == before):
                continue
            multipliers(s, known.inverses, q, y)
            for j in range(p):
                rest[j] = s[j]
            found = max(found, bound_of(rest, y, known.active, q, known.margin, known.cuts, known.limits))
        if found > -math.inf:
            unit = largest(t[i]) / size
            high[i] = min(high[i], -found * unit + 4e-16 * abs(found) * unit)
