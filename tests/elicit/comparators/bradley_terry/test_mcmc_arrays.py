"""Particles moved beside each other and one by one: the same, to the last bit."""

from typing import Any

import numpy as np
import pytest

from elicit import PosteriorComparator
from elicit._support.hashing import fold
from elicit.comparators.bradley_terry import mcmc, mcmc_arrays
from elicit.model.difference import tail_sums

TUTORS: list[dict[str, Any]] = [
    {},
    {"lapse": 0.0},
    {"lapse": 0.05, "precision": 30.0},
    {"prior": ["e2 >= 0.1"]},
]


@pytest.mark.parametrize("last", [1.0, 0.37])
@pytest.mark.parametrize("tie", [0.0, 0.05])
@pytest.mark.parametrize(
    ("k", "particles", "rows", "size"),
    [(2, 60, 9, 1.0), (5, 50, 64, 9.0), (6, 500, 130, 1.0), (9, 70, 40, 99.0)],
)
@pytest.mark.parametrize("tutor", range(len(TUTORS)))
def test_the_same_moves(
    tutor: int, k: int, particles: int, rows: int, size: float, tie: float, last: float
) -> None:
    if k == 2 and "prior" in TUTORS[tutor]:
        return
    rng = np.random.default_rng([tutor, k, particles])
    comparator = PosteriorComparator(k, particles=particles, seed=tutor, **TUTORS[tutor])
    if tie:
        comparator._start(tie)
    d = np.diff(rng.dirichlet(np.ones(k), size=rows + 1), axis=0)
    answers, tied = np.ascontiguousarray(size * tail_sums(d).T), rng.random(rows) < 0.2
    one, other = comparator._x.copy(), comparator._x.copy()
    settings = (answers, tied, rows, last, comparator._prior, fold(tutor, k)[()], 3)
    with np.errstate(all="ignore"):
        accepted = mcmc.move(one, *settings), mcmc_arrays.move(other, *settings)
    assert accepted[0] == accepted[1] > 0
    assert (one != comparator._x).any()
    assert one.tobytes() == other.tobytes()
