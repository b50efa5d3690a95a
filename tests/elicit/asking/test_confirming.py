"""The question that leaves least open where answers may be wrong, by other sums than the code's."""

import numpy as np
import pytest

from elicit import Answers, InconsistentAnswers, PolytopeComparator, simultaneous_bounds
from elicit.asking.confirming import confirming_question
from elicit.model.comparator import WRONG_ODDS
from tests.scale_arithmetic import tail_sums

LIMIT = 0.01


def halvings(scales, d):
    """By how many halvings the bounds of these scales on d (n, k) exceed the limit."""
    return np.log2(np.maximum(simultaneous_bounds(scales, d)[0] / LIMIT, 1.0)).sum()


def left_open(known, asked, d):
    """The expected logarithm of what the answers to ``asked`` (k,) leave open in all cells."""
    chance, left = 0.0, {1: 1.0, -1: 1.0}
    for cell in known.cells:
        more = known.wrong - len(cell.wrong)
        gaps, weights, _ = cell.scales.draws
        better = ((tail_sums(asked) @ gaps) > 0) @ weights
        if more:
            better = (better + WRONG_ODDS * (1 - better)) / (1 + WRONG_ODDS)
        chance += cell.weight * better
        for y in left:
            try:
                open_still = halvings(cell.scales.update(Answers(asked[None], [y])), d)
            except InconsistentAnswers:
                open_still = 0.0
            left[y] += 6.0**more * open_still
            if more:  # the answer may be the wrong one
                left[-y] += 6.0 ** (more - 1) * open_still
    return chance * np.log2(left[1]) + (1 - chance) * np.log2(left[-1])


@pytest.mark.parametrize("seed", [0, 5, 9])
def test_the_question_leaves_no_more_open_than_the_differences_and_the_old_ones(seed):
    rng = np.random.default_rng(seed)
    scale = np.array([0, *np.sort(rng.random(2)), 1])
    d = rng.dirichlet(np.ones(4), 9) - rng.dirichlet(np.ones(4), 9)
    d *= -np.sign(d @ scale)[:, None]
    known = PolytopeComparator(4, wrong=1).update(Answers(d[:5], [-1] * 5))
    assert len(known.cells) > 1
    asked = confirming_question(known, d[5:], LIMIT)
    found = left_open(known, asked.d, d[5:])
    high = simultaneous_bounds(known, d[5:])[0]
    others = [left_open(known, one, d[5:]) for one in d[5:][high > LIMIT]]
    unsure = d[:5][known.compare(d[:5]) == 2]
    others += [left_open(known, one, d[5:]) for one in unsure]
    assert found <= min(others) + 1e-3
