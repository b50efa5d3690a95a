"""Particles over scales and precisions, reweighted by each answer and moved when few of them carry the weight.

A particle is x (p,) with theta = exp(x) = c g: the logs of the gaps times the precision. In these coordinates the
plausible set has no border to reject moves at. Iterated batch importance sampling (Chopin 2002), tempered where one
answer is a surprise (Del Moral, Doucet and Jasra 2006).

Compiled where numba is installed. Random numbers are a hash of (key, counters).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from elicit._support.hashing import mix
from elicit._support.jit import compiled, loosely
from elicit.comparators.bradley_terry.density import BLOCK, Prior, likelihoods, scaled
from elicit.comparators.bradley_terry.mcmc import move, unit
from elicit.model.tail_sums_kernel import BETTER, UNKNOWN, WORSE, by_dominance, tail_sums_into

ENOUGH, FAIR = 0.5, 0.2  # shares of an effective sample: below the first particles are moved, below the second an
# answer is taken in by parts
SWEEPS = 16  # at a move
LEVEL_ROUNDING = 1e-9  # a level is reached by sums of weights that fall short of it by less
ROUNDING = 1e-14  # levels' values that vary by less do not vary


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
            chosen, run = x[copied], 0.0
            for i in range(m):
                for j in range(x.shape[1]):
                    x[i, j] = chosen[i, j]
                logs[i] = 0.0
                run = run + 1.0 if i > 0 and copied[i] == copied[i - 1] else 1.0
                noise[0] += (2.0 * run - 2.0) / m / m  # sums to squared numbers of copies, less one for each particle
            before = features(x, prior.fixed)
            accepted += move(x, rows, tied, n, done, prior, mix(key, stage), SWEEPS)
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
def weigh(d: Any, gaps: Any, weights: Any, level: float, verdicts: Any) -> None:
    """Verdicts (n,) on differences d (n, k): dominance, else by ``shared_sign``."""
    p, m = gaps.shape
    t, at = np.empty(p), np.empty(m)
    for i in range(len(d)):
        tail_sums_into(d, i, t)
        verdicts[i] = by_dominance(t)
        if verdicts[i] == UNKNOWN:
            side = shared_sign(t, 0.0, gaps, weights, level, at)
            verdicts[i] = UNKNOWN if side == 0 else BETTER if side > 0 else WORSE


@compiled
def shared_sign(t: Any, shift: float, gaps: Any, weights: Any, level: float, at: Any) -> int:
    """The sign of t.g + shift that particles of gaps (p, m) and total weight ``level`` share, with the scores in at
    (m,); 0 where none has so much."""
    m, up, down, left = len(at), 0.0, 0.0, 1.0
    for start in range(0, m, BLOCK):
        end = min(m, start + BLOCK)
        scores_into(t, shift, gaps, start, at[start:end])
        above, below, both = signed_weights(at[start:end], weights[start:end])
        up, down, left = up + above, down + below, left - both
        if max(up, down) + left < level - 2.0 * LEVEL_ROUNDING:
            return 0
    return 1 if up >= level - LEVEL_ROUNDING else -1 if down >= level - LEVEL_ROUNDING else 0


@compiled
def scores_into(t: Any, shift: float, gaps: Any, start: int, out: Any) -> None:
    """t.g + shift into out (n,), for as many particles of gaps (p, m) from ``start``."""
    p, n, stop = len(t), len(out), start + len(out)
    first = gaps[0, start:stop]
    for q in range(n):
        out[q] = t[0] * first[q]
    for j in range(1, p - 3, 4):  # four at a time, each sum in order
        a, b, c, d = t[j], t[j + 1], t[j + 2], t[j + 3]
        ga, gb = gaps[j, start:stop], gaps[j + 1, start:stop]
        gc, gd = gaps[j + 2, start:stop], gaps[j + 3, start:stop]
        for q in range(n):
            out[q] = out[q] + a * ga[q] + b * gb[q] + c * gc[q] + d * gd[q]
    for j in range(p - (p - 1) % 4, p):
        by, gap = t[j], gaps[j, start:stop]
        for q in range(n):
            out[q] += by * gap[q]
    if shift != 0.0:
        for q in range(n):
            out[q] += shift


@loosely
def signed_weights(at: Any, weights: Any) -> tuple[float, float, float]:
    """The weight (of weights (n,)) of positive scores (n,), of negative ones, and all of it. The order of a sum matters
    less than ``LEVEL_ROUNDING``."""
    up, down, both = 0.0, 0.0, 0.0
    for q in range(len(at)):
        w = weights[q]
        both += w
        up += w if at[q] > 0.0 else 0.0
        down += w if at[q] < 0.0 else 0.0
    return up, down, both
