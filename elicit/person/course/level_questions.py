"""Questions about single levels, which an interview puts beside those of its asker.

They compare a level with a mixture of two others, in whole numbers, as near as possible to the
middle of the level's interval. They need nothing but a comparator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from elicit.model.comparator import Comparator, bounds_of, value_bounds
from elicit.model.query import Query
from elicit.model.scale import Floats
from elicit.person.course.conduct import ORDER
from elicit.person.course.ranges import value_ranges

LEVEL = "level/"
"""Start of the id of a question about a level."""
NARROW = 2.0
"""Width of a range, of 100, that is not worth a question."""
_NARROW = NARROW / 100  # the same, from 0 (worst) to 1 (best)
_APART = 0.05  # least difference, on that scale, of a question whose answer is known
_FEWEST = 0.5  # questions for each halving that an interval needs, at the fewest
_MOST = 1.6  # the same, at the most
_GRID = 1e-6  # grid for comparing widths, so that no rounding decides

WIDE = 20.0
"""Width of a range, of 100, from which it is called wide."""
FINE = 10.0
"""Width to which questions narrow ranges that are not wide, if the person goes on."""
_FOR_EACH, _FOR_EACH_HALVING = 1.0, 2.2  # questions at the most, for a wide range
FURTHER = "With more answers the result depends less on any single one."
"""The reason for a question about a level, if the result is not settled."""
GUARDS = (
    "Earlier answers suggest how you see this. Asking in another way guards against a mistake in "
    "any one of them."
)
"""The reason for a question whose answer follows from others."""


class _LevelPair(NamedTuple):
    """Two levels to mix: a share of the higher one, and the rest of the lower one."""

    low: int
    high: int


def level_question(
    comparator: Comparator,
    of: int,
    answered: Callable[[Query], bool],
    asked: Collection[int] = (),
    mixed_with: Literal["ends", "neighbours"] = "ends",
) -> Query | None:
    """Return a question about the level whose value is most open, or None if there is none.

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
        pair = _LevelPair(0, k - 1) if mixed_with == "ends" else _LevelPair(level - 1, level + 1)
        for query in _about(comparator, level, pair, of):
            if not answered(query):
                return query
    return None


def known_question(
    comparator: Comparator, of: int, answered: Callable[[Query], bool]
) -> Query | None:
    """Return a question whose answer follows from earlier ones, as a check.

    It compares a level with a mixture of best and worst that is certainly not as good: the nearest
    such mixture.

    Parameters
    ----------
    comparator : Comparator
    of : int
        Number of outcomes on either side.
    answered : callable
        Returns whether a query's difference was answered before.

    Returns
    -------
    Query or None
    """
    counts = np.arange(1, of)
    found: list[tuple[int, int, int]] = []
    for level in range(1, comparator.k - 1):
        least, most = bounds_of(
            comparator, _differences(comparator.k, level, _LevelPair(0, -1), of)
        )
        apart = np.rint(np.maximum(least, -most) / _GRID)  # above 0 where the answer is known
        known = np.flatnonzero(apart * _GRID >= _APART)
        found += [(int(apart[row]), level, int(counts[row])) for row in known]
    for _, level, count in sorted(found):
        query = _query(comparator.k, level, _LevelPair(0, comparator.k - 1), count, of)
        if not answered(query):
            return query
    return None


def questions_left(comparator: Comparator) -> tuple[int, int] | None:
    """Return the fewest and the most questions about levels that are likely still to come, or None.

    The best question halves an interval, and one in whole numbers, or about a person who errs,
    narrows it by less. From each question on, after the first five, of 16 simulated sessions about
    4 and 6 levels, the number left was in this range in 212 of 212 cases with a polytope, and in
    328 of 366 with a posterior (people who err by nothing, and call .02 to .05 of the range equal).

    Parameters
    ----------
    comparator : Comparator

    Returns
    -------
    (2,) int or None
        None if the comparator bounds no values.
    """
    low, high = value_bounds(comparator)
    widths = (high - low)[1:-1]
    if not np.isfinite(widths).all():
        return None
    halvings = np.log2(widths[widths >= _NARROW - _GRID] / _NARROW)
    needed = float((1.0 + np.maximum(halvings, 0.0)).sum())
    return int(_FEWEST * needed), math.ceil(_MOST * needed) + (needed > 0)


def questions_to_narrow(widths: Sequence[float], width: float = WIDE) -> tuple[int, int]:
    """Return the fewest and the most questions about levels until no range is wider than ``width``.

    The learner is a posterior, which allows for mistakes. A question narrows mostly one range, and
    sometimes two. In sessions of 100 simulated people about 4 and 6 levels, a quarter of whom
    answered one question in 20 at random, the number was in this range after five and more
    questions in 1,005 of 1,075 cases.

    Parameters
    ----------
    widths : sequence of float
        The width of the range of each level, of 100, as ``counted_widths`` counts it.
    width : float

    Returns
    -------
    (2,) int

    Examples
    --------
    >>> questions_to_narrow([66.0, 83.0, 12.0])
    (1, 11)
    """
    wide = [each for each in widths if each > width]
    halvings = sum(math.log2(each / width) for each in wide)
    return math.ceil(len(wide) / 2), math.ceil(_FOR_EACH * len(wide) + _FOR_EACH_HALVING * halvings)


def purpose_of(
    query: Query, comparator: Comparator, labels: Sequence[str], until: float | None
) -> str:
    """Return sentences on the purpose of a question about a level, or "" for another one.

    Parameters
    ----------
    query : Query
    comparator : Comparator
    labels : (k,) str
        Names of the levels, worst first.
    until : float or None
        Width of a range, of 100, at which such questions end, if the person chose to go on so far.
    """
    if not query.id.startswith(LEVEL):
        return ""
    level = int(query.id.removeprefix(LEVEL).split("/")[0])
    if not all(math.isfinite(bound[level]) for bound in value_bounds(comparator)):
        return ""
    said = f"This question narrows what “{labels[level]}” is worth to you."
    low, high = value_ranges(comparator)
    if until is None or 100.0 * (high[level] - low[level]) <= until:
        return f"{said} {FURTHER}"
    return (
        f"Questions like this one narrow what “{labels[level]}” is worth to you, until its range, "
        f"which allows for mistakes, is at most {until:.0f} wide, on the scale from 0 to 100."
    )


def order_question(k: int, level: int) -> Query:
    """Return the check question that compares a level with the next worse one.

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


def _about(comparator: Comparator, level: int, pair: _LevelPair, of: int) -> Iterator[Query]:
    """Yield the open questions about a level: the coarser ones first, then the most open."""
    for total in dict.fromkeys((of, 10 * of)):
        least, most = bounds_of(comparator, _differences(comparator.k, level, pair, total))
        width = np.rint(np.minimum(-least, most) / _GRID)
        open_still = [row for row in np.argsort(-width, kind="stable").tolist() if width[row] > 1]
        for row in open_still:
            yield _query(comparator.k, level, pair, row + 1, total)


def _differences(k: int, level: int, pair: _LevelPair, total: int) -> Floats:
    """Return the differences (total - 1, k) between a level and mixtures of a pair of levels.

    The mixtures have 1, 2, ... outcomes of the higher level, out of ``total``.
    """
    shares = np.arange(1, total) / total
    d = np.zeros((len(shares), k))
    d[:, level] = 1.0
    d[:, pair.high] -= shares
    d[:, pair.low] -= 1.0 - shares
    return d


def _query(k: int, level: int, pair: _LevelPair, count: int, total: int) -> Query:
    mixture = np.zeros(k)
    mixture[pair.high] = count / total
    mixture[pair.low] = (total - count) / total
    name = f"{LEVEL}{level}/{pair.low}-{pair.high}/{count} of {total}"
    return Query(name, np.eye(k)[level], mixture)
