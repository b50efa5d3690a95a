"""Particles over scales and precisions, reweighted by each answer and moved when few of them carry the weight.

A particle is x (p,) with theta = exp(x) = c g: the logs of the gaps times the precision. In these coordinates the
plausible set has no border to reject moves at. Iterated batch importance sampling (Chopin 2002), tempered where one
answer is a surprise (Del Moral, Doucet and Jasra 2006); the moves are differential-evolution Metropolis (ter Braak
2006), whose steps are differences of other particles and so fit themselves to the posterior, in all coordinates or in
a few (Vrugt et al. 2009), and exchanges of two gaps, which leap between modes: few answers tell that some gap is large
but not which. Each term of the log-likelihood is at most 0, so that a proposal is given up as soon as its partial sum
is too low.

Compiled where numba is installed. Random numbers are a hash of (key, counters).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from elicit.hashed import mix
from elicit.jit import compiled
from elicit.scale import Floats
from elicit.settle import BETTER, UNKNOWN, WORSE, by_dominance, tail_sums_into

BLOCK = 64  # rows whose likelihoods are multiplied before a logarithm is taken
FARTHEST = 60.0  # a logistic function is 0 or 1 there, to within 1e-26
ENOUGH, FAIR = 0.5, 0.2  # shares of an effective sample: below the first particles are moved, below the second an
# answer is taken in by parts
SWEEPS = 16  # at a move
SWAPS, SHIFTS, WHOLE, FEW = 0.3, 0.2, 0.7, 4  # shares: of proposals that exchange two gaps; of the others, those that
# change the precision alone, and with them those in all coordinates; the rest step in at most so many
LEVEL_ROUNDING = 1e-9  # a level is reached by sums of weights that fall short of it by less
ROUNDING = 1e-14  # levels' values that vary by less do not vary
NUDGE = 1e-9  # of the step: lets particles leave a subspace that all of them lie in

_S11 = np.uint64(11)


class Prior(NamedTuple):
    """log h(S) = log of the mixture over shapes a of Dirichlet(a), in S = sum log g; and log c ~ N(mean, sd^2).
    ``fixed`` > 0 is a known precision; then the level of x means nothing."""

    shapes: Floats  # (nodes,)
    constants: Floats  # (nodes,) log weight + log of Dirichlet(a)'s constant
    mean: float
    sd: float
    fixed: float
    lapse: float
    above: Floats  # (r, p) rows with row.g >= limits
    limits: Floats  # (r,)


@compiled
def unit(h: Any) -> float:
    """A hash as a number strictly between 0 and 1: ``hashed.unit`` may be 0, which has no logarithm."""
    return (float(h >> _S11) + 0.5) * 2.0**-53


@compiled
def scaled(x: Any, fixed: float, theta: Any) -> float:
    """log c of x, and theta = c g into theta (p,)."""
    p = len(x)
    most, total = x[0], 0.0
    for j in range(p):
        most = max(most, x[j])
    for j in range(p):
        theta[j] = small_exp(min(most - x[j], FARTHEST))
    for j in range(p):
        total += theta[j]
    log_c: float = most + math.log(total)
    c = fixed if fixed > 0.0 else math.exp(min(log_c, 300.0))
    for j in range(p):
        theta[j] *= c / total
    return log_c


@compiled
def log_prior(x: Any, prior: Prior, theta: Any) -> float:
    """Log density of x up to a constant, and theta = c g into theta (p,); -inf where a prior inequality fails."""
    p, s, c = len(x), 0.0, 0.0
    log_c = scaled(x, prior.fixed, theta)
    for j in range(p):
        s += x[j]
        c += theta[j]
    for i in range(len(prior.limits)):
        at = 0.0
        for j in range(p):
            at += prior.above[i, j] * theta[j]
        if not at >= prior.limits[i] * c:
            return -math.inf
    s -= p * log_c
    best, total = -math.inf, 0.0
    for i in range(len(prior.shapes)):
        best = max(best, prior.constants[i] + prior.shapes[i] * s)
    for i in range(len(prior.shapes)):
        total += small_exp(min(best - prior.constants[i] - prior.shapes[i] * s, FARTHEST))
    z: float = (log_c - prior.mean) / prior.sd
    return best + math.log(total) - 0.5 * z * z


@compiled
def log_likelihood(
    theta: Any, rows: Any, tied: Any, first: int, end: int, lapse: float, least: float, work: Any
) -> float:
    """Sum over rows (p, n) from ``first`` up to ``end`` of log(lapse/2 + (1 - lapse) sigma(row.theta)), and where
    ``tied`` (n,) of the mean of that and of its opposite's; -inf as soon as it is below ``least``. ``work`` is
    (2, BLOCK)."""
    total = 0.0
    for start in range(first, end, BLOCK):
        size = min(BLOCK, end - start)
        for i in range(size):
            work[0, i] = 0.0
        j = 0
        while j + 4 <= len(theta):  # four at a time: the sums stay in registers
            a, b, c, d = theta[j], theta[j + 1], theta[j + 2], theta[j + 3]
            for i in range(start, start + size):
                work[0, i - start] += rows[j, i] * a + rows[j + 1, i] * b + rows[j + 2, i] * c + rows[j + 3, i] * d
            j += 4
        while j < len(theta):
            for i in range(start, start + size):
                work[0, i - start] += rows[j, i] * theta[j]
            j += 1
        for i in range(size):
            work[1, i] = small_exp(min(abs(work[0, i]), FARTHEST))
        total += log_terms(work, tied, start, size, lapse)
        if total < least:
            return -math.inf
    return total


@compiled
def log_terms(work: Any, tied: Any, start: int, size: int, lapse: float) -> float:
    """The terms of one block, of eta and exp(-|eta|) in the rows of ``work``: sigma(eta) = (1 or exp(-|eta|)) over
    1 + exp(-|eta|), so that products of both take one logarithm each."""
    total, above, below = 0.0, 1.0, 1.0
    for i in range(size):
        eta, far = work[0, i], work[1, i]
        below *= 1.0 + far
        even = 0.5 * lapse * (1.0 + far)
        if tied[start + i]:
            if lapse == 0.0:
                total -= 0.5 * abs(eta)
            else:
                total += 0.5 * math.log((even + (1.0 - lapse)) * (even + (1.0 - lapse) * far))
        elif lapse == 0.0:
            total += min(eta, 0.0)
        else:
            above *= even + (1.0 - lapse) * (1.0 if eta >= 0.0 else far)
            if above < 1e-250:
                total += math.log(above)
                above = 1.0
    return total + math.log(above) - math.log(below)


@compiled
def small_exp(u: float) -> float:
    """exp(-u) for u in 0..64, to a few parts in 10^14 where it is above 1e-6: exp(-u/64) by Taylor's series, squared
    six times. Without branches, for code that treats several u at once."""
    v = u * (-1.0 / 64.0)
    e = 1.0 + v * (1.0 / 12.0)
    e = 1.0 + v * (1.0 / 11.0) * e
    e = 1.0 + v * (1.0 / 10.0) * e
    e = 1.0 + v * (1.0 / 9.0) * e
    e = 1.0 + v * (1.0 / 8.0) * e
    e = 1.0 + v * (1.0 / 7.0) * e
    e = 1.0 + v * (1.0 / 6.0) * e
    e = 1.0 + v * (1.0 / 5.0) * e
    e = 1.0 + v * (1.0 / 4.0) * e
    e = 1.0 + v * (1.0 / 3.0) * e
    e = 1.0 + v * (1.0 / 2.0) * e
    e = 1.0 + v * e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@compiled
def thetas(x: Any, fixed: float, out: Any) -> None:
    """theta = c g (p, m) of particles x (m, p)."""
    m, p = x.shape
    theta = np.empty(p)
    for i in range(m):
        scaled(x[i], fixed, theta)
        for j in range(p):
            out[j, i] = theta[j]


@compiled
def likelihoods(theta: Any, rows: Any, tied: Any, n: int, lapse: float, out: Any) -> None:
    """Log-likelihood (m,) of row n - 1, for particles of theta (p, m)."""
    p, m = theta.shape
    work = np.empty((2, 1))
    for i in range(m):
        out[i] = 0.0
    for j in range(p):
        for i in range(m):
            out[i] += rows[j, n - 1] * theta[j, i]
    for i in range(m):
        work[0, 0] = out[i]
        work[1, 0] = small_exp(min(abs(out[i]), FARTHEST))
        out[i] = log_terms(work, tied, n - 1, 1, lapse)


@compiled
def effective_size(logs: Any) -> float:
    """(sum w)^2 / sum w^2 of log weights (m,)."""
    most = logs.max()
    total, squares = 0.0, 0.0
    for i in range(len(logs)):
        w = math.exp(logs[i] - most)
        total += w
        squares += w * w
    return total * total / squares


@compiled
def resample(weights: Any, u: float, out: Any) -> None:
    """Systematic resampling: which particle (m,) each new one copies."""
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
def learn(
    x: Any, theta: Any, logs: Any, noise: Any, rows: Any, tied: Any, n: int, prior: Prior, key: Any
) -> tuple[int, int]:
    """Reweight particles x (m, p), whose ``thetas`` are theta (p, m), with log weights ``logs`` (m,) by row n - 1 of
    rows (p, >= n), and move them where that leaves few with weight. ``noise`` (1,) is the variance of a mean over
    equally weighted particles, in units of the posterior's: resampling adds to it, and moves take away as much as they
    make a particle forget. Returns how many moves were proposed and accepted."""
    m = len(x)
    found, target, copied = np.empty(m), np.empty(m), np.empty(m, dtype=np.int64)
    proposed, accepted, done, stage = 0, 0, 0.0, 0
    while done < 1.0:
        likelihoods(theta, rows, tied, n, prior.lapse, found)
        part = tempered(logs, found, 1.0 - done)
        done = 1.0 if part >= 1.0 - done else done + part
        for i in range(m):
            logs[i] += part * found[i]
        if effective_size(logs) < ENOUGH * m or done < 1.0:
            most = logs.max()
            for i in range(m):
                target[i] = math.exp(logs[i] - most)
            resample(target, unit(mix(mix(key, stage), 0)), copied)
            x[:] = x[copied]
            run = 0.0
            for i in range(m):
                logs[i] = 0.0
                run = run + 1.0 if i > 0 and copied[i] == copied[i - 1] else 1.0
                noise[0] += (2.0 * run - 2.0) / m / m  # sums to squared numbers of copies, less one for each particle
            densities(x, rows, tied, n, done, prior, target)
            before = features(x, prior.fixed)
            for turn in range(SWEEPS):
                accepted += sweep(x, target, rows, tied, n, done, prior, mix(mix(key, stage), 1 + turn))
            proposed += SWEEPS * m
            thetas(x, prior.fixed, theta)
            noise[0] = 1.0 / m + remembered(before, features(x, prior.fixed)) * (noise[0] - 1.0 / m)
            stage += 1
    return proposed, accepted


@compiled
def features(x: Any, fixed: float) -> Any:
    """What verdicts hang on (p, m): the values of levels 2 to k - 1, and log c unless the precision is ``fixed``."""
    m, p = x.shape
    out = np.empty((p, m))
    for i in range(m):
        most, total = x[i].max(), 0.0
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
    """The greatest squared correlation, over features (p, m), of what they were before some moves and after."""
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
    """The greatest power up to ``most`` of likelihoods exp(found) that leaves a fair effective size."""
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


@compiled
def densities(x: Any, rows: Any, tied: Any, n: int, last: float, prior: Prior, out: Any) -> None:
    """Log density (m,) of the target, the last row's likelihood to the power ``last``."""
    p = x.shape[1]
    theta, work = np.empty(p), np.empty((2, BLOCK))
    for i in range(len(x)):
        out[i] = log_prior(x[i], prior, theta)
        out[i] += last * log_likelihood(theta, rows, tied, n - 1, n, prior.lapse, -math.inf, work)
        out[i] += log_likelihood(theta, rows, tied, 0, n - 1, prior.lapse, -math.inf, work)


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
        density = log_prior(proposal, prior, theta)
        least = logs[i] + math.log(unit(mix(h, 1))) - density
        if density == -math.inf or least > 0.0:
            continue
        found = last * log_likelihood(theta, rows, tied, n - 1, n, prior.lapse, -math.inf, work)
        if found >= least:
            found += log_likelihood(theta, rows, tied, 0, n - 1, prior.lapse, least - found, work)
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


@compiled
def weigh(d: Any, gaps: Any, weights: Any, level: float, verdicts: Any) -> None:
    """Verdicts (n,) on differences d (n, k): dominance, else the sign that particles of gaps (p, m) and total
    weight ``level`` share."""
    p, m = gaps.shape
    t, at = np.empty(p), np.empty(BLOCK)
    for i in range(len(d)):
        tail_sums_into(d, i, t)
        verdicts[i] = by_dominance(t)
        if verdicts[i] != UNKNOWN:
            continue
        up, down, left = 0.0, 0.0, 1.0
        for start in range(0, m, BLOCK):
            size = min(BLOCK, m - start)
            for q in range(size):
                at[q] = 0.0
            for j in range(p):
                for q in range(size):
                    at[q] += t[j] * gaps[j, start + q]
            for q in range(size):
                w = weights[start + q]
                left -= w
                if at[q] > 0.0:
                    up += w
                elif at[q] < 0.0:
                    down += w
            if max(up, down) + left < level - 2.0 * LEVEL_ROUNDING:
                break
        if up >= level - LEVEL_ROUNDING:
            verdicts[i] = BETTER
        elif down >= level - LEVEL_ROUNDING:
            verdicts[i] = WORSE
