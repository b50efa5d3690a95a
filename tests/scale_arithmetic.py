"""Tail sums, dominance, and scales by their gaps, written a second time for the tests.

Sums run in the order that the toolkit states, so that numbers can be compared to the last bit.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def tail_sums(d: Floats) -> Floats:
    """Return t (n, k-1) with t_j = d_k + ... + d_{j+1}, of differences d (n, k) or (k,)."""
    t = np.array(d[..., 1:])
    for j in range(t.shape[-1] - 2, -1, -1):
        t[..., j] = t[..., j + 1] + d[..., j + 1]
    return t


def dominance(t: Floats) -> NDArray[np.int8]:
    """Return eq. (4) of tail sums t (n, k-1) as codes of ``Verdict``: 1, -1, 0, or 2 for none."""
    up, down = (t >= 0).all(axis=-1), (t <= 0).all(axis=-1)
    return np.where(up & down, 0, np.where(up, 1, np.where(down, -1, 2))).astype(np.int8)


def dot(t: Floats, g: Floats) -> Floats:
    """Return t.g (n,) of tail sums t (n, k-1) and gaps g (k-1,), summed from the first gap on."""
    total = np.zeros(t.shape[:-1])
    for j in range(t.shape[-1]):
        total = total + t[..., j] * g[..., j]
    return total


def normalise(values: ArrayLike) -> Floats:
    """Return a scale (k,) from 0 to 1 of increasing values (k,)."""
    v = np.asarray(values, dtype=float)
    return (v - v[0]) / (v[-1] - v[0])


def gaps(values: ArrayLike) -> Floats:
    """Return the gaps g (k-1,) of increasing values (k,), with total 1."""
    return np.diff(normalise(values))


def values_of(g: Floats) -> Floats:
    """Return the scale e (k,) of gaps g (k-1,): 0, g_1, g_1 + g_2, ..."""
    return np.append(0.0, np.cumsum(g))
