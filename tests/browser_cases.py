"""A browser, and sessions on pages for it to open."""

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from elicit import (
    Answer,
    Answers,
    InconsistentAnswers,
    PolytopeComparator,
    Query,
    Session,
    Subject,
    Words,
)

LABELS = ("died", "moderate", "recovered")
PREAMBLE = (
    "The patients are alike at the start. Choose the group that you would rather see, as a whole. "
    "There is no right or "
    "wrong answer. For research on algorithms; not medical advice."
)
WORDS = Words("patients", "fare", "ICU-Sepsis", PREAMBLE, "which is better off?")
_FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def bags(*counts: tuple[Sequence[int], Sequence[int]]) -> list[Query]:
    """Questions of two sides, in counts of one total, worst level first."""
    return [
        Query(f"q{i}", np.array(left) / sum(left), np.array(right) / sum(right))
        for i, (left, right) in enumerate(counts)
    ]


QUESTIONS = bags(*(((0, 10, 0), (10 - n, 0, n)) for n in (4, 6, 5, 7, 8)))


class Listed:
    """An asker of these questions in turn, that knows some answers already."""

    def __init__(self, questions: Sequence[Query], known: Any = ()) -> None:
        self.comparator = PolytopeComparator(len(questions[0].left))
        self._questions, self._told = questions, {entry.answer.query.id for entry in known}
        self._learn([entry.answer for entry in known if entry.used])

    def ask(self) -> Sequence[Query]:
        """The next one."""
        return [query for query in self._questions if query.id not in self._told][:1]

    def tell(
        self, answers: Sequence[Answer], on_conflict: Literal["raise", "drop"] = "raise"
    ) -> None:
        """Learn from these."""
        try:
            self._learn(answers)
        except InconsistentAnswers:
            if on_conflict == "raise":
                raise
        self._told |= {answer.query.id for answer in answers}

    def result(self) -> int:
        """Return the number of questions that were answered."""
        return len(self._told)

    def _learn(self, answers: Sequence[Answer]) -> None:
        said = [answer for answer in answers if answer.verdict is not None]
        if said:
            self.comparator = self.comparator.update(Answers.of(said, self.comparator.k))


def says(answered: int) -> list[str]:
    """Return the result of a ``Listed``, in words."""
    return [
        f"The plan rests on {answered} answers and may lose at most 0.8%.",
        "It differs in 2 of 700 states:",
        "  state 12: dose 3, not 2",
        "  state 40: dose 1, not 4",
    ]


@contextmanager
def served(
    log: Path,
    questions: Sequence[Query] = QUESTIONS,
    labels: Sequence[str] = LABELS,
    words: Words = WORDS,
    port: int = 0,
    ask: type[Listed] = Listed,
    least: int = 0,
    **more: Any,
) -> Iterator[Any]:
    """Start a ``WebServer`` of a session that asks these questions.

    With ``least`` above 0 the interview may add further ones. ``more`` are further parts of its
    Subject.
    """
    from elicit.person.hosts.web import WebServer

    subject = Subject(tuple(labels), words, report=says, least=least, **more)
    with (
        Session(lambda known: ask(questions, known), log) as session,
        WebServer(session, subject, port=port) as server,
    ):
        yield server


def executable() -> str:
    """Return the path of the browser. Without one skip the test, or fail it if CI is set."""
    path = shutil.which("chromium-headless-shell")
    if path is None:
        why = "no chromium-headless-shell: on Debian, apt-get install chromium-headless-shell"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(why)
    return path


@contextmanager
def browser() -> Iterator[Any]:
    """A browser of Playwright's (skips or fails the test where it is not installed)."""
    path = executable()
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        why = "no playwright: pip install 'elicit-qlearn[browser]'"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(why)
    with sync_playwright() as playwright, ExitStack() as stack:
        chromium = playwright.chromium.launch(executable_path=path, args=list(_FLAGS))
        stack.callback(chromium.close)
        yield chromium
