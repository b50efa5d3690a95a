"""The functions of ``difference`` and ``pairs`` for a single difference, in compiled code.

Results are the same to the last bit. A table finds the answer to a pair. The module is separate
because numba takes long to import, and ``import elicit`` does without it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import mix
from elicit._support.jit import compiled
from elicit.model.pairs import GRID, NEAR, OFFSET, SHARE
from elicit.model.query import Verdict
from elicit.model.scale import Floats

WORSE, EQUAL, BETTER, UNKNOWN = map(int, Verdict)  # as plain numbers
LEFT_OPEN = 3  # a code beside the verdicts: compiled code has left it to Python
NOT_THERE = -1  # the row of a pair that is not in a table


@compiled
def tail_sums_into(d: Any, i: int, t: Any) -> None:
    """Write the tail sums of row i of d (n, k) into t (k-1,)."""
    total = -0.0  # a sum that begins so keeps the sign of zero
    for j in range(len(t) - 1, -1, -1):
        total += d[i, j + 1]
        t[j] = total


@compiled
def to_order_one(t: Any) -> tuple[float, int]:
    """Divide t (p,) by a power of two, so that its largest entry is in [1/2, 1).

    Return the largest entry and the exponent. If bits would be lost, t stays as it is and the
    exponent is 0: conclusions from t are then still certain, but there may be fewer. See
    ``difference.of_order_one``.
    """
    size = largest(t)
    fraction, exponent = math.frexp(size)
    if exponent == 0:
        return size, 0
    for j in range(len(t)):
        scaled = math.ldexp(t[j], -exponent)
        if exponent > 0 and math.ldexp(scaled, exponent) != t[j]:
            for i in range(j):
                t[i] = math.ldexp(t[i], exponent)
            return size, 0
        t[j] = scaled
    return fraction, exponent


@compiled
def largest(t: Any) -> float:
    """Return the largest absolute value of an entry."""
    size = 0.0
    for j in range(len(t)):
        size = max(size, abs(t[j]))
    return size


@compiled
def by_dominance(t: Any) -> int:
    """Return the verdict by dominance on tail sums t (p,): see ``difference.dominance``."""
    least, greatest = 0.0, 0.0
    for j in range(len(t)):
        least, greatest = min(least, t[j]), max(greatest, t[j])
    return by_range(least, greatest)


@compiled
def by_range(least: float, greatest: float) -> int:
    """Return the verdict by dominance on tail sums with this least and greatest entry.

    ``least`` is at most 0 and ``greatest`` at least 0.
    """
    if greatest > 0.0:
        return UNKNOWN if least < 0.0 else BETTER
    return WORSE if least < 0.0 else EQUAL


class PairTable(NamedTuple):
    """A table of answers, to be looked up by pair.

    ``marks`` (n,) are sorted keys (see ``mark_of``), and ``rows`` (n,) say to which answers they
    belong. The other arrays are in the order of the answers, perhaps with unused places at their
    end.
    """

    marks: Floats
    rows: NDArray[np.int64]
    sums: Floats  # (c, p) tail sums
    said: NDArray[np.int8]  # (c,) the tutor's verdict on the left one
    binding: NDArray[np.bool_]  # (c,) whether no model may overrule it


@compiled
def mark_of(t: Any) -> float:
    """Return the key by which tail sums t (p,) are sorted in a table; -t has the opposite key."""
    mark = 0.0
    for j in range(len(t)):
        mark += math.sqrt(j + 2.0) * t[j]
    return mark


@compiled
def near_to(t: Any) -> float:
    """Return how much an entry of tail sums t (p,) may differ within the same pair.

    It is ``pairs.nearness``.
    """
    size = largest(t)
    return min(NEAR * max(size, 1.0), SHARE * size)


@compiled
def marks_within(near: float, p: int) -> float:
    """Return how far ``mark_of`` may differ between two tail sums (p,) of the same pair.

    Two tail sums are of the same pair if no entry of them differs by more than ``near``.
    """
    total = 0.0
    for j in range(p):
        total += math.sqrt(j + 2.0)
    return near * total * 1.001


@compiled
def apart(t: Any, sign: int, other: Any) -> float:
    """Return the greatest absolute difference between entries of sign * t (p,) and ``other``."""
    most = 0.0
    for j in range(len(t)):
        most = max(most, abs(sign * t[j] - other[j]))
    return most


@compiled
def find(t: Any, table: PairTable) -> tuple[int, int]:
    """Return the row of the pair with tail sums t (p,) in a table, and 1, or -1 if it is flipped.

    If no row holds the pair, the result is ``NOT_THERE`` and 1. If several do, it is the nearest.
    """
    n, best, way = len(table.marks), NOT_THERE, 1
    if n == 0:
        return best, way
    mark, near = mark_of(t), near_to(t)
    reach, least = marks_within(near, len(t)), math.inf
    for sign in (1, -1):
        i = np.searchsorted(table.marks, sign * mark - reach)
        while i < n and table.marks[i] <= sign * mark + reach:
            row = table.rows[i]
            far = apart(t, sign, table.sums[row])
            if far <= near and far < least:
                best, way, least = row, sign, far
            i += 1
    return best, way


@compiled
def find_all(t: Any, table: PairTable, rows: Any, ways: Any) -> None:
    """Write the results of ``find`` for tail sums t (n, p) into rows (n,) and ways (n,)."""
    for i in range(len(t)):
        rows[i], ways[i] = find(t[i], table)


@compiled
def way_round(t: Any) -> int:
    """Return an orientation of a pair with tail sums t (p,): 1 or -1, and 0 for equal vectors.

    A pair and the same pair flipped have opposite orientations (``pairs.ways_round``).
    """
    mark = mark_of(t)
    return 1 if mark > 0.0 else -1 if mark < 0.0 else 0


@compiled
def pair_code(key: Any, t: Any) -> Any:
    """Return a hash of the key and of the pair with tail sums t (p,), in either order.

    The pair is hashed as the numbers of ``pairs.whole_numbers``.
    """
    size, sign = largest(t), way_round(t)
    exponent = max(0, math.frexp(size * OFFSET)[1])
    total = mix(key, np.uint64(exponent))
    for j in range(len(t)):
        grains = math.floor(math.ldexp(sign * t[j], -exponent) * GRID + 0.5)
        total = mix(total, np.uint64(np.int64(grains)))
    return total
