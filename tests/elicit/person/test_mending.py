"""A question that comes again says so if its answer was taken back, and a check does not."""

from typing import Any

import pytest

from elicit import AnswerLog, Interview, Session, Subject
from elicit.person.course.counts import Counts, number_of
from elicit.person.course.level_questions import GUARDS
from tests.browser_cases import LABELS, QUESTIONS, Listed

SAME = "This is the same question again, because you took back your answer to it"


def choice(session: Session, value: float) -> str:
    """Return the choice on the screen of whoever values the middle level so."""
    query, swapped = session.question(), session.log.asked[-1].swapped
    assert query is not None
    apart = float(query.d @ [0.0, value, 1.0])
    return "equal" if abs(apart) < 1e-9 else "a" if (apart > 0) != swapped else "b"


@pytest.mark.parametrize("least", [0, 5])
def test_a_question_that_earlier_answers_decide_does_not_lead_to_that_answer(least: int) -> None:
    """Shares of .4, .6, .5, .7 and .8 of the best level are compared with the middle one."""
    subject, found = Subject(LABELS, least=least), {}
    with (
        Session(lambda known: Listed(QUESTIONS, known), AnswerLog(), audit=0) as session,
        Interview(session, subject) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        while screen["stage"] == "question" and screen["question"]["id"].startswith("q"):
            id = screen["question"]["id"]
            assert screen["question"]["check"] == ""
            why = interview.handle({"do": "outlook", "id": id})["why"]
            found[id] = GUARDS in why
            assert not (found[id] and len(why) > 1)
            said = choice(session, 0.65)
            screen = interview.handle({"do": "answer", "id": id, "choice": said})
        decided = [id for id, implied in found.items() if implied]
        assert decided == (["q2", "q4"] if least else [])  # .6 < value, then value < .7


def test_a_question_that_one_earlier_answer_decides_speaks_of_one_answer() -> None:
    """A choice between .6 of the best level and the middle one decides that with .4."""
    with (
        Session(lambda known: Listed(QUESTIONS[1::-1], known), AnswerLog(), audit=0) as session,
        Interview(session, Subject(LABELS)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        screen = answered(interview, screen, choice(session, 0.65))
        id = screen["question"]["id"]
        assert screen["question"]["check"] == ""
        assert interview.handle({"do": "outlook", "id": id})["why"] == [GUARDS]


def test_a_question_that_comes_again_keeps_its_number_and_says_why() -> None:
    with (
        Session(lambda known: Listed(QUESTIONS, known), AnswerLog(), audit=0) as session,
        Interview(session, Subject(LABELS, least=0)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        for n in (1, 2, 3):
            assert (screen["question"]["number"], screen["question"]["check"]) == (n, "")
            screen = answered(interview, screen, choice(session, 0.65))
        assert screen["question"]["number"] == 4
        back = interview.handle({"do": "withdraw", "id": "q1"})
        assert (back["question"]["id"], back["question"]["number"]) == ("q1", 2)
        assert back["question"]["check"].startswith(SAME)
        assert back["note"] == "Taken back. The other answers stay."
        assert back["answered"] == 2
        back = interview.handle({"do": "withdraw", "id": "q0"})
        assert back["question"]["number"] == 1
        assert number_of(session.log, "q2") == 3  # as before
        for n, after in ((1, 2), (2, 4)):
            assert back["question"]["number"] == n
            back = answered(interview, back, choice(session, 0.65))
            assert back["question"]["number"] == after
        assert back["question"]["check"] == ""
        list_ = interview.handle({"do": "answers"})["answers"]
        assert [(one["id"], one["number"], one["withdrawn"]) for one in list_] == [
            ("q0", 1, True),
            ("q1", 2, True),
            ("q2", 3, False),
            ("q0", 1, False),
            ("q1", 2, False),
        ]


def test_where_another_question_comes_after_one_was_taken_back_it_is_said() -> None:
    makes = [QUESTIONS]  # then the second one comes last

    def make(known: Any) -> Listed:
        return Listed(makes.pop() if makes else [*QUESTIONS[::2], *QUESTIONS[1::2]], known)

    with (
        Session(make, AnswerLog(), audit=0) as session,
        Interview(session, Subject(LABELS, least=0)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        for _ in range(2):
            screen = answered(interview, screen, "a")
        back = interview.handle({"do": "withdraw", "id": "q1"})
        assert back["question"]["id"] == "q2"
        assert back["note"].endswith(" Another question comes now.")
        assert back["question"]["number"] == 3  # the second is taken


def test_a_question_whose_answer_was_taken_back_comes_again_at_once() -> None:
    makes = [QUESTIONS]  # then the second one comes last

    def make(known: Any) -> Listed:
        return Listed(makes.pop() if makes else [*QUESTIONS[::2], *QUESTIONS[1::2]], known)

    with (
        Session(make, AnswerLog(), audit=0) as session,
        Interview(session, Subject(LABELS, least=1)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        for _ in range(2):
            screen = answered(interview, screen, choice(session, 0.65))
        back = interview.handle({"do": "undo", "id": "q1"})
        assert (back["question"]["id"], back["note"]) == ("q1", "Taken back.")
        assert back["question"]["check"].startswith(SAME)
        after = answered(interview, back, "cannot tell")
        assert after["question"] is None or after["question"]["id"] != "q1"
        assert "q1" in [entry.answer.query.id for entry in session.log.standing]
        back = interview.handle({"do": "withdraw", "id": "q0"})  # also an earlier one
        assert back["question"]["id"] == "q0"


def test_an_answer_that_was_not_kept_is_no_answer_that_was_taken_back() -> None:
    with (
        Session(lambda known: Listed(QUESTIONS[:2], known), AnswerLog(), audit=0) as session,
        Interview(session, Subject(LABELS, least=1)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        for value in (0.35, 0.65):  # less than .4 of the best level, then more than .6
            screen = answered(interview, screen, choice(session, value))
        conflict = screen["conflict"]
        labels = [one["label"] for one in conflict["choices"]]
        assert labels == ["Keep answer 1", "Keep answer 2", "I am not sure", "Keep both"]
        keep = conflict["choices"][0]["choice"]
        after = interview.handle({"do": "settle", "id": conflict["id"], "choice": keep})
        assert after["note"] == "Thank you. Answer 2 no longer counts. The other answers stay."
        if after["stage"] == "question":
            assert "you did not keep your answer to it" in after["question"]["check"]
        assert Counts.of(session.log).sentence == (
            "1 answer stands: 1 is learned from. Besides these, 1 was not kept."
        )
        found = interview.handle({"do": "answers"})["answers"]
        assert [one["status"] for one in found] == ["learned from", "not kept"]
        assert found[1]["remarks"] == ("not kept: it contradicted answer 1, which you kept",)


def answered(interview: Interview, screen: Any, choice: str) -> Any:
    return interview.handle({"do": "answer", "id": screen["question"]["id"], "choice": choice})


def test_at_the_end_the_checks_left_are_counted() -> None:
    """Once no other question is left, the number to come is that of the checks that are needed."""
    with (
        Session(lambda known: Listed(QUESTIONS[:3], known), AnswerLog()) as session,
        Interview(session, Subject(LABELS)) as interview,
    ):
        screen, ranges = interview.handle({"do": "practised", "choice": "a"}), []
        notes: list[str] = []
        while screen["stage"] == "question":
            id = screen["question"]["id"]
            reply = interview.handle({"do": "outlook", "id": id})
            ranges.append((reply["at_least"], reply["to_come"], session.next_told() is None))
            notes.append(screen["question"]["check"])
            screen = answered(interview, screen, choice(session, 0.65))
    left = range(len(ranges) - 1, -1, -1)
    assert all(least <= n for (least, _, _), n in zip(ranges, left, strict=True))
    # until only checks are left, an answer may make further questions needed
    assert all(
        found is None or found[0] <= n <= found[1]
        for (_, found, _), n in zip(ranges, left, strict=True)
    )
    at_end = [(n, found) for (_, found, over), n in zip(ranges, left, strict=True) if over]
    assert len(at_end) > 2
    assert [found for n, found in at_end[2:]] == [[n, n] for n, _ in at_end[2:]]
    # no check is announced
    assert all(note == "" or note.startswith("This question narrows") for note in notes)
