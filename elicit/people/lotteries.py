"""Lotteries over amounts of money as share vectors over levels.

The levels are a few amounts, called knots. An amount between two knots is split between them so
that its mean stays the same. For a value function that is linear between knots the split changes
nothing: the lottery and its share vector have the same value. For any other value function it is an
approximation, which is better the closer the knots are.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.validation import is_whole, require
from elicit.model.scale import Floats

_TOTAL = 1e-6  # probabilities in published tables are rounded to a few digits


def shares_over(knots: ArrayLike, amounts: ArrayLike, probabilities: ArrayLike) -> Floats:
    """Return a lottery as a share vector over the knots.

    Parameters
    ----------
    knots : (k,)
        Amounts of the levels, increasing.
    amounts : (m,)
        The amounts that the lottery may pay, within the range of the knots.
    probabilities : (m,)
        At least 0, with total 1. They are divided by their total, which may be off by rounding.

    Returns
    -------
    (k,) shares
        They total 1, and the mean amount is that of the lottery. If one lottery stochastically
        dominates another one, so do its shares.

    Raises
    ------
    ValueError
        If the knots do not increase, an amount lies outside their range, or the probabilities are
        not valid.

    Examples
    --------
    >>> shares_over([0, 10, 30], amounts=[0, 25], probabilities=[0.2, 0.8])
    array([0.2, 0.2, 0.6])
    """
    at = np.asarray(knots, dtype=np.float64)
    pays, chance = (
        np.asarray(amounts, dtype=np.float64),
        np.asarray(probabilities, dtype=np.float64),
    )
    if at.ndim != 1 or len(at) < 2 or not (np.isfinite(at).all() and (np.diff(at) > 0).all()):
        raise ValueError(f"knots must be at least two increasing amounts, not {knots!r}")
    if pays.ndim != 1 or pays.shape != chance.shape or not len(pays):
        raise ValueError(
            f"a lottery has one probability an amount, not {chance.shape} for {pays.shape}"
        )
    if not (chance >= 0).all() or not abs(chance.sum() - 1.0) <= _TOTAL:
        raise ValueError(f"probabilities must be at least 0 and total 1, not {chance.tolist()}")
    outside = (chance > 0) & ~((pays >= at[0]) & (pays <= at[-1]))
    if outside.any():
        raise ValueError(
            f"the amount {pays[outside][0]:g} lies outside the knots, {at[0]:g} to {at[-1]:g}"
        )
    shares = np.zeros(len(at))
    for pay, weight in zip(pays[chance > 0], chance[chance > 0] / chance.sum(), strict=True):
        upper = min(max(int(np.searchsorted(at, pay)), 1), len(at) - 1)
        above = (pay - at[upper - 1]) / (at[upper] - at[upper - 1])
        shares[upper - 1] += (1.0 - above) * weight
        shares[upper] += above * weight
    return shares


def knots_of(amounts: Iterable[float], levels: int) -> tuple[float, ...]:
    """Return ``levels`` of these amounts as knots, evenly spaced by rank.

    Parameters
    ----------
    amounts : iterable of float
    levels : int
        At least 2.

    Returns
    -------
    tuple of ``levels`` increasing amounts

    Raises
    ------
    ValueError
        If there are fewer different amounts than levels.
    """
    require(is_whole(levels, 2), "levels", "a whole number of at least 2", levels)
    different = sorted({float(amount) for amount in amounts})
    if len(different) < levels:
        raise ValueError(
            f"{len(different)} different amounts are too few for {levels} levels: take fewer levels"
        )
    # whole numbers, so that no rounding chooses
    return tuple(
        different[(2 * i * (len(different) - 1) + levels - 1) // (2 * (levels - 1))]
        for i in range(levels)
    )
