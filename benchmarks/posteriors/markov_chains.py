"""The posterior of ``PosteriorComparator`` by two samplers that are made for any posterior, for
comparison with it.

Same likelihood, same prior, as its module states them: P(left is better) = l/2 + (1 - l) sigma(c
d.e); gaps Dirichlet(a), log a uniform; log c normal; the lapse l Beta. A point x (k + 1,) holds log
theta = log(c g) (k - 1,), then the logits of where log a lies in its interval and of the lapse.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import digamma, expit, gammaln, log_expit

from elicit.comparators.bradley_terry.first_particles import CONCENTRATION, LAPSE, PRECISION
from elicit.model.difference import tail_sums
from elicit.model.query import Answers
from elicit.model.scale import Floats

Density = Callable[
    [Floats], tuple[Floats, Floats]
]  # of points (w, k + 1): log densities (w,), slopes (w, k + 1)


class Scales(NamedTuple):
    """Draws of scales: gaps (m, p) of total 1, and under each the tutor's precision (m,) and lapse
    (m,).
    """

    gaps: Floats
    precision: Floats
    lapse: Floats


def log_posterior(answers: Answers) -> Density:
    """The log density up to a constant, and its gradient; answers that are no ties."""
    t = tail_sums(answers.d) * answers.y[:, None]
    p, (low, high) = t.shape[1], np.log(np.array(CONCENTRATION) / t.shape[1])

    def density(x: Floats) -> tuple[Floats, Floats]:
        log_theta, u, v = x[:, :p], x[:, p], x[:, p + 1]
        most = log_theta.max(axis=1)
        log_c = most + np.log(np.exp(log_theta - most[:, None]).sum(axis=1))
        gaps = np.exp(log_theta - log_c[:, None])
        a, lapse = np.exp(low + (high - low) * expit(u)), expit(v)
        total = log_theta.sum(axis=1) - p * log_c  # of log g
        off = (log_c - PRECISION[0]) / PRECISION[1]
        log_prior = gammaln(p * a) - p * gammaln(a) + a * total - 0.5 * off**2
        log_prior += (
            log_expit(u) + log_expit(-u) + LAPSE[0] * log_expit(v) + LAPSE[1] * log_expit(-v)
        )
        theta = np.exp(np.minimum(log_theta, 300.0))
        s = expit(theta @ t.T)
        chance = np.maximum(lapse[:, None] / 2 + (1 - lapse[:, None]) * s, 1e-300)
        rate = (1 - lapse[:, None]) * s * (1 - s) / chance
        slope = np.empty_like(x)
        slope[:, :p] = (
            a[:, None] * (1 - p * gaps) - (off / PRECISION[1])[:, None] * gaps + (rate @ t) * theta
        )
        by_a = p * digamma(p * a) - p * digamma(a) + total
        slope[:, p] = by_a * a * (high - low) * expit(u) * expit(-u) + 1 - 2 * expit(u)
        by_lapse = ((0.5 - s) / chance).sum(axis=1)
        slope[:, p + 1] = by_lapse * lapse * (1 - lapse) + LAPSE[0] * (1 - lapse) - LAPSE[1] * lapse
        return log_prior + np.log(chance).sum(axis=1), slope

    return density


def start(k: int, how_many: int, rng: np.random.Generator) -> Floats:
    """Points (how_many, k + 1) near even gaps, the prior's middle precision and its mean lapse."""
    x = 0.3 * rng.standard_normal((how_many, k + 1))
    x[:, : k - 1] += PRECISION[0] - np.log(k - 1)
    x[:, k] += np.log(LAPSE[0] / LAPSE[1])
    return x


def scales(x: Floats) -> Scales:
    """Return the scales, precisions and lapses of points (m, k + 1)."""
    p = x.shape[1] - 2
    theta = np.exp(np.minimum(x[:, :p], 300.0))
    c = theta.sum(axis=1)
    return Scales(theta / c[:, None], c, expit(x[:, p + 1]))


def hamiltonian(
    density: Density, x: Floats, warm_up: int, draws: int, rng: np.random.Generator, leaps: int = 16
) -> tuple[Floats, float]:
    """Plain Hamiltonian Monte Carlo (Duane et al. 1987; Neal 2011): chains x (w, n) side by side,
    each move up to 2 ``leaps`` leapfrog steps, diagonal masses and a common step adapted during the
    warm-up (Hoffman and Gelman's dual averaging for an acceptance of .8). The states (draws, w, n)
    after it, and the share of moves accepted."""
    size, log_mean, gap = 0.1, np.log(0.1), 0.0
    scale = np.ones(x.shape[1])
    at, slope = density(x)
    kept, accepted, seen = np.empty((draws, *x.shape)), 0.0, []
    for i in range(warm_up + draws):
        momentum = rng.standard_normal(x.shape)
        step, y, there, push = size * scale, x, at, slope
        moved = momentum + 0.5 * step * push
        steps = int(rng.integers(1, 2 * leaps + 1))
        for j in range(steps):
            y = y + step * moved
            there, push = density(y)
            moved = moved + (1.0 if j < steps - 1 else 0.5) * step * push
        gain = there - at - 0.5 * ((moved**2).sum(axis=1) - (momentum**2).sum(axis=1))
        chance = np.where(np.isfinite(gain), np.exp(np.minimum(gain, 0.0)), 0.0)
        takes = rng.random(len(x)) < chance
        x, at = np.where(takes[:, None], y, x), np.where(takes, there, at)
        slope = np.where(takes[:, None], push, slope)
        if i < warm_up:
            n = i + 1
            gap += (0.8 - chance.mean() - gap) / (n + 10)
            log_size = -np.sqrt(n) / 0.05 * gap
            log_mean += n**-0.75 * (log_size - log_mean)
            size = float(np.exp(np.clip(log_size if n < warm_up else log_mean, -12.0, 1.0)))
            seen.append(x)
            if n in (
                warm_up // 4,
                warm_up // 2,
            ):  # the scales of the coordinates, from what was seen since
                scale, gap = (
                    np.maximum(np.concatenate(seen[len(seen) // 2 :]).std(axis=0), 1e-3),
                    0.0,
                )
        else:
            kept[i - warm_up] = x
            accepted += chance.mean() / draws
    return kept, accepted
