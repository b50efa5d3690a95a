"""A session with a person who answers, kept in an answer log.

It can be left at any moment and resumed later. A session has no prompt, socket or window: a host
shows the questions, and calls ``question`` and ``answer``. The log alone determines the state of
the session (``elicit.person.replayed_asker``).
"""

import copy
import secrets
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from os import PathLike
from typing import Any

import numpy as np

from elicit._support.closing import Closing
from elicit._support.hashing import Seed
from elicit._support.seeds import seed_of
from elicit._support.validation import is_number, require
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator
from elicit.model.difference import tail_sums
from elicit.model.pairs import same_pairs
from elicit.model.query import Answer, Query, StaleAnswer, Verdict
from elicit.person.asker import (
    AfterAnswer,
    Asker,
    Audits,
    ChooseReplacement,
    Compares,
    MakeAsker,
    Supposed,
    counts,
)
from elicit.person.course.conduct import ORDER, SETTLED, Conduct, Repeats, differs, repeats_in
from elicit.person.course.conflicts import TakenAsRight
from elicit.person.replayed_asker import ReplayedAsker
from elicit.tutors.answer_log import (
    EXPECTED,
    REPEATS,
    RESOLVED,
    WHO,
    AnswerLog,
    Entry,
    check_person,
)


@dataclass(frozen=True)
class SessionStatus:
    """The state of a session. Repeats are counted apart from the other answers."""

    answered: int  # answers that stand
    equal: int  # among these, answers that the two are equal
    cannot_tell: int  # among these, answers that the person cannot tell
    unused: int  # among these, answers that contradict others
    withdrawn: int  # answers taken back
    finished: bool  # no question is left
    repeated: int = 0  # questions that were put again
    alike: int = 0  # among these, questions that were answered as before

    def __str__(self) -> str:
        more = {"equal": self.equal, "cannot tell": self.cannot_tell, "unused": self.unused}
        among = ", ".join(f"{n} {name}" for name, n in more.items() if n)
        state = "finished" if self.finished else "a question waits"
        taken_back = f", {self.withdrawn} taken back" if self.withdrawn else ""
        again = f", {self.alike} of {self.repeated} repeats as before" if self.repeated else ""
        return (
            f"{state}: {self.answered} answered{f' ({among})' if among else ''}{taken_back}{again}"
        )


class Session(Closing):
    """Questions, one at a time, and answers that are on the disk before anything else happens.

    An answer that contradicts others is marked unused in the log, and decides only its own pair.
    ``conflicts`` names the answers that contradict each other. Once enough of them are withdrawn,
    the answer is used again. A session must not be used by several threads at a time.

    Parameters
    ----------
    asker : MakeAsker or Asker
        A function that makes an asker from the answers that it is to know, or a new asker. With an
        asker the session cannot undo, withdraw, or go on with a log whose questions are not its
        own.
    log : AnswerLog or path
        If it is a path, the session closes the log at the end.
    who : str, optional
        The person whose answers these are, for the log. A new log at a path is then that person's.
        Default: the person of the log.
    audit : float, optional
        The share of questions in front of which an earlier question is put again, to see whether
        the answers agree. The asker is not told the answer to a repeat, and nothing else depends on
        it. Default: none, but an ``Interview`` puts those that it needs.
    seed : int or Generator or SeedSequence, optional
        Chooses the repeats, together with the answers that stand. None draws a new seed.
    clock : callable
        Returns seconds since 1970, for the log. Nothing depends on it.

    Raises
    ------
    TypeError
        If ``asker`` is neither of these.
    ValueError
        If this log needs a function that makes an asker.
    BadLog, BlockingIOError, OSError
        As ``AnswerLog`` raises them, also for a log of another person.
    """

    def __init__(
        self,
        asker: Asker | MakeAsker,
        log: AnswerLog | str | PathLike[str],
        *,
        who: str | None = None,
        audit: float | None = None,
        seed: Seed | None = 0,
        clock: Callable[[], float] = time.time,
    ) -> None:
        what = "audit, the share of questions in front of which one is put again,"
        require(audit is None or is_number(audit, 0, 1), what, "None, or in 0..1", audit)
        self._clock = clock
        self._stamp: dict[str, Any] = {"session": secrets.token_hex(4)}
        self._put_at: dict[
            str, float
        ] = {}  # when a pending question was put, by a clock that only goes forwards
        self.choose_replacement: ChooseReplacement | None = None
        """Chooses the query to put in place of the asker's, if the session can make askers. After
        the answer a new asker is made, which knows the answer."""
        self.choose_first: Callable[[], Query | None] | None = None
        """Chooses a question before any other, while there is one, if the session can make
        askers."""
        self.choose_extra: Callable[[], Query | None] | None = None
        """Chooses a question once the asker has none, if the session can make askers."""
        self._taken_as_right = TakenAsRight(self._comparator)
        self.audits = audit is None or audit > 0
        """False if the session was told to put no question again."""
        self.seed = seed_of(seed)
        """The seed that gives the same repeats again."""
        ReplayedAsker.check(asker)  # before a file is made
        self._mine = not isinstance(log, AnswerLog)
        self._log = log if isinstance(log, AnswerLog) else AnswerLog(log, who=who)
        try:
            check_person(self._log, who)
            if (person := who or self._log.who) is not None:
                self._stamp[WHO] = person
            self._repeats = Repeats(self._log, float(audit or 0.0), self.seed)
            self._replayed = ReplayedAsker(asker, self._log, self._now)
            self._replayed.current()
        except BaseException:
            self.close()
            raise

    @property
    def log(self) -> AnswerLog:
        """The answer log of the session."""
        return self._log

    def current_asker(self) -> Asker:
        """Return the asker, after telling it all that is in the log.

        The object is replaced by ``undo`` and ``withdraw``, and when the asker after an answer was
        computed ahead.

        Returns
        -------
        Asker
        """
        return self._replayed.current()

    def discard(self) -> None:
        """Discard the asker and all that was computed, which a failure may have left half done.

        The next call makes them again from the log. A session that was given an asker keeps that.
        """
        self._taken_as_right.forget()
        self._replayed.discard()

    @property
    def makes_askers(self) -> bool:
        """True if a function that makes askers was given, rather than an asker."""
        return self._replayed.makes_askers

    def twin(self) -> Asker | None:
        """Return a copy of the asker, on which another thread may try answers, or None.

        It is made by ``copy.deepcopy``, and may share nothing with the asker that changes.

        Returns
        -------
        Asker or None
            None if the asker cannot be copied.
        """
        try:
            return copy.deepcopy(self.current_asker())
        except Exception:  # whatever a part of it raises
            return None

    def question(self) -> Query | None:
        """Return the current question, or None if there is none left.

        It stays the same until it is answered. Computing it may take a second.

        Returns
        -------
        Query or None
        """
        query = self.next_told()
        if query is not None:
            query = self._repeats.due(self.conduct()) or self._in_place_of(query) or query
        elif self.choose_extra is not None and self.makes_askers:
            query = self.choose_extra()
        if query is not None:
            query = self._first() or query
            self._put_at.setdefault(query.id, time.monotonic())
        return query

    def _first(self) -> Query | None:
        """Return the question that comes before any other, or None."""
        return None if self.choose_first is None or not self.makes_askers else self.choose_first()

    def next_told(self) -> Query | None:
        """Return the first query whose answer the asker waits for.

        ``question`` may return another one: an earlier question that is put again, or a replacement
        of this query.

        Returns
        -------
        Query or None
            None if the asker is finished.
        """
        return next(iter(self._pending().values()), None)

    def check_regularly(self) -> None:
        """Put an earlier question again regularly, and after a repeat differed.

        One comes after every fourth answer, and after every second one until there are five checks.

        If the session was made with ``audit=0``, none is put again.
        """
        self._repeats.regular = self.audits

    def conduct(self) -> Conduct:
        """Return counts of how the person has answered so far.

        Returns
        -------
        Conduct
        """
        return Conduct.of([*self._log])

    def answered_before(self) -> Callable[[Query], bool]:
        """Return a function that tells whether a query's difference was answered already.

        Returns
        -------
        function
            It takes a Query and returns a bool, by the answers that stand now.
        """
        said = [tail_sums(entry.answer.query.d) for entry in self._log.standing]

        def answered(query: Query) -> bool:
            return bool(said) and bool(same_pairs(tail_sums(query.d), np.array(said)).any())

        return answered

    def confirming(self) -> Query | None:
        """Return an earlier question that should be put again before the end, or None.

        Returns
        -------
        Query or None
        """
        return self._repeats.confirming(self.conduct()) if self.audits else None

    def checks_left(self, id: str, further: int) -> int:
        """Return the fewest checks that must come after the pending question of an id.

        Parameters
        ----------
        id : str
            The id of the pending question.
        further : int
            The number of answers that come after it.

        Returns
        -------
        int
            At most the number of questions that can be put again once ``further`` more answers have
            come.
        """
        if not self.audits:
            return 0
        repeat = self.is_repeat(id)
        needed = self.conduct().checks_left - (repeat or id.startswith(ORDER))
        # it uses up one that may be repeated, and the last answer is repeated after another one
        repeatable = self._repeats.left() + further - 2 * repeat
        return max(0, min(needed, repeatable))

    def checking(self) -> Query | None:
        """Return an earlier question that is due to be put again now, or None.

        Returns
        -------
        Query or None
        """
        return self._repeats.due(self.conduct()) if self.audits else None

    def at_start(self) -> Asker | None:
        """Return a new asker that knows no answer, or None if the session cannot make one.

        Returns
        -------
        Asker or None
        """
        return self._replayed.at_start()

    def stamp(self, who: str) -> None:
        """Set the person whose answers the next lines of the log are.

        Parameters
        ----------
        who : str
            The person's name.

        Raises
        ------
        BadLog
            For a log of another person.
        """
        check_person(self._log, who)
        self._stamp[WHO] = who

    @property
    def who(self) -> str | None:
        """The person whose answers these are, by the last line of the log that names one."""
        said = [entry.answer.who for entry in self._log if entry.answer.who is not None]
        return self._stamp.get(WHO) or (said[-1] if said else None)

    def answering(self, query: Query) -> str | None:
        """Return the person who answers a query: the one it names, else the session's, or None.

        Parameters
        ----------
        query : Query

        Returns
        -------
        str or None
        """
        return query.who or self._stamp.get(WHO)

    def is_repeat(self, id: str) -> bool:
        """Return whether a pending query is an earlier question put again.

        Parameters
        ----------
        id : str
            The id of the query.

        Returns
        -------
        bool
        """
        return self._repeats.names(id) and id not in self._pending()

    def first_answer(self, query: Query) -> Answer | None:
        """Return the answer given the first time to a query that is put again, or None.

        Parameters
        ----------
        query : Query

        Returns
        -------
        Answer or None
        """
        return self._repeats.first_answer(query)

    def shown(self, id: str, swapped: bool = False, **how: Any) -> None:
        """Log that a pending question is shown to the person, and how.

        Parameters
        ----------
        id : str
        swapped : bool
            True if its sides are exchanged.
        **how
            Any JSON.

        Raises
        ------
        StaleAnswer
            If no such query is pending.
        """
        query = self._to_answer(id)
        if query is None:
            raise StaleAnswer(f"no pending query has the id {id!r}: show what question() returns")
        asked = {} if query.who is None else {WHO: query.who}
        self._log.append_asked(query, swapped, **{**self._now(), **asked}, **how)
        self._put_at[id] = time.monotonic()

    def answer(
        self,
        id: str,
        verdict: Verdict | int | None,
        *,
        ahead: Callable[[Asker, Answer], AfterAnswer | None] | None = None,
        **metadata: Any,
    ) -> Answer:
        """Take the answer to the pending query of this id.

        It is on the disk before this returns.

        An answer that was given already has no effect, so a page may send it twice.

        Parameters
        ----------
        id : str
        verdict : Verdict or int or None
            Of ``query.left``, also if the question was shown right to left. None: cannot tell.
        ahead : callable, optional
            Returns an asker that was told this answer already (``LookAhead.told``). A session that
            makes its askers goes on with that one.
        **metadata
            Any JSON, for the log.

        Returns
        -------
        Answer
            The answer as it was logged.

        Raises
        ------
        StaleAnswer
            For another verdict than the one that stands, and for an id that was never asked.
        OSError
            As ``AnswerLog.append`` raises it. The question is then still pending.
        """
        asker = self.current_asker()
        said = _last_answer(self._replayed.known_and_told()[1], id)
        query = None if said else self._to_answer(id)
        said = said or (None if query else _last_answer(self._log.standing, id))
        if said is not None:
            return _unchanged(said, verdict)
        if query is None:
            raise StaleAnswer(f"no pending query has the id {id!r}: answer what question() returns")
        swapped = next(
            (one.swapped for one in reversed(self._log.asked) if one.query.id == id), False
        )
        answer = Answer(query, verdict, swapped, self.answering(query))  # type: ignore[arg-type]  # which turns the code into a Verdict
        latency = (
            {"latency": round(time.monotonic() - self._put_at[id], 3)} if id in self._put_at else {}
        )
        when = {name: value for name, value in self._now().items() if name != WHO}
        first = self._repeats.first_answer(query) if self.is_repeat(id) else None
        if first is not None:
            before = {REPEATS: first.query.id, EXPECTED: int(first.verdict or 0)}
            self._log.append(answer, used=False, **{**when, **latency, **before, **metadata})
            self._put_at.pop(id, None)
            return answer
        implied = asker.implied if isinstance(asker, Audits) else {}
        audited = {EXPECTED: int(implied[id])} if id in implied else {}
        self._log.append(answer, **{**when, **latency, **audited, **metadata})
        self._put_at.pop(id, None)
        pending = id in {
            query.id for query in asker.ask()
        }  # otherwise it is in place of one that is
        if (
            pending
            and ahead is not None
            and self.makes_askers
            and (after := ahead(asker, answer)) is not None
        ):
            self._replayed.go_on_with(after)
        self._replayed.current()  # tells the asker
        return answer

    def undo(self) -> Answer:
        """Take back the last answer that stands, and return it.

        Its question is put again, or another one if it was answered before a restart.

        Returns
        -------
        Answer

        Raises
        ------
        ValueError
            If there is no answer, and otherwise as ``withdraw`` does.
        """
        standing = self._log.standing
        if not standing:
            raise ValueError("there is no answer to undo")
        last = standing[-1].answer
        self.withdraw(last.query.id)
        return last

    def withdraw(self, id: str, **metadata: Any) -> None:
        """Take back the answer to the query of this id, and its repeats. The others stay.

        Parameters
        ----------
        id : str
        **metadata
            Any JSON for the log, such as the reason.

        Raises
        ------
        ValueError
            If no answer of this id stands, or if the session was given an asker in place of a
            function that makes one.
        """
        said = {**self._now(), **metadata}
        standing = {entry.answer.query.id: entry for entry in self.log if entry.stands}
        for other, entry in standing.items() if id in standing else ():
            if entry.repeat and entry.metadata.get(REPEATS) == id:  # its first answer is gone
                self._replayed.withdraw(other, said)
        self._replayed.withdraw(id, said)
        self._put_at.clear()

    def settle(self, id: str, verdict: Verdict | int | None) -> None:
        """Set what the person meant, after a repeated question was answered differently.

        The verdict replaces both answers, and is learned.

        Parameters
        ----------
        id : str
            The id of the repeat.
        verdict : Verdict or int or None
            The verdict on ``query.left``. None: cannot tell.

        Raises
        ------
        ValueError
            If no such repeat stands, or its first answer does not. Also if the first answer
            changes, and the session was given an asker in place of a function that makes one.
        """
        standing = {e.answer.query.id: e for e in self._log.standing}
        again = standing.get(id)
        first = None if again is None else standing.get(str(again.metadata.get(REPEATS)))
        if again is None or not again.repeat or first is None:
            raise ValueError(f"no two answers wait to be settled by the id {id!r}")
        query = replace(first.answer.query, id=f"{SETTLED}{first.answer.query.id}")
        meant = Answer(query, verdict, again.answer.swapped, again.answer.who)  # type: ignore[arg-type]
        told = {**self._now(), RESOLVED: None if meant.verdict is None else int(meant.verdict)}
        changes = meant.verdict != first.answer.verdict
        if changes:
            self._replayed.exchange(first.answer.query.id, told, meant)
        self._log.retract(id, **told)
        self._put_at.clear()
        if changes:  # last, for it may fail, and the log must be whole by then
            self._replayed.restart()

    def supposing(
        self, without: Collection[str], meant: Sequence[Answer] = ()
    ) -> Callable[[], Supposed]:
        """Return a function that gives the asker as it would be with other answers.

        Nothing changes. Another thread may call the function, which may take a second.

        Parameters
        ----------
        without : collection of str
            Ids of answers that would be taken back.
        meant : sequence of Answer
            Answers that would be added.

        Returns
        -------
        function
            It takes nothing, and returns a named tuple. Its ``asker`` knows these answers, ``of``
            counts those that have a verdict, and ``used`` those among them that the asker uses.

        Raises
        ------
        ValueError
            If the session was given an asker in place of a function that makes one.
        """
        if not self.makes_askers:
            raise ValueError("to suppose other answers the session must make a new asker")
        return self._replayed.supposing(without, meant)

    def restarts(self, query: Query, swapped: bool) -> Iterator[None]:
        """Return steps that prepare the asker for each answer to a replacement of its own query.

        Another thread may go through them while the person reads. Nothing changes.

        Parameters
        ----------
        query : Query
            The pending query.
        swapped : bool
            True if its sides are shown exchanged.

        Returns
        -------
        iterator
        """
        who = self.answering(query)
        verdicts = (Verdict.BETTER, Verdict.WORSE, Verdict.EQUAL, None)
        return self._replayed.restarts([Answer(query, one, swapped, who) for one in verdicts])

    def conflicts(self) -> tuple[tuple[Entry, ...], ...]:
        """Return sets of answers that contradict each other, whatever the scale.

        If any one of a set were withdrawn, the others of that set would be consistent. No answer is
        in two sets. Each answer is taken as right, even if the comparator allows for errors. With a
        comparator other than a polytope, two things that the person calls equal may still differ by
        5% of the value range, or by its ``tie`` if that is more. Answers of different people do not
        contradict each other.

        Returns
        -------
        tuple of tuple of Entry
            The sets; () if no answers contradict each other.
        """
        return self._taken_as_right.conflicts(self._told())

    def contradiction(self) -> tuple[Entry, ...]:
        """Return answers of one person that contradict each other, with the last answer among them.

        As in ``conflicts``, each answer is taken as right, even if the comparator allows for
        errors. To check one more answer takes far less time than to find all ``conflicts``.

        Returns
        -------
        tuple of Entry
            It is empty if the last answer contradicts no earlier ones.
        """
        told, standing = self._told(), self._log.standing
        if not told or told[-1] is not standing[-1]:
            return ()
        return self._taken_as_right.contradiction(told)

    def implied(self, query: Query) -> bool:
        """Return whether a person's answers, if each is right, say which side of a query is better.

        Answers that contradict earlier ones are left out.

        Parameters
        ----------
        query : Query
            The person is the one who answers it (``answering``).

        Returns
        -------
        bool
        """
        who = self.answering(query)
        told = [entry for entry in self._told() if entry.answer.who == who]
        return self._taken_as_right.imply(told, query.d)

    def as_given(self) -> PolytopeComparator | None:
        """Return a comparator that takes each answer as right, or None.

        As in ``conflicts``, two things that the person calls equal may differ a little.

        Returns
        -------
        PolytopeComparator or None
            None if answers contradict each other, if several people answered, or if the order of
            two levels is open.
        """
        return self._taken_as_right.comparator(self._told())

    def status(self) -> SessionStatus:
        """Return the state of the session.

        Computing it may take a second, because it looks for the next question.

        Returns
        -------
        SessionStatus
        """
        entries = [entry for entry in self._log if not entry.repeat]
        standing = [entry for entry in entries if entry.stands]
        again = repeats_in(self._log)
        verdicts = [entry.answer.verdict for entry in standing]
        return SessionStatus(
            answered=len(standing),
            equal=verdicts.count(Verdict.EQUAL),
            cannot_tell=verdicts.count(None),
            unused=sum(not entry.used for entry in standing),
            withdrawn=len(entries) - len(standing),
            finished=not self._pending(),
            repeated=len(again),
            alike=sum(not differs(entry) for entry in again),
        )

    def result(self) -> Any:
        """Return the asker's result so far.

        Returns
        -------
        object
            A learner's policy, or the choice of ``choose``.
        """
        return self.current_asker().result()

    def close(self) -> None:
        """Close the log, if the session opened it."""
        if self._mine:
            self._log.close()

    def _pending(self) -> dict[str, Query]:
        return {query.id: query for query in self.current_asker().ask()}

    def _now(self) -> dict[str, Any]:
        """Return the metadata of a line of the log."""
        when = datetime.fromtimestamp(self._clock(), UTC).isoformat(timespec="milliseconds")
        return {"time": when, **self._stamp}

    def _to_answer(self, id: str) -> Query | None:
        """Return the query with this id, if it waits for an answer, else None."""
        if (first := self._first()) is not None and first.id == id:
            return first
        waits = self.next_told()
        if waits is not None:
            others = (self._repeats.due(self.conduct()), self._in_place_of(waits))
        elif self.choose_extra is not None and self.makes_askers:
            others = (self.choose_extra(), None)
        else:
            return None
        for query in others:
            if query is not None and query.id == id:
                return query
        return self._pending().get(id)

    def _in_place_of(self, query: Query) -> Query | None:
        """Return the query that replaces a pending query, or None if that one is put unchanged.

        ``choose_replacement`` chooses it. An audit is never replaced.
        """
        if self.choose_replacement is None or not self.makes_askers:
            return None
        asker = self.current_asker()
        if isinstance(asker, Audits) and query.id in asker.implied:
            return None
        return self.choose_replacement(query, self.answered_before())

    def _told(self) -> list[Entry]:
        """Return the answers that count and have a verdict."""
        return [entry for entry in self._log if counts(entry) and entry.answer.verdict is not None]

    def _comparator(self) -> Comparator | None:
        """Return the asker's comparator, or None if it has none."""
        asker = self.current_asker()
        return asker.comparator if isinstance(asker, Compares) else None


def _last_answer(entries: Sequence[Entry], id: str) -> Answer | None:
    """Return the last answer to the query of this id, or None if there is none."""
    return next((entry.answer for entry in reversed(entries) if entry.answer.query.id == id), None)


def _unchanged(said: Answer, verdict: Verdict | int | None) -> Answer:
    """Return a standing answer that is given again. Raises StaleAnswer for another verdict."""
    again = Answer(said.query, verdict)  # type: ignore[arg-type]  # which turns the code into a Verdict
    if again.verdict != said.verdict:
        raise StaleAnswer(
            f"the query {said.query.id!r} was answered with {_word(said.verdict)} already, not "
            f"{_word(again.verdict)}: "
            "withdraw that answer first"
        )
    return said


def _word(verdict: Verdict | None) -> str:
    return "'cannot tell'" if verdict is None else repr(verdict.name.lower())
