"""The violation of answers by a scale, as a sum of terms max(0, ...), and its minimum."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from elicit.comparators.polytope.plausible_set import PlausibleSet
from elicit.lp.dual_simplex import End, minimise_exactly
from elicit.lp.region import Region, answer_rows
from elicit.lp.rounding import pull_inside, rounding
from elicit.model.difference import of_order_one
from elicit.model.query import Answers
from elicit.model.scale import Floats


class Hinges(NamedTuple):
    """The total violation of the answers, f(g) = sum weights * max(0, rhs - rows g).

    Each term, a *hinge*, is an inequality that an answer states about the gaps g. The unit of f is
    2^exponent. Weights are powers of two, at most 1.
    """

    rows: Floats  # (m, p)
    rhs: Floats  # (m,)
    owner: NDArray[np.int64]  # (m,) number of the answer
    weights: Floats  # (m,)
    exponent: int

    @staticmethod
    def of(answers: Answers, tie: float) -> Hinges:
        """Return the terms for these answers: one for each inequality that an answer states.

        "Equal" states two: |d.e| <= ``tie``.
        """
        rows, rhs, owner = answer_rows(answers, 0, tie)
        size = of_order_one(answers.d, "the answers").exponent[owner]
        exponent = int(size.max()) if len(size) else 0
        return Hinges(rows, rhs, owner, np.ldexp(1.0, size - exponent), exponent)

    def lacking(self, g: Floats) -> Floats:
        """Return by how much each row (m,) is short of its limit at g (p,), times its weight.

        It is negative if g satisfies the row with room to spare.
        """
        return np.asarray(self.weights * (self.rhs - self.rows @ g))

    def total(self, g: Floats) -> float:
        """Return the total violation f at g (p,)."""
        return float(np.maximum(self.lacking(g), 0.0).sum())

    def at_most(self, g: Floats) -> float:
        """Return an upper bound on f at g, which allows for rounding, also of g itself."""
        doubt = 4.0 * rounding(len(g), np.abs(self.rows) @ np.abs(g) + np.abs(self.rhs))
        each = np.maximum(self.lacking(g) + self.weights * doubt, 0.0)
        return float(each.sum() * (1.0 + 2.0**-50 * len(each)))

    def cut(self, weights: Floats, budget: float) -> tuple[Floats, float]:
        """Return a cut row.g >= limit, made of some of the terms, that holds wherever f <= budget.

        ``weights`` (m,) are the terms' weights in the cut: each is from 0 to the term's own weight.
        The limit is rounded so that the cut holds.
        """
        row, limit = weights @ self.rows, float(weights @ self.rhs) - budget
        size = float((weights @ np.abs(self.rows)).max() + weights @ np.abs(self.rhs)) + budget
        # g >= 0 totals 1: row.g is off by no more than an entry
        limit -= 2.0 * float(rounding(int(np.count_nonzero(weights)), size))
        exponent = -np.frexp(np.abs(row).max())[1]
        return np.asarray(np.ldexp(row, exponent)), float(
            np.clip(np.ldexp(limit, exponent), -2.0, 2.0)
        )


class HingeSolution(NamedTuple):
    """HiGHS's solution: a point g (p,), and the multipliers of the rows and of the budget.

    ``y`` (m,) >= 0 are the multipliers of the rows, and ``price`` is that of the budget.
    """

    g: Floats
    y: Floats
    price: float


def solve(hinges: Hinges, region: Region, cost: Floats, budget: float) -> HingeSolution | None:
    """Return the (g, s) of least cost in the region, or None if HiGHS finds none.

    Each s_i >= 0 is at least the violation of row i by g, and the weighted sum of s is at most
    ``budget``.
    """
    (m, p), prior = hinges.rows.shape, len(region.rows)
    options = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    rows = np.block(
        [
            [hinges.rows, np.eye(m)],
            [region.rows, np.zeros((prior, m))],
            [np.zeros(p), -hinges.weights],
        ]
    )
    limits = np.concatenate([hinges.rhs, region.rhs, [-budget]])
    bounds = [(region.margin, None)] * p + [(0.0, None)] * m
    total = np.append(np.ones(p), np.zeros(m))[None]
    found = linprog(cost, -rows, -limits, total, [1.0], bounds, method="highs-ds", options=options)
    if found.status != 0:
        return None
    y = np.maximum(-found.ineqlin.marginals, 0.0)
    return HingeSolution(found.x[:p] / found.x[:p].sum(), y[:m], float(y[-1]))


def best_fit(hinges: Hinges, order: PlausibleSet) -> Floats:
    """Return a point (p,) with the least total violation f, up to rounding.

    The point certainly satisfies the order and the prior.
    """
    region, p = order.region, order.region.p
    found = solve(hinges, region, np.append(np.zeros(p), hinges.weights), len(hinges.rows) + 1.0)
    if found is None:
        raise ArithmeticError("HiGHS could not find the least total violation of these answers")
    point = None if order.inside is None else pull_inside(found.g, order.inside, region)
    if point is not None:
        return point
    # the set is too flat for floats: find in rationals a point that violates no answer by much more
    for room in 100.0 ** np.arange(-6, 2):
        vertex = minimise_exactly(
            np.zeros(p), region.plus(hinges.rows, hinges.rows @ found.g - room, hinges.owner)
        )
        if vertex.end is not End.EMPTY:
            break
    return vertex.g.astype(np.float64)
