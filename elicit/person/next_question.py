"""The questions of an interview that stand beside its asker's.

Some take the place of the asker's question: a check of the order, another kind of question, or one
in whole numbers. Others come once the asker has none.
"""

from __future__ import annotations

from collections.abc import Callable

from elicit.model.query import Query
from elicit.person.asker import Compares
from elicit.person.course.conduct import LEAST_CHECKS, ORDER, Conduct
from elicit.person.course.level_questions import level_question, order_question
from elicit.person.drawing import Drawing, Subject, shown_of
from elicit.person.session import Session
from elicit.person.showing import near_in_whole_numbers

_ORDER_AFTER = 4  # answers before the question about the order of two levels


class NextQuestion(Drawing):
    """Chooses questions beside those of a session's asker.

    Parameters
    ----------
    session : Session
    subject : Subject
    """

    def __init__(self, session: Session, subject: Subject) -> None:
        super().__init__(session, subject)
        session.choose_replacement = self._replacement
        if subject.least:
            session.choose_extra = self._extra
            session.check_regularly()

    def _replacement(self, query: Query, answered: Callable[[Query], bool]) -> Query | None:
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

    def _extra(self) -> Query | None:
        """Return the question to put when the asker has none, or None at the end."""
        conduct, start = Conduct.of([*self._session.log]), self._at_start()
        needed = start is not None and not start.finished
        few = needed and conduct.with_verdict < self._subject.least
        if needed and not few and self._session.audits and conduct.unresolved:
            few = self._session.confirming() is None  # then there is more to put again
        enough = self._subject.enough
        if needed and not few and enough is not None and not enough(self._session.result()):
            if (check := self._session.checking()) is not None:
                return check
            few = True
        if (self._chosen.more or few) and (found := self._level_question(few)) is not None:
            return found
        return self._session.confirming() if needed or self._chosen.more else None

    def _still_needed(self, conduct: Conduct) -> tuple[int, int]:
        """Return how many answers, and checks besides, must come after this question."""
        if not self._subject.least:
            return 0, 0
        checks = max(0, LEAST_CHECKS - conduct.checks) if self._session.audits else 0
        return max(0, self._subject.least - conduct.with_verdict - 1), checks


def _in_whole_numbers(
    subject: Subject, query: Query, answered: Callable[[Query], bool]
) -> Query | None:
    """Return a query in whole numbers near one that is not, if any was not asked yet."""
    if shown_of(subject, query).exact:
        return None
    return next((near for near in near_in_whole_numbers(query) if not answered(near)), None)
