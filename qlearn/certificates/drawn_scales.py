"""Drawn scales of a comparator, for choosing questions and for bounds that depend on them."""

import numpy as np

from elicit.lp.hit_and_run import Draws, draws_within
from elicit.lp.region import Region
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import draws_in, trusted_share


def drawn_set(comparator: Comparator) -> tuple[Draws, float] | None:
    """Return a comparator's draws and the share of their weight under which its bounds hold.

    None if its bounds do not depend on draws.
    """
    level = trusted_share(comparator)
    draws = None if level is None else draws_in(comparator)
    return None if level is None or draws is None else (Draws(*draws), level)


def draws_of(comparator: Comparator) -> Draws:
    """Return a comparator's draws, or draws from all ordered scales if it has none."""
    own = draws_in(comparator)
    if own is not None:
        return Draws(*own)
    p = comparator.k - 1
    return draws_within(
        Region(0.0, np.empty((0, p)), np.empty(0), np.empty(0, np.int64)), np.full(p, 1.0 / p)
    )
