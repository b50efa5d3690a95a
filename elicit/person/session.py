"""A session with a person who answers, kept in an answer log: it can be left at any moment and picked up again.

It holds no prompt, no socket and no window; whoever shows the questions calls ``question`` and ``answer``. The log
alone says where the session stands: the answers that stand since whoever asks last (re)started are told again, in
order, to a new asker, so the next question and the end are those of a session that nothing disturbed. What was
answered before a restart the asker is made to know (``known=``). It is restarted where its questions are not those of
the log, as with another comparator, and where an answer is withdrawn that others followed.
"""

import copy
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from inspect import Parameter, signature
from os import PathLike
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np

from elicit._support.closing import Closing
from elicit._support.hashing import Seed, fold, key_of, name_code, uniform
from elicit._support.seeds import seed_of
from elicit._support.validation import is_number, require
from elicit.asking.elicitation import OnConflict
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator, tie_of
from elicit.model.pairs import same_pairs
from elicit.model.query import Answer, Answers, InconsistentAnswers, Query, StaleAnswer, Verdict
from elicit.model.scale import tail_sums
from elicit.tutors.answer_log import CONTRADICTS, EXPECTED, REPEATS, AnswerLog, Entry

_AGAIN = " again"  # after the id of a query that is put again
_ANY_NUMBER = Parameter.VAR_POSITIONAL  # of arguments
_NOT_ITS_QUESTIONS = (
    "this asker does not ask what the log answers: it was told something already, has another comparator or other "
    "settings, or an answer was withdrawn. Give Session a function known -> asker in its place, such as lambda known: "
    "choose(vectors, comparator, known=known)"
)


@runtime_checkable
class Asker(Protocol):
    """Whatever asks and is told, such as a learner of qlearn, or what ``choose`` returns."""

    def ask(self) -> Sequence[Query]:
        """The pending queries, the same until told; none when finished."""

    def tell(self, answers: Sequence[Answer], on_conflict: OnConflict = "raise") -> Any:
        """Take answers to pending queries. Raises InconsistentAnswers, unless ``on_conflict="drop"``; when it raises
        nothing has changed."""

    def result(self) -> Any:
        """What is known so far."""


@runtime_checkable
class Audits(Protocol):
    """An asker that puts to the tutor what the answers had settled."""

    @property
    def implied(self) -> Mapping[str, Verdict]:
        """Of pending queries that are audits, by id: the verdict that the answers so far imply."""


@runtime_checkable
class Compares(Protocol):
    """An asker that says what it knows of the scale."""

    @property
    def comparator(self) -> Comparator:
        """What is known of the scale."""


MakeAsker: TypeAlias = Callable[[list[Entry]], Asker]
"""Makes a new asker that knows these answers: lambda known: qlearn.InteractiveValueIteration(mdp, comparator,
known=known), say."""


class Told(NamedTuple):
    """An asker that was told an answer; contradicts: None, or the ids of the answers, this one among them, that do not
    go together, where it had to be dropped."""

    asker: Asker
    contradicts: list[str] | None


class _Standing(NamedTuple):
    """An asker, and how many entries of the log it knows. An interruption may come at any line, so these are exchanged
    together."""

    asker: Asker
    known: int
    telling: bool = False  # whether it may have been told the next entry already
    contradicts: list[str] | None = None  # what the next entry contradicts, where it is known to
    unmarked: list[str] | None = None  # what the last entry known contradicts, until the log says so


Instead: TypeAlias = Callable[[Query, Callable[[Query], bool]], Query | None]
"""What to put in place of a query, given whether a query's difference was answered already; None: the query itself."""


@dataclass(frozen=True)
class SessionStatus:
    """Where a session stands. ``answered``: the answers that stand, among them so many ``equal``, ``cannot_tell``, and
    ``unused`` for what they contradict; ``withdrawn``: those taken back; ``finished``: there is no question left. Not
    among these: ``repeated``, how many questions were put again, of which ``alike`` were answered as before."""

    answered: int
    equal: int
    cannot_tell: int
    unused: int
    withdrawn: int
    finished: bool
    repeated: int = 0
    alike: int = 0

    def __str__(self) -> str:
        more = {"equal": self.equal, "cannot tell": self.cannot_tell, "unused": self.unused}
        among = ", ".join(f"{n} {name}" for name, n in more.items() if n)
        state = "finished" if self.finished else "a question waits"
        taken_back = f", {self.withdrawn} withdrawn" if self.withdrawn else ""
        again = f", {self.alike} of {self.repeated} repeats as before" if self.repeated else ""
        return f"{state}: {self.answered} answered{f' ({among})' if among else ''}{taken_back}{again}"


class Session(Closing):
    """Questions, one at a time, and answers that are on the disk before anything is made of them.

    asker: a function that makes an asker from the answers it is to know (``MakeAsker``), or a new asker; the latter
    cannot undo, withdraw, or go on with a log whose questions are not its own. log: an AnswerLog, or the path of one,
    which the session then closes. who: whose answers these are, for the log. audit: in front of this share of the
    questions an earlier one is put again, to see whether the answers agree; which, and where, depends on ``seed`` and
    the answers that stand. The asker is not told what is said of it, and nothing else depends on it. clock: seconds
    since 1970, only to be written down; nothing depends on it.

    An answer that contradicts the others is marked unused in the log and settles its own pair only; ``conflicts`` says
    what does not go together. Once enough of that is withdrawn it counts again. Not for several threads at a time.

    Raises TypeError for what is no asker, ValueError where only a function can go on with this log, BadLog,
    BlockingIOError and other OSErrors of ``AnswerLog``.
    """

    def __init__(
        self,
        asker: Asker | MakeAsker,
        log: AnswerLog | str | PathLike[str],
        *,
        who: str | None = None,
        audit: float = 0.0,
        seed: Seed | None = 0,
        clock: Callable[[], float] = time.time,
    ) -> None:
        require(
            is_number(audit, 0, 1),
            "audit, the share of questions in front of which one is put again,",
            "in 0..1",
            audit,
        )
        self.seed = seed_of(seed)
        """Gives the same repeats again."""
        self._audit, self._key = float(audit), fold(key_of(self.seed), name_code("questions put again"))
        if isinstance(asker, type):
            _check_makes(asker)
        self._given = asker if isinstance(asker, Asker) and not isinstance(asker, type) else None
        self._make = asker if self._given is None and callable(asker) else None
        if self._given is None and self._make is None:
            raise TypeError(
                f"a session takes a function known -> asker, or an asker with ask, tell and result, not {asker!r}"
            )
        self._mine = not isinstance(log, AnswerLog)
        self._log = log if isinstance(log, AnswerLog) else AnswerLog(log)
        self._clock = clock
        self._stamp = {"session": secrets.token_hex(4), **({} if who is None else {"who": who})}
        self._put_at: dict[str, float] = {}  # when a pending question was put, by a clock that only goes forwards
        self.instead: Instead | None = None
        """What is put in place of the queries that the asker waits for, of a session that makes its askers: after the
        answer a new one is made, which knows it."""
        self._stands: _Standing | None = None  # None: the asker is to be made from the log
        try:
            self._know(self._resumed())
        except BaseException:
            self.close()
            raise

    @property
    def log(self) -> AnswerLog:
        """The log."""
        return self._log

    @property
    def asker(self) -> Asker:
        """Who asks now, told all that is in the log: another one after ``undo`` and ``withdraw``, and after an answer
        that was looked ahead to."""
        if self._stands is None:
            self._know(self._resumed())
        self._mark_contradiction()
        while (now := self._standing_now).known < len(self._log):  # logged, but to tell it failed or was interrupted
            self._tell_next(now)
            self._mark_contradiction()
        return self._standing_now.asker

    @property
    def makes_askers(self) -> bool:
        """Whether it was given a function that makes an asker, not an asker."""
        return self._make is not None

    def twin(self) -> Asker | None:
        """A copy of the asker, for another thread to try out on it what may be answered; None where it cannot be
        copied. ``copy.deepcopy`` of an asker must be one that shares nothing with it that changes."""
        try:
            return copy.deepcopy(self.asker)
        except Exception:  # whatever a part of it says to that
            return None

    def question(self) -> Query | None:
        """The question to put now, the same until it is answered; None when there is none left. Computes it."""
        query = self.next_told()
        if query is not None:
            query = self._repeat() or self._in_place_of(query) or query
            self._put_at.setdefault(query.id, time.monotonic())
        return query

    def next_told(self) -> Query | None:
        """The first query that the asker waits for: ``question``, unless that puts an earlier one again, or another one
        in its place."""
        return next(iter(self._pending().values()), None)

    def is_repeat(self, id: str) -> bool:
        """Whether the query of this id, which waits for an answer, is an earlier one put again."""
        return id.endswith(_AGAIN) and id not in self._pending()

    def shown(self, id: str, swapped: bool = False, **how: Any) -> None:
        """Log that a pending question is put to the person, perhaps right to left, and how: any JSON. Raises
        StaleAnswer where no such query is pending."""
        query = self._to_answer(id)
        if query is None:
            raise StaleAnswer(f"no pending query has the id {id!r}: show what question() returns")
        self._log.append_asked(query, swapped, **self._now(), **how)
        self._put_at[id] = time.monotonic()

    def answer(
        self,
        id: str,
        verdict: Verdict | int | None,
        *,
        ahead: Callable[[Asker, Answer], Told | None] | None = None,
        **metadata: Any,
    ) -> Answer:
        """Take the answer to the pending query of this id, a verdict on ``query.left``, also where it was shown right
        to left; None is "cannot tell". When this returns it is on the disk; returns it as it was logged.

        Told again what was answered so already, it does nothing: so a page may send an answer twice. Raises StaleAnswer
        for another verdict than the one that stands, and for an id that was never asked; and what ``AnswerLog.append``
        raises, after which the question is still pending. metadata: any JSON, for the log. ahead: what may have told
        that answer to a copy of the asker already (``LookAhead.told``): once the answer is on the disk, a session that
        makes its askers goes on with that one.
        """
        asker = self.asker
        said = _last(self._standing()[1], id)
        query = None if said else self._to_answer(id)
        said = said or (None if query else _last([entry for entry in self._log if not entry.retracted], id))
        if said is not None:
            answer = Answer(said.query, verdict)  # type: ignore[arg-type]  # which turns the code into a Verdict
            if answer.verdict != said.verdict:
                raise StaleAnswer(
                    f"the query {id!r} was answered with {_word(said.verdict)} already, not {_word(answer.verdict)}: "
                    "withdraw that answer first"
                )
            return said
        if query is None:
            raise StaleAnswer(f"no pending query has the id {id!r}: answer what question() returns")
        swapped = next((one.swapped for one in reversed(self._log.asked) if one.query.id == id), False)
        answer = Answer(query, verdict, swapped)  # type: ignore[arg-type]
        latency = {"latency": round(time.monotonic() - self._put_at[id], 3)} if id in self._put_at else {}
        if (first := self._repeated(query)) is not None:
            before = {REPEATS: first.query.id, EXPECTED: int(first.verdict or 0)}
            self._log.append(answer, used=False, **{**self._now(), **latency, **before, **metadata})
            self._put_at.pop(id, None)
            return answer
        implied = asker.implied if isinstance(asker, Audits) else {}
        audited = {EXPECTED: int(implied[id])} if id in implied else {}
        self._log.append(answer, **{**self._now(), **latency, **audited, **metadata})
        self._put_at.pop(id, None)
        pending = id in {query.id for query in asker.ask()}  # else it is in place of one that is
        if pending and ahead is not None and self.makes_askers and (told := ahead(asker, answer)) is not None:
            self._stands = _Standing(told.asker, len(self._log), unmarked=told.contradicts)
        _ = self.asker  # which is told
        return answer

    def undo(self) -> Answer:
        """Take back the last answer that stands, and return it; its question is put again (if it was answered before
        a restart, that or another one). Raises ValueError where there is none, and otherwise like ``withdraw``."""
        standing = [entry for entry in self._log if not entry.retracted]
        if not standing:
            raise ValueError("there is no answer to undo")
        last = standing[-1].answer
        self.withdraw(last.query.id)
        return last

    def withdraw(self, id: str, **metadata: Any) -> None:
        """Take back the answer to the query of this id, whichever it is; the others stay and are used. metadata: any
        JSON for the log, such as the reason. Raises ValueError where no answer of this id stands, and where the session
        was given an asker in place of a function that makes one."""
        if self._make is None:
            raise ValueError(
                "to take back an answer the session must make a new asker: give Session a function known -> asker, "
                "such as lambda known: choose(vectors, comparator, known=known)"
            )
        known = {entry.answer.query.id for entry in self._standing()[0]}
        repeat = any(entry.repeat for entry in self._log if entry.answer.query.id == id)
        before = self._stands
        if not repeat:  # of which the asker knows nothing
            self._stands = None  # now, for an interruption may come when the answer is taken back already
        try:
            self._log.retract(id, **{**self._now(), **metadata})
        except Exception:
            self._stands = before
            raise
        self._put_at.clear()
        if not repeat:
            # after the last answer what came before is told again, and its question comes back
            self._know(self._restarted() if id in known else self._resumed())

    def conflicts(self) -> tuple[tuple[Entry, ...], ...]:
        """Sets of answers that do not go together, whatever the scale: if any one of a set were withdrawn, the others
        of that set would. No answer is in two of them. Of a noisy comparator, too, as if the person did not err."""
        rest = [entry for entry in self._log if _counts(entry) and entry.answer.verdict is not None]
        found: list[tuple[Entry, ...]] = []
        while rest:
            comparator = self._reliable(len(rest[0].answer.query.left))
            try:
                comparator.update(Answers.of([entry.answer for entry in rest], comparator.k))
                break
            except InconsistentAnswers as error:
                rows = sorted({row for row, _ in error.answers})
                found.append(tuple(rest[row] for row in rows))
                rest = [entry for row, entry in enumerate(rest) if row not in rows]
        return tuple(found)

    def status(self) -> SessionStatus:
        """Where the session stands. Computes the next question, to see whether there is one."""
        entries = [entry for entry in self._log if not entry.repeat]
        standing = [entry for entry in entries if not entry.retracted]
        again = [entry for entry in self._log if entry.repeat and not entry.retracted]
        verdicts = [entry.answer.verdict for entry in standing]
        return SessionStatus(
            answered=len(standing),
            equal=verdicts.count(Verdict.EQUAL),
            cannot_tell=verdicts.count(None),
            unused=sum(not entry.used for entry in standing),
            withdrawn=len(entries) - len(standing),
            finished=not self._pending(),
            repeated=len(again),
            alike=sum(entry.metadata[EXPECTED] == entry.answer.verdict for entry in again),
        )

    def result(self) -> Any:
        """What the asker knows so far: the policy of a learner, the choice of ``choose``."""
        return self.asker.result()

    def close(self) -> None:
        """Close the log, if the session opened it."""
        if self._mine:
            self._log.close()

    @property
    def _standing_now(self) -> _Standing:
        assert self._stands is not None
        return self._stands

    def _know(self, asker: Asker) -> None:
        """Go on with an asker that knows all that is in the log."""
        self._stands = _Standing(asker, len(self._log))

    def _tell_next(self, now: _Standing) -> None:
        """Tell the asker the next entry of the log that it does not know. After an interruption this is called again:
        a query that the asker waits for no more was told."""
        entry, asker = self._log[now.known], now.asker
        if entry.repeat or entry.retracted:
            self._stands = _Standing(asker, now.known + 1)
            return
        if any(query.id == entry.answer.query.id for query in asker.ask()):
            self._stands = now = now._replace(telling=True)
            if now.contradicts is None:
                try:
                    asker.tell([entry.answer])
                except InconsistentAnswers as error:
                    self._stands = now = now._replace(contradicts=[name for _, name in error.answers])
            if now.contradicts is not None:
                asker.tell([entry.answer], "drop")
        elif not now.telling and _counts(entry):  # it was in place of a query, or comes from elsewhere
            if self._make is None:
                raise ValueError(_NOT_ITS_QUESTIONS)
            self._stands = None
            self._know(self._restarted())
            return
        self._stands = _Standing(asker, now.known + 1, unmarked=now.contradicts)

    def _mark_contradiction(self) -> None:
        """Mark the last entry that the asker knows unused, where it had to be dropped."""
        now = self._standing_now
        if now.unmarked is not None:
            last = self._log[now.known - 1]
            if last.used:
                self._mark_unused(last.answer.query.id, now.unmarked)
            self._stands = now._replace(unmarked=None)

    def _pending(self) -> dict[str, Query]:
        return {query.id: query for query in self.asker.ask()}

    def _now(self) -> dict[str, Any]:
        """The metadata of every line."""
        when = datetime.fromtimestamp(self._clock(), UTC).isoformat(timespec="milliseconds")
        return {"time": when, **self._stamp}

    def _standing(self) -> tuple[list[Entry], list[Entry]]:
        """The entries not withdrawn, repeats left out: those that the asker knew when it was made, and those told to it
        since."""
        entries, n = list(self._log), self._log.restarted
        before, since = ([e for e in some if not e.retracted and not e.repeat] for some in (entries[:n], entries[n:]))
        return before, since

    def _to_answer(self, id: str) -> Query | None:
        """The query of this id, if it waits for an answer."""
        waits = self.next_told()
        for query in (self._repeat(), self._in_place_of(waits)) if waits is not None else ():
            if query is not None and query.id == id:
                return query
        return self._pending().get(id)

    def _in_place_of(self, query: Query) -> Query | None:
        """What is put in place of a pending query, if anything is: what an audit confirms is asked as it is."""
        asker = self.asker
        if self.instead is None or self._make is None or (isinstance(asker, Audits) and query.id in asker.implied):
            return None
        said = [tail_sums(entry.answer.query.d) for entry in self._log if not entry.retracted]

        def asked_before(other: Query) -> bool:
            return bool(said) and bool(same_pairs(tail_sums(other.d), np.array(said)).any())

        return self.instead(query, asked_before)

    def _repeat(self) -> Query | None:
        """The earlier question that is to be put again now, as a query of its own, if one is."""
        standing = [entry for entry in self._log if not entry.retracted]
        if not standing or standing[-1].repeat:
            return None
        first = [entry.answer for entry in standing if not entry.repeat]
        chance, which = fold(self._key, len(first), [0, 1])
        if uniform(chance) >= self._audit:
            return None
        again = {entry.metadata[REPEATS] for entry in standing if entry.repeat}
        # not the last one, which is remembered
        may = [said.query for said in first[:-1] if said.verdict is not None and said.query.id not in again]
        if not may:
            return None
        query = may[int(which) % len(may)]
        return replace(query, id=f"{query.id}{_AGAIN}")

    def _repeated(self, query: Query) -> Answer | None:
        """What was answered to a query the first time, if it is a repeat."""
        if not self.is_repeat(query.id):
            return None
        return _last([entry for entry in self._log if not entry.retracted], query.id.removesuffix(_AGAIN))

    def _mark_unused(self, id: str, contradicts: Sequence[str]) -> None:
        self._log.mark_unused(id, **{CONTRADICTS: [name for name in contradicts if name != id]})

    def _resumed(self) -> Asker:
        """An asker where the log has it."""
        before, since = self._standing()
        if self._make is None:
            assert self._given is not None
            if not before and self._told_again(self._given, since):
                return self._given
            raise ValueError(_NOT_ITS_QUESTIONS)
        try:
            asker = self._made(before)
        except InconsistentAnswers:  # with another comparator, perhaps
            return self._restarted()
        return asker if self._told_again(asker, since) else self._restarted()

    def _told_again(self, asker: Asker, entries: Sequence[Entry]) -> bool:
        """Tell an asker what it was told; whether it asks the same."""
        for entry in entries:
            id = entry.answer.query.id
            if id not in {query.id for query in asker.ask()}:
                if _counts(entry):
                    return False
                continue  # a practice question, say
            contradicts = tell(asker, entry.answer)
            if contradicts is None and not entry.used:
                return False
            if contradicts is not None and entry.used:  # a crash came between
                self._mark_unused(id, contradicts)
        return True

    def _restarted(self) -> Asker:
        """An asker that knows all that stands, but for what contradicts it; and the log says so."""
        before = [entry for entry in self._log if not entry.retracted and not entry.repeat]
        known = [replace(entry, used=True) if _counts(entry) else entry for entry in before]
        contradicts: dict[int, list[str]] = {}
        while True:
            try:
                asker = self._made(known)
                break
            except InconsistentAnswers as error:
                names = [name for _, name in error.answers]
                told = [i for i, entry in enumerate(known) if entry.used and entry.answer.verdict is not None]
                last = next((i for i in reversed(told) if known[i].answer.query.id in names), None)
                if last is None:
                    raise
                known[last], contradicts[last] = replace(known[last], used=False), names
        for i, (was, entry) in enumerate(zip(before, known, strict=True)):
            if was.used and not entry.used:
                self._mark_unused(entry.answer.query.id, contradicts[i])
            elif entry.used and not was.used:
                self._log.mark_used(entry.answer.query.id)
        self._log.mark_restart(**self._now())
        return asker

    def _made(self, known: list[Entry]) -> Asker:
        assert self._make is not None
        asker = self._make(list(known))
        if not isinstance(asker, Asker):
            raise TypeError(f"the function given to Session must return what has ask, tell and result, not {asker!r}")
        return asker

    def _reliable(self, k: int) -> PolytopeComparator:
        """A comparator that knows no answer, and takes each for true."""
        asker = self.asker
        if not isinstance(asker, Compares):
            return PolytopeComparator(k)
        known = asker.comparator
        if isinstance(known, PolytopeComparator):
            return known.retract(*known.answers.ids)
        return PolytopeComparator(k, tie=tie_of(known))


def _check_makes(asker: type) -> None:
    """Raise TypeError for a class that cannot be called with the known answers alone."""
    try:
        takes = list(signature(asker).parameters.values())
        signature(asker).bind([])
    except (TypeError, ValueError):
        takes = []
    if not takes or (isinstance(asker, Asker) and takes[0].name != "known" and takes[0].kind is not _ANY_NUMBER):
        name = asker.__name__
        raise TypeError(
            f"a session takes an asker, or a function known -> asker, but {name} is a class: make one, "
            f"{name}(...), or give a function that does, lambda known: {name}(..., known=known)"
        )


def tell(asker: Asker, answer: Answer) -> list[str] | None:
    """Tell an asker; the ids of the answers that do not go together where this one had to be dropped."""
    try:
        asker.tell([answer])
    except InconsistentAnswers as error:
        asker.tell([answer], "drop")
        return [name for _, name in error.answers]
    return None


def _counts(entry: Entry) -> bool:
    """Whether an answer stands, and is used, or would be but for what it contradicts."""
    return not entry.retracted and (entry.used or CONTRADICTS in entry.metadata)


def _last(entries: Sequence[Entry], id: str) -> Answer | None:
    return next((entry.answer for entry in reversed(entries) if entry.answer.query.id == id), None)


def _word(verdict: Verdict | None) -> str:
    return "'cannot tell'" if verdict is None else repr(verdict.name.lower())
