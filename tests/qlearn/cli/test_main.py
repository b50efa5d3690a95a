"""The command line, from outside."""

from __future__ import annotations

import builtins
import signal
import subprocess
import sys
import time
from inspect import signature
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from qlearn import ablation
from qlearn.cli import main as cli
from qlearn.experiments.ablation import KEYS, ORDER
from qlearn.experiments.journal import Journal


def test_the_defaults_in_the_help_are_those_of_the_library() -> None:
    keywords = {**signature(ablation.ablate).parameters, **signature(ablation.run).parameters}
    assert {name: keywords[name].default for name in cli.DEFAULTS} == cli.DEFAULTS
    missing = {*keywords} - {*cli.DEFAULTS} - {"cell", "mdp", "values"}
    assert missing == {"jobs", "journal", "fresh", "progress", "settings"}
    assert {"problem": cli._PROBLEMS, "learner": cli._LEARNERS, "comparator": cli._COMPARATORS} == ORDER


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom qlearn.cli.main import main\ntry:\n    main(['ablate', '--help'])\nexcept SystemExit:\n"
        "    print('heavy:', sorted({'numpy', 'scipy', 'pandas', 'matplotlib', 'joblib'} & set(sys.modules)))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "--max-queries" in shown
    assert "[2000]" in shown
    assert shown.endswith("heavy: []\n")


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--seeds", "0", "'0' is not a whole number of at least 1"),
        ("--seeds", "2.5", "'2.5' is not a whole number"),
        ("--error-rates", "0.5", "'0.5' is not a number of at least 0 and below 0.5"),
        ("--tolerance", "nan", "'nan' is not a number above 0"),
        ("--discount", "1", "'1' is not a number of at least 0 and below 1"),
        ("--audit", "5", "'5' is not a number from 0 to 1"),
        ("--audit-steps", "0", "'0' is not a whole number of at least 1"),
        ("--levels", "101", "'101' is not a whole number from 2 to 100"),
        ("--comparators", "ellipsoid", "ellipsoid"),
        ("--colour", "red", "--colour"),
    ],
)
def test_bad_options_end_in_2_and_say_the_value(
    option: str, value: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["ablate", option, value])
    assert caught.value.code == 2
    assert said in capsys.readouterr().err


def test_no_command_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main([])
    assert caught.value.code == 2
    assert "COMMAND" in capsys.readouterr().err


QUICKER = (
    "ablate --quick --jobs 1 --seeds 1 --learners q-learning --comparators polytope --error-rates 0 0.15 --steps 60"
)


def test_quick_writes_rows_times_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "results"
    assert cli.main([*QUICKER.split(), "--out", str(out)]) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "ablation.png", "journal.jsonl", "runs.csv", "summary.csv", "times.csv"
    ]  # fmt: skip
    assert (out / "ablation.png").stat().st_size > 10_000
    rows, times = pd.read_csv(out / "runs.csv"), pd.read_csv(out / "times.csv")
    assert len(rows) == len(times) == 5
    assert "seconds" not in rows.columns
    assert times.columns.tolist() == [*KEYS, "seconds"]
    shown = capsys.readouterr().out
    assert "random MDP (15 states, 3 actions, 4 levels), Q-learning" in shown
    assert "excess loss" in shown

    first = (out / "runs.csv").read_bytes()
    assert b"\r" not in first
    spent = (out / "times.csv").read_bytes()
    assert cli.main([*QUICKER.split(), "--out", str(out)]) == 0
    assert "5 of the 5 runs had finished before" in capsys.readouterr().err
    assert (out / "runs.csv").read_bytes() == first
    assert (out / "times.csv").read_bytes() == spent
    assert cli.main([*QUICKER.split(), "--fresh", "--out", str(out)]) == 0
    assert "before" not in capsys.readouterr().err
    assert (out / "runs.csv").read_bytes() == first
    assert (out / "times.csv").read_bytes() != spent


def test_after_kill_9_the_same_command_computes_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [*QUICKER.split(), "--learners", "ivi", "--seeds", "3"]
    journal = tmp_path / "killed" / "journal.jsonl"
    with subprocess.Popen([sys.executable, "-m", "qlearn", *options, "--out", str(journal.parent)]) as child:
        while not (journal.exists() and journal.read_bytes().count(b"\n") >= 2):
            assert child.poll() is None
            time.sleep(0.005)
        child.send_signal(signal.SIGKILL)
    kept = journal.read_bytes().count(b"\n")
    assert 2 <= kept < 15
    assert not (journal.parent / "runs.csv").exists()

    assert cli.main([*options, "--out", str(journal.parent)]) == 0
    assert f"{kept} of the 15 runs had finished before" in capsys.readouterr().err
    assert cli.main([*options, "--out", str(tmp_path)]) == 0
    assert (journal.parent / "runs.csv").read_bytes() == (tmp_path / "runs.csv").read_bytes()


def test_a_journal_in_use_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    assert cli.main([*QUICKER.split(), "--out", str(tmp_path)]) == 1
    assert f"qlearn: another process is writing to {tmp_path}" in capsys.readouterr().err
    journal.close()


def test_options_override_the_preset(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen: dict[str, Any] = {}

    def fake(**settings: Any) -> pd.DataFrame:
        seen.update(settings)
        raise ValueError("the settings 3 and 4 do not go together")

    monkeypatch.setattr(ablation, "ablate", fake)
    assert cli.main(["ablate", "--paper", "--steps", "7", "--out", str(tmp_path)]) == 1
    assert (seen["steps"], seen["seeds"], seen["refit_growth"], seen["jobs"]) == (7, 20, 0.0, -1)
    assert "problems" not in seen  # what is not said is left to the library


@pytest.mark.parametrize(
    "error",
    [
        ValueError("this cannot be"),
        ImportError("the ICU-Sepsis tables are not installed: pip install 'elicit-qlearn[icu]'"),
    ],
)
def test_errors_of_the_library_are_one_line(
    error: Exception, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fake(**settings: Any) -> pd.DataFrame:
        raise error

    monkeypatch.setattr(ablation, "ablate", fake)
    assert cli.main(["ablate", "--out", str(tmp_path)]) == 1
    assert f"qlearn: {error}\n" in capsys.readouterr().err


def test_ctrl_c_keeps_what_has_finished(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    real = ablation.ablate

    def stopped(progress: Any, **settings: Any) -> pd.DataFrame:
        def stop(done: int, total: int) -> None:
            if done == 2:
                raise KeyboardInterrupt

        return real(progress=stop, **settings)

    monkeypatch.setattr(ablation, "ablate", stopped)
    assert cli.main([*QUICKER.split(), "--out", str(tmp_path)]) == 130
    assert len(pd.read_csv(tmp_path / "runs.csv")) == 2


def test_a_missing_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "tqdm":
            raise ModuleNotFoundError("No module named 'tqdm'", name="tqdm")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    assert cli.main(["ablate", "--out", str(tmp_path)]) == 1
    assert "tqdm is not installed: pip install 'elicit-qlearn[ablation]'" in capsys.readouterr().err


def test_a_directory_that_cannot_be_made_is_said_before_the_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert cli.main(["ablate", "--out", str(tmp_path / "file" / "results")]) == 1
    assert "cannot make the directory" in capsys.readouterr().err
