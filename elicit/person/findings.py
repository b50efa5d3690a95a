"""Findings of a session about the scale, in numbers that a person reads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from elicit.model.comparator import Comparator, bounds_of
from elicit.model.comparator_parts import best_guess, trusted_share, unordered_of, wrong_of
from elicit.model.difference import tail_sums
from elicit.model.outcomes import assumed_of_answers
from elicit.person.showing import printable
from elicit.tutors.answer_log import Entry


class ScaleRow(NamedTuple):
    """The value of a level, from 0 to 100: the best guess, and an interval.

    The interval is rounded outwards to whole numbers. ``asked`` is False for a level that no answer
    is about: its best guess is a guess of the program's, not of the person's.
    """

    label: str
    value: float
    low: float
    high: float
    asked: bool = True


def asked_levels(log: Iterable[Entry]) -> set[int]:
    """Return the levels (0 the worst) that an answer is about.

    The answer stands, is used, and says more than "cannot tell" and than the order of the levels
    does.
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
    worst = open_step if open_step[0] == 0 else (0,)  # a value is that above the worst of these
    above = [bounds_of(comparator, np.eye(k) - np.eye(k)[level]) for level in worst]
    low, high = np.array(above).max(axis=0)
    values = 100.0 * best_guess(comparator)
    # rounded outwards, so that the statement holds
    low = np.clip(np.floor(100.0 * low + 1e-6), 0, 100)
    high = np.clip(np.ceil(100.0 * high - 1e-6), 0, 100)
    if open_step[1] != k - 1:
        low[-1] = 100.0
    if open_step[0] != 0:
        high[0] = 0.0
    rows = [
        ScaleRow(printable(label), float(value), float(least), float(most), level in asked)
        for level, (label, value, least, most) in enumerate(
            zip(labels, values, low, high, strict=True)
        )
    ]
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
