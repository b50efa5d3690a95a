"""A scripted person at ``qlearn teach``, or at another program that asks in the terminal: reads
what it shows, and answers by hidden values."""

import io
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from elicit._support.background import Background
from qlearn.cli import teach_terminal
from tests.interpreter import ROOT

_TEACH = ("-m", "qlearn", "teach")


class Teach:
    """The command, or another program, with these options, run in a folder, and what it has shown
    so far.

    The person wants the result only, unless an option says how far the questions go.
    """

    def __init__(
        self,
        folder: Path,
        *options: str,
        program: Sequence[str] = _TEACH,
        columns: int = 80,
    ) -> None:
        if program == _TEACH and not {"--until", "--web"} & {*options}:
            options = ("--until", "settled", *options)
        more = {
            "COLUMNS": f"{columns}",
            "PYTHONPATH": str(ROOT),
            "PYTHONUNBUFFERED": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        self.process = subprocess.Popen(
            [sys.executable, *program, *options],
            cwd=folder,
            env={**os.environ, **more},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            # a shell's background job ignores Ctrl+C, and so would what it starts
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        self.shown = self.since = ""  # since the last prompt

    def __enter__(self) -> "Teach":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()

    def prompted(self) -> str:
        """Return the text that is shown up to the next prompt, or to the end."""
        assert self.process.stdout is not None
        since = b""
        while not since.endswith(b"\n> ") and (byte := self.process.stdout.read(1)):
            since += byte
        self.since = since.decode()
        self.shown += self.since
        return self.since

    def say(self, line: str) -> str:
        """Answer the prompt with a line; what is shown up to the next one."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n".encode())
        self.process.stdin.flush()
        return self.prompted()

    def leave(self) -> tuple[int, str]:
        """End the input; the exit code, and the error stream."""
        rest, errors = self.process.communicate(timeout=240)
        self.shown += rest.decode()
        return self.process.returncode, errors.decode()


class Typing(io.StringIO):
    """The input of a truthful person at a command that runs in this process.

    The person sees what the command has shown.
    """

    def __init__(self, shown: Callable[[], str], values: Mapping[str, float]) -> None:
        super().__init__()
        self._shown, self._values = shown, values
        self.text = ""

    def readline(self, size: int | None = -1) -> str:
        """Answer the question that stands last; at the end, end the input."""
        since = self._shown()
        self.text += since
        return "" if "Enter: what was learned" in since else f"{truthful(since, self._values)}\n"


def reads_nothing_beside(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let persons in this process answer before anything is computed beside what they read.

    They are asked the same, which ``tests/elicit/person/test_look_ahead.py`` tries. No notes,
    forecasts or consequences are there.
    """

    def computes_nothing(self: Background, steps: Iterator[Any]) -> None:
        self.stop()

    monkeypatch.setattr(Background, "start", computes_nothing)
    monkeypatch.setattr(teach_terminal, "_PATIENCE", 0.0)  # in vain


def truthful(question: str, values: Mapping[str, float]) -> str:
    """The key of the side that is worth more by the values of the levels, by name; in 80
    columns. An offer to stop is declined.
    """
    if on := re.search(r"^(\d): Go on until it is settled", question, re.MULTILINE):
        return on[1]
    worth = [0.0, 0.0]
    for line in question.splitlines():
        for name, value in values.items():
            if line.startswith(f"  {name} "):
                numbers = re.findall(r"(?<= )\d[\d,]*", line[2 + len(name) :])
                assert len(numbers) == 2, line
                for side in (0, 1):
                    worth[side] += value * int(numbers[side].replace(",", ""))
    return "e" if worth[0] == worth[1] else "a" if worth[0] > worth[1] else "b"


def answer_all(teach: Teach, values: Mapping[str, float], most: int = 1000) -> Sequence[str]:
    """Answer truthfully, so many questions at most, the practice one included, and decline offers
    to stop; the keys of the answers. The prompt after them is open."""
    keys = []
    text = teach.since or teach.prompted()
    while len(keys) < most and "Enter: what was learned" not in text:
        key = truthful(text, values)
        text = teach.say(key)
        if not key.isdecimal():
            keys.append(key)
    return keys
