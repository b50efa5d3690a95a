"""The density of a particle x (p,), theta = exp(x) = c g: prior times likelihood, in compiled code.

Each term of the log-likelihood is at most 0, so that a proposal can be given up as soon as its partial sum is too low.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from elicit._support.jit import compiled
from elicit.model.scale import Floats

BLOCK = 64  # rows whose likelihoods are multiplied before a logarithm is taken; log_terms halves it three times
FARTHEST = 60.0  # a logistic function is 0 or 1 there, to within 1e-26


class ParticlePrior(NamedTuple):
    """log h(S) = log of the mixture over shapes a of Dirichlet(a), in S = sum log g; and log c ~ N(mean, sd^2).
    ``fixed`` > 0 is a known precision; then the level of x means nothing."""

    shapes: Floats  # (nodes,), at most BLOCK
    constants: Floats  # (nodes,) log weight + log of Dirichlet(a)'s constant
    mean: float
    sd: float
    fixed: float
    lapse: float
    above: Floats  # (r, p) rows with row.g >= limits
    limits: Floats  # (r,)


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
def log_prior(x: Any, prior: ParticlePrior, theta: Any, work: Any) -> float:
    """Log density of x up to a constant, and theta = c g into theta (p,); -inf where a prior inequality fails.
    ``work`` is (2, BLOCK)."""
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
    best, total, terms, nodes = -math.inf, 0.0, work[0], len(prior.shapes)
    for i in range(nodes):
        terms[i] = prior.constants[i] + prior.shapes[i] * s
    for i in range(nodes):
        best = max(best, terms[i])
    for i in range(nodes):
        terms[i] = small_exp(min(best - terms[i], FARTHEST))
    for i in range(nodes):
        total += terms[i]
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
        if size == BLOCK:  # the same, with a length that the compiler knows
            logits(theta, rows, start, BLOCK, work[0])
        else:
            logits(theta, rows, start, size, work[0])
        total += log_terms(work, tied[start : start + size], lapse)
        if total < least:
            return -math.inf
    return total


@compiled
def logits(theta: Any, rows: Any, start: int, size: int, out: Any) -> None:
    """row.theta into out (>= size,) for as many rows (p, n) from ``start``."""
    p, stop = len(theta), start + size
    for i in range(size):
        out[i] = 0.0
    for j in range(0, p - 3, 4):  # four at a time: the sums stay in registers
        a, b, c, d = theta[j], theta[j + 1], theta[j + 2], theta[j + 3]
        ra, rb = rows[j, start:stop], rows[j + 1, start:stop]
        rc, rd = rows[j + 2, start:stop], rows[j + 3, start:stop]
        for i in range(size):
            out[i] += ra[i] * a + rb[i] * b + rc[i] * c + rd[i] * d
    for j in range(p - p % 4, p):
        a, ra = theta[j], rows[j, start:stop]
        for i in range(size):
            out[i] += ra[i] * a


@compiled
def log_terms(work: Any, tied: Any, lapse: float) -> float:
    """The sum of one block's terms, one for each of ``tied``, of eta in the first row of ``work`` (2, BLOCK), which is
    lost. sigma(eta) = (1 or exp(-|eta|)) over 1 + exp(-|eta|): products of both take few logarithms, and multiplied by
    halves they take few steps."""
    above, below, size, ties, far = work[0], work[1], len(tied), 0, 0
    for i in range(size):
        ties += tied[i]
        far += abs(above[i]) > FARTHEST
    if far > 0 and lapse == 0.0:
        total = 0.0
        for i in range(size):
            total += log_term(above[i], tied[i], lapse)
        return total
    half, sure = 0.5 * lapse, 1.0 - lapse
    for i in range(size):
        below[i] = small_exp(min(abs(above[i]), FARTHEST))
    for i in range(size):
        above[i] = half * (1.0 + below[i]) + sure * (1.0 if above[i] >= 0.0 else below[i])
    if ties > 0:
        for i in range(size):
            if tied[i]:
                even = half * (1.0 + below[i])
                above[i] = math.sqrt((even + sure) * (even + sure * below[i]))
    for i in range(size):
        below[i] += 1.0
    for i in range(size, BLOCK):
        above[i], below[i] = 1.0, 1.0
    for half in (BLOCK // 2, BLOCK // 4, BLOCK // 8):
        for i in range(half):
            above[i] *= above[i + half]
            below[i] *= below[i + half]
    few, many, total = 1.0, 1.0, 0.0
    for i in range(BLOCK // 8):
        few *= below[i]  # at most 2^BLOCK
        many *= above[i]  # each at least exp(-8 FARTHEST)
        if many < 1e-90:
            total += math.log(many)
            many = 1.0
    return total + math.log(many) - math.log(few)


@compiled
def log_term(eta: float, tied: bool, lapse: float) -> float:
    """log(lapse/2 + (1 - lapse) sigma(eta)); where ``tied`` the mean of that and of its opposite's."""
    less = small_exp(min(abs(eta), FARTHEST))
    if lapse == 0.0:
        return (-0.5 * abs(eta) if tied else min(eta, 0.0)) - math.log(1.0 + less)
    even, sure = 0.5 * lapse * (1.0 + less), 1.0 - lapse
    if tied:
        return 0.5 * math.log((even + sure) * (even + sure * less)) - math.log(1.0 + less)
    return math.log(even + sure * (1.0 if eta >= 0.0 else less)) - math.log(1.0 + less)


@compiled
def small_exp(u: float) -> float:
    """exp(-u) for u in 0..60, to a few parts in 10^14 where it is above 1e-8, and in 10^11 below: exp(-u/256) by
    Taylor's series, squared eight times. Without branches, for code that treats several u at once."""
    v = u * (-1.0 / 256.0)
    e = 1.0 / 40320.0 + v * (1.0 / 362880.0)
    e = 1.0 / 5040.0 + v * e
    e = 1.0 / 720.0 + v * e
    e = 1.0 / 120.0 + v * e
    e = 1.0 / 24.0 + v * e
    e = 1.0 / 6.0 + v * e
    e = 0.5 + v * e
    e = 1.0 + v * e
    e = 1.0 + v * e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@compiled
def likelihoods(theta: Any, rows: Any, tied: Any, n: int, lapse: float, out: Any) -> None:
    """Log-likelihood (m,) of row n - 1, for particles of theta (p, m)."""
    p, m = theta.shape
    for i in range(m):
        out[i] = 0.0
    for j in range(p):
        each, by = theta[j], rows[j, n - 1]
        for i in range(m):
            out[i] += by * each[i]
    for i in range(m):
        out[i] = log_term(out[i], tied[n - 1], lapse)


@compiled
def powered(theta: Any, rows: Any, tied: Any, n: int, last: float, lapse: float, least: float, work: Any) -> float:
    """``log_likelihood`` of the first n rows, the last one's to the power ``last``."""
    if last == 1.0:
        return log_likelihood(theta, rows, tied, 0, n, lapse, least, work)
    found = last * log_likelihood(theta, rows, tied, n - 1, n, lapse, -math.inf, work)
    return found + log_likelihood(theta, rows, tied, 0, n - 1, lapse, least - found, work)
