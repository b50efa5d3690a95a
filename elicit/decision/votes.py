"""The vote of weighted scales on a difference: the sign of d.e that scales of enough weight share.

A scale is its gaps g, and votes by the sign of t.g. A block of scales at a time, and no more once neither sign can
reach the level.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from elicit._support.jit import compiled, loosely
from elicit.lp.sign import BETTER, UNKNOWN, WORSE, by_dominance, tail_sums_into

LEVEL_ROUNDING = 1e-9  # a level is reached by sums of weights that fall short of it by less
BLOCK = 64  # scales whose votes are counted before it is asked whether a level can still be reached


@compiled
def weigh(d: Any, gaps: Any, weights: Any, level: float, verdicts: Any) -> None:
    """Verdicts (n,) on differences d (n, k): dominance, else by ``shared_sign``."""
    p, m = gaps.shape
    t, at = np.empty(p), np.empty(m)
    for i in range(len(d)):
        tail_sums_into(d, i, t)
        verdicts[i] = by_dominance(t)
        if verdicts[i] == UNKNOWN:
            side = shared_sign(t, 0.0, gaps, weights, level, at)
            verdicts[i] = UNKNOWN if side == 0 else BETTER if side > 0 else WORSE


@compiled
def shared_sign(t: Any, shift: float, gaps: Any, weights: Any, level: float, at: Any) -> int:
    """The sign of t.g + shift that particles of gaps (p, m) and total weight ``level`` share, with the scores in at
    (m,); 0 where none has so much."""
    m, up, down, left = len(at), 0.0, 0.0, 1.0
    for start in range(0, m, BLOCK):
        end = min(m, start + BLOCK)
        scores_into(t, shift, gaps, start, at[start:end])
        above, below, both = signed_weights(at[start:end], weights[start:end])
        up, down, left = up + above, down + below, left - both
        if max(up, down) + left < level - 2.0 * LEVEL_ROUNDING:
            return 0
    return 1 if up >= level - LEVEL_ROUNDING else -1 if down >= level - LEVEL_ROUNDING else 0


@compiled
def scores_into(t: Any, shift: float, gaps: Any, start: int, out: Any) -> None:
    """t.g + shift into out (n,), for as many particles of gaps (p, m) from ``start``."""
    p, n, stop = len(t), len(out), start + len(out)
    first = gaps[0, start:stop]
    for q in range(n):
        out[q] = t[0] * first[q]
    for j in range(1, p - 3, 4):  # four at a time, each sum in order
        a, b, c, d = t[j], t[j + 1], t[j + 2], t[j + 3]
        ga, gb = gaps[j, start:stop], gaps[j + 1, start:stop]
        gc, gd = gaps[j + 2, start:stop], gaps[j + 3, start:stop]
        for q in range(n):
            out[q] = out[q] + a * ga[q] + b * gb[q] + c * gc[q] + d * gd[q]
    for j in range(p - (p - 1) % 4, p):
        by, gap = t[j], gaps[j, start:stop]
        for q in range(n):
            out[q] += by * gap[q]
    if shift != 0.0:
        for q in range(n):
            out[q] += shift


@loosely
def signed_weights(at: Any, weights: Any) -> tuple[float, float, float]:
    """The weight (of weights (n,)) of positive scores (n,), of negative ones, and all of it. The order of a sum matters
    less than ``LEVEL_ROUNDING``."""
    up, down, both = 0.0, 0.0, 0.0
    for q in range(len(at)):
        w = weights[q]
        both += w
        up += w if at[q] > 0.0 else 0.0
        down += w if at[q] < 0.0 else 0.0
    return up, down, both
