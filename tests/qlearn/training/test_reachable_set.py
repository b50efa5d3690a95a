"""Corners are those of the polytope: what linear programs over the same inequalities find."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from qlearn.training import reachable_set
from qlearn.training.reachable_set import ReachableSet, as_shares
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import examples


def greatest(t, facets, limits):
    found = linprog(-t, A_ub=facets, b_ub=limits, bounds=(None, None), method="highs")
    assert found.status == 0
    return -found.fun


@examples(40)
@given(k=st.integers(2, 6), cuts=st.integers(0, 7), seed=st.integers(0, 10**6), box=st.booleans())
def test_the_greatest_over_the_corners_is_that_of_a_linear_program(k, cuts, seed, box):
    rng = np.random.default_rng(seed)
    reach = ReachableSet.box(-np.ones(k - 1), rng.random(k - 1)) if box else ReachableSet.shares(k)
    seen = reach.corners.mean(axis=0)  # stays within reach
    facets, limits = reach.facets, reach.limits
    for _ in range(cuts):
        gaps = rng.dirichlet(np.ones(k - 1))
        limit = seen @ gaps + rng.choice([0.0, 0.05]) * rng.random()
        reach = reach.cut(gaps, limit)
        facets, limits = np.vstack([facets, gaps]), np.append(limits, limit)
    ways = rng.standard_normal((10, k - 1))
    for way in ways:
        assert (reach.corners @ way).max() == pytest.approx(greatest(way, facets, limits), abs=1e-7)
    assert (reach.corners @ facets.T <= limits + 1e-8).all()
    assert tail_sums(reach.vectors) == pytest.approx(reach.corners, abs=1e-12)
    assert reach.vectors.sum(axis=1) == pytest.approx(1.0)


def test_a_cut_that_takes_nothing_away_or_everything_changes_nothing():
    reach = ReachableSet.shares(4)
    gaps = np.array([0.2, 0.3, 0.5])
    assert reach.cut(gaps, 1.0) is reach
    assert (
        reach.cut(gaps, -0.1) is reach
    )  # no policy could be there: an error of the trainer's, not a bound


def test_a_cut_that_would_leave_too_many_corners_is_left_out(monkeypatch):
    monkeypatch.setattr(reachable_set, "MOST_CORNERS", 5)
    reach = ReachableSet.shares(4)
    left = reach.cut(np.array([0.2, 0.3, 0.5]), 0.4)
    assert left.corners is reach.corners
    assert left.full
    assert not reach.full


def test_of_too_many_cuts_the_first_are_left_out(monkeypatch):
    rng, k = np.random.default_rng(0), 6
    seen = ReachableSet.shares(k).corners.mean(axis=0)
    cuts = [(gaps, float(seen @ gaps) + 0.01) for gaps in rng.dirichlet(np.ones(k - 1), 12)]
    whole = ReachableSet.shares(k).cut_by(cuts)
    assert not whole.full
    assert len(whole.corners) > 60
    monkeypatch.setattr(reachable_set, "MOST_CORNERS", 60)
    part = ReachableSet.shares(k).cut_by(cuts)
    assert part.full
    assert len(part.corners) <= 60
    gaps, limit = cuts[-1]
    assert part.greatest(gaps[:, None])[0] <= limit + 1e-9
    ways = rng.dirichlet(np.ones(k - 1), 50).T
    assert (part.greatest(ways) >= whole.greatest(ways) - 1e-9).all()  # larger, so bounds hold


def test_what_is_no_share_vector_is_refused():
    assert as_shares([0.25, 0.25], 2)[0] == pytest.approx([0.5, 0.5])
    assert as_shares([0.25, 0.25], 2)[1] == pytest.approx(0.5)
    for wrong in ([0.7, 0.4], [0.0, 0.0], [1.0, 0.0, 0.0]):
        with pytest.raises(ValueError, match="shares"):
            as_shares(wrong, 2)
    with pytest.raises(ValueError, match="each low below its high"):
        ReachableSet.box([0.0, 1.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="at most 14"):
        ReachableSet.box(np.zeros(15), np.ones(15))
