"""Objectives beside levels: weights of m objectives that have no order, by the same comparators.

A vector v (m,) of objectives, of which more is always better, is worth w.v. The weights w >= 0 are
hidden and total 1. Comparators learn them as a scale of m + 1 levels: the weights are the gaps of
the scale, and v holds the tail sums of ``as_levels(v)``. For two such vectors v and u the inner
product d.e is then w.(v - u).

    vectors = as_levels(v)          # v (n, m), say profit and minus the waste
    choice = elicit.choose(vectors, elicit.PolytopeComparator(m + 1))
    ...
    weights(choice.comparator.values)    # (m,)

All that works on differences works here too: comparators, their bounds and proofs, ``choose``, the
learners' loop, tutors (``TruthfulTutor(values(w))``), ``qlearn.InteractiveTraining``. These things
change:

- A vector dominates another if it has at least as much of every objective.
- The vectors are no shares, and may have negative entries. So show people the objectives,
  ``of_levels(query.left)``, rather than bags of days.
- Losses are in the unit of w.v. Bring the objectives to similar ranges, such as 0 to 1. Otherwise
  the one with the largest numbers alone decides what a tolerance means.
- A polytope's margin (1e-6 by default) is the least weight that it allows.
"""

import numpy as np
from numpy.typing import ArrayLike

from elicit.model.scale import Floats


def as_levels(v: ArrayLike) -> Floats:
    """Return vectors (n, m + 1), of total 1, whose tail sums are the objectives v (n, m).

    Parameters
    ----------
    v : (n, m) or (m,)
        The m objectives of each alternative. More of each is better.

    Returns
    -------
    (n, m + 1), or (m + 1,) for a single v
        The vectors. They may have negative entries.

    Raises
    ------
    ValueError
        If v is not finite, has no objectives, or has another shape.
    """
    t = _numbers(v, "objectives")
    first, last = np.ones((*t.shape[:-1], 1)), np.zeros((*t.shape[:-1], 1))
    return np.asarray(np.concatenate([first, t], axis=-1) - np.concatenate([t, last], axis=-1))


def of_levels(vectors: ArrayLike) -> Floats:
    """Return the objectives (n, m), or (m,), of vectors made by ``as_levels``, up to rounding.

    Parameters
    ----------
    vectors : (n, m + 1) or (m + 1,)
        Vectors that ``as_levels`` made.

    Returns
    -------
    (n, m) or (m,)
        The objectives, in their own units.

    Raises
    ------
    ValueError
        If the vectors are not finite, have no entries, or have another shape.
    """
    x = _numbers(vectors, "vectors")
    return np.asarray(np.cumsum(x[..., :0:-1], axis=-1)[..., ::-1])


def weights(values: ArrayLike) -> Floats:
    """Return the weights (m,), of total 1, that a scale (m + 1,) stands for.

    Parameters
    ----------
    values : (m + 1,)
        The scale, for example a comparator's ``values``. It must not fall.

    Returns
    -------
    (m,)
        The weight of each objective, at least 0.

    Raises
    ------
    ValueError
        If the values are not finite, fall somewhere, or are all the same.
    """
    e = _numbers(values, "values")
    gaps = np.diff(e)
    if e.ndim != 1 or not len(gaps) or not (gaps >= 0).all() or not gaps.any():
        raise ValueError(f"values must be m + 1 numbers that rise, as a comparator's do, not {e}")
    return np.asarray(gaps / gaps.sum())


def values(w: ArrayLike) -> Floats:
    """Return the scale (m + 1,), from 0 to 1, whose gaps are the weights w (m,) over their total.

    Parameters
    ----------
    w : (m,)
        The weight of each objective, at least 0 and not all 0. They need not total 1.

    Returns
    -------
    (m + 1,)
        The scale, as ``elicit.TruthfulTutor`` takes it.

    Raises
    ------
    ValueError
        If the weights are not finite, one is below 0, or all are 0.
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
