"""The ordinal scale in gap coordinates, in which everything linear is simple.

A scale e_1 < ... < e_k is normalised to e_1 = 0 and e_k = 1. Its k-1 gaps are g_j = e_{j+1} - e_j,
and total 1. The tail sums of a difference d of two share vectors are t_j, the sum of d_i over i >
j. Then d.e = t.g. Dominance (the paper's eq. (4)) is t >= 0, and an answer is a cut t.g >= 0.
"""

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def as_rows(numbers: ArrayLike, k: int | None = None, name: str = "d") -> Floats:
    """Return numbers as rows (n, k) of finite floats, after a check. A vector (k,) becomes (1, k).

    Parameters
    ----------
    numbers : (n, k) or (k,)
    k : int, optional
        The number of levels that is required. Default: any, from 2 on.
    name : str
        The name of the numbers in messages.

    Returns
    -------
    (n, k)

    Raises
    ------
    ValueError
        For another shape, and for numbers that are not finite.
    """
    try:
        a = np.asarray(numbers, dtype=np.float64)
        a = a if a.ndim == 2 else np.atleast_2d(a)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} must be numbers of shape (n, k): {error}") from None
    if a.ndim != 2 or (k is not None and a.shape[1] != k) or a.shape[1] < 2:
        want = "(n, k) with k >= 2" if k is None else f"(n, {k}), one column a level"
        raise ValueError(f"{name} must have shape {want}, not {np.shape(numbers)}")
    if not np.isfinite(a).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(a))[0])
        raise ValueError(
            f"{name} must be finite, but row {row}, level {column + 1} is {a[row, column]}"
        )
    return a


def dot(t: Floats, g: Floats) -> Floats:
    """Return t.g (n,) for t (n, k-1) and g (k-1,).

    The sum has a fixed order. With BLAS a row's result could depend on its neighbours.
    """
    total: Floats = np.zeros(t.shape[:-1])
    for j in range(t.shape[-1]):
        total = total + t[..., j] * g[..., j]
    return total


def exact_dot(t: Iterable[Any], g: Iterable[Any]) -> Fraction:
    """Return t.g without rounding, for tail sums t (k-1,) and gaps g, floats or Fractions."""
    return sum((Fraction(a) * Fraction(b) for a, b in zip(t, g, strict=True)), Fraction())


def rounded_to_total(parts: Floats, digits: int = 0) -> Floats:
    """Round parts (k,) to ``digits`` decimals so that they add up to their rounded total.

    The parts with the largest remainders are rounded up.
    """
    unit = 10.0**digits
    exact = np.round(parts * unit, 6)  # a part that is whole but for float error stays as it is
    counts = np.floor(exact)
    missing = round(float(exact.sum())) - int(counts.sum())
    counts[np.argsort(counts - exact, kind="stable")[:missing]] += 1
    return np.asarray(counts / unit)


def normalise(values: ArrayLike) -> Floats:
    """Return the scale (k,) as (values - values[0]) / (values[-1] - values[0]).

    Parameters
    ----------
    values : (k,)
        The value of each level, worst first.

    Returns
    -------
    (k,)
        From 0 to 1.

    Raises
    ------
    ValueError
        Unless there are k >= 2 finite, strictly increasing values.
    """
    v = as_rows(values, name="values")[0] if np.ndim(values) == 1 else None
    if v is None:
        raise ValueError(f"values must have shape (k,) with k >= 2, not {np.shape(values)}")
    rises = v[1:] > v[:-1]
    if not rises.all():
        j = int(np.argmin(rises))
        raise ValueError(
            f"values must increase from the worst level to the best, but value {j + 1} is {v[j]:g} "
            f"and value {j + 2} is {v[j + 1]:g}"
        )
    half = v * 0.5  # halves cannot overflow on subtraction
    spread = half[-1] - half[0]
    e: Floats = (half - half[0]) / (spread if spread > 0 else 1.0)
    if not (np.diff(e) > 0).all():
        raise ValueError(
            f"values {v} are too close together to be told apart once normalised to 0..1"
        )
    return e


def gaps(values: ArrayLike) -> Floats:
    """Return the gaps g (k-1,) of a scale, normalised to total 1."""
    return np.diff(normalise(values))


def values_of(g: Floats) -> Floats:
    """Return the scale e (k,) with gaps g (k-1,): 0, g_1, g_1 + g_2, ..."""
    return np.concatenate([[0.0], np.cumsum(g)])


def order_bounds(t: Floats, margin: float) -> tuple[Floats, Floats]:
    """Return the least and the greatest d.e (n,) over all ordered scales.

    These are the scales K_0 = {g >= margin, sum g = 1}. The bounds have a closed form in the tail
    sums t (n, k-1).
    """
    p = t.shape[-1]
    base = margin * t.sum(axis=-1)
    free = 1 - p * margin
    return base + free * t.min(axis=-1), base + free * t.max(axis=-1)
