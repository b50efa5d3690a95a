"""Findings of a session about the scale, as numbers for a person to read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import best_guess, trusted_share, unordered_of, wrong_of
from elicit.model.difference import tail_sums
from elicit.model.outcomes import assumed_of_answers
from elicit.person.course.conclusion import listed
from elicit.person.course.level_questions import WIDE, questions_to_narrow
from elicit.person.course.ranges import counted_widths, draws_again, outwards, value_ranges
from elicit.person.showing import printable
from elicit.tutors.answer_log import Entry

_FEW = 3  # levels that are named in a sentence
_AT_AN_END = 1.0  # a best guess is said to lie at an end of a range from so near on, of 100

_NOT_KNOWN = "“Not known yet” (no dot): no answer is about it, or none narrows its range."
_ROUGHLY = (
    f"Hollow dot: a rough best guess, “about” so much, of a range wider than {WIDE:.0f}, or than "
    f"{WIDE / 2:.0f} if it reaches to 0 or 100."
)
_PULLED = (
    "A best guess weighs all answers, and allows for a mistake in each. So it may lie at an end of "
    "the range if no answer is a mistake."
)
_SAME_END = (
    "Where both ranges end alike, your answers allow values beyond that end, but these are too "
    "improbable."
)
_WIDE_BUT_HEARD = (
    "{named} still {has} a wide range although you answered about {it}, because any one answer may "
    "be a mistake."
)
_WIDE_FOR_FEW = "{named} still {has} a wide range. More answers about {it} would narrow it."
_NARROWING = (
    "The values of the levels are known only roughly: about {questions} more questions would "
    "narrow every range to a width of {width:.0f} or less."
)
_ABOUT_EQUAL = (
    "In “If no answer is a mistake”, an answer “equally good” counts as “within {within:.0f} of "
    "100”."
)
OVERLAP = (
    "Ranges may overlap although the order is fixed: a better level is never worth less than a "
    "worse one."
)
"""The sentence beside ranges that overlap."""


class ScaleRow(NamedTuple):
    """The value of a level, from 0 to 100: the best guess, and an interval.

    The interval is rounded outwards to whole numbers. ``asked`` is False if no answer is about the
    level: its best guess then comes from the program, not from the person.

    ``known`` is False if no answer is about the level, or its interval counts as wider than
    ``WIDE`` (see ``counted_widths``).

    ``rough`` is True if the level is not ``known``, but answers are about it and its interval is
    less than the whole scale. Its best guess is "about" 75, where that of another level is "not
    known yet".

    ``given`` has the two ends of the range if no answer is a mistake (see ``given_in``).
    """

    label: str
    value: float
    low: float
    high: float
    asked: bool = True
    known: bool = True
    rough: bool = False
    given: Sequence[float] | None = None


def guess_in_words(value: float, known: bool, rough: bool) -> str:
    """Return the best guess of a row as it is shown, or words in its place."""
    if known:
        return f"{value:.0f}"
    return f"about {value:.0f}" if rough else "not known yet"


def values_in_words(rows: Iterable[ScaleRow]) -> str:
    """Return the best guess of each row in one sentence, such as "well 100, ill about 40, dead 0".

    Parameters
    ----------
    rows : sequence of ScaleRow
        The levels, best first.
    """
    said = [f"{row.label} {guess_in_words(row.value, row.known, row.rough)}" for row in rows]
    return f"{', '.join(said)}." if said else ""


def is_narrower(given: Sequence[float] | None, low: float, high: float) -> bool:
    """Return whether the range if no answer is a mistake is known, and less than the whole one."""
    return given is not None and given[1] - given[0] < high - low


def given_in(row: ScaleRow, as_given: Sequence[ScaleRow]) -> tuple[float, float] | None:
    """Return the range of a row's level if no answer is a mistake, or None.

    It is None if no answer is about the level, or if no value is in both that range and the row's
    own. Otherwise it is what both have in common.

    Parameters
    ----------
    row : ScaleRow
    as_given : sequence of ScaleRow
        The rows of a comparator that takes every answer as given; none if the answers contradict
        each other.
    """
    for one in as_given:
        if one.label == row.label and row.asked and row.low < row.high:
            low, high = max(one.low, row.low), min(one.high, row.high)
            return (low, high) if low <= high else None
    return None


def scale_notes(
    rows: Sequence[ScaleRow],
    comparator: Comparator,
    settled: bool,
    as_given: Sequence[ScaleRow] = (),
    about_equal: float = 0.0,
) -> list[str]:
    """Return sentences beside the rows of a comparator: on wide ranges, and on the order.

    Parameters
    ----------
    rows : sequence of ScaleRow
    comparator : Comparator
    settled : bool
        True if the result is settled.
    as_given : sequence of ScaleRow
        The rows of a comparator that takes every answer as given; none if the answers contradict
        each other.
    about_equal : float
        The share of the value range within which that comparator takes things called equal to be; 0
        if nothing was called so.
    """
    hollow = [row for row in rows if not row.known]
    notes = _on_wide(rows, comparator, as_given)
    given = [(row, ends) for row in rows if (ends := given_in(row, as_given)) is not None]
    if any(is_narrower(ends, row.low, row.high) for row, ends in given):  # else none is shown
        if about_equal > 0:
            notes.append(_ABOUT_EQUAL.format(within=100.0 * about_equal))
        if any(_at_an_end(row, ends) for row, ends in given):
            notes.append(_PULLED)
        if any(_is_cut(row, as_given) for row, _ in given):
            notes.append(_SAME_END)
    if not all(row.rough for row in hollow):
        notes.append(_NOT_KNOWN)
    if any(row.rough for row in hollow):
        notes.append(_ROUGHLY)
    if hollow:
        it = "it" if len(hollow) == 1 else "them"
        named = listed([f"“{row.label}”" for row in hollow])
        those = named if len(hollow) <= _FEW else "these levels"
        allows = f"The result allows for all that is still possible for {those}"
        needs = f", and does not need to know {it} more exactly" if settled else ""
        notes.append(f"{allows}{needs}.")
    if overlap(rows):
        notes.append(OVERLAP)
    return notes


def _at_an_end(row: ScaleRow, given: tuple[float, float]) -> bool:
    """Return whether a best guess, if shown, is at an end of its range ``given``."""
    near = min(abs(row.value - end) for end in given) <= _AT_AN_END
    return (row.known or row.rough) and near and given[1] - given[0] > _AT_AN_END


def _is_cut(row: ScaleRow, as_given: Sequence[ScaleRow]) -> bool:
    """Return whether answers taken as given allow values beyond just one end of a row's range."""
    [one] = [each for each in as_given if each.label == row.label]
    return (one.low < row.low) != (one.high > row.high)


def _on_wide(
    rows: Sequence[ScaleRow], comparator: Comparator, as_given: Sequence[ScaleRow]
) -> list[str]:
    """Return sentences on why ranges that answers are about are wide, and what narrows them.

    They name just the rows that have no exact best guess although they are ``asked``.
    """
    wide = [row for row in rows if row.asked and not row.known]
    if not wide:
        return []
    sure = trusted_share(comparator) is not None
    each = [f"“{row.label}” ({row.low:.0f} to {row.high:.0f})" for row in wide]
    words = {"has": "has", "it": "it"} if len(wide) == 1 else {"has": "have", "it": "them"}
    because = _WIDE_BUT_HEARD if sure or wrong_of(comparator) > 0 else _WIDE_FOR_FEW
    said = because.format(named=listed(each), **words)
    # otherwise the range if no answer is a mistake stands beside each
    return [] if all(given_in(row, as_given) for row in wide) else [said]


def narrowing(rows: Sequence[ScaleRow], comparator: Comparator) -> str:
    """Return a sentence on how many questions would narrow the wide ranges, or "".

    How many it takes was measured for a posterior, so nothing is said of other comparators.
    """
    low, high = (np.array([getattr(row, end) for row in rows]) for end in ("low", "high"))
    widths = counted_widths(low, high)
    if trusted_share(comparator) is None or widths.max() <= WIDE:
        return ""
    least, most = questions_to_narrow(widths.tolist())
    questions = f"{least} to {most}" if least < most else f"{most}"
    return _NARROWING.format(questions=questions, width=WIDE)


def overlap(rows: Sequence[ScaleRow]) -> bool:
    """Return whether the ranges of two neighbouring levels overlap; ``rows`` are best first."""
    return any(worse.high > better.low for better, worse in pairwise(rows))


def asked_levels(log: Iterable[Entry]) -> set[int]:
    """Return the levels (0 the worst) that an informative answer is about.

    Such an answer stands, is used, has a verdict, and does not follow from the order of the levels.
    """
    said = [
        entry.answer.query.d for entry in log if entry.used and entry.answer.verdict is not None
    ]
    d = np.array([row for row in said if (tail_sums(row) > 0).any() and (tail_sums(row) < 0).any()])
    return set(np.flatnonzero((d != 0).any(axis=0)).tolist()) if len(d) else set()


def scale_rows(
    comparator: Comparator, labels: Sequence[str], log: Iterable[Entry] | None = None
) -> list[ScaleRow]:
    """Return the value of each of the k levels, best first.

    Parameters
    ----------
    comparator : Comparator
    labels : (k,) str
        Names of the levels, worst first.
    log : entries, optional
        The answers. Default: every level counts as asked about.

    Returns
    -------
    list of ScaleRow
    """
    k = len(labels)
    asked = set(range(k)) if log is None else {0, k - 1} | asked_levels(log)
    open_step = unordered_of(comparator) or (-1, -1)
    low, high = value_ranges(comparator, draws_again(comparator))
    values = 100.0 * best_guess(comparator)
    low, high = outwards(low, high)
    if open_step[1] != k - 1:
        low[-1] = 100.0
    if open_step[0] != 0:
        high[0] = 0.0
    rows, widths = [], counted_widths(low, high)
    for level, label in enumerate(labels):
        ends = float(low[level]), float(high[level])
        has = level in asked
        known = has and bool(widths[level] <= WIDE)
        rough = has and not known and ends != (0.0, 100.0)
        rows.append(ScaleRow(printable(label), float(values[level]), *ends, has, known, rough))
    return rows[::-1]


def certainty(comparator: Comparator, whose: str = "your") -> str:
    """Return a phrase on how certain each interval of ``scale_rows`` is.

    Parameters
    ----------
    comparator : Comparator
    whose : {"your", "the"}
        The answers' owner, in the phrase.
    """
    level = trusted_share(comparator)
    return (
        assumed_of_answers(wrong_of(comparator), whose)
        if level is None
        else f"with {level:.0%} probability each"
    )
