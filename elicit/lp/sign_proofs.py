"""Proofs of the sign of t.g over K_t, cheapest first, in compiled code.

``prove`` tries the proofs in the order that saves most time:

1. a multiple of one answer's row that lies below t (dominance after adding an answer),
2. known points of K_t with both signs,
3. multipliers at the best vertex known,
4. the closed form over K_0, all ordered scales,
5. a walk from vertex to vertex of K_t (the primal simplex method), from the best vertex known.

A walk ends at a point that shows t.g < 0, or at multipliers y >= 0. If the multipliers' bound, less
every rounding, is positive, it shows t.g > 0. If no proof shows a sign, the difference is
LEFT_OPEN. All verdicts are proven, and none depends on what earlier calls have stored. The caller
tests dominance before all of this.

A *certificate* is a vector f (p,) below t with f.g >= 0 on K_t. It shows the same verdict for all
tail sums above f.
"""

import math
from typing import Any

import numpy as np

from elicit._support.jit import compiled, compiled_beside
from elicit.lp.primal_simplex import (
    CERTAIN_POINT,
    DOUBTFUL_VERTEX,
    ROW,
    USED,
    Known,
    multipliers,
    walk,
)
from elicit.lp.rounding import SMALL, bound_of, least_in_order, rounding_of, score_doubt
from elicit.model.difference_kernel import (
    BETTER,
    LEFT_OPEN,
    UNKNOWN,
    WORSE,
    by_dominance,
    largest,
    to_order_one,
)

BY_EQUAL, BY_DOMINANCE, BY_SCREEN, BY_SIMPLEX = 0, 1, 2, 3  # codes of Tier
NOWHERE = -1  # no row, no vertex


@compiled
def prove(t: Any, certificate: Any, known: Known, verdicts: Any, tiers: Any) -> bool:
    """Decide the sign of t.g over K_t for each row of tail sums t (n, p) whose verdict is UNKNOWN.

    Verdicts (n,) and tiers (n,) are written into the last two arguments. A verdict is LEFT_OPEN if
    no proof is found. Pass many rows in a call, because passing ``known`` takes as long as a cheap
    proof.

    If t has a single row, a certificate (see the module) can be written into ``certificate`` (p,).
    The proofs that give far-reaching certificates then come first. Give an array (0,) if you want
    none. Return whether a certificate was written.
    """
    margin, inside, counts = known.margin, known.inside, known.counts
    rows, lifted, masks = known.rows, known.lifted, known.masks
    vertices = (
        margin,
        known.cuts,
        known.limits,
        known.points,
        known.inverses,
        known.active,
        known.kind,
    )
    n, p = len(verdicts), t.shape[1]
    s, y, rest, at = np.empty(p), np.empty(p), np.empty(p), np.empty(len(known.kind))
    wanted, certified = len(certificate) > 0, False
    for i in range(n):
        if verdicts[i] != UNKNOWN:
            continue
        for j in range(p):
            s[j] = t[i, j]
        size, exponent = to_order_one(s)
        doubt = score_doubt(p, size)
        side, row = side_of(s, inside, doubt), NOWHERE
        if side != 0 and not wanted:
            row = lifting_row(s, side, rows, lifted, masks, counts)
        if row != NOWHERE:
            verdicts[i], tiers[i] = side, BY_SCREEN
            continue
        verdict, vertex = by_known_vertices(s, doubt, side, counts[USED], vertices, at, y, rest)
        tier = BY_SCREEN if vertex == NOWHERE else BY_SIMPLEX
        if wanted and vertex != NOWHERE:
            certified = below_by_vertex(s, verdict, y, rest, vertex, known, certificate)
        elif wanted and verdict == LEFT_OPEN and side != 0:
            row = lifting_row(s, side, rows, lifted, masks, counts)
            if row != NOWHERE:
                verdict, certified = side, below_by_row(s, side, row, rows, lifted, certificate)
        if verdict == LEFT_OPEN:
            verdict, tier = search(s, known)
            if wanted and tier == BY_SIMPLEX and verdict in (BETTER, WORSE):
                # the vertex where the walk ended is known now
                again, vertex = by_known_vertices(
                    s, doubt, side, counts[USED], vertices, at, y, rest
                )
                if again == verdict:
                    certified = below_by_vertex(s, verdict, y, rest, vertex, known, certificate)
        verdicts[i], tiers[i] = verdict, tier
        if certified:
            for j in range(p):
                certificate[j] = math.ldexp(certificate[j], exponent)
    return certified


@compiled
def sign_of(t: Any, known: Known) -> int:
    """Return the verdict on tail sums t (p,), dominance included; it may be LEFT_OPEN."""
    verdicts, tiers = np.empty(1, dtype=np.int8), np.empty(1, dtype=np.int8)
    verdicts[0] = by_dominance(t)
    prove(t.reshape(1, len(t)), np.empty(0), known, verdicts, tiers)
    return int(verdicts[0])


@compiled
def by_known_vertices(
    t: Any, doubt: float, side: int, used: int, vertices: Any, at: Any, y: Any, rest: Any
) -> tuple[int, int]:
    """Return the verdict proven by the known vertices with the least and the greatest t.g.

    If t.g has both signs there, the result is (UNKNOWN, NOWHERE). Otherwise one of the two vertices
    may prove to be the best of all; its number is then the second result.

    ``vertices`` are the arrays of ``Known`` about vertices, of which ``used`` are in use. ``side``
    is the certain sign of t.g at the inner point, else 0. ``at`` (>= used,) receives t.g at each
    vertex. If a vertex proves the verdict, its multipliers are written into ``y`` (p,), and the
    remainder of +-t into ``rest`` (p,).
    """
    margin, cuts, limits, points, inverses, active, kind = vertices
    above, below = signs_at_points(t, doubt, side, points, kind, at[:used])
    if above and below:
        return UNKNOWN, NOWHERE
    lowest, highest = outermost(at[:used], kind, True)
    if lowest == NOWHERE or not (above or below):
        return LEFT_OPEN, NOWHERE
    sign, best = (1, lowest) if above else (-1, highest)
    for j in range(len(t)):
        rest[j] = sign * t[j]
    if (
        multipliers(rest, inverses, best, y) >= 0
        or not bound_of(rest, y, active, best, margin, cuts, limits) > 0.0
    ):
        return LEFT_OPEN, NOWHERE
    return (BETTER if above else WORSE), best


def signs_together(
    t: Any, doubt: float, side: int, points: Any, kind: Any, at: Any
) -> tuple[bool, bool]:
    """Return the result of ``signs_at_points``, computed for all points at once."""
    at[:] = 0.0
    for j in range(len(t)):
        at += points[j, : len(at)] * t[j]
    sure = at[kind[: len(at)] != DOUBTFUL_VERTEX]
    return side > 0 or bool((sure > doubt).any()), side < 0 or bool((sure < -doubt).any())


@compiled_beside(signs_together)
def signs_at_points(
    t: Any, doubt: float, side: int, points: Any, kind: Any, at: Any
) -> tuple[bool, bool]:
    """Return whether t.g is certainly positive at a known point, and certainly negative at one.

    ``side`` is its sign at some point known already, or 0. t.g at each of the points (p, >= q) is
    written into ``at`` (q,).
    """
    used = len(at)
    for q in range(used):
        at[q] = 0.0
    for j in range(len(t)):
        for q in range(used):
            at[q] += points[j, q] * t[j]
    above, below = side > 0, side < 0
    for q in range(used):
        if kind[q] != DOUBTFUL_VERTEX:
            above = above or at[q] > doubt
            below = below or at[q] < -doubt
    return above, below


@compiled
def outermost(at: Any, kind: Any, with_basis: bool) -> tuple[int, int]:
    """Return the places of the least and the greatest number in at (q,), or NOWHERE.

    If ``with_basis``, only points that have a basis (exact vertices) count.
    """
    lowest, highest = NOWHERE, NOWHERE
    for q in range(len(at)):
        if with_basis and kind[q] == CERTAIN_POINT:
            continue
        if lowest == NOWHERE or at[q] < at[lowest]:
            lowest = q
        if highest == NOWHERE or at[q] > at[highest]:
            highest = q
    return lowest, highest


@compiled
def search(t: Any, known: Known) -> tuple[int, int]:
    """Return the verdict and tier for tail sums t (p,), of order 1, by the costlier proofs.

    These are the closed form over all ordered scales, and walks from vertex to vertex of K_t.
    """
    if known.margin == 0.0 and len(known.limits) == 0:
        return UNKNOWN, BY_SCREEN
    p, total = len(t), 0.0
    opposite = np.empty(p)
    for j in range(p):
        total += t[j]
        opposite[j] = -t[j]
    if not math.isfinite(total):  # t is too large to be summed, so that nothing follows
        return LEFT_OPEN, BY_SIMPLEX
    doubt = score_doubt(p, largest(t))
    if least_in_order(t, known.margin) > doubt:
        return BETTER, BY_SCREEN
    if least_in_order(opposite, known.margin) > doubt:
        return WORSE, BY_SCREEN
    side = side_of(t, known.inside, doubt)
    at = np.empty(known.counts[USED])
    above, below = signs_at_points(t, doubt, side, known.points, known.kind, at)
    if above and below:
        return UNKNOWN, BY_SCREEN
    lowest, highest = outermost(at, known.kind, True)
    if lowest == NOWHERE:
        return LEFT_OPEN, BY_SIMPLEX
    nothing = np.zeros(0, dtype=np.bool_)
    if not below:
        found = walk(t, lowest, known, nothing, 0.0)
        if found > 0:
            return BETTER, BY_SIMPLEX
        below = found < 0
    if not above:
        found = walk(opposite, highest, known, nothing, 0.0)
        if found > 0:
            return WORSE, BY_SIMPLEX
        above = found < 0
    return (UNKNOWN if above and below else LEFT_OPEN), BY_SIMPLEX


@compiled
def side_of(t: Any, g: Any, doubt: float) -> int:
    """Return the sign of t.g at a point g if it is certain in spite of rounding, else 0."""
    at = 0.0
    for j in range(len(t)):
        at += t[j] * g[j]
    if at > doubt:
        return 1
    return -1 if at < -doubt else 0


@compiled
def lifting_row(t: Any, side: int, rows: Any, lifted: Any, masks: Any, counts: Any) -> int:
    """Return the number of a known row w that proves side * t.g >= 0, or NOWHERE.

    It does if side * t >= lambda w for some lambda >= 0, because w.g >= 0 on K_t. The row that was
    found last time, which ``counts`` remembers, is tried first.
    """
    negative = np.uint64(0)  # w can only help if it is negative at every entry where side * t is
    for j in range(min(len(t), 64)):
        if side * t[j] < 0.0:
            negative |= np.uint64(1) << np.uint64(j)
    last = counts[ROW]
    if last < len(masks) and not masks[last] & negative and lifts(t, side, last, rows, lifted):
        return int(last)
    for i in range(len(masks)):
        if not masks[i] & negative and lifts(t, side, i, rows, lifted):
            counts[ROW] = i
            return i
    return NOWHERE


@compiled
def lifts(t: Any, side: int, row: int, rows: Any, lifted: Any) -> bool:
    """Return whether side * t >= lambda w for a row w, rounding included.

    Lambda is the least number that makes this true at the negative entries of side * t.
    """
    least = 0.0
    for j in range(len(t)):
        entry = side * t[j]
        if entry < 0.0:
            if rows[row, j] >= 0.0:
                return False
            least = max(least, entry / rows[row, j])
    if not least > SMALL:
        return False
    # lambda = 1 needs no multiplication, hence no rounding: it decides an answered pair met again
    for j in range(len(t)):
        lift = rows[row, j] if least == 1.0 else least * lifted[row, j]
        if not side * t[j] >= lift:
            return False
    return True


@compiled
def below_by_row(t: Any, side: int, row: int, rows: Any, lifted: Any, certificate: Any) -> bool:
    """Write a certificate for t: a multiple of the row w that decided it.

    Of all multiples of w that lie below side * t, entry by entry, the middle one is taken. Return
    whether it lies below side * t in spite of rounding.
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
def below_by_vertex(
    t: Any, side: int, y: Any, rest: Any, vertex: int, known: Known, certificate: Any
) -> bool:
    """Write a certificate from the multipliers y (p,) of a vertex that decided t.

    Side * t is a combination of rows, with these multipliers, plus ``rest`` (p,). The certificate
    is the combination of rows, plus a margin above all rounding errors. Return whether there is a
    certificate.
    """
    p = len(t)
    size, gained, weight, least = largest(t), 0.0, 0.0, rest[0]
    for j in range(p):
        least = min(least, rest[j])
    for i in range(p - 1):
        active = known.active[vertex, i]
        if active >= p and y[i + 1] > 0.0:
            weight += y[i + 1]
            gained += y[i + 1] * known.limits[active - p]
    doubt = rounding_of(2 * p, 4.0 * size + 6.0 * weight)
    if not (gained >= 0.0 and least > 16.0 * doubt):
        return False
    for j in range(p):
        certificate[j] = side * t[j] - rest[j] + 8.0 * doubt
    return True
