"""K_t in gap space: the rows of answers and prior inequalities, and proofs about the set in floats.

Points and multipliers come from solvers that are only nearly right. A point counts once it
satisfies every constraint by more than any rounding. Multipliers count by a bound that holds for
any multipliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit._support.jit import compiled
from elicit.lp.prior_inequalities import Prior
from elicit.model.query import Answers
from elicit.model.scale import Floats, order_bounds

TIE_BAND = 1e-9
"""An answer "equal" means |d.e| <= tie, or <= TIE_BAND |d|_1 where that is wider (as it is where
the tie is 0).
"""


@dataclass(frozen=True, eq=False)
class Region:
    """The set K = {g >= margin, sum g = 1, rows g >= rhs}.

    ``owner`` (m,) names each row's origin: the number of the answer it comes from, or -1 - i for
    prior inequality i.
    """

    margin: float
    rows: Floats
    rhs: Floats
    owner: NDArray[np.int64]

    @property
    def p(self) -> int:
        """Number of gaps, k - 1."""
        return int(self.rows.shape[1])

    @property
    def exact_margin(self) -> Fraction:
        """The margin as a rational.

        It is the float's own value, or 1/p itself if the float is nearest to that (which is the
        only way to ask for equal gaps).
        """
        return Fraction(1, self.p) if self.margin == 1.0 / self.p else Fraction(self.margin)

    @cached_property
    def constraints(self) -> tuple[Floats, Floats]:
        """All constraints (p + m, p) and their limits (p + m,), the order's first."""
        limits = np.concatenate([np.full(self.p, self.margin), self.rhs])
        return np.concatenate([np.eye(self.p), self.rows]), limits

    @cached_property
    def constraints_in_order(self) -> tuple[Floats, Floats]:
        """The constraints (m, p) and limits (m,) that say anything, each once.

        Their order depends on their set only. So nothing computed from them depends on the order of
        the answers.
        """
        rows, limits = self.constraints
        used = np.flatnonzero(np.abs(rows).max(axis=1) > 0)
        _, first = np.unique(np.column_stack([limits, rows])[used], axis=0, return_index=True)
        return rows[used[first]], limits[used[first]]

    def take(self, keep: NDArray[Any], margin: float | None = None) -> Region:
        """Return the same region with only some of its rows, and perhaps another margin."""
        return Region(
            self.margin if margin is None else margin,
            self.rows[keep],
            self.rhs[keep],
            self.owner[keep],
        )

    def plus(self, rows: Floats, rhs: Floats, owner: NDArray[np.int64]) -> Region:
        """Return the same region cut by further rows."""
        join = np.concatenate
        return Region(
            self.margin, join([self.rows, rows]), join([self.rhs, rhs]), join([self.owner, owner])
        )


def rounding(p: int, magnitude: Any) -> Any:
    """Return a bound on the error of a float sum of p products.

    It also covers numbers that underflow (Higham 2002, section 3.1, with room to spare).

    Parameters
    ----------
    p : int
    magnitude : float or array
        Total of the products' absolute values.

    Returns
    -------
    float or array, as ``magnitude``
    """
    return (p + 8) * 2.0**-52 * magnitude + 2.0**-1000


def _unit_rows(d: Floats, name: str) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return tail sums of d (n, k) with a largest entry in [1/2, 1), d at the same scale, and
    exponents.

    The tail sums are (n, p). The exponents (n,) are those of the powers of two by which they were
    divided. Raises ValueError if that would lose bits.
    """
    t, small, exponents = (
        np.empty((len(d), d.shape[1] - 1)),
        np.empty(d.shape),
        np.empty(len(d), dtype=np.int64),
    )
    row = scale_rows(d, d.shape[1].bit_length(), t, small, exponents)
    if row >= 0:
        raise ValueError(
            f"row {row} of {name} holds both huge and tiny numbers, {d[row]}: round the tiny ones "
            "to 0"
        )
    return t, small, exponents


@compiled
def scale_rows(d: Any, spare: int, t: Any, small: Any, exponents: Any) -> int:
    """Write the tail sums, rows and exponents of ``_unit_rows`` into the last three arguments.

    Returns the first row that would lose bits, or -1. ``spare`` bits leave the sums below 1.
    """
    k = d.shape[1]
    for i in range(len(d)):
        largest = 0.0
        for j in range(1, k):
            largest = max(largest, abs(d[i, j]))
        first = math.frexp(largest)[1] + spare
        for j in range(k):
            small[i, j] = math.ldexp(d[i, j], -first)
            if j > 0 and math.ldexp(small[i, j], first) != d[i, j]:
                return i
        total, largest = 0.0, 0.0
        for j in range(k - 1, 0, -1):
            total += small[i, j]
            t[i, j - 1] = total
            largest = max(largest, abs(total))
        rest = math.frexp(largest)[1]
        for j in range(k - 1):
            t[i, j] = math.ldexp(t[i, j], -rest) + 0.0
        for j in range(k):
            small[i, j] = math.ldexp(small[i, j], -rest)
        exponents[i] = first + rest
    return -1


def answer_rows(
    answers: Answers, first: int, tie: float
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return the rows, right-hand sides and owners of the answers' cuts.

    An answer y = +-1 is the cut y t.g >= 0. An answer y = 0 is the band on both sides, as wide as
    ``tie`` in units of d.e.

    Parameters
    ----------
    answers : Answers
    first : int
        Number of the first answer.
    tie : float

    Returns
    -------
    rows : (m, p)
    rhs : (m,)
    owner : (m,)
    """
    t, d, exponent = _unit_rows(answers.d, "the answers")
    with np.errstate(over="ignore"):
        tied = np.minimum(np.ldexp(tie, -exponent), 1.0)  # |t.g| <= 1 at this scale
    # a little wider, so that rounding cannot exclude any scale that the band allows
    band = -(1 + 1e-14) * np.maximum(
        TIE_BAND * np.minimum(np.abs(d).sum(axis=1), 1 / TIE_BAND), tied
    )
    rows, rhs, owner = [], [], []
    for i, y in enumerate(answers.y):
        if not t[i].any():
            continue
        for sign in (1, -1) if y == 0 else (int(y),):
            rows.append(sign * t[i] + 0.0)
            rhs.append(band[i] if y == 0 else 0.0)
            owner.append(first + i)
    p = answers.k - 1
    return (
        np.array(rows).reshape(-1, p),
        np.array(rhs, dtype=np.float64),
        np.array(owner, dtype=np.int64),
    )


def prior_rows(
    prior: Prior | tuple[Floats, Floats] | None, k: int
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return rows, right-hand sides and owners of A e >= b in gap space.

    e is the cumulative sum of g, so A's tail sums are its rows.

    Parameters
    ----------
    prior : Prior, (A (p, k), b (p,)), or None
    k : int

    Returns
    -------
    rows : (m, k-1)
    rhs, owner : (m,) each
    """
    if prior is None:
        return np.empty((0, k - 1)), np.empty(0), np.empty(0, dtype=np.int64)
    rows, _, exponent = _unit_rows(prior[0], "the prior's A")
    with np.errstate(over="ignore"):
        rhs = np.clip(
            np.ldexp(prior[1], -exponent), -2.0, 2.0
        )  # |row.g| <= 1, so limits beyond make no difference
    if ((np.ldexp(rhs, exponent) != prior[1]) & (np.abs(rhs) < 2)).any():
        raise ValueError(
            f"the prior's b is too small beside its A: round {prior[1]} to 0 where it is nearly so"
        )
    return rows, rhs, -1 - np.arange(len(rhs))


def certified_bound(t: Floats, y: Floats, region: Region) -> float:
    """Return a lower bound on t.g over the region that holds for any y >= 0.

    t.g = (t - rows'y).g + y.(rows g) >= min over K_0 of (t - rows'y).g + y.rhs, less every
    rounding. It is -inf if floats overflow.

    Parameters
    ----------
    t : (p,)
    y : (m,)
        Multipliers of the region's rows.
    region : Region

    Returns
    -------
    float
    """
    p, used = region.p, np.flatnonzero(y)
    rows, rhs, weights = region.rows[used], region.rhs[used], y[used]
    with np.errstate(all="ignore"):
        rest = t - product(weights, rows)
        size = float((np.abs(t) + product(weights, np.abs(rows))).max()) + float(
            product(weights, np.abs(rhs))
        )
        bound = float(
            order_bounds(rest, region.margin)[0]
            + product(weights, rhs)
            - 5.0 * rounding(p + len(used), size)
        )
    return bound if np.isfinite(bound) else -np.inf


def strictly_inside(g: Floats, region: Region) -> bool:
    """Return whether g, divided by its sum, satisfies every constraint by more than any
    rounding.
    """
    if not abs(float(g.sum()) - 1.0) < 1e-12:
        return False
    slack, doubt = _slack(g, region)
    return bool((slack > doubt).all())


def pull_inside(g: Floats, centre: Floats, region: Region) -> Floats | None:
    """Return the nearest strictly interior mixture of g and a strictly interior centre, if there is
    one.

    The entries of g (p,) total about 1.
    """
    slack, doubt = _slack(g, region)
    centre_slack, _ = _slack(centre, region)
    short = ~(slack > doubt)
    with np.errstate(all="ignore"):
        lift = (2.0 * doubt - slack)[short] / (centre_slack - slack)[short]
    share = float(lift.max(initial=0.0))
    for more in (1.0, 1.5, 10.0):
        if not share * more < 1:
            return None
        mixed: Floats = (1 - share * more) * g + share * more * centre
        mixed = mixed / mixed.sum()
        if strictly_inside(mixed, region):
            return mixed
    return None


def _slack(g: Floats, region: Region) -> tuple[Floats, Floats]:
    """Return by how much g exceeds each limit (p + m,), and bounds on the rounding errors of
    that.
    """
    with np.errstate(all="ignore"):
        slack = np.concatenate([g - region.margin, product(region.rows, g) - region.rhs])
        doubt = 4.0 * rounding(
            region.p, product(np.abs(region.rows), np.abs(g)) + np.abs(region.rhs)
        )
        # the further terms: the components of g total 1 only to 1e-12
        order = np.full(region.p, 1e-11 * region.margin + 1e-300)
        return slack, np.concatenate([order, doubt + 1e-11 * np.abs(region.rhs)])
