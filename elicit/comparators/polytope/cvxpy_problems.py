"""The least and the greatest d.e over a set of scales, as cvxpy problems to inspect or extend."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from elicit.lp.prior_inequalities import Prior
from elicit.lp.region import Region
from elicit.model.difference import as_differences
from elicit.model.scale import Floats
from elicit.model.scale_variable import scale_variable

if TYPE_CHECKING:
    import cvxpy


def least_and_greatest(
    d: ArrayLike, region: Region, prior: Prior | None
) -> tuple[cvxpy.Problem, cvxpy.Problem]:
    """Return the problems that minimise and maximise d.e, over a variable e that they share.

    Parameters
    ----------
    d : (k,)
        One difference left - right.
    region : Region
        The margin and the answers' constraints on the gaps (rows whose ``owner`` is at least 0).
    prior : Prior or None
        The prior's inequalities, as they were given.

    Returns
    -------
    least, greatest : cvxpy.Problem
        Labels are "worst level", "best level", "order", the prior's names, and "answer 1", ...
        Each problem has its own constraints, and so its own dual values.

    Raises
    ------
    ValueError
        For other shapes of d.
    """
    import cvxpy as typed

    cp: Any = typed  # cvxpy's type hints are incomplete
    rows = as_differences(d, region.p + 1)
    if len(rows) != 1:
        raise ValueError(
            f"problems takes one difference of shape ({region.p + 1},), not {len(rows)} of them"
        )
    e = scale_variable(region.p + 1)

    def constraints() -> Iterator[Any]:
        yield (e[0] == 0).set_label("worst level")
        yield (e[region.p] == 1).set_label("best level")
        yield (cp.diff(e) >= region.margin).set_label("order")
        for row, limit, name in () if prior is None else zip(*prior, strict=True):
            yield (_constant(row) @ e >= limit).set_label(name)
        # an answer "equal" has two rows, one for each side: |at| <= -limit. It is written as norm1,
        # because cvxpy 1.9 warns of NaN within its bounds on the abs of a matrix product
        for owner in np.unique(region.owner[region.owner >= 0]):
            mine = np.flatnonzero(region.owner == owner)
            at, limit = (
                _constant(_along_levels(region.rows[mine[0]])) @ e,
                float(region.rhs[mine[0]]),
            )
            said = at >= limit if len(mine) == 1 else cp.norm1(at) <= -limit
            yield said.set_label(f"answer {owner + 1}")

    goal = _constant(rows[0]) @ e
    return cp.Problem(cp.Minimize(goal), [*constraints()]), cp.Problem(
        cp.Maximize(goal), [*constraints()]
    )


def _along_levels(t: Floats) -> Floats:
    """Return the difference (k,), of total 0, whose tail sums are t (k-1,)."""
    return 0.0 - np.diff(t, prepend=0.0, append=0.0)


def _constant(row: Floats) -> Any:
    """Return numbers (k,) as a cvxpy constant that prints on one line with four digits."""
    import cvxpy

    return cvxpy.Constant(row, name=f"[{', '.join(f'{x + 0.0:.4g}' for x in row)}]")
