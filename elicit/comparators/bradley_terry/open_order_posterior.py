"""A posterior over scales if the order of two neighbouring levels is open, for tutors who may err.

It consists of a posterior for each of the two orders. A priori both orders are equally likely. The
answers make that order likelier whose posterior predicted them better.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.fixed_order import product
from elicit._support.hashing import Seed
from elicit._support.seeds import seed_of
from elicit._support.threads import one_thread
from elicit.comparators.bradley_terry.particle_comparator import PARTICLES, PosteriorComparator
from elicit.comparators.two_orders import (
    Order,
    filled_up,
    mean_scale,
    open_step,
    orders_of,
    together,
)
from elicit.decision.comparator_rule import Rule, weighted
from elicit.decision.draw_bounds import quantiles, upper_together
from elicit.decision.verdicts import decide_by_rule
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import TIE, Verdicts, check_answers, check_levels
from elicit.model.difference import as_differences, tail_sums
from elicit.model.query import Answers, Verdict
from elicit.model.scale import Floats, dot

_LEAST = 1e-12  # a smaller predictive probability of an answer counts as this


class _OrderPosterior(NamedTuple):
    """One of the two orders, and the posterior over scales if it is the true order."""

    order: Order
    scales: PosteriorComparator


class OpenOrderPosterior:
    """A posterior over scales in which either of two neighbouring levels may be the better.

    It decides a difference if one sign of d.e has posterior probability ``level``, over both
    orders. Dominance alone decides nothing, because it depends on the order. ``elicit.choose`` and
    ``qlearn.InteractivePolicyIteration`` take it. Other learners need the levels in a fixed order,
    and refuse it. The comparator is a frozen value. ``elicit.Comparator`` says what its methods
    take and return.

    Parameters
    ----------
    k : int
        Number of levels, at least 2.
    unordered : (int, int)
        The two levels, counted from 0, the worst. They must be neighbours.
    lapse : float, optional
        Share of answers given at random. None: learned, as in ``PosteriorComparator``.
    level : float
        Posterior probability that a verdict needs, strictly between 1/2 and 1.
    seed : int, SeedSequence, Generator or None
    tie : float
        Largest |d.e| that the tutor may call equal, a share of the value range.
    particles : int
        Number of draws of each order's posterior.

    Raises
    ------
    ValueError
        If ``unordered`` are not two neighbouring levels, or another argument is out of its range.

    Notes
    -----
    The weight of an order is 1/2 times the product of the probabilities that its posterior gave to
    each answer before it was given (a Bayes factor). "Equal" counts as half an answer each way. A
    scale is normalised so that its worst level is worth 0 and its best 1, whichever level is the
    worst. If two vectors differ in their totals, the difference counts as time at level 1, as
    everywhere.

    Examples
    --------
    >>> known = elicit.OpenOrderPosterior(3, unordered=(0, 1), seed=0)
    >>> care, death = [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]
    >>> answers = elicit.Answers([np.subtract(care, death)] * 3, [-1, -1, 1])
    >>> known = known.update(answers)
    >>> bool(known.order_probabilities[1] > 0.5)
    True
    """

    def __init__(
        self,
        k: int,
        unordered: Sequence[int] = (0, 1),
        lapse: float | None = None,
        level: float = 0.95,
        seed: Seed | None = 0,
        tie: float = TIE,
        particles: int = PARTICLES,
    ) -> None:
        self.k = check_levels(k)
        self.unordered = open_step(self.k, unordered)
        blank = PosteriorComparator(
            k, lapse=lapse, level=level, seed=seed_of(seed), tie=tie, particles=particles
        )
        self.level, self.tie, self.particles = blank.level, blank.tie, blank.particles
        self.answers = Answers.none(self.k)
        self._blank = blank
        self._parts = tuple(_OrderPosterior(order, blank) for order in orders_of(k, self.unordered))
        self._log_weights = np.zeros(2)

    def __repr__(self) -> str:
        low, high = self.unordered
        return (
            f"OpenOrderPosterior(k={self.k}, unordered=({low}, {high}), {len(self.answers)} "
            f"answers, given order {100 * self.order_probabilities[0]:.0f}% likely)"
        )

    @property
    def order_probabilities(self) -> Floats:
        """The probabilities (2,) of the given order, and of that with both levels exchanged."""
        weights = np.exp(self._log_weights - self._log_weights.max())
        return np.asarray(weights / weights.sum())

    def update(self, answers: Answers) -> OpenOrderPosterior:
        """Return a comparator that also knows these answers, learned in the given order.

        Parameters
        ----------
        answers : Answers
            They are about k levels.

        Returns
        -------
        OpenOrderPosterior

        Raises
        ------
        TypeError, ValueError
            For anything but Answers about k levels.
        """
        check_answers(answers, self.k)
        rows, logs, parts = filled_up(answers.d), self._log_weights.copy(), []
        for part, (order, scales) in enumerate(self._parts):
            for i, d in enumerate(rows[:, order]):
                logs[part] += _log_chance(scales, d, int(answers.y[i]))
                told = Answers(d[None], answers.y[i : i + 1], answers.ids[i : i + 1])
                scales = scales.update(told)
            parts.append(_OrderPosterior(order, scales))
        return self._with(self.answers + answers, tuple(parts), logs)

    def retract(self, *ids: str) -> OpenOrderPosterior:
        """Return a comparator without the answers of these ids.

        Parameters
        ----------
        *ids : str
            As they are in ``answers.ids``. All answers of an id are left out.

        Returns
        -------
        OpenOrderPosterior
            With the same settings, and the other answers in their order.

        Raises
        ------
        ValueError
            For an id that is not among the answers.
        """
        blank = tuple(_OrderPosterior(order, self._blank) for order, _ in self._parts)
        fresh = self._with(Answers.none(self.k), blank, np.zeros(2))
        return fresh.update(self.answers.without(ids))

    def _with(
        self, answers: Answers, parts: tuple[_OrderPosterior, ...], log_weights: Floats
    ) -> OpenOrderPosterior:
        """Return a comparator with these answers, posteriors and weights, and the same settings."""
        new = object.__new__(OpenOrderPosterior)
        for name in ("k", "unordered", "level", "tie", "particles", "_blank"):
            setattr(new, name, getattr(self, name))
        new.answers, new._parts, new._log_weights = answers, parts, log_weights
        return new

    @cached_property
    def draws(self) -> Draws:
        """Weighted draws of scales from the posterior over both orders.

        In one order, the gap between the two levels is negative.
        """
        parts = [(order, Draws(*scales.draws)) for order, scales in self._parts]
        return together(parts, self.order_probabilities)

    @cached_property
    @one_thread
    def values(self) -> Floats:
        """The posterior mean (k,) of the scale, least 0 and greatest 1. Read-only.

        The two levels may be in either order.
        """
        return mean_scale(
            [(order, scales.values) for order, scales in self._parts], self.order_probabilities
        )

    @property
    def lapse(self) -> float:
        """The share of answers given at random: as given, or its posterior mean."""
        each = [scales.lapse for _, scales in self._parts]
        return float(product(np.array(each), self.order_probabilities))

    @property
    def rule(self) -> Rule:
        """The draws as plain arrays for compiled loops. Dominance decides nothing in them.

        Dominance depends on the order of the levels, which is open.
        """
        return weighted(self.draws.gaps, self.draws.weights, self.level)._replace(dominance=False)

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts on differences: the sign that has probability ``level``.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,) int8 verdicts
        """
        return decide_by_rule(self.rule, self._rows(d)).verdicts

    def probability(self, d: ArrayLike) -> Floats:
        """Return the posterior probabilities that d.e > 0.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,)
            P(d.e > 0 | answers), over both orders.
        """
        shares = [
            self.draws.weights[dot(t, self.draws.gaps.T) > 0].sum()
            for t in tail_sums(self._rows(d))
        ]
        return np.asarray(np.minimum(shares, 1.0))

    def answer_probability(self, d: ArrayLike) -> Floats:
        """Return the probabilities that the tutor's next answer is "left is better".

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,)
            They allow for the tutor's errors, which ``probability`` leaves out.
        """
        rows = self._rows(d)
        each = [scales.answer_probability(rows[:, order]) for order, scales in self._parts]
        return product(self.order_probabilities, np.array(each))

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return two quantiles of d.e: 1 - ``level`` and ``level``.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        lo, hi : (n,) each, in units of the value range
        """
        draws = self.draws
        scores = product(tail_sums(self._rows(d)), draws.gaps)
        found = [quantiles(row, draws.weights, self.level) for row in scores]
        low, high = np.array(found).reshape(-1, 2).T
        return low.copy(), high.copy()

    @one_thread
    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e that hold for all rows at once, and the probability of that.

        Draws are sorted by their greatest d.e over the rows. Those with the greatest are left out,
        up to a total weight of 1 - ``level``. A bound is the greatest d.e of its row under the
        others.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        hi : (n,) in units of the value range
        probability : float
            Posterior probability that all of them hold: ``level``, or 1 if there are no rows.
        """
        draws = self.draws
        at = product(tail_sums(self._rows(d)), draws.gaps)
        if not len(at):
            return np.empty(0), 1.0
        return upper_together(at, draws.weights, self.level), self.level

    def _rows(self, d: ArrayLike) -> Floats:
        return filled_up(as_differences(d, self.k))


def _log_chance(scales: PosteriorComparator, d: Floats, y: int) -> float:
    """Return the log of the probability that a posterior gives to an answer y about d (k,).

    EQUAL counts as half an answer each way.
    """
    left, right = scales.answer_probability(np.array([d, -d])).tolist()
    if y == Verdict.EQUAL:
        return float(0.5 * np.log(max(left, _LEAST)) + 0.5 * np.log(max(right, _LEAST)))
    return float(np.log(max(left if y > 0 else right, _LEAST)))
