"""Sequential Monte Carlo over scales and tutors: answers reweight particles, then they may move.

A particle is a vector x with theta = exp(x) = c g: the logs of the p gaps times the precision. If
they are learned, the logit of the tutor's lapse and that of the width of EQUAL follow. In these
coordinates the plausible set has no border at which moves are rejected. The method is iterated
batch importance sampling (Chopin 2002), tempered if an answer is a surprise (Del Moral, Doucet and
Jasra 2006). Random numbers are a hash of (key, counters).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from elicit._support.hashing import mix
from elicit._support.jit import compiled
from elicit.comparators.bradley_terry.density import ParticlePrior, likelihoods, scaled, slips
from elicit.comparators.bradley_terry.mcmc import move, unit

ENOUGH, FAIR = (
    0.5,
    0.2,
)  # effective sizes, as shares: below the first, particles are moved; below the second, an
# answer is learned in parts
SWEEPS = 16  # number of sweeps at a move
ROUNDING = 1e-14  # levels' values whose relative variation is less count as constant
GRID = 2.0**20  # first particles are whole multiples of its inverse


class ParticleArrays(NamedTuple):
    """Particles and the answers they have learned, as arrays.

    Attributes
    ----------
    x : (m, >= p)
        The particles.
    theta : (p, m)
        Their gaps times precision, see ``thetas``.
    slip : (2, m)
        Their lapses and widths of EQUAL.
    logs : (m,)
        Their log weights.
    noise : (1,)
        The variance of a mean over equally weighted particles, in units of the posterior's
        variance. Resampling increases it. Moves reduce it, and more so the less a particle's new
        place depends on its old one.
    rows : (p, >= n)
        The answers.
    tied : (>= n,)
        Flags of the answers that are EQUAL.
    """

    x: Any
    theta: Any
    slip: Any
    logs: Any
    noise: Any
    rows: Any
    tied: Any


def without_last_bits(x: Any) -> Any:
    """Return the first particles x rounded to multiples of 2^-20, the same on every processor.

    Logarithms and quantiles differ in their last bits from processor to processor. Without
    rounding, each move would enlarge these differences, until other moves are accepted.
    """
    return np.floor(x * GRID + 0.5) / GRID


@compiled
def thetas(x: Any, prior: ParticlePrior, out: Any, slip: Any) -> None:
    """Write theta = c g of particles x (m, >= p) into ``out`` (p, m).

    The lapses and widths of EQUAL are written into ``slip`` (2, m).
    """
    p, m = out.shape
    theta = np.empty(p)
    for i in range(m):
        scaled(x[i], prior.fixed, theta)
        for j in range(p):
            out[j, i] = theta[j]
        slip[0, i], slip[1, i] = slips(x[i], theta, prior)


@compiled
def effective_size(logs: Any) -> float:
    """Return the effective size (sum w)^2 / sum w^2 of weights w, given as logs (m,)."""
    most = logs.max()
    total, squares = 0.0, 0.0
    for i in range(len(logs)):
        w = math.exp(logs[i] - most)
        total += w
        squares += w * w
    return total * total / squares


@compiled
def resample(weights: Any, u: float, out: Any) -> None:
    """Write into ``out`` (m,) the number of the particle that each new particle is a copy of.

    The method is systematic resampling, with the uniform number u.
    """
    m = len(weights)
    total, at, i = 0.0, 0.0, 0
    for w in weights:
        total += w
    at = weights[0]
    for k in range(m):
        while at < (k + u) / m * total and i < m - 1:
            i += 1
            at += weights[i]
        out[k] = i


@compiled
def learn(state: ParticleArrays, n: int, prior: ParticlePrior, key: Any) -> tuple[int, int]:
    """Reweight particles by the last of n answers, and move them if few have weight.

    The arrays of ``state`` are changed. Return the numbers of moves proposed and accepted.
    """
    x, theta, slip, logs, noise, rows, tied = state
    m = len(x)
    found, target, copied = np.empty(m), np.empty(m), np.empty(m, dtype=np.int64)
    proposed, accepted, done, stage = 0, 0, 0.0, 0
    while done < 1.0:
        likelihoods(theta, slip, rows, tied, n, found)
        part = tempered(logs, found, 1.0 - done)
        done = 1.0 if part >= 1.0 - done else done + part
        for i in range(m):
            logs[i] += part * found[i]
        if effective_size(logs) < ENOUGH * m or done < 1.0:
            most = logs.max()
            for i in range(m):
                target[i] = math.exp(logs[i] - most)
            resample(target, unit(mix(mix(key, stage), 0)), copied)
            chosen, run = x[copied], 0.0
            for i in range(m):
                for j in range(x.shape[1]):
                    x[i, j] = chosen[i, j]
                logs[i] = 0.0
                run = run + 1.0 if i > 0 and copied[i] == copied[i - 1] else 1.0
                noise[0] += (
                    (2.0 * run - 2.0) / m / m
                )  # the total is that of squared numbers of copies, less one for each particle
            before = features(x, len(theta), prior.fixed)
            accepted += move(x, rows, tied, n, done, prior, mix(key, stage), SWEEPS)
            proposed += SWEEPS * m
            thetas(x, prior, theta, slip)
            noise[0] = 1.0 / m + remembered(before, features(x, len(theta), prior.fixed)) * (
                noise[0] - 1.0 / m
            )
            stage += 1
    return proposed, accepted


@compiled
def features(x: Any, p: int, fixed: float) -> Any:
    """Return the quantities (p, m) of particles x that verdicts depend on.

    They are the values of levels 2 to k - 1, and log c unless the precision is ``fixed``.
    """
    m = len(x)
    out = np.empty((p, m))
    for i in range(m):
        most, total = x[i, :p].max(), 0.0
        for j in range(p):
            total += math.exp(x[i, j] - most)
        at = 0.0
        for j in range(p - 1):
            at += math.exp(x[i, j] - most) / total
            out[j, i] = at
        out[p - 1, i] = most + math.log(total) if fixed == 0.0 or p == 1 else out[0, i]
    return out


@compiled
def remembered(before: Any, after: Any) -> float:
    """Return the greatest squared correlation of a feature (p, m) before and after some moves."""
    p, m = before.shape
    most = 0.0
    for j in range(p):
        a, b, ab, aa, bb = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(m):
            a += before[j, i] / m
            b += after[j, i] / m
        for i in range(m):
            ab += (before[j, i] - a) * (after[j, i] - b)
            aa += (before[j, i] - a) * (before[j, i] - a)
            bb += (after[j, i] - b) * (after[j, i] - b)
        if min(aa, bb) > m * ROUNDING * ROUNDING:
            most = max(most, ab * ab / (aa * bb))
    return most


@compiled
def tempered(logs: Any, found: Any, most: float) -> float:
    """Return the power, at most ``most``, to which the next likelihood may be raised.

    It is the greatest power that leaves an effective size of ``FAIR`` times the number of
    particles. ``logs`` are the log weights, and ``found`` the log-likelihoods of the answer.
    """
    m = len(logs)
    trial = np.empty(m)
    low, high = 0.0, most
    for turn in range(40):
        power = most if turn == 0 else 0.5 * (low + high)
        for i in range(m):
            trial[i] = logs[i] + power * found[i]
        if effective_size(trial) >= FAIR * m:
            if turn == 0:
                return most
            low = power
        else:
            high = power
    return low if low > 0.0 else high
