"""Messages that the page does not send change nothing."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from elicit import (
    AlwaysAsk,
    AnswerLog,
    Interview,
    PolytopeComparator,
    Query,
    Session,
    Subject,
    Verdict,
    choose,
)
from elicit.person.course.level_questions import questions_to_narrow
from tests.browser_cases import LABELS, QUESTIONS, Listed


def choosing(known: Any) -> Any:
    return choose([[3.0, 0, 7], [2, 2, 6], [0, 5, 5]], PolytopeComparator(3), known=known)


@pytest.mark.parametrize(
    "message",
    [
        *(None, 3, "state", ["do", "state"], [("do", "state")], {}),
        *(
            {"do": None},
            {"do": "close"},
            {"do": ["state"]},
            {"do": "state", "id": "x"},
            {"do": "state", 1: "x"},
        ),
        *(
            {"do": "answer"},
            {"do": "answer", "id": 1, "choice": "a"},
            {"do": "answer", "id": "", "self": "a"},
        ),
    ],
)
def test_what_is_no_message_is_refused(message: Any) -> None:
    with (
        Session(choosing, AnswerLog()) as session,
        Interview(session, Subject(("x", "y", "z"), least=0)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "b"})
        with pytest.raises(ValueError, match="message"):
            interview.handle(message)
        assert interview.handle({"do": "state"}) == {**screen, "note": None}


def test_the_docs_have_every_message_and_every_field_of_the_screens() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs/interview-messages.md").read_text("utf-8")
    with (
        Session(choosing, AnswerLog()) as session,
        Interview(session, Subject(("x", "y", "z"))) as interview,
    ):
        with pytest.raises(ValueError, match="do") as refused:
            interview.handle({"do": "dance"})
        messages = re.search(r"one of (.*), and strings", str(refused.value))
        assert messages
        screen = interview.handle({"do": "state"})
        named = {*messages[1].split(", "), *screen, *screen["welcome"]}
        question = interview.handle({"do": "start"})["question"]
        named |= {*question, *question["rows"][0]}
        screen = interview.handle({"do": "practised", "choice": "a"})
        named |= {*interview.handle({"do": "outlook", "id": screen["question"]["id"]})}
        end = interview.handle({"do": "result"})["end"]
        named |= {*end, *end["scale"][0], *interview.handle({"do": "prospects"})}
        assert len(named) > 60
        assert not [name for name in named if f"`{name}`" not in page]


def test_a_choice_that_there_is_not_is_refused() -> None:
    log = AnswerLog()
    with (
        Session(choosing, log) as session,
        Interview(session, Subject(("x", "y", "z"), least=0)) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "b"})
        with pytest.raises(ValueError, match="choice"):
            interview.handle(
                {"do": "answer", "id": screen["question"]["id"], "choice": "c" * 100_000}
            )
        assert not len(log)


def test_the_practice_question_can_be_tried_again_until_another_is_answered() -> None:
    log = AnswerLog()
    with (
        Session(choosing, log) as session,
        Interview(session, Subject(("x", "y", "z"))) as interview,
    ):
        best = interview.handle({"do": "start"})["question"]["rows"][0]
        right, wrong = ("a", "b") if best["a"] else ("b", "a")
        for slip in (wrong, "equal", "cannot tell"):
            screen = interview.handle({"do": "practised", "choice": slip})
            assert screen["stage"] == "question"
            assert screen["may_practise"]
            assert "try again, or go on" in screen["note"]
            again = interview.handle({"do": "practise"})
            assert again["stage"] == "practice"
            assert not again["may_practise"]
        assert not interview.handle({"do": "practised", "choice": right})["may_practise"]
        assert interview.handle({"do": "practise"})["stage"] == "question"  # it was right
        assert not len(log)
    with (
        Session(choosing, log) as session,
        Interview(session, Subject(("x", "y", "z"))) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": wrong})
        told = {"id": screen["question"]["id"], "choice": "a"}
        assert not interview.handle({"do": "answer", **told})["may_practise"]
        assert interview.handle({"do": "practise"})["stage"] == "question"


@pytest.mark.parametrize(("audit", "fewest"), [(0.1, 8), (0.0, 5)])
def test_the_welcome_and_the_first_question_count_the_fewest_questions_alike(
    audit: float, fewest: int
) -> None:
    with (
        Session(choosing, AnswerLog(), audit=audit) as session,
        Interview(session, Subject(("x", "y", "z"))) as interview,
    ):
        least = interview.handle({"do": "state"})["welcome"]["least"]
        interview.handle({"do": "start"})
        screen = interview.handle({"do": "practised", "choice": "a"})
        reply = interview.handle({"do": "outlook", "id": screen["question"]["id"]})
        assert least == 1 + reply["at_least"]
        assert least >= fewest
        said = reply["forecast"]
        assert said == "" if reply["to_come"] else f"“At least {least - 1} more” are the" in said


def test_an_asker_that_was_given_ends_with_its_last_question() -> None:
    with (
        Session(choosing(()), AnswerLog()) as session,
        Interview(session, Subject(("x", "y", "z"))) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "b"})
        while screen["stage"] == "question":
            told = {"id": screen["question"]["id"], "choice": "a"}
            screen = interview.handle({"do": "answer", **told})
        assert screen["stage"] == "end"
        assert not screen["end"]["more"]
        assert interview.handle({"do": "more"})["stage"] == "end"


def test_what_a_session_would_know_with_other_answers() -> None:
    log = AnswerLog()
    with Session(choosing, log) as session:
        while query := session.question():
            session.answer(query.id, 1)
        said = [entry.answer for entry in log]
        as_it_is = session.supposing([])()
        assert (as_it_is.used, as_it_is.of) == (len(said), len(said))
        assert as_it_is.asker.result().best == session.result().best
        size = len(log)
        less = session.supposing([said[-1].query.id])()
        assert (less.used, less.of) == (len(said) - 1, len(said) - 1)
        other = replace(said[-1], verdict=Verdict.WORSE)
        both = session.supposing([], [other])()
        assert both.used == len(said)  # of two that contradict each other the later is dropped
        turned = session.supposing([said[-1].query.id], [other])()
        assert turned.used == len(said)
        assert len(log) == size
        assert not any(entry.retracted for entry in log)
        session.withdraw(said[-1].query.id)
        assert less.asker.result().answers.ids == session.result().answers.ids
    with (
        Session(choosing(()), AnswerLog()) as session,
        pytest.raises(ValueError, match="must make a new asker"),
    ):
        session.supposing([])


def test_a_budget_that_is_no_number_is_none() -> None:
    with (
        Session(choosing, AnswerLog()) as session,
        Interview(session, Subject(("x", "y", "z"))) as interview,
    ):
        assert interview.handle({"do": "state"})["stage"] == "welcome"
        for budget in ("", "0", "-3", "many", "1" * 30):
            assert interview.handle({"do": "start", "budget": budget})["budget"] is None
        assert interview.handle({"do": "start", "budget": "15"})["budget"] == 15
        assert interview.handle({"do": "state"})["stage"] == "practice"


class LearnsNothing(Listed):
    """An asker whose comparator knows no more after any answer."""

    def __init__(self, questions: Sequence[Query], known: Any = ()) -> None:
        super().__init__(questions, known)
        self.comparator: Any = AlwaysAsk(3)


def test_where_no_answer_narrows_a_range_an_interview_for_the_values_ends_all_the_same() -> None:
    log = AnswerLog()
    with (
        Session(lambda known: LearnsNothing(QUESTIONS, known), log, audit=0) as session,
        Interview(session, Subject(LABELS)) as interview,
    ):
        interview.handle({"do": "practised", "choice": "a"})
        screen = interview.handle({"do": "start", "until": "values"})
        while screen["stage"] == "question":
            put = screen["question"]
            apart = sum(
                [0.0, 0.65, 1.0][row["level"]] * (row["a"] - row["b"]) for row in put["rows"]
            )
            choice = "a" if apart > 0 else "b"
            screen = interview.handle({"do": "answer", "id": put["id"], "choice": choice})
    assert screen["stage"] == "end"
    about = sum(entry.answer.query.id.startswith("level/") for entry in log)
    assert 5 < about <= 2 * questions_to_narrow([100.0])[1]


def test_while_ranges_are_narrowed_no_answer_waits_for_whether_the_result_is_sure_enough() -> None:
    looked: list[int] = []

    def enough(result: int) -> bool:
        looked.append(result)
        return True

    subject = Subject(LABELS, enough=enough, enough_is_slow=True)
    with (
        Session(lambda known: Listed(QUESTIONS[:1], known), AnswerLog(), audit=0) as session,
        Interview(session, subject) as interview,
    ):
        interview.handle({"do": "practised", "choice": "a"})
        screen = interview.handle({"do": "start", "until": "values"})
        waited = []
        while screen["stage"] == "question":
            waited.append((session.next_told() is None, len(looked)))
            put = screen["question"]
            apart = sum(
                [0.0, 0.65, 1.0][row["level"]] * (row["a"] - row["b"]) for row in put["rows"]
            )
            choice = "a" if apart > 0 else "b"
            screen = interview.handle({"do": "answer", "id": put["id"], "choice": choice})
    assert sum(over for over, _ in waited) > 2
    assert looked  # at the end
    assert waited[-4][1] == 0
