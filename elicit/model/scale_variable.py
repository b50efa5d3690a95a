"""The scale as a cvxpy variable, and linear cvxpy constraints over it as rows a e >= b.

Only functions that need cvxpy import it, when they are called.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.sparse import issparse

from elicit.model.comparator import check_levels
from elicit.model.scale import Floats

if TYPE_CHECKING:
    import cvxpy

_NAME = "e"
_FAR = (
    2.0**200
)  # times a unit vector: beside it no constant is seen, and dividing by it loses no bit
_LONGEST = 80  # characters of a name that cvxpy makes up
_WAY_OUT = "add it to the programs of comparator.problems(d), which the polytopes have"


class LinearConstraint(NamedTuple):
    """A cvxpy constraint as rows a e >= b, with a (m, k) and b (m,), and its name.

    The name is "" if the constraint is best described by its numbers.
    """

    a: Floats
    b: Floats
    name: str


def scale_variable(k: int) -> cvxpy.Variable:
    """Return a cvxpy variable (k,), named e, which stands for the scale.

    Linear constraints over it can be a comparator's ``prior=``. You need not state that e[0] is 0
    and e[k - 1] is 1.

    Parameters
    ----------
    k : int
        Number of levels.

    Returns
    -------
    cvxpy.Variable
        (k,): e[0] is the worst level, and e[k - 1] the best.

    Raises
    ------
    ValueError
        If k is no whole number of at least 2.
    """
    import cvxpy

    return cvxpy.Variable(check_levels(k), name=_NAME)


def is_constraint(thing: object) -> bool:
    """Return whether an object is a cvxpy constraint, without importing cvxpy."""
    if "cvxpy" not in sys.modules:
        return False
    from cvxpy import Constraint

    return isinstance(thing, Constraint)


def linear_rows(constraint: Any, k: int) -> LinearConstraint:
    """Return the rows a e >= b of a cvxpy constraint over a scale variable, two for an equality.

    Rows that only restate that the scale goes from 0 to 1 are left out. Parameters have their
    current values. Coefficients are rounded only as Python would round them. Raise ValueError, with
    advice, unless the constraint is linear in ``scale_variable(k)`` alone.
    """
    called = " ".join((constraint.label or str(constraint)).split())
    _check_terms(constraint, k, called)
    more, less = _sides(constraint, called)
    (variable,) = constraint.variables()
    a_more, b_more = _coefficients(more, variable, k, constraint.shape)
    a_less, b_less = _coefficients(less, variable, k, constraint.shape)
    with np.errstate(all="ignore"):
        a, b = a_more - a_less, 0.0 - (b_more - b_less)
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError(f'the prior\'s "{called}" holds numbers too large to compute with')
    if isinstance(constraint, (_kinds().Equality, _kinds().Zero)):
        a, b = np.stack([a, 0.0 - a], axis=1).reshape(-1, k), np.stack([b, 0.0 - b], axis=1).ravel()
    states = a[:, 1:-1].any(axis=1) | (a[:, -1] < b)
    return LinearConstraint(
        a[states], b[states], called if constraint.label or len(called) <= _LONGEST else ""
    )


def _kinds() -> Any:
    """Return cvxpy's classes of constraints, which its type hints do not export."""
    import cvxpy

    return cvxpy.constraints


def _check_terms(constraint: Any, k: int, called: str) -> None:
    """Raise ValueError unless ``scale_variable(k)`` is the constraint's only variable.

    Each parameter in the constraint must have a value.
    """
    variables = constraint.variables()
    if not variables:
        raise ValueError(
            f'the prior\'s "{called}" compares nothing: no level of the scale is in it'
        )
    others = [v.name() for v in variables if v.name() != _NAME]
    if others:
        raise ValueError(
            f'the prior\'s "{called}" is about {" and ".join(others)}, but a prior is about the '
            "scale alone: write it "
            f"over e = elicit.scale_variable({k}), or leave it out here and {_WAY_OUT}"
        )
    if len(variables) > 1:
        raise ValueError(f'the prior\'s "{called}" mixes {len(variables)} scale variables: use one')
    shape, attributes = variables[0].shape, variables[0].attributes
    if len(shape) == 1 and shape[0] != k:
        raise ValueError(f'the prior\'s "{called}" is about {shape[0]} levels, not k = {k}')
    declared = [
        name for name, value in attributes.items() if value is not None and value is not False
    ]
    if shape != (k,) or declared:
        what = f"declared {', '.join(declared)}" if declared else f"of shape {shape}"
        raise ValueError(
            f'the prior\'s "{called}" is over a variable {what}: write it over '
            f"elicit.scale_variable({k}), of real "
            "numbers, and state what is known of them as constraints"
        )
    unset = [parameter.name() for parameter in constraint.parameters() if parameter.value is None]
    if unset:
        raise ValueError(
            f'the prior\'s "{called}" has no value yet for {" and ".join(unset)}: set its .value '
            "first"
        )


def _sides(constraint: Any, called: str) -> tuple[Any, Any]:
    """Return the two affine expressions of "more >= less" or "more == less".

    Raises ValueError if the constraint has no such sides.
    """
    args, of = constraint.args, _kinds()
    linear = of.Inequality, of.Equality, of.Zero, of.NonNeg, of.NonPos
    if isinstance(constraint, linear) and all(arg.is_affine() for arg in args):
        first, second = args if len(args) == 2 else (args[0], 0.0 * args[0])
        return (
            (second, first)
            if isinstance(constraint, (of.Inequality, of.NonPos))
            else (first, second)
        )
    if isinstance(constraint, of.FiniteSet) or not constraint.is_dcp():
        raise ValueError(
            f'the prior\'s "{called}" is not convex by the rules of cvxpy (DCP), and a prior must '
            "be linear: state it "
            "as linear inequalities"
        )
    raise ValueError(
        f'the prior\'s "{called}" is convex but not linear, and verdicts are proven by linear '
        "programs: state it as "
        "linear inequalities where that can be done (abs(x) <= t is x <= t and x >= -t), or leave "
        "it out here and "
        f"{_WAY_OUT}"
    )


def _coefficients(
    expression: Any, variable: Any, k: int, shape: tuple[int, ...]
) -> tuple[Floats, Floats]:
    """Return the coefficients (m, k) and constants (m,) of an affine expression of m entries.

    They are found by evaluating a copy of the expression, so that the caller's variable keeps its
    value. A coefficient is the slope between two opposite points. They are so far from 0 that the
    constants are lost in rounding.
    """
    import cvxpy

    at = cvxpy.Variable(k)
    copy = expression.tree_copy({id(variable): at})

    def value(point: Floats) -> Floats:
        at.value = point
        found = copy.value
        return (
            np.broadcast_to(found.toarray() if issparse(found) else found, shape)
            .ravel()
            .astype(np.float64)
        )

    with np.errstate(all="ignore"):  # the caller looks for numbers that overflowed
        each = [
            (value(_FAR * unit) - value(-_FAR * unit)) / (2.0 * _FAR) + 0.0 for unit in np.eye(k)
        ]
        return np.stack(each, axis=1), value(np.zeros(k))
