"""Random MDPs and hidden values have the stated law."""

from math import ceil, log2
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from qlearn import draw_values, random_mdp
from tests.thoroughness import examples


@examples(100)
@given(
    n=st.integers(1, 70),
    m=st.integers(1, 5),
    k=st.integers(2, 100),
    seed=st.integers(0, 2**64),
    weights=st.sampled_from(["dirichlet", "gaussian"]),
)
def test_random_mdp_invariants(n: int, m: int, k: int, seed: int, weights: Any) -> None:
    mdp, values = random_mdp(n, m, k, rng=seed, weights=weights)
    assert mdp.successors.shape == mdp.probabilities.shape == (n, m, max(1, ceil(log2(n))))
    assert (np.diff(mdp.successors, axis=2) > 0).all()  # distinct
    np.testing.assert_allclose(mdp.probabilities.sum(axis=2), 1, atol=1e-12)
    assert (mdp.probabilities > 0).all()
    assert (mdp.levels.shape, mdp.k, len(mdp.labels), mdp.discount) == ((n, m), k, k, 0.95)
    assert not mdp.terminal.any()
    assert mdp.admissible.all()
    assert values.shape == (k,)
    assert (np.diff(values) >= 1).all()
    assert set(values) <= set(range(100))


@pytest.mark.parametrize(
    ("n", "b"), [(1, 1), (2, 1), (3, 2), (4, 2), (5, 3), (100, 7), (128, 7), (129, 8), (500, 9)]
)
def test_branching_is_the_ceiling_of_log2(n: int, b: int) -> None:
    assert random_mdp(n, 2, 5, rng=0)[0].successors.shape == (n, 2, b)


def test_the_seed_decides() -> None:
    (one, a), (two, b), (three, _) = (random_mdp(20, 3, 5, rng=seed) for seed in (7, 7, 8))
    assert one.fingerprint == two.fingerprint
    assert one.fingerprint != three.fingerprint
    np.testing.assert_array_equal(a, b)
    generator = np.random.default_rng(3)
    first, second = (random_mdp(20, 3, 5, rng=generator)[0].fingerprint for _ in range(2))
    assert first != second
    assert random_mdp(20, 3, 5, rng=np.random.SeedSequence(7))[0].fingerprint == one.fingerprint
    with pytest.raises(TypeError, match="seed"):
        random_mdp(20, 3, 5, rng=-7)


def test_a_series_over_k_keeps_its_transitions() -> None:
    five, twenty = (random_mdp(30, 3, k, rng=11)[0] for k in (5, 20))
    np.testing.assert_array_equal(five.transitions.toarray(), twenty.transitions.toarray())


def test_successors_are_uniform() -> None:
    mdp, _ = random_mdp(8, 4000, 2, rng=5)  # 3 of 8 states, 32000 times
    # each of the 56 sets equally often
    codes = (1 << mdp.successors.reshape(-1, 3).astype(np.int64)).sum(axis=1)
    _, counts = np.unique(codes, return_counts=True)
    assert counts.size == 56
    assert stats.chisquare(counts).pvalue > 1e-4


def test_probabilities_are_dirichlet() -> None:
    p = random_mdp(8, 2000, 2, rng=6)[0].probabilities
    # a component of Dirichlet(1, 1, 1) is Beta(1, 2)
    assert stats.kstest(p[:, :, 0].ravel(), stats.beta(1, 2).cdf).pvalue > 1e-4
    assert stats.kstest(p[:, :, 2].ravel(), stats.beta(1, 2).cdf).pvalue > 1e-4


def test_gaussian_weights_are_more_even_than_dirichlet() -> None:
    spread = [
        random_mdp(64, 50, 2, rng=6, weights=w)[0].probabilities.std()
        for w in ("gaussian", "dirichlet")
    ]
    half = np.abs(np.random.default_rng(0).standard_normal((3200, 6)))
    assert spread[0] == pytest.approx((half / half.sum(axis=1, keepdims=True)).std(), rel=0.05)
    assert spread[0] < 0.9 * spread[1]


def test_levels_and_values_are_uniform() -> None:
    counts = np.bincount(random_mdp(500, 40, 10, rng=1)[0].levels.ravel(), minlength=10)
    assert stats.chisquare(counts).pvalue > 1e-4
    drawn = np.concatenate([draw_values(10, seed) for seed in range(1000)]).astype(int)
    assert stats.chisquare(np.bincount(drawn, minlength=100)).pvalue > 1e-4


def test_draw_values_limits() -> None:
    np.testing.assert_array_equal(draw_values(100, 0), np.arange(100.0))
    for k in (1, 101, 2.5, True):
        with pytest.raises(ValueError, match="from 2 to 100"):
            draw_values(k, 0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("args", "keywords", "message"),
    [
        ((0, 2, 5), {}, "n_states must be a whole number from 1"),
        ((2.5, 2, 5), {}, "n_states .* not 2.5"),
        ((5, 0, 5), {}, "n_actions"),
        ((5, 2, 1), {}, "n_levels must be a whole number from 2 to 100, not 1"),
        ((5, 2, 101), {}, "not 101"),
        ((5, 2, 5, 1.0), {}, "discount"),
        ((5, 2, 5), {"weights": "uniform"}, "weights"),
    ],
)
def test_random_mdp_refuses(args: Any, keywords: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        random_mdp(*args, rng=0, **keywords)
