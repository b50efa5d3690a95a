"""Answers that are mended: conflicts that the person settles, and answers that they take back.

It also says above a question why it comes again, and what a question about a level is for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from elicit.model.query import Query, Verdict
from elicit.person.asker import Compares, Supposed
from elicit.person.course.conduct import IN_CONFLICT, ORDER, differs, was_settled
from elicit.person.course.counts import KEPT, status_of
from elicit.person.course.kept_in_log import Choices
from elicit.person.course.level_questions import purpose_of
from elicit.person.drawing import Drawing
from elicit.person.session import Session
from elicit.person.showing import Subject, printable
from elicit.tutors.answer_log import REPEATS, Entry

_CHECK_TAKEN_BACK = (
    "This is the same check again, because you took back your answer to it. It repeats question "
    "{n}. Your answer to question {n} still stands. Choose as you see it now."
)
_NOT_KEPT = (
    "This is the same question again: you did not keep your answer to it, which contradicted "
    "another. Choose as you see it now."
)
_TAKEN_BACK = "This is the same question again, because you took back your answer to it."


class Mending:
    """Mends the answers of a session.

    Parameters
    ----------
    session : Session
    subject : Subject
    chosen : Choices
        The person's choices, which may change.
    drawing : Drawing
    """

    def __init__(
        self, session: Session, subject: Subject, chosen: Choices, drawing: Drawing
    ) -> None:
        self._session, self._subject = session, subject
        self._chosen, self._drawing = chosen, drawing

    def note(self, query: Query) -> str:
        """Return sentences above a question whose answer was taken back, or on its purpose, or "".

        A check is not announced: an answer given in this knowledge would show little.
        """
        gone = [
            status_of(entry)
            for entry in self._session.log
            if entry.answer.query.id == query.id and entry.retracted and not was_settled(entry)
        ]
        if self._session.is_repeat(query.id):
            return self._again(query) if gone else ""
        if gone:
            return _NOT_KEPT if gone[-1] == "not kept" else _TAKEN_BACK
        if query.id.startswith(ORDER) or not self._subject.least or self._session.implied(query):
            return ""
        return self._purpose_of(query)

    def is_implied(self, query: Query) -> bool:
        """Return whether a question comes although its answer follows from others.

        It is put because any one of these may be a mistake. A check is not among them.
        """
        check = self._session.is_repeat(query.id) or query.id.startswith(ORDER)
        return bool(self._subject.least) and not check and self._session.implied(query)

    def _again(self, query: Query) -> str:
        """Return sentences on a check whose answer was taken back."""
        first = self._session.first_answer(query)
        assert first is not None
        return _CHECK_TAKEN_BACK.format(n=self._drawing.number_of(first.query.id))

    def _purpose_of(self, query: Query) -> str:
        """Return sentences on the purpose of a question about a level, if nothing else is open."""
        asker = self._session.current_asker()
        if self._session.next_told() is not None or not isinstance(asker, Compares):
            return ""
        labels = [printable(label) for label in self._subject.labels]
        return purpose_of(query, asker.comparator, labels, self._chosen.width)

    def conflict(self) -> dict[str, Any] | None:
        """Return the conflict that the last answer is part of, unless the person left it."""
        standing = self._session.log.standing
        if not standing or not self._subject.least:
            return None
        last = standing[-1]
        if last.repeat:
            first = next((e for e in standing if e.answer.query.id == last.metadata[REPEATS]), None)
            if first is None or not differs(last) or self._is_passed((first, last)):
                return None
            return self._drawing.repeat_conflict(first, last)
        among = self._session.contradiction()
        if not among or self._is_passed(among):
            return None
        return self._drawing.contradiction(among)

    def _is_passed(self, among: Sequence[Entry]) -> bool:
        return self._chosen.leaves(entry.answer.query.id for entry in among)

    def settle(self, conflict: Mapping[str, Any], choice: str) -> str:
        """Settle the present conflict, and return a sentence on it.

        Raises ValueError for a choice that is not one of the conflict's.
        """
        if choice not in {one["choice"] for one in conflict["choices"]}:
            raise ValueError(f"choice must be one of the conflict's, not {choice[:80]!r}")
        session, id = self._session, conflict["id"]
        standing = {entry.answer.query.id: entry for entry in session.log.standing}
        last = standing[id]
        if last.repeat:
            return self._settle_repeat(standing[last.metadata[REPEATS]], last, choice)
        among = session.contradiction()
        if choice == "later":
            self._leave(among)
            return "Nothing was changed. You find this under “Your answers”."
        if not session.makes_askers:
            self._leave(among)
            return "This program cannot take answers back."
        if choice == "cannot tell":
            for entry in among:
                session.withdraw(entry.answer.query.id, **{IN_CONFLICT: True})
            return "Thank you. None of these answers is used."
        gone = choice.removeprefix("withdraw:")
        number = self._drawing.number_of(gone)
        kept = [entry.answer.query.id for entry in among if entry.answer.query.id != gone]
        instead = {KEPT: kept[0]} if len(kept) == 1 else {}
        became = self.take_back(gone, **{IN_CONFLICT: True}, **instead)
        return f"Thank you. Answer {number} no longer counts.{became}"

    def _settle_repeat(self, first: Entry, last: Entry, choice: str) -> str:
        """Settle a repeat that was answered otherwise, and return a sentence on it."""
        if choice == "first" and not self._session.makes_askers:
            self._leave((first, last))
            return "Your first answer stands."
        meant = {
            "first": first.answer.verdict,
            "second": last.answer.verdict,
            "equal": Verdict.EQUAL,
            "cannot tell": None,
        }[choice]
        self._session.settle(last.answer.query.id, meant)
        return "Thank you. That is what counts from now on."

    def _leave(self, among: Sequence[Entry]) -> None:
        self._chosen.leave(entry.answer.query.id for entry in among)

    def take_back(self, id: str, **metadata: Any) -> str:
        """Take an answer back, and return a sentence on what became of the others."""
        before = len(self._session.log.standing)
        self._session.withdraw(id, **metadata)
        checks = before - len(self._session.log.standing) - 1
        if checks < 1:
            return " The other answers stay."
        gone = (
            "The check that repeated it goes" if checks == 1 else "The checks that repeated it go"
        )
        return f" {gone} with it. The other answers stay."

    def taken_back_before(self, id: str) -> str | None:
        """Return a note for an answer that was taken back already, as by a message sent twice."""
        said = [entry.retracted for entry in self._session.log if entry.answer.query.id == id]
        return "That answer was taken back already." if said and all(said) else None


def each_supposed(
    session: Session, last: Entry, choices: Sequence[str]
) -> dict[str, Callable[[], Supposed]]:
    """Return for each choice in a conflict a function that gives the asker after that choice.

    Nothing is settled. Another thread may call the functions, each of which may take a second.

    Parameters
    ----------
    session : Session
    last : Entry
        The last answer of the conflict.
    choices : sequence of str
        As ``Mending.settle`` takes them.
    """
    if last.repeat:
        first = str(last.metadata[REPEATS])
        meant = {"second": last.answer.verdict, "equal": Verdict.EQUAL, "cannot tell": None}
        return {
            choice: session.supposing([first], [replace(last.answer, verdict=meant[choice])])
            if choice in meant
            else session.supposing([])
            for choice in choices
        }
    among = [entry.answer.query.id for entry in session.contradiction()]
    without = {"cannot tell": among, "later": []}
    return {
        choice: session.supposing(without.get(choice, [choice.removeprefix("withdraw:")]))
        for choice in choices
    }
