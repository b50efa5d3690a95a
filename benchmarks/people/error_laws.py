"""Laws of error: how the chance of an answer depends on two bags, for a person with a scale.

Each law gives P("left is better") for a scale, a precision, a lapse and a side bias. These are
drawn from a prior, many at once. A person's answers weight the draws, and the weighted mean is the
prediction: plain importance sampling, which needs no tuning and is exact for many draws. A prior of
people is the mean of what the answers of the choosing half say of the draws.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from benchmarks.people.choices import Bools, Choices
from elicit.comparators.bradley_terry.first_particles import CONCENTRATION, LAPSE, PRECISION
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats

SIDE = 0.5  # standard deviation of the side bias a priori, in logits
SPREAD_PRECISION = (np.log(10.0), 2.0)  # of log c a priori, where d.e is divided by a spread
UNIFORM = 0.05  # weight that a prior of people leaves to the prior before
STEPS = 2  # of the expectation-maximisation that finds a prior of people
_SMALL = 1e-9

Chances = NDArray[np.float32]


class Draws(NamedTuple):
    """Parameters (n,) and scales (n, k) from the prior; ``z`` is a standard normal for log c."""

    gaps: Floats
    values: Floats
    z: Floats
    lapse: Floats
    bias: Floats


class Law(NamedTuple):
    """A law of error: logits per draw and question, and whether it has a lapse and a side bias."""

    label: str
    logits: Callable[[Draws, Choices], Floats]
    lapse: bool = True
    bias: bool = False
    spread: bool = False  # whether the precision is in units of a spread


def draws(k: int, n: int, seed: int) -> Draws:
    """Return n draws from the prior of ``PosteriorComparator`` for k levels."""
    rng, p = np.random.default_rng(seed), k - 1
    low, high = np.log(np.array(CONCENTRATION) / p)
    shape = np.exp(rng.uniform(low, high, n))[:, None]
    logs = np.log(rng.standard_gamma(shape + 1.0, (n, p))) + np.log(rng.random((n, p))) / shape
    gaps = np.exp(logs - logs.max(axis=1, keepdims=True))
    gaps /= gaps.sum(axis=1, keepdims=True)
    values = np.concatenate([np.zeros((n, 1)), np.cumsum(gaps, axis=1)], axis=1)
    return Draws(gaps, values, rng.normal(size=n), rng.beta(*LAPSE, n), SIDE * rng.normal(size=n))


def difference(drawn: Draws, choices: Choices) -> Floats:
    """Return d.e (n, m) of each draw and question."""
    return np.asarray(drawn.gaps @ tail_sums(choices.d).T)


def log_precision(drawn: Draws, spread: bool) -> Floats:
    """Return log c (n,)."""
    mean, sd = SPREAD_PRECISION if spread else PRECISION
    return np.asarray(mean + sd * drawn.z)


def _plain(drawn: Draws, choices: Choices) -> Floats:
    return difference(drawn, choices)


def _sign(drawn: Draws, choices: Choices) -> Floats:
    return np.asarray(1e9 * np.sign(difference(drawn, choices)))


def _by_mass(drawn: Draws, choices: Choices) -> Floats:
    """d.e as a share of the probability in which the two bags differ."""
    return np.asarray(difference(drawn, choices) / np.abs(choices.d).sum(axis=1) * 2)


def _by_range(drawn: Draws, choices: Choices) -> Floats:
    """d.e as a share of the value range of the levels in either bag (Wilcox 2011)."""
    used = (choices.left + choices.right) > 1e-9
    low, high = used.argmax(axis=1), used.shape[1] - 1 - used[:, ::-1].argmax(axis=1)
    width = drawn.values[:, high] - drawn.values[:, low]
    return np.asarray(difference(drawn, choices) / np.maximum(width, 1e-6))


def spread_of(values: Floats, left: Floats, right: Floats) -> Floats:
    """Return the spread (n, m) of two bags: the root of their mean variance of value."""
    squares = values**2 @ (left + right).T / 2
    means = ((values @ left.T) ** 2 + (values @ right.T) ** 2) / 2
    return np.asarray(np.sqrt(np.maximum(squares - means, 1e-8)))


def _by_spread(drawn: Draws, choices: Choices) -> Floats:
    """d.e in units of the spread of the two bags (Busemeyer and Townsend 1993)."""
    spread = spread_of(drawn.values, choices.left, choices.right)
    return np.asarray(difference(drawn, choices) / spread)


def _by_own_spread(drawn: Draws, choices: Choices) -> Floats:
    """d.e in units of the spread of what the bags do not share, times the root of its mass: it
    needs the difference alone."""
    mass = np.abs(choices.d).sum(axis=1) / 2
    parts = (np.maximum(sign * choices.d, 0.0) / mass[:, None] for sign in (1, -1))
    spread = spread_of(drawn.values, *parts)
    return np.asarray(difference(drawn, choices) / (np.sqrt(mass) * np.maximum(spread, 0.05)))


LAWS = {
    "flips": Law("the same error rate everywhere", _sign),
    "logistic": Law("logistic in d.e", _plain, lapse=False),
    "logistic, lapse": Law("logistic in d.e, lapse (the product's)", _plain),
    "logistic, lapse, side": Law("logistic in d.e, lapse, side bias", _plain, bias=True),
    "mass": Law("logistic in d.e / differing mass, lapse", _by_mass, spread=True),
    "range": Law("logistic in d.e / value range of the pair, lapse", _by_range, spread=True),
    "spread, no lapse": Law(
        "logistic in d.e / spread of the pair", _by_spread, lapse=False, spread=True
    ),
    "spread": Law("logistic in d.e / spread of the pair, lapse", _by_spread, spread=True),
    "own spread": Law(
        "logistic in d.e / spread of what differs, lapse", _by_own_spread, spread=True
    ),
    "spread, side": Law(
        "logistic in d.e / spread, lapse, side bias", _by_spread, bias=True, spread=True
    ),
}


def chances(law: Law, drawn: Draws, choices: Choices) -> dict[int, Chances]:
    """Return P("left is better") (n, m) if left was shown first (1), and if right was (-1)."""
    precision = np.exp(np.minimum(log_precision(drawn, law.spread), 300.0))[:, None]
    logits = precision * law.logits(drawn, choices)
    lapse = drawn.lapse[:, None] if law.lapse else 0.0
    shifts = {side: side * drawn.bias[:, None] if law.bias else 0.0 for side in (1, -1)}
    return {
        side: (lapse / 2 + (1 - lapse) * expit(logits + shift)).astype(np.float32)
        for side, shift in shifts.items()
    }


def log_weights(by_side: dict[int, Chances], choices: Choices, taken: Bools) -> Floats:
    """Return the log-likelihood (draws, people) of the answers that are ``taken`` (n, m)."""
    total = np.zeros((len(by_side[1]), len(choices.names)), np.float32)
    said = np.nan_to_num(choices.said)
    for side, chance in by_side.items():
        mask = taken & choices.answered & (choices.side == side)
        yes, no = np.log(np.maximum(chance, _SMALL)), np.log(np.maximum(1 - chance, _SMALL))
        total += yes @ (mask * said).T.astype(np.float32)
        total += no @ (mask * (1 - said)).T.astype(np.float32)
    return np.asarray(total, dtype=np.float64)


def normalised(logs: Floats) -> Floats:
    """Return weights of total 1 a column."""
    weights = np.exp(logs - logs.max(axis=0))
    return np.asarray(weights / weights.sum(axis=0))


def prior_of_people(full: Floats, who: Bools) -> Floats:
    """Return the log prior (draws,) that the answers of these people suggest.

    ``full`` (draws, people) is the log-likelihood of all their answers.
    """
    n, prior = len(full), np.zeros(len(full))
    for _ in range(STEPS):
        pooled = normalised(full[:, who] + prior[:, None]).mean(axis=1)
        prior = np.log((1 - UNIFORM) * pooled + UNIFORM / n)
    return prior


def predicted(
    by_side: dict[int, Chances],
    choices: Choices,
    fold_of: NDArray[np.intp],
    who: Bools,
    prior: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Return P("left") (n, m) of each answer of these people by their other folds, nan elsewhere,
    and the effective numbers of draws behind the predictions (folds, people)."""
    found, sizes = np.full(choices.said.shape, np.nan), []
    for fold in range(int(fold_of.max()) + 1):
        logs = log_weights(by_side, choices, fold_of != fold)[:, who]
        weights = normalised(logs if prior is None else logs + prior[:, None])
        sizes.append(1.0 / (weights**2).sum(axis=0))
        for side, chance in by_side.items():
            here = (fold_of[who] == fold) & (choices.side[who] == side)
            at = found[who]
            at[here] = (weights.T.astype(np.float32) @ chance)[here]
            found[who] = at
    return found, np.array(sizes)
