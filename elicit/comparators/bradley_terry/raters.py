"""Several raters of one scale, each with their own precision, lapse and width of EQUAL.

A particle is a scale and three numbers for each rater. Its first p coordinates are the logs of the
gaps times a common precision c, as in ``smc``. Then come the three of each rater: log f, where f c
is the rater's own precision; the logit of their lapse; and the logarithm of the ratio of their
width to the median width.

A priori log f ~ N(0, SPREAD^2), and the variance of log c is smaller by SPREAD^2. So each rater
alone has the same prior as a single person, and the answers of some raters tell what to expect of
others (partial pooling). Lapses are independent. Given the scale, so are answers.

Particles are reweighted and resampled as in ``smc``. They move by Metropolis steps along the
difference of two particles of the other half (ter Braak 2006), so that one half moves at once. A
step changes the scale, all coordinates, or those of one rater. In the last case only that rater's
answers are looked at. Until the likelihood is compiled, NumPy computes it, with identical results.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, expit, logit, ndtri

from elicit._support.fixed_order import product
from elicit._support.hashing import fold
from elicit._support.jit import compiled_beside
from elicit.comparators.bradley_terry import mcmc_arrays
from elicit.comparators.bradley_terry.density import (
    BLOCK,
    FARTHEST,
    LEAST_LAPSE,
    LEAST_WIDTH,
    ParticlePrior,
    log_logistic,
    log_prior,
    powered,
)
from elicit.comparators.bradley_terry.mcmc_arrays import (
    SWAPS,
    elementwise,
    exchanges,
    in_order,
    logistic,
    odds,
    steps,
    unit,
)
from elicit.comparators.bradley_terry.smc import (
    ENOUGH,
    effective_size,
    features,
    remembered,
    resample,
    tempered,
    without_last_bits,
)
from elicit.model.scale import Floats

SPREAD = 1.74
"""Standard deviation a priori of the log of the precision among raters. It is that of the people of
public experiments (``elicit.tutors.person``)."""

OWN = 3  # coordinates of a rater
TURNS = 8  # turns of moves; in each, every part of a particle may change
_SCALE, _ALL, _SHIFT, _RATERS = range(4)  # parts of a turn; the raters follow one by one


class RaterArrays(NamedTuple):
    """Particles of several raters and the answers they have learned, as arrays.

    Attributes
    ----------
    x : (m, p + 3 r)
        The particles.
    logs : (m,)
        Their log weights.
    noise : (1,)
        As in ``smc.ParticleArrays``.
    rows : (p, n)
        The answers.
    tied : (n,)
        Flags of the answers that are EQUAL.
    by : (n,)
        The number of the rater who gave each answer.
    wide : (r,)
        Flags of the raters who have a width of EQUAL: they may call equal two things that are
        close.
    """

    x: Floats
    logs: Floats
    noise: Floats
    rows: Floats
    tied: NDArray[np.bool_]
    by: NDArray[np.int64]
    wide: tuple[bool, ...]


@dataclass(frozen=True)
class Reliability:
    """The reliability of one rater: three numbers, each with an interval.

    Attributes
    ----------
    answers : int
        Number of their answers.
    right : float
        Probability that they prefer the better of two bags whose values differ by a tenth of the
        value range. 1/2 is a coin toss.
    right_interval : (low, high)
    precision : float
        In logits per unit of d.e.
    precision_interval : (low, high)
    lapse : float
        Share of answers given at random.
    lapse_interval : (low, high)
    """

    answers: int
    right: float
    right_interval: tuple[float, float]
    precision: float
    precision_interval: tuple[float, float]
    lapse: float
    lapse_interval: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.right_interval
        most, least = self.lapse_interval[1], self.lapse_interval[0]
        return (
            f"right in {100 * self.right:.0f}% ({100 * low:.0f} to {100 * high:.0f}) where values "
            f"differ by a tenth of the range, {100 * self.lapse:.0f}% ({100 * least:.0f} to "
            f"{100 * most:.0f}) of answers at random, {self.answers} answers"
        )


_LEAST = 1e-300  # a given precision may be 0, which has no logarithm
NEAR = 0.1  # difference in value, a share of the range, for ``Reliability.right``


def learn(state: RaterArrays, n: int, prior: ParticlePrior, key: Any) -> tuple[int, int]:
    """Reweight particles by the last of n answers, and move them if few have weight.

    The arrays of ``state`` are changed. Return the numbers of moves proposed and accepted.
    """
    x, logs, noise, p = state.x, state.logs, state.noise, len(state.rows)
    m, who = len(x), int(state.by[n - 1])
    proposed, accepted, done, stage = 0, 0, 0.0, 0
    copied = np.empty(m, dtype=np.int64)
    while done < 1.0:
        told = _OneRater(state.rows[:, n - 1 : n], state.tied[n - 1 : n], 1.0)
        found = _terms(x, _of_scale(x, prior)[1], who, told, state.wide[who], prior)
        part = tempered(logs, found, 1.0 - done)
        done = 1.0 if part >= 1.0 - done else done + part
        logs += part * found
        if effective_size(logs) < ENOUGH * m or done < 1.0:
            target = elementwise(math.exp, logs - logs.max())
            here = fold(key, stage)
            resample(target, float(unit(fold(here, 0))), copied)
            x[:] = x[copied]
            logs[:] = 0.0
            # copies in excess of one: as in ``smc.learn``
            noise[0] += float((np.bincount(copied, minlength=m) ** 2).sum() - m) / m / m
            before = features(x, p, prior.fixed)
            tried, taken = move(state, n, done, prior, here, TURNS)
            proposed, accepted = proposed + tried, accepted + taken
            kept = remembered(before, features(x, p, prior.fixed))
            noise[0] = 1.0 / m + kept * (noise[0] - 1.0 / m)
            stage += 1
    return proposed, accepted


class Several(NamedTuple):
    """The raters by number: their names, and whether each has a width of EQUAL."""

    names: tuple[str | None, ...]
    wide: tuple[bool, ...]


class _OneRater(NamedTuple):
    """The answers of one rater. The last answer's likelihood is raised to the power ``last``."""

    rows: Floats
    tied: NDArray[np.bool_]
    last: float


def move(
    state: RaterArrays, n: int, last: float, prior: ParticlePrior, key: Any, turns: int
) -> tuple[int, int]:
    """Propose moves for each particle, ``turns`` times over, in place.

    The moves leave the posterior of the first n answers invariant. In it the last answer's
    likelihood is raised to the power ``last``. Return the numbers of moves proposed and accepted.
    """
    x, p, m = state.x, len(state.rows), len(state.x)
    told = []
    for number in range(len(state.wide)):
        own = np.flatnonzero(state.by[:n] == number)
        power = last if number == state.by[n - 1] else 1.0
        told.append(_OneRater(np.ascontiguousarray(state.rows[:, own]), state.tied[own], power))

    def terms(some: Floats, theta: Floats, number: int) -> Floats:
        return _terms(some, theta, number, told[number], state.wide[number], prior)

    raters = range(len(told))
    scale_prior, theta = _of_scale(x, prior)
    # the first row is the scale's, and the others are the raters'
    priors = np.stack([scale_prior, *(_of_rater(x, number, prior) for number in raters)])
    logs = np.stack([terms(x, theta, number) for number in raters])
    proposed = accepted = 0
    for turn in range(turns):
        for part in range(_RATERS + len(told)):
            if part == _SHIFT and prior.fixed > 0.0:
                continue
            for half in (0, 1):
                at = np.arange(half, m, 2)
                h = fold(key, 1 + turn, part, at)
                u = [unit(fold(h, j)) for j in range(10)]
                first, second = _two_of(np.arange(1 - half, m, 2), u[2], u[3])
                proposal = _proposal(x[at], x[first], x[second], p, part, u)
                prior_of, theta_of, found = priors[:, at].copy(), theta[:, at], logs[:, at].copy()
                if part < _RATERS:
                    prior_of[0], theta_of = _of_scale(proposal, prior)
                if part != _SCALE:
                    for number in (part - _RATERS,) if part >= _RATERS else raters:
                        prior_of[1 + number] = _of_rater(proposal, number, prior)
                some = np.flatnonzero(prior_of[0] > -np.inf)
                if part != _SHIFT:  # a shift changes no likelihood
                    for number in (part - _RATERS,) if part >= _RATERS else raters:
                        found[number, some] = terms(proposal[some], theta_of[:, some], number)
                gain = in_order(prior_of) - in_order(priors[:, at])
                gain += in_order(found) - in_order(logs[:, at])
                taken = elementwise(math.log, u[1]) <= gain
                new = at[taken]
                x[new], theta[:, new] = proposal[taken], theta_of[:, taken]
                priors[:, new], logs[:, new] = prior_of[:, taken], found[:, taken]
                proposed, accepted = proposed + len(at), accepted + int(taken.sum())
    return proposed, accepted


def _two_of(others: NDArray[np.int64], u: Floats, v: Floats) -> tuple[Any, Any]:
    """Return two different entries of ``others`` for each pair of uniform numbers u, v (q,)."""
    first = (u * len(others)).astype(np.int64)
    second = (v * (len(others) - 1)).astype(np.int64)
    second += second >= first
    return others[first], others[second]


def _proposal(x: Floats, a: Floats, b: Floats, p: int, part: int, u: list[Floats]) -> Floats:
    """Return a proposal for each particle x (q, size): a step along the difference of a and b.

    The particles a and b (q, size) are of the other half. ``part`` says which coordinates change.
    """
    proposal, size = x.copy(), x.shape[1]
    if part == _SCALE:
        proposal[:, :p] = steps(x[:, :p], a[:, :p], b[:, :p], p, u)[0]
        if p > 1:
            swapped = exchanges(x[:, :p], p, u)[0]
            proposal[:, :p] = np.where((u[0] < SWAPS)[:, None], swapped, proposal[:, :p])
        return proposal
    if part == _SHIFT:
        # a shift of the common precision against the raters' own changes none of the likelihoods
        by = 2.0 * u[8] * (a[:, :p].max(axis=1) - b[:, :p].max(axis=1))
        proposal[:, :p] += by[:, None]
        proposal[:, p::OWN] -= by[:, None]
        return proposal
    first = 0 if part == _ALL else p + OWN * (part - _RATERS)
    last = size if part == _ALL else first + OWN
    usual = 2.38 / math.sqrt(2.0 * (last - first)) * (0.5 + u[8])
    # one step in ten is a whole difference, which leaps between modes
    length = np.where(u[7] < 0.1, 1.0, usual)
    proposal[:, first:last] += length[:, None] * (a[:, first:last] - b[:, first:last])
    return proposal


def of_several(prior: ParticlePrior, tie: float) -> ParticlePrior:
    """Return a single person's prior changed into that of several people.

    The median of their widths of EQUAL is ``tie``.
    """
    return prior._replace(sd=math.sqrt(prior.sd**2 - SPREAD**2), tie=tie)


def of_the_scale(prior: ParticlePrior) -> ParticlePrior:
    """Return the part of a prior that is about the scale and the common precision."""
    return prior._replace(lapse=max(0.0, prior.lapse), tie=0.0)


def newcomer(prior: ParticlePrior, m: int, seed: int) -> Floats:
    """Draw a rater's three coordinates from the prior, (m, 3) for m particles."""
    rng = np.random.Generator(np.random.Philox(seed))
    factor, lapse, width = ((rng.permutation(m) + rng.random(m)) / m for _ in range(OWN))
    lapses = betaincinv(prior.lapse_a, prior.lapse_b, lapse)
    return np.asarray(
        without_last_bits(np.column_stack([SPREAD * ndtri(factor), logit(lapses), logit(width)]))
    )


def _of_scale(x: Floats, prior: ParticlePrior) -> tuple[Floats, Floats]:
    """Return the log prior density (q,) of the particles' scales and common precisions.

    It is up to a constant. The particles are x (q, p + 3 r). The second result is theta (p, q), the
    gaps times the common precision.
    """
    p = prior.above.shape[1]
    theta = np.empty((p, len(x)))
    return log_priors(np.ascontiguousarray(x[:, :p]), of_the_scale(prior), theta), theta


def _of_rater(x: Floats, number: int, prior: ParticlePrior) -> Floats:
    """Return the log prior density (q,) of one rater's coordinates, up to a constant."""
    first = prior.above.shape[1] + OWN * number
    own = np.ascontiguousarray(x[:, first : first + OWN])
    return np.asarray(log_priors_of_raters(own, prior.lapse_a, prior.lapse_b))


def parameters(
    x: Floats, common: Floats, number: int, wide: bool, prior: ParticlePrior
) -> tuple[Floats, Floats, Floats]:
    """Return one rater's factor f, lapse, and width of EQUAL in logits, (q,) each.

    Parameters
    ----------
    x : (q, p + 3 r)
    common : (q,)
        The common precision.
    number : int
        Number of the rater.
    wide : bool
        True if the rater may call equal two things that are close.
    prior : ParticlePrior
        The prior made by ``of_several``. A precision or lapse known in it is that of every rater.
    """
    p = prior.above.shape[1]
    first = p + OWN * number
    factor, lapse, width = np.ones(len(x)), np.full(len(x), prior.lapse), np.zeros(len(x))
    if prior.fixed == 0.0:
        factor = elementwise(math.exp, np.clip(x[:, first], -FARTHEST, FARTHEST))
    if prior.lapse < 0.0:
        lapse = LEAST_LAPSE + (1.0 - LEAST_LAPSE) * logistic(x[:, first + 1])
    if wide:
        share = np.minimum(1.0, prior.tie * odds(x[:, first + 2]))
        width = np.maximum(LEAST_WIDTH, factor * common * share)
    return factor, lapse, width


def _terms(
    x: Floats, theta: Floats, number: int, told: _OneRater, wide: bool, prior: ParticlePrior
) -> Floats:
    """Return the log-likelihood (q,) of one rater's answers ``told``, for particles x."""
    n = told.rows.shape[1]
    if n == 0 or not len(x):
        return np.zeros(len(x))
    factor, lapse, width = parameters(x, in_order(theta), number, wide, prior)
    rows = np.ascontiguousarray(told.rows)
    return np.asarray(
        log_likelihoods(
            np.ascontiguousarray(theta * factor), rows, told.tied, n, told.last, lapse, width
        )
    )


def reliability_of(
    precision: Floats, lapse: Floats, weights: Floats, answers: int, level: float
) -> Reliability:
    """Return a rater's reliability from weighted draws (q,) of their precision and lapse.

    Each interval reaches from the (1 - level) quantile to the level quantile.
    """
    right = lapse / 2.0 + (1.0 - lapse) * expit(NEAR * precision)
    middle = np.exp(product(np.log(np.maximum(precision, _LEAST)), weights))
    return Reliability(
        answers,
        float(product(right, weights)),
        _interval(right, weights, level),
        float(middle),
        _interval(precision, weights, level),
        float(product(lapse, weights)),
        _interval(lapse, weights, level),
    )


def _interval(numbers: Floats, weights: Floats, level: float) -> tuple[float, float]:
    """Return the (1 - level) quantile and the level quantile of weighted numbers."""
    order = np.argsort(numbers, kind="stable")
    below = np.cumsum(weights[order])
    low, high = np.searchsorted(below, [1.0 - level, level])
    return float(numbers[order[low]]), float(numbers[order[min(high, len(order) - 1)]])


def _likelihoods_of_arrays(
    theta: Floats, rows: Floats, tied: Any, n: int, last: float, lapse: Floats, width: Floats
) -> Floats:
    """Compute ``log_likelihoods`` in NumPy."""
    least = np.full(theta.shape[1], -np.inf)
    return mcmc_arrays.powered(theta, rows, tied, n, last, lapse, width, least)


@compiled_beside(_likelihoods_of_arrays)
def log_likelihoods(
    theta: Any, rows: Any, tied: Any, n: int, last: float, lapse: Any, width: Any
) -> Any:
    """Return the log-likelihood (q,) of n answers, rows (p, >= n), for each theta (p, q)."""
    p, q = theta.shape
    out, one, work = np.empty(q), np.empty(p), np.empty((2, BLOCK))
    for i in range(q):
        for j in range(p):
            one[j] = theta[j, i]
        out[i] = powered(one, rows, tied, n, last, lapse[i], width[i], -math.inf, work)
    return out


def _priors_of_arrays(x: Floats, prior: ParticlePrior, theta: Floats) -> Floats:
    """Compute ``log_priors`` in NumPy."""
    found, theta[:] = mcmc_arrays.log_prior(x.T, x.shape[1], prior)
    return found


@compiled_beside(_priors_of_arrays)
def log_priors(x: Any, prior: ParticlePrior, theta: Any) -> Any:
    """Return the log prior density (q,) of x (q, p), and write theta into ``theta`` (p, q)."""
    q, p = x.shape
    out, one, work = np.empty(q), np.empty(p), np.empty((2, BLOCK))
    for i in range(q):
        out[i] = log_prior(x[i], prior, one, work)
        for j in range(p):
            theta[j, i] = one[j]
    return out


def _raters_of_arrays(own: Floats, a: float, b: float) -> Floats:
    """Compute ``log_priors_of_raters`` in NumPy."""
    z, lapse, width = own.T
    z = z / SPREAD
    found = mcmc_arrays.log_logistic(lapse, a, b) + mcmc_arrays.log_logistic(width, 1.0, 1.0)
    return np.asarray(found - 0.5 * z * z)


@compiled_beside(_raters_of_arrays)
def log_priors_of_raters(own: Any, a: float, b: float) -> Any:
    """Return the log prior density (q,) of a rater's coordinates (q, 3), up to a constant."""
    out = np.empty(len(own))
    for i in range(len(own)):
        z = own[i, 0] / SPREAD
        out[i] = log_logistic(own[i, 1], a, b) + log_logistic(own[i, 2], 1.0, 1.0) - 0.5 * z * z
    return out
