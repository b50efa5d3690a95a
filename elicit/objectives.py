"""Objectives beside levels: weights for m objectives that have no order, by the same comparators.

A vector of objectives v (m,), of each of which more is better, is worth w.v. The weights w >= 0 are
hidden and total 1. They are the gaps of a scale of m + 1 levels, and v are the tail sums of
``as_levels(v)``. So for two such vectors d.e is w.(v - u).

    vectors = as_levels(v)                                # (n, m) objectives, say profit and minus
                                                          the waste
    choice = elicit.choose(vectors, elicit.PolytopeComparator(m + 1))
    ...
    weights(choice.comparator.values)                     # (m,)

Everything that looks at differences carries over: comparators, their bounds and proofs, ``choose``,
the learners' loop, tutors (``TruthfulTutor(values(w))``), ``qlearn.InteractiveTraining``. What
changes: dominance is componentwise, "as much of every objective". Vectors are no shares (entries
may be negative), so bags of days and pictures of them mean nothing; show people v itself,
``of_levels(query.left)``. Losses come in the unit of w.v. So bring the objectives to similar
ranges, such as 0 to 1. Otherwise a tolerance depends on the one with the largest numbers alone. No
weight is less than the margin of a polytope, 1e-6 by default.
"""

import numpy as np
from numpy.typing import ArrayLike

from elicit.model.scale import Floats


def as_levels(v: ArrayLike) -> Floats:
    """Return vectors (n, m + 1), of total 1, whose tail sums are the objectives v (n, m).

    Of one vector (m,) it is one (m + 1,). Raises ValueError for what is not finite.
    """
    t = _numbers(v, "objectives")
    first, last = np.ones((*t.shape[:-1], 1)), np.zeros((*t.shape[:-1], 1))
    return np.asarray(np.concatenate([first, t], axis=-1) - np.concatenate([t, last], axis=-1))


def of_levels(vectors: ArrayLike) -> Floats:
    """The objectives (n, m), or (m,), of what ``as_levels`` made of them, up to rounding."""
    x = _numbers(vectors, "vectors")
    return np.asarray(np.cumsum(x[..., :0:-1], axis=-1)[..., ::-1])


def weights(values: ArrayLike) -> Floats:
    """The weights (m,), which total 1, of a scale (m + 1,), such as a comparator's ``values``.

    Raises ValueError.
    """
    e = _numbers(values, "values")
    gaps = np.diff(e)
    if e.ndim != 1 or not len(gaps) or not (gaps >= 0).all() or not gaps.any():
        raise ValueError(f"values must be m + 1 numbers that rise, as a comparator's do, not {e}")
    return np.asarray(gaps / gaps.sum())


def values(w: ArrayLike) -> Floats:
    """The scale (m + 1,), from 0 to 1, whose gaps are these weights (m,) over their total.

    Raises ValueError.
    """
    given = _numbers(w, "weights")
    if given.ndim != 1 or not len(given) or not (given >= 0).all() or not given.any():
        raise ValueError(f"weights must be m numbers of at least 0, not all 0, not {given}")
    e = np.concatenate([[0.0], np.cumsum(given / given.sum())])
    return np.asarray(e / e[-1])


def _numbers(given: ArrayLike, name: str) -> Floats:
    found = np.asarray(given, dtype=np.float64)
    if found.ndim not in (1, 2) or not found.shape[-1] or not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite numbers, (n, m) or (m,), not {given!r}")
    return found
