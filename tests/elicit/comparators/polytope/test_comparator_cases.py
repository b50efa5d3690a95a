"""Every verdict and bound of the polytope comparator, on random and adversarial cases, against
exact rationals.
"""

from collections import Counter
from fractions import Fraction

import numpy as np
import pytest

from elicit import Answers, PolytopeComparator
from tests.lp_cases import (
    KINDS,
    Case,
    Oracle,
    cases,
    dot,
    exact,
    least_from_scratch,
    tails,
    verdict,
)
from tests.thoroughness import scaled

PART = 80  # cases; the slow test has 10,000


def told(case: Case, how: int) -> PolytopeComparator:
    """The comparator that knows the case's answers: told at once, one by one in another order, or
    in halves.
    """
    comparator = PolytopeComparator(case.k, margin=case.margin, prior=case.prior, tie=case.tie)
    n = len(case.y)
    if how == 0 or n > 60:
        return comparator.update(Answers(case.d, case.y))
    order = np.random.default_rng(n).permutation(n)
    for rows in [order[: n // 2], order[n // 2 :]] if how == 1 else order[:, None]:
        comparator = comparator.update(Answers(case.d[rows], case.y[rows]))
    return comparator


def check(case: Case, how: int) -> Counter[int]:
    """Verdicts and bounds of one case; returns how often each verdict was right to give."""
    region = case.region()
    assert region.contains(case.truth)
    oracle, comparator = Oracle(region), told(case, how)
    single = how == 2
    given = [comparator.compare(d)[0] for d in case.ask] if single else comparator.compare(case.ask)
    low, high = comparator.bounds(case.ask)
    seen: Counter[int] = Counter()
    for d, got, lo, hi in zip(case.ask, given, low, high, strict=True):
        t = tails(d)
        least, greatest = oracle.range(exact(t))
        expected = verdict(least, greatest)
        seen[expected] += 1
        where = f"{case.kind}, k = {case.k}, {len(case.y)} answers, d = {d.tolist()}"
        assert got == expected, (
            f"{where}: {got} instead of {expected}, exactly {float(least)}..{float(greatest)}"
        )
        # one part in 10^9 of |d|_1, or the last bit of numbers that have only a few
        room = Fraction(1e-9) * sum(map(abs, exact(d))) + Fraction(2) ** -1072
        if np.isfinite([lo, hi]).all():
            assert 0 <= least - Fraction(lo) <= room, where
            assert 0 <= Fraction(hi) - greatest <= room, where
        else:
            assert max(abs(least), abs(greatest)) > 2.0**1000, where
    return seen


@pytest.mark.parametrize(
    "part", [0, *(pytest.param(part, marks=pytest.mark.slow) for part in range(1, 5))]
)
def test_verdicts_and_bounds_are_exact(part: int) -> None:
    seen: Counter[int] = Counter()
    for i, case in enumerate(cases([2024, part], scaled(PART // 4, PART))):
        seen += check(case, (i // len(KINDS) + i) % 3)
    assert set(seen) == {-1, 0, 1, 2}  # the cases are worth their time: each verdict occurs


@pytest.mark.slow
@pytest.mark.parametrize("part", range(50))
def test_verdicts_and_bounds_are_exact_in_many_more_cases(part: int) -> None:
    for i, case in enumerate(cases([7, part], 200, asks=6)):
        check(case, (i // len(KINDS) + i) % 3)


def test_the_second_opinion_agrees_with_itself() -> None:
    """A verified basis and the exact simplex method give the same rational number."""
    verified = 0
    for case in cases(6, 60, asks=2, most_levels=10, most_answers=40):
        oracle = Oracle(case.region())
        for d in case.ask:
            t = exact(tails(d))
            least = oracle.least(t)
            assert least == (least_from_scratch(t, oracle.region) if any(t) else 0)
            assert least <= dot(t, case.truth)
        verified += oracle.verified
    assert verified > 60
