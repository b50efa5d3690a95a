"""Particles moved beside each other and one by one: the same, to the last bit."""

from typing import Any

import numpy as np
import pytest

from elicit import PosteriorComparator
from elicit._support.hashing import fold
from elicit.comparators.bradley_terry import mcmc, mcmc_arrays
from elicit.comparators.bradley_terry.earlier_people import EarlierPeople, Kind
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import covering

TUTORS: list[dict[str, Any]] = [
    {},
    {"lapse": 0.0},
    {"lapse": 0.05, "precision": 30.0},
    {"prior": ["e2 >= 0.1"]},
    {"like": 2},
]


@pytest.mark.parametrize(
    ("tutor", "sizes", "tie", "last"),
    covering(
        range(len(TUTORS)),
        [(2, 60, 9, 1.0), (5, 50, 64, 9.0), (6, 500, 130, 1.0), (9, 70, 40, 99.0)],
        [0.0, 0.05],
        [1.0, 0.37],
    ),
)
def test_the_same_moves(
    tutor: int, sizes: tuple[int, int, int, float], tie: float, last: float
) -> None:
    k, particles, rows, size = sizes
    if k == 2 and "prior" in TUTORS[tutor]:
        return
    rng = np.random.default_rng([tutor, k, particles])
    settings = dict(TUTORS[tutor])
    if "like" in settings:
        kind = Kind(0.5, tuple(0.3 + 0.7 * rng.random(k - 1)), 2.5, 0.6, 1.5, 9.0)
        other = kind._replace(log_precision=5.0, lapse_b=30.0)
        settings["like"] = EarlierPeople(9, 90, (kind, other))
    comparator = PosteriorComparator(k, particles=particles, seed=tutor, **settings)
    if tie:
        comparator._start(tie)
    d = np.diff(rng.dirichlet(np.ones(k), size=rows + 1), axis=0)
    answers, tied = np.ascontiguousarray(size * tail_sums(d).T), rng.random(rows) < 0.2
    one, other = comparator._x.copy(), comparator._x.copy()
    arguments = (answers, tied, rows, last, comparator._prior, fold(tutor, k)[()], 3)
    with np.errstate(all="ignore"):
        accepted = mcmc.move(one, *arguments), mcmc_arrays.move(other, *arguments)
    assert accepted[0] == accepted[1] > 0
    assert (one != comparator._x).any()
    assert one.tobytes() == other.tobytes()
