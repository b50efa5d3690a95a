"""Cuts: questions made to close several differences at once, against what single questions
close.
"""

import numpy as np
import pytest

from elicit import Answers, PolytopeComparator
from elicit.asking.cuts import _SLACK, closing_cut
from elicit.lp.hit_and_run import Draws
from elicit.model.difference import tail_sums

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
    """How far the two answers leave the differences from the limit, in the mean, by other programs
    than the code's.
    """
    share, total = float((tail_sums(asked) @ known.draws.gaps < 0).mean()), 0.0
    for weight, y in ((share, -1), (1 - share, 1)):
        if weight > 0:
            high = known.update(Answers(asked[None], [y])).bounds(d)[1]
            total += weight * np.log2(np.maximum(high / LIMIT, 1.0)).sum()
    return total


@pytest.mark.parametrize("seed", range(3))
def test_a_cut_closes_at_least_as_much_as_the_differences_that_are_most_open(seed):
    known, d, high = nearly_proven(6, seed)
    assert len(d) > 3
    cut = closing_cut(known, known.draws, d, high, LIMIT)
    most = np.argsort(-high)[:4]
    weighed_to = len(d) * np.log2(1.0 + _SLACK)
    assert (
        halvings_left(known, cut.d, d)
        <= min(halvings_left(known, d[row], d) for row in most) + weighed_to
    )
    again = closing_cut(known, known.draws, d, high, LIMIT)
    np.testing.assert_array_equal(again.d, cut.d)


def test_some_cuts_are_of_their_own_and_set_two_mixtures_against_each_other():
    own = []
    for seed in range(8):
        known, d, high = nearly_proven(6, seed)
        if not len(d):
            continue
        cut = closing_cut(known, known.draws, d, high, LIMIT)
        if cut.row >= 0:
            np.testing.assert_array_equal(cut.d, d[cut.row])
        else:
            own.append(cut.d)
    assert own
    for asked in own:
        assert np.maximum(asked, 0.0).sum() == 1.0
        assert np.maximum(-asked, 0.0).sum() == 1.0


def test_a_cut_has_the_same_bits_where_draws_differ_by_rounding():
    own = 0
    for seed in range(8):
        known, d, high = nearly_proven(6, seed)
        if not len(d):
            continue
        cut, draws = closing_cut(known, known.draws, d, high, LIMIT), known.draws
        noise = 1.0 + 1e-15 * np.random.default_rng(seed).standard_normal(draws.gaps.shape)
        nearly = closing_cut(known, draws._replace(gaps=draws.gaps * noise), d, high, LIMIT)
        np.testing.assert_array_equal(nearly.d, cut.d)
        own += cut.row < 0
    assert own


def test_where_nothing_scatters_one_of_the_differences_is_asked_about():
    known, d, high = nearly_proven(5, 1)
    middle = known.draws.gaps.mean(axis=1)[:, None]
    one = Draws(middle, np.ones(1), np.full(1, np.inf))
    assert closing_cut(known, one, d, high, LIMIT).row >= 0
