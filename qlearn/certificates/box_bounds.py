"""Upper bounds on very many differences at once, most of them over a box of scales."""

import numpy as np

from elicit._support.fixed_order import principal_axes, product
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import draws_in, simultaneous_bounds
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats, order_bounds

_AT_ONCE = 1 << 14  # differences bounded at the same time


def bounds_of_many(comparator: Comparator, d: Floats) -> tuple[Floats, float]:
    """Return upper bounds on d.e for very many differences, and the confidence in them.

    For most of the differences, d.e is below 0 under every plausible scale. Bounds over a box that
    contains all plausible scales suffice to show this, and these bounds are returned for them. The
    other differences have the comparator's ``simultaneous_bounds``.

    The axes of the box are the principal axes of the comparator's draws, and its extent comes from
    2 (k - 1) bounds. No box is used if the comparator has no draws. Nor is one used if its bounds
    are not certain, because such bounds may depend on the number of differences.

    Parameters
    ----------
    comparator : Comparator
    d : (n, k)

    Returns
    -------
    high : (n,) in units of e_k - e_1
    confidence : float
        The probability that all of them hold; 1 if proven.
    """
    if (box := box_of(comparator)) is not None:
        axes, reach, confidence = box
        high = _bounds_by_box(axes, reach, d)
        rows = np.flatnonzero(high > 0)
        high[rows] = simultaneous_bounds(comparator, d[rows])[0]
        return high, confidence
    high, confidence = simultaneous_bounds(comparator, d)
    return np.minimum(high, order_bounds(tail_sums(d), 0.0)[1]), confidence  # the first may be inf


def box_of(comparator: Comparator) -> tuple[Floats, Floats, float] | None:
    """Return a box that contains all plausible scales, or None if there is no proven one.

    Returns
    -------
    axes : (p, p)
        Orthonormal columns.
    reach : (2p,)
        Upper bounds on the gaps along each axis, then along the opposite of each.
    confidence : float
        Always 1.
    """
    if (draws := draws_in(comparator)) is None:
        return None
    gaps, weights = draws[:2]
    spread = gaps - product(gaps, weights)[:, None]
    axes = principal_axes(product(spread * weights, spread.T))  # (p, p), orthonormal
    ways = np.concatenate([axes.T, -axes.T])
    reach, confidence = simultaneous_bounds(
        comparator, -np.diff(ways, axis=1, prepend=0.0, append=0.0)
    )
    return (axes, reach, confidence) if confidence == 1 and np.isfinite(reach).all() else None


def _bounds_by_box(axes: Floats, reach: Floats, d: Floats) -> Floats:
    """Return upper bounds (n,) on d.e over a box of scales.

    The columns of ``axes`` (p, p) are orthonormal. ``reach`` (2p,) are upper bounds on the gaps
    along each axis, then along the opposite of each.
    """
    p, high = len(axes), np.empty(len(d))
    # the axes are orthonormal only up to rounding, and so are the products below
    rounding = (
        np.abs(product(axes, axes.T) - np.eye(p)).max() * p + 16 * p * p * np.finfo(float).eps
    )
    for start in range(0, len(d), _AT_ONCE):
        t, some = tail_sums(d[start : start + _AT_ONCE]), slice(start, start + _AT_ONCE)
        along = product(t, axes)
        high[some] = np.maximum(along * reach[:p], along * -reach[p:]).sum(
            axis=1
        ) + rounding * np.abs(t).sum(axis=1)
    return high
