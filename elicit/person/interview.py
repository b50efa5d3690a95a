"""The interview: the screens that a host shows a person, and the messages that it sends back.

A host, such as a page or a widget, sends messages and draws the replies. Both are plain JSON, so
one front end (``page/interview.js``) serves all of them. An ``Interview`` may be used by several
threads, windows and people at once: one message is taken at a time, and an answer counts once.

Every message is ``{"do": ...}``. The reply to the first five of these is the screen to be drawn
now:

``state``
    Nothing else.
``practised``
    The practice question was answered, with ``choice``.
``answer``
    ``id`` of the question; ``choice``: "a", "b", "equal" or "cannot tell".
``undo``
    ``id`` of the answer that is taken back. It must be the last one, otherwise nothing happens.
``withdraw``
    ``id`` of an answer that is taken back, whichever it is.
``outlook``
    ``id`` of the question, for the notes beside it. The reply has ``why`` (sentences), ``to_come``
    ([least, most], the number of questions after this one, or null) and ``ready`` (true if nothing
    will be added; until then ask again).
``answers``
    The reply has ``answers``, oldest first, each with ``id``, ``sentence``, ``verdict``, ``time``,
    ``withdrawn``, ``used`` and ``repeat``, and ``conflicts``, lists of ids.
``report``
    The reply has ``html``, a page to keep, and ``name`` for its file.

A screen has these fields:

``title``, ``preamble``
    Texts.
``stage``
    "practice", "question" or "end".
``answered``
    Number of answers that stand.
``last``
    ``id`` and ``sentence`` of the answer that undo takes back, or null.
``note``
    A remark to the person on the last message, or null.
``question``
    Null at the end.
``end``
    Null before the end.

A question has ``id``, ``number``, ``heading``, ``sentences``, ``sides`` (the names of A and B),
``of``, ``unit``, ``levels`` (k), ``labels``, ``icons`` (true if the counts of the rows are small
enough to be drawn one by one) and ``rows``, best level first. Each row has ``label``, ``level`` (0
the worst), ``a`` and ``b``.

The end has ``open`` (the reason why there is no question though more could be asked, or null),
``scale`` (rows, best level first: ``label``, ``value``, ``low``, ``high``, from 0 to 100),
``certainty`` (of the intervals), ``statements``, ``counts`` and ``conflicts`` (lists of ``id`` and
``sentence``). ``counts`` has ``answered``, with ``equal``, ``cannot tell`` and ``unused`` among
them; ``withdrawn``; and ``repeated``, the questions that were put again, which nothing else counts,
with ``alike`` of them answered as before.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from inspect import signature
from itertools import chain
from typing import Any

from elicit._support.closing import Closing
from elicit.model.query import Answer, Query, Verdict
from elicit.person.asker import AfterAnswer, Asker, Compares
from elicit.person.background import Background
from elicit.person.findings import certainty, scale_rows
from elicit.person.look_ahead import LookAhead
from elicit.person.outlook import Outlook
from elicit.person.report import report_page
from elicit.person.session import Session, SessionStatus
from elicit.person.showing import (
    MOST_ICONS,
    Shown,
    Words,
    near_in_whole_numbers,
    practice,
    printable,
    show,
)
from elicit.tutors.answer_log import Entry

_UNUSED = "This does not go together with earlier answers, so it is not used: see “Your answers”."
_REPEATED = (
    "That question was put a second time, to see whether the answers agree. What follows is the "
    "same either way."
)


def _no_more(_: Any) -> list[str]:
    return []


def _unsaid(_: Any) -> None:
    return None


@dataclass(frozen=True, eq=False)
class Subject:
    """The subject of an interview, in words.

    Parameters
    ----------
    labels : (k,) str
        The levels, worst first.
    words : Words
        The words in which the problem speaks.
    of : int
        Number of outcomes on a side, if there is a choice.
    report : callable
        Returns sentences about the outcome of ``Session.result``.
    stakes : callable
        Returns from the same outcome a sentence on the purpose of more questions, or None.
    finer : str
        Advice for when no question in whole numbers is left.
    seed : int
        Decides which side is A, and other choices by chance.
    """

    labels: tuple[str, ...]
    words: Words = field(default_factory=Words)
    of: int = 10
    report: Callable[[Any], list[str]] = field(default=_no_more, repr=False)
    stakes: Callable[[Any], str | None] = field(default=_unsaid, repr=False)
    finer: str = ""
    seed: int = 0


@dataclass(frozen=True, eq=False)
class _Beside:
    """Computations beside a question (``shown`` by its id) for this asker, if it could be
    copied.
    """

    shown: str
    asker: Asker
    ahead: LookAhead | None = None
    outlook: Outlook | None = None


class Interview(Closing):
    """A session as screens and messages (see the module).

    While the person reads, a thread computes the next question after each possible answer.
    ``close``, or leaving the Interview as a context manager, ends it. The session stays open.

    Parameters
    ----------
    session : Session
    subject : Subject

    Raises
    ------
    ValueError
        For something that is no message. The methods also raise what ``Session`` and its log raise,
        after which the same message may be sent again.
    """

    def __init__(self, session: Session, subject: Subject) -> None:
        self._session, self._subject = session, subject
        self._lock = threading.RLock()
        self._practised = any(not entry.retracted for entry in session.log)
        self._put: str | None = None  # id of the query that was logged last as shown
        self.shown: Shown | None = None
        """The question of the last screen, for hosts that draw it themselves; None if it has
        none.
        """
        session.instead = partial(_in_whole_numbers, subject)
        self._background = Background()
        self._beside: _Beside | None = None
        self._since: list[Verdict | None] = []  # verdicts since then
        self._does: dict[str, Callable[..., dict[str, Any]]] = {
            "state": lambda: self._screen(),
            "practised": self._practise,
            "answer": self._answer,
            "undo": self._undo,
            "withdraw": self._withdraw,
            "outlook": self._outlook,
            "answers": self._answers,
            "report": self._report,
        }

    def handle(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Return the reply to a message.

        Parameters
        ----------
        message : mapping
            As the module describes it.

        Returns
        -------
        dict
            JSON.

        Raises
        ------
        ValueError
            For something that is no message.
        """
        parts = dict(message) if isinstance(message, Mapping) else {}
        does = self._does.get(str(parts.pop("do", None)))
        if does is None or not all(isinstance(value, str) for value in parts.values()):
            raise ValueError(
                f'a message says what to "do", one of {", ".join(self._does)}, and strings besides'
            )
        try:
            signature(does).bind(**parts)
        except TypeError:
            raise ValueError("the parts of this message are not those it should have") from None
        with nullcontext() if does == self._outlook else self._lock:
            return does(**parts)

    def close(self) -> None:
        """End the background computation.

        The session stays open, and the interview may be used again.
        """
        self._background.close()

    def _screen(self, note: str | None = None) -> dict[str, Any]:
        session, words = self._session, self._subject.words
        standing = [entry for entry in session.log if not entry.retracted]
        answered = sum(not entry.repeat for entry in standing)
        last = standing[-1].answer if standing else None
        screen: dict[str, Any] = {
            "title": printable(words.title),
            "preamble": printable(words.preamble),
            "stage": "practice",
            "answered": answered,
            "last": last and {"id": last.query.id, "sentence": self._sentence(standing[-1])},
            "note": note,
            "question": None,
            "end": None,
        }
        if not self._practised and not standing:
            shown = practice(self._subject.labels, words, self._subject.of, self._subject.seed)
            self.shown = shown
            self._background.start(self._first_question())
            return {**screen, "question": self._drawn(shown, 0)}
        query = session.question()
        shown_now = None if query is None else self._shown(query)
        if shown_now is None or not shown_now.exact:
            self.shown = None
            # an answer to rounded numbers could make the statements at the end untrue
            return {**screen, "stage": "end", "end": self._end(shown_now is not None)}
        if self._put != shown_now.id:
            session.shown(shown_now.id, shown_now.swapped, shown=shown_now.record())
            self._put = shown_now.id
        self.shown = shown_now
        self._compute_beside(shown_now)
        return {**screen, "stage": "question", "question": self._drawn(shown_now, answered + 1)}

    def _first_question(self) -> Iterator[None]:
        with self._lock:
            self._session.question()
        yield

    def _practise(self, choice: str) -> dict[str, Any]:
        self._practised = True
        shown = practice(
            self._subject.labels, self._subject.words, self._subject.of, self._subject.seed
        )
        obvious = "b" if shown.swapped else "a"
        if choice == obvious:
            return self._screen("Just so. Now the questions that count.")
        return self._screen(
            f"Most would say {obvious.upper()}: all there are at the best level. Now the questions "
            "that count."
        )

    def _answer(self, id: str, choice: str) -> dict[str, Any]:
        query = self._session.question()
        if query is None or query.id != id:
            said = next(
                (
                    e
                    for e in reversed(self._session.log)
                    if e.answer.query.id == id and not e.retracted
                ),
                None,
            )
            if said is None:
                return self._screen(
                    "That question is not open any more. This is where things stand."
                )
            if self._shown(said.answer.query).verdict(choice) == said.answer.verdict:  # type: ignore[arg-type]
                return self._screen()  # the answer was sent twice
            return self._screen(
                "That question was answered already, perhaps in another window: "
                f"{self._sentence(said)}. "
                "That answer stands; you can take it back."
            )
        verdict = self._shown(query).verdict(choice)  # type: ignore[arg-type]  # which raises ValueError
        waits = self._session.next_told()
        self._session.answer(id, verdict, ahead=self._told_ahead)
        if waits is not None and waits.id != id and not self._session.log[-1].repeat:
            self._forget()  # there is another asker now
        self._practised = True
        said = self._session.log[-1]
        return self._screen(_REPEATED if said.repeat else None if said.used else _UNUSED)

    def _compute_beside(self, shown: Shown) -> None:
        """Start the computations beside a question, which is on the screen now."""
        session, subject, now = self._session, self._subject, self._beside
        asker = session.current_asker()
        if now is not None and now.shown == shown.id and now.asker is asker:
            return
        before, since = None if now is None else now.outlook, tuple(self._since)
        self._beside, self._since = _Beside(shown.id, asker), []
        if (twin := session.twin()) is None:
            return
        pending = session.next_told()
        assert pending is not None  # otherwise nothing would be shown
        ahead = None
        if now is not None and now.ahead is not None and now.ahead.waits_for(asker, pending):
            ahead = now.ahead  # ``shown`` is, or was, a repeat
        elif session.makes_askers and not self._rounded(pending):
            ahead = LookAhead(asker, twin, pending, self._shown(pending).swapped)
        counted = not session.is_repeat(shown.id)
        outlook = Outlook(
            twin, shown, pending, subject.stakes, self._ends, subject.seed, before, since, counted
        )
        self._beside = _Beside(shown.id, asker, ahead, outlook)
        self._background.start(chain(() if ahead is None else ahead.steps(), outlook.steps()))

    def _told_ahead(self, asker: Asker, answer: Answer) -> AfterAnswer | None:
        """Return the asker after an answer, if it was computed, and give up the other
        computations.
        """
        ahead = None if self._beside is None else self._beside.ahead
        found = None if ahead is None else ahead.told(asker, answer)
        self._background.stop()
        self._since.append(answer.verdict)
        return found

    def _rounded(self, query: Query) -> bool:
        return not self._shown(query).exact

    def _ends(self, query: Query) -> bool:
        """Return whether a session like this one has no question left in front of a query."""
        return not self._session.makes_askers and self._rounded(query)

    def _forget(self) -> None:
        """Discard what was shown and computed."""
        self._put = self._beside = None
        self._since = []
        self._background.stop()

    def _undo(self, id: str) -> dict[str, Any]:
        standing = [entry for entry in self._session.log if not entry.retracted]
        if not standing or standing[-1].answer.query.id != id:
            return self._screen("Nothing was taken back: that is not the last answer any more.")
        self._forget()
        self._session.undo()
        return self._screen("Taken back.")

    def _withdraw(self, id: str) -> dict[str, Any]:
        if not any(
            entry.answer.query.id == id and not entry.retracted for entry in self._session.log
        ):
            return self._screen("Nothing was taken back: no such answer stands any more.")
        self._forget()
        self._session.withdraw(id)
        return self._screen("Taken back. The other answers stay.")

    def _outlook(self, id: str) -> dict[str, Any]:
        """Return the notes beside a question, without taking the lock: nobody waits for it, nor it
        for anybody.
        """
        now = self._beside
        outlook = now.outlook if now is not None and now.shown == id else None
        if outlook is None:
            return {"id": id, "why": [], "to_come": None, "ready": True}
        ready = outlook.ready  # read first: whatever is there by then stays
        to_come = None if outlook.to_come is None else [*outlook.to_come]
        return {"id": id, "why": [*outlook.why], "to_come": to_come, "ready": ready}

    def _answers(self) -> dict[str, Any]:
        said = [
            {
                "id": entry.answer.query.id,
                "sentence": self._sentence(entry),
                "verdict": entry.answer.verdict,
                "time": entry.metadata.get("time"),
                "withdrawn": entry.retracted,
                "used": entry.used,
                "repeat": entry.repeat,
            }
            for entry in self._session.log
        ]
        return {
            "answers": said,
            "conflicts": [[one["id"] for one in among] for among in self._conflicts()],
        }

    def _report(self) -> dict[str, Any]:
        query, log = self._session.question(), self._session.log
        whole = query is not None and self._shown(query).exact
        now = datetime.now(UTC)
        title = printable(self._subject.words.title)
        html = report_page(
            title,
            f"{now.day} {now:%B %Y, %H:%M} UTC",
            self._end(query is not None and not whole),
            self._answers()["answers"],
            waiting=whole,
            log=None if log.path is None else printable(log.path.name),
            checksum=log.checksum,
            preamble=printable(self._subject.words.preamble),
        )
        words = re.findall(r"\w+", title.lower())
        return {"html": html, "name": "-".join([*words, "report", f"{now:%Y-%m-%d}"]) + ".html"}

    def _end(self, open_still: bool) -> dict[str, Any]:
        session, subject = self._session, self._subject
        status = session.status()
        asker = session.current_asker()
        known = asker.comparator if isinstance(asker, Compares) else None
        return {
            "open": f"There is no finer question of whole numbers. {subject.finer}".strip()
            if open_still
            else None,
            "scale": []
            if known is None
            else [row._asdict() for row in scale_rows(known, subject.labels)],
            "certainty": None if known is None else certainty(known),
            "statements": [*map(printable, subject.report(session.result())), *_repeats(status)],
            "counts": {
                "answered": status.answered,
                "equal": status.equal,
                "cannot tell": status.cannot_tell,
                "unused": status.unused,
                "withdrawn": status.withdrawn,
                "repeated": status.repeated,
                "alike": status.alike,
            },
            "conflicts": self._conflicts(),
        }

    def _conflicts(self) -> list[list[dict[str, Any]]]:
        return [
            [{"id": entry.answer.query.id, "sentence": self._sentence(entry)} for entry in among]
            for among in self._session.conflicts()
        ]

    def _drawn(self, shown: Shown, number: int) -> dict[str, Any]:
        rows = shown.rows
        return {
            "id": shown.id,
            "number": number,
            "heading": shown.sentences()[-1],
            "sentences": list(shown.sentences()[:-1]),
            "sides": [printable(f"{shown.words.side.capitalize()} {name}") for name in "AB"],
            "of": shown.of,
            "unit": printable(shown.words.unit),
            "levels": len(shown.labels),
            "labels": list(shown.labels),
            "icons": max((n for row in rows for n in (row.a, row.b)), default=0) <= MOST_ICONS,
            "rows": [row._asdict() for row in rows],
        }

    def _shown(self, query: Query) -> Shown:
        return _shown(self._subject, query)

    def _sentence(self, entry: Entry) -> str:
        return self._shown(entry.answer.query).sentence(entry.answer.verdict)


def _shown(subject: Subject, query: Query) -> Shown:
    return show(query, subject.words, subject.of, subject.seed, subject.labels)


def _in_whole_numbers(
    subject: Subject, query: Query, answered: Callable[[Query], bool]
) -> Query | None:
    """Return a query in whole numbers near one that is not, if there is one that was not asked
    yet.
    """
    if _shown(subject, query).exact:
        return None
    return next((near for near in near_in_whole_numbers(query) if not answered(near)), None)


def _repeats(status: SessionStatus) -> list[str]:
    """Return sentences on how many repeats were answered as before."""
    n = status.repeated
    questions = "question was" if n == 1 else "questions were"
    return [f"{status.alike} of {n} repeated {questions} answered as before."] if n else []
