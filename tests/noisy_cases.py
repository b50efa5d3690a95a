"""Differences, scales and answers of tutors who err, and the posterior's formulas written once
more.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logsumexp

from elicit import (
    AlwaysAsk,
    Answers,
    BradleyTerryComparator,
    Comparator,
    Dominance,
    PolytopeComparator,
    PosteriorComparator,
    Verdict,
)
from elicit.comparators.bradley_terry.density import ParticlePrior
from tests.scale_arithmetic import dominance, tail_sums

Floats = NDArray[np.float64]
Rng = np.random.Generator
MEAN, SD = math.log(30.0), 2.5  # of log c a priori
COMPARATORS: dict[str, Callable[..., Comparator]] = {
    "always ask": AlwaysAsk,
    "dominance": Dominance,
    "polytope": PolytopeComparator,
    "polytope, margin 0": partial(PolytopeComparator, margin=0.0),
    "ensemble": partial(BradleyTerryComparator, n_boot=20, region="ensemble"),
    "box": partial(BradleyTerryComparator, n_boot=20, region="box"),
    "posterior": partial(PosteriorComparator, particles=60),
}


def differences(rng: Rng, k: int, n: int) -> Floats:
    d: Floats = rng.dirichlet(np.ones(k), n) - rng.dirichlet(np.ones(k), n)
    return d


def pairs(rng: Rng, k: int, n: int) -> Floats:
    """n differences that dominance leaves open."""
    d = differences(rng, k, 20 * n + 20)
    return np.asarray(d[dominance(tail_sums(d)) == Verdict.UNKNOWN][:n])


def log_gaps(rng: Rng, k: int, m: int, shape: tuple[float, float] | None = None) -> Floats:
    """Logarithms of gaps (m, k - 1) from a prior's shapes, or from those of the default prior."""
    a = np.exp(rng.uniform(*np.log(shape or (0.2 / (k - 1), 2.0 / (k - 1))), (m, 1)))
    log_gamma = np.log(rng.standard_gamma(a + 1.0, (m, k - 1))) + np.log(rng.random((m, k - 1))) / a
    return np.asarray(log_gamma - logsumexp(log_gamma, axis=1, keepdims=True))


def drawn_gaps(rng: Rng, k: int, m: int = 1) -> Floats:
    """Gaps (m, k - 1) from the default prior."""
    return np.asarray(np.exp(log_gaps(rng, k, m)))


def widths_of(tie: float, u: Any) -> Floats:
    """Widths of EQUAL, shares of the value range, at quantiles u (m,) of their prior."""
    return np.asarray(np.minimum(1.0, tie * u / (1.0 - u)))


def log_terms(theta: Floats, t: Floats, tied: Any, lapse: Any, width: Any = 0.0) -> Floats:
    """Log-likelihoods (m, n) at theta (m, p) of answers with tail sums t (n, p), turned to the side
    that was said to be better; where ``tied`` (n,) half an answer each way, or with a width, in
    logits, by Rao and Kupper's formula. Lapse and width are numbers, or (m,)."""
    eta, q, s = theta @ t.T, np.asarray(lapse)[..., None], np.asarray(width)[..., None]
    if s.any():
        equal = -np.expm1(-2 * s) * expit(s - np.abs(eta)) * expit(s + np.abs(eta))
        at_random, clear = np.where(tied, 0.01, 0.495), np.where(tied, equal, expit(eta - s))
        return np.asarray(np.log(q * at_random + (1 - q) * clear))
    if q.any():
        yes, no = (np.log(q / 2 + (1 - q) * expit(sign * eta)) for sign in (1, -1))
    else:
        yes, no = -np.logaddexp(0, -eta), -np.logaddexp(0, eta)
    return np.asarray(np.where(tied, (yes + no) / 2, yes))


def prior_of(k: int, **settings: Any) -> ParticlePrior:
    """The density that a comparator's particles have before any answer; by default with a given
    lapse.
    """
    return PosteriorComparator(k, **({"lapse": 0.05} | settings))._prior


def learned(particles: int, n: int) -> list[str]:
    """Return all results of a few small comparators after n answers, to the last bit."""
    rng, lines = np.random.default_rng(5), []
    d = rng.dirichlet(np.ones(4), n) - rng.dirichlet(np.ones(4), n)
    y = np.sign(d @ [0, 0.2, 0.5, 1.0]).astype(int) * (np.arange(n) % 5 > 0)
    settings: tuple[dict[str, Any], ...] = (
        {},
        {"precision": 30.0, "lapse": 0.0},
        {"lapse": 0.05, "prior": "e3 >= 0.4", "shape": (1.0, 1.0), "tie": 0.0},
    )
    for more in settings:
        c = PosteriorComparator(4, particles=particles, seed=3, **more).update(Answers(d, y))
        lines.append(
            f"{[part.tobytes().hex() for part in c.draws]} {c.proposed} {c.accepted} "
            f"{c.effective_size}"
        )
        lines.append(f"{c.compare(d).tolist()} {c.probability(d).tobytes().hex()}")
    return lines
