"""The tolerance that a tutor's errors leave within reach of a number of questions.

A tutor whose answers follow eq. (6) with precision c and lapse q tells little of a difference d.e:
each answer about it has at most the Fisher information (c (1 - q) / 2)^2. After n answers the 95%
interval of a single number of the value range is about 2 * 1.645 * 2 / (c (1 - q) sqrt(n)) wide.
Half of that is the tolerance within reach. It is a rough figure: a policy depends on several
numbers, but not on all to that accuracy.
"""

from __future__ import annotations

import math

from elicit.model.comparator import Comparator

Z = 1.645  # standard deviations that leave 5% on one side
GRACE = 2.0
"""A tolerance is called out of reach only if it is so many times smaller than what is within
reach."""
ENOUGH_ANSWERS = 30  # with fewer answers a learned precision says little


def tolerance_within_reach(comparator: Comparator, questions: int) -> float:
    """Return the tolerance that may be had after so many questions to this tutor, roughly.

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
    """Return whether a tolerance is out of reach of so many questions, as far as is known yet.

    Parameters
    ----------
    comparator : Comparator
        It must have learned from at least 30 answers, or the result is False.
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
