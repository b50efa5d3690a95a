"""Magnified pairs: a power of two times the difference, between sides of the same total."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from elicit.asking.magnified import magnified, multiples
from elicit.asking.question import Pair
from tests.thoroughness import examples


@examples(200)
@given(st.integers(0, 10**6), st.integers(2, 8), st.floats(1e-6, 1.0))
def test_the_difference_is_the_greatest_power_of_two_times_what_it_was(seed, k, share):
    rng = np.random.default_rng(seed)
    both, one, other = rng.dirichlet(np.ones(k), 3)
    pair = Pair((1 - share) * both + share * one, (1 - share) * both + share * other, "which?")
    large = magnified(pair)
    before, after = pair.left - pair.right, large.left - large.right
    times = 2.0 ** np.round(np.log2(np.abs(after).sum() / np.abs(before).sum()))
    np.testing.assert_allclose(after, times * before, atol=1e-12)
    assert times >= 1
    for side in (large.left, large.right):
        assert (side >= -1e-12).all()
        assert abs(side.sum() - 1.0) <= 1e-9
    common = float(np.minimum(large.left, large.right).sum())
    # A further doubling would leave less than nothing in common, or enlarge rounding too much.
    assert common <= 0.5 + 1e-9 or times == 2.0**20
    assert times == multiples(pair.left[None, :], pair.right[None, :])[0]
    assert large[2:] == pair[2:]


def test_pairs_without_a_difference_or_without_room_stay_as_they_are():
    same, apart = np.array([0.5, 0.5]), (np.array([1.0, 0.0]), np.array([0.0, 1.0]))
    for sides in ((same, same), apart):
        assert magnified(Pair(*sides, "")) == Pair(*sides, "")


def test_rounding_changes_no_multiple():
    for share in (0.25, 0.25 + 1e-13, 0.25 - 1e-13):  # a quarter differs: there is room for 4 times
        left, right = np.array([1 - share, share, 0.0]), np.array([1 - share, 0.0, share])
        large = magnified(Pair(left, right, ""))
        np.testing.assert_allclose(large.left - large.right, [0.0, 1.0, -1.0], atol=1e-12)
        assert min(large.left.min(), large.right.min()) >= 0.0
    tiny = np.array([[1.0 - 1e-15, 1e-15]]), np.array([[1.0, 0.0]])
    assert multiples(*tiny) <= 2.0**20
