"""The two possible orders of levels if one step is open; vectors and scales in each of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elicit._support.validation import is_whole, require
from elicit.lp.hit_and_run import Draws
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats

Order = tuple[int, ...]  # level numbers, from the worst to the best


def open_step(k: int, unordered: Sequence[int]) -> tuple[int, int]:
    """Return the two neighbouring levels whose order is open, the lower number first.

    Raise ValueError for anything else.
    """
    pair = sorted(unordered) if np.size(unordered) == 2 else []
    neighbours = all(is_whole(level, 0) for level in pair) and np.diff(pair).tolist() == [1]
    require(
        neighbours and pair[-1] < k,
        "unordered",
        f"two neighbouring levels, such as (0, 1), below k = {k}",
        unordered,
    )
    return int(pair[0]), int(pair[1])


def orders_of(k: int, unordered: tuple[int, int]) -> tuple[Order, Order]:
    """Return two orders of k levels: the given one, and the one with the two levels exchanged."""
    low, high = unordered
    given = tuple(range(k))
    return given, (*given[:low], high, low, *given[high + 1 :])


def filled_up(d: Floats) -> Floats:
    """Return differences (n, k) of total 0: what is missing of the total is added at level 1."""
    rows = d.copy()
    rows[:, 0] = -tail_sums(d)[:, 0]
    return rows


def together(parts: Sequence[tuple[Order, Draws]], shares: Floats) -> Draws:
    """Return weighted draws from several orders as draws in the given order.

    ``shares``, of total 1, are the weights of the orders. In an order with the two levels
    exchanged, the gap between them is negative.
    """
    gaps, weights, precisions = [], [], []
    for share, (order, own) in zip(shares.tolist(), parts, strict=True):
        values = np.zeros((len(order), own.gaps.shape[1]))
        values[list(order[1:])] = np.cumsum(own.gaps, axis=0)
        gaps.append(np.diff(values, axis=0))
        weights.append(share * own.weights)
        precisions.append(own.precision)
    return Draws(np.concatenate(gaps, axis=1), np.concatenate(weights), np.concatenate(precisions))


def mean_scale(parts: Sequence[tuple[Order, Floats]], shares: Floats) -> Floats:
    """Return the mean (k,) of scales of several orders, least 0 and greatest 1; read-only.

    ``shares`` are the weights of the orders. If all levels are worth the same in that mean, which
    happens with two levels, it is the scale of the first order.
    """
    mean = np.zeros(len(parts[0][0]))
    for share, (order, values) in zip(shares.tolist(), parts, strict=True):
        mean[list(order)] += share * values
    if mean.max() - mean.min() <= 1e-9 * shares.sum():
        mean[list(parts[0][0])] = parts[0][1]
    found: Floats = (mean - mean.min()) / (mean.max() - mean.min())
    found.flags.writeable = False
    return found
