"""Questions made for people: pairs of simple bags.

An example: "of 10 days: 10 stable, or 6 critical and 4 well?"

A learner's own questions are about vectors of odd shares, such as 0.1372. A *bag question* sets one
level for certain against a mixture of a worse and a better level, in small whole numbers of days
(the time trade-off of Torrance, Thomas and Sackett 1972). Its answer often decides the learner's
question too. If it does not, another question follows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from math import comb, gcd
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.fixed_order import product
from elicit._support.threads import one_thread
from elicit._support.validation import is_number, is_whole, require
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import check_levels
from elicit.model.difference import as_vectors, tail_sums
from elicit.model.scale import Floats
from elicit.tutors.erring_tutor import says_left

_LEAST = 1e-3  # bits: a question that tells less is not asked
MOST_QUESTIONS = 200_000
"""Largest number of bag questions to weigh. With a thousand scales, this many already fill
gigabytes."""


class BagQuestions(NamedTuple):
    """Pairs of bags, and how easy each pair is to compare.

    ``left`` and ``right`` (n, k) are in whole days. ``ease`` (n,) lies in (0, 1], and 1 is the
    easiest.
    """

    left: Floats
    right: Floats
    ease: Floats


@dataclass(frozen=True)
class Bags:
    """Settings of questions about bags.

    Parameters
    ----------
    days : int
        The number of days in a bag, at least 2. Bags of 10 or fewer are easy to picture.
        Default: 10.
    simplicity : float
        The share of the best question's information that may be given up for an easier question,
        in 0..1. Default: 0.3.

    Raises
    ------
    ValueError
        If a setting is out of range.
    """

    days: int = 10
    simplicity: float = 0.3

    def __post_init__(self) -> None:
        wanted = "a whole number of at least 2"
        require(is_whole(self.days, 2), "days, the number of days in a bag,", wanted, self.days)
        require(is_number(self.simplicity, 0, 1), "simplicity", "a number in 0..1", self.simplicity)

    def questions(self, k: int) -> BagQuestions:
        """Return all bag questions about k levels, those with few and round numbers first.

        Parameters
        ----------
        k : int
            Number of levels, at least 2.

        Returns
        -------
        BagQuestions
            The arrays ``left`` (n, k) and ``right`` (n, k), in whole days, and ``ease`` (n,), which
            lies in (0, 1], with 1 for the easiest. They are read-only.

        Raises
        ------
        ValueError
            If k < 2, or there are more than ``MOST_QUESTIONS``.
        """
        k, days = check_levels(k), int(self.days)
        count = comb(k, 3) * (days - 1)
        if count > MOST_QUESTIONS:
            fewer = MOST_QUESTIONS // comb(k, 3) + 1
            advice = f"set days to {fewer} or fewer" if fewer > 1 else "take fewer levels"
            raise ValueError(
                f"bags of {days} days over k = {k} levels make {count:,} questions, more than the "
                f"{MOST_QUESTIONS:,} "
                f"that are looked through at a time: {advice}"
            )
        return _all_questions(k, days)

    @one_thread
    def best(
        self, draws: Draws, about: ArrayLike, lapse: float = 0.0, skip: Sequence[int] = ()
    ) -> tuple[int, Floats]:
        """Return the row of ``questions`` to ask, and the information of each of them.

        The information is about the signs of d.e for the differences ``about``.

        Parameters
        ----------
        draws : Draws
            Plausible scales: gaps (k - 1, m), weights (m,) and precisions (m,).
        about : (c, k)
            Differences left - right whose signs are wanted.
        lapse : float
            Share of answers given at random, in 0..1. Default: 0.
        skip : sequence of int
            Rows of ``questions`` that are not to be asked. Default: none.

        Returns
        -------
        row : int
            The row of the easiest question with at least (1 - simplicity) of the greatest
            information, or -1 if no question gives any.
        information : (n,)
            The information of each question, in bits; 0 for those in ``skip``.

        Raises
        ------
        ValueError
            If ``about`` is not finite or not of the draws' k levels, ``lapse`` is outside 0..1, or
            ``questions`` has no row of ``skip``.
        """
        k = len(draws.gaps) + 1
        wanted_signs, asked = as_vectors(about, k), self.questions(k)
        require(is_number(lapse, 0, 1), "lapse", "a number in 0..1", lapse)
        n = len(asked.ease)
        wanted = f"rows of questions({k}), whole numbers of at least 0 and below {n}"
        require(all(is_whole(row, 0) and row < n for row in skip), "skip", wanted, skip)
        if not n:
            return -1, np.empty(0)
        d = (asked.left - asked.right) / self.days
        chance = says_left(product(tail_sums(d), draws.gaps), draws.precision, lapse)
        told = information(chance, product(tail_sums(wanted_signs), draws.gaps) > 0, draws.weights)
        told[np.array([int(row) for row in skip], dtype=np.intp)] = 0.0
        if not told.max() > _LEAST:
            return -1, told
        fair = told >= max(_LEAST, (1.0 - self.simplicity) * float(told.max()))
        order = np.lexsort([-told, -asked.ease, ~fair])
        return int(order[0]), told

    def sentence(self, left: Floats, right: Floats, labels: Sequence[str]) -> str:
        """Return the question in words.

        Parameters
        ----------
        left, right : (k,)
            The bags, in whole days, worst level first.
        labels : sequence of str
            The names of the k levels, worst first.

        Returns
        -------
        str
            Such as "of 10 days: 10 ill (left), or 4 dead and 6 well (right)?".
        """
        bags = [zip(days, labels, strict=True) for days in (left, right)]
        said = [" and ".join(f"{int(n)} {label}" for n, label in bag if n) for bag in bags]
        return f"of {self.days} days: {said[0]} (left), or {said[1]} (right)?"


@lru_cache(maxsize=8)
def _all_questions(k: int, days: int) -> BagQuestions:
    found = []
    for low, sure, high in combinations(range(k), 3):
        for good in range(1, days):
            left, right = np.zeros(k), np.zeros(k)
            left[sure], right[high], right[low] = days, good, days - good
            found.append((ease(days, good, low == 0 and high == k - 1), left, right))
    found.sort(key=lambda one: -one[0])
    eases, lefts, rights = (np.array([one[i] for one in found]) for i in range(3))
    questions = BagQuestions(lefts.reshape(-1, k), rights.reshape(-1, k), eases)
    for part in questions:
        part.flags.writeable = False
    return questions


def ease(days: int, good: int, ends: bool) -> float:
    """Return in (0, 1] how easy it is to picture ``good`` better days among ``days``.

    Halves are easier than fifths, and fifths easier than tenths. Mixtures of the worst and the best
    level (``ends``) are easier than others.
    """
    return 2.0 * gcd(days, good) / days * (1.0 if ends else 0.7)


def entropy(chance: Floats) -> Floats:
    """Return the entropy, in bits, of an answer that is yes with this probability."""
    p, q = np.clip(chance, 1e-300, 1.0), np.clip(1.0 - chance, 1e-300, 1.0)
    return np.asarray(-(chance * np.log2(p) + (1.0 - chance) * np.log2(q)))


def information(chance: Floats, events: NDArray[np.bool_], weights: Floats) -> Floats:
    """Return the mutual information (n,), in bits, of answers to n questions with some events.

    ``chance`` (n, m) is the probability of the answer under each of m scales with ``weights`` (m,).
    Each of ``events`` (c, m) is true or false under each scale. The result is the mean over the
    events.
    """
    prior = product(events, weights)
    some = (prior > 0) & (prior < 1 - 1e-12)  # a certain event tells nothing
    if not some.any():
        return np.zeros(len(chance))
    true, mass = events[some] * weights, prior[some]
    overall = product(chance, weights)
    if_true = np.clip(product(chance, true.T) / mass, 0.0, 1.0)
    if_false = np.clip((overall[:, None] - if_true * mass) / (1.0 - mass), 0.0, 1.0)
    told = entropy(overall)[:, None] - mass * entropy(if_true) - (1.0 - mass) * entropy(if_false)
    return np.asarray(np.maximum(told, 0.0).sum(axis=1) / len(events))
