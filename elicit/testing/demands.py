"""Demands of a contract, which raise AssertionErrors that say what was found instead."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from elicit.model.scale import Floats

_T = TypeVar("_T")
TOLERANCE = 1e-8  # largest error of bounds, times |d|_1; verdicts may have none


def demand(condition: Any, message: str) -> None:
    """Raise AssertionError with the message unless the condition holds."""
    if not condition:
        raise AssertionError(message)


def demand_near(
    what: str, found: Any, wanted: Any, d: Floats, tolerance: float = TOLERANCE
) -> None:
    """Demand that numbers (n,), for rows of d (n, k), be within tolerance |d|_1 of ``wanted``."""
    apart = np.abs(np.nan_to_num(found) - np.nan_to_num(wanted)) > tolerance * np.abs(d).sum(axis=1)
    if apart.any():
        i = int(np.argmax(apart))
        raise AssertionError(f"{what}, but on d = {d[i]} it is {found[i]}, not {wanted[i]}")


def demand_same(what: str, found: Any, than: str, wanted: Any, d: Floats) -> None:
    """Demand that verdict codes (n,), for rows of d (n, k), equal the codes ``wanted``.

    ``than`` says in the message where the latter come from.
    """
    demand_near(f"{what} must agree with {than}", found, wanted, d, 0.0)


def wanted(call: Callable[[], _T]) -> _T:
    """Return the result of a call of the comparator.

    If it has a wrong shape, fail with the message of the contract.
    """
    try:
        return call()
    except (TypeError, ValueError) as error:
        raise AssertionError(str(error)) from error
