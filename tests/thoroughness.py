"""Thoroughness of a test: all its cases in a run that has the slow tests, a part in a quick one."""

from collections.abc import Iterable
from itertools import combinations, product
from typing import Any, TypeVar

import pytest
from hypothesis import settings

T = TypeVar("T")

QUICK, SLOW = "quick", "slow"
settings.register_profile(QUICK, max_examples=10, deadline=None)
settings.register_profile(SLOW, max_examples=100, deadline=None)


def choose(expression: str) -> None:
    """Take the profile that goes with an expression of marks, as pytest's option ``-m`` has it."""
    settings.load_profile(QUICK if expression.strip() == "not slow" else SLOW)


def thorough() -> bool:
    """Return whether the slow tests are run too."""
    return settings.get_current_profile_name() != QUICK


def scaled(quick: T, slow: T) -> T:
    """Return the first in a quick run, else the second: a number of seeds or cases, say."""
    return slow if thorough() else quick


def examples(slow: int) -> settings:
    """Return the settings of a property that is tried on so many examples; in a quick run on a
    fifth of them.
    """
    return settings(max_examples=max(5, slow * settings.default.max_examples // 100), deadline=None)


def quick_first(values: Iterable[Any], quick: int) -> list[Any]:
    """Return a test's parameters, all but the first ``quick`` of them marked as slow."""
    return [
        value if i < quick else pytest.param(value, marks=pytest.mark.slow)
        for i, value in enumerate(values)
    ]


def covering(*factors: Iterable[Any], together: int = 2) -> list[Any]:
    """Return all combinations of values, the parameters of a test, few of them in the quick run.

    Any ``together`` values of different factors meet in one of these, so each pair of values does
    by default. The others are slow.
    """
    values = [[*factor] for factor in factors]
    cases = [*product(*(range(len(each)) for each in values))]
    groups = [*combinations(range(len(values)), together)]
    meets = {case: {(group, *(case[i] for i in group)) for group in groups} for case in cases}
    missing = set().union(*meets.values())
    quick = set()
    while missing:
        best = max(cases, key=lambda case: len(meets[case] & missing))
        missing -= meets[best]
        quick.add(best)
    return [
        pytest.param(
            *(values[i][j] for i, j in enumerate(case)),
            marks=[] if case in quick else pytest.mark.slow,
        )
        for case in cases
    ]
