"""Data to fit: a tutor who errs, their answers, resamples of them, and pairs to decide."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from elicit import Answers, BradleyTerryTutor, Verdict
from elicit.comparators.bradley_terry.likelihood import bootstrap_weights
from elicit.model.comparator import Verdicts
from elicit.model.difference import dominance, tail_sums
from elicit.model.scale import Floats, dot, values_of

SPREAD = 2.0  # standard deviation of the tutor's logits over the pairs
FRESH = 2000  # pairs to decide, for each data set


class Data(NamedTuple):
    """A tutor's answers, their resamples, and pairs to decide."""

    answers: Answers
    t: Floats  # (n, p) tail sums of the answers
    counts: (
        Floats  # (m + 1, n) how often each resample holds each answer; the first holds each once
    )
    fresh: Floats  # (FRESH, k)
    truth: Verdicts  # (FRESH,)
    top: float  # the tutor's precision, which is the true theta_k
    errors: float  # the share of wrong answers


def draw(k: int, n: int, m: int, seed: int) -> Data:
    """Draw a data set: n answers of a tutor, m resamples of them, and pairs to decide.

    The tutor's gaps are uniform on the simplex. All pairs are ones that dominance does not decide.
    """
    rng = np.random.default_rng([seed, k, n])
    gaps = rng.dirichlet(np.ones(k - 1))
    d = open_pairs(k, FRESH + n, rng)
    scores = dot(tail_sums(d), gaps)
    top = float(SPREAD / scores[:FRESH].std())
    tutor = BradleyTerryTutor(values_of(gaps), top, seed)
    answers = Answers(d[FRESH:], tutor.signs(d[FRESH:]))
    counts = np.concatenate([np.ones((1, n)), bootstrap_weights(seed, m, n)])
    truth = np.sign(scores[:FRESH]).astype(np.int8)
    return Data(
        answers, tail_sums(answers.d), counts, d[:FRESH], truth, top, tutor.realised_error_rate
    )


def open_pairs(k: int, n: int, rng: np.random.Generator) -> Floats:
    """(n, k) differences of vectors uniform on their simplex, without those that the order of the
    levels settles.
    """
    found: list[Floats] = []
    while sum(map(len, found)) < n:
        d = rng.dirichlet(np.ones(k), 2 * n) - rng.dirichlet(np.ones(k), 2 * n)
        found.append(d[dominance(tail_sums(d)) == Verdict.UNKNOWN])
    return np.concatenate(found)[:n]
