"""Findings of a session about the scale, in numbers that a person reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from elicit.model.comparator import Comparator, best_guess, bounds_of, trusted_share, wrong_of
from elicit.model.outcomes import assumed_of_answers
from elicit.person.showing import printable


class ScaleRow(NamedTuple):
    """The value of a level, from 0 to 100: the best guess, and an interval.

    The interval is rounded outwards to whole numbers.
    """

    label: str
    value: float
    low: float
    high: float


def scale_rows(comparator: Comparator, labels: Sequence[str]) -> list[ScaleRow]:
    """Return the value of each of the k levels, best first.

    Parameters
    ----------
    comparator : Comparator
    labels : (k,) str
        Names of the levels, worst first.

    Returns
    -------
    list of ScaleRow
    """
    ends = np.eye(len(labels)) - np.eye(len(labels))[0]
    low, high = bounds_of(comparator, ends)
    values = 100.0 * best_guess(comparator)
    # rounded outwards, so that the statement holds
    low = np.clip(np.floor(100.0 * low + 1e-6), 0, 100)
    high = np.clip(np.ceil(100.0 * high - 1e-6), 0, 100)
    low[-1] = 100.0
    high[0] = 0.0
    rows = [
        ScaleRow(printable(label), float(value), float(least), float(most))
        for label, value, least, most in zip(labels, values, low, high, strict=True)
    ]
    return rows[::-1]


def certainty(comparator: Comparator) -> str:
    """Return a phrase on how certain each interval of ``scale_rows`` is."""
    level = trusted_share(comparator)
    return (
        assumed_of_answers(wrong_of(comparator), "your")
        if level is None
        else f"each interval with {level:.0%} probability"
    )
