"""A question put again is reported, and nothing else depends on it."""

from typing import Any

import numpy as np
import pytest

from elicit import (
    AnswerLog,
    Interview,
    PolytopeComparator,
    Query,
    Session,
    Subject,
    TruthfulTutor,
    Verdict,
    choose,
    merge_logs,
    tutor_report,
)
from elicit.tutors.answer_log import EXPECTED, REPEATS
from qlearn.cli.main import main

K = 5
VECTORS = np.random.default_rng(0).multinomial(20, np.ones(K) / K, 14).astype(float)


def make(known: Any) -> Any:
    return choose(VECTORS, PolytopeComparator(K), order=True, known=known)


def says(query: Query) -> Verdict | None:
    return TruthfulTutor([0, 10, 11, 40, 99])(query).verdict


def answer(session: Session, most: int = 1000, other: bool = False) -> list[str]:
    """Answer at most so many questions, and return their ids.

    If ``other``, a repeated question gets the opposite answer.
    """
    ids: list[str] = []
    while len(ids) < most and (query := session.question()):
        waits = session.next_told()
        assert waits is not None
        verdict = says(query)
        repeats = query.id != waits.id
        session.answer(query.id, -verdict if verdict is not None and repeats and other else verdict)
        ids.append(query.id)
        assert session.log[-1].repeat == repeats
    return ids


def told(log: AnswerLog, repeats: bool = True) -> list[Any]:
    return [
        (e.answer.query.id, e.answer.verdict, e.used)
        for e in log
        if not e.retracted and (repeats or not e.repeat)
    ]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.jsonl"


@pytest.mark.parametrize("other", [False, True])
def test_the_asker_asks_and_ends_as_without(path, other):
    plain = Session(make, AnswerLog())
    answer(plain)
    with Session(make, path, audit=0.7, seed=1) as session:
        answer(session, other=other)
        status, log = session.status(), session.log
        again = [entry for entry in log if entry.repeat]
        assert len(again) == status.repeated >= 3
        assert status.alike == (0 if other else len(again))
        assert status.answered == len(plain.log) == len(log) - len(again)
        assert status.unused == 0
        assert told(log, repeats=False) == told(plain.log)
        assert session.conflicts() == ()
        assert session.result().answers.ids == plain.result().answers.ids
        assert session.result().order == plain.result().order
        assert str(status).endswith(f", {status.alike} of {status.repeated} repeats as before")
    entries = [*AnswerLog.read(path)]
    for i, entry in enumerate(entries):
        if entry.repeat:
            before = [e.answer for e in entries[:i] if not e.repeat]
            (first,) = (said for said in before if said.query.id == entry.metadata[REPEATS])
            assert first is not before[-1]
            assert first.query.d.tolist() == entry.answer.query.d.tolist()
            assert (entry.metadata[EXPECTED], entry.used) == (first.verdict, False)
            assert not entries[i - 1].repeat
    assert len({entry.metadata[REPEATS] for entry in entries if entry.repeat}) == status.repeated
    # whoever is given the log learns the first answers
    assert make(AnswerLog.read(path)).result().order == plain.result().order
    assert make(AnswerLog.read(path)).ask() == ()


@pytest.mark.slow
def test_left_before_every_question_and_undone_it_is_the_same(path):
    with Session(make, AnswerLog(), audit=0.7, seed=1) as session:
        ids = answer(session)
    for name in ids:
        with Session(make, path, audit=0.7, seed=1) as session:
            assert session.question().id == name
            answer(session, 1)
            assert session.undo().query.id == name
            assert session.question().id == name
            session.answer(name, says(session.question()))
            session.answer(name, says(session.log[-1].answer.query))  # sent twice
    with Session(make, path, audit=0.7, seed=1) as session:
        assert session.question() is None
        assert session.log.restarted == 0
        assert [row[0] for row in told(session.log)] == ids
        for name in reversed(ids):
            assert session.undo().query.id == name
            assert session.question().id == name
        assert session.status().answered == session.status().repeated == 0


def test_after_the_first_was_withdrawn_it_can_be_answered_anew(path):
    with Session(make, path, audit=0.7, seed=1) as session:
        answer(session)
        again = next(entry for entry in session.log if entry.repeat)
        session.withdraw(again.metadata[REPEATS])
        repeats = session.status().repeated
        answer(session)
        assert session.status().repeated >= repeats
        assert session.question() is None
        repeats = session.status().repeated
        another = next(entry for entry in session.log if entry.repeat and entry.stands)
        session.withdraw(another.answer.query.id)  # and not the answer that it checks
        assert (session.status().withdrawn, session.status().repeated) == (1, repeats - 1)
        before = told(session.log)
    with Session(make, path, audit=0.7, seed=1) as session:
        assert told(session.log) == before


def test_a_repeat_is_taken_back_with_the_answer_that_it_checks(path):
    with Session(make, path, audit=0.7, seed=1) as session:
        answer(session)
        log = session.log
        again = next(entry for entry in log if entry.repeat)
        first = again.metadata[REPEATS]
        repeated, answered = session.status().repeated, session.status().answered
        others = [e for e in log if e.answer.query.id not in (first, again.answer.query.id)]
        session.withdraw(first)
        assert {e.answer.query.id for e in log if e.retracted} == {first, again.answer.query.id}
        assert all(e.stands for e in others)
        assert session.status().repeated == repeated - 1
        assert session.status().answered == answered - 1
    assert [e.retracted for e in AnswerLog.read(path)] == [e.retracted for e in log]


def test_programs_that_read_the_log_tell_them_apart(path, capsys):
    with Session(make, path, audit=0.7, seed=1) as session:
        answer(session, other=True)
        n, repeats = session.status().answered, session.status().repeated
    report = tutor_report(AnswerLog.read(path))
    assert (report.unused, report.repeated, report.couples) == (0, repeats, repeats)
    assert report.consistency.value == 0.0
    assert main(["log", "check", str(path)]) == 0
    sentence = f"{n + repeats} answers stand: {n} are learned from and {repeats} are repeats that "
    assert sentence in capsys.readouterr().out
    assert main(["log", "show", str(path)]) == 0
    shown = capsys.readouterr().out
    assert shown.count(", repeat ") == repeats
    assert sentence in shown  # the same count
    merge_logs([AnswerLog.read(path)], path.with_suffix(".merged"))
    with Session(make, path.with_suffix(".merged")) as session:
        assert session.question() is None
        assert (session.status().answered, session.status().repeated) == (n, repeats)


def test_an_interview_does_not_say_that_a_question_is_one():
    notes, numbers, log = [], [], AnswerLog()
    with (
        Session(make, log, audit=0.7, seed=1) as session,
        Interview(session, Subject(tuple("abcde"), least=0)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        while screen["stage"] == "question":
            question = screen["question"]
            numbers.append(question["number"])
            query = session.question()
            assert query is not None
            assert question["id"] == query.id
            assert question["check"] == ""
            shown = log.asked[-1]
            assert shown.query.id == query.id
            verdict = says(query)
            choice = "equal" if verdict == 0 else "a" if (verdict == 1) != shown.swapped else "b"
            screen = interview.handle({"do": "answer", "id": query.id, "choice": choice})
            notes.append(screen["note"])
            assert screen["last"]["id"] == query.id
            if log[-1].repeat and len(notes) < 12:
                screen = interview.handle({"do": "undo", "id": query.id})
                same = screen["question"]["check"]
                assert same.startswith("This is the same check again, because you took back ")
                before = log[-1].metadata[REPEATS]
                n = interview.handle({"do": "answers"})["answers"]
                number = next(one["number"] for one in n if one["id"] == before)
                assert f"Your answer to question {number} still stands." in same
                assert screen["question"] == {**question, "check": same}
                screen = interview.handle({"do": "answer", "id": query.id, "choice": choice})
        repeats = session.status().repeated
        assert {*notes} == {None}  # nothing is said of a repeat that was answered as before
        assert max(numbers) == len(notes)
        assert screen["answered"] == screen["end"]["counts"]["answered"] == len(notes)
        given = screen["end"]["given"]
        assert given.startswith(f"{len(notes)} answers stand: {len(notes) - repeats} are learned ")
        assert f" and {repeats} are repeats that agree (they confirm, and are " in given
        assert (
            screen["end"]["counts"]["repeated"] == screen["end"]["counts"]["alike"] == repeats >= 3
        )
        answers = interview.handle({"do": "answers"})["answers"]
        assert [one["repeat"] for one in answers] == [entry.repeat for entry in log]
    # sides are at random anew
    sides: dict[str, set[bool]] = {}
    for asked in log.asked:
        sides.setdefault(asked.query.id.removesuffix(" again"), set()).add(asked.swapped)
    assert any(len(both) == 2 for both in sides.values())


def test_numbers_stay_when_answers_are_taken_back(tmp_path, capsys):
    path = tmp_path / "log.jsonl"
    with (
        Session(make, path, audit=1, seed=1) as session,
        Interview(session, Subject(tuple("abcde"))) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        settled = taken_back = 0
        while settled < 2 or len(session.log) < 14:
            if screen["stage"] == "conflict":
                id = screen["conflict"]["id"]
                settled += 1
                meant = screen["conflict"]["choices"][settled % 2]["choice"]
                screen = interview.handle({"do": "settle", "id": id, "choice": meant})
                continue
            assert screen["stage"] == "question"
            query = session.question()
            verdict, swapped = says(query), session.log.asked[-1].swapped
            if session.is_repeat(query.id) and settled < 2:
                verdict = Verdict.BETTER if verdict != Verdict.BETTER else Verdict.WORSE
            choice = "equal" if verdict == 0 else "a" if (verdict == 1) != swapped else "b"
            screen = interview.handle({"do": "answer", "id": query.id, "choice": choice})
            if not taken_back and not session.log[-1].repeat:
                screen = interview.handle({"do": "undo", "id": query.id})
                taken_back += 1
        screen = interview.handle({"do": "result"})
        found = interview.handle({"do": "answers"})["answers"]
        numbers = [one["number"] for one in found]
        first: dict[str, int] = {}
        for one in found:  # a question has one number, also when it is put anew
            name = one["id"].removeprefix("settled/")
            assert one["number"] == first.setdefault(name, len(first) + 1)
        gone = [one for one in found if not one["stands"]]
        # of the two checks that differed, the first answer was kept once, and the second once
        counts = screen["end"]["counts"]
        assert [one["status"] for one in gone].count("not kept") == counts["not kept"] == 2
        assert [one["repeat"] for one in gone].count(True) == 1
        assert counts["withdrawn"] == len(gone) - 2 >= 1
        stand = [one["status"] for one in found if one["stands"]]
        kinds = {"agrees": "agreeing", "differs": "differing", "ignored": "unused"}
        for status in ("agrees", "differs", "cannot tell", "ignored"):
            assert stand.count(status) == counts[kinds.get(status, status)]
        learned = stand.count("learned from")
        assert screen["saved"] == counts["answered"] == len(stand) > learned
        assert f"{len(stand)} answers stand: {learned} are learned from" in screen["end"]["given"]
        remarks = {remark for one in found for remark in one["remarks"]}
        assert {"not kept: another answer replaces it", "what you meant, after a check"} <= remarks
        assert sum(remark.startswith("not kept: you meant answer ") for remark in remarks) == 1
        assert sum(remark.endswith(": you meant this answer") for remark in remarks) == 1
        rows = interview.table("answers")
        assert [row["status"] for row in rows] == [one["status"] for one in found]
        assert [row["used"].startswith("no: ") for row in rows] == [
            not one["stands"] or one["status"] in ("cannot tell", "ignored") for one in found
        ]
        assert sum(row["taken_back"] for row in rows) == counts["withdrawn"]
        assert [row["number"] for row in interview.table("answers")] == numbers
        page = interview.handle({"do": "report"})["html"]
    assert page.count("<s>") == len(gone)
    back = f"{counts['withdrawn']} taken back, {counts['not kept']} not kept"
    assert f"oldest first ({screen['saved']} that stand, {back})" in page
    assert f"{screen['end']['given']} {screen['end']['checks']}" in page
    assert main(["log", "show", str(path)]) == 0
    rows = capsys.readouterr().out.splitlines()[2:-1]
    assert [int(row.split()[0]) for row in rows] == numbers
    assert sum(", taken back" in row for row in rows) == counts["withdrawn"]
    assert sum(", not kept" in row for row in rows) == counts["not kept"]


def test_what_is_no_share():
    with pytest.raises(ValueError, match="audit"):
        Session(make, AnswerLog(), audit=1.5)
