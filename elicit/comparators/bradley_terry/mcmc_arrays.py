"""``mcmc.move`` in NumPy, for use until that is compiled, with identical results.

In ``mcmc.move`` particles move one after the other, and a proposal uses two other particles as they
are at that time: moved if they come before, else not. So here particles are moved in groups, each
in the first group after all the particles that it uses. Five hundred particles make some ten
groups. Every sum has the order of the compiled code, and logarithms are those of ``math``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from elicit._support.hashing import fold
from elicit.comparators.bradley_terry.density import (
    BLOCK,
    EQUAL_LAPSES,
    FARTHEST,
    LEAST_LAPSE,
    LEAST_WIDTH,
    ParticlePrior,
    exp_of_minus,
    log_term,
)
from elicit.model.scale import Floats

SWAPS, SHIFTS, WHOLE, FEW = (
    0.3,
    0.2,
    0.7,
    4,
)  # shares of proposals: SWAPS exchange two gaps; of the others SHIFTS
# change the tutor's parameters alone, and up to WHOLE step in all coordinates; the rest step in at
# most FEW
NUDGE = 1e-9  # share of the step: lets particles leave a subspace that all of them lie in


def move(
    x: Floats,
    rows: Floats,
    tied: Any,
    n: int,
    last: float,
    prior: ParticlePrior,
    key: Any,
    turns: int,
) -> int:
    """Propose moves for each particle, as ``mcmc.move`` does."""
    p, m, accepted = len(rows), len(x), 0

    def density_and_taken(proposed: Floats, room: Floats) -> tuple[Floats, Any]:
        """Return the log densities of particles (q, size), and whether they exceed ``room`` (q,).

        The likelihood is computed only as long as it can exceed ``room`` less the log prior
        density.
        """
        density, theta = log_prior(proposed.T, p, prior)
        lapse, width = _slips(proposed.T, theta, prior)
        least = room - density
        found = powered(theta, rows, tied, n, last, lapse, width, least)
        return density + found, (density > -np.inf) & (least <= 0.0) & (found >= least)

    logs, _ = density_and_taken(x, np.full(m, -np.inf))
    for turn in range(turns):
        h = fold(fold(key, 1 + turn), np.arange(m))
        u = [unit(fold(h, j)) for j in range(10)]
        ease, before = elementwise(math.log, u[1]), x.copy()
        a = (u[2] * (m - 1)).astype(np.int64)
        a += a >= np.arange(m)
        b = (u[3] * (m - 2)).astype(np.int64)
        b += b >= np.minimum(a, np.arange(m))
        b += b >= np.maximum(a, np.arange(m))
        swaps = (u[0] < SWAPS) & (p > 1)
        for group in _groups(a, b, swaps):
            at, chance = group[:, None], [each[group] for each in u]
            first, second = (
                np.where(other[at] < at, x[other[group]], before[other[group]]) for other in (a, b)
            )
            proposal, away = steps(x[group], first, second, p, chance)
            if swaps[group].any():
                swapped, apart = exchanges(x[group], p, chance)
                proposal = np.where(swaps[at], swapped, proposal)
                away = np.where(swaps[group], apart, away)
            log, taken = density_and_taken(proposal, logs[group] + ease[group])
            x[group[taken]], logs[group[taken]] = proposal[taken], log[taken]
            accepted += int(away[taken].sum())
    return accepted


def _groups(a: Any, b: Any, alone: Any) -> list[Any]:
    """Return groups of particles that can move together, as lists of their numbers.

    A particle's proposal uses two other particles, a and b (m,). If one of these comes before it,
    it must have moved already, so it is in an earlier group. ``alone`` marks particles whose
    proposals use no others.
    """
    level: list[int] = []
    for i, (one, other, needs_none) in enumerate(
        zip(a.tolist(), b.tolist(), alone.tolist(), strict=True)
    ):
        behind = 0 if needs_none or one > i else level[one] + 1
        level.append(behind if needs_none or other > i else max(behind, level[other] + 1))
    return [np.flatnonzero(np.equal(level, each)) for each in range(max(level) + 1)]


def steps(x: Floats, a: Floats, b: Floats, p: int, u: list[Floats]) -> tuple[Floats, Any]:
    """Return the proposals of ``mcmc.step`` for particles x (q, size), and flags (q,).

    A flag is False if the proposal is the particle itself.
    """
    size, apart = x.shape[1], np.zeros(len(x))
    count = np.where(u[4] < WHOLE, size, np.minimum(size, 1 + (u[5] * FEW).astype(np.int64)))
    first = (u[6] * size).astype(np.int64)
    length = np.where(u[7] < 0.1, 1.0, 2.38 / np.sqrt(2.0 * count) * (0.5 + u[8]))
    chosen = (np.arange(size) - first[:, None]) % size < count[:, None]
    proposal = np.where(chosen, x + length[:, None] * (a - b), x)
    apart = np.where(chosen, np.abs(a - b), 0.0).max(axis=1)
    at = np.arange(len(x)), first
    proposal[at] += NUDGE * apart * (u[9] - 0.5)
    shift = u[4] < SHIFTS
    if shift.any():
        more = a[:, :p].max(axis=1) - b[:, :p].max(axis=1)
        away = np.concatenate([np.tile(more, (p, 1)).T, a[:, p:] - b[:, p:]], axis=1)
        by = np.where(
            np.arange(size) < p, (2.0 * u[8] * more)[:, None], (2.0 * u[8])[:, None] * away
        )
        proposal = np.where(shift[:, None], x + by, proposal)
        apart = np.where(shift, np.abs(away).max(axis=1), apart)
    return proposal, apart != 0.0


def exchanges(x: Floats, p: int, u: list[Floats]) -> tuple[Floats, Any]:
    """Return the proposals of ``mcmc.swap`` for particles x (q, size), and flags (q,).

    A flag is False if the proposal is the particle itself.
    """
    each, first = np.arange(len(x)), (u[2] * p).astype(np.int64)
    count = 2 + (u[3] * (p - 1)).astype(np.int64)
    places = (first[:, None] + np.arange(p)) % p
    gaps = np.where(np.arange(p) < count[:, None], x[each[:, None], places], -np.inf)
    best = places[each, gaps.argmax(axis=1)]
    other = (first + (u[4] * (count - 1)).astype(np.int64)) % p
    other = np.where(other == best, (first + count - 1) % p, other)
    proposal = x.copy()
    proposal[each, best], proposal[each, other] = x[each, other], x[each, best]
    return proposal, x[each, best] != x[each, other]


def log_prior(x: Floats, p: int, prior: ParticlePrior) -> tuple[Floats, Floats]:
    """Return the log prior density (q,) and theta (p, q) of particles x (size, q).

    See ``density.log_prior``.
    """
    most = x[:p].max(axis=0)
    theta = exp_of_minus(np.minimum(most - x[:p], FARTHEST))
    total = in_order(theta)
    log_c = most + elementwise(math.log, total)
    theta *= (
        prior.fixed if prior.fixed > 0.0 else elementwise(math.exp, np.minimum(log_c, 300.0))
    ) / total
    s, c = in_order(x[:p]) - p * log_c, in_order(theta)
    terms = prior.constants[:, None] + prior.shapes[:, None] * s
    best = terms.max(axis=0)
    z = (log_c - prior.mean) / prior.sd
    found = (
        best
        + elementwise(math.log, in_order(exp_of_minus(np.minimum(best - terms, FARTHEST))))
        - 0.5 * z * z
    )
    if prior.lapse < 0.0:
        found += log_logistic(x[p], prior.lapse_a, prior.lapse_b)
    if len(prior.kinds):
        found = _among_kinds(x, log_c, found + prior.general, prior)
    if prior.tie > 0.0:
        found += log_logistic(x[-1], 1.0, 1.0)
    for above, limit in zip(prior.above, prior.limits, strict=True):
        found[~(in_order(above[:, None] * theta) >= limit * c)] = -np.inf
    return found, theta


def _among_kinds(x: Floats, log_c: Floats, general: Floats, prior: ParticlePrior) -> Floats:
    """Return the log density (q,) of ``density.among_kinds`` for particles x (size, q)."""
    p, best, terms = prior.kinds.shape[1] - 5, general, []
    for constant, mean, sd, a, b, *shapes in prior.kinds.tolist():
        at, z = np.full(len(log_c), constant), (log_c - mean) / sd
        for shape, part in zip(shapes, x, strict=False):
            at = at + shape * (part - log_c)
        at -= 0.5 * z * z
        if prior.lapse < 0.0:
            at += log_logistic(x[p], a, b)
        terms.append(at)
        best = np.maximum(best, at)
    total = exp_of_minus(np.minimum(best - general, FARTHEST))
    for at in terms:
        total = total + exp_of_minus(np.minimum(best - at, FARTHEST))
    return np.asarray(best + elementwise(math.log, total))


def _slips(x: Floats, theta: Floats, prior: ParticlePrior) -> tuple[Floats, Floats]:
    """Return the lapses (q,) and the widths of EQUAL (q,) of particles, as ``density.slips``."""
    lapse, width = np.full(x.shape[1], prior.lapse), np.zeros(x.shape[1])
    if prior.lapse < 0.0:
        lapse = LEAST_LAPSE + (1.0 - LEAST_LAPSE) * logistic(x[len(theta)])
    if prior.tie > 0.0:
        share = np.minimum(1.0, prior.tie * odds(x[-1]))
        width = np.maximum(LEAST_WIDTH, in_order(theta) * share)
    return lapse, width


def log_logistic(u: Floats, a: float, b: float) -> Floats:
    """Return the log density (q,) of the logits u (q,) of a Beta(a, b) variate."""
    less = exp_of_minus(np.minimum(np.abs(u), FARTHEST))
    found: Floats = (
        a * np.minimum(u, 0.0)
        - b * np.maximum(u, 0.0)
        - (a + b) * elementwise(math.log, 1.0 + less)
    )
    return found


def logistic(u: Floats) -> Floats:
    """Return 1 / (1 + exp(-u)) of logits u (q,), as ``density.logistic``."""
    less = exp_of_minus(np.minimum(np.abs(u), FARTHEST))
    return np.asarray(np.where(u >= 0.0, 1.0, less) / (1.0 + less))


def odds(u: Floats) -> Floats:
    """Return the odds (q,) of log odds u (q,), as ``density.odds``."""
    less = exp_of_minus(np.minimum(np.abs(u), FARTHEST))
    return np.asarray(np.where(u >= 0.0, 1.0 / less, less))


def powered(
    theta: Floats,
    rows: Floats,
    tied: Any,
    n: int,
    last: float,
    lapse: Floats,
    width: Floats,
    least: Floats,
) -> Floats:
    """Return the log-likelihood (q,) of n answers for theta (p, q), as ``density.powered``."""
    if last == 1.0:
        return _log_likelihood(theta, rows, tied, 0, n, lapse, width, least)
    found = last * _log_likelihood(
        theta, rows, tied, n - 1, n, lapse, width, np.full(len(least), -np.inf)
    )
    return found + _log_likelihood(theta, rows, tied, 0, n - 1, lapse, width, least - found)


def _log_likelihood(
    theta: Floats,
    rows: Floats,
    tied: Any,
    first: int,
    end: int,
    lapse: Floats,
    width: Floats,
    least: Floats,
) -> Floats:
    """Return the log-likelihood (q,) of theta (p, q), as ``density.log_likelihood``."""
    p, total, low = len(theta), np.zeros(theta.shape[1]), np.zeros(theta.shape[1], dtype=np.bool_)
    for start in range(first, end, BLOCK):
        some = slice(start, min(end, start + BLOCK))
        eta = np.zeros((some.stop - start, len(total)))
        for j in range(0, p - 3, 4):
            a, b, c, d = (rows[i, some, None] * theta[i] for i in range(j, j + 4))
            eta += a + b + c + d
        for j in range(p - p % 4, p):
            eta += rows[j, some, None] * theta[j]
        total += _log_terms(eta, tied[some], lapse, width)
        low |= total < least
    total[low] = -np.inf
    return total


def _log_terms(eta: Floats, tied: Any, lapse: Floats, width: Floats) -> Floats:
    """Return the sums (q,) of ``log_term`` over a block of n answers with logits eta (n, q).

    Without a width of EQUAL the result is that of ``density.log_terms``. With one it is that of
    ``density.log_terms_apart``.
    """
    apart, sure, ties = bool(width[:1] > 0.0), 1.0 - lapse, tied[:, None]
    u = np.where(ties, width - np.abs(eta), eta - width) if apart else eta
    below = exp_of_minus(np.minimum(np.abs(u), FARTHEST))
    top = np.where(u >= 0.0, 1.0, below)
    if apart:
        equal = -elementwise(math.expm1, -2.0 * width)
        top = np.where(
            ties, top * (equal / (1.0 + exp_of_minus(np.minimum(2.0 * width - u, FARTHEST)))), top
        )
        share = np.where(ties, EQUAL_LAPSES, 0.5 * (1.0 - EQUAL_LAPSES))
        found = _log_quotient(share * lapse * (1.0 + below) + sure * top, below, 1e-30)
    else:
        even = 0.5 * lapse * (1.0 + below)
        top = np.where(ties, np.sqrt((even + sure) * (even + sure * below)), even + sure * top)
        found = _log_quotient(top, below, 1e-90)
    for i in np.flatnonzero((lapse == 0.0) & (np.abs(u) > FARTHEST).any(axis=0)):
        found[i] = sum(
            log_term(*each, lapse[i], width[i]) for each in zip(eta[:, i], tied, strict=True)
        )
    return found


def _log_quotient(top: Floats, below: Floats, low: float) -> Floats:
    """Return the logs (q,) of products of quotients (n, q), as ``density.log_quotient``.

    n is at most BLOCK.
    """
    above, under = np.ones((2, BLOCK, top.shape[1]))
    above[: len(top)], under[: len(top)] = top, below + 1.0
    for half in (BLOCK // 2, BLOCK // 4, BLOCK // 8):
        above[:half] *= above[half : 2 * half]
        under[:half] *= under[half : 2 * half]
    few, many, total = np.ones((3, top.shape[1]))
    total[:] = 0.0
    for i in range(BLOCK // 8):
        few *= under[i]
        many *= above[i]
        tiny = many < low
        if tiny.any():
            total[tiny] += elementwise(math.log, many[tiny])
            many[tiny] = 1.0
    found: Floats = total + elementwise(math.log, many) - elementwise(math.log, few)
    return found


def unit(h: Any) -> Floats:
    """Return hashes (m,) as numbers strictly between 0 and 1, as ``mcmc.unit``."""
    return np.asarray(((h >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53)


def in_order(terms: Floats) -> Floats:
    """Return the sums (q,) of terms (p, q), added from the first on."""
    total = np.zeros(terms.shape[1])
    for term in terms:
        total = total + term
    return total


def elementwise(function: Callable[[float], float], numbers: Floats) -> Floats:
    """Apply a function of ``math`` to each of the numbers (q,), and return the results.

    NumPy's own functions differ from those of ``math`` in their last bits.
    """
    return np.array([function(number) for number in numbers.tolist()])
