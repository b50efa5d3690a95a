"""Strategies: small functions that score candidates for a question.

The candidate with the greatest score is asked about, and of equal scores the first. A strategy is
any function from ``Candidates`` to scores (n,), or the name of one of those here. Your own:

    def closest_to_even_odds(candidates):
        left_better = (candidates.scores > 0) @ candidates.weights
        return -abs(left_better - 0.5)

``candidates.scores`` (n, m) holds d.e of each candidate under each of m plausible scales, and
``weights`` (m,) the weights of these. ``d``, ``states``, ``actions``, ``limit``, ``bounds`` and the
comparator are there too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit._support.validation import require
from elicit.asking.bags import Bags, entropy
from elicit.asking.elicitation import Elicitation
from elicit.asking.question import Pair, Place
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import bounds_above, lapse_of, simultaneous_bounds
from elicit.model.difference import tail_sums
from elicit.model.needs import uses
from elicit.model.scale import Floats
from elicit.tutors.erring_tutor import says_left
from qlearn.certificates.loss_bound import draws_of

__all__ = [
    "STRATEGIES",
    "Candidates",
    "Strategy",
    "first_come",
    "max_regret",
    "most_even_cut",
    "mutual_information",
    "telling_violation",
    "violated_weight",
    "widest_bound",
]


def __dir__() -> list[str]:
    return sorted(__all__)  # completion offers the strategies, not the learners' helpers


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidates for a question: differences d (n, k) that may be asked about.

    Attributes
    ----------
    d : (n, k)
        The vector of the challenger minus that of the best action so far.
    states : (n,) int
        The state of each candidate.
    actions : (n,) int
        The challenger's action at that state.
    limit : float
        A difference matters if d.e exceeds this, a share of the value range.
    comparator : Comparator
        What is known of the scale so far.
    times : float or (n,)
        The factor by which a question multiplies d. Default: 1.
    """

    d: Floats
    states: NDArray[np.int64]
    actions: NDArray[np.int64]
    limit: float
    comparator: Comparator
    times: Floats | float = 1.0

    @cached_property
    def draws(self) -> Draws:
        """Weighted plausible scales: the comparator's ``draws``.

        If it has none, they are drawn from all ordered scales.
        """
        return draws_of(self.comparator)

    @property
    def weights(self) -> Floats:
        """Weights (m,) of the draws, of total 1."""
        return self.draws.weights

    @cached_property
    def scores(self) -> Floats:
        """d.e (n, m) of each candidate under each of the draws."""
        return product(tail_sums(self.d), self.draws.gaps)

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds (n,) on d.e that hold for all candidates at once."""
        both = simultaneous_bounds(self.comparator, np.concatenate([self.d, -self.d]))[0]
        return -both[len(self.d) :], both[: len(self.d)]

    @cached_property
    def agreement(self) -> Floats:
        """Probability (n, m) that the tutor says "left is better", under each of the draws."""
        asked = self.scores * np.reshape(self.times, (-1, 1))
        return says_left(asked, self.draws.precision, lapse_of(self.comparator))

    def __len__(self) -> int:
        return len(self.d)


Strategy: TypeAlias = Callable[[Candidates], Floats]


def first_come(candidates: Candidates) -> Floats:
    """Score by the order of states and actions, the first highest, as the paper does.

    Parameters
    ----------
    candidates : Candidates
        The n candidates, in the order of states and actions.

    Returns
    -------
    (n,)
        Scores 0, -1, -2, ...
    """
    return -np.arange(len(candidates), dtype=np.float64)


@uses("simultaneous_bounds")
def widest_bound(candidates: Candidates) -> Floats:
    """Score by the distance between the bounds on d.e.

    Parameters
    ----------
    candidates : Candidates
        The n candidates.

    Returns
    -------
    (n,)
        Upper minus lower bound of each candidate, a share of the value range.
    """
    low, high = candidates.bounds
    return np.asarray(high - low)


@uses("simultaneous_bounds")
def max_regret(candidates: Candidates) -> Floats:
    """Score by the upper bound on d.e.

    Parameters
    ----------
    candidates : Candidates
        The n candidates.

    Returns
    -------
    (n,)
        The upper bound of each candidate, a share of the value range.
    """
    return candidates.bounds[1]


@uses("draws")
def most_even_cut(candidates: Candidates) -> Floats:
    """Score by the weight of scales that are excluded by the answer that excludes less.

    "Left is better" excludes the scales with d.e < 0, and "right is better" those with d.e > 0.

    Parameters
    ----------
    candidates : Candidates
        The n candidates. Their comparator's ``draws`` are the scales.

    Returns
    -------
    (n,)
        The smaller weight for each candidate, from 0 to 1/2.
    """
    weights = candidates.weights
    better, worse = product(candidates.scores > 0, weights), product(candidates.scores < 0, weights)
    return np.asarray(np.minimum(better, worse))


@uses("draws", "lapse")
def mutual_information(candidates: Candidates) -> Floats:
    """Score by the expected information of the answer about the scale, in bits.

    It is computed from the comparator's model of the tutor (Houlsby et al. 2011; Biyik et al.
    2019): the entropy of the answer, minus the mean of its entropy under each scale.

    Parameters
    ----------
    candidates : Candidates
        The n candidates. Their comparator's ``draws`` are the scales.

    Returns
    -------
    (n,)
        The information that an answer about each candidate gives, in bits.
    """
    chance, weights = candidates.agreement, candidates.weights
    return np.asarray(entropy(product(chance, weights)) - product(entropy(chance), weights))


@uses("draws")
def violated_weight(candidates: Candidates) -> Floats:
    """Score by the weight of the scales under which the difference matters, d.e > limit.

    Parameters
    ----------
    candidates : Candidates
        The n candidates. Their comparator's ``draws`` are the scales.

    Returns
    -------
    (n,)
        The weight for each candidate, from 0 to 1.
    """
    return product(candidates.scores > candidates.limit, candidates.weights)


@uses("draws", "lapse")
def telling_violation(candidates: Candidates) -> Floats:
    """Score by mutual information times the weight of the scales for which the difference matters.

    The weight of one draw is added, so that scores differ even if it matters under no draw.

    Parameters
    ----------
    candidates : Candidates
        The n candidates. Their comparator's ``draws`` are the scales.

    Returns
    -------
    (n,)
        The product for each candidate, in bits.
    """
    spare = 1.0 / len(candidates.weights)
    return np.asarray(mutual_information(candidates) * (violated_weight(candidates) + spare))


_ALL = (
    first_come,
    widest_bound,
    max_regret,
    most_even_cut,
    mutual_information,
    violated_weight,
    telling_violation,
)
STRATEGIES: Mapping[str, Strategy] = MappingProxyType(
    {strategy.__name__: strategy for strategy in _ALL}
)
"""The strategies above, by name."""


def strategy_of(choice: Strategy | str) -> Strategy:
    """Return the strategy itself, or the one of that name.

    Raise ValueError if there is none, or if it cannot be called.
    """
    wanted = (
        f"a function from Candidates to scores (n,), or one of the names {', '.join(STRATEGIES)}"
    )
    known = choice in STRATEGIES if isinstance(choice, str) else callable(choice)
    require(known, "strategy", wanted, choice)
    return STRATEGIES[choice] if isinstance(choice, str) else choice


def worth_asking(
    elicitation: Elicitation, d: Floats, places: Callable[[int], Place], limit: float | Floats
) -> NDArray[np.int64]:
    """Return the rows of differences d (n, k) that are worth a question.

    Their upper bounds exceed ``limit``, a number or (n,), and the elicitation may ask about them.
    ``places`` gives the place at which a row is compared.
    """
    rows = np.flatnonzero(bounds_above(elicitation.comparator, d, limit)[0] > limit)
    return rows[elicitation.may_ask(d[rows], lambda i: places(int(rows[i])))]


def best(strategy: Strategy, candidates: Candidates, how_many: int = 1) -> list[int]:
    """Return the numbers of the candidates with the greatest scores, greatest first.

    Of equal scores the first comes first. Raise ValueError if scores are not numbers (n,).
    """
    scores = np.asarray(strategy(candidates), dtype=np.float64)
    if scores.shape != (len(candidates),) or np.isnan(scores).any():
        raise ValueError(
            f"a strategy must return one number for each of {len(candidates)} candidates, not "
            f"{'nan' if scores.shape == (len(candidates),) else f'shape {scores.shape}'}"
        )
    return [int(i) for i in np.argsort(-_coarse(scores), kind="stable")[:how_many]]


def _coarse(scores: Floats) -> Floats:
    """Return scores rounded to a grid, so that scores that differ only by rounding become equal.

    The grid is finer than any difference that matters.
    """
    some = np.isfinite(scores)
    _, exponent = np.frexp(np.abs(scores[some]).max(initial=0.0))
    unit = np.ldexp(1.0, int(exponent) - 32)
    return np.where(some, np.round(scores / unit), scores)


def simple_pair(
    elicitation: Elicitation,
    bags: Bags,
    candidates: Candidates,
    about: Floats,
    labels: Sequence[str],
) -> Pair | None:
    """Return a question of simple bags that tells of the signs of ``about`` (c, k), or None.

    It is None if no question tells anything. Such a question belongs to no state: its place is its
    sentence.
    """
    asked, draws = bags.questions(len(labels)), candidates.draws
    d = asked.left / bags.days - asked.right / bags.days
    may = elicitation.may_ask(d, lambda _: ())
    if elicitation.gave_up:
        may &= (np.abs(product(tail_sums(d), draws.gaps)) > elicitation.indifference).any(axis=1)
    row, _ = bags.best(draws, about, lapse_of(candidates.comparator), np.flatnonzero(~may).tolist())
    if row < 0:
        return None
    sentence = bags.sentence(asked.left[row], asked.right[row], labels)
    return Pair(asked.left[row] / bags.days, asked.right[row] / bags.days, sentence)
