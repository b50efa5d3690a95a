"""``qlearn teach --web --people`` as it runs, killed and started again, and ``qlearn report``."""

import csv
import json
import random
import re
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from http.client import HTTPException
from io import StringIO
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from elicit import AnswerLog
from qlearn import draw_values
from qlearn.cli.main import main
from tests.scripted_person import Teach
from tests.study_visitors import Guest, TeachStudy
from tests.web_person import answer_all, untimed

PEOPLE = ("ann", "ben", "chen")
LEVELS = [f"level {i}" for i in range(1, 6)]
VALUES = {
    who: dict(zip(LEVELS, draw_values(5, seed).tolist(), strict=True))
    for who, seed in zip(PEOPLE, (7, 8, 9), strict=True)
}
FINE = ("--problem", "random", "--comparator", "polytope", "--days", "20", "--tolerance", "0.001")
TABLE = "name,died,ill,well\nold,2,3,5\nnew,3,1,6\nnone,1,8,1\n"


def log_of(folder: Path, who: str) -> Path:
    return folder / f"answers-random-{who}.jsonl"


def told(log: Path) -> list[tuple[Any, ...]]:
    """The answers of a log, and whose each is."""
    if not log.exists():
        return []
    return [
        (e.answer.query.id, e.answer.verdict, e.used, e.retracted, e.answer.who)
        for e in AnswerLog.read(log)
    ]


def all_answer(links: dict[str, str], taken: dict[str, list[str]]) -> dict[str, Any]:
    """Let all people answer at once, each to the end. Returns the last screens, or None."""

    def one(who: str) -> Any:
        try:
            return answer_all(Guest(links[who]), VALUES[who], acknowledged=taken[who].append)
        except (OSError, HTTPException, AssertionError, ValueError):
            return None

    with ThreadPoolExecutor(len(PEOPLE)) as pool:
        return dict(zip(PEOPLE, pool.map(one, PEOPLE), strict=True))


def killed(folder: Path, kills: int, seed: int) -> dict[str, int]:
    """Kill a study so many times while three people answer, and go on each time.

    Returns how often it was killed while somebody answered, and how many answers there were.
    """
    calm = folder / "calm"
    calm.mkdir()
    begun = time.monotonic()
    with TeachStudy(calm, ",".join(PEOPLE), *FINE) as teach:
        starting = time.monotonic() - begun
        ends = all_answer(teach.links, {who: [] for who in PEOPLE})
        answering = time.monotonic() - begun - starting
    expected = {who: told(log_of(calm, who)) for who in PEOPLE}
    assert all(len(found) > 5 for found in expected.values())
    chance, done, while_answering, answers, round_ = random.Random(seed), 0, 0, 0, 0
    while done < kills:
        here = folder / f"{round_}"
        here.mkdir()
        round_ += 1
        taken: dict[str, list[str]] = {who: [] for who in PEOPLE}
        screens: dict[str, Any] = dict.fromkeys(PEOPLE)
        while None in screens.values():
            if done < kills and chance.random() < 0.15:
                with Teach(here, "--web", "--people", ",".join(PEOPLE), *FINE):
                    time.sleep(chance.uniform(0, 1.2 * starting))
                done += 1
            with TeachStudy(here, ",".join(PEOPLE), *FINE) as teach:
                timer = threading.Timer(chance.uniform(0, answering), teach.process.kill)
                if done < kills:
                    timer.start()
                screens = all_answer(teach.links, taken)
                timer.cancel()
                if None in screens.values():
                    done += 1
                    while_answering += 1
            for who in PEOPLE:
                found = told(log_of(here, who))
                kept = [row[0] for row in found]
                assert kept[: len(taken[who])] == taken[who]  # nothing acknowledged is lost
                assert len(taken[who]) <= len(kept) <= len(taken[who]) + 1
                assert len({*kept}) == len(kept)
                assert {row[-1] for row in found} <= {who}  # nothing is in another's log
                assert found == expected[who][: len(found)]
                taken[who] = kept
        for who in PEOPLE:
            assert told(log_of(here, who)) == expected[who]
            assert untimed(screens[who]["end"]) == untimed(ends[who]["end"])
            answers += len(expected[who])
    return {"while answering": while_answering, "killed": done, "answers": answers}


@pytest.mark.slow
def test_killed_while_three_answer_nothing_is_lost_nor_in_the_wrong_log(tmp_path: Path) -> None:
    assert killed(tmp_path, 2, seed=1)["killed"] >= 2


@pytest.mark.slow
def test_killed_fifty_times_nothing_is_lost_nor_in_the_wrong_log(tmp_path: Path) -> None:
    found = killed(tmp_path, 50, seed=2)
    print(found)
    assert found["killed"] >= 50


@pytest.mark.slow
def test_a_study_goes_on_and_old_links_say_what_to_do(tmp_path: Path) -> None:
    options = ("--problem", "random", "--comparator", "polytope", "--tolerance", "0.05")
    with TeachStudy(tmp_path, "Dr. Ann,ben", *options) as teach:
        old, port = Guest(teach.links["Dr. Ann"]), teach.links["ben"].split("/")[2].split(":")[1]
        screen = answer_all(old, VALUES["ann"], most=3)
        code, rest, errors = teach.interrupt()
    assert (code, "Traceback" in errors) == (0, False)
    assert rest.startswith("Kept: Dr. Ann 2 answers, ben 0 answers.\nTo go on:\n  qlearn teach")
    assert "--people 'Dr. Ann,ben'" in rest
    assert "qlearn report answers-random-Dr-Ann.jsonl answers-random-ben.jsonl --out" in rest
    with TeachStudy(tmp_path, "ben,Dr. Ann", *options, "--port", port) as teach:
        for path in ("/", f"/?{old.at.query}"):  # the old cookie, the old link
            status, _, body = old.fetch("GET", path, cookie=old.cookie)
            assert (status, b"Ask whoever runs the study for a new link" in body) == (403, True)
        again = Guest(teach.links["Dr. Ann"]).screen()
        assert (again["answered"], again["question"]) == (2, screen["question"])
        said = refused_as_running(tmp_path)
        assert "answers-random-" in said
        teach.interrupt()


def refused_as_running(folder: Path) -> str:
    """Return the message of the command if the logs are in use."""
    with Teach(folder, "--web", "--people", "ben", "--problem", "random") as other:
        code, errors = other.leave()
    assert code == 1
    return errors


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("ann,,ben", "is blank"),
        (" , ", "is blank"),
        ("", "is blank"),
        ("ann,ann", "would share a log"),
        ("Ann,ann", "would share a log"),
        ("a b,a-b", "would share a log"),
        ("../x,x", "would share a log"),
        ("\u00e9,e\u0301", "would share a log"),
        ("x" * 81, "1 to 80 characters"),
        ("\u6f22" * 79, "too long for a file's name"),
        (",".join(f"p{i}" for i in range(51)), "at most 50 people"),
    ],
)
def test_names_that_cannot_be(
    names: str, said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("qlearn.cli.teach.run", lambda **_: 0)
    with pytest.raises(SystemExit) as stopped:
        main(["teach", "--web", "--people", names])
    assert stopped.value.code == 2
    assert said in " ".join(capsys.readouterr().err.split())


def test_options_that_are_for_one_person(capsys: pytest.CaptureFixture[str]) -> None:
    for options, said in (
        (("--people", "ann,ben"), "add --web"),
        (("--web", "--invite", "2", "--log", "x.jsonl"), "--log is for one person"),
        (("--web", "--invite", "2", "--who", "ann"), "--who is for one person"),
        (("--web", "--invite", "2", "--questions", "9"), "--questions is for one person"),
        (("--web", "--invite", "2", "--until", "settled"), "--until is for one person"),
    ):
        assert main(["teach", *options]) == 1
        assert said in " ".join(capsys.readouterr().err.split())
    for wrong in (("--invite", "0"), ("--invite", "51"), ("--invite", "2", "--people", "ann,ben")):
        with pytest.raises(SystemExit):
            main(["teach", "--web", *wrong])


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the logs of two people who chose always A, or always B, of a table."""
    folder = tmp_path_factory.mktemp("answered")
    with pytest.MonkeyPatch.context() as here, redirect_stdout(StringIO()):
        here.chdir(folder)
        Path("care.csv").write_text(TABLE)
        for who, key in (("ann", "a"), ("<b>ben</b>", "b")):
            here.setattr(sys, "stdin", StringIO(f"{key}\n1\n" * 7))
            options = ("--problem", "care.csv", "--unit", "patients", "--seed", "2", "--who", who)
            assert main(["teach", *options]) == 0
    return folder


@pytest.fixture
def logs(answered: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The logs of these people, in the current folder."""
    copytree(answered, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return ["answers-care-ann.jsonl", "answers-care-b-ben-b.jsonl"]


def test_a_report_has_everything_and_leaves_the_logs_as_they_are(
    logs: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    before = [Path(log).read_bytes() for log in logs]
    assert main(["report", *logs, "--out", "found"]) == 0
    assert "following.csv" in capsys.readouterr().out
    assert [Path(log).read_bytes() for log in logs] == before
    html = Path("found/report.html").read_text()
    for said in (
        "What the levels are worth to each",
        "Questions that divide these people most",
        "What it costs to follow one another",
        "What this does not say",
        "Comparator",
        "Seed",
        "Version",
        "care.csv",
        *logs,
    ):
        assert said in html, said
    assert "<b>ben" not in html  # a name is text
    assert "&lt;b&gt;ben" in html
    assert not re.search(r"<script|https?://|src=", html)
    for name, columns in (
        ("scales", {"person", "level", "value", "low", "high"}),
        ("choices", {"person", "alternative", "choice"}),
        ("answers", {"person", "a: well", "b: died", "chosen", "used"}),
        ("following", {"person", "follows", "loss", "at_most"}),
    ):
        rows = json.loads(Path(f"found/{name}.json").read_text())
        assert columns <= {*rows[0]}
        assert {row["person"] for row in rows} == {"ann", "<b>ben</b>"}
        table = Path(f"found/{name}.csv").read_text().splitlines()
        assert len([*csv.DictReader(table)]) == len(rows)
    for row in json.loads(Path("found/following.json").read_text()):
        assert 0 <= row["loss"] <= row["at_most"] + 1e-6
        assert row["loss"] == 0 or row["person"] != row["follows"]
    counts = [len(AnswerLog.read(log)) for log in logs]
    assert len(json.loads(Path("found/answers.json").read_text())) == sum(counts)


def test_at_the_end_it_says_how_many_answers_of_each_were_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("care.csv").write_text(TABLE)

    def served(make: Any, *_: Any, people: Any, **__: Any) -> None:
        """Three people answer, of whom the last takes the first answer back."""
        assert people == ("ann", "ben", "chen")
        study = make()
        for who, n in (("ben", 1), ("chen", 3)):
            interview = study.interviews[who]
            screen = interview.handle({"do": "practised", "choice": "a"})
            first = screen["question"]["id"]
            for _ in range(n):
                told = {"id": screen["question"]["id"], "choice": "cannot tell"}
                screen = interview.handle({"do": "answer", **told})
        interview.handle({"do": "withdraw", "id": first})

    monkeypatch.setattr("elicit.person.hosts.study_web.serve_study", served)
    options = ("--problem", "care.csv", "--unit", "patients", "--web")
    assert main(["teach", *options, "--people", "ann,ben,chen"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("Kept: ann 0 answers, ben 1 answer, chen 2 answers.\nTo go on:\n  ")
    assert "qlearn report answers-care-ann.jsonl answers-care-ben.jsonl" in said


def test_logs_that_make_no_report_are_named(
    logs: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*options: str) -> str:
        assert main(["report", *options]) == 1
        return " ".join(capsys.readouterr().err.split())

    assert "qlearn result answers-care-ann.jsonl" in said(logs[0])
    assert "both of 'ann'" in said(logs[0], logs[0])
    assert "none.jsonl" in said(logs[0], "none.jsonl")
    with AnswerLog("plain.jsonl", 3, who="chen") as plain:
        plain.mark_restart()
    assert "plain.jsonl is about another problem" in said(logs[0], "plain.jsonl")
    for who, comparator in (("dan", "polytope"), ("eve", "posterior")):
        recipe = {"problem": "care.csv", "comparator": comparator, "unit": "patients"}
        header = {**AnswerLog.read(logs[0]).header, "recipe": recipe}
        kept = {n: header[n] for n in ("labels", "unit", "problem", "recipe")}
        with AnswerLog(f"{who}.jsonl", 3, kept, who) as empty:
            empty.mark_restart()
    assert "choose one with --comparator" in said("dan.jsonl", "eve.jsonl")
    assert main(["report", "dan.jsonl", "eve.jsonl", "--comparator", "polytope"]) == 0
    assert "once two people have answered" in Path("study/report.html").read_text()
    assert not Path("none.jsonl").exists()
    Path("frida.jsonl").touch()  # of somebody who never came
    assert main(["report", *logs, "frida.jsonl"]) == 0
    assert "frida" in Path("study/report.html").read_text()
