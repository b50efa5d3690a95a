"""Choices of people as arrays, their two halves, and scores of predicted answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit.model.scale import Floats
from elicit.tutors.answer_log import AnswerLog

SPLIT_SEED = 1
"""Draws the half of the people on whom anything is chosen. The others are only reported on."""

RESAMPLES = 2000
BINS = 10  # of the probability of an answer, for the calibration error
LEAST = 1e-9  # probability that a wrong certainty counts as

Bools = NDArray[np.bool_]


class Choices(NamedTuple):
    """Answers of n people to m questions.

    left, right (m, k) are share vectors. ``said`` (n, m) is 1 for left, 0 for right, nan where
    there is no answer. ``side`` (n, m) is 1 if left was shown first, -1 if right was.
    """

    names: list[str]
    left: Floats
    right: Floats
    amounts: Floats
    said: Floats
    side: Floats

    @property
    def d(self) -> Floats:
        """Differences (m, k)."""
        return self.left - self.right

    @property
    def answered(self) -> Bools:
        """Flags (n, m) of the answers that there are."""
        return np.asarray(~np.isnan(self.said))


def choices_of(logs: Mapping[str, AnswerLog]) -> Choices:
    """Return the answers of people who were put the same questions, each once."""
    names, questions = sorted(logs), dict[str, int]()
    for name in names:
        for entry in logs[name]:
            questions.setdefault(entry.answer.query.id, len(questions))
    k, shape = logs[names[0]].k, (len(names), len(questions))
    left, right = np.zeros((shape[1], k or 0)), np.zeros((shape[1], k or 0))
    said, side = np.full(shape, np.nan), np.ones(shape)
    for i, name in enumerate(names):
        for entry in logs[name]:
            answer, j = entry.answer, questions[entry.answer.query.id]
            left[j], right[j] = answer.query.left, answer.query.right
            said[i, j] = float(answer.verdict == 1)
            side[i, j] = -1.0 if answer.swapped else 1.0
    amounts = np.array(logs[names[0]].header["amounts"], dtype=np.float64)
    return Choices(names, left, right, amounts, said, side)


def choosing_half(n: int) -> Bools:
    """Return which of n people, in the order of their names, choices may be made on."""
    return np.asarray(np.random.default_rng(SPLIT_SEED).permutation(n) < (n + 1) // 2)


def deal(n: int, m: int, folds: int, seed: int) -> NDArray[np.intp]:
    """Return the fold (n, m) of each person's answer to each question."""
    ranks = np.argsort(np.argsort(np.random.default_rng(seed).random((n, m)), axis=1), axis=1)
    return np.asarray(ranks % folds)


def log_likelihood(chance: Floats, said: Floats) -> float:
    """Return the mean log-probability of the answers, of the probability of "left"."""
    clear = ~np.isnan(said) & ~np.isnan(chance)
    given = np.where(said[clear] == 1, chance[clear], 1.0 - chance[clear])
    return float(np.log(np.maximum(given, LEAST)).mean())


def calibration_error(chance: Floats, said: Floats) -> float:
    """Return the expected calibration error: how far the share of "left" is from its probability,
    in ten equal bins of the probability, weighted by the answers in them."""
    clear = ~np.isnan(said) & ~np.isnan(chance)
    p, y = chance[clear], said[clear]
    bins = np.minimum((p * BINS).astype(int), BINS - 1)
    return float(np.abs(np.bincount(bins, p - y, BINS)).sum() / len(p))


def agreement(chance: Floats, said: Floats) -> float:
    """Return the share of answers on the side that was the more probable; 1/2 counts half."""
    clear = ~np.isnan(said) & ~np.isnan(chance)
    return float((1 + np.sign(chance[clear] - 0.5) * (2 * said[clear] - 1)).mean() / 2)


def over_people(
    statistic: Callable[[NDArray[np.intp]], float], n: int, seed: int = 0
) -> tuple[float, float, float]:
    """Return a statistic of all n people, and its 95% interval by a bootstrap over people."""
    rng = np.random.default_rng(seed)
    drawn = [statistic(rng.integers(0, n, n)) for _ in range(RESAMPLES)]
    found = [x for x in drawn if not np.isnan(x)]
    low, high = np.quantile(found, [0.025, 0.975]) if found else (np.nan, np.nan)
    return statistic(np.arange(n)), float(low), float(high)


def shown(estimate: Sequence[float], digits: int = 3, percent: bool = False) -> str:
    """Return an estimate with its interval as text."""
    factor, unit = (100.0, "%") if percent else (1.0, "")
    value, low, high = (f"{factor * x + 0.0:.{digits}f}" for x in estimate)
    return f"{value}{unit} [{low}, {high}]"
