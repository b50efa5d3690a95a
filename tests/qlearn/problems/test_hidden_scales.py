"""Hidden scales have the stated law, and are the same for the same seed."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from elicit import PolytopeComparator, TruthfulTutor
from qlearn import InteractivePolicyIteration, drive, hidden_scales, random_mdp
from qlearn.problems.hidden_scales import KINDS
from tests import older_processor
from tests.interpreter import run
from tests.thoroughness import examples


@examples(100)
@given(kind=st.sampled_from(KINDS), k=st.integers(2, 100), seed=st.integers(0, 2**64))
def test_values_increase_from_0_to_1(kind: str, k: int, seed: int) -> None:
    values = hidden_scales(kind, k, seed)
    assert values.shape == (k,)
    assert (values[0], values[-1]) == (0, 1)
    gaps = np.diff(values)
    assert gaps.min() > 9e-6  # above a polytope's margin
    if kind == "equal":
        np.testing.assert_allclose(values, np.linspace(0, 1, k), atol=1e-12)
    if kind == "convex":
        assert (np.diff(gaps) >= -2e-12).all()
    if kind == "concave":
        assert (np.diff(gaps) <= 2e-12).all()
    np.testing.assert_array_equal(values, hidden_scales(kind, k, seed=seed))


@pytest.mark.parametrize(("kind", "alpha"), [("even", 1.0), ("skewed", 0.3)])
def test_gaps_are_dirichlet(kind: str, alpha: float) -> None:
    gaps = np.array([np.diff(hidden_scales(kind, 5, seed)) for seed in range(400)])
    for column in gaps.T:  # a component of a symmetric Dirichlet is a beta
        assert stats.kstest(column, stats.beta(alpha, 3 * alpha).cdf).pvalue > 1e-3


def test_bent_scales_are_powers_between_their_limits_and_mirror_each_other() -> None:
    convex, concave = (
        np.array([hidden_scales(kind, 3, seed)[1] for seed in range(400)]) for kind in KINDS[3:]
    )
    powers = [-np.log2(convex), -np.log2(1 - concave)]
    for drawn in powers:
        assert drawn.min() >= 1.499
        assert drawn.max() <= 5.001
        log = np.log(drawn / 1.5) / np.log(5 / 1.5)
        assert stats.kstest(log, "uniform").pvalue > 1e-3


def test_kinds_and_seeds_differ() -> None:
    drawn = {tuple(hidden_scales(kind, 6, seed)) for kind in KINDS[1:] for seed in range(5)}
    assert len(drawn) == 5 * (len(KINDS) - 1)
    assert tuple(hidden_scales("even", 6)) != tuple(hidden_scales("even", 6, None))
    np.testing.assert_array_equal(hidden_scales("equal", 6, 1), hidden_scales("equal", 6))


def test_an_older_processor_draws_the_same() -> None:
    code = (
        "from qlearn import hidden_scales\n"
        "from qlearn.problems.hidden_scales import KINDS\n"
        "print([hidden_scales(kind, 9, s).tolist() for kind in KINDS for s in range(5)])"
    )
    here = [hidden_scales(kind, 9, s).tolist() for kind in KINDS for s in range(5)]
    assert run(code, **older_processor.environment()) == [str(here)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_polytope_can_learn_every_kind(kind: str) -> None:
    mdp, _ = random_mdp(8, 2, 6, seed=1)
    tutor = TruthfulTutor(hidden_scales(kind, 6, seed=2))
    learner = InteractivePolicyIteration(mdp, PolytopeComparator(6), tolerance=0.01)
    assert drive(learner, tutor).loss_bound <= 0.01


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("flat", 5, 0), r"kind must be one of equal, even, skewed, convex, concave, not 'flat'"),
        ((None, 5, 0), "kind must be one of"),
        (("even", 1, 0), "k must be the number of levels, a whole number from 2 to 100, not 1"),
        (("even", 101, 0), "not 101"),
        (("even", 2.5, 0), "not 2.5"),
        (("even", "5", 0), "not '5'"),
    ],
)
def test_what_cannot_be_is_refused(arguments: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        hidden_scales(*arguments)


def test_a_seed_that_is_none_is_refused() -> None:
    for seed in (-1, "a", 1.5):
        with pytest.raises(TypeError, match="seed"):
            hidden_scales("even", 5, seed)  # type: ignore[arg-type]
