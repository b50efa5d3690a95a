"""Ranges of levels as they are shown: how often they hold, and which draws they come from."""

import numpy as np
import pytest

from elicit import Answer, Answers, PolytopeComparator, PosteriorComparator, Verdict, value_bounds
from elicit.person.course.level_questions import level_question
from elicit.person.course.ranges import draws_again, value_ranges
from tests.thoroughness import scaled


def asked(knows: PosteriorComparator, values: np.ndarray, n: int) -> PosteriorComparator:
    """Ask n questions about levels of somebody who calls differences of up to 3 of 100 equal."""
    seen = set[str]()
    for _ in range(n):
        query = level_question(knows, 10, lambda query: query.id in seen)
        assert query is not None
        seen.add(query.id)
        apart = float(query.d @ values)
        verdict = Verdict(0 if abs(apart) <= 0.03 else int(np.sign(apart)))
        knows = knows.update(Answers.of([Answer(query, verdict)], knows.k))
    return knows


def test_a_range_as_a_whole_has_the_stated_probability() -> None:
    """Bounds leave out 5% at each end, so that only 90% lie between them."""
    knows = asked(PosteriorComparator(4, particles=300), np.array([0, 0.2, 0.7, 1.0]), 4)
    gaps, weights, _ = knows.draws
    values, inside = np.cumsum(gaps, axis=0)[:-1], []
    for low, high in (value_bounds(knows), value_ranges(knows)):
        within = (values >= low[1:-1, None]) & (values <= high[1:-1, None])
        inside.append(within @ weights)
    assert (inside[0] < 0.93).all()
    assert (inside[1] >= 0.95 - 1e-9).all()
    assert (inside[1] < 0.98).all()


def test_ranges_are_those_of_the_posterior_learned_several_times() -> None:
    knows = asked(PosteriorComparator(4, particles=200), np.array([0, 0.2, 0.7, 1.0]), 3)
    again = draws_again(knows)
    assert again is not None
    assert again.gaps.shape == (3, 800)
    assert again.weights.sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(again.gaps[:, :200], knows.draws.gaps)
    assert not np.array_equal(again.gaps[:, 200:400], again.gaps[:, 400:600])
    low, high = value_ranges(knows, again)
    least, most = value_bounds(knows)
    assert (low <= least).all()
    assert (high >= most).all()
    above = PosteriorComparator(4, prior="e2 >= 0.6*e4", particles=50)
    within = draws_again(above)
    assert within is not None
    assert (within.gaps[0] >= 0.6 - 1e-9).all()  # all settings are the comparator's own
    polytope = PolytopeComparator(4)
    assert draws_again(polytope) is None
    np.testing.assert_array_equal(value_ranges(polytope), value_bounds(polytope))


@pytest.mark.parametrize("law", ["uniform", "few large steps"])
def test_values_of_simulated_people_lie_in_the_ranges_as_often_as_is_said(law: str) -> None:
    people, held = scaled(4, 100), []
    for number in range(people):
        rng = np.random.default_rng([number, 5])
        a = 1.0 if law == "uniform" else float(np.exp(rng.uniform(np.log(0.2), np.log(2.0)))) / 3
        gaps = np.maximum(rng.dirichlet(np.full(3, a)), 1e-9)
        values = np.r_[0.0, np.cumsum(gaps) / gaps.sum()]
        knows = asked(PosteriorComparator(4, particles=200, seed=number), values, 6)
        low, high = value_ranges(knows, draws_again(knows))
        held += ((values >= low - 0.005) & (values <= high + 0.005))[1:-1].tolist()
    assert np.mean(held) >= 0.95
