"""The tail sums and the dominance of ``elicit.model.scale``, one difference at a time, for compiled code.

The same numbers to the last bit. Apart from ``scale``, because numba takes long to import and ``import elicit`` does
without it.
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
    some_up, some_down = False, False
    for j in range(len(t)):
        some_up = some_up or t[j] > 0.0
        some_down = some_down or t[j] < 0.0
    if some_up:
        return UNKNOWN if some_down else BETTER
    return WORSE if some_down else EQUAL
