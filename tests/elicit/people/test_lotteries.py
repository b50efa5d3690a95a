"""A value function that is linear between knots values a lottery and its share vector alike."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit.people import knots_of, shares_over
from tests.scale_arithmetic import tail_sums

KNOTS = [0, 7, 10, 40, 100]


@st.composite
def lotteries(draw):
    """Amounts within the knots and whole weights, of which the probabilities are shares."""
    amounts = draw(st.lists(st.integers(0, 100), min_size=1, max_size=5))
    weights = draw(
        st.lists(st.integers(0, 9), min_size=len(amounts), max_size=len(amounts)).filter(any)
    )
    return amounts, weights


def exact_shares(amounts, weights):
    """The shares in exact arithmetic, level by level, by distances from the neighbouring knots."""
    shares = [Fraction(0)] * len(KNOTS)
    for amount, weight in zip(amounts, weights, strict=True):
        for i, knot in enumerate(KNOTS):
            left = KNOTS[i - 1] if i else knot - 1
            right = KNOTS[i + 1] if i + 1 < len(KNOTS) else knot + 1
            hat = min(Fraction(amount - left, knot - left), Fraction(right - amount, right - knot))
            shares[i] += Fraction(weight, sum(weights)) * max(Fraction(0), hat)
    return shares


@given(lotteries())
def test_shares_are_those_of_exact_arithmetic_and_total_one(lottery):
    amounts, weights = lottery
    shares = shares_over(KNOTS, amounts, np.array(weights) / sum(weights))
    assert (shares >= 0).all()
    assert shares.sum() == pytest.approx(1, abs=1e-12)
    assert shares == pytest.approx([float(x) for x in exact_shares(amounts, weights)], abs=1e-12)


@given(lotteries(), st.lists(st.integers(0, 9), min_size=4, max_size=4))
def test_a_value_function_that_is_linear_between_knots_sees_no_difference(lottery, slopes):
    amounts, weights = lottery
    chances = np.array(weights) / sum(weights)
    values = np.concatenate([[0], np.cumsum(slopes * np.diff(KNOTS))])
    direct = float(np.interp(amounts, KNOTS, values) @ chances)
    assert shares_over(KNOTS, amounts, chances) @ values == pytest.approx(direct, abs=1e-9)


@given(lotteries(), st.data())
def test_raising_an_amount_never_lowers_a_tail_sum(lottery, data):
    amounts, weights = lottery
    chances = np.array(weights) / sum(weights)
    i = data.draw(st.integers(0, len(amounts) - 1))
    raised = list(amounts)
    raised[i] = data.draw(st.integers(amounts[i], 100))
    better, worse = (shares_over(KNOTS, each, chances) for each in (raised, amounts))
    assert (tail_sums(better - worse) >= -1e-12).all()


@pytest.mark.parametrize(
    ("knots", "amounts", "chances", "message"),
    [
        ([0], [0], [1], "at least two increasing amounts"),
        ([0, 0], [0], [1], "at least two increasing amounts"),
        ([0, 10], [11], [1], "11 lies outside the knots, 0 to 10"),
        ([0, 10], [1, 2], [1], "one probability an amount"),
        ([0, 10], [1, 2], [0.5, 0.4], "total 1"),
        ([0, 10], [1, 2], [1.5, -0.5], "at least 0"),
        ([0, 10], [float("nan")], [1], "outside"),
    ],
)
def test_what_is_no_lottery_is_refused(knots, amounts, chances, message):
    with pytest.raises(ValueError, match=message):
        shares_over(knots, amounts, chances)


def test_an_outcome_of_probability_zero_may_be_anywhere():
    assert shares_over([0, 10], [99, 5], [0, 1]).tolist() == [0.5, 0.5]


@given(st.sets(st.integers(0, 1000), min_size=2, max_size=60), st.data())
def test_knots_are_amounts_and_span_them(amounts, data):
    levels = data.draw(st.integers(2, len(amounts)))
    knots = knots_of(amounts, levels)
    assert len(set(knots)) == levels
    assert list(knots) == sorted(knots)
    assert set(knots) <= amounts
    assert (knots[0], knots[-1]) == (min(amounts), max(amounts))


def test_too_few_amounts_are_refused():
    with pytest.raises(ValueError, match="2 different amounts are too few for 3 levels"):
        knots_of([1, 2, 2], 3)
