"""The benchmark of sweeps measures what it says: all solve the problem, and who is fastest is said
first.
"""

from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

from benchmarks.learning import scalar_solvers
from benchmarks.learning import value_iteration_cost as ivi
from benchmarks.quotes import table_rows
from qlearn import policy_loss, random_mdp
from tests.thoroughness import quick_first, scaled


@pytest.mark.parametrize("jobs", quick_first([1, 2], 1))
def test_all_on_share_vectors_solve_the_problem(jobs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ivi, "BLOCK", 32)
    mdp, values = random_mdp(*scaled((40, 4, 6), (100, 5, 10)), rng=0)
    found = {method: solve(mdp, values, jobs) for method, solve in ivi.VECTORS.items()}
    for run in found.values():
        assert policy_loss(mdp, run["policy"], values).max() <= ivi.TOLERANCE
    plain = found["the same without partial sweeps"]
    assert abs(plain["sweeps"] - found["values known, share vectors"]["sweeps"]) <= 2
    assert found["interactive value iteration"]["sweeps"] < plain["sweeps"] / 2


@pytest.mark.parametrize("name", scalar_solvers.SOLVERS)
def test_scalar_solvers_solve_the_problem(name: str) -> None:
    solver = scalar_solvers.SOLVERS[name]
    if solver.missing:
        pytest.skip(f"{solver.needs} is not installed")
    mdp, values = random_mdp(60, 3, 5, discount=0.9, rng=1)
    found = solver.solve(mdp, values, 0.001)
    assert policy_loss(mdp, found.policy, values).max() <= 0.001
    assert found.cpu >= 0.0


def test_the_check_of_another_package_is_back_after_it_was_left_out() -> None:
    if find_spec("mdptoolbox") is None:
        pytest.skip("mdptoolbox is not installed")
    from mdptoolbox import mdp as toolbox

    check = toolbox._util.check
    mdp, values = random_mdp(20, 2, 3, rng=0)
    scalar_solvers.SOLVERS["pymdptoolbox, value iteration"].solve(mdp, values, 0.01)
    assert toolbox._util.check is check


def test_the_report(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    seconds = {
        "qlearn, modified policy iteration": [0.5, 0.5, 0.5],
        "interactive value iteration": [5.0, 4.0, 9.0],
    }
    seconds |= {"pymdptoolbox, value iteration": [0.3, 0.2, 0.1]}
    tried = []

    def instead(method: str, *settings: Any) -> Any:
        tried.append(method)
        if method not in seconds:
            return "not installed"
        found = {"sweeps": 4, "cpu": seconds[method].pop(0), "loss": 0.0, "peak": 0.5, "built": 1.0}
        return found | {"until the last answer": 1.0, "decided": {}, "asked": 7}

    monkeypatch.setattr(ivi, "measured", instead)
    ivi.main(["--states", "50", "--out", str(tmp_path / "new" / "ivi.md")])
    text = (tmp_path / "new" / "ivi.md").read_text()
    assert capsys.readouterr().out.strip() == text.strip()
    rows = table_rows(text)
    assert [len(row) for row in rows] == [9] * (1 + len(ivi.METHODS))
    # medians of three, the fastest first
    assert rows[1][:6] == ["pymdptoolbox, value iteration", "0.200", "0.100", "0.300", "1.0", "4"]
    assert rows[3][:5] == ["interactive value iteration", "5.000", "4.000", "9.000", "25.0"]
    assert rows[4][1] == "not installed"
    assert "pymdptoolbox, value iteration takes 0.200 CPU seconds" in text
    assert "interactive value iteration 25.0 times as long" in text
    assert tried.count("QuantEcon, policy iteration") == 1, "what failed once is not tried again"


def test_a_run_in_this_process() -> None:
    for method in ("values known, share vectors", "qlearn, modified policy iteration"):
        found = ivi.run(method, 60, 1, seed=0, with_loss=True)
        assert found["loss"] <= ivi.TOLERANCE
        assert found["peak"] > 0.01
        assert np.isfinite(found["cpu"])


def test_another_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scalar_solvers, "find_spec", lambda name: None)
    assert ivi.measured("pymdptoolbox, value iteration", 10, 1, 0, False, 1.0) == "not installed"
