"""The prior over scales and tutors, and the first particles, which are drawn from it."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import betaincinv, gammaln, logit, ndtri

from elicit._support.fixed_order import product
from elicit._support.hashing import fold
from elicit.comparators.bradley_terry.density import ParticlePrior
from elicit.comparators.bradley_terry.earlier_people import EarlierPeople, drawn, log_dirichlet
from elicit.comparators.bradley_terry.mcmc import move
from elicit.comparators.bradley_terry.smc import SWEEPS, without_last_bits
from elicit.lp.infeasibility import is_empty
from elicit.lp.prior_inequalities import Prior
from elicit.lp.region import Region, prior_rows
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats

_THIN = 1e-12  # narrower sets of scales have no room for particles, only for rounding
_NODES = 16  # nodes of the quadrature over the prior's shape
PRECISION = (math.log(30.0), 2.5)
"""Mean and standard deviation of log c a priori, c in logits per unit of d.e."""


CONCENTRATION = (0.2, 2.0)
"""Least and greatest sum of the Dirichlet parameters of the gaps a priori. The range is one of the
sum, not of each parameter. With a range of each parameter, more levels would decide more before any
answer, wrongly on scales of a few large gaps. With a fixed sum, levels added in between leave the
law of the others as it was (Ferguson 1973)."""


LAPSE = (1.0, 4.0)
"""A priori the lapse is Beta with these two parameters. No lapse is the most likely, a fifth the
mean, and .6 (a tutor who flips three answers in ten) still plausible. ``tutor_report`` has the same
prior."""


def prior_law(
    k: int,
    shape: tuple[float, float],
    precision: float | None,
    lapse: float | None,
    inequalities: Prior | None,
) -> ParticlePrior:
    """Return the prior's density, for a tutor who calls nothing equal.

    The integral over Dirichlet shapes a is computed by Gauss-Legendre quadrature in log a. A
    precision or lapse of None is to be learned.
    """
    p, (low, high) = k - 1, shape
    nodes, mass = np.polynomial.legendre.leggauss(1 if low == high else _NODES)
    shapes = np.exp(np.log(low) + (nodes + 1) / 2 * np.log(high / low))
    above, limits = np.empty((0, p)), np.empty(0)
    if inequalities is not None:
        above, limits = np.ascontiguousarray(tail_sums(inequalities.a)), inequalities.b
    mean, sd = PRECISION
    lapse_a, lapse_b = LAPSE
    return ParticlePrior(
        shapes=shapes,
        constants=np.log(mass) + gammaln(p * shapes) - p * gammaln(shapes),
        mean=mean,
        sd=sd,
        fixed=precision or 0.0,
        lapse=-1.0 if lapse is None else lapse,
        lapse_a=lapse_a,
        lapse_b=lapse_b,
        tie=0.0,
        above=above,
        limits=limits,
        general=0.0,
        kinds=np.empty((0, p + 5)),
    )


def first_particles(
    key: int,
    m: int,
    shape: tuple[float, float],
    prior: ParticlePrior,
    inequalities: Prior | None,
    like: EarlierPeople | None,
) -> Floats:
    """Return particles (m, >= p) drawn from a prior.

    The first p columns are the logs of gaps times precision. A learned lapse and a learned width of
    EQUAL have a further column each, as logits.

    Parameters
    ----------
    key : int
        Seed of the draws.
    m : int
    shape : (low, high)
        Range of the Dirichlet parameter of the gaps.
    prior : ParticlePrior
    inequalities : Prior, optional
    like : EarlierPeople, optional
        Some of the particles are drawn from the kinds of earlier people.

    Raises
    ------
    ValueError
        If no scale satisfies the inequalities, or too few do.
    """
    rng, p = np.random.Generator(np.random.Philox(key)), prior.above.shape[1]
    spread = (rng.permutation(m) + rng.random(m)) / m  # stratified
    a = np.exp(np.log(shape[0]) + spread * np.log(shape[1] / shape[0]))[:, None]
    x = log_dirichlet(rng, np.broadcast_to(a, (m, p)))
    log_c = prior.mean + prior.sd * ndtri((rng.permutation(m) + rng.random(m)) / m)
    x = x + log_c[:, None]
    slips = [
        logit(betaincinv(*law, (rng.permutation(m) + rng.random(m)) / m))[:, None]
        for learned, law in ((prior.lapse < 0, LAPSE), (prior.tie > 0, (1.0, 1.0)))
        if learned
    ]
    if like is not None:
        of, draws = drawn(like, rng, m)
        for i, (log_gaps, log_precision, lapse) in enumerate(draws):
            x[of == i] = log_gaps + log_precision[:, None]
            if prior.lapse < 0:
                slips[0][of == i, 0] = logit(np.clip(lapse, 1e-300, 1.0 - 1e-16))
    x = without_last_bits(np.concatenate([x, *slips], axis=1))
    if inequalities is None:
        return np.ascontiguousarray(x)
    # a lapse moves with the scale only where earlier people tell of both; a width never does
    moved = p if like is None else x.shape[1] - (prior.tie > 0)
    inside = _within(np.ascontiguousarray(x[:, :moved]), key, prior, inequalities)
    return np.ascontiguousarray(np.concatenate([inside, x[:, moved:]], axis=1))


def _within(x: Floats, key: int, prior: ParticlePrior, inequalities: Prior) -> Floats:
    """Return particles x of a prior, moved to where its inequalities hold.

    They move through nested sets, each of which holds half of the particles of the one before
    (subset simulation, Au and Beck 2001). Raise ValueError if no scale satisfies the inequalities,
    or too few do.
    """
    m, p = len(x), prior.above.shape[1]
    if is_empty(Region(0.0, *prior_rows(inequalities, p + 1))) is not None:
        raise ValueError(
            f"no scale satisfies the prior's inequalities together, {'; '.join(inequalities.names)}"
        )
    above, limits = prior.above, prior.limits
    law = prior._replace(tie=0.0)
    if x.shape[1] == p:
        law = law._replace(lapse=max(0.0, law.lapse))
    nothing, untied = np.zeros((p, 1)), np.zeros(1, dtype=np.bool_)
    for stage in range(200):
        theta = np.exp(x[:, :p] - x[:, :p].max(axis=1, keepdims=True))
        short = (limits - product(theta / theta.sum(axis=1, keepdims=True), above.T)).max(axis=1)
        if (short <= 0).all():
            return x
        gap = max(0.0, float(np.median(short)))
        if 0.0 < gap < _THIN:
            break
        x = x[np.resize(np.flatnonzero(short <= gap), m)].copy()
        eased = law._replace(limits=limits - gap)
        with np.errstate(all="ignore"):
            move(x, nothing, untied, 1, 1.0, eased, fold(np.uint64(key), m, stage)[()], SWEEPS)
    raise ValueError(
        f"the prior's inequalities, {'; '.join(inequalities.names)}, leave too little room to draw "
        "scales from: relax some of them"
    )
