"""The tail sums and the dominance of ``elicit.model.scale``, one difference at a time, for compiled
code.

The same numbers to the last bit. Apart from ``scale``, because numba takes long to import and
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
    """``scale.tail_sums`` of row i of d (n, k), into t (k-1,)."""
    for factor in (1.0, 2.0**-64):
        total = -0.0  # as a sum begins that keeps the sign of zero
        for j in range(len(t) - 1, -1, -1):
            total += d[i, j + 1] * factor
            t[j] = total
        if math.isfinite(total):
            return


@compiled
def by_dominance(t: Any) -> int:
    """``scale.dominance`` of one row of tail sums t (p,) (eq. 4)."""
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
