"""A comparator for scales with one open step: either of two neighbouring levels may be the better.

"Worse than dead" is the usual case: some people put a life in constant care below death, and some
do not. The plausible scales are then the union of two polytopes, one for each order. A verdict is
proven if both agree. An order that contradicts the answers is dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.threads import one_thread
from elicit.comparators.polytope.cells import agreed, log_volume
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.comparators.two_orders import filled_up, mean_scale, open_step, orders_of, together
from elicit.decision.comparator_rule import Rule, unaided
from elicit.decision.verdicts import decide, decide_by_rule
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import TIE, Decisions, Verdicts, check_answers, check_levels
from elicit.model.difference import as_differences
from elicit.model.query import Answers, InconsistentAnswers, Verdict
from elicit.model.scale import Floats


class _Ordered(NamedTuple):
    """One of the two orders, worst level first, and a comparator that takes it as true."""

    order: tuple[int, ...]
    scales: PolytopeComparator


class OpenOrderComparator:
    """All scales consistent with the answers, with two neighbouring levels in either order.

    It holds a ``PolytopeComparator`` for each of the two orders. Its decisions hold under both, so
    dominance counts only if neither order contradicts it. ``elicit.choose`` and
    ``qlearn.InteractivePolicyIteration`` take it. Other learners need the levels in a fixed order,
    and refuse it. The comparator is a frozen value. ``elicit.Comparator`` says what its methods
    take and return.

    Parameters
    ----------
    k : int
        Number of levels, at least 2.
    unordered : (int, int)
        The two levels, counted from 0, the worst. They must be neighbours.
    margin : float
        Least gap between neighbouring levels, in either order, a share of the value range.
    tie : float
        Largest |d.e| that the tutor may call equal, a share of the value range.

    Raises
    ------
    ValueError
        If k < 2, ``unordered`` are not two neighbouring levels, the margin is outside [0, 1/(k-1)],
        or the tie is outside [0, 1).

    Notes
    -----
    A scale is normalised so that its worst level is worth 0 and its best 1, whichever level is the
    worst. If two vectors differ in their totals, the difference counts as time at level 1, as
    everywhere.

    Examples
    --------
    >>> known = elicit.OpenOrderComparator(3, unordered=(0, 1))
    >>> gamble, care = [0.5, 0.0, 0.5], [0.0, 1.0, 0.0]
    >>> choosing = elicit.choose([gamble, care], known)
    >>> len(choosing.ask())
    1
    """

    def __init__(
        self,
        k: int,
        unordered: Sequence[int] = (0, 1),
        margin: float = 1e-6,
        tie: float = TIE,
    ) -> None:
        self.k = check_levels(k)
        self.unordered = open_step(self.k, unordered)
        self.answers = Answers.none(self.k)
        self._parts = tuple(
            _Ordered(order, PolytopeComparator(k, margin, tie=tie))
            for order in orders_of(self.k, self.unordered)
        )
        self.margin, self.tie = (getattr(self._parts[0].scales, name) for name in ("margin", "tie"))

    def __repr__(self) -> str:
        low, high = self.unordered
        return (
            f"OpenOrderComparator(k={self.k}, unordered=({low}, {high}), "
            f"{len(self.answers)} answers, {len(self._parts)} of 2 orders left)"
        )

    @property
    def orders(self) -> tuple[tuple[int, ...], ...]:
        """The orders that the answers leave possible: level numbers, from the worst to the best."""
        return tuple(part.order for part in self._parts)

    @cached_property
    def values(self) -> Floats:
        """The central scale (k,), least 0 and greatest 1. Read-only.

        It is the mean over the possible orders, weighted by the volume of their scales. So the two
        levels may be in either order in it. If all levels have the same value in the mean, which
        happens with two levels, it is the scale of the given order.
        """
        return mean_scale([(order, scales.values) for order, scales in self._parts], self._weights)

    @cached_property
    def _weights(self) -> Floats:
        """The volume of the scales of each possible order, as a share of the greatest."""
        logs = np.zeros(len(self._parts))
        if len(self._parts) > 1:
            logs = np.array([log_volume(part.scales.draws) for part in self._parts])
        return np.asarray(np.exp(logs - logs.max()))

    @cached_property
    def draws(self) -> Draws:
        """Scales drawn about uniformly from those of all orders that are left.

        In one order, the gap between the two levels is negative. The draws serve to choose
        questions. No proof depends on them.
        """
        shares = self._weights / self._weights.sum()
        return together([(order, scales.draws) for order, scales in self._parts], shares)

    @one_thread
    def update(self, answers: Answers) -> OpenOrderComparator:
        """Return the comparator that also knows these answers. Orders they contradict are dropped.

        Parameters
        ----------
        answers : Answers
            They are about k levels.

        Returns
        -------
        OpenOrderComparator

        Raises
        ------
        InconsistentAnswers
            If no scale of either order is left. It names a minimal contradictory set of answers.
        """
        check_answers(answers, self.k)
        new = object.__new__(OpenOrderComparator)
        new.k, new.unordered = self.k, self.unordered
        new.margin, new.tie = self.margin, self.tie
        new.answers = self.answers + answers
        new._parts = tuple(_told(self._parts, answers))
        if not new._parts:
            blank = OpenOrderComparator(self.k, self.unordered, self.margin, self.tie)
            raise InconsistentAnswers(partial(_explained, blank._parts, new.answers))
        return new

    def retract(self, *ids: str) -> OpenOrderComparator:
        """Return a comparator without the answers of these ids.

        Parameters
        ----------
        *ids : str
            As they are in ``answers.ids``. All answers of an id are left out.

        Returns
        -------
        OpenOrderComparator
            With the same settings, and the other answers in their order.

        Raises
        ------
        ValueError
            For an id that is not among the answers.
        """
        fresh = OpenOrderComparator(self.k, self.unordered, self.margin, self.tie)
        return fresh.update(self.answers.without(ids))

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts on differences, on which all possible orders agree.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,) int8 verdicts
        """
        return decide_by_rule(self.rule, self._rows(d), self.decide_rest).verdicts

    @property
    def rule(self) -> Rule:
        """A rule for compiled loops that decides nothing: ``decide_rest`` decides everything.

        Even dominance depends on the order of the levels.
        """
        return unaided()

    @one_thread
    def decide_rest(self, d: Floats) -> Decisions:
        """Decide differences by the comparators of both orders.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        Decisions
            The verdicts (n,) and their tiers (n,).
        """
        rows = self._rows(d)
        verdicts = np.full(len(rows), Verdict.EQUAL, np.int8)
        tiers = np.zeros(len(rows), np.int8)
        for order, scales in self._parts:
            found = decide(scales, rows[:, order])
            verdicts = agreed(verdicts, found.verdicts)
            tiers = np.maximum(tiers, found.tiers)
        return Decisions(verdicts, tiers)

    @one_thread
    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return bounds on d.e that hold in all possible orders.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        lo, hi : (n,) each, in units of the value range
        """
        rows = self._rows(d)
        each = np.array([scales.bounds(rows[:, order]) for order, scales in self._parts])
        return each[:, 0].min(axis=0), each[:, 1].max(axis=0)

    @one_thread
    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e that hold for all rows at once, and their confidence.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        hi : (n,) in units of the value range
        confidence : float
            Always 1.
        """
        rows = self._rows(d)
        each = [scales.simultaneous_bounds(rows[:, order])[0] for order, scales in self._parts]
        return np.max(each, axis=0), 1.0

    def _rows(self, d: ArrayLike) -> Floats:
        return filled_up(as_differences(d, self.k))


def _told(parts: Sequence[_Ordered], answers: Answers) -> list[_Ordered]:
    """Return those orders that the answers allow, each with a comparator that has learned them."""
    left = []
    for order, scales in parts:
        there = Answers(filled_up(answers.d)[:, order], answers.y, answers.ids)
        try:
            left.append(_Ordered(order, scales.update(there)))
        except InconsistentAnswers:
            continue
    return left


def _explained(
    blank: Sequence[_Ordered], answers: Answers
) -> tuple[str, tuple[tuple[int, str], ...], bool]:
    """Return a sentence, a minimal contradictory set, and whether a margin of 0 would allow it."""

    def possible(rows: Sequence[int], parts: Sequence[_Ordered]) -> bool:
        chosen: NDArray[np.intp] = np.array(rows, dtype=np.intp)
        some = Answers(answers.d[chosen], answers.y[chosen], [answers.ids[row] for row in rows])
        return bool(_told(parts, some))

    rows = list(range(len(answers)))
    for row in rows[::-1]:
        rest = [other for other in rows if other != row]
        if rest and not possible(rest, blank):
            rows = rest
    found = tuple((row, answers.ids[row]) for row in rows)
    listed = ", ".join(f"row {row} (id {name})" for row, name in found)
    loose = [
        _Ordered(order, PolytopeComparator(scales.k, 0.0, tie=scales.tie))
        for order, scales in blank
    ]
    margin = blank[0].scales.margin > 0 and possible(rows, loose)
    said = (
        f"these {len(rows)} answers contradict each other in either order of the two levels: "
        f"{listed}. Drop or correct one of them."
    )
    if margin:
        said += " With a margin of 0 they would not: the margin is above the least gap they allow."
    return said, found, margin
