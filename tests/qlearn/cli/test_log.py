"""``qlearn log``, from outside."""

from pathlib import Path

import pytest

from elicit import Answer, AnswerLog, Answers, Query
from elicit.tutors.answer_log import REPEATS
from qlearn.cli import main as cli

LEFT, RIGHT = [0.1, 0.2, 0.7], [0.3, 0.3, 0.4]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    with AnswerLog(tmp_path / "log.jsonl", header={"unit": "days"}) as log:
        log.append(
            Answer(Query("a", LEFT, RIGHT, "ward 3\nor 4?"), 1, swapped=True),
            who="ann",
            latency=2.5,
        )  # type: ignore[arg-type]
        log.append(Answer(Query("b", RIGHT, LEFT), None), who="bob")
        log.append(Answer(Query("c", LEFT, RIGHT), -1), used=False)  # type: ignore[arg-type]
        log.append(Answer(Query("d", LEFT, RIGHT), 0))  # type: ignore[arg-type]
        log.retract("d")
    return tmp_path / "log.jsonl"


COUNTED = (
    "3 answers stand: 1 is learned from, 1 is “cannot tell” and 1 is ignored for contradicting "
    "others. Besides these, 1 was taken back."
)


def damage(path: Path) -> Path:
    damaged = path.with_name("damaged")
    data = path.read_bytes()
    damaged.write_bytes(data.replace(b'"verdict": null', b'"verdict": 0000'))
    return damaged


def test_show(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["log", "show", str(path)]) == 0
    title, head, *rows, counted = capsys.readouterr().out.splitlines()
    assert title == f"{path} (k: 3, unit: days)"
    assert head.split() == ["time", "who", "question", "answer", "seconds", "about"]
    assert [row.split() for row in rows] == [
        ["1", "ann", "a", "left", "(shown", "right", "to", "left)", "2.5", "ward", "3", "or", "4?"],
        ["2", "bob", "b", "cannot", "tell"],
        ["3", "c", "right,", "unused"],
        ["4", "d", "equal,", "taken", "back"],
    ]
    assert counted == COUNTED


def test_check(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["log", "check", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: whole; {COUNTED}\n"
    old = tmp_path / "old"
    old.write_text('{"format": "elicit answers", "version": 1, "k": 3}\n')
    assert cli.main(["log", "check", str(old)]) == 1
    assert "is a log of version 1, which no release has written" in capsys.readouterr().err
    before = damage(path).read_bytes()
    assert (
        cli.main(
            ["log", "check", str(path), str(damage(path)), str(tmp_path), str(tmp_path / "none")]
        )
        == 1
    )
    out, err = capsys.readouterr()
    assert out.startswith(f"{path}: whole")
    assert out.count("\n") == 1
    for said in (f"line 3 of {tmp_path / 'damaged'} is damaged", "is a directory", "none"):
        assert said in err
    assert damage(path).read_bytes() == before


def test_check_counts_repeats_apart_from_what_is_unused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "repeats.jsonl"
    with AnswerLog(path, 3) as log:
        log.append(Answer(Query("a", LEFT, RIGHT), 1))  # type: ignore[arg-type]
        again = Query("a again", LEFT, RIGHT)
        log.append(Answer(again, 1), used=False, **{REPEATS: "a"})  # type: ignore[arg-type]
        log.append(Answer(Query("b", LEFT, RIGHT), -1), used=False)  # type: ignore[arg-type]
    assert cli.main(["log", "check", str(path)]) == 0
    kinds = "1 is learned from, 1 is a repeat that agrees (it confirms, and is not learned again)"
    kinds += " and 1 is ignored for contradicting others"
    said = f"{path}: whole; 3 answers stand: {kinds}.\n"
    assert capsys.readouterr().out == said


def test_merge(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new = tmp_path / "new"
    with AnswerLog(tmp_path / "other", header={"unit": "days"}) as log:
        log.append(Answer(Query("e", LEFT, RIGHT), 1))  # type: ignore[arg-type]
    assert cli.main(["log", "merge", str(path), str(tmp_path / "other"), "--out", str(new)]) == 0
    assert sorted(entry.answer.query.id for entry in AnswerLog.read(new)) == [
        "a",
        "b",
        "c",
        "d",
        "e",
    ]
    assert AnswerLog.read(new).header["unit"] == "days"
    assert cli.main(["log", "merge", str(path), "--out", str(new)]) == 1
    assert "name a new file" in capsys.readouterr().err
    saved = tmp_path / "saved"
    assert cli.main(["log", "merge", str(damage(path)), "--out", str(saved)]) == 1
    assert not saved.exists()
    assert "line 3" in capsys.readouterr().err
    assert cli.main(["log", "merge", "--salvage", str(damage(path)), "--out", str(saved)]) == 1
    assert (
        "1 answers of 1 logs; what stood behind the damage is not among them"
        in capsys.readouterr().out
    )
    assert [entry.answer.query.id for entry in AnswerLog.read(saved)] == ["a"]
    with pytest.raises(SystemExit):
        cli.main(["log", "merge", str(path)])


def test_export(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "table.csv"
    assert cli.main(["log", "export", str(path), "--out", str(table)]) == 0
    told = AnswerLog.read(path).answers()
    read = Answers.from_csv(table)
    assert (read.ids, read.y.tolist(), read.d.tobytes()) == (("a",), [1], told.d.tobytes())
    assert cli.main(["log", "export", str(path), str(path)]) == 0
    first, row, *_ = capsys.readouterr().out.splitlines()
    assert (first, row.split(",")[-1]) == ("id,d_1,d_2,d_3,answer,who", "ann")
    assert read.who == told.who == ("ann",)
    assert cli.main(["log", "export", str(damage(path)), "--out", str(tmp_path / "x")]) == 1
    assert not (tmp_path / "x").exists()
    empty = tmp_path / "empty"
    empty.touch()
    assert cli.main(["log", "export", str(empty)]) == 1
    assert "number of levels" in capsys.readouterr().err
