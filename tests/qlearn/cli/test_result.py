"""``qlearn result`` says of a log what the page says, and does not change the log."""

import csv
import io
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from elicit import AnswerLog
from qlearn.cli.main import main
from qlearn.cli.teach_subjects import taught_again
from tests.interpreter import ROOT

TABLE = "name,died,ill,well\nold,2,3,5\nnew,3,1,6\nnone,1,8,1\n"


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a table, and the log of a person who answered six questions about it."""
    folder = tmp_path_factory.mktemp("answered")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("care.csv").write_text(TABLE)
        patch.setattr(sys, "stdin", io.StringIO("a\n1\n" * 7))
        assert main(["teach", "--problem", "care.csv", "--unit", "patients", "--seed", "2"]) == 0
    return folder


@pytest.fixture
def log(answered: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the path of a copy of that log, in a folder of its own that is the working one."""
    shutil.copytree(answered, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return Path("answers-care.jsonl")


def test_it_says_what_the_answers_say_and_leaves_the_log_as_it_is(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = log.read_bytes()
    assert main(["result", str(log), "--out", "found"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert log.read_bytes() == before
    assert "What the levels are worth" in said
    assert "patients were at “died” instead of “well”" in said
    assert "Without your answers the choice could have lost up to " in said
    assert "report.html" in said
    answers = json.loads(Path("found/answers.json").read_text())
    assert [row["id"] for row in answers] == [e.answer.query.id for e in AnswerLog.read(log)]
    scale = [*csv.DictReader(Path("found/scale.csv").read_text().splitlines())]
    assert [row["level"] for row in scale] == ["well", "ill", "died"]
    assert {(row["who"], row["problem"]) for row in scale} == {("", "care")}
    given = {row["level"]: (row["low_if_no_mistake"], row["high_if_no_mistake"]) for row in scale}
    assert given["well"] == given["died"] == ("", "")
    assert all(float(ends[0]) <= float(ends[1]) for ends in [given["ill"]])
    policy = json.loads(Path("found/choice.json").read_text())
    assert sum(row["choice"] == "chosen" for row in policy) == 1
    for row in policy:  # numbers are no texts
        assert row["low"] <= row["high"]
        assert row["behind_at_least"] <= row["behind"] + 0.01
        assert row["worth"] is None or row["low"] <= row["worth"] <= row["high"]
    table = [*csv.DictReader(Path("found/choice.csv").read_text().splitlines())]
    assert [float(row["behind"]) for row in table] == [row["behind"] for row in policy]
    report = Path("found/report.html").read_text()
    for said in (
        "Comparator",
        "posterior",
        "Seed",
        "“You” in this report is",
        "answers-care.jsonl",
    ):
        assert said in report


def test_another_comparator_and_a_log_that_does_not_say_its_problem(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["result", str(log), "--comparator", "polytope"]) == 0
    assert "with 95% probability" not in " ".join(capsys.readouterr().out.split())
    with AnswerLog("plain.jsonl", 3):
        pass
    assert main(["result", "plain.jsonl"]) == 1
    assert "--problem" in capsys.readouterr().err
    assert main(["result", "none.jsonl"]) == 1
    assert "none.jsonl" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("head", "noun"),
    [
        ("name", "alternative"),
        ("Treatment", "treatment"),
        ("Kürzel", "alternative"),
        ("x y", "alternative"),
    ],
)
def test_alternatives_are_called_what_the_csv_calls_them(
    head: str, noun: str, tmp_path: Path
) -> None:
    path = tmp_path / "care.csv"
    path.write_text(TABLE.replace("name", head), encoding="utf-8")
    made = taught_again({"problem": str(path), "comparator": "polytope"})
    said = made.subject.conclude(made.make(()).result(), 0.1)
    assert said.changes is not None
    assert (said.changes.of, said.changes.title) == (noun, f"The 3 {noun}s")
    assert f"nother {noun} may be better" in said.next


def test_a_log_of_a_comparator_that_is_no_more_says_what_to_use(log: Path) -> None:
    recipe = AnswerLog.read(log).header["recipe"] | {"comparator": "relaxed"}
    advice = r"no comparator 'relaxed': give --comparator posterior, or --comparator polytope-1-wro"
    with pytest.raises(ValueError, match=advice):
        taught_again(recipe)


def test_a_log_is_shown_in_the_words_of_the_screen(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["log", "show", str(log)]) == 0
    shown = capsys.readouterr().out
    assert "patients)" in shown
    assert "left" not in shown
    assert " A: " in shown


def test_a_reader_who_has_read_enough_gets_no_traceback(log: Path) -> None:
    command = (
        f"{sys.executable} -m qlearn log show {' '.join([str(log.resolve())] * 400)} | head -1"
    )
    done = subprocess.run(command, shell=True, capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.startswith(str(log.resolve()))
    assert "Traceback" not in done.stderr
    assert "BrokenPipe" not in done.stderr


def test_a_csv_says_its_words_in_a_file_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    Path("care.csv").write_text(TABLE)
    assert main(["teach", "--problem", "care.csv"]) == 0
    assert "Write it in care.words.json" in capsys.readouterr().err
    words = {"title": "Hip care", "unit": "patients", "levels": {"ill": "In bed"}}
    Path("care.words.json").write_text(json.dumps(words))
    assert main(["teach", "--problem", "care.csv", "--log", "new.jsonl"]) == 0
    shown = capsys.readouterr()
    assert shown.out.startswith("Hip care\n  - ill: In bed\n")
    assert "care.words.json" not in shown.err
    for text, said in (
        ("{", "is no JSON"),
        ('{"colour": "red"}', "some of the names unit, verb"),
        ('{"title": 3}', "'title' in care.words.json must be a text"),
        ('{"levels": {"dead": "x"}}', "by the names of levels, some of died, ill, well"),
    ):
        Path("care.words.json").write_text(text)
        assert main(["teach", "--problem", "care.csv"]) == 1
        assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("died,ill,well\n2,3,5\n3,1,6\n", "it must hold the names of the alternatives. If 'died'"),
        ("2,3,5\n3,1,6\n", "the first line of x.csv holds numbers"),
    ],
)
def test_a_missing_column_of_names_is_said(
    text: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("x.csv").write_text(text)
    assert main(["teach", "--problem", "x.csv"]) == 1
    assert said in capsys.readouterr().err


def test_a_log_of_somebody_earlier_is_a_prior(
    log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def teach(*options: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "stdin", io.StringIO("a\n"))
        code = main(["teach", "--problem", "care.csv", *options])
        shown = capsys.readouterr()
        return code, " ".join((shown.out + shown.err).split())

    code, said = teach("--who", "ben", "--like", str(log), str(log))
    assert code == 0
    assert f"--like {log.resolve()}" in said  # in the command that goes on
    own = Path("answers-care-ben.jsonl")
    assert AnswerLog.read(own).header["recipe"]["like"] == [str(log.resolve())]
    assert main(["result", str(own), "--out", "found"]) == 0
    assert "learned from 1 earlier person" in Path("found/report.html").read_text()
    assert main(["report", str(own), str(log)]) == 1
    assert "with other earlier people" in capsys.readouterr().err
    assert (
        "posterior" in teach("--like", str(log), "--comparator", "polytope", "--log", "n.jsonl")[1]
    )
    assert "own log: leave it out" in teach("--log", str(log), "--like", str(log))[1]
    with AnswerLog("other.jsonl", 3, {"labels": ["a", "b", "c"]}) as other:
        other.append(AnswerLog.read(log)[0].answer)
    assert "about the levels ['a', 'b', 'c'], not" in teach("--like", "other.jsonl")[1]
    Path("empty.jsonl").touch()
    assert "holds no answers" in teach("--like", "empty.jsonl")[1]
    assert "missing.jsonl" in teach("--like", "missing.jsonl")[1]
