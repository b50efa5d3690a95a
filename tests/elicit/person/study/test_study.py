"""A study refuses what cannot be one, and its people's work in the background takes turns."""

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from elicit import AnswerLog, PolytopeComparator, Session, Subject, choose
from elicit._support.background import Background, Turns
from elicit.person.study.study import Study

VECTORS = np.random.default_rng(0).multinomial(10, [0.25] * 4, 8)
SUBJECT = Subject(("died", "worse", "ill", "well"), least=0)


def make(known: Any = ()) -> Any:
    return choose(VECTORS, PolytopeComparator(4), order=True, known=known)


def test_what_cannot_be_a_study_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one person"):
        Study({}, SUBJECT)
    log = AnswerLog(k=4)
    with pytest.raises(ValueError, match="share a log"):
        Study({"ann": Session(make, log), "ben": Session(make, log)}, SUBJECT)
    each = {who: Session(make, AnswerLog(k=4)) for who in ("ann\x08", "ann\x07")}
    with pytest.raises(ValueError, match="look alike"):
        Study(each, SUBJECT)
    for message in ({}, {"do": "start"}, {"do": "state", "who": "ann"}):
        with (
            Study({"ann": Session(make, AnswerLog(k=4))}, SUBJECT) as study,
            pytest.raises(ValueError, match="state, agreement or end"),
        ):
            study.handle(message)


def test_agreement_is_computed_anew_only_after_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    sessions = {who: Session(make, AnswerLog(k=4)) for who in ("ann", "ben")}
    with Study(sessions, SUBJECT) as study:
        for who in sessions:
            _first_answer(study, who)
        found = study.agreement()
        assert found["people"] == ["ann", "ben"]
        assert study.agreement() is found
        _first_answer(study, "ben")
        assert study.agreement() is not found


def _first_answer(study: Study, who: str) -> None:
    interview = study.interviews[who]
    screen = interview.handle({"do": "state"})
    while screen["stage"] in ("welcome", "practice"):
        message = (
            {"do": "start"} if screen["stage"] == "welcome" else {"do": "practised", "choice": "a"}
        )
        screen = interview.handle(message)
    interview.handle({"do": "answer", "id": screen["question"]["id"], "choice": "a"})


def test_answers_taken_back_do_not_count_and_repeats_do() -> None:
    sessions = {who: Session(make, AnswerLog(k=4), audit=1) for who in ("ann", "ben")}
    with Study(sessions, SUBJECT) as study:
        _first_answer(study, "ben")
        ann = study.interviews["ann"]
        ann.handle({"do": "practised", "choice": "a"})
        log = sessions["ann"].log
        while not any(entry.repeat for entry in log):
            question = ann.handle({"do": "state"})["question"]
            ann.handle({"do": "answer", "id": question["id"], "choice": "equal"})
        assert study.agreement()["people"] == ["ann", "ben"]
        for who, session in sessions.items():
            study.interviews[who].handle({"do": "withdraw", "id": session.log[0].answer.query.id})
        gone = [entry for entry in log if entry.retracted]
        assert gone[0] is log[0]
        assert all(entry.repeat for entry in gone[1:])  # those that checked it
        assert [one["answered"] for one in study.overview()["people"]] == [len(log) - len(gone), 0]
        assert study.agreement()["people"] == ["ann"]  # nothing of ben's stands
        assert "two people" in study.agreement()["few"]


def test_threads_take_turns_and_wait_for_replies() -> None:
    turns, done, at_once = Turns(), list[int](), list[int]()
    inside = 0
    lock = threading.Lock()

    def steps(who: int) -> Iterator[None]:
        nonlocal inside
        for _ in range(6):
            with lock:
                inside += 1
                at_once.append(inside)
            time.sleep(0.01)
            done.append(who)
            with lock:
                inside -= 1
            yield

    threads = [Background(turns) for _ in range(3)]
    with turns.reply():
        for who, one in enumerate(threads):
            one.start(steps(who))
        time.sleep(0.1)
        assert not done
    until = time.monotonic() + 30
    while len(done) < 18 and time.monotonic() < until:
        time.sleep(0.01)
    assert max(at_once) == 1
    assert all(abs(done[:9].count(who) - 3) <= 1 for who in range(3))  # none is far ahead
    for one in threads:
        one.close()


def test_work_that_was_given_up_while_it_waits_is_not_begun() -> None:
    turns, done = Turns(), list[int]()
    one = Background(turns)
    with turns.reply():
        one.start(done.append(1) for _ in range(3))
        one.close()
    assert not done
    assert turns.take(lambda: False)
    turns.leave()
