"""The plausible set K_t in gap coordinates g: the exact sign of t.g over it, and rigorous bounds.

Compiled code decides most signs (``decision.rule_kernel``). The others go to the solver Clarabel.
If its result proves nothing, they go to the simplex method in rationals, whose optimum, multipliers
and basis are kept as proofs. ``bounds`` come from Clarabel, and each is proven.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit.decision.comparator_rule import Rule, proven, unaided
from elicit.decision.verdicts import decide_by_rule
from elicit.lp.clarabel_programs import Programs
from elicit.lp.dual_simplex import Vertex, minimise_exactly
from elicit.lp.infeasibility import is_empty
from elicit.lp.primal_simplex import USED, Known
from elicit.lp.region import Region
from elicit.lp.rounding import rounding
from elicit.lp.sign_proofs import sign_of, signs_at_points
from elicit.lp.support_function import greatest, greatest_beside
from elicit.lp.vertex_store import (
    add_point,
    add_row,
    add_vertex,
    cut,
    has_grown,
    has_point,
    prune,
    refresh,
    rows_left,
    start,
)
from elicit.model.comparator import Decisions, Tier, verdicts_from
from elicit.model.difference import of_order_one, tail_sums
from elicit.model.difference_kernel import LEFT_OPEN, to_order_one
from elicit.model.query import Verdict
from elicit.model.scale import Floats, order_bounds

_REMEMBERED = 1_000_000  # numbers in the differences whose bounds are kept


class _Bounded(NamedTuple):
    """Upper bounds ``high`` (n,) on differences d (n, k), kept from an earlier call.

    They were found over this set or a larger one. Bounds above ``enough`` (n,) are exact for the
    set they were found over; others may be loose.
    """

    d: Floats
    high: Floats
    enough: Floats


class Empty(ValueError):
    """Error raised if no point satisfies the rows of ``region``.

    ``proof`` names some rows that alone contradict each other.
    """

    def __init__(self, region: Region, proof: Vertex) -> None:
        super().__init__("no scale satisfies all of these constraints")
        self.region = region
        self.proof = proof


class PlausibleSet:
    """The set {g >= margin, sum g = 1, rows g >= rhs}, with everything proven about it so far.

    The set never changes. More proofs may be found, which changes only the CPU time of later calls.
    Raise Empty if no point satisfies the rows.
    """

    _rule: Rule | None = None
    _last: _Bounded | None = None

    def __init__(self, region: Region) -> None:
        if len(region.rows):
            _check_some(region)
        self.region = region
        self._known = start(region)

    def cut(self, rows: Floats, rhs: Floats, owner: NDArray[np.int64]) -> PlausibleSet:
        """Return the part of the set that satisfies further rows (m, p), rows g >= rhs.

        Rows that follow from others are left out. Raise Empty if no point satisfies them.
        """
        part = self
        for i in range(len(rows)):
            if not part._holds(rows[i], float(rhs[i])):
                part = part._cut(rows[i : i + 1], rhs[i : i + 1], owner[i : i + 1])
        return part

    @property
    def inside(self) -> Floats | None:
        """A point (p,) strictly inside the set; None if floats find none in a flat set."""
        return None if np.isnan(self._known.inside[0]) else self._known.inside

    @cached_property
    def programs(self) -> Programs:
        """The linear programs over this set, to be solved by Clarabel."""
        return Programs(self.region)

    def decide(self, d: Floats) -> Decisions:
        """Return verdicts (n,) and tiers (n,) of valid differences d (n, k)."""
        return decide_by_rule(self.rule, d, self.decide_rest)

    @property
    def rule(self) -> Rule:
        """The proofs about the set as plain arrays for compiled loops.

        With a margin of 0, rows can force gaps to be 0, which dominance does not take into account.
        So if the set has no point strictly inside, the arrays hold no proofs.
        """
        if self.region.margin == 0 and len(self.region.rows) > 0 and self.inside is None:
            return unaided()
        if self._rule is None or self._rule.known is not self._known:
            self._rule = proven(self._known, grows=self.inside is not None)
        return self._rule

    def decide_rest(self, d: Floats) -> Decisions:
        """Return verdicts and tiers (n,) of differences (n, k) that compiled proofs leave open."""
        solved = [self._solve(row) for row in d]
        return Decisions(
            np.array([v for v, _ in solved], np.int8),
            np.array([tier for _, tier in solved], np.int8),
        )

    def bounds(self, d: Floats) -> tuple[Floats, Floats]:
        """Return proven bounds lo (n,), hi (n,) on d.e of d (n, k), tight to 1e-9 |d|_1."""
        return self._least(d), 0.0 - self._least(-d)

    def _least(self, d: Floats) -> Floats:
        """Return lower bounds (n,) on d.e for differences d (n, k), tight to 1e-9 |d|_1."""
        _, t, exponent = of_order_one(d)
        low = order_bounds(t, self.region.margin)[0]
        low -= rounding(self.region.p + 1, 4.0 * np.abs(t).max(axis=1, initial=0.0))
        if len(self.region.rows):
            low = np.maximum(low, [self.programs.least(row, self.inside) for row in t])
        with np.errstate(over="ignore", under="ignore"):
            low = np.ldexp(low, exponent)
        # one step outwards: the results may have lost bits on the way back
        return np.where(t.any(axis=1), np.nextafter(low, -np.inf), 0.0)

    def bounded(self, d: Floats, enough: Floats | None = None) -> Floats:
        """Return upper bounds (n,) on d.e of d (n, k), as ``greatest``, but reuse the last bounds.

        If the exact bound is at most ``enough`` (n,), the result may be any number between the two.
        By default all bounds are exact.

        In each round a learner needs the bounds three times: for its proof, to see which
        differences are open, and to choose a cut. From round to round differences change little,
        and the set becomes smaller. So the last bounds, plus the change of each difference, mostly
        suffice to show that a bound is still below ``enough``.
        """
        enough = np.full(len(d), -np.inf) if enough is None else enough
        last = self._last
        if last is None or last.d.shape != d.shape:
            high = self.greatest(d)
        else:
            same = (last.d == d).all()
            if same and (last.enough <= enough).all():
                return last.high.copy()
            high = self._at_most(d, last)
            rows = np.flatnonzero(~(high <= enough))
            high[rows] = self.greatest(d[rows])
        if d.size <= _REMEMBERED:
            self._last = _Bounded(d.copy(), high.copy(), enough.copy())
        return high

    def _at_most(self, d: Floats, last: _Bounded) -> Floats:
        """Return upper bounds (n,) on d.e, from the ``last`` ones and how d has changed since."""
        size = np.abs(d).sum(axis=1) + np.abs(last.d).sum(axis=1)
        change = order_bounds(tail_sums(d) - tail_sums(last.d), self.region.margin)[1]
        bounds: Floats = last.high + change + rounding(self.region.p + 1, 4.0 * size)
        return bounds

    def greatest(self, d: Floats) -> Floats:
        """Return upper bounds (n,) on d.e for valid differences d (n, k).

        Positive bounds are tight to 1e-9 |d|_1. Walks from vertex to vertex find most of them, and
        Clarabel the rest.
        """
        high, reached = greatest(d, self._known)
        if len(self.region.rows):
            if len(rows := self._loose(d, high, reached)):
                # a walk can fail where one from a vertex found since does not
                again, reached[rows] = greatest(d[rows], self._known)
                high[rows] = np.minimum(high[rows], again)
            for i in self._loose(d, high, reached):
                high[i] = min(high[i], -float(self._least(-d[i : i + 1])[0]))
        return high

    def greatest_beside(self, d: Floats, asked: Floats, enough: Floats) -> Floats:
        """Return roughly the greatest d.e (c, 2, n) after each answer to each question.

        The maximum is over the part of the set that the answer leaves. The questions are ``asked``
        (c, k). Of the two answers, "worse" comes first. A maximum up to ``enough`` (n,) need not be
        exact.
        """
        return greatest_beside(d, asked, self._known, enough)

    def _loose(self, d: Floats, high: Floats, reached: Floats) -> NDArray[np.int64]:
        """Return the rows of d whose upper bounds ``high`` (n,) are positive and perhaps loose.

        A bound is tight if d.e is near it at a known point of the set, or at the point where a walk
        ended. At the latter it is ``reached`` (n,).
        """
        near = 1e-9 * np.abs(d).sum(axis=1)
        rows = np.flatnonzero((high > 0) & ~(high - reached <= near))
        points = self._known.points[:, : self._known.counts[USED]]
        most = product(tail_sums(d[rows]), points).max(axis=1, initial=-np.inf)
        loose: NDArray[np.bool_] = ~(high[rows] - most <= near[rows])
        return rows[loose]

    def _cut(self, row: Floats, rhs: Floats, owner: NDArray[np.int64]) -> PlausibleSet:
        """Return the part of the set that satisfies one more row (1, p)."""
        new = object.__new__(PlausibleSet)
        region = self.region.plus(row, rhs, owner)
        with np.errstate(all="ignore"):
            known = cut(self._known, row[0], float(rhs[0]))
            if not has_point(known):
                _check_some(region)
            known = refresh(known, region)
            if has_grown(known):
                known, region = prune(known, region)
        return new._filled(region, known, self._last)

    def cut_in_loop(
        self, rows: Floats, rhs: Floats, owner: NDArray[np.int64], known: Known
    ) -> PlausibleSet:
        """Return the set cut by rows (m, p) that a compiled loop has already added to ``known``.

        The loop may have removed redundant rows.
        """
        region = rows_left(self.region.plus(rows, rhs, owner), known)
        return object.__new__(PlausibleSet)._filled(region, known, self._last)

    def _filled(self, region: Region, known: Known, last: _Bounded | None) -> PlausibleSet:
        """Set this new set's region, the facts known about it, and the last bounds; return the set.

        The bounds were found over a larger set. They still hold, but may no longer be tight.
        """
        self.region, self._known = region, known
        if last is not None:  # its bounds hold, but are no longer tight
            self._last = last._replace(enough=np.full(len(last.d), np.inf))
        return self

    def _holds(self, row: Floats, limit: float) -> bool:
        """Return whether row.g >= limit is known to follow from the set's rows."""
        if limit == 0:
            with np.errstate(all="ignore"):
                verdict = sign_of(row, self._known)
            if verdict != LEFT_OPEN:
                return verdict in (Verdict.BETTER, Verdict.EQUAL)
        return bool(((self.region.rows == row).all(axis=1) & (self.region.rhs == limit)).any())

    def _solve(self, d: Floats) -> tuple[Verdict, Tier]:
        """Return a difference's verdict and tier, from the signs of its least and greatest d.e.

        The two linear programs are those of the paper's section 3.1. If a known point already shows
        the sign of an optimum, that program is not solved.
        """
        t = np.ascontiguousarray(tail_sums(d))
        size, _ = to_order_one(t)
        tier, least, greatest = Tier.LP, -1, 1
        doubt, known = rounding(self.region.p, 4.0 * size), self._known
        above, below = signs_at_points(
            t, doubt, 0, known.points, known.kind, np.empty(known.counts[USED])
        )
        if not below:
            least, tier = self._sign_of_least(t, tier)
        if least <= 0 and not above:
            sign, tier = self._sign_of_least(-t, tier)
            greatest = -sign
        return Verdict(int(verdicts_from(np.array([least]), np.array([greatest]))[0])), tier

    def _sign_of_least(self, t: Floats, tier: Tier) -> tuple[int, Tier]:
        """Return the sign of the least t.g over the set, and the tier that found it.

        Clarabel finds it if its solution proves it. Otherwise it is computed in rationals.
        """
        sign, point = (
            self.programs.sign_of_least(t, self.inside) if self.inside is not None else (0, None)
        )
        if point is not None:
            add_point(self._known, point)
        if sign != 0:
            return sign, tier
        exact = minimise_exactly(t, self.region)
        with np.errstate(all="ignore"):
            add_vertex(self._known, exact.basis)
        add_point(self._known, exact.g.astype(np.float64))
        if exact.value >= 0:
            self._known = add_row(self._known, t)
        return int(exact.value > 0) - int(exact.value < 0), Tier.EXACT


def _check_some(region: Region) -> None:
    """Raise Empty if no point satisfies the region's constraints."""
    proof = is_empty(region)
    if proof is not None:
        raise Empty(region, proof)
