"""The support function of K_t: the greatest t.g for many t at once, in compilable code.

Each maximum is searched by a walk from vertex to vertex (``walk``), from the best vertex known.
``greatest`` does not return the last vertex's value, but the bound that its multipliers prove,
rounding included.

``greatest_beside`` returns what the maxima would be if a question cut K_t in two. It proves
nothing, and serves to choose questions. In one of the two parts the maximum is the same as in K_t.
In the other one the dual simplex method finds it in a few steps. K_t itself is not cut.
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
    exchange,
    multipliers,
    rates_of,
    row_at,
    vertex_of,
    walk,
)
from elicit.lp.rounding import bound_of, rounding, slacks_of
from elicit.lp.sign_proofs import NOWHERE, outermost, signs_at_points
from elicit.model.difference import of_order_one, tail_sums
from elicit.model.difference_kernel import to_order_one
from elicit.model.scale import Floats, order_bounds

_MISSED = 1e-10  # how far a vertex may violate a constraint if nothing is to be proven
_ENTERS = 1e-11  # a smaller rate is rounding
OUTSIDE = 1e-11  # a vertex that violates a constraint by at most this lies in K_t up to rounding


def greatest(d: Floats, known: Known) -> tuple[Floats, Floats]:
    """Return upper bounds (n,) on d.e over K_t, and d.e (n,) at the points where the walks ended.

    If the two numbers are the same, the bound is tight.

    Parameters
    ----------
    d : (n, k)
    known : Known

    Returns
    -------
    bounds : (n,)
        If the set is too flat for floats to have vertices, these are the bounds from the order of
        the levels.
    reached : (n,)
        d.e at a point of K_t, up to rounding, or -inf if none is found.
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
    """Tighten upper bounds ``high`` (n,) on t.g, for t (n, p), as far as the best vertices prove.

    A bound follows from the vertex's multipliers. If the vertex lies in K_t up to rounding, its t.g
    is written into ``reached`` (n,).
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
        vertex_of(known.inverses[best], known.active[best], known, g)
        slacks_of(g, known.margin, known.cuts, known.limits, slack)
        if slack.min() >= -OUTSIDE:
            reached[i] = 0.0
            for j in range(p):
                reached[i] += t[i, j] * g[j]


def greatest_beside(d: Floats, asked: Floats, known: Known, enough: Floats) -> Floats:
    """Return roughly the greatest d.e over each of the two parts into which a question cuts K_t.

    Parameters
    ----------
    d : (n, k)
    asked : (c, k)
        The questions. The parts are asked.e <= 0 and asked.e >= 0.
    known : Known
    enough : (n,)
        A maximum up to this number may be replaced by any number up to it.

    Returns
    -------
    (c, 2, n)
        -inf if there is no such part, and inf if floats find no vertex.
    """
    t, rows = np.ascontiguousarray(tail_sums(d)), of_order_one(asked).t
    out = np.full((len(asked), 2, len(d)), np.inf)
    p, m = known.cuts.shape
    divided = known._replace(cuts=np.zeros((p, m + 1)), limits=np.append(known.limits, 0.0))
    divided.cuts[:, :m] = known.cuts
    expect(_divide, 2e-7 * d.size * d.shape[1] * (1 + len(asked)))
    with np.errstate(all="ignore"):
        # a copy: arrays that may not be written to would have machine code of their own
        _divide(t, np.ascontiguousarray(rows), known, divided, np.array(enough), out)
    return out


@compiled
def _divide(t: Any, asked: Any, known: Known, divided: Known, enough: Any, out: Any) -> None:
    """Write the greatest t.g, for t (n, p), over the parts that rows ``asked`` (c, p) make.

    ``divided`` is K_t with an additional row, the one that makes the part. ``out`` receives the
    numbers.
    """
    (n, p), m = t.shape, len(known.limits)
    s, y, g = np.empty(p), np.empty(p), np.empty(p)
    slack, left = np.empty(p + m), np.empty(p + m + 1)
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
        q = start if known.counts[SLOT] == before else before
        if known.kind[q] == CERTAIN_POINT or multipliers(s, known.inverses, q, y) >= 0:
            continue
        vertex_of(known.inverses[q], known.active[q], known, g)
        slacks_of(g, known.margin, known.cuts, known.limits, slack)
        least, unit = 0.0, math.ldexp(1.0, exponent)
        for j in range(p):
            least += s[j] * g[j]
        for c in range(len(asked)):
            side = 0.0
            for j in range(p):
                side += asked[c, j] * g[j]
            for part in range(2):
                sign, found = 2.0 * part - 1.0, least
                if sign * side < 0.0:
                    for j in range(p):
                        divided.cuts[j, m] = sign * asked[c, j]
                    for r in range(p + m):
                        left[r] = slack[r]
                    left[p + m] = sign * side
                    found = _least_beyond(
                        s,
                        known.inverses[q : q + 1].copy(),
                        known.active[q : q + 1].copy(),
                        least,
                        left,
                        divided,
                        -enough[i] / unit,
                    )
                out[c, part, i] = -found * unit


@compiled
def _least_beyond(
    s: Any, inverse: Any, active: Any, least: float, slack: Any, known: Known, enough: float
) -> float:
    """Return roughly the least s.g over K_t by the dual simplex method, or inf if K_t is empty.

    It starts from a basis whose multipliers are not negative: ``inverse`` (1, p, p) and ``active``
    (1, p - 1). The basis's vertex has the value ``least`` and these slacks (p + m,). The search
    ends as soon as the value is at least ``enough``.
    """
    p = len(s)
    y, w, rate = np.empty(p), np.empty(p), np.empty(len(slack))
    multipliers(s, inverse, 0, y)
    for _ in range(50 + 10 * p):
        entering = -1
        for c in range(len(slack)):
            if slack[c] < (-_MISSED if entering < 0 else slack[entering]):
                entering = c
        if entering < 0 or least >= enough:
            break
        row_at(inverse[0], entering, known, w)
        leaving, ratio = -1, math.inf
        for i in range(1, p):
            if w[i] > _ENTERS and max(y[i], 0.0) < ratio * w[i]:
                leaving, ratio = i, max(y[i], 0.0) / w[i]
        if leaving < 0:
            return math.inf
        length = -slack[entering] / w[leaving]
        rates_of(inverse[0], leaving, known, rate)
        for c in range(len(slack)):
            slack[c] += length * rate[c]
        slack[entering] = 0.0
        least += length * max(y[leaving], 0.0)
        for i in range(1, p):
            y[i] -= ratio * w[i]
        y[leaving] = ratio
        active[0, leaving - 1] = entering
        exchange(inverse[0], leaving, w)
    return least
