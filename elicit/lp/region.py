"""K_t in gap space: the rows that answers and prior inequalities make, and what floats can prove of the set.

Points and multipliers come from solvers that are only nearly right. A point counts once it satisfies every constraint
by more than any rounding, and multipliers by a bound that holds for any multipliers.
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
"""An answer "equal" means |d.e| <= tie, or <= TIE_BAND |d|_1 where that is wider (as it is where the tie is 0)."""


@dataclass(frozen=True, eq=False)
class Region:
    """K = {g >= margin, sum g = 1, rows g >= rhs}; ``owner`` (m,) names each row's origin: the number of
    the answer it comes from, or -1 - i for prior inequality i."""

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
        """The margin as a rational: the float's own value, but 1/p itself where the float is nearest to it
        (which is the only way to ask for equal gaps)."""
        return Fraction(1, self.p) if self.margin == 1.0 / self.p else Fraction(self.margin)

    @cached_property
    def constraints(self) -> tuple[Floats, Floats]:
        """All constraints (p + m, p) and their limits (p + m,), the order's first."""
        limits = np.concatenate([np.full(self.p, self.margin), self.rhs])
        return np.concatenate([np.eye(self.p), self.rows]), limits

    @cached_property
    def constraints_in_order(self) -> tuple[Floats, Floats]:
        """The constraints (m, p) and limits (m,) that say anything, each once, in an order that depends on their set
        only: what is computed from them does not depend on the order in which answers came."""
        rows, limits = self.constraints
        used = np.flatnonzero(np.abs(rows).max(axis=1) > 0)
        _, first = np.unique(np.column_stack([limits, rows])[used], axis=0, return_index=True)
        return rows[used[first]], limits[used[first]]

    def take(self, keep: NDArray[Any], margin: float | None = None) -> Region:
        """The same region with only some of its rows, and perhaps another margin."""
        return Region(self.margin if margin is None else margin, self.rows[keep], self.rhs[keep], self.owner[keep])

    def plus(self, rows: Floats, rhs: Floats, owner: NDArray[np.int64]) -> Region:
        """The same region cut by further rows."""
        join = np.concatenate
        return Region(self.margin, join([self.rows, rows]), join([self.rhs, rhs]), join([self.owner, owner]))


def rounding(p: int, magnitude: Any) -> Any:
    """A bound on the error of a float sum of p products whose absolute values total ``magnitude``
    (Higham 2002, section 3.1, with room to spare), and of numbers that underflow."""
    return (p + 8) * 2.0**-52 * magnitude + 2.0**-1000


def _unit_rows(d: Floats, name: str) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Tail sums (n, p) with a largest entry in [1/2, 1), d (n, k) at the same scale, and the exponents (n,)
    of two by which they were divided. Raises ValueError where that would lose bits."""
    t, small, exponents = np.empty((len(d), d.shape[1] - 1)), np.empty(d.shape), np.empty(len(d), dtype=np.int64)
    row = scale_rows(d, d.shape[1].bit_length(), t, small, exponents)
    if row >= 0:
        raise ValueError(f"row {row} of {name} holds both huge and tiny numbers, {d[row]}: round the tiny ones to 0")
    return t, small, exponents


@compiled
def scale_rows(d: Any, spare: int, t: Any, small: Any, exponents: Any) -> int:
    """``_unit_rows`` into the last three arguments; the first row that would lose bits, else -1. ``spare`` bits leave
    the sums below 1."""
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


def answer_rows(answers: Answers, first: int, tie: float) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Rows, right-hand sides and owners of the cuts: y t.g >= 0, and for y = 0 the band on both sides, as wide as
    ``tie`` in units of d.e."""
    t, d, exponent = _unit_rows(answers.d, "the answers")
    with np.errstate(over="ignore"):
        tied = np.minimum(np.ldexp(tie, -exponent), 1.0)  # |t.g| <= 1 at this scale
    # a little wider, so that rounding cannot exclude what the band allows
    band = -(1 + 1e-14) * np.maximum(TIE_BAND * np.minimum(np.abs(d).sum(axis=1), 1 / TIE_BAND), tied)
    rows, rhs, owner = [], [], []
    for i, y in enumerate(answers.y):
        if not t[i].any():
            continue
        for sign in (1, -1) if y == 0 else (int(y),):
            rows.append(sign * t[i] + 0.0)
            rhs.append(band[i] if y == 0 else 0.0)
            owner.append(first + i)
    p = answers.k - 1
    return np.array(rows).reshape(-1, p), np.array(rhs, dtype=np.float64), np.array(owner, dtype=np.int64)


def prior_rows(prior: Prior | tuple[Floats, Floats] | None, k: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """A e >= b in gap space: e is the cumulative sum of g, so A's tail sums are its rows."""
    if prior is None:
        return np.empty((0, k - 1)), np.empty(0), np.empty(0, dtype=np.int64)
    rows, _, exponent = _unit_rows(prior[0], "the prior's A")
    with np.errstate(over="ignore"):
        rhs = np.clip(np.ldexp(prior[1], -exponent), -2.0, 2.0)  # |row.g| <= 1: beyond, any limit means the same
    if ((np.ldexp(rhs, exponent) != prior[1]) & (np.abs(rhs) < 2)).any():
        raise ValueError(f"the prior's b is too small beside its A: round {prior[1]} to 0 where it is nearly so")
    return rows, rhs, -1 - np.arange(len(rhs))


def certified_bound(t: Floats, y: Floats, region: Region) -> float:
    """A lower bound on t.g over the region that holds for ANY y >= 0.

    t.g = (t - rows'y).g + y.(rows g) >= min over K_0 of (t - rows'y).g + y.rhs, less every rounding;
    -inf where floats overflow.
    """
    p, used = region.p, np.flatnonzero(y)
    rows, rhs, weights = region.rows[used], region.rhs[used], y[used]
    with np.errstate(all="ignore"):
        rest = t - product(weights, rows)
        size = float((np.abs(t) + product(weights, np.abs(rows))).max()) + float(product(weights, np.abs(rhs)))
        bound = float(
            order_bounds(rest, region.margin)[0] + product(weights, rhs) - 5.0 * rounding(p + len(used), size)
        )
    return bound if np.isfinite(bound) else -np.inf


def strictly_inside(g: Floats, region: Region) -> bool:
    """Whether g, divided by its sum, satisfies every constraint by more than any rounding."""
    if not abs(float(g.sum()) - 1.0) < 1e-12:
        return False
    slack, doubt = _slack(g, region)
    return bool((slack > doubt).all())


def pull_inside(g: Floats, centre: Floats, region: Region) -> Floats | None:
    """The nearest mixture of g (of total about 1) and a strictly interior centre that is itself strictly inside."""
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
    """By how much g exceeds each limit (p + m,), and more than that number's rounding error."""
    with np.errstate(all="ignore"):
        slack = np.concatenate([g - region.margin, product(region.rows, g) - region.rhs])
        doubt = 4.0 * rounding(region.p, product(np.abs(region.rows), np.abs(g)) + np.abs(region.rhs))
        # the further terms: the components of g total 1 only to 1e-12
        order = np.full(region.p, 1e-11 * region.margin + 1e-300)
        return slack, np.concatenate([order, doubt + 1e-11 * np.abs(region.rhs)])
