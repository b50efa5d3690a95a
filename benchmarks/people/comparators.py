"""Comparators and plain rivals on people's held-out answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.people.choices import Bools, Choices
from elicit.comparators.bradley_terry.bootstrap_comparator import BradleyTerryComparator
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator, learn
from elicit.model.difference import tail_sums
from elicit.model.pairs import pair_numbers
from elicit.model.query import Answers, Query, Verdict
from elicit.model.scale import Floats
from elicit.people.repeated_answers import RepeatedAnswersTutor
from elicit.tutors.answer_log import AnswerLog

STRENGTHS = (
    0.3,
    1.0,
    3.0,
    10.0,
    30.0,
)  # inverse ridge of the logistic fits, of which one is chosen
TIMES = 3  # answers to each training pair of repeated gambles
MAKES: Mapping[str, Callable[[int], Comparator]] = {
    "PolytopeComparator": lambda k: PolytopeComparator(k),
    "PosteriorComparator": lambda k: PosteriorComparator(k),
    "BradleyTerryComparator": lambda k: BradleyTerryComparator(k, region="ensemble"),
}


class Predictions(NamedTuple):
    """Predictions (n, m) for each person and question; nan where there is none.

    They are the verdict, the probability of the answer "left", and the probability that left is
    better.
    """

    verdict: Floats
    chance: Floats
    better: Floats | None = None


def chance_of(comparator: Comparator, d: Floats) -> Floats:
    """Return the probability (n,) of the answer "left", nan without a model of answers."""
    if isinstance(comparator, PosteriorComparator):
        return comparator.answer_probability(d)
    if isinstance(comparator, BradleyTerryComparator):
        return comparator.probability(d)[-1]
    return np.full(len(d), np.nan)


def on_questions(
    make: Callable[[int], Comparator], choices: Choices, fold_of: NDArray[np.intp], who: Bools
) -> Predictions:
    """Return predictions of each answer by the person's other folds."""
    verdict, chance, better = (np.full(choices.said.shape, np.nan) for _ in range(3))
    for i in np.flatnonzero(who):
        for fold in range(int(fold_of.max()) + 1):
            test = fold_of[i] == fold
            train = ~test & choices.answered[i]
            y = np.where(choices.said[i, train] == 1, 1, -1)
            fresh = make(choices.d.shape[1])
            known, _ = learn(fresh, Answers(choices.d[train], y), one_by_one=True)
            verdict[i, test] = known.compare(choices.d[test])
            chance[i, test] = chance_of(known, choices.d[test])
            if isinstance(known, PosteriorComparator):
                better[i, test] = known.probability(choices.d[test])
    return Predictions(verdict, chance, better)


def by_logistic_fit(
    features: Floats, choices: Choices, fold_of: NDArray[np.intp], who: Bools, strength: float
) -> Predictions:
    """Return predictions of a ridge logistic regression on features (m, p), person by person."""
    from sklearn.linear_model import LogisticRegression

    chance = np.full(choices.said.shape, np.nan)
    for i in np.flatnonzero(who):
        for fold in range(int(fold_of.max()) + 1):
            test = fold_of[i] == fold
            train = ~test & choices.answered[i]
            y = choices.said[i, train]
            if len(set(y)) == 1:
                chance[i, test] = (y.sum() + 0.5) / (len(y) + 1)
                continue
            fit = LogisticRegression(C=strength, fit_intercept=False).fit(features[train], y)
            chance[i, test] = fit.predict_proba(features[test])[:, 1]
    return Predictions(np.sign(chance - 0.5), chance)


def by_others(choices: Choices, who: Bools) -> Predictions:
    """Return predictions by the share of the other people of ``who`` who said left."""
    chance = np.full(choices.said.shape, np.nan)
    for i in np.flatnonzero(who):
        others = who.copy()
        others[i] = False
        said = choices.said[others]
        chance[i] = (np.nansum(said, axis=0) + 1) / ((~np.isnan(said)).sum(axis=0) + 2)
    return Predictions(np.sign(chance - 0.5), chance)


def features(choices: Choices) -> dict[str, Floats]:
    """Return what the logistic rivals see of a question: shares, or the expected value."""
    spread = choices.amounts[-1] - choices.amounts[0]
    return {
        "logistic fit on shares": tail_sums(choices.d),
        "expected value": (choices.d @ choices.amounts / spread)[:, None] * 10,
    }


def on_repeats(make: Callable[[int], Comparator], log: AnswerLog, folds: int, seed: int) -> Floats:
    """Return scores (pairs, 5) of a comparator on pairs that it was not told of.

    It is told ``TIMES`` answers to each pair of the other folds. The columns are: 1 if it decided,
    the share of the answers to the pair that say the opposite of its verdict, the share that are
    not the most frequent answer, the number of these answers, and the sum of their
    log-probabilities (nan without a model of answers).
    """
    entries = list(log)
    d = np.array([entry.answer.query.d for entry in entries])
    numbers = pair_numbers(d)
    first = [int(np.flatnonzero(numbers == i)[0]) for i in range(numbers.max() + 1)]
    queries = [entries[i].answer.query for i in first]
    fold_of = np.random.default_rng(seed).permutation(len(first)) % folds
    rows = np.full((len(first), 5), np.nan)
    for fold in range(folds):
        tutor = RepeatedAnswersTutor(log, seed)
        told = [tutor(queries[i]) for i in np.flatnonzero(fold_of != fold) for _ in range(TIMES)]
        k = len(queries[0].left)
        known, _ = learn(make(k), Answers.of(told, k), one_by_one=True)
        for i in np.flatnonzero(fold_of == fold):
            rows[i] = _score(known, tutor, queries[i])
    return rows


def _score(known: Comparator, tutor: RepeatedAnswersTutor, query: Query) -> list[float]:
    """Return one row of ``on_repeats``."""
    d = query.d[None]
    verdict, left, right = known.compare(d)[0], chance_of(known, d)[0], chance_of(known, -d)[0]
    said = np.array([int(tutor(query).verdict or 0) for _ in range(tutor.left_over(query))])
    counts = np.array([(said == y).sum() for y in (1, -1, 0)])
    total = counts.sum()
    # without a width of EQUAL a model counts it as half an answer each way
    equal = max(1.0 - left - right, 0.0) or np.sqrt(left * right)
    logs = counts @ np.log(np.maximum([left, right, equal], 1e-9))
    decided = verdict in (Verdict.BETTER, Verdict.WORSE)
    otherwise = (said == -verdict).mean() if decided else np.nan
    return [float(decided), otherwise, 1 - counts.max() / total, float(total), float(logs)]
