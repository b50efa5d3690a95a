"""Every bound on rounding errors in the linear programs, for NumPy arrays and for compiled loops.

Points and multipliers come from solvers that are only approximate. A point counts once it satisfies
every constraint of K_t by more than any rounding (``strictly_inside``). Multipliers count by a
bound that holds for any multipliers (``certified_bound``). Both use the same formula, ``rounding``,
which leaves room to spare.

Rows are of order one: no entry is larger than 1, and no limit larger than 2. The compiled functions
take K_t as plain arrays: its margin, ``cuts`` (p, m), which are the rows transposed, and ``limits``
(m,).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from elicit._support.jit import compiled
from elicit.model.difference_kernel import largest
from elicit.model.scale import Floats

if TYPE_CHECKING:
    from elicit.lp.region import Region

EPS = 2.0**-52
TINY = 2.0**-1000
SMALL = 2.0**-500  # a product of two numbers above this cannot underflow


def rounding(p: int, magnitude: Any) -> Any:
    """Return a bound on the rounding error of a float sum of p products.

    Underflow is covered too (Higham 2002, section 3.1, with room to spare).

    Parameters
    ----------
    p : int
    magnitude : float or array
        Total of the products' absolute values.

    Returns
    -------
    float or array, as ``magnitude``
    """
    return (p + 8) * EPS * magnitude + TINY


rounding_of = compiled(rounding)  # the same, called by compiled code


@compiled
def score_doubt(p: int, size: float) -> float:
    """Return an upper bound on the rounding error of t.g at a known point g.

    No entry of t (p,) may exceed ``size``.
    """
    doubt: float = rounding_of(p, 4.0 * size)
    return doubt


@compiled
def limit_doubt(c: int, p: int, margin: float, limits: Any) -> float:
    """Return an upper bound on the rounding error of the slack of constraint c.

    The point must total 1 to within 1e-12. Constraints are numbered: the p of the order first, then
    the rows.
    """
    if c < p:
        return 1e-11 * margin + 1e-300
    limit = abs(limits[c - p])
    doubt: float = 4.0 * rounding_of(p, 1.0 + limit) + 1e-11 * limit
    return doubt


@compiled
def slacks_of(g: Any, margin: float, cuts: Any, limits: Any, slack: Any) -> None:
    """Write the slack of g (p,) in each constraint into ``slack`` (p + m,)."""
    p, m = len(g), len(limits)
    for j in range(p):
        slack[j] = g[j] - margin
    for i in range(m):
        slack[p + i] = -limits[i]
    for j in range(p):
        for i in range(m):
            slack[p + i] += cuts[j, i] * g[j]


@compiled
def surely_inside(g: Any, margin: float, cuts: Any, limits: Any, slack: Any) -> bool:
    """Return whether g (p,) of total 1 satisfies every constraint by more than any rounding.

    The slacks are written into ``slack`` (p + m,).
    """
    slacks_of(g, margin, cuts, limits, slack)
    inside = True
    for c in range(len(slack)):
        inside = inside and slack[c] > limit_doubt(c, len(g), margin, limits)
    return inside


@compiled
def pulled_inside(
    g: Any, slack: Any, inside: Any, room: Any, margin: float, cuts: Any, limits: Any, point: Any
) -> bool:
    """Write into ``point`` (p,) a mixture of g and a point inside that is certainly in K_t.

    It is the one nearest to g. ``slack`` (p + m,) are g's slacks, and ``room`` (p + m,) those of
    the point inside. Return whether floats find a mixture.
    """
    p, share = len(g), 0.0
    for c in range(len(slack)):
        doubt = limit_doubt(c, p, margin, limits)
        if not slack[c] > doubt:
            if not room[c] > 4.0 * doubt:
                return False
            share = max(share, (2.0 * doubt - slack[c]) / (room[c] - slack[c]))
    at = np.empty(len(slack))
    for more in (1.0, 2.0, 10.0):
        mixed = share * more
        if not mixed < 1.0:
            return False
        total = 0.0
        for j in range(p):
            point[j] = (1.0 - mixed) * g[j] + mixed * inside[j]
            total += point[j]
        for j in range(p):
            point[j] /= total
        if abs(total - 1.0) < 1e-9 and surely_inside(point, margin, cuts, limits, at):
            return True
    return False


@compiled
def least_in_order(t: Any, margin: float) -> float:
    """Return the least t.g over all ordered scales, K_0 = {g >= margin, sum g = 1}.

    It is ``scale.order_bounds`` for a single row.
    """
    total, least = 0.0, t[0]
    for j in range(len(t)):
        total += t[j]
        least = min(least, t[j])
    bound: float = margin * total + (1.0 - len(t) * margin) * least
    return bound


@compiled
def bound_of(
    rest: Any, y: Any, active: Any, q: int, margin: float, cuts: Any, limits: Any
) -> float:
    """Return a lower bound on t.g over K_t that holds for any multipliers y.

    It is weak duality: t.g = (t - rows'y).g + y.(rows g) is at least the minimum of (t - rows'y).g
    over K_0 plus y.limits. Every rounding error is subtracted. The bound is -inf if floats
    overflow.

    ``rest`` (p,) holds t on entry, and t - rows'y on return. ``active[q]`` (c,) names c
    constraints: j < p for g_j >= margin, and p + i for row i. ``y`` (1 + c,) holds the multiplier
    of sum g = 1 and those of the c constraints. Negative multipliers count as zero. So do those of
    g_j >= margin, because the minimum over K_0 is computed in closed form.
    """
    p, c = len(rest), active.shape[1]
    size, gained, weight = largest(rest), 0.0, 0.0
    for i in range(c):
        if active[q, i] >= p and y[i + 1] > 0.0:
            row = active[q, i] - p
            weight += y[i + 1]
            gained += y[i + 1] * limits[row]
            for j in range(p):
                rest[j] -= y[i + 1] * cuts[j, row]
    bound: float = least_in_order(rest, margin) + gained
    if not math.isfinite(bound):
        return -math.inf
    doubt: float = rounding_of(p + 1 + c, 4.0 * size + 6.0 * weight)
    return bound - doubt


def certified_bound(t: Floats, y: Floats, region: Region) -> float:
    """Return a lower bound on t.g over the region that holds for any y >= 0 (``bound_of``).

    Parameters
    ----------
    t : (p,)
    y : (m,)
        Multipliers of the region's rows.
    region : Region

    Returns
    -------
    float
    """
    every = np.arange(region.p, region.p + len(y))[None]
    with np.errstate(all="ignore"):
        return bound_of(t.copy(), np.append(0.0, y), every, 0, *_arrays(region))


def strictly_inside(g: Floats, region: Region) -> bool:
    """Return whether g (p,), divided by its sum, is inside the region by more than any rounding."""
    slack = np.empty(region.p + len(region.rhs))
    total_is_one = abs(float(g.sum()) - 1.0) < 1e-12
    return total_is_one and surely_inside(g, *_arrays(region), slack)


def pull_inside(g: Floats, centre: Floats, region: Region) -> Floats | None:
    """Return the mixture of g and a centre that is nearest to g and strictly inside, or None.

    The centre is strictly inside the region. The entries of g (p,) total about 1.
    """
    arrays, point = _arrays(region), np.empty(region.p)
    slack, room = np.empty((2, region.p + len(region.rhs)))
    with np.errstate(all="ignore"):
        slacks_of(g, *arrays, slack)
        slacks_of(centre, *arrays, room)
        found = pulled_inside(g, slack, centre, room, *arrays, point)
    return point if found else None


def _arrays(region: Region) -> tuple[float, Floats, Floats]:
    """Return the margin, cuts and limits of a region, as compiled code takes them."""
    return region.margin, np.ascontiguousarray(region.rows.T), region.rhs
