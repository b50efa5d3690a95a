"""Scales drawn from K_t, about uniformly: hit-and-run (Smith 1984), many chains at once.

Proofs about K_t need no draws. Questions do: which of them divides what is plausible most evenly, say. For that,
chains that start at the middle of K_t and take their directions from Dikin's ellipsoid there (Kannan and Narayanan
2012), which has about the shape of K_t, are near enough to uniform after a few dozen steps.
"""

from typing import NamedTuple

import numpy as np

from elicit._support.fixed_order import LeastSquares, product, sums_to_zero
from elicit._support.hashing import name_code
from elicit._support.threads import one_thread
from elicit.lp.region import Region
from elicit.model.scale import Floats

CHAINS, STEPS = 256, 60
_KEY = name_code("draws of scales")
_LEAST_SLACK = 1e-12  # a flat region has none: its middle lies on its constraints


class Draws(NamedTuple):
    """Weighted draws of gaps (p, m), their weights (m,), which total 1, and of the precision (m,), in logits per unit
    of d.e; infinite where the tutor is taken never to err."""

    gaps: Floats
    weights: Floats
    precision: Floats


@one_thread
def draws_within(region: Region, inside: Floats) -> Draws:
    """Draws from a region, one a chain, for a point ``inside`` (p,) strictly inside it; that point alone where the
    region is too flat for the chains to move. They depend on the region as a set, not on the order of its rows."""
    p = region.p
    weights, never = np.full(CHAINS, 1.0 / CHAINS), np.full(CHAINS, np.inf)
    g = np.repeat(inside[:, None], CHAINS, axis=1)
    if p == 1:
        return Draws(g, weights, never)
    rng = np.random.Generator(np.random.Philox(_KEY))
    rows, limits = region.constraints_in_order
    shape = _ellipsoid(rows, limits, inside)
    slack = product(rows, g) - limits[:, None]
    for _ in range(STEPS):
        way = product(shape, rng.standard_normal((p - 1, CHAINS)))
        rate = product(rows, way)
        with np.errstate(all="ignore"):
            reach = -slack / rate  # where each constraint is met
        up = np.where(rate < 0, reach, np.inf).min(axis=0)
        down = np.where(rate > 0, reach, -np.inf).max(axis=0)
        moves = np.isfinite(up) & np.isfinite(down) & (up > down)
        length = np.where(moves, down + (up - down) * rng.random(CHAINS), 0.0)
        g, slack = g + length * way, np.maximum(slack + length * rate, 0.0)
    return Draws(g / g.sum(axis=0), weights, never)


def _ellipsoid(rows: Floats, limits: Floats, inside: Floats) -> Floats:
    """A matrix (p, p - 1) that turns standard normals into directions along sum g = 1 with the covariance of the
    Dikin ellipsoid at ``inside``, up to a factor."""
    along, slack = sums_to_zero(len(inside)), np.maximum(product(rows, inside) - limits, _LEAST_SLACK)
    return product(along, LeastSquares(product(rows, along) / slack[:, None], least=1e-12).shape)
