"""MCMC moves of the particles: differential evolution, and exchanges of two gaps.

In differential-evolution Metropolis (ter Braak 2006) a step is along the difference of two other
particles, and so adapts to the posterior. It changes all coordinates or a few (Vrugt et al. 2009).
An exchange of two gaps leaps between modes: a few answers may show that some gap is large, but not
which one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from elicit._support.hashing import mix
from elicit._support.jit import compiled, compiled_beside
from elicit.comparators.bradley_terry import mcmc_arrays
from elicit.comparators.bradley_terry.density import (
    BLOCK,
    LEAST_LAPSE,
    ParticlePrior,
    log_prior,
    powered,
    slips,
)
from elicit.comparators.bradley_terry.density_float32 import (
    error,
    hardest_first,
    rough_likelihood,
    roughened,
)
from elicit.comparators.bradley_terry.mcmc_arrays import FEW, NUDGE, SHIFTS, SWAPS, WHOLE

_S11 = np.uint64(11)


@compiled
def unit(h: Any) -> float:
    """Return a hash as a number strictly between 0 and 1.

    ``hashing.unit`` may be 0, which has no logarithm.
    """
    return (float(h >> _S11) + 0.5) * 2.0**-53


@compiled_beside(mcmc_arrays.move)
def move(
    x: Any, rows: Any, tied: Any, n: int, last: float, prior: ParticlePrior, key: Any, turns: int
) -> int:
    """Propose moves for each particle x (m, >= p) in turn, ``turns`` times over, in place.

    The moves leave the density prior times likelihood, of ``log_prior`` and ``powered``, invariant.
    Single precision decides unless its errors could change the decision. Return the number of
    accepted moves that changed a particle.
    """
    p, (m, size) = len(rows), x.shape
    proposal, theta, work, small = (
        np.empty(size),
        np.empty(p),
        np.empty((2, BLOCK)),
        np.empty((2, BLOCK), np.float32),
    )
    # if the last answer is tempered, double precision decides all
    order = hardest_first(x, rows, tied, n if last == 1.0 else 0, prior)
    rough, logs, errors = roughened(rows, tied, order), np.empty(m), np.zeros(m)
    precise, accepted = last < 1.0 or 0.0 <= prior.lapse < LEAST_LAPSE, 0
    for i in range(m):
        if i > 0 and (x[i] == x[i - 1]).all():
            logs[i], errors[i] = logs[i - 1], errors[i - 1]
            continue
        logs[i] = log_prior(x[i], prior, theta, work)
        lapse, width = slips(x[i], theta, prior)
        if precise:
            logs[i] += powered(theta, rows, tied, n, last, lapse, width, -math.inf, work)
        else:
            logs[i] += rough_likelihood(theta, rough, lapse, width, -math.inf, small)
            errors[i] = error(theta, rough, width)
    for draw in range(turns * m):
        i = draw % m
        h = mix(mix(key, 1 + draw // m), i)
        away = (
            swap(x, i, p, proposal, h)
            if p > 1 and unit(mix(h, 0)) < SWAPS
            else step(x, i, p, proposal, h)
        )
        density, ease = log_prior(proposal, prior, theta, work), math.log(unit(mix(h, 1)))
        least = logs[i] + ease - density
        if density == -math.inf or least > errors[i]:
            continue
        lapse, width = slips(proposal, theta, prior)
        slack, found = 0.0, -math.inf
        if last == 1.0:
            slack = error(theta, rough, width)
            found = rough_likelihood(theta, rough, lapse, width, least - errors[i] - slack, small)
            if found == -math.inf:
                continue
        if precise or not found > least + errors[i] + slack:
            if errors[i] > 0.0:
                logs[i], errors[i] = log_prior(x[i], prior, theta, work), 0.0
                lapse, width = slips(x[i], theta, prior)
                logs[i] += powered(theta, rows, tied, n, last, lapse, width, -math.inf, work)
                density = log_prior(proposal, prior, theta, work)
                lapse, width = slips(proposal, theta, prior)
                least = logs[i] + ease - density
            slack, found = 0.0, powered(theta, rows, tied, n, last, lapse, width, least, work)
            if least > 0.0 or not found >= least:
                continue
        for j in range(size):
            x[i, j] = proposal[j]
        logs[i], errors[i] = density + found, slack
        accepted += away
    return accepted


@compiled
def step(x: Any, i: int, p: int, proposal: Any, h: Any) -> bool:
    """Write a proposal for particle i: a step along the difference of two other particles.

    The step changes all coordinates, a few neighbouring ones, or the tutor's parameters alone. In
    the last case the same multiple of a difference is added to the tutor's coordinates, those after
    the first p, and to the log of the precision. For the latter it is the difference between the
    two particles' greatest coordinates among the first p. Return False if the two particles do not
    differ there.
    """
    m, size = x.shape
    a = int(unit(mix(h, 2)) * (m - 1))
    a += a >= i
    b = int(unit(mix(h, 3)) * (m - 2))
    b += b >= min(a, i)
    b += b >= max(a, i)
    kind = unit(mix(h, 4))
    count = size if kind < WHOLE else min(size, 1 + int(unit(mix(h, 5)) * FEW))
    first = int(unit(mix(h, 6)) * size)
    # one step in ten is a whole difference, which leaps between modes
    length = (
        1.0 if unit(mix(h, 7)) < 0.1 else 2.38 / math.sqrt(2.0 * count) * (0.5 + unit(mix(h, 8)))
    )
    apart = 0.0
    for j in range(size):
        proposal[j] = x[i, j]
    if kind < SHIFTS:
        apart, by = x[a, :p].max() - x[b, :p].max(), 2.0 * unit(mix(h, 8))
        for j in range(p):
            proposal[j] += by * apart
        for j in range(p, size):
            proposal[j] += by * (x[a, j] - x[b, j])
            apart = max(abs(apart), abs(x[a, j] - x[b, j]))
        return bool(apart != 0.0)
    for q in range(count):
        j = first + q if first + q < size else first + q - size
        proposal[j] += length * (x[a, j] - x[b, j])
        apart = max(apart, abs(x[a, j] - x[b, j]))
    proposal[first] += NUDGE * apart * (unit(mix(h, 9)) - 0.5)
    return apart > 0.0


@compiled
def swap(x: Any, i: int, p: int, proposal: Any, h: Any) -> bool:
    """Write a proposal for particle i with two of its p gaps exchanged.

    The first is the greatest of a few neighbouring gaps, and the second is another of these. The
    prior does not depend on the order of gaps, so only the answers decide. Return False if both
    gaps are equal.
    """
    first, count = int(unit(mix(h, 2)) * p), 2 + int(unit(mix(h, 3)) * (p - 1))
    best = first
    for j in range(x.shape[1]):
        proposal[j] = x[i, j]
    for q in range(count):
        j = first + q if first + q < p else first + q - p
        if x[i, j] > x[i, best]:
            best = j
    other = (first + int(unit(mix(h, 4)) * (count - 1))) % p
    if other == best:
        other = (first + count - 1) % p
    proposal[best], proposal[other] = x[i, other], x[i, best]
    return bool(proposal[best] != proposal[other])
