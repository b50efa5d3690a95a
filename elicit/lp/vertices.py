"""What is known of K_t, its vertices above all, as plain arrays for compiled code."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit.model.scale import Floats

CERTAIN_POINT, CORNER, DOUBTFUL_CORNER = 0, 1, 2
"""What a known corner is good for: its point alone, its point and its basis, its basis alone. A
later cut may have taken the corner itself, by a hair, and left the point beside it: a basis is
where to start, no proof of its own."""
USED, SLOT, ROW = (
    0,
    1,
    2,
)  # counters: corners in use, the next to be replaced, the row that settled last

EPS = 2.0**-52
TINY = 2.0**-1000
SMALL = 2.0**-500  # a product of two numbers above this cannot underflow


class Known(NamedTuple):
    """What is known of K_t = {g >= margin, sum g = 1, rows g >= limits}, as plain arrays; p gaps, m
    rows.

    The corners' arrays and the counters change as walks find new corners.
    """

    margin: float
    cuts: Floats  # (p, m) the rows, transposed
    limits: Floats  # (m,)
    rows: Floats  # (r, p) rows w with w.g >= 0 on K_t
    # (r, p) a little larger: t >= lambda * lifted, in floats, implies t >= lambda * w; else nan
    lifted: Floats
    masks: NDArray[np.uint64]  # (r,) bit j: entry j is not negative (of the first 64)
    inside: Floats  # (p,) a point strictly inside K_t; not a number where none is known
    room: Floats  # (p + m,) its distances to the constraints
    points: Floats  # (p, q) the corners' points
    inverses: Floats  # (q, p, p) of [1; active constraints]
    active: NDArray[np.int64]  # (q, p - 1) j < p: g_j >= margin; p + i: row i
    kind: NDArray[np.int8]  # (q,)
    age: NDArray[np.int64]  # (q,) pivots since the inverse was computed afresh
    counts: NDArray[np.int64]  # (3,)


def nothing_known(margin: float, rows: Floats, limits: Floats, corners: int) -> Known:
    """Only what defines K_t, rows (m, p) and limits (m,), with places for so many corners."""
    p = rows.shape[1]
    return Known(
        margin=margin,
        cuts=np.ascontiguousarray(rows.T),
        limits=limits,
        rows=np.empty((0, p)),
        lifted=np.empty((0, p)),
        masks=np.empty(0, dtype=np.uint64),
        inside=np.full(p, np.nan),
        room=np.full(p + len(rows), np.nan),
        points=np.zeros((p, corners)),
        inverses=np.zeros((corners, p, p)),
        active=np.zeros((corners, max(0, p - 1)), dtype=np.int64),
        kind=np.zeros(corners, dtype=np.int8),
        age=np.zeros(corners, dtype=np.int64),
        counts=np.zeros(3, dtype=np.int64),
    )
