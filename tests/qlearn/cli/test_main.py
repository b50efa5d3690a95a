"""The command line, from outside."""

import builtins
import re
from concurrent.futures import BrokenExecutor
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from matplotlib.figure import Figure

from qlearn import ablation
from qlearn.cli import ablate, figures
from qlearn.cli import main as cli
from qlearn.experiments.ablation import KEYS
from qlearn.experiments.settings import AblationSettings, FiguresSettings, Settings
from qlearn.paper import figure_runs as series
from tests.interpreter import ROOT, run


@pytest.mark.parametrize(
    ("command", "settings", "texts"),
    [("ablate", AblationSettings, ablate.TEXTS), ("figures", FiguresSettings, figures.TEXTS)],
)
def test_the_help_says_every_option_with_its_default(
    command: str,
    settings: type[Settings],
    texts: dict[str, str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        cli.main([command, "--help"])
    shown = "".join(capsys.readouterr().out.split())
    said = {one.name: one for one in fields(settings)}
    names = [name for group in settings.GROUPS.values() for name in group]
    assert len(names) == len({*names}) == {"ablate": len(said), "figures": 19}[command]
    assert {*texts} <= {*names}
    assert not {"[None]", "[]"} & {*re.findall(r"\[\w*\]", shown)}
    for name in names:
        default = said[name].default
        text = texts.get(name, said[name].metadata["help"])
        if default in (None, ()):
            assert text.endswith("]"), name  # in words
        else:
            stated = [
                f"{x:g}" if isinstance(x, float) else str(x)
                for x in (default if isinstance(default, tuple) else [default])
            ]
            text += f"[{''.join(stated)}]"
        assert f"--{name.replace('_', '-')}" in shown
        assert "".join(text.split()) in shown


def test_it_says_its_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"qlearn {version('elicit-qlearn')}\n"


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom qlearn.cli.main import main\ntry:\n    main(['ablate', "
        "'--help'])\nexcept SystemExit:\n"
        "    print('heavy:', sorted({'numpy', 'scipy', 'pandas', 'matplotlib', 'joblib'} & "
        "set(sys.modules)))"
    )
    *shown, heavy = run(code)
    assert "--max-queries" in "".join(shown)
    assert "[2000]" in "".join(shown)
    assert heavy == "heavy: []"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("ablate --seeds 0", "'0' is not a whole number of at least 1"),
        ("ablate --seeds 2.5", "'2.5' is not a whole number"),
        ("ablate --jobs 0", "'0' is not a whole number of at least 1"),
        ("ablate --error-rates 0 0.5", "'0.5' is not a number of at least 0 and below 0.5"),
        ("ablate --tolerance nan", "'nan' is not a number strictly between 0 and 1"),
        ("ablate --comparators ellipsoid", "invalid choice: 'ellipsoid' (choose from "),
        ("ablate --comparators polytope nowhere:f", "'nowhere:f': there is no module 'nowhere'"),
        (
            "ablate --problems tests.own_cases:missing",
            "--problems: 'tests.own_cases:missing': module tests.own_cases has",
        ),
        ("ablate --learners tests.own_cases:NUMBER", "is no factory: 5 cannot be called"),
        (
            "ablate --tutors flip",
            "invalid choice: 'flip' (choose from 'person', or your own, as package.module:factory)",
        ),
        ("ablate --comparators", "expected at least one argument"),
        ("ablate --colour red", "--colour"),
        ("ablate --quick --paper", "not allowed with"),
        ("", "COMMAND"),
        ("figures --seeds 0", "'0' is not a whole number of at least 1"),
        ("figures --levels 4 101", "'101' is not a whole number from 2 to 100"),
        ("figures --comparators always", "invalid choice: 'always'"),
    ],
)
def test_bad_options_end_in_2_and_say_the_value(
    options: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(options.split())
    assert caught.value.code == 2
    assert said in capsys.readouterr().err


def test_no_comparator_need_be_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[FiguresSettings] = []
    monkeypatch.setattr(
        "qlearn.cli.figures.run", lambda settings, **how: seen.append(settings) or 0
    )
    assert cli.main(["figures", "--thinned"]) == 0
    assert cli.main(["figures", "--thinned", "box"]) == 0
    assert [settings.thinned for settings in seen] == [(), ("box",)]
    with pytest.raises(SystemExit):
        cli.main(["figures", "--levels"])


ABLATE = (
    "ablate --quick --seeds 1 --learners q-learning --comparators polytope --audit 0.05 --steps 60"
)
FIGURES = (
    "figures --levels 3 4 --at-states 6 --states 6 9 --at-levels 4 --actions 2 --seeds 2 --steps "
    "60 --n-boot 5 "
    "--particles 20 --tutors 10% --thinned polytope"
)
FIGURE_FILES = [
    "claims.csv",
    "claims.md",
    *(f"figure{i}.{kind}" for i in (2, 3, 4) for kind in ("png", "svg")),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "files", "keys", "rows", "said"),
    [
        (
            ABLATE,
            ["ablation.png"],
            KEYS,
            5,
            "random MDP (10 states, 3 actions, 5 levels), Q-learning",
        ),
        pytest.param(FIGURES, FIGURE_FILES, series.KEYS, 28, "| holds (", marks=pytest.mark.slow),
    ],
    ids=["ablate", "figures"],
)
def test_a_command_writes_the_same_bytes_again_read_back_or_computed_on_two_cores(
    command: str,
    files: list[str],
    keys: tuple[str, ...],
    rows: int,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "new" / "results"

    def written(*options: str) -> dict[str, bytes]:
        assert cli.main([*command.split(), "--out", str(out), *options]) == 0
        return {path.name: path.read_bytes() for path in out.iterdir()}

    first = written("--jobs", "1")
    assert said in capsys.readouterr().out
    assert {*first} == {*files, "journal.jsonl", "runs.csv", "summary.csv", "times.csv"}
    assert b"\r" not in first["runs.csv"]
    assert all(len(first[name]) > 10_000 for name in files if name.endswith("png"))
    runs, times = pd.read_csv(out / "runs.csv"), pd.read_csv(out / "times.csv")
    assert len(runs) == len(times) == rows
    assert "seconds" not in runs.columns
    assert times.columns.tolist() == [*keys, "seconds"]

    assert written() == first
    assert f"{rows} of the {rows} runs had finished before" in capsys.readouterr().err
    fresh = written("--jobs", "2", "--fresh")
    assert "before" not in capsys.readouterr().err
    assert {name for name in first if first[name] != fresh[name]} == {"times.csv", "journal.jsonl"}


def test_options_override_the_preset_and_the_preset_the_defaults(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    seen: list[Any] = []

    def fake(settings: AblationSettings, progress: Any, **how: Any) -> pd.DataFrame:
        seen.append((settings, how))
        raise ValueError("enough")

    monkeypatch.setattr(ablation, "ablate", fake)
    assert (
        cli.main(
            [
                "ablate",
                "--paper",
                "--steps",
                "7",
                "--error-rates",
                "0",
                ".2",
                "--out",
                str(tmp_path),
            ]
        )
        == 1
    )
    settings = AblationSettings(
        seeds=20, n_boot=200, refit_growth=0.0, steps=7, error_rates=(0.0, 0.2)
    )
    assert seen == [(settings, {"jobs": -1, "fresh": False, "journal": tmp_path / "journal.jsonl"})]


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("this cannot be"), "this cannot be"),
        (ImportError("the tables are not installed: pip install x"), "the tables are not "
                                                                     "installed: pip install x"),
        (BlockingIOError("another process is writing to it"), "another process is writing to it"),
        (BrokenExecutor(), "a process that computed a run died (killed, or out of memory?); the "
                           "runs that had finished "
         "are kept: start again to compute the rest, or with --jobs 1"),
    ],
)  # fmt: skip
def test_errors_of_the_library_are_one_line(
    error: Exception,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fake(*settings: Any, **how: Any) -> pd.DataFrame:
        raise error

    monkeypatch.setattr(ablation, "ablate", fake)
    assert cli.main(["ablate", "--out", str(tmp_path)]) == 1
    assert f"qlearn: {said}\n" in capsys.readouterr().err
    (tmp_path / "file").touch()
    assert cli.main(["ablate", "--out", str(tmp_path / "file" / "results")]) == 1
    assert "cannot make the directory" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "module"),
    [(f"{ABLATE} --jobs 1", ablation), (f"{FIGURES} --jobs 1", series)],
)
def test_ctrl_c_keeps_what_has_finished(
    command: str, module: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    name = command.split()[0]
    real = getattr(module, name)

    def stopped(settings: Settings, progress: Any, **how: Any) -> pd.DataFrame:
        def stop(done: int, total: int) -> None:
            if done == 2:
                raise KeyboardInterrupt

        return real(settings, progress=stop, **how)

    monkeypatch.setattr(module, name, stopped)
    assert cli.main([*command.split(), "--out", str(tmp_path)]) == 130
    kept = pd.read_csv(tmp_path / "runs.csv")
    assert len(kept) == 2
    assert {*module.KEYS, "asked", "loss"} <= {*kept.columns}


def test_a_partial_table_and_picture_say_what_is_incomplete(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    real, titles = ablation.ablate, []

    def stopped(settings: Settings, progress: Any, **how: Any) -> pd.DataFrame:
        def stop(done: int, total: int) -> None:
            if done == 4:
                raise KeyboardInterrupt

        return real(settings, progress=stop, **how)

    def drawn(figure: Figure, *_: Any, **__: Any) -> None:
        titles.append(figure.get_suptitle())

    monkeypatch.setattr(ablation, "ablate", stopped)
    monkeypatch.setattr(Figure, "savefig", drawn)
    command = [
        *ABLATE.replace("--seeds 1", "--seeds 3").split(),
        "--jobs",
        "1",
        "--out",
        str(tmp_path),
    ]
    assert cli.main(command) == 130
    lines = capsys.readouterr().out.splitlines()
    (oracle,) = (line for line in lines if line.startswith("always"))
    (polytope,) = (line for line in lines if line.startswith("polytope"))
    assert oracle.split()[1:3] == ["0%", "3"]
    assert "1 of 3" in polytope
    assert "INCOMPLETE: 4 of 15 runs; of 3 rows there are none yet" in lines
    assert titles[0].splitlines()[-1] == "INCOMPLETE: of 3 seeds some means have 1 only"

    monkeypatch.setattr(ablation, "ablate", real)
    assert cli.main(command) == 0
    text = capsys.readouterr().out
    assert "INCOMPLETE" not in text
    assert " of 3 " not in text
    assert titles[1].splitlines()[-1] == "means over 3 seeds, with 95% intervals"


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_parts_of_the_users_go_in_from_the_current_directory(jobs: int, tmp_path: Path) -> None:
    (tmp_path / "my_models.py").write_text("from tests.own_cases import Exact, tiny\n\ndef "
                                           "exact(k, seed):\n"
                                           "    return Exact(tiny(seed)[1])\n")  # fmt: skip
    options = (
        "ablate --learners value-iteration certified=tests.own_cases:certified --error-rates 0"
    )
    options += " --tutors tests.own_cases:careless"
    options += " --comparators polytope exact=my_models:exact --problems box=tests.own_cases:tiny --seeds 1"  # noqa: E501
    options += f" --jobs {jobs}"
    options += " --tolerance 0.05 --audit 0"
    start = "import sys; sys.path = [p for p in sys.path if p]; from qlearn.cli.main import main; "
    lines = run(
        f"{start}raise SystemExit(main({options.split()!r}))",
        tmp_path,
        PYTHONPATH=str(ROOT),
        PYTHONWARNINGS="ignore",
    )
    heads = [line for line in lines if line.startswith("box, ")]
    assert heads == ["box, value iteration", "box, certified"]
    rows = pd.read_csv(tmp_path / "results" / "ablation" / "runs.csv").set_index(
        ["learner", "comparator", "error_rate"]
    )
    assert len(rows) == 9
    careless = "tests.own_cases:careless"
    for learner in ("value-iteration", "certified"):
        for tutor in ("0.0", careless):
            assert rows.asked[learner, "exact", tutor] == 0
            assert rows.loss[learner, "exact", tutor] < 0.05
            assert rows.asked[learner, "polytope", tutor] > 0
        assert rows.realised_error_rate[learner, "polytope", careless] > 0.9


def test_what_a_factory_returned_is_said_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, said in (
        (
            "three",
            "returned no comparator: a comparator is wanted, such as PolytopeComparator(k=5), not 3",  # noqa: E501
        ),
        ("two", "returned a comparator of k = 2: it must be made for 5"),
    ):
        options = [
            *ABLATE.split(),
            "--comparators",
            f"mine=tests.own_cases:{name}",
            "--out",
            str(tmp_path),
        ]
        assert cli.main(options) == 1
        assert (
            f"qlearn: 'mine': the factory, called with k = 5, seed = 0, {said}"
            in capsys.readouterr().err
        )


@pytest.mark.slow
def test_quick_has_enough_seeds_for_its_picture_to_tell_the_comparators_apart(
    tmp_path: Path,
) -> None:
    assert cli.main(["ablate", "--quick", "--jobs", "1", "--out", str(tmp_path)]) == 0
    times = pd.read_csv(tmp_path / "times.csv")
    assert (
        times.seconds.sum() < 60
    )  # some 3 seconds where nothing has to be compiled, and nobody else computes
    cells = pd.read_csv(tmp_path / "summary.csv").set_index(["learner", "comparator", "error_rate"])
    assert (cells.runs >= 8).all()
    for learner in ("q-learning", "value-iteration"):
        here = cells.loc[learner]
        for name in (
            "polytope",
            "posterior",
            "ensemble",
        ):  # all ask far less than always, beyond their intervals
            few, most = here.loc[name, 0.0], here.loc["always", 0.0]
            assert few.asked + few.asked_half < most.asked - most.asked_half
            assert few.excess_loss <= 0.001
        wrong, right = here.loc["polytope", 0.15], here.loc["posterior", 0.15]
        margin = (
            right.asked_half if learner == "q-learning" else 0.0
        )  # value iteration asks too little for both intervals
        assert wrong.asked + wrong.asked_half < right.asked - margin
        assert wrong.excess_loss > right.excess_loss + right.excess_loss_half


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


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("teach --problem none.csv", "there is no file none.csv: check the name"),
        ("teach --problem care.csv --log no/log.jsonl", "there is no folder no for log.jsonl"),
        ("teach --problem care.csv --like none.jsonl", "there is no file {}none.jsonl: check"),
        ("result none.jsonl", "there is no file none.jsonl: check the name"),
        ("report none.jsonl other.jsonl", "there is no file none.jsonl: check the name"),
        ("log show none.jsonl", "there is no file none.jsonl: check the name"),
        ("log check no/none.jsonl", "there is no folder no for none.jsonl"),
        ("log export none.jsonl", "there is no file none.jsonl: check the name"),
        ("log merge none.jsonl --out new.jsonl", "there is no file none.jsonl: check the name"),
    ],
)
def test_a_missing_file_is_said_in_words(
    options: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("care.csv").write_text("name,died,ill,well\nold,2,3,5\nnew,3,1,6\n")
    assert cli.main(options.split()) == 1
    errors = capsys.readouterr().err
    assert f"qlearn: {said.format(f'{tmp_path}/')}" in errors
    assert "Errno" not in errors
