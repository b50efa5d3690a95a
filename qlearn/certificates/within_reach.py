"""A rough figure for the tolerance that a number of questions can reach if the tutor errs.

Let a tutor's answers follow the paper's eq. (6) with precision c, and lapse q. An answer about a
difference has at most the Fisher information (c (1 - q) / 2)^2 about d.e. After n answers the 95%
interval of a single number is about 2 * 1.645 * 2 / (c (1 - q) sqrt(n)) wide, in units of the value
range. Half of that is the tolerance within reach. It is rough, because a policy depends on several
numbers, but not on all to that accuracy.
"""

from __future__ import annotations

import math

from elicit.model.comparator import Comparator

Z = 1.645  # standard deviations that leave 5% on one side
GRACE = 2.0
"""A tolerance is called out of reach only if it is this many times smaller than the one within
reach."""
ENOUGH_ANSWERS = 30  # with fewer answers a learned precision says little


def tolerance_within_reach(comparator: Comparator, questions: int) -> float:
    """Return roughly the tolerance that can be reached by a number of questions to this tutor.

    Parameters
    ----------
    comparator : Comparator
        Has learned the tutor's precision, and perhaps the lapse.
    questions : int
        Number of questions in all.

    Returns
    -------
    float
        A share of the value range, at most 1. nan if the comparator does not learn a precision.
    """
    precision = getattr(comparator, "precision", None)
    if not isinstance(precision, float) or questions < 1:
        return math.nan
    told = precision * (1.0 - float(getattr(comparator, "lapse", 0.0) or 0.0))
    if told <= 0.0:
        return 1.0
    return min(1.0, 2.0 * Z / (told * math.sqrt(questions)))


def out_of_reach(comparator: Comparator, tolerance: float, questions: int) -> bool:
    """Return whether a number of questions is probably too small to reach a tolerance.

    Parameters
    ----------
    comparator : Comparator
        If it has learned from fewer than 30 answers, the result is False.
    tolerance : float
    questions : int

    Returns
    -------
    bool
    """
    answers = getattr(comparator, "answers", ())
    if len(answers) < ENOUGH_ANSWERS:
        return False
    return tolerance_within_reach(comparator, questions) > GRACE * tolerance
