"""Scales drawn from K_t, about uniformly, by hit-and-run (Smith 1984) with many chains at once.

Proofs about K_t need no draws. The choice of questions does, for example to halve the plausible
scales. The chains start in the middle of K_t. Their directions come from Dikin's ellipsoid there
(Kannan and Narayanan 2012), which has about the shape of K_t. After a few dozen steps the points
are near enough to uniform.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from elicit._support.fixed_order import LeastSquares, product, sums_to_zero
from elicit._support.hashing import name_code
from elicit._support.jit import compiled_beside
from elicit._support.threads import one_thread
from elicit.lp.region import Region
from elicit.model.scale import Floats

CHAINS, STEPS = 256, 60
_KEY = name_code("draws of scales")
_LEAST_SLACK = 1e-12  # in a flat region the middle lies on constraints and has no slack


class Draws(NamedTuple):
    """Weighted draws of scales, given by their gaps.

    Attributes
    ----------
    gaps : (p, m)
    weights : (m,)
        Of total 1.
    precision : (m,)
        In logits per unit of d.e. It is infinite if the tutor is taken never to err.
    """

    gaps: Floats
    weights: Floats
    precision: Floats


@one_thread
def draws_within(region: Region, inside: Floats) -> Draws:
    """Return draws of scales from a region, the end of each chain.

    They depend on the region as a set, not on the order of its rows.

    Parameters
    ----------
    region : Region
    inside : (p,)
        A point strictly inside the region. If the region is too flat for the chains to move, this
        point is the only draw.

    Returns
    -------
    Draws
    """
    p = region.p
    weights, never = np.full(CHAINS, 1.0 / CHAINS), np.full(CHAINS, np.inf)
    g = np.repeat(inside[:, None], CHAINS, axis=1)
    if p == 1:
        return Draws(g, weights, never)
    rng = np.random.Generator(np.random.Philox(_KEY))
    rows, limits = region.constraints_in_order
    shape = _ellipsoid(rows, limits, inside)
    slack = product(rows, g) - limits[:, None]
    up, down = np.empty(CHAINS), np.empty(CHAINS)
    for _ in range(STEPS):
        way = product(shape, rng.standard_normal((p - 1, CHAINS)))
        rate = product(rows, way)
        _reached(slack, rate, up, down)
        moves = np.isfinite(up) & np.isfinite(down) & (up > down)
        length = np.where(moves, down + (up - down) * rng.random(CHAINS), 0.0)
        g = g + length * way
        _move(slack, rate, length)
    return Draws(g / g.sum(axis=0), weights, never)


def _reached_together(slack: Floats, rate: Floats, up: Floats, down: Floats) -> None:
    """Write the distances (n,) at which each line leaves the region, forwards and backwards.

    ``slack`` (m, n) are the distances to the constraints, and ``rate`` (m, n) their growth along
    the line.
    """
    with np.errstate(all="ignore"):
        reach = -slack / rate  # distance along the line at which each constraint is met
    up[:] = np.where(rate < 0, reach, np.inf).min(axis=0)
    down[:] = np.where(rate > 0, reach, -np.inf).max(axis=0)


@compiled_beside(_reached_together)
def _reached(slack: Any, rate: Any, up: Any, down: Any) -> None:
    """Do the same as ``_reached_together``, a constraint at a time, for compiled code."""
    m, n = rate.shape
    for i in range(n):
        up[i], down[i] = math.inf, -math.inf
    for c in range(m):
        for i in range(n):
            reach = -slack[c, i] / rate[c, i]
            up[i] = min(up[i], reach if rate[c, i] < 0.0 else math.inf)
            down[i] = max(down[i], reach if rate[c, i] > 0.0 else -math.inf)


def _move_together(slack: Floats, rate: Floats, length: Floats) -> None:
    """Update ``slack`` (m, n) after a move along each line by ``length`` (n,); none is negative."""
    slack += length * rate
    np.maximum(slack, 0.0, out=slack)


@compiled_beside(_move_together)
def _move(slack: Any, rate: Any, length: Any) -> None:
    """Do the same as ``_move_together``, a constraint at a time, for compiled code."""
    m, n = slack.shape
    for c in range(m):
        for i in range(n):
            slack[c, i] = max(slack[c, i] + length[i] * rate[c, i], 0.0)


def _ellipsoid(rows: Floats, limits: Floats, inside: Floats) -> Floats:
    """Return a matrix (p, p - 1) that turns standard normal vectors into directions for lines.

    The directions lie in sum g = 0. Their covariance is that of the Dikin ellipsoid at ``inside``,
    up to a factor.
    """
    along, slack = (
        sums_to_zero(len(inside)),
        np.maximum(product(rows, inside) - limits, _LEAST_SLACK),
    )
    return product(along, LeastSquares(product(rows, along) / slack[:, None], least=1e-12).shape)
