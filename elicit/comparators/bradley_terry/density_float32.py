"""Likelihoods in single precision, which suffice to decide nearly all proposals of the sampler.

They save little up to 100 answers, and from 300 on mostly a quarter to a half of the CPU time. How
much depends on the processor (benchmarks/RESULTS-single-precision.md).

No decision depends on their rounding. Each likelihood has a bound on its error. If a proposal is
closer than that to the limit at which it is rejected, double precision decides. So the answers may
be summed in any order. Those that the particles find hard to explain come first, so that a bad
proposal is rejected after few of them. Rows are padded to whole blocks, so that every loop has a
length that the compiler knows.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from elicit._support.jit import compiled, loosely
from elicit.comparators.bradley_terry.density import (
    BLOCK,
    EQUAL_LAPSES,
    LEAST_LAPSE,
    ParticlePrior,
    logits,
    scaled,
)

ROUNDING = 2.0**-24  # relative rounding error of a number in single precision
TERM = 1e-5  # maximum error of a log-term, excluding the error inherited from its logit
GREATEST = 1e30  # largest theta: single precision overflows not far above
HALF = BLOCK // 2
# from LEAST_LAPSE on half a block's product is not smaller, even if all its answers are EQUAL
SMALL = 1e-195
STORED = 1e-100  # smaller products are stored as logarithms
CLASSES, WIDTH, LOWEST = (
    64,
    0.5,
    -8.0,
)  # classes of logits that order the rows: number, width, lowest logit
_NONE, _ONE, _PART = np.float32(0.0), np.float32(1.0), np.float32(-1.0 / 32.0)
_NEAR, _FAR = (
    np.float32(15.0),
    np.float32(30.0),
)  # logits are clipped to these, the first without lapses
_C2, _C3, _C4, _C5, _C6, _C7 = (np.float32(1.0 / math.factorial(i)) for i in range(2, 8))


class Rough(NamedTuple):
    """Rows of answers in single precision, reordered, and padded with zeros to whole blocks."""

    rows: Any  # (p, n), single precision
    tied: Any  # (n,)
    sums: Any  # (p,) sum of the absolute values in each column of rows
    ties: Any  # (n / BLOCK,) number of ties in each block
    theta: Any  # (p,), single precision, to write in
    n: int  # number of rows without the padding


@compiled
def hardest_first(x: Any, rows: Any, tied: Any, n: int, prior: ParticlePrior) -> Any:
    """Return the order (n,) of n answers, so that those hardest to explain come first.

    The answers are columns of ``rows`` (p, >= n). Ties come first. The others follow by their
    logits at the mean theta of particles x (m, >= p), lowest first. Logits that differ by less than
    ``WIDTH`` count as equal.
    """
    p, m = len(rows), len(x)
    theta, mean, eta = np.empty(p), np.zeros(p), np.zeros(n)
    for i in range(m):
        scaled(x[i], prior.fixed, theta)
        for j in range(p):
            mean[j] += theta[j] / m
    for j in range(p):
        for i in range(n):
            eta[i] += mean[j] * rows[j, i]
    place, end, order = np.empty(n, np.int64), np.zeros(CLASSES, np.int64), np.empty(n, np.int64)
    for i in range(n):
        place[i] = 0 if tied[i] else int(min(max((eta[i] - LOWEST) / WIDTH, 0.0), CLASSES - 1.0))
        end[place[i]] += 1
    for i in range(1, CLASSES):
        end[i] += end[i - 1]
    for i in range(n):
        end[place[i]] -= 1
        order[end[place[i]]] = i
    return order


@compiled
def roughened(rows: Any, tied: Any, order: Any) -> Rough:
    """Return rows (p, n) and ``tied`` (n,) in single precision, in the given order."""
    p, n, whole = len(rows), len(order), (len(order) + BLOCK - 1) // BLOCK * BLOCK
    out, ties, sums = np.zeros((p, whole), np.float32), np.zeros(whole, np.bool_), np.zeros(p)
    counts = np.zeros(whole // BLOCK, np.int64)
    for j in range(p):
        for i in range(n):
            out[j, i] = rows[j, order[i]]
            sums[j] += abs(rows[j, order[i]])
    for i in range(n):
        ties[i] = tied[order[i]]
        counts[i // BLOCK] += ties[i]
    return Rough(out, ties, sums, counts, np.empty(p, np.float32), n)


@compiled
def error(theta: Any, rough: Rough, width: float) -> float:
    """Return an upper bound on the rounding error of ``rough_likelihood``."""
    sizes, p = 0.0, len(theta)
    for j in range(p):
        sizes += rough.sums[j] * theta[j]
        if not theta[j] <= GREATEST:
            return math.inf
    roundings = (
        p // 4 + p % 4 + 8
    )  # roundings of a product in ``logits``, which adds four at a time, and three of its factors
    return TERM * len(rough.tied) + ROUNDING * (roundings * sizes + 8 * len(rough.tied) * width)


@compiled
def rough_likelihood(
    theta: Any, rough: Rough, lapse: float, width: float, least: float, small: Any
) -> float:
    """Return the log-likelihood of theta (p,) in single precision, to within ``error``.

    If the lapse is below ``LEAST_LAPSE``, the result may be too great by more, because a term is
    never less than exp(-``_NEAR``). The result is -inf as soon as it must be below ``least``.
    ``small`` (2, BLOCK), in single precision, is overwritten.
    """
    whole, gone, share = len(rough.tied), 0.0, 1.0
    for j in range(len(theta)):
        rough.theta[j] = theta[j]
    wrong = 0.5 * (1.0 + EQUAL_LAPSES) if width > 0.0 else 0.5  # share of lapses, at least
    most = math.log(1.0 - lapse * wrong) + 4.0 * ROUNDING  # greatest value of a term
    for start in range(0, whole, BLOCK):
        logits(rough.theta, rough.rows, start, BLOCK, small[0])
        if width > 0.0:
            rough_terms_apart(small, rough.tied[start : start + BLOCK], lapse, width)
        else:
            rough_terms(small, lapse)
            if rough.ties[start // BLOCK] > 0:
                rough_ties(small, rough.tied[start : start + BLOCK], lapse)
        for i in range(rough.n - start, BLOCK):
            small[0, i] = _ONE
        for half in (small[0, :HALF], small[0, HALF:]):
            share *= max(product(half), SMALL)
            if share < STORED:
                gone += math.log(share)
                share = 1.0
        if share < math.exp(least - gone - most * max(0, rough.n - start - BLOCK)):
            return -math.inf
    return gone + math.log(share)


@loosely
def rough_terms(small: Any, lapse: float) -> None:
    """Replace a block's logits eta, the first row of ``small`` (2, BLOCK), by their terms.

    The terms are those of ``density.log_terms``.
    """
    above, below = small[0], small[1]
    half, sure = np.float32(0.5 * lapse), np.float32(1.0 - lapse)
    far = _NEAR if lapse < LEAST_LAPSE else _FAR
    for i in range(BLOCK):
        below[i] = rough_exp(min(abs(above[i]), far))
    for i in range(BLOCK):
        above[i] = half + sure * (_ONE if above[i] >= _NONE else below[i]) / (_ONE + below[i])


@loosely
def rough_ties(small: Any, tied: Any, lapse: float) -> None:
    """Write a block's terms for those answers that are ``tied`` (BLOCK,).

    ``rough_terms`` writes the terms of the others.
    """
    above, below = small[0], small[1]
    half, sure = np.float32(0.5 * lapse), np.float32(1.0 - lapse)
    for i in range(BLOCK):
        if tied[i]:
            less = sure * below[i] / (_ONE + below[i])
            above[i] = math.sqrt((half + less) * (half + sure - less))


@loosely
def rough_terms_apart(small: Any, tied: Any, lapse: float, width: float) -> None:
    """Replace a block's logits by their terms, with a width of EQUAL.

    See ``density.log_terms_apart``.
    """
    above, below = small[0], small[1]
    rare, often, sure, equal = (
        np.float32(EQUAL_LAPSES * lapse),
        np.float32(0.5 * (1.0 - EQUAL_LAPSES) * lapse),
        np.float32(1.0 - lapse),
        np.float32(-math.expm1(-2.0 * width)),
    )
    far, wide = _NEAR if lapse < LEAST_LAPSE else _FAR, np.float32(width)
    for i in range(BLOCK):
        above[i] = wide - abs(above[i]) if tied[i] else above[i] - wide
    for i in range(BLOCK):
        below[i] = rough_exp(min(abs(above[i]), far))
    for i in range(BLOCK):
        top = (_ONE if above[i] >= _NONE else below[i]) / (_ONE + below[i])
        if tied[i]:
            top *= equal / (_ONE + rough_exp(min(wide + wide - above[i], _FAR)))
        above[i] = (rare if tied[i] else often) + sure * top


@loosely
def product(terms: Any) -> float:
    """Return the product of terms (n,) in double precision."""
    total = 1.0
    for i in range(len(terms)):
        total *= np.float64(terms[i])
    return total


@loosely
def rough_exp(u: Any) -> Any:
    """Return exp(-u) for u in 0..30 in single precision.

    The relative error is at most 4e-6 for u up to 15.
    """
    v = u * _PART
    e = _C6 + v * _C7
    e = _C5 + v * e
    e = _C4 + v * e
    e = _C3 + v * e
    e = _C2 + v * e
    e = _ONE + v * e
    e = _ONE + v * e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e
