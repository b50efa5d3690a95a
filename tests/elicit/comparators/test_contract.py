"""Promises of every comparator that learns, by the conformance tests of elicit, and its tiers."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from elicit import (
    Answers,
    BradleyTerryComparator,
    Comparator,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    Tier,
    TruthfulTutor,
    Verdict,
    decide,
)
from elicit.model.comparator import BY_ANSWERS
from elicit.testing import check_comparator
from tests.noisy_cases import pairs
from tests.thoroughness import OLDER

BOOTSTRAP = partial(BradleyTerryComparator, precision=20.0, n_boot=30, region="ensemble")
MADE: dict[str, Callable[[int], Comparator]] = {
    "polytope": PolytopeComparator,
    "polytope, margin 0, prior": lambda k: PolytopeComparator(k, margin=0.0, prior=["e2 >= 0.1"]),
    "polytope, one wrong": partial(PolytopeComparator, wrong=1),
    "posterior": partial(PosteriorComparator, particles=200),
    "ensemble": BOOTSTRAP,
    "ensemble, rescaled": partial(BOOTSTRAP, rescale=True),
    "box": partial(BOOTSTRAP, region="box"),
    "box, rescaled": partial(BOOTSTRAP, region="box", rescale=True),
}


def told(name: str, k: int, n: int) -> Comparator:
    values, d = (
        np.linspace(0.0, 1.0, k) ** 2,
        pairs(np.random.default_rng([k, n]), k, n if k > 2 else 0),
    )
    tutor = (
        TruthfulTutor(values) if name.startswith("polytope") else FlippingTutor(values, 0.1, seed=1)
    )
    return MADE[name](k).update(Answers(d, tutor.signs(d)))


@pytest.mark.parametrize(
    ("name", "k", "n"),
    [
        pytest.param(name, k, n, marks=[pytest.mark.slow] if n > most or (OLDER and k > 3) else [])
        for name in MADE
        for most in [12 if OLDER or "," in name else 40]  # variants
        for k, n in ((2, 0), (3, 12), (5, 0), (5, 40), (9, 60))
    ],
)
def test_it_keeps_the_contract(name: str, k: int, n: int) -> None:
    check_comparator(told(name, k, n))


@pytest.mark.parametrize("n", [0, 40])
@pytest.mark.parametrize("name", MADE)
def test_equality_and_dominance_come_first(name: str, n: int) -> None:
    d = np.array(
        [
            [0, 0, 0, 0, 0],
            [7, 0, 0, 0, 0],
            [-1, 0, 0, 0, 1],
            [-0.5, 0.5, 0, 0, 0],
            [0, 0, 0, 0.5, -0.5],
        ]
    )
    comparator = told(name, 5, n)
    verdicts, tiers = decide(
        comparator, np.concatenate([d, pairs(np.random.default_rng(0), 5, 50)])
    )
    assert verdicts[:5].tolist() == [
        Verdict.EQUAL,
        Verdict.EQUAL,
        Verdict.BETTER,
        Verdict.BETTER,
        Verdict.WORSE,
    ]
    assert tiers[:5].tolist() == [Tier.EQUAL] * 2 + [Tier.DOMINANCE] * 3
    assert set(tiers[5:]) <= set(BY_ANSWERS)
    if isinstance(comparator, (BradleyTerryComparator, PosteriorComparator)):
        assert set(tiers[5:]) == {Tier.MODEL}
