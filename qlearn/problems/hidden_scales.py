"""Random hidden scales of several kinds, to test learners: evenly spread levels, and others."""

from __future__ import annotations

import numpy as np

from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.seeds import seed_of
from elicit._support.validation import is_number, is_whole, require
from elicit.model.scale import Floats

KINDS = ("equal", "even", "skewed", "convex", "concave")
"""The kinds of hidden scales."""
_MOST_LEVELS = 100
_LEAST_GAP = 1e-5  # ten times the default margin of a polytope between two levels
_POWERS = (1.5, 5.0)  # of the most gently and of the most sharply bent scale


def hidden_scales(kind: str, k: int, seed: Seed | None = None) -> Floats:
    """Draw the hidden values of k levels.

    Parameters
    ----------
    kind : str
        "equal": all gaps between neighbouring levels are equal. "even": gaps drawn uniformly from
        all that total 1, Dirichlet(1). "skewed": gaps drawn from Dirichlet(.3), so that a few of
        them make up most of the range. "convex": the values x ** p of k evenly spaced x from 0 to
        1, with p from 1.5 to 5 and log(p) drawn uniformly; the bad levels lie close together.
        "concave": 1 - (1 - x) ** p likewise; the good levels lie close together.
    k : int
        The number of levels, from 2 to 100.
    seed : int or None
        The seed; None draws another scale each time. "equal" needs none.

    Returns
    -------
    ndarray
        (k,) increasing values, the first 0 and the last 1. To each gap as drawn 1e-5 is added
        before they are scaled to a total of 1, so that none is too small for a comparator's margin.

    Raises
    ------
    ValueError
        If the kind is unknown, or k is no whole number from 2 to 100.
    TypeError
        If the seed is neither None nor a whole number of at least 0.

    Examples
    --------
    >>> qlearn.hidden_scales("equal", 5)
    array([0.  , 0.25, 0.5 , 0.75, 1.  ])
    >>> qlearn.hidden_scales("skewed", 5, seed=1).shape
    (5,)
    """
    require(kind in KINDS, "kind", f"one of {', '.join(KINDS)}", kind)
    whole = is_whole(k, 2) and is_number(k, 2, _MOST_LEVELS)
    require(whole, "k", f"the number of levels, a whole number from 2 to {_MOST_LEVELS}", k)
    key = fold(key_of(seed_of(seed)), name_code(f"{kind} scale"))
    gaps = _gaps(kind, int(k), np.random.default_rng(int(key)))
    gaps = gaps / gaps.sum() + _LEAST_GAP
    values = np.concatenate([[0.0], np.cumsum(gaps)])
    # rounded, because processors differ in the last bits of powers
    scaled: Floats = np.round(values / values[-1], 12)
    return scaled


def _gaps(kind: str, k: int, generator: np.random.Generator) -> Floats:
    """Return k - 1 gaps of this kind, not yet scaled to a total."""
    if kind == "equal":
        return np.ones(k - 1)
    if kind in ("even", "skewed"):
        return np.asarray(generator.dirichlet(np.full(k - 1, 1.0 if kind == "even" else 0.3)))
    low, high = _POWERS
    power = low * (high / low) ** float(generator.random())
    gaps = np.diff([(i / (k - 1)) ** power for i in range(k)])
    return gaps if kind == "convex" else gaps[::-1]
