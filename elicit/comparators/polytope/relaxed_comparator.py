"""The polytope comparator for a tutor who errs now and then.

It decides what all scales agree on that violate the answers nearly as little as possible. A scale
violates an answer (d, y) by max(0, -y d.e), or for y = 0 by max(0, |d.e| - tie), in units of e_k -
e_1. The total f over all answers is convex and piecewise linear in the scale. Its least value is
found by a linear program: the fit of a scale by least total violation (LINMAP: Srinivasan and
Shocker 1973, Psychometrika 38; UTA: Jacquet-Lagreze and Siskos 1982, EJOR 10). The plausible set is
{f <= B}, where B is that least value plus the slack.

For every subset S of the answers, the total violation over S is at most f and so at most B. This is
a linear cut. The set that satisfies the cuts made so far contains {f <= B}, so verdicts over it are
proven. If it leaves both signs possible, its best point is joined to a point inside {f <= B}. The
answers that are violated where the segment leaves {f <= B} make the next cut (Veinott 1967,
Operations Research 15; after Kelley 1960, SIAM J. 8). There are finitely many subsets, and few of
them matter.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from elicit._support.fixed_order import null_basis, product
from elicit._support.threads import one_thread
from elicit._support.validation import is_number
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.comparators.polytope.plausible_set import PlausibleSet
from elicit.comparators.polytope.violation import Hinges, best_fit, solve
from elicit.decision.comparator_rule import PROVEN, Rule, outer
from elicit.decision.verdicts import decide_by_rule
from elicit.lp.analytic_centre import climb
from elicit.lp.dual_simplex import End, minimise, minimise_exactly
from elicit.lp.hit_and_run import Draws, draws_within
from elicit.lp.prior_inequalities import PriorLike
from elicit.lp.rounding import rounding
from elicit.model.comparator import TIE, Decisions, Verdicts, check_answers
from elicit.model.difference import as_differences, of_order_one
from elicit.model.query import Answers, InconsistentAnswers, Verdict
from elicit.model.scale import Floats, values_of

if TYPE_CHECKING:
    import cvxpy

LEAST_SLACK = 1e-9
"""A smaller slack is raised to this number times the largest answered tail sum, rounded up to a
power of two, so that {f <= B} is not too thin for floats. A slack of 0 with consistent answers
stays 0."""

_GRID = (
    2.0**-36
)  # the least violation is rounded up to a multiple, so that a solver's last bits do not matter
_NEAR = 1e-12  # smaller violations beyond B, and smaller distances of optima from 0, count as none
_TIGHT = 3e-10  # largest gap between the least t.g over the cuts and that over {f <= B}
_PATIENCE = 4  # cuts for one optimum before it is solved for directly
_MOST_CUTS = 1000  # largest number of cuts for one optimum
_MOST_POINTS = 1000  # largest number of points of {f <= B} to keep
_SHARPENED = 20  # rounds in which the greatest of several upper bounds is made tight
_FEWEST = 50  # least number of draws to choose a question by
_BLOCK = 32  # open differences that are decided together, after all cuts made for those before them


class RelaxedPolytopeComparator:
    """The set of all scales whose total violation of the answers is nearly the least possible.

    Its scales have at least ``margin`` between neighbouring levels, satisfy the prior, and violate
    the answers in total by at most ``slack`` more than the least possible. The comparator is a
    frozen value. ``elicit.Comparator`` says what its methods take and return.

    BETTER, WORSE and EQUAL are proven. UNKNOWN may also be said if the exact optimum is within
    about 1e-9 |d|_1 of zero.

    With slack 0 and consistent answers the comparator equals ``PolytopeComparator``. With slack 0
    and inconsistent answers it keeps the best fit, often one scale alone, which is hardly ever the
    true one. The true scale stays plausible if the tutor's errors do not exceed the slack in total.
    An answer that contradicts earlier ones can make a decided difference UNKNOWN again.

    Parameters
    ----------
    k : int
        Number of levels.
    slack : float
        At least 0, in units of e_k - e_1.
    margin, prior, tie
        As in ``PolytopeComparator``.

    Raises
    ------
    ValueError
        As ``PolytopeComparator`` does, and if the slack is negative or not finite.
    """

    def __init__(
        self,
        k: int,
        slack: float = 0.0,
        margin: float = 1e-6,
        prior: PriorLike = None,
        tie: float = TIE,
    ) -> None:
        if not is_number(slack, 0):
            raise ValueError(
                "the slack must be a finite number of at least 0 (in units of e_k - e_1), not "
                f"{slack!r}"
            )
        self._blank = blank = PolytopeComparator(k, margin, prior, tie)
        self.slack, self.k, self.margin, self.prior = (
            float(slack),
            blank.k,
            blank.margin,
            blank.prior,
        )
        self.tie = blank.tie
        self._order = PlausibleSet(blank.region)
        self._learn(blank.answers, blank, None)

    def __repr__(self) -> str:
        return (
            f"RelaxedPolytopeComparator(k={self.k}, slack={self.slack:g}, {len(self.answers)} "
            "answers)"
        )

    @one_thread
    def update(self, answers: Answers) -> RelaxedPolytopeComparator:
        """Return a comparator that also knows these answers, consistent or not."""
        new = object.__new__(RelaxedPolytopeComparator)
        new.slack, new.k, new.margin, new.prior, new.tie = (
            self.slack,
            self.k,
            self.margin,
            self.prior,
            self.tie,
        )
        new._blank, new._order = self._blank, self._order
        together = self.answers + check_answers(answers, self.k)
        try:
            exact = None if self._exact is None else self._exact.update(answers)
        except InconsistentAnswers:
            exact = None
        new._learn(together, exact, self._set)
        return new

    def retract(self, *ids: str) -> RelaxedPolytopeComparator:
        """Return a comparator without the answers of these ids.

        Raises
        ------
        ValueError
            For an id that is not among the answers.
        """
        fresh = RelaxedPolytopeComparator(self.k, self.slack, self.margin, self.prior, self.tie)
        return fresh.update(self.answers.without(ids))

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts (n,) on differences (n, k), on which every plausible scale agrees."""
        return decide_by_rule(self.rule, as_differences(d, self.k), self.decide_rest).verdicts

    @property
    def rule(self) -> Rule:
        """The proofs about the plausible scales as plain arrays for compiled loops."""
        return self._set.rule

    @one_thread
    def decide_rest(self, d: Floats) -> Decisions:
        """Decide, by linear programs, differences that the compiled proofs leave open."""
        return self._set.decide_rest(d)

    @one_thread
    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return proven bounds on d.e over the plausible scales, tight to 1e-9 |d|_1."""
        return self._set.bounds(as_differences(d, self.k))

    @one_thread
    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e that hold for all rows at once, and their confidence.

        Returns
        -------
        hi : (n,) in units of e_k - e_1
        confidence : float
            1 as long as the answers are consistent. After that it is nan, because nothing says how
            likely the slack is to be enough.
        """
        high = self._set.simultaneous_bounds(rows := as_differences(d, self.k))[0]
        if self._exact is None:
            return high, np.nan
        return np.maximum(high, self._exact.simultaneous_bounds(rows)[0]) if (
            self.answers.y == 0
        ).any() else high, 1.0

    @cached_property
    @one_thread
    def draws(self) -> Draws:
        """Plausible scales, drawn to choose questions. No proof depends on them."""
        return self._set.draws

    @property
    @one_thread
    def values(self) -> Floats:
        """The analytic centre (k,) of the plausible set, from 0 to 1; read-only.

        If scales may violate the answers, it is the centre of a larger set. A point of that set is
        a scale together with the violation allowed for each answer.
        """
        return self._set.values

    @property
    def violation(self) -> float:
        """The least total violation, in units of e_k - e_1.

        It is exactly 0 if the answers are consistent. Otherwise it is at most 1e-9 of the largest
        |d|_1 too high.
        """
        with np.errstate(over="ignore"):
            return float(np.ldexp(self._least, self._hinges.exponent))

    @cached_property
    @one_thread
    def violated(self) -> tuple[tuple[int, str], ...]:
        """The answers that do not fit the others, as (row, id).

        A scale with the least total violation violates them, by more than 1e-7 of the largest
        answered difference. Usually there is one such scale. If there are several, they violate
        different answers, and all of these are listed.
        """
        if self._exact is not None:
            return ()
        # on the set of its minimisers f is linear, and hence each violation is: a violation that is
        # positive somewhere on the set is positive in its middle
        best = self._within(self._least + LEAST_SLACK)
        wrong = self._hinges.owner[self._hinges.lacking(np.diff(best.values)) > 1e-7]
        return tuple((int(row), self.answers.ids[row]) for row in np.unique(wrong))

    def problems(self, d: ArrayLike) -> tuple[cvxpy.Problem, cvxpy.Problem]:
        """Return cvxpy problems that minimise and maximise d.e over the plausible scales.

        They are like those of ``PolytopeComparator.problems``, with a variable "violation" (n,):
        the violation of each answer, in units of e_k - e_1.

        Parameters
        ----------
        d : (k,)
            One difference left - right.

        Returns
        -------
        least, greatest : cvxpy.Problem
        """
        from elicit.comparators.polytope.cvxpy_problems import least_and_greatest

        if isinstance(self._set, PolytopeComparator):
            return self._set.problems(d)
        hinges, unit = self._hinges, np.ldexp(1.0, self._hinges.exponent)
        weights = unit * hinges.weights
        region = self._blank.region.plus(
            weights[:, None] * hinges.rows, weights * hinges.rhs, hinges.owner
        )
        return least_and_greatest(
            d, region, self.prior, (len(self.answers), float(unit * self._set.budget))
        )

    @property
    def solves(self) -> int:
        """Number of linear programs that were solved to compare and to make cuts."""
        return self._set.solves

    def _learn(
        self,
        answers: Answers,
        exact: PolytopeComparator | None,
        old: PolytopeComparator | _Sublevel | None,
    ) -> None:
        self.answers, self._exact, self._hinges, self._least = (
            answers,
            exact,
            Hinges.of(answers, self.tie),
            0.0,
        )
        self._set: PolytopeComparator | _Sublevel
        if exact is not None and self.slack == 0:
            self._set = exact
            return
        self._fit = best_fit(self._hinges, self._order)
        least = float(np.ceil(self._hinges.at_most(self._fit) / _GRID)) * _GRID
        if exact is None:
            self._least = least
        with np.errstate(over="ignore"):
            slack = max(float(np.ldexp(self.slack, -self._hinges.exponent)), LEAST_SLACK)
        budget = least + min(
            slack, len(self._hinges.rows) + 1.0
        )  # no scale violates any row by more than 1
        self._set = self._within(budget)
        if isinstance(old, _Sublevel):
            self._set.inherit(old)

    def _within(self, budget: float) -> _Sublevel:
        return _Sublevel(self._hinges, budget, self._fit, np.diff(self._blank.values), self._order)


class _Sublevel:
    """The set {f <= budget} of scales whose total violation f of the answers is within a budget.

    The object keeps points inside this set, and a PlausibleSet that contains it, to which cuts are
    added as needed. It begins with two points: ``middle``, in the middle of all ordered scales, and
    ``fit``, the best fit (f < budget).
    """

    def __init__(
        self, hinges: Hinges, budget: float, fit: Floats, middle: Floats, order: PlausibleSet
    ) -> None:
        self.hinges, self.budget, self.middle, self.order, self.around = (
            hinges,
            budget,
            middle,
            order,
            order,
        )
        least, most = hinges.total(fit), hinges.total(middle)
        share = 0.5 if most <= budget else 0.5 * (budget - least) / (most - least)
        self.inside = (1 - share) * fit + share * middle
        self.points = self.inside[None, :]
        self.solves = 0

    def inherit(self, old: _Sublevel) -> None:
        """Take over the cuts and points of ``old``, found for fewer answers.

        If the budget has grown since, they are not valid, and nothing is taken over.
        """
        with np.errstate(over="ignore"):
            budget = np.ldexp(old.budget, old.hinges.exponent - self.hinges.exponent)
        if self.budget <= budget:
            self.around = old.around
            still = [self.hinges.total(g) <= self.budget + _NEAR for g in old.points]
            self.points = np.concatenate([self.points, old.points[still]])

    def decide_rest(self, d: Floats) -> Decisions:
        """Return verdicts (n,) and tiers (n,) of differences d (n, k) that the rule leaves open."""
        verdicts, tiers = self.around.decide(d)
        unknown = np.flatnonzero(verdicts == Verdict.UNKNOWN)
        for first in range(0, len(unknown), _BLOCK):
            block = unknown[first : first + _BLOCK]
            at = product(_unit_tails(d[block]), self.points.T)
            block = block[~((at < -_NEAR).any(axis=1) & (at > _NEAR).any(axis=1))]
            verdicts[block], tiers[block] = self.around.decide(d[block])
            block = block[verdicts[block] == Verdict.UNKNOWN]
            for t in _unit_tails(d[block]):
                self._sharpen(t, 0.0)
                self._sharpen(-t, 0.0)
            verdicts[block], tiers[block] = self.around.decide(d[block])
        return Decisions(verdicts, tiers)

    @property
    def rule(self) -> Rule:
        """The proofs about the set as plain arrays: the containing set, and points inside."""
        rule = self.around.rule
        return outer(rule.known, self.points.T) if rule.kind == PROVEN else rule

    def bounds(self, d: Floats) -> tuple[Floats, Floats]:
        """Return proven bounds lo (n,), hi (n,) on d.e of d (n, k), tight to 1e-9 |d|_1."""
        for one in _unit_tails(d):
            for t in (one, -one) if one.any() else ():
                self._sharpen(t, -np.inf)
        return self.around.bounds(d)

    def simultaneous_bounds(self, d: Floats) -> tuple[Floats, float]:
        """Return upper bounds (n,) on d.e for differences d (n, k), and their confidence, 1.

        The greatest of them is tight to 1e-9 |d|_1.
        """
        high = self.around.greatest(d)
        for _ in range(_SHARPENED if len(d) else 0):
            row = int(np.argmax(high))
            before = float(high[row])
            self._sharpen(-_unit_tails(d[row : row + 1])[0], -np.inf)
            high = np.minimum(high, self.around.greatest(d))
            if high[row] >= before - 1e-9 * float(np.abs(d[row]).sum()):
                break
        return high, 1.0

    @cached_property
    def draws(self) -> Draws:
        """Draws from the containing set that lie in the set {f <= budget} itself.

        If these are few, the known points are added.
        """
        drawn = draws_within(self.around.region, np.diff(self.values))
        within = np.array([self.hinges.total(g) <= self.budget + _NEAR for g in drawn.gaps.T])
        gaps = (
            drawn.gaps[:, within]
            if within.sum() >= _FEWEST
            else np.concatenate([drawn.gaps[:, within], self.points.T], axis=1)
        )
        m = gaps.shape[1]
        return Draws(gaps, np.full(m, 1.0 / m), np.full(m, np.inf))

    @cached_property
    def values(self) -> Floats:
        """The scale (k,) at the analytic centre; read-only."""
        values = values_of(_centre(self))
        values.flags.writeable = False
        return values

    def _sharpen(self, t: Floats, enough: float) -> None:
        """Add cuts until the least t.g over the containing set is that over the set itself.

        Stop early if a point of the set has t.g < enough.
        """
        for step in range(_MOST_CUTS):
            if step == _PATIENCE:
                self._jump(t)
            found = float(product(self.points, t).min())
            if found < enough - _NEAR:
                return
            self.solves += 1
            vertex = minimise(t, self.around.region)
            if vertex.end is not End.OPTIMAL:
                vertex = minimise_exactly(t, self.around.region)
            near = found - _TIGHT if enough < 0 else _NEAR
            if float(vertex.value) >= near or not self._cut_off(vertex.g.astype(np.float64)):
                return

    def _jump(self, t: Floats) -> None:
        """Solve for the least t.g over the set: keep its point, and the cut that proves it."""
        cost = np.append(t, np.zeros(len(self.hinges.rows)))
        found = solve(self.hinges, self.order.region, cost, self.budget)
        self.solves += 1
        if found is not None and found.price > 0:
            self._cut_off(found.g)
            self._add(
                *self.hinges.cut(
                    np.minimum(found.y / found.price, self.hinges.weights), self.budget
                )
            )

    def _add(self, row: Floats, limit: float) -> None:
        if limit > row.min():  # otherwise the order alone implies it
            self.around = self.around.cut(row[None, :], np.array([limit]), np.array([-1]))

    def _cut_off(self, g: Floats) -> bool:
        """Cut off a point g outside the set: follow the segment to it from a point inside.

        The point where the segment leaves the set is kept, and the cut there is added. Return False
        if the segment does not leave the set, or if rounding leaves too little of the cut.
        """
        start = self.hinges.lacking(self.inside)
        way = self.hinges.lacking(g) - start
        share, best = 1.0, (g, -np.inf)
        for _ in range(len(start)):  # Newton's method on a convex, piecewise linear function
            some = start + share * way > 0
            if (start + share * way)[some].sum() <= self.budget + _NEAR:
                break
            row, limit = self.hinges.cut(np.where(some, self.hinges.weights, 0.0), self.budget)
            if row @ g < limit - rounding(len(g), 1.0):
                best = row, limit
            share = float((self.budget - start[some].sum()) / way[some].sum())
        point = (1 - share) * self.inside + share * g
        self.points = np.concatenate([self.points, point[None, :]])[-_MOST_POINTS:]
        if best[1] > -np.inf:
            self._add(*best)
        return best[1] > -np.inf


def _unit_tails(d: Floats) -> Floats:
    """Return tail sums (n, p) of d (n, k), divided by the largest of each row."""
    t = of_order_one(d).t
    size = np.abs(t).max(axis=1, initial=0.0, keepdims=True)
    return np.asarray(t / np.where(size > 0, size, 1.0))


def _centre(level: _Sublevel) -> Floats:
    """Return the gaps (p,) at the analytic centre of a set of scales and violations.

    A point of the set has gaps g and violations s. The gaps satisfy the order and the prior. Each
    s_i >= 0 is at least the violation of answer i by g, and sum s <= budget.
    """
    hinges, (rows, limits) = level.hinges, level.order.region.constraints
    m, p = hinges.rows.shape
    flat = rows @ level.middle - limits <= 1e-12 * np.abs(rows).max(
        axis=1
    )  # rows without room at the middle have no room anywhere
    along = null_basis(np.concatenate([np.ones((1, p)), rows[flat]]))
    s = np.maximum(hinges.lacking(level.inside), 0.0)
    s += (level.budget - s.sum()) / (m + 1)
    none, each = np.zeros((m, p)), np.eye(m)
    every = np.block([
        [rows[~flat], np.zeros((np.count_nonzero(~flat), m))],
        [hinges.weights[:, None] * hinges.rows, each],
        [none, each],
        [np.zeros((1, p)), np.full((1, m), -1.0)],
    ])  # fmt: skip
    least = np.concatenate(
        [limits[~flat], hinges.weights * hinges.rhs, np.zeros(m), [-level.budget]]
    )
    g = climb(np.append(level.inside, s), every, least, block_diag(along, each))[:p]
    return np.asarray(g / g.sum())
