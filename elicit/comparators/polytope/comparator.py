"""The comparator for a tutor who is always right: it decides what all consistent scales agree on.

This is section 3.1 of the paper. A verdict follows from the signs of the least and the greatest d.e
over the plausible set K_t. The cheapest sufficient proof is used (``decision.rule_kernel``,
``plausible_set``). ``bounds`` come from the solver Clarabel, and each is proven.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.threads import one_thread
from elicit._support.validation import is_number, is_whole, require
from elicit.comparators.polytope.cells import Cells, PolytopeCell, too_many_wrong
from elicit.comparators.polytope.plausible_set import Empty, PlausibleSet
from elicit.decision.verdicts import decide_by_rule
from elicit.lp.analytic_centre import analytic_centre
from elicit.lp.hit_and_run import Draws, draws_within
from elicit.lp.infeasibility import (
    contradiction,
    exclude_opposites,
    opposed,
    opposite_answers,
)
from elicit.lp.prior_inequalities import Prior, PriorLike, as_prior
from elicit.lp.region import Region, answer_rows, prior_rows
from elicit.model.comparator import (
    ALLOWANCE,
    TIE,
    Decisions,
    Verdicts,
    check_answers,
    check_levels,
    check_tie,
)
from elicit.model.comparator_parts import Cell, bounds_on_trial
from elicit.model.difference import as_differences
from elicit.model.query import Answers
from elicit.model.scale import Floats, values_of

if TYPE_CHECKING:
    import cvxpy

    from elicit.comparators.polytope.explanation import Explanation
    from elicit.decision.comparator_rule import Rule


class PolytopeComparator:
    """The polytope K_t of all scales that are consistent with all answers but at most ``wrong``.

    A scale in K_t has at least ``margin`` (eta) between neighbouring levels and satisfies the prior
    inequalities A e >= b. It also satisfies each answer: d.e >= 0, d.e <= 0 or, for "equal", |d.e|
    <= ``tie``. The comparator is a frozen value. ``elicit.Comparator`` says what its methods take
    and return.

    Parameters
    ----------
    k : int
        Number of levels, at least 2.
    margin : float
        Least gap between neighbouring levels, a share of the value range, in [0, 1/(k-1)].
    prior : optional
        (A (p, k), b (p,)), or named inequalities: texts such as "e4 >= 2*e2", the results of
        ``elicit.inequality``, and linear cvxpy constraints over ``elicit.scale_variable(k)``. For
        texts that use the levels' own names see ``elicit.inequalities(texts, labels=...)``.
    tie : float
        Largest |d.e| that the tutor may call equal, a share of the value range e_k - e_1, in [0,
        1). Here d is a difference of share vectors. 0: equal means equal. It matters only once the
        tutor says "equal". Then a larger tie is safer, and an answer teaches less
        (docs/about-equal.md). Verdicts and ``bounds`` use the tie as it is.
        ``simultaneous_bounds``, and so guarantees, allow for twice as much.
    wrong : int
        The number of answers that may be wrong. K_t then holds every scale that satisfies all but
        this many of the answers: it is the union of ``cells``. Proofs hold even if this many
        answers are wrong, and take more questions.

    Raises
    ------
    ValueError
        If k < 2, the margin is outside [0, 1/(k-1)], no scale satisfies the prior, the tie is
        outside [0, 1), or ``wrong`` is no whole number of at least 0.
    """

    _cells: Cells | None = None

    def __init__(
        self,
        k: int,
        margin: float = 1e-6,
        prior: PriorLike = None,
        tie: float = TIE,
        wrong: int = 0,
    ) -> None:
        self.k = check_levels(k)
        self.margin = _check_margin(margin, self.k)
        self.tie = check_tie(tie)
        require(
            is_whole(wrong, 0),
            "wrong, how many answers may be wrong,",
            "a whole number of at least 0",
            wrong,
        )
        self.wrong = int(wrong)
        self.answers = Answers.none(self.k)
        self.prior = as_prior(prior, self.k)
        try:
            self._set = self._with_wider_ties = PlausibleSet(
                Region(self.margin, *prior_rows(self.prior, self.k))
            )
        except Empty:
            raise ValueError(
                f"no scale with margin {self.margin:g} (and e_1 = 0, e_k = 1) satisfies the "
                "prior's "
                f"inequalities together, {_listed(self.prior)}: relax or drop some of them"
            ) from None
        if self.wrong:
            self._cells = Cells(
                [PolytopeCell(PolytopeComparator(k, margin, self.prior, tie), ())], self.wrong
            )

    def __repr__(self) -> str:
        wrong = f", wrong={self.wrong}" if self.wrong else ""
        return f"PolytopeComparator(k={self.k}, margin={self.margin:g}{wrong}, {len(self.answers)} answers)"  # noqa: E501

    @property
    def cells(self) -> tuple[Cell, ...]:
        """The polytopes whose union is K_t, each with its comparator and its wrong answers.

        Within a cell no further answer is wrong. With ``wrong=0`` there is one cell, whose
        comparator is this one.
        """
        return (Cell(self, (), 1.0),) if self._cells is None else self._cells.cells

    @property
    def suspects(self) -> tuple[tuple[int, str], ...]:
        """Answers that may be wrong, as (row, id), once the answers contradict each other.

        They are the answers that are wrong under some scale of K_t. There are none before the
        answers contradict each other. If there is only one, it must be wrong.
        """
        parts = () if self._cells is None else self._cells.parts
        if not all(part.wrong for part in parts):
            return ()
        return tuple(
            (row, self.answers.ids[row])
            for row in sorted({row for part in parts for row in part.wrong})
        )

    @property
    def refuted(self) -> tuple[tuple[int, str], ...]:
        """Answers that are wrong under every scale of K_t, as (row, id).

        With ``wrong`` = 0 there are none.
        """
        wrong = [] if self._cells is None else [set(part.wrong) for part in self._cells.parts]
        return tuple(
            (row, self.answers.ids[row])
            for row in sorted(set.intersection(*wrong) if wrong else ())
        )

    @cached_property
    def region(self) -> Region:
        """K_t as linear constraints on the gaps: those of the prior and of all answers.

        Redundant constraints are included. It raises ValueError with ``wrong > 0``: then each of
        ``cells`` has a region.
        """
        self._check_convex("region")
        prior = prior_rows(self.prior, self.k)
        return Region(self.margin, *prior).plus(*answer_rows(self.answers, 0, self.tie))

    @cached_property
    def values(self) -> Floats:
        """The analytic centre (k,) of K_t, from 0 to 1; read-only.

        With ``wrong > 0`` it is the weighted mean of the centres of ``cells``. A cell's weight is
        its volume, less if more answers are wrong in it.
        """
        values = (
            values_of(analytic_centre(self.region)) if self._cells is None else self._cells.values
        )
        values.flags.writeable = False
        return values

    @one_thread
    def update(self, answers: Answers) -> PolytopeComparator:
        """Return the comparator whose K_t also satisfies these answers.

        Parameters
        ----------
        answers : Answers
            They are about k levels.

        Returns
        -------
        PolytopeComparator

        Raises
        ------
        InconsistentAnswers
            If no scale is left. It names a minimal contradictory set of rows of the old and new
            answers: without any one of them, no more than ``wrong`` of the others would have to be
            wrong. Opposite answers to the same pair always contradict each other: they do not mean
            that it is equal.
        """
        new = self._with_answers(answers)
        if self._cells is not None:
            new._set, new._with_wider_ties = self._set, self._with_wider_ties
            new._cells = self._cells.update(answers, len(self.answers))
            if not new._cells.parts:
                blank, loose = (
                    PolytopeComparator(self.k, margin, self.prior, self.tie)
                    for margin in (self.margin, 0.0)
                )
                raise too_many_wrong(blank, loose, new.answers, self.wrong)
            return new
        rows, limits, owner = answer_rows(answers, len(self.answers), self.tie)
        try:
            new._set = self._set.cut(rows, limits, owner)
        except Empty as empty:
            _refuse_opposite(new.answers, len(self.answers))
            raise contradiction(empty.region, empty.proof, new.answers) from None
        if not exclude_opposites(rows[limits == 0], new._set.inside):
            _refuse_opposite(new.answers, len(self.answers))
        if self._with_wider_ties is self._set and (self.tie == 0 or (answers.y != 0).all()):
            new._with_wider_ties = new._set
        else:
            new._with_wider_ties = self._with_wider_ties.cut(
                *answer_rows(answers, len(self.answers), ALLOWANCE * self.tie)
            )
        return new

    def learned_in_loop(self, answers: Answers, rule: Rule) -> PolytopeComparator:
        """Return the comparator after answers that a compiled loop has already added to ``rule``.

        The result is that of ``update``.

        Parameters
        ----------
        answers : Answers
            The added answers. None of them is "equal", and they do not contradict the earlier ones.
        rule : elicit.decision.comparator_rule.Rule
            This comparator's ``rule``, with these answers added to it.

        Returns
        -------
        PolytopeComparator
        """
        if not len(answers):
            return self
        new = self._with_answers(answers)
        rows = answer_rows(answers, len(self.answers), self.tie)
        new._set = new._with_wider_ties = self._set.cut_in_loop(*rows, rule.known)
        return new

    def retract(self, *ids: str) -> PolytopeComparator:
        """Return a comparator without the answers of these ids.

        Parameters
        ----------
        *ids : str
            As they are in ``answers.ids``. All answers of an id are left out.

        Returns
        -------
        PolytopeComparator
            With the same settings, and the other answers in their order.

        Raises
        ------
        ValueError
            For an id that is not among the answers.
        """
        fresh = PolytopeComparator(self.k, self.margin, self.prior, self.tie, self.wrong)
        return fresh.update(self.answers.without(ids))

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts on differences, proven over K_t.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,) int8 verdicts
        """
        return decide_by_rule(self.rule, as_differences(d, self.k), self.decide_rest).verdicts

    @property
    def rule(self) -> Rule:
        """The proofs about K_t as plain arrays for compiled loops."""
        rule = self._set.rule if self._cells is None else self._cells.rule
        cuts_all = self._cells is None and self._with_wider_ties is self._set
        return rule if cuts_all else rule._replace(grows=False)

    @one_thread
    def decide_rest(self, d: Floats) -> Decisions:
        """Decide, by linear programs, differences that the compiled proofs leave open.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        Decisions
            The verdicts (n,) and their tiers (n,).
        """
        return self._set.decide_rest(d) if self._cells is None else self._cells.decide_rest(d)

    @one_thread
    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return the least and the greatest d.e over K_t.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        lo, hi : (n,) each, in units of e_k - e_1
            Rounded outwards, and tight to 1e-9 |d|_1.
        """
        rows = as_differences(d, self.k)
        return self._set.bounds(rows) if self._cells is None else self._cells.bounds(rows)

    @one_thread
    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e that hold for all rows at once, and their confidence.

        They are proven for every scale in K_t, with its ties taken twice as wide. Computing them is
        far cheaper than computing ``bounds``.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        hi : (n,) in units of e_k - e_1
        confidence : float
            Always 1.
        """
        rows = as_differences(d, self.k)
        return (
            self._with_wider_ties.bounded(rows)
            if self._cells is None
            else self._cells.greatest(rows)
        ), 1.0

    @one_thread
    def bounds_above(self, d: ArrayLike, enough: ArrayLike) -> tuple[Floats, float]:
        """Return ``simultaneous_bounds``, but bounds up to ``enough`` may be loose.

        It takes less time if the last call was about nearly the same differences: bounds that were
        below ``enough`` then mostly still are.

        Parameters
        ----------
        d : (n, k)
        enough : float or (n,)
            In units of e_k - e_1. If the exact bound is at most this, the result may be any number
            between the two.

        Returns
        -------
        hi : (n,) in units of e_k - e_1
        confidence : float
            Always 1.
        """
        if self._cells is not None:
            return self.simultaneous_bounds(d)
        rows = as_differences(d, self.k)
        limits = np.broadcast_to(np.asarray(enough, dtype=np.float64), len(rows))
        return self._with_wider_ties.bounded(rows, limits), 1.0

    @one_thread
    def bounds_after(self, asked: ArrayLike, d: ArrayLike, enough: ArrayLike) -> Floats:
        """Return roughly the ``simultaneous_bounds`` there would be after each possible answer.

        They serve to choose questions, and prove nothing.

        Parameters
        ----------
        asked : (c, k)
            Differences left - right, of questions.
        d : (n, k)
            Differences left - right, to bound.
        enough : float or (n,)
            In units of e_k - e_1. A bound up to this may be replaced by any number up to this.

        Returns
        -------
        (c, 2, n) in units of e_k - e_1
            The first of the two is for the answer "worse", and the second for "better". -inf if the
            answer contradicts earlier ones, inf if floats find no bound.
        """
        rows, questions = as_differences(d, self.k), as_differences(asked, self.k)
        limits = np.broadcast_to(np.asarray(enough, dtype=np.float64), len(rows))
        if self._cells is not None:
            return bounds_on_trial(self, questions, rows)
        return self._with_wider_ties.greatest_beside(rows, questions, limits)

    @cached_property
    def draws(self) -> Draws:
        """Scales drawn about uniformly from K_t.

        They serve to choose questions by probability. No proof depends on them.
        """
        return (
            draws_within(self.region, np.diff(self.values))
            if self._cells is None
            else self._cells.draws
        )

    def explain(self, d: ArrayLike, labels: Sequence[str] | None = None) -> Explanation:
        """Explain how the answers decide a difference, or why they do not.

        Parameters
        ----------
        d : (k,)
            A difference left - right.
        labels : (k,) str, optional
            Names of the levels.

        Returns
        -------
        Explanation
            A smallest set of answers and prior inequalities, and the order of the levels, with
            multipliers that prove the verdict. If the verdict is UNKNOWN, it holds two scales that
            disagree. ``str()`` gives a sentence.
        """
        self._check_convex("an explanation")
        from elicit.comparators.polytope.minimal_proof import explain

        return explain(d, self, labels)

    def problems(self, d: ArrayLike) -> tuple[cvxpy.Problem, cvxpy.Problem]:
        """Return the linear programs that minimise and maximise d.e over K_t, as cvxpy problems.

        They share a scale variable. Inspect them, extend them, or give them to another solver.

        Parameters
        ----------
        d : (k,)
            One difference left - right.

        Returns
        -------
        least, greatest : cvxpy.Problem
            The label of each constraint says where it comes from, such as "answer 3". An answer is
            scaled so that its largest tail sum is between 1/2 and 1.
        """
        self._check_convex("problems")
        from elicit.comparators.polytope.cvxpy_problems import least_and_greatest

        return least_and_greatest(d, self.region, self.prior)

    @property
    def solves(self) -> int:
        """Number of linear programs that Clarabel has solved for this comparator."""
        if self._cells is not None:
            return sum(part.scales.solves for part in self._cells.parts)
        return self._set.programs.solves

    def _with_answers(self, answers: Answers) -> PolytopeComparator:
        """Return a comparator with these further answers, which computes K_t when it is needed."""
        new = object.__new__(PolytopeComparator)
        new.k, new.margin, new.prior = self.k, self.margin, self.prior
        new.tie, new.wrong = self.tie, self.wrong
        new.answers = self.answers + check_answers(answers, self.k)
        return new

    def _check_convex(self, what: str) -> None:
        if self._cells is not None:
            raise ValueError(
                f"with wrong={self.wrong} the plausible scales are a union of {len(self._cells.parts)} polytopes, and "  # noqa: E501
                f"{what} is of one: take that of each of comparator.cells"
            )


def _refuse_opposite(answers: Answers, first: int) -> None:
    """Raise InconsistentAnswers if two answers to the same pair are opposite.

    The later of the two is in row ``first`` or after it.
    """
    if (rows := opposite_answers(answers, first)) is not None:
        raise opposed(rows, answers)


def _check_margin(margin: float, k: int) -> float:
    if not is_number(margin, 0, 1.0 / (k - 1)):
        raise ValueError(
            f"the margin eta must lie between 0 and 1/(k-1) = {1 / (k - 1):g}, or no {k} levels "
            "fit between 0 and 1; "
            f"it is {margin!r}"
        )
    return float(margin)


def _listed(prior: Prior | None) -> str:
    return "; ".join(prior.names) if prior is not None else "none"
