"""Cuts: questions made to close several differences at once, against what single questions
close.
"""

from functools import cache

import numpy as np
import pytest

from elicit import Answers, Panel, PolytopeComparator
from elicit.asking.cuts import closing_cut, closing_cut_of_one, cuts_towards
from elicit.lp.hit_and_run import Draws
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import quick_first, scaled

LIMIT = 1e-3


def nearly_proven(k, seed, n=30):
    """A polytope, and differences (n, k) of which a true scale has none above 0, and few draws have
    any.
    """
    rng = np.random.default_rng(seed)
    e = np.concatenate([[0.0], np.sort(rng.random(k - 2)), [1.0]])
    d = rng.dirichlet(np.ones(k), n) - rng.dirichlet(np.ones(k), n)
    d *= -np.sign(d @ e)[:, None]
    known = PolytopeComparator(k)
    while ((tail_sums(d) @ known.draws.gaps > LIMIT).any(axis=0)).mean() > 0.3:
        share = (tail_sums(d) @ known.draws.gaps > 0).mean(axis=1)
        row = int(np.argmin(np.abs(share - 0.5)))
        known = known.update(Answers(d[row : row + 1], [-1]))
    high = known.simultaneous_bounds(d)[0]
    return known, d[high > LIMIT], high[high > LIMIT]


def halvings_left(known, asked, d):
    """Return how far the two answers leave the differences from the limit, in the mean.

    It is computed by other programs than the code's.
    """
    share, total = float((tail_sums(asked) @ known.draws.gaps < 0).mean()), 0.0
    for weight, y in ((share, -1), (1 - share, 1)):
        if weight > 0:
            high = known.update(Answers(asked[None], [y])).bounds(d)[1]
            total += weight * np.log2(np.maximum(high / LIMIT, 1.0)).sum()
    return total


@pytest.mark.parametrize("seed", quick_first(range(3), 2))
def test_a_cut_closes_twice_what_the_question_in_its_place_would_or_is_not_asked(seed):
    known, d, high = nearly_proven(6, seed)
    instead = d[np.argmax(high)]
    now = np.log2(np.maximum(high / LIMIT, 1.0)).sum()
    cut = closing_cut(known, known.draws, d, high, LIMIT, instead)
    weighed_to = 1e-6 * len(d)  # bounds that are not proven to the last bit
    own = now - halvings_left(known, instead, d)
    if cut is None:
        others = cuts_towards(known.draws, d, high, LIMIT)
        promised = [now - halvings_left(known, other, d) for other in others]
        assert max(promised, default=0.0) <= 2 * own + weighed_to
    else:
        assert now - halvings_left(known, cut, d) >= 2 * own - weighed_to
        again = closing_cut(known, known.draws, d, high, LIMIT, instead)
        np.testing.assert_array_equal(again, cut)


@cache
def asked_cuts():
    """Return cuts that beat a question that tells nothing, with what they were made of."""
    found = []
    for seed in range(scaled(4, 8)):
        known, d, high = nearly_proven(6, seed)
        if len(d):
            nothing = np.eye(6)[5] - np.eye(6)[0]  # the best level against the worst
            cut = closing_cut(known, known.draws, d, high, LIMIT, nothing)
            assert cut is not None
            found.append((known, d, high, nothing, cut))
    return found


def test_a_cut_sets_two_mixtures_against_each_other():
    found = [cut for *_, cut in asked_cuts()]
    assert len(found) > scaled(1, 3)
    for asked in found:
        assert np.maximum(asked, 0.0).sum() == 1.0
        assert np.maximum(-asked, 0.0).sum() == 1.0


def test_a_cut_has_the_same_bits_where_draws_differ_by_rounding():
    for seed, (known, d, high, nothing, cut) in enumerate(asked_cuts()):
        draws = known.draws
        noise = 1.0 + 1e-15 * np.random.default_rng(seed).standard_normal(draws.gaps.shape)
        gaps = draws.gaps * noise
        nearly = closing_cut(known, draws._replace(gaps=gaps), d, high, LIMIT, nothing)
        np.testing.assert_array_equal(nearly, cut)


def test_where_nothing_scatters_there_is_no_cut():
    known, d, high = nearly_proven(5, 1)
    middle = known.draws.gaps.mean(axis=1)[:, None]
    one = Draws(middle, np.ones(1), np.full(1, np.inf))
    assert closing_cut(known, one, d, high, LIMIT, d[0]) is None


def test_a_direction_is_cut_once_and_another_one_beside_it():
    draws = PolytopeComparator(5).draws
    one, other = np.array([[0.0, 1, -1, 1, -1], [0.5, -1, 0, -0.5, 1]])
    high = LIMIT * np.array([8.0, 4, 2])
    found = cuts_towards(draws, np.array([one, 1.5 * one, other]), high, LIMIT)
    assert len(found) == 3 * (2 + 3)  # of two directions, and of three middles of what is near
    worth = tail_sums(np.array([one, other, *found])) @ draws.gaps
    alike = np.corrcoef(worth)[:2, 2:]
    assert (alike > 1 - 1e-9).sum(axis=1).min() >= 3


def test_where_nothing_is_open_nobody_of_several_is_asked_a_cut():
    panel = Panel({name: PolytopeComparator(4) for name in ("ann", "ben")})
    d = np.array([[0.0, 1, -1, 0], [-0.5, 1, 0, -0.5]])
    assert closing_cut_of_one(panel, d, np.full(2, LIMIT), LIMIT) is None
    assert closing_cut_of_one(panel, d, np.array([1.0, 0.5]), LIMIT) is not None
