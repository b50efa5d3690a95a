"""Computations beside the screens of an interview, in a thread, while the person reads.

They are: the next question after each possible answer, the notes beside a question, the forecasts
on the welcome screen, and the result of each choice in a conflict. Messages that ask for these get
what is known by then, without waiting.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from elicit._support.background import Background, Turns
from elicit._support.closing import Closing
from elicit.model.query import Answer, Query, Verdict
from elicit.person.asker import AfterAnswer, Asker, Compares, LookAhead, Supposed
from elicit.person.course.conduct import AGAIN, LEAST_CHECKS, ORDER, Conduct
from elicit.person.course.conflicts import Consequences
from elicit.person.course.forecast import AtQuestion, QuestionsToCome
from elicit.person.course.kept_in_log import Choices
from elicit.person.course.level_questions import FURTHER, LEVEL, questions_left
from elicit.person.course.offers import nearly_from
from elicit.person.course.pace import Pace
from elicit.person.drawing import MINUTES, Drawing
from elicit.person.mending import each_supposed
from elicit.person.outlook import Outlook, Prospects
from elicit.person.session import Session
from elicit.person.showing import Shown, Subject, shown_of

_CHECK = "Some questions check your answers. They show how far these can be relied on."
_ORDER = "This question checks that you see the levels in the order in which they are listed."


@dataclass(frozen=True, eq=False)
class _Computed:
    """Results of the computations for a question on the screen, whose id is ``shown``.

    ``ahead`` and ``outlook`` are None if they cannot be computed, for example because the asker
    cannot be copied.
    """

    shown: str
    asker: Asker
    ahead: LookAhead | None = None
    outlook: Outlook | None = None


class Company(Closing):
    """Shared work of several interviews about the same subject. ``close`` ends it.

    Parameters
    ----------
    several : bool
        True if there are several interviews. Shared work then goes on if one of them no longer
        needs it.
    """

    def __init__(self, several: bool = False) -> None:
        self.turns = Turns()
        self._several, self._lock = several, threading.Lock()
        self._background = Background(self.turns)
        self._prospects: Prospects | None = None

    def foresee(self, prospects: Prospects, own: Background) -> Prospects:
        """Have an interview's forecasts computed in a thread, and return the object that gets them.

        Before the first answer, forecasts for the same numbers of questions are the same for all
        people. So with ``several`` interviews the first one's forecasts are shared by all that plan
        with the same numbers of questions.

        Parameters
        ----------
        prospects : Prospects
            The interview's forecasts, not yet computed.
        own : Background
            The interview's own thread, which computes them if they are not shared.

        Returns
        -------
        Prospects
            The shared forecasts, or else ``prospects``.
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
        """End the background work."""
        self._background.close()


class Beside(Closing):
    """Computes in a thread while the person reads the screens of an interview.

    The results can be read without waiting for a message that is being answered.

    Parameters
    ----------
    session : Session
    subject : Subject
    chosen : Choices
        The person's choices, which may change.
    drawing : Drawing
    company : Company
        What is shared with other interviews.
    """

    def __init__(
        self,
        session: Session,
        subject: Subject,
        chosen: Choices,
        drawing: Drawing,
        company: Company,
    ) -> None:
        self._session, self._subject = session, subject
        self._chosen, self._drawing = chosen, drawing
        self._company = company
        self._background = Background(company.turns)
        self._beside: _Computed | None = None
        self._prospects: Prospects | None = None
        self._values = ""  # how many questions until no level's range is wide, in words
        self._pace = Pace()  # then: without the lock the log must not be read
        self._weighed: Consequences[Supposed] | None = None
        self._since: list[Verdict | None] = []  # verdicts since then
        self._to_come = QuestionsToCome(
            chosen,
            least=subject.least,
            checks=session.audits,
            asks_on=subject.enough is not None,
            slow=subject.enough_is_slow,
        )
        self._stated: float | None = None  # the loss that was last stated
        self._near: bool | None = None  # at the last question that has notes
        self._results: tuple[tuple[Asker, Any], ...] = ()  # after the last answer
        self._reason = ""  # for this question, if its card says why it comes

    def start(self, steps: Iterator[None]) -> None:
        """Compute these steps in place of the present ones."""
        self._background.start(steps)

    def stop(self) -> None:
        """Stop the present computation."""
        self._background.stop()

    def close(self) -> None:
        """Stop the present computation, and wait until its thread has ended."""
        self._background.close()

    def foresee(self, needed: tuple[int, int], to_narrow: tuple[int, int]) -> None:
        """Start to compute what each planned number of questions is likely to prove.

        Parameters
        ----------
        needed : (2,) int
            Numbers of answers, and of checks, that must come after the first question.
        to_narrow : (2,) int
            The fewest and the most questions until no level's range is wide.
        """
        self._values = self._until_values(needed, to_narrow)
        if self._prospects is None and (twin := self._session.twin()) is not None:
            self._pace = pace = Pace.of(self._session.log)
            numbers = [pace.questions_in(minutes) for minutes in MINUTES]
            subject = self._subject
            enough = None if subject.enough_is_slow else subject.enough
            prospects = Prospects(twin, numbers, subject.seed, self._ends, enough)
            self._prospects = self._company.foresee(prospects, self._background)
            self._to_come.simulated = self._prospects

    def prospects(self, started: bool) -> dict[str, Any]:
        """Return what each planned number of questions is likely to prove, as far as it is known.

        Parameters
        ----------
        started : bool
            True if the person has left the welcome.
        """
        now = self._prospects
        if now is None:
            return {"budgets": [], "settled": "", "values": self._values, "ready": True}
        # once the person has started, the computation is given up
        ready = now.ready or started
        length, settled = now.length(), ""
        if length is not None:
            most = max(length, self._subject.least + LEAST_CHECKS)
            settled = (
                f"Half of the simulated sessions took at most {most} questions, about "
                f"{in_minutes(self._pace.minutes_for(most))}."
            )
        return {
            "budgets": [self._drawing.in_prospect(found) for found in now.found()],
            "settled": settled,
            "values": self._values,
            "ready": ready,
        }

    def _until_values(self, needed: tuple[int, int], to_narrow: tuple[int, int]) -> str:
        """Return a sentence on how many questions it takes until no level's range is wide, or "".

        The numbers are those of ``accompany``, for the first question.
        """
        subject, pace = self._subject, self._pace
        if not to_narrow[1] or not subject.least:
            return ""
        levels_left = self._levels_left(subject.enough is not None and not subject.enough_is_slow)
        first = AtQuestion(Conduct.of(()), needed, levels_left, to_narrow)
        least, most = (1 + n for n in self._to_come.until_settled(first))
        return (
            f"In all it mostly takes {least} to {most} questions, about "
            f"{pace.minutes_for(least)} to {in_minutes(pace.minutes_for(most))}."
        )

    def _levels_left(self, asks_on: bool) -> tuple[int, int] | None:
        """Return the fewest and the most questions about levels from this one on, or None.

        The result is None if the interview will not ask about levels by itself (``asks_on`` is
        False), or if the number is not known.
        """
        asker = self._session.current_asker()
        if not asks_on or not isinstance(asker, Compares):
            return None
        return questions_left(asker.comparator)

    def weigh(self, conflict: Mapping[str, Any]) -> None:
        """Start to compute the result of each choice in a conflict."""
        session, id = self._session, str(conflict["id"])
        if not session.makes_askers or (self._weighed and self._weighed.id == id):
            return
        last = next(e for e in reversed(session.log) if e.answer.query.id == id)
        choices = [str(one["choice"]) for one in conflict["choices"]]
        suppose = each_supposed(session, last, choices)
        d = last.answer.query.d
        sides = [np.flatnonzero(side[1:-1]) + 1 for side in (d > 0, d < 0)]  # ends are fixed
        level = min((side for side in sides if len(side)), key=len, default=sides[0])
        levels = level[-2:].tolist()[::-1]
        self._weighed = Consequences(id, suppose, partial(self._drawing.left_by, levels))
        self._background.start(self._weighed.steps())

    def consequences(self, id: str) -> dict[str, Any]:
        """Return the result that each choice in a conflict would lead to, as far as it is known."""
        now = self._weighed
        if now is None or now.id != id:
            return {"id": id, "choices": {}, "ready": True}
        ready = now.ready  # read first: whatever is there by then stays
        return {"id": id, "choices": now.found(), "ready": ready}

    def accompany(
        self,
        shown: Shown,
        conduct: Conduct,
        needed: tuple[int, int],
        no_others: bool = False,
        near: Callable[[Any], bool] | None = None,
        reason: str = "",
        to_narrow: tuple[int, int] = (0, 0),
    ) -> None:
        """Start the computations for the question that is now on the screen.

        Parameters
        ----------
        shown : Shown
        conduct : Conduct
            The conduct in the answers before this question.
        needed : (2,) int
            Numbers of answers, and of checks, that must still come after this one.
        no_others : bool
            True if no questions but the needed ones come after this one.
        near : callable, optional
            Takes a result, and returns whether little could be lost by stopping. None: this is not
            computed.
        reason : str
            Why the question comes, if the note on its card says so. "Why this question?" then gives
            the same reason.
        to_narrow : (2,) int
            The fewest and the most questions until no level's range is wide, if the person chose to
            go on so far.
        """
        self._reason = reason
        session, subject, now = self._session, self._subject, self._beside
        may_change = not (session.is_repeat(shown.id) or shown.id.startswith(ORDER))
        asker = session.current_asker()
        enough, more = subject.enough, self._chosen.all_told
        known = more or to_narrow[1] > 0 or session.next_told() is not None
        if not subject.least or (subject.enough_is_slow and known):
            enough = None  # more questions come in any case
        asks_on = enough is not None and not enough(session.result())
        levels_left = self._levels_left(more or asks_on)
        self._to_come.go_on_to(
            AtQuestion(conduct, needed, levels_left, to_narrow, no_others, may_change)
        )
        if now is not None and now.shown == shown.id and now.asker is asker:
            return
        before, since = None if now is None else now.outlook, tuple(self._since)
        self._note(now)
        self._beside, self._since = _Computed(shown.id, asker), []
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
            swapped = shown_of(subject, pending).swapped
            ahead = LookAhead(asker, twin, pending, swapped, session.answering(pending))
        counted = not session.is_repeat(shown.id)
        outlook = Outlook(
            twin, shown, pending, subject.stakes, self._ends, subject.seed, before, since, counted
        )
        outlook.stated, outlook.is_near, outlook.reason = self._stated, near, reason
        outlook.why = (reason,) if reason else ()  # at once
        if ahead is not None and conduct.put + 1 >= nearly_from(self._chosen.offered):
            ahead.is_near, outlook.if_near = near, ahead.results
        self._beside = _Computed(shown.id, asker, ahead, outlook)
        looks = () if ahead is None else ahead.steps()
        self._background.start(chain(instead, looks, outlook.steps()))

    def to_come(self) -> tuple[int, int] | None:
        """Return the range of questions left after the last one, or None if it is not known."""
        outlook = None if self._beside is None else self._beside.outlook
        if outlook is None or outlook.to_come is None or self._chosen.all_told:
            return None
        return self._to_come.shown(outlook.to_come)

    def near(self) -> bool | None:
        """Return whether little could be lost by stopping at the last question; None if unknown."""
        outlook = None if self._beside is None else self._beside.outlook
        return self._near if outlook is None else outlook.near

    def result_of(self, asker: Asker) -> Any:
        """Return the asker's result if it was computed before the last answer, otherwise None."""
        now = self._beside
        untold = not self._since and self._session.makes_askers
        if untold and now is not None and now.outlook is not None and now.asker is asker:
            return now.outlook.result  # a check was answered, which the asker is not told
        return next((result for one, result in self._results if one is asker), None)

    def _note(self, now: _Computed | None) -> None:
        """Keep two results of the last question before its other results are replaced.

        They are whether little could be lost by stopping there, and the loss that its notes stated.
        """
        outlook = None if now is None else now.outlook
        if now is None or outlook is None:
            return
        self._near = outlook.near
        if outlook.counted and outlook.loss is not None and not now.shown.startswith(ORDER):
            self._stated = outlook.loss

    def told_ahead(self, asker: Asker, answer: Answer) -> AfterAnswer | None:
        """Return the asker after an answer if it was made ahead, and stop other computations."""
        ahead = None if self._beside is None else self._beside.ahead
        found = None if ahead is None else ahead.told(asker, answer)
        self._results = () if ahead is None else ahead.found
        self._background.stop()
        self._since.append(answer.verdict)
        return found

    def _rounded(self, query: Query) -> bool:
        return not shown_of(self._subject, query).exact

    def _ends(self, query: Query) -> bool:
        """Return whether a session like this one would end in place of asking a query."""
        return not self._session.makes_askers and self._rounded(query)

    def forget(self, answered: bool = False) -> None:
        """Discard what was computed, and stop the rest.

        Parameters
        ----------
        answered : bool
            True if the only reason is one more answer.
        """
        self._note(self._beside)
        if not answered:
            self._stated = None  # it is no longer compared with: other answers stand
            self._near = None
        self._beside = self._weighed = None
        self._since = []
        self._background.stop()

    def outlook(self, id: str) -> dict[str, Any]:
        """Return the notes shown with a question, as far as they are known."""
        now = self._beside
        outlook = now.outlook if now is not None and now.shown == id else None
        if outlook is None:
            settled = self._chosen.all_told or self._to_come.now.to_narrow[1]
            why = [FURTHER] if id.startswith(LEVEL) and not settled else []
            why = [self._reason] if self._reason else why
            why = [_CHECK] if id.endswith(AGAIN) else why
            forecast = self._to_come.reply(None, None)
            if now is None or now.shown != id:  # it is not the question on the screen
                forecast.update(to_come=None, rose=False, near=False)
            return {"id": id, "why": why, **forecast, "ready": True}
        ready = outlook.ready  # read first: whatever is there by then stays
        forecast = self._to_come.reply(outlook.to_come, outlook.likely)
        why = [*outlook.why]
        if not outlook.counted:
            why = [_CHECK]
        elif id.startswith(ORDER):
            why = [_ORDER]
        return {
            "id": id,
            "why": why,
            **forecast,
            "ready": ready,
        }


def in_minutes(n: int) -> str:
    """Return a number of minutes in words."""
    return "1 minute" if n == 1 else f"{n} minutes"
