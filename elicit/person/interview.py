"""The interview: the screens that a host shows a person, and the messages that it sends back.

A host, such as a page or a widget, sends messages and draws the replies. Both are plain JSON, so
one front end (``page/interview.js``) serves all of them. An ``Interview`` may be used by several
threads, windows and people at once: one message is taken at a time, and an answer counts once.

Every message is ``{"do": ...}``, and its other parts are strings. The reply to each of these is the
screen to be drawn now:

``state``
    Nothing else.
``start``
    The person leaves the welcome, perhaps with ``who``, and ``budget`` (a number of questions) or
    ``minutes``.
``practised``
    The practice question was answered, with ``choice``.
``answer``
    ``id`` of the question; ``choice``: "a", "b", "equal" or "cannot tell".
``undo``
    ``id`` of the answer that is taken back. It must be the last one, otherwise nothing happens.
``withdraw``
    ``id`` of an answer that is taken back, whichever it is.
``settle``
    ``id`` of a conflict; ``choice``, one of the conflict's.
``choose``
    ``option`` of an offer.
``finish``
    The person wants the result now.
``more``
    The person wants to go on after the end.
``result``
    Nothing else. The reply is the screen at the end, also if a question or a conflict waits.
    Nothing changes.

The other replies are:

``outlook``
    ``id`` of the question, for the notes beside it. The reply has ``why`` (sentences), ``to_come``
    ([least, most], the number of questions after this one, or null), ``at_least`` (how many must
    come) and ``ready`` (true if nothing
    will be added; until then ask again).
``prospects``
    What each budget of the welcome will likely prove. The reply has ``budgets`` (sentences, in the
    order of the welcome's), ``settled`` (a sentence on how long it takes until nothing is left to
    ask, or "") and ``ready`` (as of ``outlook``). It is empty as long as nothing is known.
``consequences``
    ``id`` of a conflict. The reply has ``choices`` (for each choice of it a sentence on what would
    be left, as far as computed) and ``ready`` (as of ``outlook``).
``answers``
    The reply has ``answers``, oldest first, each with ``id``, ``number``, ``sentence``,
    ``shown`` (both sides in words), ``verdict``, ``time``, ``withdrawn``, ``used`` and ``repeat``,
    and ``conflicts``, lists of ids.
``report``
    The reply has ``html``, a page to keep, and ``name`` for its file.
``download``
    ``what``: "scale", "policy" or "answers"; ``format``: "csv" or "json". The reply has ``text``,
    ``type`` and ``name``.

A screen has these fields:

``title``, ``preamble``, ``note_beside``
    Texts. The last is for every result, such as a disclaimer.
``legend``
    ``duration`` (a sentence, or "") and ``levels``, best first, each with ``label``, ``level`` (0
    the worst) and ``meaning``.
``stage``
    "welcome", "practice", "question", "conflict", "offer" or "end".
``answered``
    Number of answers that stand.
``checks``
    Number of repeated questions among the answers that stand.
``open_conflicts``
    Number of answers that contradict others.
``budget``
    Number of questions that the person planned, or null. If they said how many minutes they have,
    it is the number that fits into these at their pace.
``time``
    ``planned`` (minutes, or null), ``spent`` (seconds, without breaks) and ``pace`` (seconds a
    question).
``last``
    ``id`` and ``sentence`` of the answer that undo takes back, or null.
``note``
    A remark to the person on the last message, or null.
``welcome``, ``question``, ``conflict``, ``offer``, ``end``
    Null but at their stage. The practice has a question too.

The welcome has ``who`` (the name of the person, if it is known already, or ""), ``before`` (a
sentence on what could be lost without an answer, or ""), ``purpose``,
``compare``, ``least`` (the fewest answers before it can be finished) and ``budgets``, each with
``minutes`` and ``questions``.

A question has ``id``, ``number``, ``heading``, ``sentences``, ``sides`` (the names of A and B),
``of``, ``unit``, ``levels`` (k), ``labels``, ``icons`` (true if the counts of the rows are small
enough to be drawn one by one) and ``rows``, best level first. Each row has ``label``, ``level`` (0
the worst), ``a`` and ``b``.

A conflict has ``id``, ``heading``, ``text``, ``answers`` (each with ``number``, ``sentence``,
``chosen`` and ``question``, which is drawn as it was shown) and ``choices``, each with ``choice``
and ``label``. An offer has ``heading``, ``text`` and ``options``, each with ``option`` and
``label``.

The end has ``headline``, ``sure``, ``next``, ``before`` (texts), ``caution`` (a sentence on why the
answers say little, or null), ``remarks`` (sentences on answers that came very fast, and on repeats
that differ more often in one half of the session), ``settled``, ``finished`` (false if a question
waits), ``more`` (true if something is left to ask), ``open`` (the reason why there is no question
though more could be asked, or null), ``scale`` (rows, best level first: ``label``, ``value``,
``low``, ``high``, from 0 to 100, and ``asked``, false for a level that no answer is about),
``certainty`` (of the intervals), ``by_chance`` (a sentence on how often answers by chance would do
as well in the checks, or ""), ``statements``, ``changes`` (``title``, ``note``, ``columns``,
``rows``, or null), ``downloads``, ``facts`` (pairs), ``limits``, ``counts`` and ``conflicts``
(lists of ``id``, ``number`` and ``sentence``). ``counts`` has ``answered``, with ``equal``,
``cannot tell`` and ``unused`` among them; ``withdrawn``; and ``repeated``, the questions that were
put again, which nothing else counts, with ``alike`` of them answered as before.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from inspect import signature
from itertools import chain
from typing import Any

import numpy as np

from elicit._support.closing import Closing
from elicit.model.query import Answer, Query, Verdict
from elicit.person.asker import AfterAnswer, Asker, Compares, Supposed
from elicit.person.background import Background, Turns
from elicit.person.course.choices import CHOICES, Choices
from elicit.person.course.conduct import IN_CONFLICT, LEAST_CHECKS, ORDER, Conduct, differs
from elicit.person.course.consequences import Consequences
from elicit.person.course.further import LEVEL, level_question, order_question
from elicit.person.course.pace import FEW_HASTY, Pace
from elicit.person.course.progress import Progress
from elicit.person.course.start import START, Start
from elicit.person.drawing import MINUTES, Drawing, legend_of, shown_of
from elicit.person.drawing import Subject as Subject
from elicit.person.look_ahead import LookAhead
from elicit.person.outlook import Outlook, Prospects
from elicit.person.session import Session
from elicit.person.showing import (
    Shown,
    near_in_whole_numbers,
    practice,
    printable,
)
from elicit.tutors.answer_log import CONTRADICTS, REPEATS, Entry

_MORE_AFTER_CAUTION = 10  # answers until a caution that the person passed over is said again
_ORDER_AFTER = 4  # answers before the question about the order of two levels
_LONGEST_NAME = 80
_FURTHER = "This question makes sure that the result does not depend on too few answers."


@dataclass(frozen=True, eq=False)
class _Beside:
    """Computations beside a question (``shown``: its id) for this asker, if it could be copied."""

    shown: str
    asker: Asker
    ahead: LookAhead | None = None
    outlook: Outlook | None = None


class Company(Closing):
    """Interviews about one subject, and what they share. ``close`` ends its work.

    Parameters
    ----------
    several : bool
        True if there are several interviews. What one of them needs must then go on when another
        one no longer does.
    """

    def __init__(self, several: bool = False) -> None:
        self.turns = Turns()
        self._several, self._lock = several, threading.Lock()
        self._background = Background(self.turns)
        self._prospects: Prospects | None = None

    def foresee(self, prospects: Prospects, own: Background) -> Prospects:
        """Return prospects that are computed now, or others of the same numbers of questions.

        Before their first answer all people have the same prospects, so these are computed once.

        Parameters
        ----------
        prospects : Prospects
        own : Background
            The interview's own, for work that nobody shares.
        """
        with self._lock:
            if self._several and self._prospects is None:
                self._prospects = prospects
                self._background.start(prospects.steps())
            if self._prospects is not None and self._prospects.questions == prospects.questions:
                return self._prospects
        own.start(prospects.steps())
        return prospects

    def close(self) -> None:
        """End the work."""
        self._background.close()


class Interview(Drawing, Closing):
    """A session as screens and messages (see the module).

    While the person reads, a thread computes the next question after each possible answer.
    ``close``, or leaving the Interview as a context manager, ends it. The session stays open.

    Parameters
    ----------
    session : Session
    subject : Subject
    company : Company, optional
        What it shares with other interviews about the same subject in the same process.

    Raises
    ------
    ValueError
        For something that is no message. The methods also raise what ``Session`` and its log raise,
        after which the same message may be sent again.
    """

    def __init__(self, session: Session, subject: Subject, company: Company | None = None) -> None:
        super().__init__(session, subject)
        self._lock = threading.RLock()
        self._company = company or Company()
        self._over: str | None = None  # the note of an interview that takes no more answers
        self._started = self._practised = any(not entry.retracted for entry in session.log)
        self._put: str | None = None  # id of the query that was logged last as shown
        self.shown: Shown | None = None
        """The question of the last screen, for hosts that draw it themselves; None if it has
        none.
        """
        session.instead = self._instead
        if subject.least:
            session.further = self._further
            session.check_regularly()
        self._background = Background(self._company.turns)
        self._beside: _Beside | None = None
        self._prospects: Prospects | None = None
        self._pace = Pace()  # then: whoever does not hold the lock may not read the log
        self._weighed: Consequences[Supposed] | None = None
        self._since: list[Verdict | None] = []  # verdicts since then
        self._put_so_far = 0  # questions, and checks, before this one
        self._needed = (0, 0)  # answers and checks that must still come after this question
        # whoever resumes without an answer sees the welcome, and chooses anew
        self._chosen = Choices.of(session.log.asked) if self._started else Choices()
        self._kept = replace(self._chosen)  # as the log has them
        self._does: dict[str, Callable[..., dict[str, Any]]] = {
            "state": lambda: self._screen(),
            "start": self._begin,
            "practised": self._practise,
            "answer": self._answer,
            "undo": self._undo,
            "withdraw": self._withdraw,
            "settle": self._settle,
            "choose": self._choose,
            "finish": self._finish,
            "result": self._result,
            "more": self._go_on,
            "outlook": self._outlook,
            "prospects": self._prospects_so_far,
            "consequences": self._consequences,
            "answers": self._answers,
            "report": self._report,
            "download": self._download,
        }
        self.progress = self._progress(None)
        """The point at which it stood after the last message."""

    @property
    def _unlocked(self) -> tuple[Callable[..., dict[str, Any]], ...]:
        """The messages that only read what a thread computes: neither waits for the other."""
        return self._outlook, self._prospects_so_far, self._consequences

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
        if does in self._unlocked:
            return does(**parts)
        with self._lock, self._company.turns.reply():
            only_reads = does in (self._answers, self._report, self._download)
            if self._over is not None and not only_reads:
                return self._after_all(self._over)
            screen = does(**parts)
            self.progress = self._progress(self.progress, None if only_reads else screen)
            return screen

    def take_no_more(self, note: str) -> None:
        """Take no more answers. From now on every screen is the result, with this note.

        Nothing is written to the log any more once this returns.

        Parameters
        ----------
        note : str
        """
        with self._lock:
            self._over = printable(note)
            self._background.stop()

    def close(self) -> None:
        """End the background computation.

        The session stays open, and the interview may be used again.
        """
        self._background.close()

    def _progress(
        self, before: Progress | None, screen: Mapping[str, Any] | None = None
    ) -> Progress:
        """Return where the interview stands, of which ``screen`` is what the person sees now."""
        asker = self._session.current_asker()
        known = asker.comparator if isinstance(asker, Compares) else None
        entries = tuple(self._session.log)
        if screen is None:
            return replace(before or Progress((), None), entries=entries, comparator=known)
        end = screen["end"]
        settled = end is not None and bool(end["settled"])
        return Progress(entries, known, screen["stage"], settled, screen["time"]["planned"])

    def _after_all(self, note: str) -> dict[str, Any]:
        """Return the screen of an interview that takes no more answers."""
        screen = self._result()
        end = {**screen["end"], "more": False, "next": ""}
        return {**screen, "end": end, "last": None, "note": note}

    def _screen(self, note: str | None = None) -> dict[str, Any]:
        session, words = self._session, self._subject.words
        standing = [entry for entry in session.log if not entry.retracted]
        screen = self._screen_of(standing, note)
        if not standing and not self._practised and not self._chosen.stopped:
            if not self._started and session.question() is not None:
                self.shown = None
                self._foresee()
                return {**screen, "welcome": self._welcome()}
            if session.question() is not None:
                shown = practice(self._subject.labels, words, self._subject.of, self._subject.seed)
                self.shown = shown
                self._background.start(self._first_question())
                return {**screen, "stage": "practice", "question": self._drawn(shown, 0)}
        conduct = Conduct.of([*session.log])
        caution = (
            conduct.caution()
            if conduct.given >= self._chosen.heard + _MORE_AFTER_CAUTION
            or (conduct.taken_back and not self._chosen.heard)
            else None
        )
        if conflict := self._conflict_now():
            self.shown = None
            self._weigh(conflict)
            return {**screen, "stage": "conflict", "conflict": conflict}
        if self._chosen.stopped or (caution and self._subject.least):
            self.shown = None
            self._keep()
            return {**screen, "stage": "end", "end": self._end(False)}
        if offer := self._offer(conduct):
            self.shown = None
            return {**screen, "stage": "offer", "offer": offer}
        query = session.question()
        shown_now = None if query is None else self._shown(query)
        if shown_now is None or not shown_now.exact:
            self.shown = None
            # an answer to rounded numbers could make the statements at the end untrue
            return {**screen, "stage": "end", "end": self._end(shown_now is not None)}
        if self._put != shown_now.id or self._chosen != self._kept:
            self._log_shown(shown_now)
        self.shown = shown_now
        self._needed = self._still_needed(conduct)
        self._put_so_far = len(standing)
        self._compute_beside(shown_now)
        return {
            **screen,
            "stage": "question",
            "question": self._drawn(shown_now, len(standing) + 1),
        }

    def _screen_of(self, standing: Sequence[Entry], note: str | None) -> dict[str, Any]:
        """Return the parts of a screen that do not depend on its stage."""
        words = self._subject.words
        last = standing[-1].answer if standing else None
        pace = Pace.of(self._session.log)
        return {
            "title": printable(words.title),
            "preamble": printable(words.preamble),
            "note_beside": printable(words.note),
            "legend": legend_of(self._subject),
            "stage": "welcome",
            "answered": sum(not entry.repeat for entry in standing),
            "checks": sum(entry.repeat for entry in standing),
            "open_conflicts": sum(CONTRADICTS in e.metadata and not e.used for e in standing),
            "budget": self._planned(),
            "time": {"planned": self._chosen.minutes, "spent": pace.spent, "pace": pace.seconds},
            "last": last and {"id": last.query.id, "sentence": self._sentence(standing[-1])},
            "note": note,
            "welcome": None,
            "question": None,
            "conflict": None,
            "offer": None,
            "end": None,
        }

    def _planned(self) -> int | None:
        """Return the number of questions that the person planned, or has time for, or None."""
        if self._chosen.minutes is None:
            return self._chosen.budget
        log = self._session.log
        return Conduct.of([*log]).answered + Pace.of(log).questions_in(self._chosen.minutes)

    def _foresee(self) -> None:
        """Start to compute what each budget will likely prove."""
        if self._prospects is None and (twin := self._session.twin()) is not None:
            self._pace = pace = Pace.of(self._session.log)
            numbers = [pace.questions_in(minutes) for minutes in MINUTES]
            subject = self._subject
            prospects = Prospects(twin, numbers, subject.seed, self._ends, subject.enough)
            self._prospects = self._company.foresee(prospects, self._background)

    def _prospects_so_far(self) -> dict[str, Any]:
        """Return what the budgets will likely prove, without taking the lock."""
        now = self._prospects
        if now is None:
            return {"budgets": [], "settled": "", "ready": True}
        # once somebody has started, the computation is given up
        ready, length = now.ready or self._started, now.length()
        settled = ""
        if length is not None:
            most = max(length, self._subject.least + LEAST_CHECKS)
            settled = (
                f"Half of the simulated sessions took at most {most} questions, about "
                f"{_minutes(self._pace.minutes_for(most))}."
            )
        return {
            "budgets": [self._in_prospect(found) for found in now.found()],
            "settled": settled,
            "ready": ready,
        }

    def _keep(self) -> None:
        """Log the person's choices while no question is on the screen, with the one that waits."""
        if self._chosen == self._kept:
            return
        query = self._session.question()
        shown = None if query is None else self._shown(query)
        if shown is not None and shown.exact:  # otherwise the end comes without a choice
            with suppress(OSError):  # the result is shown all the same
                self._log_shown(shown)

    def _log_shown(self, shown: Shown) -> None:
        """Log the question that is put now, the person's choices if they changed, and the start."""
        changed = {CHOICES: self._chosen.record()} if self._chosen != self._kept else {}
        start, facts = self._start, self._subject.facts.of
        if facts and isinstance(start, Start) and (before := start.computed()):
            changed[START] = before.record(facts)
            self._start = before
        self._session.shown(shown.id, shown.swapped, shown=shown.record(), **changed)
        self._put, self._kept = shown.id, replace(self._chosen)

    def _first_question(self) -> Iterator[None]:
        with self._lock:
            self._session.question()
        yield

    def _begin(self, who: str = "", budget: str = "", minutes: str = "") -> dict[str, Any]:
        self._started, self._chosen.stopped = True, False
        begun = any(not entry.retracted for entry in self._session.log)
        if who.strip() and self._session.log.who is None and not begun:
            self._session.stamp(printable(who.strip())[:_LONGEST_NAME])
        self._chosen.budget, self._chosen.minutes = _number(budget), _number(minutes)
        return self._screen()

    def _practise(self, choice: str) -> dict[str, Any]:
        self._started = self._practised = True
        shown = practice(
            self._subject.labels, self._subject.words, self._subject.of, self._subject.seed
        )
        obvious = "b" if shown.swapped else "a"
        if self._session.question() is None:
            return self._screen()
        if choice == obvious:
            return self._screen("Right. Now the real questions.")
        return self._screen(
            f"Most people choose {obvious.upper()}, because everyone in it is “"
            f"{printable(self._subject.labels[-1])}”. Now the real questions."
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
                return self._screen("That question is no longer open. This is the current one.")
            if self._shown(said.answer.query).verdict(choice) == said.answer.verdict:  # type: ignore[arg-type]
                return self._screen()  # the answer was sent twice
            return self._screen(
                "That question was already answered, perhaps in another window: "
                f"{self._sentence(said)}. That answer stands. You can take it back."
            )
        verdict = self._shown(query).verdict(choice)  # type: ignore[arg-type]  # which raises ValueError
        waits = self._session.next_told()
        self._session.answer(id, verdict, ahead=self._told_ahead)
        self._started = self._practised = True
        self._chosen.stopped = False
        said = self._session.log[-1]
        if not said.repeat and (waits is None or waits.id != id):
            self._forget()  # there is another asker now
        return self._screen(self._about_haste())

    def _about_haste(self) -> str | None:
        """Return a remark on the first few answers that came very fast, once in a session."""
        few = Pace.of(self._session.log).hasty < FEW_HASTY
        if few or self._chosen.slowed or not self._subject.least:
            return None
        self._chosen.slowed = True
        return "Some answers came in under a second. There is no hurry: take the time you need."

    def _instead(self, query: Query, answered: Callable[[Query], bool]) -> Query | None:
        """Return the query in place of the asker's: a check, another kind, or whole numbers."""
        asker = self._session.current_asker()
        if self._subject.least and isinstance(asker, Compares):
            if (check := self._order_check(asker.comparator.k)) and not answered(check):
                return check
            if self._chosen.other:
                other = level_question(
                    asker.comparator, self._subject.of, answered, mixed_with="neighbours"
                )
                if other is not None:
                    return other
        return _in_whole_numbers(self._subject, query, answered)

    def _order_check(self, k: int) -> Query | None:
        """Return the question about two neighbouring levels that is due, or None."""
        log = [*self._session.log]
        conduct = Conduct.of(log)
        n = sum(entry.answer.query.id.startswith(ORDER) for entry in log)
        due = (conduct.answered >= _ORDER_AFTER) + (conduct.differed > 0)
        if not self._session.audits or k < 3 or n >= due:
            return None
        return order_question(k, 1 + (k // 2 + n) % (k - 1))

    def _further(self) -> Query | None:
        """Return the question to put when the asker has none, or None at the end."""
        conduct, start = Conduct.of([*self._session.log]), self._at_start()
        needed = start is not None and not start.finished
        few = needed and conduct.with_verdict < self._subject.least
        if needed and not few and self._session.audits and conduct.unresolved:
            few = self._session.confirming() is None  # then there is more to put again
        few = few or (needed and not self._subject.enough(self._session.result()))
        if (self._chosen.more or few) and (found := self._level_question(few)) is not None:
            return found
        return self._session.confirming() if needed or self._chosen.more else None

    def _still_needed(self, conduct: Conduct) -> tuple[int, int]:
        """Return how many answers, and checks besides, must come after this question."""
        if not self._subject.least:
            return 0, 0
        checks = max(0, LEAST_CHECKS - conduct.checks) if self._session.audits else 0
        return max(0, self._subject.least - conduct.with_verdict - 1), checks

    def _offer(self, conduct: Conduct) -> dict[str, Any] | None:
        """Return what the person is offered before the next question, or None."""
        n = conduct.answered
        if n <= self._chosen.offered or not self._subject.least:
            return None
        stop = {"option": "finish", "label": "Finish now and show the result"}
        if conduct.offers:
            return {
                "heading": f"You could not tell {conduct.in_a_row} times in a row",
                "text": "That is fine. What would you like to do?",
                "options": [
                    {"option": "other", "label": "Try another kind of question"},
                    {"option": "on", "label": "Go on as before"},
                    {"option": "pause", "label": "Take a break"},
                    stop,
                ],
            }
        planned, minutes = self._planned(), self._chosen.minutes
        if planned is not None and n >= planned and self._session.question() is not None:
            return {
                "heading": f"You planned {planned} questions, and answered {n}"
                if minutes is None
                else f"Your {_minutes(minutes)} {'is' if minutes == 1 else 'are'} over, and you "
                f"answered {n} questions",
                "text": "You can see the result now, or go on for a smaller uncertainty.",
                "options": [stop, {"option": "on", "label": "Go on until it is settled"}],
            }
        return None

    def _choose(self, option: str) -> dict[str, Any]:
        if option not in ("other", "on", "finish"):
            raise ValueError(f"option must be 'other', 'on' or 'finish', not {option[:40]!r}")
        if option == "finish":
            return self._finish()
        self._chosen.offered = Conduct.of([*self._session.log]).answered
        planned = self._planned()
        if planned is not None and self._chosen.offered >= planned:
            self._chosen.budget = self._chosen.minutes = None
        if option == "other":
            self._chosen.other = not self._chosen.other
            self._forget()
        return self._screen()

    def _finish(self) -> dict[str, Any]:
        self._chosen.stopped = True
        return self._screen()

    def _result(self) -> dict[str, Any]:
        screen = self._screen_of([e for e in self._session.log if not e.retracted], None)
        return {**screen, "stage": "end", "end": self._end(False)}

    def _go_on(self) -> dict[str, Any]:
        conduct = Conduct.of([*self._session.log])
        self._started = self._practised = True
        self._chosen.stopped = False
        if conduct.caution() is not None:
            self._chosen.heard = conduct.given
        self._chosen.offered = conduct.answered
        if self._session.question() is None:
            self._chosen.more = True
        return self._screen()

    def _conflict_now(self) -> dict[str, Any] | None:
        """Return the conflict that the last answer is part of, unless the person left it."""
        standing = [entry for entry in self._session.log if not entry.retracted]
        if not standing or not self._subject.least:
            return None
        last = standing[-1]
        if last.repeat:
            first = next((e for e in standing if e.answer.query.id == last.metadata[REPEATS]), None)
            if first is None or not differs(last) or self._is_passed((first, last)):
                return None
            return self._repeat_conflict(first, last)
        among = self._session.contradiction()
        if not among or self._is_passed(among):
            return None
        return self._contradiction(among)

    def _is_passed(self, among: Sequence[Entry]) -> bool:
        return self._chosen.leaves(entry.answer.query.id for entry in among)

    def _settle(self, id: str, choice: str) -> dict[str, Any]:
        conflict = self._conflict_now()
        if conflict is None or conflict["id"] != id:
            return self._screen("That was settled already, perhaps in another window.")
        if choice not in {one["choice"] for one in conflict["choices"]}:
            raise ValueError(f"choice must be one of the conflict's, not {choice[:80]!r}")
        standing = {e.answer.query.id: e for e in self._session.log if not e.retracted}
        last = standing[id]
        self._forget()
        if choice == "later":
            among = self._session.contradiction()
            self._chosen.leave(entry.answer.query.id for entry in among)
            return self._screen("Nothing was changed. You find this under “Your answers”.")
        if last.repeat:
            first = standing[last.metadata[REPEATS]]
            if choice == "first" and not self._session.makes_askers:
                self._chosen.leave((first.answer.query.id, id))
                return self._screen("Your first answer stands.")
            meant = {
                "first": first.answer.verdict,
                "second": last.answer.verdict,
                "equal": Verdict.EQUAL,
                "cannot tell": None,
            }[choice]
            self._session.settle(id, meant)
            return self._screen("Thank you. That is what counts from now on.")
        among = self._session.contradiction()
        if not self._session.makes_askers:
            self._chosen.leave(entry.answer.query.id for entry in among)
            return self._screen("This program cannot take answers back.")
        if choice == "cannot tell":
            for entry in among:
                self._session.withdraw(entry.answer.query.id, **{IN_CONFLICT: True})
            return self._screen("Thank you. None of these answers is used.")
        self._session.withdraw(choice.removeprefix("withdraw:"), **{IN_CONFLICT: True})
        return self._screen("Thank you. The other answers stay.")

    def _weigh(self, conflict: Mapping[str, Any]) -> None:
        """Start to compute what each choice in a conflict would leave."""
        session, id = self._session, str(conflict["id"])
        if not session.makes_askers or (self._weighed and self._weighed.id == id):
            return
        last = next(e for e in reversed(session.log) if e.answer.query.id == id)
        choices = [str(one["choice"]) for one in conflict["choices"]]
        suppose: dict[str, Callable[[], Supposed]] = {}
        if last.repeat:
            first = str(last.metadata[REPEATS])
            meant = {"second": last.answer.verdict, "equal": Verdict.EQUAL, "cannot tell": None}
            suppose = {
                choice: session.supposing([first], [replace(last.answer, verdict=meant[choice])])
                if choice in meant
                else session.supposing([])
                for choice in choices
            }
        else:
            among = [entry.answer.query.id for entry in session.contradiction()]
            without = {"cannot tell": among, "later": []}
            suppose = {
                choice: session.supposing(without.get(choice, [choice.removeprefix("withdraw:")]))
                for choice in choices
            }
        d = last.answer.query.d
        sides = [np.flatnonzero(side[1:-1]) + 1 for side in (d > 0, d < 0)]  # ends are fixed
        level = min((side for side in sides if len(side)), key=len, default=sides[0])
        levels = level[-2:].tolist()[::-1]
        self._weighed = Consequences(id, suppose, partial(self._left_by, levels))
        self._background.start(self._weighed.steps())

    def _consequences(self, id: str) -> dict[str, Any]:
        """Return what the choices of a conflict would leave, without taking the lock."""
        now = self._weighed
        if now is None or now.id != id:
            return {"id": id, "choices": {}, "ready": True}
        ready = now.ready  # read first: whatever is there by then stays
        return {"id": id, "choices": now.found(), "ready": ready}

    def _compute_beside(self, shown: Shown) -> None:
        """Start the computations beside a question, which is on the screen now."""
        session, subject, now = self._session, self._subject, self._beside
        asker = session.current_asker()
        if now is not None and now.shown == shown.id and now.asker is asker:
            return
        before, since = None if now is None else now.outlook, tuple(self._since)
        self._beside, self._since = _Beside(shown.id, asker), []
        pending, query = session.next_told(), session.question()
        other = (pending is None or pending.id != shown.id) and not session.is_repeat(shown.id)
        instead: Iterator[None] = iter(())
        if query is not None and other and session.makes_askers:
            instead = session.restarts(query, shown.swapped)
        if pending is None or (twin := session.twin()) is None:
            self._background.start(instead)
            return  # the asker is done, or cannot be copied
        ahead = None
        if now is not None and now.ahead is not None and now.ahead.waits_for(asker, pending):
            ahead = now.ahead  # ``shown`` is, or was, a repeat
        elif session.makes_askers and not self._rounded(pending) and not other:
            ahead = LookAhead(
                asker, twin, pending, self._shown(pending).swapped, session.answering(pending)
            )
        counted = not session.is_repeat(shown.id)
        outlook = Outlook(
            twin, shown, pending, subject.stakes, self._ends, subject.seed, before, since, counted
        )
        self._beside = _Beside(shown.id, asker, ahead, outlook)
        looks = () if ahead is None else ahead.steps()
        self._background.start(chain(instead, looks, outlook.steps()))

    def _told_ahead(self, asker: Asker, answer: Answer) -> AfterAnswer | None:
        """Return the asker after an answer, if computed, and give up the other computations."""
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
        self._put = self._beside = self._weighed = None
        self._since = []
        self._background.stop()

    def _undo(self, id: str) -> dict[str, Any]:
        standing = [entry for entry in self._session.log if not entry.retracted]
        if not standing or standing[-1].answer.query.id != id:
            return self._screen(
                "Nothing was taken back, because that is no longer the last answer."
            )
        self._forget()
        self._chosen.stopped = False
        self._session.undo()
        return self._screen("Taken back.")

    def _withdraw(self, id: str) -> dict[str, Any]:
        if not any(
            entry.answer.query.id == id and not entry.retracted for entry in self._session.log
        ):
            return self._screen("Nothing was taken back, because that answer no longer stands.")
        self._forget()
        self._session.withdraw(id)
        return self._screen("Taken back. The other answers stay.")

    def _outlook(self, id: str) -> dict[str, Any]:
        """Return the notes beside a question, without taking the lock.

        Nobody waits for it, nor it for anybody.
        """
        now = self._beside
        outlook = now.outlook if now is not None and now.shown == id else None
        if outlook is None:
            why = [_FURTHER] if id.startswith(LEVEL) and not self._chosen.more else []
            to_come = None if self._chosen.more else self._as_forecast()
            return {
                "id": id,
                "why": why,
                "to_come": to_come,
                "at_least": sum(self._needed),
                "ready": True,
            }
        ready = outlook.ready  # read first: whatever is there by then stays
        answers, checks = self._needed
        to_come = (
            self._as_forecast()
            if outlook.to_come is None
            else [max(answers, number) + checks for number in outlook.to_come]
        )
        why = [*outlook.why]
        at_least = answers + checks
        return {"id": id, "why": why, "to_come": to_come, "at_least": at_least, "ready": ready}

    def _as_forecast(self) -> list[int] | None:
        """Return how many questions are to come by the welcome's forecast, or None."""
        length = None if self._prospects is None else self._prospects.length()
        left = 0 if length is None else length - self._put_so_far - 1
        return [left, left] if left >= max(1, sum(self._needed)) else None


def _number(text: str) -> int | None:
    """Return a planned number of questions or minutes, or None if there is none."""
    return int(text) if text.isdecimal() and len(text) < 5 and int(text) > 0 else None


def _minutes(n: int) -> str:
    return "1 minute" if n == 1 else f"{n} minutes"


def _in_whole_numbers(
    subject: Subject, query: Query, answered: Callable[[Query], bool]
) -> Query | None:
    """Return a query in whole numbers near one that is not, if any was not asked yet."""
    if shown_of(subject, query).exact:
        return None
    return next((near for near in near_in_whole_numbers(query) if not answered(near)), None)
