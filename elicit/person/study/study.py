"""Several people's interviews about the same subject, and the messages of the person who runs them.

Interviews know nothing of each other. The person who runs the study sends messages of their own,
which are JSON as those of ``elicit.person.interview``. Every message is ``{"do": ...}``:

``state``
    The reply has ``title``, ``ended``, ``facts`` (pairs), ``report`` (how to make the report) and
    ``people``. Each of these has ``who``, ``answered``, ``minutes`` (that they planned, or null),
    ``state`` (a phrase), ``settled`` and ``last`` (the time of the last answer, or null).
``agreement``
    The reply has ``people`` (those with answers), ``few`` (a sentence if there are too few of them,
    or ""), ``levels`` (best first, each with ``label`` and ``each``: ``who``, ``value``, ``low``,
    ``high``, from 0 to 100, and ``asked``), ``certainty``, ``questions`` (each with ``text`` and
    ``prefers``, pairs of a person and a percentage) and ``groups`` (sentences).
``end``
    Ends the study. The reply is that to ``state``.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from elicit._support.closing import Closing
from elicit.comparators.panel import Panel
from elicit.diagnostics.agreement import Agreement, agreement
from elicit.model.comparator import Comparator
from elicit.person.beside import Company
from elicit.person.findings import certainty, scale_rows
from elicit.person.interview import Interview, Progress, Subject
from elicit.person.session import Session
from elicit.person.showing import printable
from elicit.tutors.answer_log import Entry

_ENDED = "The study has ended, so no more answers are taken. Thank you. This is your result."
_TOO_FEW = "Agreement is shown once two people have answered."
_STATES = {
    "welcome": "at the welcome page",
    "practice": "at the practice question",
    "question": "answering",
    "conflict": "looking at answers that differ",
    "offer": "choosing whether to go on",
    "end": "at the result",
}


class Study(Closing):
    """Interviews of several people about the same subject. ``close`` ends them; sessions stay open.

    Parameters
    ----------
    sessions : mapping of str to Session
        The session of each person, by name, each with a log of its own.
    subject : Subject
    report : str
        The command that makes the report of the study, or "".

    Raises
    ------
    ValueError
        If there is nobody, or two people share a log or have names that look alike.
    """

    def __init__(self, sessions: Mapping[str, Session], subject: Subject, report: str = "") -> None:
        if not sessions:
            raise ValueError("a study needs at least one person")
        if len({printable(who) for who in sessions}) < len(sessions):
            raise ValueError(f"two people of a study look alike: {', '.join(sessions)}")
        if len({id(session.log) for session in sessions.values()}) < len(sessions):
            raise ValueError("two people of a study share a log: give each a log of their own")
        self._company, self._subject, self._how = Company(several=True), subject, report
        self.interviews = {
            who: Interview(session, subject, self._company) for who, session in sessions.items()
        }
        """The interview of each person, by name."""
        self.ended = False
        """True if no more answers are taken."""
        self._lock = threading.Lock()
        self._agreed: tuple[object, dict[str, Any]] | None = None

    @property
    def people(self) -> tuple[str, ...]:
        """The names, in their order."""
        return tuple(self.interviews)

    def handle(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Return the reply to a message of the person who runs the study.

        Raises
        ------
        ValueError
            For something that is no message.
        """
        match dict(message):
            case {"do": "state", **rest} if not rest:
                return self.overview()
            case {"do": "agreement", **rest} if not rest:
                return self.agreement()
            case {"do": "end", **rest} if not rest:
                self.end()
                return self.overview()
        raise ValueError('a message says what to "do": state, agreement or end')

    def overview(self) -> dict[str, Any]:
        """Return who has answered how much, without waiting for anybody's interview."""
        return {
            "title": printable(self._subject.words.title),
            "ended": self.ended,
            "facts": [list(pair) for pair in self._subject.facts.of],
            "report": self._how,
            "people": [
                {
                    "who": printable(who),
                    "answered": interview.progress.answered,
                    "minutes": interview.progress.minutes,
                    "state": _state(interview.progress, self.ended),
                    "settled": interview.progress.settled,
                    "last": interview.progress.last,
                }
                for who, interview in self.interviews.items()
            ],
        }

    def agreement(self) -> dict[str, Any]:
        """Return how far those who have answered agree. It may take a second."""
        with self._lock:  # so that it is computed once for the same answers
            found = {who: interview.progress for who, interview in self.interviews.items()}
            answers = {
                who: [entry for entry in now.entries if entry.stands and not entry.repeat]
                for who, now in found.items()
            }
            key = {
                who: [(entry.answer.query.id, entry.answer.verdict, entry.used) for entry in said]
                for who, said in answers.items()
            }
            if self._agreed is not None and self._agreed[0] == key:
                return self._agreed[1]
            known = {
                who: now.comparator
                for who, now in found.items()
                if answers[who] and now.comparator is not None
            }
            entries = {who: found[who].entries for who in known}
            turns, several = self._company.turns, len(known) > 1
            if several:  # otherwise there is nothing to compute, and so nothing to wait for
                turns.take(lambda: False)
            try:
                reply = agreed_so_far(known, entries, self._subject.labels)
            finally:
                if several:
                    turns.leave()
            self._agreed = key, reply
            return reply

    def end(self) -> None:
        """End the study. After this returns, no more answers are taken or logged."""
        self.ended = True
        for interview in self.interviews.values():
            interview.take_no_more(_ENDED)

    def close(self) -> None:
        """End all background computation."""
        self._company.close()
        for interview in self.interviews.values():
            interview.close()


_NOTHING: dict[str, Any] = {"levels": [], "certainty": "", "questions": [], "groups": []}


def agreed_so_far(
    known: Mapping[str, Comparator],
    entries: Mapping[str, tuple[Entry, ...]],
    labels: tuple[str, ...],
) -> dict[str, Any]:
    """Return the agreement of people as JSON.

    Parameters
    ----------
    known : mapping of str to Comparator
        What is known of each person's scale, by name.
    entries : mapping of str to entries
        Their answers.
    labels : (k,) str
        The levels, worst first.

    Returns
    -------
    dict
        As the reply to ``agreement`` (see the module).
    """
    if len(known) < 2:
        return {"people": [printable(who) for who in known], "few": _TOO_FEW, **_NOTHING}
    found = agreement(Panel(known), [printable(label) for label in labels])
    scales = {who: scale_rows(one, labels, entries[who]) for who, one in known.items()}
    levels = [
        {
            "label": printable(labels[-1 - i]),
            "each": [
                {
                    "who": printable(who),
                    "value": rows[i].value,
                    "low": rows[i].low,
                    "high": rows[i].high,
                    "asked": rows[i].asked,
                    "known": rows[i].known,
                    "rough": rows[i].rough,
                }
                for who, rows in scales.items()
            ],
        }
        for i in range(len(labels))
    ]
    return {
        "people": [printable(who) for who in known],
        "few": "",
        "levels": levels,
        "certainty": certainty(next(iter(known.values())), "the"),
        "questions": [
            {
                "text": question.text,
                "prefers": [
                    [printable(who), round(100 * chance)]
                    for who, chance in question.prefers_left.items()
                ],
            }
            for question in found.questions
        ],
        "groups": _groups(found),
    }


def _groups(found: Agreement) -> list[str]:
    """Return sentences on groups of people who think alike."""
    rule = (
        "Two groups are kept apart if their members are known to differ in at least "
        f"{found.apart:.0%} of the questions that were compared, on average. After few answers "
        "little is known to differ."
    )
    if len(found.groups) == 1:
        return ["The answers show no groups of people who think differently.", rule]
    names = "; ".join(printable(", ".join(group)) for group in found.groups)
    return [f"The answers show {len(found.groups)} groups: {names}.", rule]


def _state(now: Progress, ended: bool) -> str:
    """Return the state of a person's session in a few words, for example when the study ended."""
    if ended and not now.answered:
        return "ended before the first answer"
    if ended and now.stage not in (None, "end"):
        return "ended before finishing"
    if now.stage is None:
        return "has not come back since the start" if now.answered else "has not come yet"
    return _STATES[now.stage]
