"""The benchmark of sweeps measures what it says: its base line is value iteration, and both find the best policy."""

from typing import Any

import numpy as np
import pytest

from benchmarks.learning import value_iteration_cost as ivi
from qlearn import policy_loss, random_mdp
from tests.report_cases import table_rows


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_base_line_and_ours_solve_the_problem(jobs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ivi, "BLOCK", 32)
    mdp, values = random_mdp(100, 5, 10, rng=0)
    for method in (ivi.knowing, ivi.interactive):
        found = method(mdp, values, jobs)
        assert policy_loss(mdp, found["policy"], values).max() <= ivi.TOLERANCE
    assert abs(found["sweeps"] - ivi.knowing(mdp, values, jobs)["sweeps"]) <= 2


def test_the_report(monkeypatch: pytest.MonkeyPatch, tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    seconds = iter([2.0, 5.0, 4.0, 6.0, 3.0, 4.0])

    def instead(method: str, *settings: Any) -> Any:
        if method in ivi.NEEDS:
            return "not installed"
        found = {"sweeps": 4, "cpu": 1.0, "loss": 0.0, "peak": 0.5, "built": 1.0, "seconds": next(seconds)}
        return found | {"until the last answer": 1.0, "decided": {}, "asked": 7}

    monkeypatch.setattr(ivi, "measured", instead)
    ivi.main(["--states", "50", "--out", str(tmp_path / "new" / "ivi.md")])
    text = (tmp_path / "new" / "ivi.md").read_text()
    assert capsys.readouterr().out.strip() == text.strip()
    rows = table_rows(text)
    assert [len(row) for row in rows] == [9] * 5
    # medians of three: 3 and 5
    assert rows[1][:4] == ["values known", "3.00", "1.00", "1.00"]
    assert rows[2][:6] == ["interactive", "5.00", "1.67", "1.00", "4", "1250.00"]
    assert rows[3][1] == "not installed"


def test_a_run_in_this_process() -> None:
    found = ivi.run("values known", 60, 1, seed=0, with_loss=True)
    assert found["loss"] <= ivi.TOLERANCE
    assert found["peak"] > 0.01
    assert np.isfinite(found["seconds"])


def test_another_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ivi, "find_spec", lambda name: None)
    assert ivi.measured("pymdptoolbox", 10, 1, 0, False, 1.0) == "not installed"
