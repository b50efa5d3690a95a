"""A failure while a question is chosen loses nothing, is reported, and can be tried again."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from elicit import AnswerLog, PolytopeComparator, Session, Subject, choose
from elicit.person.hosts import web, web_app
from elicit.person.hosts.study_web import StudyServer
from elicit.person.hosts.web import WebServer
from elicit.person.interview import Interview, SavedWithoutScreen
from elicit.person.study.study import Study
from tests.study_visitors import Guest
from tests.web_person import Visitor, answer_all

LABELS = ("died", "worse", "ill", "well")
SUBJECT = Subject(LABELS, least=0)
VALUES = {"died": 0.0, "worse": 0.2, "ill": 0.3, "well": 1.0}
VECTORS = np.random.default_rng(0).multinomial(10, [0.25] * 4, 8)


class Broken:
    """An asker that fails once, half way, when it is asked after so many answers.

    Until it is made anew it then goes on failing, as something that is half changed may.
    """

    due: int | None = None
    error: BaseException = RuntimeError("a planted failure")

    def __init__(self, known: Any = ()) -> None:
        self._asker = choose(VECTORS, PolytopeComparator(4), order=True, known=known)
        self._told, self._half_changed = len(known), False

    @property
    def comparator(self) -> Any:
        return self._asker.comparator

    def ask(self) -> Any:
        if self._told == Broken.due or self._half_changed:
            Broken.due, self._half_changed = None, True
            raise Broken.error
        return self._asker.ask()

    def tell(self, answers: Any, on_conflict: Any = "raise") -> Any:
        dropped = self._asker.tell(answers, on_conflict)
        self._told += len(answers)
        return dropped

    def result(self) -> Any:
        return self._asker.result()

    def __deepcopy__(self, memo: Any) -> Any:
        raise TypeError("so nothing is computed ahead, where a failure is left out")


class Panic(BaseException):
    """An error of compiled Rust code, such as Clarabel's: it is no Exception."""


@pytest.fixture(params=[RuntimeError, KeyError, ValueError, np.linalg.LinAlgError, Panic])
def failure(request: pytest.FixtureRequest) -> Iterator[type[BaseException]]:
    """The kind of a failure that can be planted from now on."""
    Broken.due, Broken.error = None, request.param("a planted failure")
    yield request.param
    Broken.due = None


def test_a_failure_after_an_answer_is_reported_and_nothing_is_lost(
    failure: type[BaseException], caplog: pytest.LogCaptureFixture
) -> None:
    with (
        Session(Broken, AnswerLog(k=4, who="ann"), who="ann") as session,
        WebServer(session, SUBJECT) as server,
    ):
        visitor = Visitor(server.new_address())
        screen = answer_all(visitor, VALUES, most=3)
        assert (screen["stage"], screen["answered"]) == ("question", 2)
        Broken.due = 3
        sent = {"do": "answer", "id": screen["question"]["id"], "choice": "a"}
        status, reply = visitor.post(sent)
        assert (status, reply["saved"]) == (500, True)
        assert reply["error"].startswith("Your answer is saved")
        assert "Try again" in reply["error"]
        assert "planted" not in reply["error"]
        assert "the page of ann: the message 'answer'" in caplog.text
        assert "Traceback" in caplog.text
        assert "a planted failure" in caplog.text
        assert len(session.log) == 3
        screen = visitor.screen(**sent)
        assert (screen["answered"], len(session.log)) == (3, 3)
        assert answer_all(visitor, VALUES)["stage"] == "end"


def test_a_failure_before_the_first_question_is_reported_and_can_be_tried_again(
    failure: type[BaseException], caplog: pytest.LogCaptureFixture
) -> None:
    with (
        Session(Broken, AnswerLog(k=4)) as session,
        WebServer(session, SUBJECT) as server,
    ):
        Broken.due = 0
        visitor = Visitor(server.new_address())
        status, reply = visitor.post({"do": "state"})
        # a ValueError may be the message's own fault
        assert (status, "saved" in reply) == (
            400 if issubclass(failure, ValueError) else 500,
            False,
        )
        assert "Try again" in reply["error"]
        assert "a person without a name" in caplog.text
        assert "Traceback" in caplog.text
        assert visitor.screen()["stage"] == "welcome"


def test_a_failure_of_one_person_of_a_study_is_theirs_alone(
    caplog: pytest.LogCaptureFixture,
) -> None:
    Broken.due, Broken.error = None, RuntimeError("a planted failure")
    with ExitStack() as stack:
        people = ("ann", "ben", "chen")
        sessions = {
            who: stack.enter_context(Session(Broken, AnswerLog(k=4, who=who), who=who))
            for who in people
        }
        study = stack.enter_context(Study(sessions, SUBJECT))
        server = stack.enter_context(StudyServer(study))
        guests = {who: Guest(link) for who, link in server.links().items()}
        before = {who: answer_all(guest, VALUES, most=3) for who, guest in guests.items()}
        Broken.due = 3
        sent = {"do": "answer", "id": before["ben"]["question"]["id"], "choice": "b"}
        status, reply = guests["ben"].post(sent)
        assert (status, reply["saved"]) == (500, True)
        assert "the page of ben: " in caplog.text
        assert "the page of ann" not in caplog.text
        assert guests["ann"].screen() == before["ann"]
        assert guests["ben"].screen(**sent)["answered"] == 3
        ends = {who: answer_all(guest, VALUES) for who, guest in guests.items()}
        assert {who: end["stage"] for who, end in ends.items()} == dict.fromkeys(people, "end")


@pytest.mark.parametrize(("do", "note"), [("undo", "already"), ("withdraw", "already")])
def test_what_was_taken_back_before_a_failure_is_said_so(do: str, note: str) -> None:
    Broken.due, Broken.error = None, RuntimeError("a planted failure")
    with (
        Session(Broken, AnswerLog(k=4)) as session,
        Interview(session, SUBJECT) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        for _ in range(2):
            id = screen["question"]["id"]
            screen = interview.handle({"do": "answer", "id": id, "choice": "a"})
        Broken.due = 1
        with pytest.raises(SavedWithoutScreen, match="a planted failure"):
            interview.handle({"do": do, "id": id})
        assert session.log[1].retracted
        again = interview.handle({"do": do, "id": id})
        assert note in again["note"]
        assert (again["stage"], again["answered"]) == ("question", 1)


def test_what_fails_outside_an_interview_is_reported_too(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with (
        Session(Broken, AnswerLog(k=4)) as session,
        WebServer(session, SUBJECT) as server,
    ):
        visitor = Visitor(server.new_address())
        monkeypatch.setattr(web_app, "_file", MagicMock(side_effect=RuntimeError("planted")))
        assert visitor.fetch("GET", "/", cookie=visitor.cookie)[0] == 500
    assert "a request for / could not be answered" in caplog.text
    assert "planted" in caplog.text


def test_a_program_that_ends_while_somebody_waits_says_so(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A slow reply, as while code is compiled: it takes longer than the server waits."""
    monkeypatch.setattr(web, "_FAREWELL", 0.1)
    begun, go_on = threading.Event(), threading.Event()

    def waits(interview: Interview, message: Any) -> Any:
        begun.set()
        go_on.wait(30)
        return {}

    with Session(Broken, AnswerLog(k=4, who="ann"), who="ann") as session:
        server = WebServer(session, SUBJECT)
        visitor = Visitor(server.new_address())
        monkeypatch.setattr(Interview, "handle", waits)
        with ThreadPoolExecutor(1) as pool:
            posted = pool.submit(visitor.post, {"do": "state"})
            assert begun.wait(30)
            server.close()
            status, reply = posted.result(30)
            go_on.set()
    assert (status, reply["saved"]) == (503, True)
    assert reply["error"].startswith("The program was stopped while this was worked out.")
    assert "Try again" in reply["error"]
    assert "the page of ann: the program ended while the message 'state'" in caplog.text
