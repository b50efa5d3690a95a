"""Random MDPs have the stated law; ICU-Sepsis is the published benchmark."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import distribution
from importlib.util import find_spec
from math import ceil, log, log2
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import absorption_probability, best_absorption_probability, evaluate_policy, value_iteration
from qlearn.problems.random_mdp import draw_values, icu_expert_policy, icu_sepsis, random_mdp

# --- random MDPs -----------------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(
    n=st.integers(1, 70),
    m=st.integers(1, 5),
    k=st.integers(2, 100),
    seed=st.integers(0, 2**64),
    branching=st.sampled_from(["log2", "log"]),
    weights=st.sampled_from(["dirichlet", "gaussian"]),
)
def test_random_mdp_invariants(n: int, m: int, k: int, seed: int, branching: Any, weights: Any) -> None:
    mdp, values = random_mdp(n, m, k, rng=seed, branching=branching, weights=weights)
    b = max(1, ceil(log2(n))) if branching == "log2" else ceil(log(1 + n))
    assert mdp.successors.shape == mdp.probabilities.shape == (n, m, b)
    assert (np.diff(mdp.successors, axis=2) > 0).all()  # distinct
    np.testing.assert_allclose(mdp.probabilities.sum(axis=2), 1, atol=1e-12)
    assert (mdp.probabilities > 0).all()
    assert mdp.levels.shape == (n, m)
    assert mdp.k == k == len(mdp.labels)
    assert mdp.discount == 0.95
    assert not mdp.terminal.any()
    assert mdp.admissible.all()
    assert values.shape == (k,)
    assert (np.diff(values) >= 1).all()
    assert values[0] >= 0
    assert values[-1] <= 99
    assert (values == np.floor(values)).all()


@pytest.mark.parametrize(("n", "b"), [(1, 1), (2, 1), (3, 2), (4, 2), (5, 3), (100, 7), (128, 7), (129, 8), (500, 9)])
def test_branching_is_the_ceiling_of_log2(n: int, b: int) -> None:
    assert random_mdp(n, 2, 5, rng=0)[0].successors.shape == (n, 2, b)


def test_one_state_loops() -> None:
    mdp, _ = random_mdp(1, 3, 4, rng=1)
    np.testing.assert_array_equal(mdp.transitions.toarray(), np.ones((3, 1)))


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
        random_mdp(20, 3, 5, rng=None)  # type: ignore[arg-type]


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
    spread = [random_mdp(64, 50, 2, rng=6, weights=w)[0].probabilities.std() for w in ("gaussian", "dirichlet")]
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
        ((5, 2, 5), {"branching": "ln"}, "branching"),
        ((5, 2, 5), {"weights": "uniform"}, "weights"),
    ],
)
def test_random_mdp_refuses(args: Any, keywords: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        random_mdp(*args, rng=0, **keywords)


# --- ICU-Sepsis ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def icu() -> OrdinalMDP:
    if find_spec("icu_sepsis") is None:
        pytest.skip("needs icu-sepsis: pip install 'elicit-qlearn[icu]'")
    return icu_sepsis()


def uniform_policy(mdp: OrdinalMDP) -> Floats:
    policy: Floats = mdp.admissible / mdp.admissible.sum(axis=1, keepdims=True)
    return policy


def test_icu_shape(icu: OrdinalMDP) -> None:
    assert (icu.n_states, icu.n_actions, icu.k) == (715, 25, 6)
    assert icu.labels == ("died", "critical", "severe", "moderate", "mild", "recovered")
    assert icu.discount == 0.99
    np.testing.assert_array_equal(np.flatnonzero(icu.terminal), [713, 714])
    np.testing.assert_array_equal(icu.final_level[713:], [0, 5])
    np.testing.assert_allclose(icu.initial.sum(), 1, atol=1e-12)
    assert icu.admissible[:713].sum(axis=1).mean() == pytest.approx(3.139, abs=1e-3)
    assert icu.successors.shape[2] == 189  # the most of an admissible action


def test_icu_rows_are_the_package_tables(icu: OrdinalMDP) -> None:
    path = distribution("icu-sepsis").locate_file("icu_sepsis/envs/assets/dynamics.npz")
    with np.load(str(path), allow_pickle=False) as data:
        table = data["tx_mat"]
    mine = icu.transitions.toarray().reshape(715, 25, 715)
    read = icu.admissible[:713]
    np.testing.assert_allclose(mine[:713][read], table[:713, :, :715][read], rtol=0, atol=1e-12)
    assert not mine[:713][~read].any()
    # the package's way with an inadmissible action is the mean of the admissible ones
    for s in (0, 1, 356, 712):
        mean = mine[s][icu.admissible[s]].mean(axis=0)
        for a in np.flatnonzero(~icu.admissible[s]):
            np.testing.assert_allclose(table[s, a, :715], mean, atol=1e-12)


def test_icu_levels_are_quarters_of_the_states_and_order_them_by_severity(icu: OrdinalMDP) -> None:
    live = icu.levels[:713]
    assert (live == live[:, :1]).all()
    np.testing.assert_array_equal(np.bincount(live[:, 0], minlength=6), [0, 178, 178, 178, 179, 0])
    # a milder band is likelier to survive: the levels mean something
    survival = absorption_probability(icu, uniform_policy(icu), 714)[:713]
    means = [survival[live[:, 0] == level].mean() for level in (1, 2, 3, 4)]
    assert means == sorted(means)


def test_icu_bands_can_be_chosen(icu: OrdinalMDP) -> None:
    near = icu_sepsis(bands=(4.7, 6.5, 8.55))  # the quartiles, rounded
    assert 0 < np.count_nonzero((near.levels != icu.levels)[:, 0]) < 10
    assert np.count_nonzero(icu_sepsis(bands=(2, 6, 15)).levels[:713, 0] == 1) < 20
    for bands in ((6, 5, 9), (1, 2), (1, 1, 2), (1, np.nan, 2), "a", {}, ((1,), (2, 3))):
        with pytest.raises(ValueError, match="three increasing SOFA scores"):
            icu_sepsis(bands=bands)  # type: ignore[arg-type]


def test_icu_published_survival(icu: OrdinalMDP) -> None:
    """The package's table of baselines: average return .78 random, .78 expert, .88 optimal."""
    random, expert = uniform_policy(icu), icu_expert_policy()
    best, policy = best_absorption_probability(icu, 714)
    returns = [icu.initial @ absorption_probability(icu, p, 714) for p in (random, expert)]
    assert [round(float(r), 2) for r in (*returns, icu.initial @ best)] == [0.78, 0.78, 0.88]
    assert [*returns, icu.initial @ best] == pytest.approx([0.78007, 0.78184, 0.87514], abs=1e-5)
    np.testing.assert_allclose(absorption_probability(icu, policy, 714), best, atol=1e-12)
    # every episode ends
    died = absorption_probability(icu, random, 713)
    np.testing.assert_allclose(died + absorption_probability(icu, random, 714), 1, atol=1e-12)


def test_icu_published_episode_lengths(icu: OrdinalMDP) -> None:
    """Average lengths 9.45 random, 9.22 expert, 10.99 optimal, which are simulated means."""
    tables = icu.transitions.toarray().reshape(715, 25, 715)[:713, :, :713]
    optimal = np.eye(25)[best_absorption_probability(icu, 714)[1]]
    for policy, length in ((uniform_policy(icu), 9.45), (icu_expert_policy(), 9.22), (optimal, 10.99)):
        chain = np.einsum("sa,sat->st", policy[:713], tables)
        steps = np.linalg.solve(np.eye(713) - chain, np.ones(713))
        assert icu.initial[:713] @ steps == pytest.approx(length, abs=0.03)


def test_icu_expert_policy(icu: OrdinalMDP) -> None:
    policy = icu_expert_policy()
    assert policy.shape == (715, 25)
    assert (policy >= 0).all()
    np.testing.assert_allclose(policy.sum(axis=1), 1, atol=1e-12)
    assert not policy[~icu.admissible].any()


def test_icu_level_shares(icu: OrdinalMDP) -> None:
    """Most of the discounted time is spent after the stay, but every level has its share."""
    v, policy = value_iteration(icu, range(6))
    shares = icu.initial @ evaluate_policy(icu, policy)
    np.testing.assert_allclose(shares.sum(), 1, atol=1e-12)
    np.testing.assert_allclose(shares, [0.1174, 0.0152, 0.0209, 0.0247, 0.0321, 0.7898], atol=2e-4)
    assert icu.initial @ v == pytest.approx(shares @ np.linspace(0, 1, 6), abs=1e-9)


@pytest.mark.usefixtures("icu")
def test_icu_never_imports_gym() -> None:
    code = (
        "import sys; from qlearn.problems.random_mdp import icu_sepsis, icu_expert_policy; "
        "icu_sepsis(); icu_expert_policy(); "
        "bad = {'gym', 'gymnasium', 'icu_sepsis', 'pandas', 'matplotlib'} & set(sys.modules); assert not bad, bad"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_icu_package_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "icu_sepsis", None)
    with pytest.raises(ImportError, match=r"pip install 'elicit-qlearn\[icu\]'"):
        icu_sepsis()
    with pytest.raises(ImportError, match="elicit-qlearn"):
        icu_expert_policy()


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        (None, "dynamics.npz exists"),
        ({"d_0": np.zeros(716), "sofa_scores": np.zeros(716)}, "holds tx_mat"),
        ({"tx_mat": np.zeros((4, 2, 4)), "d_0": np.zeros(716), "sofa_scores": np.zeros(716)}, r"not \(4, 2, 4\)"),
        ({"tx_mat": np.zeros((716, 25, 716)), "d_0": np.zeros(716), "sofa_scores": np.zeros(716)}, "lead to state 715"),
    ],
)
def test_icu_tables_of_another_version(
    tables: Any, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assets = tmp_path / "icu_sepsis" / "envs" / "assets"
    assets.mkdir(parents=True)
    (tmp_path / "icu_sepsis" / "__init__.py").write_text("raise AssertionError('must not be imported')")
    if tables is not None:
        np.savez_compressed(assets / "dynamics.npz", **tables)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(RuntimeError, match=message) as caught:
        icu_sepsis()
    assert "pip install 'icu-sepsis==2.0.1'" in str(caught.value)
