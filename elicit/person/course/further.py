"""Questions that an interview puts beside those of its asker.

They compare one level with a mixture of two others, in whole numbers, as near as possible to the
middle of what is still open about that level. They need nothing but a comparator.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import Literal, NamedTuple

import numpy as np

from elicit.model.comparator import Comparator, bounds_of
from elicit.model.query import Query
from elicit.model.scale import Floats
from elicit.person.course.conduct import ORDER

_NARROW = 0.02  # width of an interval, from 0 (worst) to 1 (best), that is not worth a question
_GRID = 1e-6  # on which widths are compared, so that no rounding decides


class _Pair(NamedTuple):
    """A mixture of two levels: a share of the higher one, and the rest of the lower one."""

    low: int
    high: int


def level_question(
    comparator: Comparator,
    of: int,
    answered: Callable[[Query], bool],
    asked: Collection[int] = (),
    mixed_with: Literal["ends", "neighbours"] = "ends",
) -> Query | None:
    """Return a question about the level of which most is open, or None if there is none.

    Parameters
    ----------
    comparator : Comparator
    of : int
        Number of outcomes on either side, if the question can be put so.
    answered : callable
        Returns whether a query's difference was answered before.
    asked : collection of int
        Levels (0 the worst) that answers are about already; the others come first.
    mixed_with : {"ends", "neighbours"}
        The levels of the mixture: the best and the worst, or the next better and the next worse.

    Returns
    -------
    Query or None
    """
    k = comparator.k
    low, high = value_bounds(comparator)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return None
    widths = np.rint((high - low) / _GRID).astype(np.int64)
    order = sorted(range(1, k - 1), key=lambda j: (j in asked, -int(widths[j]), j))
    for level in order:
        if widths[level] * _GRID < _NARROW:
            continue
        pair = _Pair(0, k - 1) if mixed_with == "ends" else _Pair(level - 1, level + 1)
        for query in _about(comparator, level, pair, of):
            if not answered(query):
                return query
    return None


def value_bounds(comparator: Comparator) -> tuple[Floats, Floats]:
    """Return bounds (k,) on each level's value, from 0 for the worst to 1 for the best."""
    ends = np.eye(comparator.k) - np.eye(comparator.k)[0]
    return bounds_of(comparator, ends)


def order_question(k: int, level: int) -> Query:
    """Return the check question whether a level is better than the next worse one.

    Parameters
    ----------
    k : int
        Number of levels.
    level : int
        From 1 to k - 1. It is the query's left.

    Returns
    -------
    Query
    """
    rows = np.eye(k)
    return Query(f"{ORDER}{level}", rows[level], rows[level - 1])


def _about(comparator: Comparator, level: int, pair: _Pair, of: int) -> Iterator[Query]:
    """Return the questions about a level whose answer is open, the most open first."""
    for total in dict.fromkeys((of, 10 * of)):
        counts = np.arange(1, total)
        d = np.zeros((len(counts), comparator.k))
        d[:, level] = 1.0
        d[:, pair.high] -= counts / total
        d[:, pair.low] -= 1.0 - counts / total
        least, most = bounds_of(comparator, d)
        open_still = np.minimum(-least, most)
        found = False
        width = np.rint(open_still / _GRID)
        for row in np.argsort(-width, kind="stable"):
            if open_still[row] <= _GRID:
                break
            found = True
            mixture = np.zeros(comparator.k)
            mixture[pair.high] = counts[row] / total
            mixture[pair.low] = (total - counts[row]) / total
            name = f"level/{level}/{pair.low}-{pair.high}/{counts[row]} of {total}"
            yield Query(name, np.eye(comparator.k)[level], mixture)
        if found:
            return
