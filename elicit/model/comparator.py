"""The Comparator protocol, the tiers of a decision, and the table from signs to verdicts.

A comparator's optional parts are described in ``comparator_parts``.
"""

from enum import IntEnum
from typing import NamedTuple, Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.validation import is_number, is_whole, require
from elicit.model.query import Answers, InconsistentAnswers, Verdict
from elicit.model.scale import Floats

Verdicts = NDArray[np.int8]
Tiers = NDArray[np.int8]


class Tier(IntEnum):
    """The step that decided a comparison, from the cheapest proof to the tutor."""

    EQUAL = 0  # the vectors are the same
    DOMINANCE = 1  # eq. (4): true for every scale
    SCREEN = 2  # a cheap proof from the answers
    SIMPLEX = 3  # the linear programs over K_t, from one known vertex to the next
    LP = 4  # the linear programs over K_t, solved by Clarabel
    EXACT = 5  # the linear programs over K_t in rational arithmetic: the optimum is 0, or nearly
    MODEL = 6  # a statistical model
    KNOWN = 7  # this very pair was answered before
    INDIFFERENT = 8  # both signs possible, but too close to matter
    # the question budget is spent, or the question put off: the sign at the comparator's best scale
    GUESS = 9
    TUTOR = 10  # asked


TIE = 0.01
"""Default of the largest |d.e| that a tutor may call equal, as a share of the value range."""

ALLOWANCE = 2.0
"""Guarantees hold even if the tutor calls equal two things up to this many ties apart, because
people do not know their own tie."""

BY_ANSWERS = (Tier.SCREEN, Tier.SIMPLEX, Tier.LP, Tier.EXACT, Tier.MODEL)
"""The tiers that depend on the tutor's answers."""


WRONG_ODDS = 0.1
"""Odds of a wrong answer against a right one, by which questions are chosen if some answers may be
wrong. No proof depends on them: benchmarks/RESULTS-wrong.md has tutors of several kinds."""


_MEMBERS = ("k", "values", "bounds", "compare", "update")


@runtime_checkable
class Comparator(Protocol):
    """A comparator: it holds what is known of the scale so far, and decides comparisons.

    It is a frozen value: ``update`` returns a new one. Only these five members are required.
    ``OPTIONAL_PARTS`` lists what else is used if it is there.
    """

    @property
    def k(self) -> int:
        """Number of levels."""

    @property
    def values(self) -> Floats:
        """The best single guess at the scale (k,), from 0 to 1."""

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return the least and the greatest plausible d.e of differences.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        lo, hi : (n,) each, in units of e_k - e_1
        """

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts on differences.

        Totals are not checked. If the totals of two vectors differ, the missing part counts as time
        at level 1, which is worth nothing.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,) int8 verdicts
        """

    def update(self, answers: Answers) -> "Comparator":
        """Return a comparator that also knows these answers; this one stays as it is.

        Parameters
        ----------
        answers : Answers

        Returns
        -------
        Comparator
            Of the same class.

        Raises
        ------
        InconsistentAnswers
            If no scale fits the answers, and the comparator takes them as facts.
        """


class Decisions(NamedTuple):
    """The verdicts on n differences, and the tier (kind of proof) that decided each.

    Attributes
    ----------
    verdicts : ndarray
        (n,) codes of ``Verdict`` as int8.
    tiers : ndarray
        (n,) codes of ``Tier`` as int8. If the verdict is UNKNOWN, the tier means nothing.
    """

    verdicts: Verdicts
    tiers: Tiers


def offers(comparator: object, member: str) -> bool:
    """Return whether a comparator has an optional member, without computing the member.

    A member that is None counts as missing. ``isinstance`` with a runtime Protocol is no
    substitute: before Python 3.12 it reads all members, and so computes a property such as
    ``draws``, in an order that changes from process to process.
    """
    kind = type(comparator)
    if (
        getattr(kind, member, None) is not None
        or getattr(comparator, "__dict__", {}).get(member) is not None
    ):
        return True
    # a wrapper may hand on members that its class does not have: only asking it tells
    return hasattr(kind, "__getattr__") and getattr(comparator, member, None) is not None


def is_comparator(thing: object) -> TypeGuard[Comparator]:
    """Return whether an object has the five members of a comparator, without computing them."""
    return not isinstance(thing, type) and all(offers(thing, member) for member in _MEMBERS)


def bounds_of(comparator: Comparator, d: Floats) -> tuple[Floats, Floats]:
    """Return ``comparator.bounds(d)`` of differences d (n, k), after a check.

    Raises TypeError unless they are lo (n,) <= hi (n,), without nan.
    """
    found = comparator.bounds(d)
    try:
        both = np.asarray(found, dtype=np.float64)
    except (TypeError, ValueError):
        both = np.empty(0)
    if both.shape != (2, len(d)) or not (both[0] <= both[1] + 1e-9 * np.abs(d).sum(axis=1)).all():
        raise TypeError(
            f"{type(comparator).__name__}.bounds(d) must return two arrays (n,), the least and the "
            "greatest d.e (-inf, "
            f"inf where nothing is known), but of d {d.shape} it returns {found!r}; "
            "elicit.testing.check_comparator "
            "tries a comparator out"
        )
    return both[0], both[1]


def value_bounds(comparator: Comparator) -> tuple[Floats, Floats]:
    """Return bounds on each level's value, on a scale from 0 for the worst to 1 for the best.

    Parameters
    ----------
    comparator : Comparator

    Returns
    -------
    low, high : (k,) each
        With the polytope they are proven. With the posterior each of the two ends holds with the
        probability ``level``, so the range between them has the probability 2 * level - 1: 90% by
        default.

    Raises
    ------
    TypeError
        If the comparator's ``bounds`` do not return two arrays, the first at most the second.
    """
    ends = np.eye(comparator.k) - np.eye(comparator.k)[0]
    return bounds_of(comparator, ends)


def learn(
    comparator: Comparator, answers: Answers, one_by_one: bool
) -> tuple[Comparator, NDArray[np.bool_]]:
    """Return the comparator after these answers, and flags (n,) of those that it learned.

    If they contradict each other, InconsistentAnswers is raised. With ``one_by_one`` no error is
    raised, and each answer that contradicts the ones before it is left out.
    """
    taken = np.ones(len(answers), dtype=np.bool_)
    try:
        learned = comparator.update(answers)
        if type(learned) is not type(comparator):
            check_comparator_made(learned)
        if learned.k != comparator.k:
            raise TypeError(f"update made k = {comparator.k} levels into {learned.k}: {learned!r}")
        return learned, taken
    except InconsistentAnswers:
        if not one_by_one:
            raise
        if len(answers) == 1:
            return comparator, ~taken
    for i in range(len(answers)):
        try:
            comparator = comparator.update(answers[i : i + 1])
        except InconsistentAnswers:
            taken[i] = False
    return comparator, taken


def verdicts_from(least: NDArray[np.floating], greatest: NDArray[np.floating]) -> Verdicts:
    """Return the verdict for the signs of the least and the greatest plausible d.e.

    Everything that makes such verdicts uses this table.
    """
    out = np.full(np.shape(least), Verdict.UNKNOWN, dtype=np.int8)
    out[(least >= 0) & (greatest > 0)] = Verdict.BETTER
    out[(greatest <= 0) & (least < 0)] = Verdict.WORSE
    out[(least == 0) & (greatest == 0)] = Verdict.EQUAL
    return out


def check_levels(k: int) -> int:
    """Return the number of levels k as an int, at least 2. Raises ValueError."""
    if not is_whole(k, 2):
        raise ValueError(
            f"k, the number of levels, must be a whole number of at least 2, not {k!r}"
        )
    return int(k)


def check_tie(tie: float) -> float:
    """Return a tie as a float, at least 0 and below 1. Raises ValueError."""
    wanted = "a share of the value range, at least 0 and below 1 (0: equal means equal)"
    require(
        is_number(tie, 0) and tie < 1,
        "tie, the largest |d.e| that a tutor may call equal,",
        wanted,
        tie,
    )
    return float(tie)


def check_comparator_made(comparator: Comparator) -> None:
    """Raise TypeError unless the object is a comparator. The error names the members it lacks.

    A class is refused too: ``PolytopeComparator`` without ``(k=5)`` is not a comparator yet.
    """
    lacking = sorted(set(_MEMBERS) - set(dir(comparator)))
    if isinstance(comparator, type) or lacking:
        without = f", which has no {', '.join(lacking)}" if lacking else ""
        raise TypeError(
            f"a comparator is wanted, such as PolytopeComparator(k=5), not {comparator!r}{without}"
            + ("; only qlearn.solve takes names" if isinstance(comparator, str) else "")
        )


def check_answers(answers: Answers, k: int) -> Answers:
    """Return the answers. Raise TypeError if they are not Answers, ValueError unless k levels."""
    if not isinstance(answers, Answers):
        raise TypeError(
            f"update takes Answers, not {answers!r}: Answers.of(list_of_answers, k) makes them"
        )
    if answers.k != k:
        raise ValueError(
            f"these answers are about {answers.k} levels, but this comparator has k = {k}"
        )
    return answers
