"""Settings are checked without raising anything raw, whatever they are."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from elicit.checks import is_number, is_range, is_whole, require

NONE: list[Any] = [None, "a", "1", True, np.True_, math.nan, math.inf, 1j, [1], {}, np.ones(3), Decimal(1), 10**400]


@pytest.mark.parametrize("value", NONE, ids=repr)
def test_what_is_no_number(value: Any) -> None:
    assert not is_number(value)
    assert not is_whole(value, 0)
    assert not is_range(value)
    assert not is_range((value, 1))
    assert not is_range((0, value))


@pytest.mark.parametrize("value", [0, 1, 2.0, np.float32(1.5), np.int8(3), Fraction(1, 3)], ids=repr)
def test_numbers_and_their_limits(value: Any) -> None:
    assert is_number(value)
    assert is_number(value, float(value), float(value))
    assert not is_number(value, least=float(value) + 0.01)
    assert not is_number(value, most=float(value) - 0.01)
    assert is_whole(value, 0) == (float(value) in (0, 1, 2, 3))
    assert not is_whole(value, 4)


def test_ranges() -> None:
    assert is_range((1, 1))
    assert is_range([0.1, 2.0], 0.1, 2.0)
    assert not is_range((2, 1))
    assert not is_range((1, 2, 3))
    assert not is_range((0, 1), least=0.5)
    assert not is_range((0, 1), most=0.5)


def test_what_is_refused_is_named() -> None:
    require(True, "x", "a number", "a")
    with pytest.raises(ValueError, match="x must be a number, not 'a'"):
        require(False, "x", "a number", "a")
