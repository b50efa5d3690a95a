"""The functions of ``elicit.model.difference``, one difference at a time, for compiled code.

The same numbers to the last bit. Apart from ``difference``, because numba takes long to import and
``import elicit`` does without it.
"""

import math
from typing import Any

from elicit._support.jit import compiled
from elicit.model.query import Verdict

WORSE, EQUAL, BETTER, UNKNOWN = map(int, Verdict)  # as plain numbers
UNSETTLED = 3  # and one more code: the compiled code cannot tell


@compiled
def tail_sums_into(d: Any, i: int, t: Any) -> None:
    """Write ``difference.tail_sums`` of row i of d (n, k) into t (k-1,)."""
    total = -0.0  # as a sum begins that keeps the sign of zero
    for j in range(len(t) - 1, -1, -1):
        total += d[i, j + 1]
        t[j] = total


@compiled
def to_order_one(t: Any) -> tuple[float, int]:
    """Divide t (p,) by a power of two, so that its largest entry is in [1/2, 1), as
    ``difference.of_order_one`` does.

    Returns that entry and the exponent. Where bits would be lost, t stays as it is, with the
    exponent 0: what is concluded from it is as certain, but may be less.
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
    """Return the size of the largest entry."""
    size = 0.0
    for j in range(len(t)):
        size = max(size, abs(t[j]))
    return size


@compiled
def by_dominance(t: Any) -> int:
    """Return ``difference.dominance`` of one row of tail sums t (p,) (eq. 4)."""
    least, greatest = 0.0, 0.0
    for j in range(len(t)):
        least, greatest = min(least, t[j]), max(greatest, t[j])
    return by_range(least, greatest)


@compiled
def by_range(least: float, greatest: float) -> int:
    """Return the verdict of eq. (4) on tail sums whose extremes, 0 among them, are these."""
    if greatest > 0.0:
        return UNKNOWN if least < 0.0 else BETTER
    return WORSE if least < 0.0 else EQUAL
