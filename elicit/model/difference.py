"""Differences of share vectors: checked, turned into tail sums, and brought to order one.

A difference d (k,) is used through its tail sums t_j, the sum of d_i over i > j, because d.e = t.g
on a scale with gaps g (``model.scale``). Verdicts are the same for a difference and its positive
multiples. So numerical code works on a multiple by a power of two, which is exact: the one whose
largest tail sum lies in [1/2, 1).

Entries of levels 2..k must lie between -``MOST`` and ``MOST``, so that no tail sum overflows.
``as_vectors`` refuses others. ``of_order_one`` refuses a row whose smallest numbers would lose bits
beside its largest. Compiled loops cannot refuse. For them ``difference_kernel`` has the same
functions for a single row.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit.model.scale import Floats, as_rows

MOST = 2.0**1000
"""The largest size of a number in a difference or a vector, about 1e301."""

_CODES = np.array(
    [2, 1, -1, 0], dtype=np.int8
)  # by whether all are >= 0, and (counting twice) all <= 0


class OrderOne(NamedTuple):
    """Differences divided by powers of two, so that the largest tail sum of each is in [1/2, 1).

    Rows that are zero stay zero.
    """

    d: Floats  # (n, k); level 1, which decides nothing, may overflow
    t: Floats  # (n, k-1) the tail sums of d
    exponent: NDArray[np.int32]  # (n,) of the powers of two


def as_vectors(vectors: ArrayLike, k: int | None = None, name: str = "d") -> Floats:
    """Return vectors or differences as an array (n, k) of floats. A single (k,) becomes (1, k).

    Raises ValueError if they have another shape, are not finite, or are beyond ``MOST``.
    """
    rows = as_rows(vectors, k, name)
    size = np.abs(rows[:, 1:])
    if not size.max(initial=0.0) <= MOST:
        row, column = np.unravel_index(size.argmax(), size.shape)
        raise ValueError(
            f"numbers of {name} must lie between -2^1000 and 2^1000 (about 1e301), but "
            f"row {row}, level {column + 2} is {rows[row, column + 1]:g}: divide all of them by "
            "the same number"
        )
    return rows


def as_differences(d: ArrayLike, k: int) -> Floats:
    """Return differences of share vectors as an array (n, k) of finite floats.

    A comparator's methods call it first.

    Parameters
    ----------
    d : array_like
        (n, k) left - right, a row for each comparison. A single difference (k,) becomes (1, k).
    k : int
        The number of levels.

    Returns
    -------
    (n, k)
        The differences as floats.

    Raises
    ------
    ValueError
        If d holds no numbers, has another shape, is not finite, or holds numbers beyond 2^1000
        (about 1e301). The message says which row and level.

    Examples
    --------
    >>> elicit.as_differences([0.25, -0.5, 0.25], k=3)
    array([[ 0.25, -0.5 ,  0.25]])
    """
    return as_vectors(d, k)


def tail_sums(d: Floats) -> Floats:
    """Return the tail sums t (n, k-1) of d (n, k), or (k-1,) of (k,): t_j = sum of d_i over i > j.

    They are added in sequence from the best level down, so that every caller rounds alike.
    """
    t: Floats = np.cumsum(d[..., :0:-1], axis=-1)[..., ::-1]
    return t


def of_order_one(d: Floats, name: str = "d") -> OrderOne:
    """Return differences d (n, k) divided by powers of two, with their tail sums.

    Raises ValueError if that would lose bits of a tail sum, or of an entry of levels 2..k.
    """
    t = tail_sums(d)
    exponent = np.frexp(np.abs(t).max(axis=1, initial=0.0))[1]
    power = exponent[:, None]
    with np.errstate(over="ignore", under="ignore"):
        small = OrderOne(np.ldexp(d, -power), np.ldexp(t, -power) + 0.0, exponent)
        if (exponent <= 0).all():  # nothing was made smaller
            return small
        kept = (np.ldexp(small.t, power) == t) & (np.ldexp(small.d, power) == d)[:, 1:]
    if not kept.all():
        row = int(np.argmin(kept.all(axis=1)))
        raise ValueError(
            f"row {row} of {name} holds both huge and tiny numbers, {d[row]}: round the tiny ones "
            "to 0"
        )
    return small


def dominance(t: Floats) -> NDArray[np.int8]:
    """Return verdicts by dominance (the paper's eq. (4)) on tail sums t (n, k-1), as codes.

    1: left dominates. -1: right does. 0: they are equal. 2: neither dominates.
    """
    up, down = t.min(axis=-1, initial=0.0) >= 0, t.max(axis=-1, initial=0.0) <= 0
    return np.asarray(_CODES[up.astype(np.intp) + 2 * down])
