"""The interview: the screens that a host shows a person, and the messages that it sends back.

A host, such as a page or a widget, sends messages and draws the replies. Both are plain JSON, so
one front end (``page/interview.js``) serves all of them. An ``Interview`` may be used by several
threads, windows and people at once: one message is taken at a time, and an answer counts once.

Every message is ``{"do": ...}``, and its other parts are strings. Most replies are the screen to be
drawn now. Its ``stage`` is "welcome", "practice", "question", "conflict", "offer" or "end", and the
field of that name has what belongs to it alone (the practice has a ``question``). ``outlook``,
``prospects`` and ``consequences`` read what is computed beside a screen: their replies have
``ready``, and until it is true the host asks again. The page docs/interview-messages.md lists all
messages, and every field of the replies.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from inspect import signature
from typing import Any

from elicit._support.closing import Closing
from elicit.model.comparator import Comparator
from elicit.person.asker import Compares
from elicit.person.beside import Beside, Company, in_minutes
from elicit.person.course import offers
from elicit.person.course.conduct import Conduct
from elicit.person.course.counts import Counts, number_of
from elicit.person.course.kept_in_log import CHOICES, START, Choices
from elicit.person.course.level_questions import GUARDS, WIDE
from elicit.person.course.pace import FEW_HASTY, Pace
from elicit.person.drawing import Drawing
from elicit.person.mending import Mending
from elicit.person.next_question import NextQuestion
from elicit.person.session import Session
from elicit.person.showing import Shown, drawn, legend_of, practice, printable, said_of, shown_of
from elicit.person.showing import Subject as Subject
from elicit.tutors.answer_log import CONTRADICTS, Entry
from elicit.tutors.log_file import BadLog

_MORE_AFTER_CAUTION = 10  # answers until a caution that the person passed over is said again
_UNKNOWN_NEAR = 4  # answers from one look to the next, where nothing was computed beside them
_LONGEST_NAME = 80
_ONLY_READ = ("answers", "report", "download")
# these read a thread's results, so neither waits for the other
_READ_AT_ONCE = ("outlook", "prospects", "consequences")


class SavedWithoutScreen(Exception):
    """Error: the message was taken and is saved, but the next screen could not be made.

    The same message may be sent again. It counts only once, and the reply is then the screen.
    """


@dataclass(frozen=True, eq=False)
class Progress:
    """The state of an interview after its last message.

    Attributes
    ----------
    entries : tuple of Entry
        The answers so far, also those that were taken back.
    comparator : Comparator or None
        What is known of the person's scale. None if the asker does not say.
    stage : str or None
        The stage of the last screen. None if the person has not come yet.
    settled : bool
        True if that screen was a result that is settled.
    minutes : int or None
        The time that the person planned.
    """

    entries: tuple[Entry, ...]
    comparator: Comparator | None
    stage: str | None = None
    settled: bool = False
    minutes: int | None = None

    @property
    def answered(self) -> int:
        """Number of answers that stand, those to repeated questions among them."""
        return Counts.of(self.entries).answered

    @property
    def last(self) -> str | None:
        """The time of the last answer, as the log has it."""
        times = [entry.metadata.get("time") for entry in self.entries]
        return times[-1] if times else None


class Interview(Closing):
    """A session as screens and messages.

    While the person reads, a thread computes the next question after each possible answer.
    ``close``, or leaving the Interview as a context manager, ends it. The session stays open.

    Parameters
    ----------
    session : Session
    subject : Subject
    company : Company, optional
        What is shared with other interviews about the same subject in the same process.

    Raises
    ------
    ValueError
        For something that is no message. The methods also raise the errors of ``Session``, its
        asker and its log. After these the same message may be sent again.
    """

    def __init__(self, session: Session, subject: Subject, company: Company | None = None) -> None:
        self._session, self._subject = session, subject
        self._company = company or Company()
        self._lock = threading.RLock()
        self._over: str | None = None  # the note of an interview that takes no more answers
        self._started = self._practised = bool(session.log.standing)
        self._slipped = False  # at the practice question
        self._put: str | None = None  # id of the query that was logged last as shown
        self.shown: Shown | None = None
        """The question of the last screen, for hosts that draw it themselves; None if it has
        none.
        """
        # a person who resumes without an answer sees the welcome, and chooses again
        self._chosen = Choices.of(session.log.asked) if self._started else Choices()
        self._kept = replace(self._chosen)  # as the log has them
        self._questions = NextQuestion(session, subject, self._chosen)
        self._drawing = Drawing(session, subject, self._chosen, self._questions)
        self._mending = Mending(session, subject, self._chosen, self._drawing)
        self._beside = Beside(session, subject, self._chosen, self._drawing, self._company)
        self._does: dict[str, Callable[..., dict[str, Any]]] = {
            "state": lambda: self._screen(),
            "start": self._begin,
            "practised": self._after_practice,
            "practise": self._practise,
            "answer": self._answer,
            "undo": self._undo,
            "withdraw": self._withdraw,
            "settle": self._settle,
            "choose": self._choose,
            "finish": self._finish,
            "result": self._result,
            "more": self._go_on,
            "outlook": self._beside.outlook,
            "prospects": lambda: self._beside.prospects(self._started),
            "consequences": self._beside.consequences,
            "answers": self._drawing.answers,
            "report": self._drawing.report,
            "download": self._drawing.download,
        }
        self.progress = self._progress(None)
        """The state of the interview after the last message."""

    def handle(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Return the reply to a message.

        Parameters
        ----------
        message : mapping
            As docs/interview-messages.md describes it.

        Returns
        -------
        dict
            JSON.

        Raises
        ------
        ValueError
            For something that is no message.
        SavedWithoutScreen
            If the message is saved, but what comes next could not be computed.
        """
        parts = dict(message) if isinstance(message, Mapping) else {}
        do = str(parts.pop("do", None))
        does = self._does.get(do)
        if does is None or not all(isinstance(value, str) for value in parts.values()):
            raise ValueError(
                f'a message says what to "do", one of {", ".join(self._does)}, and strings besides'
            )
        try:
            signature(does).bind(**parts)
        except TypeError:
            raise ValueError("the parts of this message are not those it should have") from None
        if do in _READ_AT_ONCE:
            return does(**parts)
        with self._lock, self._company.turns.reply():
            only_reads = do in _ONLY_READ
            before = self._written()
            try:
                if self._over is not None and not only_reads:
                    return self._after_all(self._over)
                screen = does(**parts)
                self.progress = self._progress(self.progress, None if only_reads else screen)
            except (OSError, BadLog):
                raise  # the log was not written, and nothing has changed
            except (KeyboardInterrupt, SystemExit):
                raise
            except BaseException as error:  # a panic of compiled Rust code is no Exception
                self._begin_anew()
                if self._written() == before:
                    raise
                raise SavedWithoutScreen(f"after {do!r}: {error}") from error
            return screen

    def _written(self) -> tuple[int, int]:
        """Return the numbers of answers in the log, and of those that were taken back."""
        log = self._session.log
        return len(log), sum(entry.retracted for entry in log)

    def _begin_anew(self) -> None:
        """Discard all that was computed, because a failure may have left it half done.

        The next message computes it again from the log.
        """
        self._forget()
        self._session.discard()

    @property
    def who(self) -> str:
        """The name of the person, for messages to the person who runs the program."""
        return printable(self._session.who or "a person without a name")

    def take_no_more(self, note: str) -> None:
        """Take no more answers. From now on every screen is the result, with this note.

        After this returns, nothing more is written to the log.

        Parameters
        ----------
        note : str
        """
        with self._lock:
            self._over = printable(note)
            self._beside.stop()

    def close(self) -> None:
        """End the background computation.

        The session stays open, and the interview may be used again.
        """
        self._beside.close()

    def table(self, what: str) -> list[dict[str, Any]]:
        """Return a table to keep, as a list of rows: {column: value}.

        Parameters
        ----------
        what : {"scale", "plan", "outcomes", "answers"}

        Returns
        -------
        list of dict
        """
        return self._drawing.table(what)

    def _progress(
        self, before: Progress | None, screen: Mapping[str, Any] | None = None
    ) -> Progress:
        """Return the progress of the interview, given the screen that the person sees now.

        If there is no screen, the stage is that of ``before``.
        """
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
        standing, conduct = session.log.standing, session.conduct()
        screen = self._screen_of(standing, conduct, note)
        if not standing and not self._practised and not self._chosen.stopped:
            if not self._started and session.question() is not None:
                self.shown = None
                self._foresee(conduct)
                return {**screen, "welcome": self._drawing.welcome()}
            if session.question() is not None:
                shown = practice(self._subject.labels, words, self._subject.of, self._subject.seed)
                self.shown = shown
                self._beside.start(self._first_question())
                return {**screen, "stage": "practice", "question": {**drawn(shown, 0), "check": ""}}
        caution = (
            conduct.caution()
            if conduct.given >= self._chosen.heard + _MORE_AFTER_CAUTION
            or (conduct.taken_back and not self._chosen.heard)
            else None
        )
        if conflict := self._mending.conflict():
            self.shown = None
            self._beside.weigh(conflict)
            return {**screen, "stage": "conflict", "conflict": conflict}
        if self._chosen.stopped or (caution and self._subject.least):
            self.shown = None
            self._keep()
            return {**screen, "stage": "end", "end": self._drawing.end(False)}
        if offer := self._offer(conduct):
            self.shown = None
            return {**screen, "stage": "offer", "offer": offer}
        query = session.question()
        shown_now = None if query is None else shown_of(self._subject, query)
        if query is None or shown_now is None or not shown_now.exact:
            self.shown = None
            # an answer to rounded numbers could make the statements at the end untrue
            return {**screen, "stage": "end", "end": self._drawing.end(shown_now is not None)}
        if self._put != shown_now.id or self._chosen != self._kept:
            self._log_shown(shown_now)
        self.shown = shown_now
        needed = self._questions.still_needed(conduct, shown_now.id)
        near, only = self._questions.nearness(conduct), self._questions.only_checks()
        check = self._mending.note(query)
        reason = GUARDS if self._mending.is_implied(query) else ""
        narrow = self._questions.to_narrow()
        self._beside.accompany(shown_now, conduct, needed, only, near, reason, narrow)
        return {
            **screen,
            "stage": "question",
            "question": {
                **drawn(shown_now, number_of(session.log, shown_now.id)),
                "check": check,
            },
        }

    def _foresee(self, conduct: Conduct) -> None:
        """Start to compute the forecasts on the welcome screen."""
        question = self._session.question()
        if question is not None:
            needed = self._questions.still_needed(conduct, question.id)
            self._beside.foresee(needed, self._questions.to_narrow(WIDE))

    def _first_question(self) -> Iterator[None]:
        """Compute the first question in a step, while the person practises."""
        with self._lock:
            self._session.question()
        yield

    def _forget(self, answered: bool = False) -> None:
        """Discard what was shown and computed."""
        self._put = None
        self._beside.forget(answered)

    def _screen_of(
        self, standing: Sequence[Entry], conduct: Conduct, note: str | None
    ) -> dict[str, Any]:
        """Return the parts of a screen that do not depend on its stage."""
        words = self._subject.words
        last = standing[-1].answer if standing else None
        pace = Pace.of(self._session.log)
        said = last and {"id": last.query.id, "sentence": said_of(self._subject, last)}
        return {
            "title": printable(words.title),
            "preamble": printable(words.preamble),
            "note_beside": printable(words.note),
            "legend": legend_of(self._subject),
            "stage": "welcome",
            "answered": conduct.put,
            "saved": Counts.of(self._session.log).answered,
            "open_conflicts": sum(CONTRADICTS in e.metadata and not e.used for e in standing),
            "budget": self._planned(conduct),
            "until": "settled" if self._chosen.width is None else "values",
            "time": {"planned": self._chosen.minutes, "spent": pace.spent, "pace": pace.seconds},
            "last": said,
            "note": note,
            "may_practise": self._slipped and self._practised and not standing,
            "welcome": None,
            "question": None,
            "conflict": None,
            "offer": None,
            "end": None,
        }

    def _planned(self, conduct: Conduct) -> int | None:
        """Return the number of questions that the person planned, or has time for, or None."""
        if self._chosen.minutes is None:
            return self._chosen.budget
        pace = Pace.of(self._session.log)
        return conduct.put + pace.questions_in(self._chosen.minutes)

    def _keep(self) -> None:
        """Log the person's choices if they have changed, although no question is on the screen.

        They are logged together with the next question. If there is none, or it cannot be shown
        exactly, nothing is logged.
        """
        if self._chosen == self._kept:
            return
        query = self._session.question()
        shown = None if query is None else shown_of(self._subject, query)
        if shown is not None and shown.exact:  # otherwise the end comes without a choice
            with suppress(OSError):  # the result is shown all the same
                self._log_shown(shown)

    def _log_shown(self, shown: Shown) -> None:
        """Log the question that is put now, the person's choices if they changed, and the start."""
        changed = {CHOICES: self._chosen.record()} if self._chosen != self._kept else {}
        if start := self._questions.start_to_keep():
            changed[START] = start
        self._session.shown(shown.id, shown.swapped, shown=shown.record(), **changed)
        self._put, self._kept = shown.id, replace(self._chosen)

    def _begin(
        self, who: str = "", budget: str = "", minutes: str = "", until: str = ""
    ) -> dict[str, Any]:
        self._started, self._chosen.stopped = True, False
        if who.strip() and self._session.log.who is None and not self._session.log.standing:
            self._session.stamp(printable(who.strip())[:_LONGEST_NAME])
        self._chosen.budget, self._chosen.minutes = _number(budget), _number(minutes)
        if until != "values":
            self._chosen.width = None
        elif not self._chosen.all_told:  # whoever asked for more goes on so far
            self._chosen.width = WIDE
        return self._screen()

    def _practise(self) -> dict[str, Any]:
        """Return to the practice question, unless another one was answered."""
        if self._slipped and not self._session.log.standing:
            self._practised = self._slipped = False
            self._beside.forget()
        return self._screen()

    def _after_practice(self, choice: str) -> dict[str, Any]:
        self._started = self._practised = True
        shown = practice(
            self._subject.labels, self._subject.words, self._subject.of, self._subject.seed
        )
        obvious = "b" if shown.swapped else "a"
        if self._session.question() is None:
            return self._screen()
        self._slipped = choice != obvious
        if not self._slipped:
            return self._screen("That is how it works. Now the real questions.")
        worst, best = (printable(self._subject.labels[i]) for i in (0, -1))
        mistake = ""
        if choice in ("a", "b"):
            mistake = f"Everyone in {choice.upper()} is “{worst}”: perhaps that was a mistake. "
        return self._screen(
            f"Most people choose {obvious.upper()}, because everyone in it is “{best}”. {mistake}"
            "You can try again, or go on: this is the first real question."
        )

    def _answer(self, id: str, choice: str) -> dict[str, Any]:
        query = self._session.question()
        if query is None or query.id != id:
            said = next(
                (e for e in reversed(self._session.log.standing) if e.answer.query.id == id),
                None,
            )
            if said is None:
                return self._screen("That question is no longer open. This is the current one.")
            if shown_of(self._subject, said.answer.query).verdict(choice) == said.answer.verdict:  # type: ignore[arg-type]
                return self._screen()  # the answer was sent twice
            return self._screen(
                "That question was already answered, perhaps in another window: "
                f"{said_of(self._subject, said.answer)}. That answer stands. You can take it back."
            )
        verdict = shown_of(self._subject, query).verdict(choice)  # type: ignore[arg-type]  # which raises ValueError
        waits = self._session.next_told()
        self._session.answer(id, verdict, ahead=self._beside.told_ahead)
        self._started = self._practised = True
        self._chosen.stopped = False
        said = self._session.log[-1]
        if not said.repeat and (waits is None or waits.id != id):
            self._forget(answered=True)  # there is another asker now
        return self._screen(self._about_haste())

    def _about_haste(self) -> str | None:
        """Return a remark on the first few answers that came very fast, once in a session."""
        few = Pace.of(self._session.log).hasty < FEW_HASTY
        if few or self._chosen.slowed or not self._subject.least:
            return None
        self._chosen.slowed = True
        return "Some answers came in under a second. There is no hurry: take the time you need."

    def _offer(self, conduct: Conduct) -> dict[str, Any] | None:
        """Return the offer to the person before the next question, or None."""
        n, least = conduct.put, self._subject.least
        if n <= self._chosen.offered or not least:
            return None
        if conduct.offers:
            return offers.after_unsure(conduct.in_a_row, self._questions.nearly(conduct))
        planned, minutes = self._planned(conduct), self._chosen.minutes
        if planned is not None and n >= planned and self._session.question() is not None:
            over = (
                f"You planned {planned} questions, and answered {n}"
                if minutes is None
                else f"Your {in_minutes(minutes)} {'is' if minutes == 1 else 'are'} over, and you "
                f"answered {n} questions"
            )
            return offers.after_plan(over, self._questions.nearly(conduct))
        if self._chosen.width is not None or not offers.nearly_is_due(
            conduct, self._chosen.offered
        ):
            return None
        # a result of a large model takes a second: mostly it was computed beside the last question
        near = self._beside.near()
        if near or (near is None and n % _UNKNOWN_NEAR == 0):
            known = self._beside.result_of(self._session.current_asker())
            nearly = self._questions.nearly(conduct, known)
            asks_on = self._session.question() is not None and not self._questions.only_checks()
            if nearly is not None and asks_on:
                return offers.after_little_loss(nearly, self._beside.to_come(), planned is not None)
        return None

    def _choose(self, option: str) -> dict[str, Any]:
        if option not in ("other", "on", "finish"):
            raise ValueError(f"option must be 'other', 'on' or 'finish', not {option[:40]!r}")
        if option == "finish":
            return self._finish()
        conduct = self._session.conduct()
        self._chosen.offered = conduct.put
        planned = self._planned(conduct)
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
        session = self._session
        screen = self._screen_of(session.log.standing, session.conduct(), None)
        return {**screen, "stage": "end", "end": self._drawing.end(False)}

    def _go_on(self) -> dict[str, Any]:
        conduct = self._session.conduct()
        self._started = self._practised = True
        self._chosen.stopped = False
        if conduct.caution() is not None:
            self._chosen.heard = conduct.given
        self._chosen.offered = conduct.put
        if self._session.question() is None:  # first until no range is wide, as the result says
            self._chosen.width = self._questions.next_width()
        return self._screen()

    def _settle(self, id: str, choice: str) -> dict[str, Any]:
        conflict = self._mending.conflict()
        if conflict is None or conflict["id"] != id:
            return self._screen("That was settled already, perhaps in another window.")
        self._forget()
        return self._screen(self._mending.settle(conflict, choice))

    def _undo(self, id: str) -> dict[str, Any]:
        standing = self._session.log.standing
        if not standing or standing[-1].answer.query.id != id:
            return self._screen(
                self._mending.taken_back_before(id)
                or "Nothing was taken back, because that is no longer the last answer."
            )
        before = self._is_settled()
        self._forget()
        self._chosen.stopped = False
        self._session.undo()
        return self._taken_back("Taken back.", id, before)

    def _withdraw(self, id: str) -> dict[str, Any]:
        if not any(entry.answer.query.id == id for entry in self._session.log.standing):
            return self._screen(
                self._mending.taken_back_before(id)
                or "Nothing was taken back: there is no such answer."
            )
        before = self._is_settled()
        self._forget()
        return self._taken_back(f"Taken back.{self._mending.take_back(id)}", id, before)

    def _is_settled(self) -> bool:
        """Return whether the result is settled, also if the person sees a question after the end.

        Before the first end no result is settled, and computing one would take time.
        """
        if self.progress.settled or self._chosen.width is None:
            return self.progress.settled
        return self._drawing.is_settled()

    def _taken_back(self, said: str, id: str, before: bool) -> dict[str, Any]:
        """Return the screen after an answer was taken back, with a note on what became of it.

        ``before`` says whether the result was settled before that.
        """
        screen = self._screen()
        end = screen["end"]
        now = (
            self._chosen.width is not None and self._drawing.is_settled()
            if end is None
            else end["settled"]
        )
        became = {
            (True, True): " The result is still settled: the answers that stand suffice.",
            (True, False): " The result is no longer settled without it.",
            (False, True): " The answers that stand settle the result.",
        }
        other = screen["question"] is not None and screen["question"]["id"] != id
        next_one = " Another question comes now." if other else ""
        return {**screen, "note": f"{said}{became.get((before, now), '')}{next_one}"}


def _number(text: str) -> int | None:
    """Return a planned number of questions or minutes, or None if there is none."""
    return int(text) if text.isdecimal() and len(text) < 5 and int(text) > 0 else None
