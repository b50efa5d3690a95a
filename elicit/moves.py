"""Moves that keep the particles' target: differential evolution, in all coordinates or in a few, and exchanges of gaps.

Differential-evolution Metropolis (ter Braak 2006): the steps are differences of other particles and so fit themselves
to the posterior, in all coordinates or in a few (Vrugt et al. 2009). Exchanges of two gaps leap between modes: few
answers tell that some gap is large but not which.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from elicit.density import BLOCK, Prior, log_prior, powered
from elicit.hashed import mix
from elicit.jit import compiled

SWAPS, SHIFTS, WHOLE, FEW = 0.3, 0.2, 0.7, 4  # shares: of proposals that exchange two gaps; of the others, those that
# change the precision alone, and with them those in all coordinates; the rest step in at most so many
NUDGE = 1e-9  # of the step: lets particles leave a subspace that all of them lie in

_S11 = np.uint64(11)


@compiled
def unit(h: Any) -> float:
    """A hash as a number strictly between 0 and 1: ``hashed.unit`` may be 0, which has no logarithm."""
    return (float(h >> _S11) + 0.5) * 2.0**-53


@compiled
def sweep(x: Any, logs: Any, rows: Any, tied: Any, n: int, last: float, prior: Prior, key: Any) -> int:
    """Propose a move for each particle x (m, p) in turn, whose target's log density is in logs (m,). Returns how many
    were accepted, those not counted that led nowhere."""
    m, p = x.shape
    proposal, theta, work = np.empty(p), np.empty(p), np.empty((2, BLOCK))
    accepted = 0
    for i in range(m):
        h = mix(key, i)
        away = swap(x, i, proposal, h) if p > 1 and unit(mix(h, 0)) < SWAPS else step(x, i, proposal, h)
        density = log_prior(proposal, prior, theta, work)
        least = logs[i] + math.log(unit(mix(h, 1))) - density
        if density == -math.inf or least > 0.0:
            continue
        found = powered(theta, rows, tied, n, last, prior.lapse, least, work)
        if found >= least:
            for j in range(p):
                x[i, j] = proposal[j]
            logs[i] = density + found
            accepted += away
    return accepted


@compiled
def step(x: Any, i: int, proposal: Any, h: Any) -> bool:
    """Particle i moved by a multiple of the difference of two others, in all coordinates or in a few neighbouring ones,
    or in precision alone, by one of their greatest coordinates'. False where those two do not differ there."""
    m, p = x.shape
    a = int(unit(mix(h, 2)) * (m - 1))
    a += a >= i
    b = int(unit(mix(h, 3)) * (m - 2))
    b += b >= min(a, i)
    b += b >= max(a, i)
    kind = unit(mix(h, 4))
    count = p if kind < WHOLE else min(p, 1 + int(unit(mix(h, 5)) * FEW))
    first = int(unit(mix(h, 6)) * p)
    # now and then a whole difference, which leaps between modes
    length = 1.0 if unit(mix(h, 7)) < 0.1 else 2.38 / math.sqrt(2.0 * count) * (0.5 + unit(mix(h, 8)))
    apart = 0.0
    for j in range(p):
        proposal[j] = x[i, j]
    if kind < SHIFTS:
        apart += x[a].max() - x[b].max()
        for j in range(p):
            proposal[j] += 2.0 * unit(mix(h, 8)) * apart
        return bool(apart != 0.0)
    for q in range(count):
        j = (first + q) % p
        proposal[j] += length * (x[a, j] - x[b, j])
        apart = max(apart, abs(x[a, j] - x[b, j]))
    proposal[first] += NUDGE * apart * (unit(mix(h, 9)) - 0.5)
    return apart > 0.0


@compiled
def swap(x: Any, i: int, proposal: Any, h: Any) -> bool:
    """Particle i with the greatest of some neighbouring gaps exchanged for another of them: the prior is the same in
    every order, so that only answers can tell them apart. False where both are equal."""
    p = x.shape[1]
    first, count = int(unit(mix(h, 2)) * p), 2 + int(unit(mix(h, 3)) * (p - 1))
    best = first
    for j in range(p):
        proposal[j] = x[i, j]
    for q in range(count):
        j = (first + q) % p
        if x[i, j] > x[i, best]:
            best = j
    other = (first + int(unit(mix(h, 4)) * (count - 1))) % p
    if other == best:
        other = (first + count - 1) % p
    proposal[best], proposal[other] = x[i, other], x[i, best]
    return bool(proposal[best] != proposal[other])
