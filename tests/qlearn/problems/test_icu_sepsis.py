"""ICU-Sepsis is the published benchmark."""

import subprocess
import sys
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from qlearn import OrdinalMDP, evaluate_policy, icu_sepsis, value_iteration
from tests.scale_arithmetic import Floats
from tests.thoroughness import quick_first


@pytest.fixture(scope="module")
def icu() -> OrdinalMDP:
    if find_spec("icu_sepsis") is None:
        pytest.skip("needs icu-sepsis: pip install 'elicit-qlearn[icu]'")
    return icu_sepsis()


def uniform_policy(mdp: OrdinalMDP) -> Floats:
    """Every admissible action alike, in the 713 states that are not terminal."""
    policy: Floats = (mdp.admissible / mdp.admissible.sum(axis=1, keepdims=True))[:713]
    return policy


def chain(mdp: OrdinalMDP, policy: Floats) -> Floats:
    """Return the probabilities (713, 715) of the next state under a policy (713, 25)."""
    places = np.arange(713 * 25), 25 * np.arange(714)
    weights = csr_array((policy.ravel(), *places), shape=(713, 715 * 25))
    steps: Floats = (weights @ mdp.transitions).toarray()
    return steps


def survival(mdp: OrdinalMDP, policy: Floats) -> Floats:
    """Probability (713,) to recover."""
    steps = chain(mdp, policy)
    recovered: Floats = np.linalg.solve(np.eye(713) - steps[:, :713], steps[:, 714])
    return recovered


def test_the_shape_is_the_benchmarks(icu: OrdinalMDP) -> None:
    assert (icu.n_states, icu.n_actions, icu.k) == (715, 25, 6)
    assert icu.labels == ("died", "critical", "severe", "moderate", "mild", "recovered")
    assert icu.discount == 0.99
    np.testing.assert_array_equal(np.flatnonzero(icu.terminal), [713, 714])
    np.testing.assert_array_equal(icu.final_level[713:], [0, 5])
    np.testing.assert_allclose(icu.initial.sum(), 1, atol=1e-12)
    assert icu.admissible[:713].sum(axis=1).mean() == pytest.approx(3.139, abs=1e-3)
    assert icu.successors.shape[2] == 189  # the most of an admissible action


def test_rows_are_the_package_tables(icu: OrdinalMDP) -> None:
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


def test_levels_are_quarters_of_the_states_and_order_them_by_severity(icu: OrdinalMDP) -> None:
    live = icu.levels[:713]
    assert (live == live[:, :1]).all()
    np.testing.assert_array_equal(np.bincount(live[:, 0], minlength=6), [0, 178, 178, 178, 179, 0])
    # a milder band is likelier to survive: the levels mean something
    recovery = survival(icu, uniform_policy(icu))
    means = [recovery[live[:, 0] == level].mean() for level in (1, 2, 3, 4)]
    assert means == sorted(means)


def test_states_and_doses_have_names(icu: OrdinalMDP) -> None:
    assert icu.state_name(0).startswith("0 (mean SOFA ")
    assert (icu.state_name(713), icu.state_name(714)) == ("died", "recovered")
    # as the package's own wrapper takes an action apart: fluids first
    assert icu.action_names is not None
    assert icu.action_names[:6] == (
        *(f"fluids 0 with vasopressors {dose}" for dose in range(5)),
        "fluids 1 with vasopressors 0",
    )
    assert icu.action_names[22] == "fluids 4 with vasopressors 2"


@pytest.mark.slow
def test_bands_can_be_chosen(icu: OrdinalMDP) -> None:
    near = icu_sepsis(bands=(4.7, 6.5, 8.55))  # the quartiles, rounded
    assert 0 < np.count_nonzero((near.levels != icu.levels)[:, 0]) < 10
    assert np.count_nonzero(icu_sepsis(bands=(2, 6, 15)).levels[:713, 0] == 1) < 20
    for bands in ((6, 5, 9), (1, 2), (1, 1, 2), (1, np.nan, 2), "a", {}, ((1,), (2, 3))):
        with pytest.raises(ValueError, match="three increasing SOFA scores"):
            icu_sepsis(bands=bands)  # type: ignore[arg-type]


def test_the_published_baselines(icu: OrdinalMDP) -> None:
    """The package's table: average return .78 at random and .88 at best, undiscounted; average
    lengths 9.45 and 10.99, which are simulated means."""
    recovery, best, before = survival(icu, uniform_policy(icu)), np.eye(715)[714], np.zeros(715)
    while np.abs(best - before).max() > 1e-12:
        q = np.where(icu.admissible, (icu.transitions @ best).reshape(715, 25), -np.inf)
        before, best = best, q.max(axis=1)
    optimal = np.eye(25)[q[:713].argmax(axis=1)]
    assert icu.initial[:713] @ recovery == pytest.approx(0.78007, abs=1e-5)
    assert icu.initial @ best == pytest.approx(0.87514, abs=1e-5)
    np.testing.assert_allclose(survival(icu, optimal), best[:713], atol=1e-9)
    for policy, length in ((uniform_policy(icu), 9.45), (optimal, 10.99)):
        steps = np.linalg.solve(np.eye(713) - chain(icu, policy)[:, :713], np.ones(713))
        assert icu.initial[:713] @ steps == pytest.approx(length, abs=0.03)


def test_level_shares(icu: OrdinalMDP) -> None:
    """Most of the discounted time is spent after the stay, but every level has its share."""
    v, policy = value_iteration(icu, range(6))
    shares = icu.initial @ evaluate_policy(icu, policy)
    np.testing.assert_allclose(shares.sum(), 1, atol=1e-12)
    np.testing.assert_allclose(shares, [0.1174, 0.0152, 0.0209, 0.0247, 0.0321, 0.7898], atol=2e-4)
    assert icu.initial @ v == pytest.approx(shares @ np.linspace(0, 1, 6), abs=1e-9)


@pytest.mark.usefixtures("icu")
@pytest.mark.parametrize("makes", quick_first(["qlearn.icu_sepsis", "qlearn.icu_sepsis()"], 1))
def test_gym_is_never_imported(makes: str) -> None:
    """A test of other tables sees quickly that the package is not imported while it is read."""
    code = (
        f"import sys, qlearn; {makes}; "
        "bad = {'gym', 'gymnasium', 'icu_sepsis', 'pandas', 'matplotlib'} & set(sys.modules); "
        "assert not bad, bad"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "icu_sepsis", None)
    with pytest.raises(ImportError, match=r"pip install 'elicit-qlearn\[icu\]'"):
        icu_sepsis()


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        (None, "dynamics.npz exists"),
        ({"d_0": np.zeros(716), "sofa_scores": np.zeros(716)}, "holds tx_mat"),
        (
            {"tx_mat": np.zeros((4, 2, 4)), "d_0": np.zeros(716), "sofa_scores": np.zeros(716)},
            r"not \(4, 2, 4\)",
        ),
        (
            {
                "tx_mat": np.zeros((716, 25, 716), dtype=np.int8),  # soon written
                "d_0": np.zeros(716),
                "sofa_scores": np.zeros(716),
            },
            "lead to state 715",
        ),
    ],
)
def test_tables_of_another_version(
    tables: Any, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assets = tmp_path / "icu_sepsis" / "envs" / "assets"
    assets.mkdir(parents=True)
    (tmp_path / "icu_sepsis" / "__init__.py").write_text(
        "raise AssertionError('must not be imported')"
    )
    if tables is not None:
        np.savez_compressed(assets / "dynamics.npz", **tables)
    monkeypatch.delitem(sys.modules, "icu_sepsis", raising=False)  # if another test imported it
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(RuntimeError, match=message) as caught:
        icu_sepsis()
    assert "pip install 'icu-sepsis==2.0.1'" in str(caught.value)
