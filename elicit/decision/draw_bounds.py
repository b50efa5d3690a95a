"""Bounds on d.e from weighted draws of a posterior over scales."""

from __future__ import annotations

import numpy as np

from elicit.decision.votes import LEVEL_ROUNDING
from elicit.model.scale import Floats


def quantiles(scores: Floats, weights: Floats, level: float) -> tuple[float, float]:
    """Return two quantiles of scores (m,) with weights (m,) of total 1: 1 - level and level.

    The verdict is BETTER if the first is above 0.
    """
    order = np.argsort(scores, kind="stable")
    below, last = np.cumsum(weights[order]), len(order) - 1
    low = int(np.searchsorted(below, 1.0 - level + LEVEL_ROUNDING, side="right"))
    high = int(np.searchsorted(below, level - LEVEL_ROUNDING))
    return float(scores[order[min(low, last)]]), float(scores[order[min(high, last)]])


def upper_together(scores: Floats, weights: Floats, level: float) -> Floats:
    """Return upper bounds (n,) on scores (n, m), all of which hold under a weight of ``level``.

    Draws are sorted by their greatest score over the rows. Those with the greatest are left out, up
    to a total weight of 1 - ``level``. A bound is the greatest score of its row under the others.
    """
    order = np.argsort(scores.max(axis=0), kind="stable")
    enough = int(np.searchsorted(np.cumsum(weights[order]), level - LEVEL_ROUNDING))
    found: Floats = scores[:, order[: 1 + enough]].max(axis=1)
    return found
