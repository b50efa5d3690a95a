"""Thoroughness of a test: all its cases in a run that has the slow tests, a part in a quick one.

A quick run as on an older processor has fewer still, for another quick run goes before it.
"""

import os
from collections.abc import Callable, Iterable
from itertools import combinations, product
from typing import Any, TypeVar

import pytest
from hypothesis import settings

T = TypeVar("T")
Test = TypeVar("Test", bound=Callable[..., Any])

OLDER = "TESTS_ON_OLDER_PROCESSOR" in os.environ  # which tests/older_processor.py sets
QUICK, SLOW = "quick", "slow"
settings.register_profile(QUICK, max_examples=5 if OLDER else 10, deadline=None)
settings.register_profile(SLOW, max_examples=100, deadline=None)


def choose(expression: str) -> None:
    """Take the profile that goes with an expression of marks, as pytest's option ``-m`` has it."""
    settings.load_profile(QUICK if expression.strip() == "not slow" else SLOW)


def thorough() -> bool:
    """Return whether the slow tests are run too."""
    return settings.get_current_profile_name() != QUICK


def scaled(quick: T, slow: T, older: T | None = None) -> T:
    """Return the first in a quick run, else the second: a number of seeds or cases, say. In a quick
    run as on an older processor, return the third if there is one.
    """
    if thorough():
        return slow
    return older if OLDER and older is not None else quick


def on_any_processor(test: Test) -> Test:
    """Mark a test whose outcome does not hang on the processor (of errors, of how a program starts,
    of what a simulation with wide limits says) as slow in a run as on an older one.
    """
    marked: Test = pytest.mark.slow(test) if OLDER else test
    return marked


def examples(slow: int) -> settings:
    """Return the settings of a property that is tried on so many examples; in a quick run on a
    fifth of them.
    """
    return settings(max_examples=max(5, slow * settings.default.max_examples // 100), deadline=None)


def quick_first(
    values: Iterable[Any], quick: int, older: int | None = None, names: int = 1
) -> list[Any]:
    """Return a test's parameters, all but the first ``quick`` of them marked as slow.

    As on an older processor these are all but the first ``older``, if that is given. If the test
    has several ``names`` for them, each value is a tuple of so many.
    """
    quick = older if OLDER and older is not None else quick
    return [
        value
        if i < quick
        else pytest.param(*(value if names > 1 else [value]), marks=pytest.mark.slow)
        for i, value in enumerate(values)
    ]


def covering(*factors: Iterable[Any], together: int = 2) -> list[Any]:
    """Return all combinations of values, the parameters of a test, few of them in the quick run.

    Any ``together`` values of different factors meet in one of these, so each pair of values does
    by default; as on an older processor each single value. The others are slow.
    """
    together = 1 if OLDER else together
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
