"""The reliable-tutor comparator (section 3.1): what every scale consistent with the answers agrees on.

A verdict is the sign of the exact optimum of the two programs over K_t, reached by the cheapest proof that will
do (``decision.judge_kernel``, ``plausible_set``). ``bounds`` are Clarabel's, made rigorous.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.threads import one_thread
from elicit._support.validation import is_number
from elicit.comparators.polytope.plausible_set import Empty, PlausibleSet
from elicit.decision.verdicts import decide_by
from elicit.lp.analytic_centre import analytic_centre
from elicit.lp.hit_and_run import Draws, draws_within
from elicit.lp.infeasibility import contradiction
from elicit.lp.prior_inequalities import Prior, PriorLike, as_prior
from elicit.lp.region import Region, answer_rows, prior_rows
from elicit.model.comparator import ALLOWANCE, TIE, Decisions, Verdicts, check_answers, check_levels, check_tie
from elicit.model.query import Answers
from elicit.model.scale import Floats, as_differences, values_of

if TYPE_CHECKING:
    import cvxpy

    from elicit.comparators.polytope.explanation import Explanation
    from elicit.decision.comparator_rule import Rule


class PolytopeComparator:
    """All scales in K_t: at least ``margin`` (eta) between neighbouring levels, the prior inequalities
    A e >= b, and what each answer says: d.e >= 0, d.e <= 0, or, of "equal", |d.e| <= ``tie``. A frozen value.

    ``prior`` is (A (p, k), b (p,)), or named inequalities: texts such as "e4 >= 2*e2", what ``elicit.inequality``
    makes of them, and linear cvxpy constraints over ``elicit.scale_variable(k)``. Texts that use the levels' own names
    go through ``elicit.inequalities(texts, labels=...)``.

    ``tie`` is the largest |d.e|, as a share of the value range e_k - e_1, that the tutor may call equal, of differences
    of share vectors; 0: equal means equal. It matters only once the tutor says "equal": then a larger one is safer,
    and teaches less (docs/about-equal.md). Verdicts and ``bounds`` go by it; ``simultaneous_bounds``, and so the
    guarantees that rest on them, allow for twice as much.

    Raises ValueError for k < 2, a margin outside [0, 1/(k-1)], a prior that no scale satisfies, and a tie outside
    [0, 1).
    """

    def __init__(self, k: int, margin: float = 1e-6, prior: PriorLike = None, tie: float = TIE) -> None:
        self.k = check_levels(k)
        self.margin = _check_margin(margin, self.k)
        self.tie = check_tie(tie)
        self.answers = Answers.none(self.k)
        self.prior = as_prior(prior, self.k)
        try:
            self._set = self._wide = PlausibleSet(Region(self.margin, *prior_rows(self.prior, self.k)))
        except Empty:
            raise ValueError(
                f"no scale with margin {self.margin:g} (and e_1 = 0, e_k = 1) satisfies the prior's "
                f"inequalities together, {_listed(self.prior)}: relax or drop some of them"
            ) from None

    def __repr__(self) -> str:
        return f"PolytopeComparator(k={self.k}, margin={self.margin:g}, {len(self.answers)} answers)"

    @cached_property
    def region(self) -> Region:
        """K_t in gap space, with every constraint: the prior's, and those of all answers, also the redundant."""
        prior = prior_rows(self.prior, self.k)
        return Region(self.margin, *prior).plus(*answer_rows(self.answers, 0, self.tie))

    @cached_property
    def values(self) -> Floats:
        """(k,) the analytic centre of K_t, from 0 to 1; read-only."""
        values = values_of(analytic_centre(self.region))
        values.flags.writeable = False
        return values

    @one_thread
    def update(self, answers: Answers) -> PolytopeComparator:
        """K_t cut by these answers. Raises InconsistentAnswers, with a minimal contradictory set of rows
        of ``self.answers + answers``, where that leaves no scale."""
        new = object.__new__(PolytopeComparator)
        new.k, new.margin, new.prior, new.tie = self.k, self.margin, self.prior, self.tie
        new.answers = self.answers + check_answers(answers, self.k)
        try:
            new._set = self._set.cut(*answer_rows(answers, len(self.answers), self.tie))
        except Empty as empty:
            raise contradiction(empty.region, empty.proof, new.answers) from None
        if self._wide is self._set and (self.tie == 0 or (answers.y != 0).all()):
            new._wide = new._set
        else:
            new._wide = self._wide.cut(*answer_rows(answers, len(self.answers), ALLOWANCE * self.tie))
        return new

    def retract(self, *ids: str) -> PolytopeComparator:
        """What is known without the answers of these ids. Raises ValueError for an id that is not among them."""
        fresh = PolytopeComparator(self.k, self.margin, self.prior, self.tie)
        return fresh.update(self.answers.without(ids))

    def compare(self, d: ArrayLike) -> Verdicts:
        """Verdicts (n,) on differences d (n, k): the sign of the exact optimum over K_t."""
        return decide_by(self.rule, as_differences(d, self.k), self.settle).verdicts

    @property
    def rule(self) -> Rule:
        """What is known of K_t as plain arrays."""
        return self._set.rule

    @one_thread
    def settle(self, d: Floats) -> Decisions:
        """Verdicts and tiers (n,) of differences d (n, k) that the rule leaves open: by linear programs."""
        return self._set.settle(d)

    @one_thread
    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Outer bounds lo (n,), hi (n,) on d.e over K_t, tight to 1e-9 |d|_1."""
        return self._set.bounds(as_differences(d, self.k))

    @one_thread
    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Upper bounds (n,) on d.e that hold for all rows of d (n, k) at once, and with what confidence: 1, for they
        are proven of every scale in K_t (its support function), its ties taken twice as wide. Far cheaper than
        ``bounds``."""
        return self._wide.greatest(as_differences(d, self.k)), 1.0

    @one_thread
    def rough_bounds(self, d: ArrayLike, slack: float | Floats) -> Floats:
        """The same bounds (n,), up to ``slack``, one or (n,), above them, without linear programs where that shows."""
        return self._wide.greatest(as_differences(d, self.k), slack)

    @cached_property
    def draws(self) -> Draws:
        """Scales drawn from K_t, about uniformly, for questions that go by probability; no proof rests on them."""
        return draws_within(self.region, np.diff(self.values))

    def explain(self, d: ArrayLike, labels: Sequence[str] | None = None) -> Explanation:
        """Why the tutor need not be asked about d (k,): a smallest set of answers and prior inequalities, and the
        order of the levels, with multipliers that prove the verdict; or, where it is UNKNOWN, two scales that
        disagree. ``str()`` of it is a sentence; ``labels`` (k,) names the levels."""
        from elicit.comparators.polytope.minimal_proof import explain

        return explain(d, self, labels)

    def problems(self, d: ArrayLike) -> tuple[cvxpy.Problem, cvxpy.Problem]:
        """The programs that minimise and maximise d.e over K_t, for one difference d (k,), as cvxpy problems over a
        scale variable that they share; each constraint's label says where it comes from ("answer 3"; in the unit in
        which its largest tail sum is between 1/2 and 1). To inspect, extend, and give to another solver."""
        from elicit.comparators.polytope.cvxpy_problems import least_and_greatest

        return least_and_greatest(d, self.region, self.prior)

    @property
    def solves(self) -> int:
        """How many linear programs Clarabel has solved for this comparator."""
        return self._set.programs.solves


def _check_margin(margin: float, k: int) -> float:
    if not is_number(margin, 0, 1.0 / (k - 1)):
        raise ValueError(
            f"the margin eta must lie between 0 and 1/(k-1) = {1 / (k - 1):g}, or no {k} levels fit between 0 and 1; "
            f"it is {margin!r}"
        )
    return float(margin)


def _listed(prior: Prior | None) -> str:
    return "; ".join(prior.names) if prior is not None else "none"
