"""Votes of scales on a difference: the sign of d.e that enough scales share.

A scale is given by its gaps g, and votes by the sign of t.g. Votes are counted by weight, by
number, or for all scales in a box. Weights are counted a block of scales at a time, and the count
stops once neither sign can reach the level.
"""

from typing import Any

import numpy as np

from elicit._support.jit import compiled, loosely
from elicit.model.difference_kernel import BETTER, UNKNOWN, WORSE

LEVEL_ROUNDING = 1e-9  # a level counts as reached if a sum of weights falls short of it by less
BLOCK = 64  # scales whose votes are counted between two tests of whether the level can be reached


@compiled
def by_weight(t: Any, shift: float, gaps: Any, weights: Any, level: float, at: Any) -> int:
    """Return BETTER if scales of total weight ``level`` have t.g + shift > 0, WORSE if < 0.

    Otherwise return UNKNOWN. Column j of ``gaps`` (p, m) is the scale with the weight
    ``weights[j]``. The scores t.g + shift are written into ``at`` (m,); some may be missing if the
    verdict is UNKNOWN.
    """
    m, up, down, left = len(at), 0.0, 0.0, 1.0
    for start in range(0, m, BLOCK):
        end = min(m, start + BLOCK)
        scores_into(t, shift, gaps, start, at[start:end])
        above, below, both = signed_weights(at[start:end], weights[start:end])
        up, down, left = up + above, down + below, left - both
        if max(up, down) + left < level - 2.0 * LEVEL_ROUNDING:
            return UNKNOWN
    return (
        BETTER
        if up >= level - LEVEL_ROUNDING
        else WORSE
        if down >= level - LEVEL_ROUNDING
        else UNKNOWN
    )


@compiled
def scores_into(t: Any, shift: float, gaps: Any, start: int, out: Any) -> None:
    """Write the scores t.g + shift of n scales into ``out`` (n,).

    The scales are the columns of ``gaps`` (p, m) from ``start`` on.
    """
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
    """Return the total weights of positive scores, of negative scores, and of all scores.

    Scores ``at`` and weights are (n,). Sums may be reordered: the error is below
    ``LEVEL_ROUNDING``.
    """
    up, down, both = 0.0, 0.0, 0.0
    for q in range(len(at)):
        w = weights[q]
        both += w
        up += w if at[q] > 0.0 else 0.0
        down += w if at[q] < 0.0 else 0.0
    return up, down, both


@loosely
def spare_score(at: Any, side: int, weights: Any, level: float) -> float:
    """Return how far all scores may move towards 0 with the verdict unchanged; 0 if not at all.

    After the move, those scores in ``at`` (m,) that have the sign ``side`` still have at least the
    weight ``level``. Only a few distances are tried, so there may be a longer one.
    """
    mean = 0.0
    for q in range(len(at)):
        mean += weights[q] * at[q]
    for share in (0.5, 0.2, 0.05):
        limit, weight = share * abs(mean), 0.0
        for q in range(len(at)):
            weight += weights[q] if side * at[q] > limit else 0.0
        if weight >= level:
            return limit - 1e-12  # the scores have an error of up to 1e-12
    return 0.0


@compiled
def by_count(t: Any, shift: float, gaps: Any, left_out: int) -> int:
    """Return the verdict on t.g + shift of the last scale, if enough other scales share it.

    The scales are columns of ``gaps`` (p, m), and all but ``left_out`` must share the verdict.
    Otherwise it is UNKNOWN.
    """
    last, against = gaps.shape[1] - 1, 0
    at = np.empty(last + 1)
    scores_into(t, shift, gaps, 0, at)
    if at[last] == 0.0:
        return UNKNOWN
    sign = 1.0 if at[last] > 0.0 else -1.0
    for q in range(last):
        if not sign * at[q] > 0.0:
            against += 1
            if against > left_out:
                return UNKNOWN
    return BETTER if sign > 0.0 else WORSE


@compiled
def by_box(d: Any, shift: float, ends: Any) -> int:
    """Return the verdict on d.e + shift that all scales in a box share, else UNKNOWN.

    ``ends`` (p, 2) bounds levels 2..k.
    """
    least, greatest = 0.0, 0.0
    for j in range(len(ends)):
        low, high = d[j + 1] * ends[j, 0], d[j + 1] * ends[j, 1]
        least += min(low, high)
        greatest += max(low, high)
    if least + shift > 0.0:
        return BETTER
    return WORSE if greatest + shift < 0.0 else UNKNOWN
