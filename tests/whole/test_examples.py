"""The programs in examples/ do what they say, with a scripted person."""

import gc
import http.client
import json
import runpy
import sys
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from elicit import AnswerLog
from tests.interpreter import ROOT
from tests.scripted_person import Teach, truthful

EXAMPLES = ROOT / "examples"
PROMPT = "\n> "
VALUES = {"died": 0.0, "severe": 4.0, "mild": 7.0, "well": 10.0}


def example(folder: Path, name: str, *options: str) -> Teach:
    return Teach(folder, *options, program=("-W", "error", str(EXAMPLES / name)))


def answer_all(run: Teach, values: dict[str, float]) -> int:
    """Answer truthfully until the program ends; how many questions there were."""
    n, text = 0, run.since or run.prompted()
    while text.endswith(PROMPT):
        text = run.say(truthful(text, values))
        n += 1
    code, errors = run.leave()
    assert not code, errors
    return n


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_is_short_and_says_what_it_shows(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 80
    assert lines[0].startswith('"""')
    assert f"    python examples/{path.name}" in lines[2]


class Keys(StringIO):
    """The input of a person who types these keys at a program that runs in this process.

    For None they answer truthfully; after the last key they leave.
    """

    def __init__(self, shown, values, keys):
        super().__init__()
        self.shown, self.values, self.keys, self.since = shown, values, iter(keys), []

    def readline(self, size=-1):
        self.since.append(self.shown())
        key = next(self.keys, "")
        if key is None:
            key = truthful(self.since[-1], self.values)
        return key and f"{key}\n"


def test_a_session_is_left_and_resumed_in_this_process(tmp_path, monkeypatch, capsys):
    def shown():
        return capsys.readouterr().out

    def typed(*keys):
        typing = Keys(shown, VALUES, keys)
        monkeypatch.setattr(sys, "stdin", typing)
        runpy.run_path(str(EXAMPLES / "resume_a_session.py"), run_name="__main__")
        gc.collect()  # which closes the log, as the end of a process does
        return [*typing.since, shown()]

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["resume_a_session.py"])
    said = typed("u", "x", None, "u", None)  # nothing to undo, no answer, and one undone
    assert truthful(said[0], VALUES) == truthful(said[4], VALUES)
    assert "Left. a question waits: 1 answered, 1 taken back." in said[-1]
    said = typed(*[None] * 4)
    assert "1 answered" in said[0]
    assert "Best first: tablets, watch, diet, surgery then tablets, injections" in said[-1]
    with AnswerLog.read(tmp_path / "answers.jsonl") as log:
        standing = [entry.answer.query.id for entry in log if not entry.retracted]
    assert len(set(standing)) == len(standing) == 5


@pytest.mark.slow
def test_a_session_is_left_and_resumed_and_asks_nothing_twice(tmp_path):
    with example(tmp_path, "resume_a_session.py") as run:
        run.prompted()
        first = run.since
        run.say("u")  # nothing to undo
        run.say("x")
        run.say(truthful(run.since, VALUES))
        run.say("u")
        assert truthful(run.since, VALUES) == truthful(first, VALUES)
        run.say(truthful(run.since, VALUES))
        code, errors = run.leave()
        assert not code, errors
        assert "Left. a question waits: 1 answered, 1 taken back." in run.shown
    with example(tmp_path, "resume_a_session.py") as run:
        assert "1 answered" in run.prompted()
        assert answer_all(run, VALUES) == 4
        assert (
            "Best first: tablets, watch, diet, surgery then tablets, injections, surgery."
            in run.shown
        )
    with AnswerLog.read(tmp_path / "answers.jsonl") as log:
        standing = [entry.answer.query.id for entry in log if not entry.retracted]
    assert len(set(standing)) == len(standing) == 5


@pytest.mark.slow
def test_one_log_serves_three_comparators(tmp_path):
    values = {"died": 0.0, "severe": 3.0, "moderate": 5.0, "mild": 8.0, "well": 10.0}
    with example(tmp_path, "one_log_three_comparators.py", "other.jsonl") as run:
        n = answer_all(run, values)
        orders = [
            line.split(";")[0] for line in run.shown.splitlines() if line.startswith("Best first")
        ]
        assert n == 9
        assert len(orders) == 3
        assert len(set(orders)) == 1
        assert "polytope: knew 0 answers and asked for 5 more." in run.shown
        assert "polytope, one wrong: knew 5 answers and asked for 4 more." in run.shown
        assert "posterior: knew 9 answers and asked for 0 more." in run.shown
        assert "do not go together" not in run.shown


class Browser:
    """A browser's part: opens the address, keeps the cookie, and sends messages."""

    def __init__(self, address: str) -> None:
        self.place = urlsplit(address)
        self.cookie = ""
        status, headers, _ = self._request("GET", f"/?{self.place.query}")
        assert status == 303
        self.cookie = headers["Set-Cookie"].split(";")[0]

    def say(self, **message: str) -> Any:
        """The reply to a message."""
        status, _, body = self._request("POST", "/api", json.dumps(message))
        assert status == 200, body
        return json.loads(body)

    def _request(self, method: str, path: str, body: str | None = None) -> tuple[int, Any, bytes]:
        connection = http.client.HTTPConnection(self.place.netloc, timeout=240)
        origin = (
            {"Origin": f"http://{self.place.netloc}", "Content-Type": "application/json"}
            if body
            else {}
        )
        try:
            connection.request(method, path, body, {"Cookie": self.cookie, **origin})
            response = connection.getresponse()
            return response.status, response.headers, response.read()
        finally:
            connection.close()


@pytest.mark.slow
def test_the_page_is_served_from_a_program_answered_and_stopped(tmp_path):
    values = {"standing still": 0, "in repair": 1, "slow": 8, "running well": 10}
    with example(tmp_path, "serve_the_page.py", "answers.jsonl", "0") as run:
        browser = Browser(run.process.stdout.readline().decode())
        screen = browser.say(do="practised", choice="a")
        while asked := screen["question"]:
            a, b = (sum(values[row["label"]] * row[side] for row in asked["rows"]) for side in "ab")
            screen = browser.say(do="answer", id=asked["id"], choice="a" if a > b else "b")
        statements = screen["end"]["statements"]
        assert statements[0] == "The plan: good: run, worn: run, broken: repair."
        assert run.process.poll() is None
        run.say("")
        code, errors = run.leave()
        assert not code, errors
        assert "finished: 5 answered" in run.shown
        assert all(line in run.shown for line in statements)
