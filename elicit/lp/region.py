"""The plausible set K_t as linear constraints on the gaps: rows of answers and of the prior."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit.lp.prior_inequalities import Prior
from elicit.model.difference import of_order_one
from elicit.model.query import Answers
from elicit.model.scale import Floats

TIE_BAND = 1e-9
"""An answer "equal" means |d.e| <= tie, or <= TIE_BAND |d|_1 if that is wider, as it is if the tie
is 0."""


@dataclass(frozen=True, eq=False)
class Region:
    """The set K = {g >= margin, sum g = 1, rows g >= rhs} of gaps g (p,).

    ``owner`` (m,) says where each row comes from: the number of an answer, or -1 - i for prior
    inequality i.
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

        It is the exact value of the float, but the float nearest to 1/p means 1/p. Otherwise it
        would be impossible to ask for equal gaps.
        """
        return Fraction(1, self.p) if self.margin == 1.0 / self.p else Fraction(self.margin)

    @cached_property
    def constraints(self) -> tuple[Floats, Floats]:
        """All constraints (p + m, p) and limits (p + m,): those of the order, then the rows."""
        limits = np.concatenate([np.full(self.p, self.margin), self.rhs])
        return np.concatenate([np.eye(self.p), self.rows]), limits

    @cached_property
    def constraints_in_order(self) -> tuple[Floats, Floats]:
        """The constraints (m, p) and limits (m,), sorted, without duplicates and trivial ones.

        Since they are sorted, nothing computed from them depends on the order of the answers.
        """
        rows, limits = self.constraints
        used = np.flatnonzero(np.abs(rows).max(axis=1) > 0)
        _, first = np.unique(np.column_stack([limits, rows])[used], axis=0, return_index=True)
        return rows[used[first]], limits[used[first]]

    def take(self, keep: NDArray[Any], margin: float | None = None) -> Region:
        """Return the region with the rows that ``keep`` flags, and perhaps another margin."""
        return Region(
            self.margin if margin is None else margin,
            self.rows[keep],
            self.rhs[keep],
            self.owner[keep],
        )

    def plus(self, rows: Floats, rhs: Floats, owner: NDArray[np.int64]) -> Region:
        """Return the region cut by further rows."""
        join = np.concatenate
        return Region(
            self.margin, join([self.rows, rows]), join([self.rhs, rhs]), join([self.owner, owner])
        )


def answer_rows(
    answers: Answers, first: int, tie: float
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return the linear constraints on the gaps that answers make, as rows g >= rhs.

    An answer y = +-1 is the cut y t.g >= 0. An answer y = 0 makes two cuts: -tie <= t.g <= tie, in
    units of d.e.

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
        The number of the answer that each row comes from.
    """
    d, t, exponent = of_order_one(answers.d, "the answers")
    cutting = np.flatnonzero(t.any(axis=1))
    number = np.repeat(cutting, 2 - np.abs(answers.y[cutting]))  # a tie has both sides
    sign, rhs = answers.y[number], np.zeros(len(number))
    tied = sign == 0
    if tied.any():
        sides = np.flatnonzero(tied)
        sign = sign.copy()
        sign[sides[::2]], sign[sides[1::2]] = 1, -1
        with np.errstate(over="ignore"):
            width = np.minimum(np.ldexp(tie, -exponent), 1.0)  # |t.g| <= 1 at this scale
        sizes = np.minimum(np.abs(d).sum(axis=1), 1 / TIE_BAND)
        # a little wider, so that rounding cannot exclude any scale that the band allows
        band = -(1 + 1e-14) * np.maximum(TIE_BAND * sizes, width)
        rhs[tied] = band[number[tied]]
    return sign[:, None] * t[number] + 0.0, rhs, first + number


def prior_rows(
    prior: Prior | tuple[Floats, Floats] | None, k: int
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return prior inequalities A e >= b as linear constraints on the gaps, rows g >= rhs.

    The scale e is the cumulative sum of the gaps, so the rows are the tail sums of A.

    Parameters
    ----------
    prior : Prior, (A (p, k), b (p,)), or None
    k : int

    Returns
    -------
    rows : (m, k-1)
    rhs : (m,)
    owner : (m,)
        -1 - i for a row that comes from prior inequality i.
    """
    if prior is None:
        return np.empty((0, k - 1)), np.empty(0), np.empty(0, dtype=np.int64)
    _, rows, exponent = of_order_one(prior[0], "the prior's A")
    with np.errstate(over="ignore"):
        rhs = np.clip(
            np.ldexp(prior[1], -exponent), -2.0, 2.0
        )  # since |row.g| <= 1, limits beyond make no difference
    if ((np.ldexp(rhs, exponent) != prior[1]) & (np.abs(rhs) < 2)).any():
        raise ValueError(
            f"the prior's b is too small beside its A: round {prior[1]} to 0 where it is nearly so"
        )
    return rows, rhs, -1 - np.arange(len(rhs))
