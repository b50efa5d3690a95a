"""The reliable-tutor comparator (section 3.1): what every scale consistent with the answers agrees on.

A verdict is the sign of the exact optimum of the two programs over K_t. It is reached by the cheapest
proof that will do: dominance; known points of K_t of both signs; the closed form over K_0; one known
non-negative row; the multipliers of an optimal vertex, evaluated with a rigorous rounding margin; and near
zero the simplex method in rationals. Proofs and points are kept, which changes time only. ``bounds`` are
Clarabel's, made rigorous in the same way.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit.centre import analytic_centre
from elicit.comparator import Decisions, Tier, Verdicts, check_answers, check_levels, verdicts_from
from elicit.conflict import Contradiction, is_empty
from elicit.lp import Programs, answer_rows, prior_rows, pull_inside, strictly_inside
from elicit.proofs import Proofs
from elicit.query import Answers, Verdict
from elicit.scale import Floats, as_vectors, dominance, order_bounds, tail_sums, values_of
from elicit.simplex import End, Region, minimise, minimise_exactly, rounding


class PolytopeComparator:
    """All scales in K_t: at least ``margin`` (eta) between neighbouring levels, the prior inequalities
    A e >= b (``prior`` = A (p, k), b (p,)), and one inequality for each answer. A frozen value.

    Raises ValueError for k < 2, a margin outside [0, 1/(k-1)], and a prior that no scale satisfies.
    """

    def __init__(self, k: int, margin: float = 1e-6, prior: tuple[ArrayLike, ArrayLike] | None = None) -> None:
        self.k = check_levels(k)
        self.margin = _check_margin(margin, self.k)
        self.answers = Answers.none(self.k)
        self.prior = None if prior is None else _check_prior(prior, self.k)
        self._region = Region(self.margin, *prior_rows(self.prior, self.k))
        if len(self._region.rows) and is_empty(self._region) is not None:
            raise ValueError(
                f"no scale with margin {self.margin:g} satisfies the prior's {len(self._region.rows)} inequalities "
                "A e >= b (with e_1 = 0 and e_k = 1): relax or drop some of them"
            )
        self._all = self._region  # every constraint; _region may lack some that follow from others
        self._proofs = Proofs.start(self._region)

    @cached_property
    def values(self) -> Floats:
        """(k,) the analytic centre of K_t, from 0 to 1; read-only."""
        values = values_of(analytic_centre(self._all))
        values.flags.writeable = False
        return values

    def update(self, answers: Answers) -> PolytopeComparator:
        """K_t cut by these answers. Raises InconsistentAnswers, with a minimal contradictory set of rows
        of ``self.answers + answers``, where that leaves no scale."""
        new = object.__new__(PolytopeComparator)
        new.k, new.margin, new.prior = self.k, self.margin, self.prior
        new.answers = self.answers + check_answers(answers, self.k)
        cuts = answer_rows(answers, len(self.answers))
        new._all = self._all.plus(*cuts)
        news = self._not_implied(*cuts[:2])
        if not len(news):
            new._region, new._proofs = self._region, self._proofs
            return new
        cuts = (cuts[0][news], cuts[1][news], cuts[2][news])
        new._region = self._region.plus(*cuts)
        new._proofs = self._proofs.cut(*cuts[:2])
        if not len(new._proofs.points):
            proof = is_empty(new._region)
            if proof is not None:
                raise Contradiction(new._region, proof, new.answers)
        return new

    def _not_implied(self, rows: Floats, rhs: Floats) -> NDArray[np.intp]:
        """Which cuts are not known to follow from K_t already: the others change nothing."""
        if not len(rows):
            return np.empty(0, dtype=np.intp)
        implied = (rhs == 0) & (self._proofs.screen(rows) == Verdict.BETTER)
        known = {
            row.tobytes() + limit.tobytes() for row, limit in zip(self._region.rows, self._region.rhs, strict=True)
        }
        news = []
        for i in np.flatnonzero(~implied):
            mark = rows[i].tobytes() + rhs[i].tobytes()
            if mark not in known:
                known.add(mark)
                news.append(i)
        return np.array(news, dtype=np.intp)

    def compare(self, d: ArrayLike) -> Verdicts:
        """Verdicts (n,) on differences d (n, k): the sign of the exact optimum over K_t."""
        return self.decide(d).verdicts

    def decide(self, d: ArrayLike) -> Decisions:
        """Verdicts (n,) and the tier of each: EQUAL, DOMINANCE, SCREEN or LP."""
        t = tail_sums(as_vectors(d, self.k))
        verdicts = dominance(t)
        tiers = _TIERS[verdicts]
        if self.margin == 0 and not self._open_gaps.all():  # a gap that is 0 in all of K_t makes no difference
            t = t * self._open_gaps
            by_order, verdicts = verdicts, dominance(t)
            tiers[verdicts != by_order] = Tier.SCREEN
        open_rows = (verdicts == _UNKNOWN).nonzero()[0]
        if len(open_rows) and (self.margin > 0 or len(self._region.rows)):
            t = _unit(t[open_rows])
            found = self._proofs.screen(t)
            for i in (found == Proofs.UNSETTLED).nonzero()[0]:
                found[i], tiers[open_rows[i]] = self._solve(t[i]), Tier.LP
            verdicts[open_rows] = found
        return Decisions(verdicts, tiers)

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Outer bounds lo (n,), hi (n,) on d.e over K_t, tight to 1e-9 |d|_1."""
        rows = as_vectors(d, self.k)
        _, exponent = np.frexp(np.abs(rows[:, 1:]).max(axis=1, initial=0.0))
        with np.errstate(over="ignore"):
            t = tail_sums(np.ldexp(rows, -exponent[:, None]))
        low, high = order_bounds(t, self.margin)
        doubt = rounding(self.k, 4.0 * np.abs(t).max(axis=1, initial=0.0))
        low, high = low - doubt, high + doubt
        if len(self._region.rows):
            low = np.maximum(low, [self._programs.least(row, self._inside) for row in t])
            high = np.minimum(high, [-self._programs.least(-row, self._inside) for row in t])
        some = t.any(axis=1)
        with np.errstate(over="ignore", under="ignore"):
            low, high = np.ldexp(low, exponent), np.ldexp(high, exponent)
        # one step outwards: the results may have lost bits on the way back
        return np.where(some, np.nextafter(low, -np.inf), 0.0), np.where(some, np.nextafter(high, np.inf), 0.0)

    @property
    def solves(self) -> int:
        """How many linear programs Clarabel has solved for this comparator."""
        return self._programs.solves

    @cached_property
    def _programs(self) -> Programs:
        return Programs(self._region)

    @cached_property
    def _inside(self) -> Floats | None:
        """A point strictly inside K_t: the mean of the known points if it is, else the centre; None where
        K_t is too flat to have one."""
        if len(self._proofs.points):
            mean: Floats = self._proofs.points.mean(axis=0)
            mean /= mean.sum()
            if strictly_inside(mean, self._region):
                return mean
        centre = analytic_centre(self._region)
        if not strictly_inside(centre, self._region):
            return None
        self._proofs.add_point(centre)
        return centre

    @cached_property
    def _open_gaps(self) -> NDArray[np.bool_]:
        """Which gaps (p,) are greater than 0 somewhere in K_t: with a margin of 0 the answers can close some."""
        if not len(self._region.rows) or self._inside is not None:
            return np.ones(self.k - 1, dtype=bool)
        is_open: NDArray[np.bool_] = np.asarray((self._proofs.points > 0).any(axis=0))
        for j in np.flatnonzero(~is_open):
            widest = minimise_exactly(-np.eye(self.k - 1)[j], self._region)
            self._proofs.add_point(widest.g.astype(np.float64))
            is_open[j] = widest.value < 0
        return is_open

    def _solve(self, t: Floats) -> Verdict:
        """Section 3.1's two programs, the second only where needed: a known point of K_t on one side of
        zero already settles the sign of one optimum."""
        side = self._proofs.sides(t[None, :])
        least = -1 if side.below[0] else self._sign_of_least(t)
        greatest = 1 if side.above[0] or least > 0 else -self._sign_of_least(-t)
        return Verdict(int(verdicts_from(np.array([least]), np.array([greatest]))[0]))

    def _sign_of_least(self, t: Floats) -> int:
        """The sign of min t.g over K_t, and what proves it."""
        vertex = minimise(t, self._region)
        if vertex.end is End.OPTIMAL:
            if self._proofs.vertices.add(self._region, vertex.basis, t):
                return 1
            if float(t @ vertex.g) < 0 and self._inside is not None:
                point = pull_inside(vertex.g, self._inside, self._region)
                if point is not None and float(t @ point) < -rounding(self.k, float(np.abs(t) @ point)):
                    self._proofs.add_point(point)
                    return -1
        exact = minimise_exactly(t, self._region)
        self._proofs.add_point(exact.g.astype(np.float64))
        if exact.value >= 0:
            self._proofs.add_row(t)
        return int(exact.value > 0) - int(exact.value < 0)


_UNKNOWN = np.int8(Verdict.UNKNOWN)  # an array is compared with this three times faster than with an enum
_TIERS = np.array([Tier.EQUAL, Tier.DOMINANCE, Tier.SCREEN, Tier.DOMINANCE], dtype=np.int8)
"""Tiers by the verdict of dominance: equal, better, open, and (-1, the last) worse."""


def _unit(t: Floats) -> Floats:
    """Each row scaled by a power of two to a largest entry in [1/2, 1): exact, and no sign changes. A row
    whose entries span more than floats can hold below 1 stays as it is."""
    _, exponent = np.frexp(np.abs(t).max(axis=1, initial=0.0))
    scaled: Floats = np.ldexp(t, -exponent[:, None])
    if (exponent > 0).any():  # only downwards can bits be lost
        lost = (np.ldexp(scaled, exponent[:, None]) != t).any(axis=1)
        scaled[lost] = t[lost]
    return scaled


def _check_margin(margin: float, k: int) -> float:
    if not (np.isfinite(margin) and 0 <= margin <= 1.0 / (k - 1)):
        raise ValueError(
            f"the margin eta must lie between 0 and 1/(k-1) = {1 / (k - 1):g}, or no {k} levels fit between 0 and 1; "
            f"it is {margin!r}"
        )
    return float(margin)


def _check_prior(prior: tuple[ArrayLike, ArrayLike], k: int) -> tuple[Floats, Floats]:
    a = as_vectors(prior[0], k, name="the prior's A")
    b = np.atleast_1d(np.asarray(prior[1], dtype=np.float64))
    if b.shape != (len(a),) or not np.isfinite(b).all():
        raise ValueError(f"the prior's b must be {len(a)} finite numbers, one a row of A, not {prior[1]!r}")
    return a, b
