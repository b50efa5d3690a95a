"""Smallest sets of answers that decide a comparison, with a proof to check by hand.

A decided verdict says that d.e >= 0 for every scale in K_t (BETTER), that -d.e is (WORSE), or both
(EQUAL). Its proof is an identity in e, with e_1 = 0 and e_k = 1 and every multiplier positive,

    d.e = sum y_i (s_i d_i . e) + sum z_j (e_{j+1} - e_j) + sum w_l (A_l . e) + remainder (e_k -
    e_1).

It adds up answered differences d_i, steps of the order and prior inequalities. The sign s_i turns
each difference to the answered side: s_i d_i . e >= 0, or >= -tie if it was "equal". Such a proof
exists by linear programming duality (Farkas 1902). Its answers and prior inequalities are
irreducible: a deletion filter (Chinneck and Dravnieks 1991) has dropped each that is not needed. So
without any one of those listed, the verdict would not follow from the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.validation import is_list, require
from elicit.comparators.polytope.explanation import (
    Explanation,
    Proof,
    UsedAnswer,
    UsedPrior,
    UsedStep,
)
from elicit.lp.clarabel_programs import Programs
from elicit.lp.dual_simplex import Numbers, minimise_exactly
from elicit.lp.prior_inequalities import Prior
from elicit.lp.region import Region
from elicit.lp.rounding import strictly_inside
from elicit.model.comparator import Comparator
from elicit.model.difference import as_differences, of_order_one, tail_sums
from elicit.model.query import Answers, Verdict
from elicit.model.scale import Floats, exact_dot, order_bounds

_MOST_SINGLES = 3  # number of single answers to try in rationals before a set of them


class Polytope(Comparator, Protocol):
    """The parts of ``PolytopeComparator`` that an explanation uses.

    It is used in place of that class, because the class's module imports this one.
    """

    margin: float
    tie: float
    answers: Answers
    prior: Prior | None

    @property
    def region(self) -> Region:
        """K_t as linear constraints on the gaps, including redundant ones."""


def explain(d: ArrayLike, comparator: Polytope, labels: Sequence[str] | None = None) -> Explanation:
    """Return the answers, steps of the order and prior inequalities that force a verdict.

    The proof's multipliers are those of an optimal vertex, found in rationals, at most k - 2 of
    them. An interior point would give every step of the order a small multiplier. Clarabel tests
    which rows can be left out, and each result is proven. A proof that needs no margin is
    preferred.

    Parameters
    ----------
    d : (k,)
        A difference left - right.
    comparator : PolytopeComparator
    labels : (k,) str, optional
        Names of levels, worst first, for the sentence. Default: "level 1", ...

    Returns
    -------
    Explanation

    Raises
    ------
    ValueError
        For other shapes.
    """
    rows = as_differences(d, comparator.k)
    if len(rows) != 1:
        raise ValueError(
            f"explain takes one difference of shape ({comparator.k},), not {len(rows)} of them"
        )
    require(
        labels is None or is_list(labels, comparator.k),
        "labels",
        f"{comparator.k} names, one a level",
        labels,
    )
    names = (
        tuple(f"level {i + 1}" for i in range(comparator.k))
        if labels is None
        else tuple(map(str, labels))
    )
    one, region = rows[0].copy(), comparator.region
    one.flags.writeable = False
    verdict, t = Verdict(int(comparator.compare(one)[0])), of_order_one(rows[:1]).t[0]
    made = Explanation(one, verdict, names, comparator.margin, comparator.tie)
    if not t.any():
        return made
    if verdict is Verdict.UNKNOWN:
        least, greatest = minimise_exactly(t, region).g, minimise_exactly(0.0 - t, region).g
        scales = _moderate(greatest, least, t), _moderate(least, greatest, t)
        return replace(made, scales=scales, told_equal=_told_equal(one, comparator.answers))
    signs = (1, -1) if verdict is Verdict.EQUAL else (int(verdict),)
    owners = _needed([sign * t + 0.0 for sign in signs], region, comparator)
    proofs = tuple(
        _proof(sign, one, t, region.take(np.isin(region.owner, owners)), comparator)
        for sign in signs
    )
    if verdict is Verdict.EQUAL or proofs[0].bound > 0:
        return replace(made, proofs=proofs)
    return replace(
        made, proofs=proofs, scales=(_scale(minimise_exactly(-int(verdict) * t + 0.0, region).g),)
    )


def _needed(goals: list[Floats], region: Region, comparator: Polytope) -> list[int]:
    """Return answers and prior inequalities that prove t.g >= 0 for each goal t, none superfluous.

    They are given by number, as the region's ``owner``; the order of the levels is used freely.
    Small sets are tried first: none, the prior inequalities, single answers, then the answers used
    at an optimal vertex. From the last set each one that is not needed is dropped, beginning with
    the latest. So an explanation changes little as more is learned.
    """
    nothing = np.zeros(len(region.rows), dtype=bool)
    if all(_never_negative(t, region.take(nothing), None) for t in goals):
        return []
    centre: Floats = np.diff(comparator.values)
    inside = centre if strictly_inside(centre, region) else None

    def enough(keep: NDArray[np.bool_]) -> bool:
        return all(_never_negative(t, region.take(keep), inside) for t in goals)

    tries = [region.owner < 0] if (region.owner < 0).any() else []
    tries += [region.owner == owner for owner in _single(goals, region)]
    part = region.take(next((keep for keep in tries if enough(keep)), ~nothing))
    owners = sorted(
        {int(part.owner[i]) for t in goals for i in np.flatnonzero(minimise_exactly(t, part).y)}
    )
    for owner in owners[::-1]:
        rest = [other for other in owners if other != owner]
        if enough(np.isin(region.owner, rest)):
            owners = rest
    return owners


def _single(goals: list[Floats], region: Region) -> list[int]:
    """Return numbers of answers each of which may prove t.g >= 0 alone, for a single goal t.

    An answer w.g >= 0 proves it if t >= lambda w for some lambda >= 0. Only the least lambda is
    tried for which this holds at the negative entries of t. Answers that need the fewest steps of
    the order come first. The search is in floats, so the caller must prove that an answer suffices.
    """
    if len(goals) > 1:
        return []
    t, down = goals[0], goals[0] < 0
    with np.errstate(all="ignore"):
        ratios = np.where(region.rows[:, down] < 0, t[down] / region.rows[:, down], np.inf)
        rest = t - ratios.max(axis=1, initial=0.0)[:, None] * region.rows
    found = np.flatnonzero((rest.min(axis=1) > -1e-12) & (region.rhs == 0) & (region.owner >= 0))
    fewest = np.argsort((rest[found] > 1e-12).sum(axis=1), kind="stable")[:_MOST_SINGLES]
    return [int(region.owner[i]) for i in found[fewest]]


def _never_negative(t: Floats, region: Region, inside: Floats | None) -> bool:
    """Return whether t.g >= 0 is proven on the whole region, by floats or by the exact optimum."""
    if not len(region.rows):
        return bool(_least_by_order(_exact(t), region) >= 0)
    sign, _ = Programs(region).sign_of_least(t, inside) if np.abs(t).max() < 1 else (0, None)
    return sign > 0 if sign != 0 else bool(minimise_exactly(t, region).value >= 0)


def _proof(sign: int, d: Floats, t: Floats, part: Region, comparator: Polytope) -> Proof:
    """Return the proof that sign * d.e >= 0, with multipliers in the units of the answers.

    The multipliers are those of an optimal vertex over the region ``part``. ``t`` are d's tail
    sums, divided by a power of two.
    """
    known, told = comparator.prior, comparator.answers
    goal = sign * t + 0.0
    found = minimise_exactly(goal, part.take(np.ones(len(part.rows), dtype=bool), margin=0.0))
    if found.value < 0:
        found = minimise_exactly(goal, part)
    rest = sign * _tails(d)
    size = rest[_largest(goal)] / Fraction(float(goal[_largest(goal)]))
    limit, answers, prior = Fraction(0), [], []
    for i in np.flatnonzero(found.y):
        owner, j = int(part.owner[i]), _largest(part.rows[i])
        tails = _tails(told.d[owner] if known is None or owner >= 0 else known.a[-1 - owner])
        unit = tails[j] / Fraction(float(part.rows[i, j]))  # the divisor of the row
        side, weight = (1 if unit > 0 else -1), found.y[i] * size / abs(unit)
        rest = rest - weight * side * tails
        limit += weight * abs(unit) * Fraction(float(part.rhs[i]))
        if known is None or owner >= 0:
            answers.append(
                UsedAnswer(owner, told.ids[owner], side, weight, equal=bool(told.y[owner] == 0))
            )
        else:
            prior.append(UsedPrior(-1 - owner, known.names[-1 - owner], weight))
    left = min(rest)
    order = tuple(UsedStep(j, r - left) for j, r in enumerate(rest) if r > left)
    bound = limit + _least_by_order(rest, part)
    if bound < 0:
        raise ArithmeticError(
            f"the verdict on d = {d} does not follow from what is known: please report this"
        )
    return Proof(
        sign, tuple(sorted(answers)), order, tuple(sorted(prior)), left, bound, limit + left
    )


def _tails(d: Floats) -> Numbers:
    """Return the tail sums of d (k,), computed in floats, as exact rationals.

    Comparisons and explanations are about these numbers.
    """
    return _exact(tail_sums(d))


def _least_by_order(t: Numbers, region: Region) -> Fraction:
    """Return the least t.g over all ordered scales, as an exact rational."""
    margin: Any = region.exact_margin
    least: Any = order_bounds(t, margin)[0]
    return Fraction(least)


def _told_equal(d: Floats, answers: Answers) -> int | None:
    same = [(answers.d[:, 1:] == s * d[1:]).all(axis=1) for s in (1, -1)]
    found = np.flatnonzero((same[0] | same[1]) & (answers.y == 0))
    return int(found[0]) if len(found) else None


def _moderate(g: Numbers, other: Numbers, t: Floats) -> Numbers:
    """Return a scale that gives t.g the same sign as vertex g does, but is less extreme.

    It lies between g and another vertex, and so is easier to picture.
    """
    for share in (Fraction(1, 4), Fraction(1, 16)):
        mixed: Numbers = (1 - share) * g + share * other
        if exact_dot(t, mixed) * exact_dot(t, g) > 0:
            return _scale(mixed)
    return _scale(g)


def _scale(g: Numbers) -> Numbers:
    return np.array([Fraction(0), *np.cumsum(g)], dtype=object)


def _exact(numbers: Floats) -> Numbers:
    return np.array([Fraction(float(x)) for x in numbers], dtype=object)


def _largest(row: Numbers) -> int:
    return int(np.argmax(np.abs(row)))
