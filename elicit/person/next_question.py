"""The questions that an interview puts beside those of its asker.

Some take the place of the asker's question: a check of the order, another kind of question, or a
question in whole numbers. Others come once the asker has none.
``elicit.person.course.level_questions`` makes those about a level.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from elicit.model.query import Query
from elicit.model.scale import Floats
from elicit.person.asker import Compares
from elicit.person.course.conclusion import NearlyEnough
from elicit.person.course.conduct import IN_CONFLICT, ORDER, SETTLED, Conduct
from elicit.person.course.counts import status_of
from elicit.person.course.kept_in_log import Before, Choices, Start
from elicit.person.course.level_questions import (
    FINE,
    LEVEL,
    NARROW,
    WIDE,
    known_question,
    level_question,
    order_question,
    questions_to_narrow,
)
from elicit.person.course.offers import NEARLY_FROM, may_be_near
from elicit.person.course.ranges import counted_widths, draws_again, outwards, value_ranges
from elicit.person.findings import asked_levels
from elicit.person.session import Session
from elicit.person.showing import Subject, near_in_whole_numbers, shown_of

_TIMES = 2  # as many questions about levels as it mostly takes, after which no more are put
_ORDER_AFTER = 4  # answers before the question about the order of two levels


class NextQuestion:
    """Chooses a session's questions that are not those of its asker.

    Parameters
    ----------
    session : Session
    subject : Subject
    chosen : Choices
        The person's choices, which may change.
    """

    def __init__(self, session: Session, subject: Subject, chosen: Choices) -> None:
        self._session, self._subject, self._chosen = session, subject, chosen
        self._start: Start | Before | None = None  # found when it is first needed
        session.choose_replacement = self._replacement
        if subject.least:
            session.choose_first = self._taken_back_last
            session.choose_extra = self._extra
            session.check_regularly()

    def at_start(self) -> Start | Before | None:
        """Return what was known before the first answer, or None if it can no longer be found."""
        facts = self._subject.facts.of
        if self._start is None and facts:
            self._start = Before.kept(self._session.log.asked, facts)
        if self._start is None:
            empty = not self._session.log.standing
            asker = self._session.current_asker() if empty else self._session.at_start()
            if asker is None:
                return None
            self._start = start = Start(asker)
            if empty:  # the asker goes on
                _ = start.loss, start.finished
        return self._start

    def start_to_keep(self) -> dict[str, Any] | None:
        """Return the state before the first answer as JSON, or None if the log has it already."""
        start, facts = self._start, self._subject.facts.of
        before = start.computed() if facts and isinstance(start, Start) else None
        if before is None:
            return None
        self._start = before
        return before.record(facts)

    def about_a_level(self, known: bool = False) -> Query | None:
        """Return a question about the value of a level that is still open.

        If there is none and ``known`` is True, return a question whose answer follows from others.
        """
        asker = self._session.current_asker()
        if not isinstance(asker, Compares):
            return None
        answered, of = self._session.answered_before(), self._subject.of
        asked = asked_levels(self._session.log)
        found = level_question(asker.comparator, of, answered, asked)
        if found is None and known:
            return known_question(asker.comparator, of, answered)
        return found

    def to_narrow(self, width: float | None = None) -> tuple[int, int]:
        """Return the fewest and the most questions until no level's range is wide.

        They are 0 if the person did not choose to go on so far, or goes on further, or nothing more
        can be asked. ``width`` may be what they would choose. A posterior is learned again, which
        takes a while, only where its own ranges are narrow.
        """
        asker = self._session.current_asker()
        wanted = self._chosen.width if width is None else width
        if wanted is None or wanted <= NARROW or not isinstance(asker, Compares):
            return 0, 0
        known = asker.comparator
        put = sum(entry.answer.query.id.startswith(LEVEL) for entry in self._session.log.standing)
        if put >= _TIMES * questions_to_narrow([100.0] * (known.k - 2), wanted)[1]:
            return 0, 0  # the answers narrow nothing
        left = _until_narrow(value_ranges(known), wanted)
        if not left[1]:
            left = _until_narrow(value_ranges(known, draws_again(known)), wanted)
        return left if left[1] and self.about_a_level() is not None else (0, 0)

    def next_width(self) -> float:
        """Return the width to which questions would narrow ranges next, if the person goes on."""
        now = self._chosen.width
        steps = [width for width in (WIDE, FINE) if now is None or width < now]
        return next((width for width in steps if self.to_narrow(width)[1]), NARROW)

    def still_needed(self, conduct: Conduct, id: str) -> tuple[int, int]:
        """Return the numbers of answers, and of checks, that must come after this question."""
        if not self._subject.least:
            return 0, 0
        answers = conduct.with_verdict + (not self._session.is_repeat(id))
        further = max(0, self._subject.least - answers)
        return further, self._session.checks_left(id, further)

    def nearly(self, conduct: Conduct, result: Any = None) -> NearlyEnough | None:
        """Return a statement that little could be lost by stopping now, or None.

        There is none without enough answers and checks, or if nothing is at stake. ``result`` is
        the session's, if it was computed already.
        """
        if not may_be_near(conduct, self._subject.least) or (start := self._staked()) is None:
            return None
        now = self._session.result() if result is None else result
        return self._subject.nearly(now, start.loss)

    def nearness(self, conduct: Conduct) -> Callable[[Any], bool] | None:
        """Return a function that takes a result and says whether little could be lost by stopping.

        It may be called in another thread. None is returned if the person would not be offered to
        stop for this reason after the next answer.

        Parameters
        ----------
        conduct : Conduct
            The conduct in the answers before the question on the screen.
        """
        if not self._subject.least or self._chosen.all_told or conduct.put + 1 < NEARLY_FROM:
            return None
        if (start := self._staked()) is None:
            return None
        nearly, loss = self._subject.nearly, start.loss
        return lambda result: nearly(result, loss) is not None

    def _staked(self) -> Start | Before | None:
        """Return what was known before the first answer, or None if nothing was at stake then."""
        start = self.at_start()
        return None if start is None or start.finished else start

    def only_checks(self) -> bool:
        """Return whether no question is left but those that are still needed."""
        if not self._subject.least or self._chosen.all_told:
            return False
        enough = self._subject.enough
        over = self._session.next_told() is None and not self.to_narrow()[1]
        return over and (enough is None or enough(self._session.result()))

    def only_values(self, conduct: Conduct) -> bool:
        """Return whether the result has all it needs, and questions left only narrow ranges."""
        chosen, enough = self._chosen, self._subject.enough
        if chosen.width is None or conduct.with_verdict < self._subject.least:
            return False
        if chosen.all_told:
            return True  # it came to its end before
        if self._session.next_told() is not None:
            return False
        checked = conduct.passed or self._session.confirming() is None
        return checked and (enough is None or enough(self._session.result()))

    def _taken_back_last(self) -> Query | None:
        """Return the question whose answer was taken back since the last answer, or None.

        A check that was taken back, and an answer that was not kept, do not count.
        """
        log = [*self._session.log]
        if not log or not any(entry.retracted for entry in log):
            return None
        last = max(str(entry.metadata.get("time", "")) for entry in log)
        since = [
            (str((entry.retraction or {}).get("time", "")), i)
            for i, entry in enumerate(log)
            if status_of(entry) == "taken back" and not entry.repeat
        ]
        time, i = max(since, default=("", -1))
        if i < 0 or not time or time < last:
            return None
        query = log[i].answer.query
        if query.id.startswith(SETTLED) or self._session.answered_before()(query):
            return None
        return query if shown_of(self._subject, query).exact else None

    def _replacement(self, query: Query, answered: Callable[[Query], bool]) -> Query | None:
        """Return a query to put in place of the asker's ``query``, or None to put the latter.

        It is a check, another kind of question, or the same question in whole numbers.
        """
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
        """Return the check question about two neighbouring levels that is due, or None."""
        conduct = self._session.conduct()
        # one that was taken back as a contradiction has been answered: it is a failed check
        n = sum(
            entry.answer.query.id.startswith(ORDER)
            and (entry.stands or IN_CONFLICT in (entry.retraction or {}))
            for entry in self._session.log
        )
        due = (conduct.answered >= _ORDER_AFTER) + (conduct.differed > 0)
        if not self._session.audits or k < 3 or n >= due:
            return None
        return order_question(k, 1 + (k // 2 + n) % (k - 1))

    def _extra(self) -> Query | None:
        """Return the question to put if the asker has none, or None at the end of the interview."""
        conduct, needed = self._session.conduct(), self._staked() is not None
        few = needed and conduct.with_verdict < self._subject.least
        if few and (check := self._session.checking()) is not None:
            return check  # otherwise all checks would come in a row at the end
        if needed and not few and self._session.audits and conduct.unresolved:
            few = self._session.confirming() is None  # then there is more to put again
        # that it is sure enough may take seconds to find, and matters only if nothing else is left
        if self._chosen.all_told or self.to_narrow()[1]:
            check = self._session.checking()
            if (found := check or self.about_a_level(few)) is not None:
                return found
        enough = self._subject.enough
        unsure = needed and not few and enough is not None and not enough(self._session.result())
        if unsure:
            if (check := self._session.checking()) is not None:
                return check
            # where little is left to gain, questions whose answers follow from others add nothing
            few = self.nearly(conduct) is None
        if (unsure or few) and (found := self.about_a_level(few)) is not None:
            return found
        return self._session.confirming() if needed or self._chosen.all_told else None


def _until_narrow(ranges: tuple[Floats, Floats], width: float) -> tuple[int, int]:
    """Return ``questions_to_narrow`` for the low and the high ends (k,) of the levels' ranges.

    They are rounded as the result shows them.
    """
    return questions_to_narrow(counted_widths(*outwards(*ranges)).tolist(), width)


def _in_whole_numbers(
    subject: Subject, query: Query, answered: Callable[[Query], bool]
) -> Query | None:
    """Return a query in whole numbers near this one, if it is not in whole numbers itself.

    The result is None if there is none that was not asked yet.
    """
    if shown_of(subject, query).exact:
        return None
    return next((near for near in near_in_whole_numbers(query) if not answered(near)), None)
