"""What is no message changes nothing."""

from typing import Any

import pytest

from elicit import AnswerLog, PolytopeComparator, Session, choose
from elicit.person.interview import Interview, Subject


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
