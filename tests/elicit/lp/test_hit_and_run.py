"""Draws from K_t, where it has room and where it has none."""

import numpy as np

from elicit import PolytopeComparator
from tests.lp_cases import equalities
from tests.scale_arithmetic import Floats

VALUES = np.array([0.0, 0.2, 0.4, 0.8, 1.0])


def lottery(level: int, values: Floats = VALUES) -> Floats:
    """A level against the mixture of the best and the worst that is worth as much."""
    d = np.eye(5)[level]
    d[4] -= values[level]
    d[0] -= 1.0 - values[level]
    return d


def pinned(*levels: int) -> PolytopeComparator:
    """Return the comparator whose prior calls each of these levels equal to its lottery."""
    return PolytopeComparator(5, prior=equalities([lottery(level) for level in levels]))


def test_draws_of_a_single_scale_are_that_scale() -> None:
    known = pinned(1, 2, 3)
    gaps, weights, _ = known.draws
    np.testing.assert_allclose(
        gaps, np.repeat(np.diff(VALUES)[:, None], gaps.shape[1], axis=1), atol=1e-9
    )
    assert np.isclose(weights.sum(), 1.0)


def test_draws_stay_within_a_flat_region() -> None:
    gaps = pinned(1).draws.gaps
    np.testing.assert_allclose(gaps[0], 0.2, atol=1e-9)
    np.testing.assert_allclose(gaps.sum(axis=0), 1.0, atol=1e-9)
    assert (gaps > 0).all()


def test_draws_of_an_open_region_differ() -> None:
    gaps = PolytopeComparator(5).draws.gaps
    assert gaps.std(axis=1).min() > 0.05
    assert (gaps > 0).all()
