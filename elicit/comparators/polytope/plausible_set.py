"""K_t as a set of gap vectors: the sign of t.g over it, exactly, and rigorous bounds.

Most signs are settled in compiled code (``settle``). What that leaves goes to the simplex method in rationals,
whose optimum, multipliers and basis are kept as proofs. ``bounds`` are Clarabel's, made rigorous.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit.decision.rule import Rule, proven
from elicit.lp.dual_simplex import Region, Vertex, minimise_exactly, rounding
from elicit.lp.infeasibility import is_empty
from elicit.lp.programs import Programs, certified_bound, pull_inside
from elicit.lp.sign import settle, settle_all, to_unit
from elicit.lp.support_function import greatest
from elicit.lp.vertex_store import add_corner, add_point, add_row, cut, has_point, prune, refresh, start
from elicit.lp.vertices import DOUBTFUL_CORNER, USED
from elicit.model.comparator import Decisions, Tier, verdicts_from
from elicit.model.query import Verdict
from elicit.model.scale import Floats, order_bounds, tail_sums
from elicit.model.tail_sums_kernel import UNSETTLED


class Empty(ValueError):
    """No point satisfies the rows of ``region``; ``proof`` names some that alone contradict each other."""

    def __init__(self, region: Region, proof: Vertex) -> None:
        super().__init__("no scale satisfies all of these constraints")
        self.region = region
        self.proof = proof


class PlausibleSet:
    """The set {g >= margin, sum g = 1, rows g >= rhs} with everything proven about it so far. The set never
    changes; what is known of it grows, which changes time only. Raises Empty."""

    def __init__(self, region: Region) -> None:
        if len(region.rows):
            _check_some(region)
        self.region = region
        self._known = start(region)
        self._pruned_to = len(region.rows)
        self._gaps_known = False

    def cut(self, rows: Floats, rhs: Floats, owner: NDArray[np.int64]) -> PlausibleSet:
        """The part of it that satisfies further rows, without those that follow from others. Raises Empty."""
        part = self
        for i in range(len(rows)):
            if not part._holds(rows[i], float(rhs[i])):
                part = part._cut(rows[i : i + 1], rhs[i : i + 1], owner[i : i + 1])
        return part

    @property
    def inside(self) -> Floats | None:
        """A point (p,) strictly inside; None where the set is too flat for floats to have one."""
        return None if np.isnan(self._known.inside[0]) else self._known.inside

    @cached_property
    def programs(self) -> Programs:
        """Clarabel over this set."""
        return Programs(self.region)

    def decide(self, d: Floats) -> Decisions:
        """Verdicts (n,) and tiers (n,) of valid differences d (n, k)."""
        self._close_gaps()
        d = np.require(d, requirements=["C", "W"])  # compiled code is made for one layout
        verdicts, tiers = np.empty(len(d), dtype=np.int8), np.empty(len(d), dtype=np.int8)
        with np.errstate(all="ignore"):
            left = settle_all(d, self._known, verdicts, tiers)
        if left:
            for i in (verdicts == UNSETTLED).nonzero()[0]:
                verdicts[i], tiers[i] = self._solve(d[i])
        return Decisions(verdicts, tiers)

    @property
    def rule(self) -> Rule:
        """The proofs as plain arrays, for ``elicit.decision.judge``."""
        self._close_gaps()
        return proven(self._known)

    def bounds(self, d: Floats) -> tuple[Floats, Floats]:
        """Outer bounds (n,) on d.e for valid differences d (n, k), tight to 1e-9 |d|_1."""
        _, exponent = np.frexp(np.abs(d[:, 1:]).max(axis=1, initial=0.0))
        with np.errstate(over="ignore"):
            t = tail_sums(np.ldexp(d, -exponent[:, None]))
        low, high = order_bounds(t, self.region.margin)
        doubt = rounding(self.region.p + 1, 4.0 * np.abs(t).max(axis=1, initial=0.0))
        low, high = low - doubt, high + doubt
        if len(self.region.rows):
            low = np.maximum(low, [self.programs.least(row, self.inside) for row in t])
            high = np.minimum(high, [-self.programs.least(-row, self.inside) for row in t])
        some = t.any(axis=1)
        with np.errstate(over="ignore", under="ignore"):
            low, high = np.ldexp(low, exponent), np.ldexp(high, exponent)
        # one step outwards: the results may have lost bits on the way back
        return np.where(some, np.nextafter(low, -np.inf), 0.0), np.where(some, np.nextafter(high, np.inf), 0.0)

    def greatest(self, d: Floats) -> Floats:
        """Upper bounds (n,) on d.e for valid differences d (n, k), tight to 1e-9 |d|_1 where positive: from the corners
        that walks find, else from Clarabel."""
        high = greatest(d, self._known)
        if len(self.region.rows) and len(d):
            points = self._known.points[:, : self._known.counts[USED]]
            reached = (tail_sums(d) @ points).max(axis=1, initial=-np.inf)
            for i in np.flatnonzero((high > 0) & (high - reached > 1e-9 * np.abs(d).sum(axis=1))):
                high[i] = min(high[i], self.bounds(d[i : i + 1])[1][0])
        return high

    def _cut(self, row: Floats, rhs: Floats, owner: NDArray[np.int64]) -> PlausibleSet:
        """The part of it that satisfies one more row (1, p)."""
        new = object.__new__(PlausibleSet)
        region, new._pruned_to, new._gaps_known = self.region.plus(row, rhs, owner), self._pruned_to, False
        with np.errstate(all="ignore"):
            known = cut(self._known, region, 1)
            if not has_point(known):
                _check_some(region)
            known = refresh(known, region, 1)
            if len(region.rows) > new._pruned_to * 1.3 + 2:
                known, region = prune(known, region)
                new._pruned_to = len(region.rows)
        new.region, new._known = region, known
        return new

    def _holds(self, row: Floats, limit: float) -> bool:
        """Whether row.g >= limit is known to follow already: then it changes nothing."""
        with np.errstate(all="ignore"):
            if limit == 0 and settle(row, self._known) in (Verdict.BETTER, Verdict.EQUAL):
                return True
        return bool(((self.region.rows == row).all(axis=1) & (self.region.rhs == limit)).any())

    def _close_gaps(self) -> None:
        """With a margin of 0 the rows can close gaps, which then make no difference."""
        if self._gaps_known or self.region.margin > 0 or not len(self.region.rows) or self.inside is not None:
            return
        p, known = self.region.p, self._known
        for j in range(p):
            widest = minimise_exactly(-np.eye(p)[j], self.region)
            add_point(known, widest.g.astype(np.float64))
            known.open[j] = float(widest.value < 0)
        self._gaps_known = True

    def _solve(self, d: Floats) -> tuple[Verdict, Tier]:
        """Section 3.1's two programs, the second only where needed: a known point on one side of zero already
        settles the sign of one optimum."""
        t = tail_sums(d) * self._known.open
        to_unit(t)
        tier, least, greatest = Tier.LP, -1, 1
        side = self._sides(t)
        if not side.below:
            least, tier = self._sign_of_least(t, tier)
        if least <= 0 and not side.above:
            sign, tier = self._sign_of_least(-t, tier)
            greatest = -sign
        return Verdict(int(verdicts_from(np.array([least]), np.array([greatest]))[0])), tier

    def _sign_of_least(self, t: Floats, tier: Tier) -> tuple[int, Tier]:
        """The sign of min t.g over the set, by Clarabel where its solution proves it, else in rationals."""
        found = self.programs.solve(t) if self.inside is not None else None
        if found is not None:
            if certified_bound(t, found.y, self.region) > 0:
                return 1, tier
            point = pull_inside(found.g, self._known.inside, self.region)
            if point is not None and float(t @ point) < -rounding(self.region.p, 4.0 * float(np.abs(t) @ point)):
                add_point(self._known, point)
                return -1, tier
        exact = minimise_exactly(t, self.region)
        with np.errstate(all="ignore"):
            add_corner(self._known, exact.basis)
        add_point(self._known, exact.g.astype(np.float64))
        if exact.value >= 0:
            self._known = add_row(self._known, len(self.region.rows), t)
        return int(exact.value > 0) - int(exact.value < 0), Tier.EXACT

    def _sides(self, t: Floats) -> Sides:
        """On which sides of zero known points prove t.g to lie."""
        used = self._known.counts[USED]
        points = self._known.points[:, :used][:, self._known.kind[:used] != DOUBTFUL_CORNER]
        at, doubt = t @ points, rounding(self.region.p, 4.0 * float(np.abs(t).max(initial=0.0)))
        return Sides(bool((at > doubt).any()), bool((at < -doubt).any()))


class Sides(NamedTuple):
    """Whether a known point has t.g certainly > 0, and one certainly < 0."""

    above: bool
    below: bool


def _check_some(region: Region) -> None:
    """Raise Empty where no point satisfies the region's constraints."""
    proof = is_empty(region)
    if proof is not None:
        raise Empty(region, proof)
