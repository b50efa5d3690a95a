"""Recognition of pairs: two differences are the same pair if they agree but for rounding.

The same two vectors come again with other last bits: after a restart, on another processor, in a
state that mirrors the first, or with left and right exchanged. So a pair is not recognised by its
bits. Two tail sums t and u are the same pair if no entry differs by more than ``nearness(t)``,
about 1e-9 of the value range. A hash needs a single name for a pair: the numbers of
``whole_numbers``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elicit.model.difference import tail_sums
from elicit.model.scale import Floats

GRID = 2.0**30
"""A hash names a number by how many of its unit's grains, 2^-30, it has."""

NEAR = 1e-9
"""Tail sums of the same pair differ by at most this: an absolute number up to size 1, and relative
beyond.
"""

SHARE = 1e-3
"""Tail sums of the same pair differ by at most this share of their size, however small they are."""

OFFSET = 0.7321
"""Sizes are multiplied by this before they are compared with powers of two. Otherwise rounding
could push round numbers over a limit."""


def nearness(t: Floats) -> Floats:
    """Return how much an entry of tail sums t (..., p) may differ within the same pair."""
    size = np.abs(t).max(axis=-1, initial=0.0)
    return np.asarray(np.minimum(NEAR * np.maximum(size, 1.0), SHARE * size))


def same_pairs(t: Floats, others: Floats) -> NDArray[np.int8]:
    """Return for each of ``others`` (n, p) whether it is the same pair as tail sums t (p,).

    1: the same; -1: the same with left and right exchanged; 0: another pair.
    """
    near = nearness(t)
    found = np.zeros(len(others), np.int8)
    found[np.abs(others + t).max(axis=1, initial=0.0) <= near] = -1
    found[np.abs(others - t).max(axis=1, initial=0.0) <= near] = 1
    return found


def ways_round(t: Floats) -> NDArray[np.int8]:
    """Return the orientation (n,) of tail sums t (n, p), 1 or -1.

    -t has the opposite orientation of t, unless t is 0. So a pair and the same pair with left and
    right exchanged can be told apart. The orientation is the sign of a weighted sum whose weights
    are square roots. For tail sums in round numbers that sum is seldom near 0, where rounding could
    change its sign.
    """
    return np.where(marks_of(t) < 0.0, -1, 1).astype(np.int8)


def marks_of(t: Floats) -> Floats:
    """Return the keys (n,) by which tail sums t (n, p) are sorted; -t has the opposite key."""
    weights = np.sqrt(np.arange(2.0, t.shape[1] + 2.0))
    # from the first on, as ``difference_kernel.mark_of`` adds them
    sums: Floats = np.add.accumulate(weights * t, axis=1)
    return sums[:, -1] + 0.0  # not -0


def whole_numbers(x: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return vectors x (..., p) as whole multiples of 2^-30, and the exponents (...) used.

    A large vector is first divided by 2 to the power of its exponent. For other vectors the
    exponent is 0.
    """
    size = np.abs(x).max(axis=-1, initial=0.0) * OFFSET
    exponent = np.maximum(0, np.frexp(size)[1].astype(np.int64))
    numbers = np.floor(np.ldexp(x, -exponent[..., None]) * GRID + 0.5).astype(np.int64)
    return numbers, exponent


def first_of_each_pair(d: Floats, most: int) -> list[int]:
    """Return the first row of each pair in d (n, k), at most ``most`` rows."""
    chosen: list[int] = []
    sums = tail_sums(d)
    for row, t in enumerate(sums):
        if len(chosen) == most:
            break
        if not same_pairs(t, sums[chosen]).any():
            chosen.append(row)
    return chosen


def pair_numbers(d: Floats) -> NDArray[np.intp]:
    """Return the number (n,), from 0 on, of the pair behind each difference d (n, k).

    Exchanging left and right gives the same pair.
    """
    sums = tail_sums(d)
    numbers = np.arange(len(sums))
    for row, t in enumerate(sums):
        if numbers[row] == row:
            later = row + 1 + np.flatnonzero(same_pairs(t, sums[row + 1 :]))
            numbers[later[numbers[later] == later]] = row
    return np.unique(numbers, return_inverse=True)[1].ravel()
