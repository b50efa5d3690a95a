"""An asker that is kept in step with the answer log of its session.

The log alone determines the state of a session. A new asker is told all standing answers since the
last (re)start, in order. So the next question and the end are those of a session that nothing
disturbed. If there are more than sixty answers, the new asker knows them from the start instead
(``known=``), which is faster.

An asker is restarted, with the earlier answers known from the start, in two cases: its questions
are not those of the log, for example with another comparator, or an answer is withdrawn that others
followed.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from inspect import Parameter, signature
from typing import Any, NamedTuple

from elicit._support.background import MadeAhead
from elicit.model.query import Answer, InconsistentAnswers
from elicit.person.asker import AfterAnswer, Asker, MakeAsker, Supposed, counts, tell
from elicit.tutors.answer_log import CONTRADICTS, WHO, AnswerLog, Entry

_MOST_TOLD_AGAIN = 60
"""Answers that are told again one by one. Each takes up to 50 ms of CPU time with a posterior; an
asker that is made anew knows 200 of them in half a second, but may go on with another question."""
_ANY_NUMBER = Parameter.VAR_POSITIONAL  # of arguments
_NOT_ITS_QUESTIONS = (
    "this asker does not ask what the log answers: it was told something already, has another "
    "comparator or other "
    "settings, or an answer was withdrawn. Give Session a function known -> asker in its place, "
    "such as lambda known: "
    "choose(vectors, comparator, known=known)"
)


Made = tuple[Asker, list[Entry], dict[int, list[str]]]
"""An asker, the entries that it knows, and for those it dropped the ids that contradict them."""
_Key = tuple[tuple[Any, ...], ...]


class _Position(NamedTuple):
    """An asker, and how many entries of the log it knows.

    Both are replaced together, because an interruption may come at any line.
    """

    asker: Asker
    known: int
    telling: bool = False  # whether it may have been told the next entry already
    contradicts: list[str] | None = None  # ids that the next entry is known to contradict
    unmarked: list[str] | None = (
        None  # ids that the last known entry contradicts, until the log says so
    )


class ReplayedAsker:
    """Makes the asker that belongs to a log, and tells it what is appended to the log.

    Parameters
    ----------
    asker : Asker or MakeAsker
        A new asker, or a function that makes an asker from the answers that it is to know.
    log : AnswerLog
    stamp : callable
        Returns the metadata of a line of the log.

    Raises
    ------
    TypeError
        If ``asker`` is neither.
    ValueError
        If this log needs a function that makes an asker.
    """

    def __init__(
        self, asker: Asker | MakeAsker, log: AnswerLog, stamp: Callable[[], dict[str, Any]]
    ) -> None:
        self.check(asker)
        self._given = asker if isinstance(asker, Asker) and not isinstance(asker, type) else None
        self._make = asker if self._given is None and callable(asker) else None
        self._log = log
        self._stamp = stamp
        self._position: _Position | None = None  # None: the asker is to be made from the log
        self._restarts = MadeAhead[_Key, Made]()

    @staticmethod
    def check(asker: Any) -> None:
        """Raise TypeError unless the object is an asker or a function that makes one."""
        if isinstance(asker, type):
            _check_makes(asker)
        elif not isinstance(asker, Asker) and not callable(asker):
            raise TypeError(
                "a session takes a function known -> asker, or an asker with ask, tell and "
                f"result, not {asker!r}"
            )

    @property
    def makes_askers(self) -> bool:
        """True if a function that makes askers was given, rather than an asker."""
        return self._make is not None

    def current(self) -> Asker:
        """Return the asker, after telling it all that is in the log.

        The object is replaced when an answer is taken back, and when the asker after an answer was
        computed ahead.
        """
        if self._position is None:
            self._know(self._resumed())
        self._mark_contradiction()
        while (now := self._position_now).known < len(
            self._log
        ):  # logged, but telling it failed or was interrupted
            self._tell_next(now)
            self._mark_contradiction()
        return self._position_now.asker

    def go_on_with(self, after: AfterAnswer) -> None:
        """Replace the asker by one that was computed ahead, and knows all that is in the log."""
        self._position = _Position(after.asker, len(self._log), unmarked=after.contradicts)

    def withdraw(self, id: str, metadata: dict[str, Any]) -> None:
        """Take back the answer to the query of this id, and go on without it.

        Raises ValueError if no answer of this id stands, or if a new asker would be needed and
        cannot be made.
        """
        if self._make is None:
            raise ValueError(
                "to take back an answer the session must make a new asker: give Session a function "
                "known -> asker, "
                "such as lambda known: choose(vectors, comparator, known=known)"
            )
        known = {entry.answer.query.id for entry in self.known_and_told()[0]}
        repeat = any(entry.repeat for entry in self._log if entry.answer.query.id == id)
        before = self._position
        if not repeat:  # the asker knows nothing of repeats
            self._position = (
                None  # now, for an interruption may come when the answer is taken back already
            )
        try:
            self._log.retract(id, **metadata)
        except Exception:
            self._position = before
            raise
        if not repeat:
            # if the last answer is withdrawn, the earlier ones are told again, and its question
            # comes back
            self._know(self._restarted() if id in known else self._resumed())

    def at_start(self) -> Asker | None:
        """Return a new asker that knows no answer, or None if none can be made."""
        return None if self._make is None else self._made([])

    def discard(self) -> None:
        """Discard the asker, and those that were made ahead; the next one is made from the log.

        If an asker was given in place of a function, it is kept, because it cannot be made again.
        """
        if self._make is not None:
            self._position = None
            self._restarts = MadeAhead[_Key, Made]()

    def restart(self) -> None:
        """Replace the asker by a new one that knows all standing answers from the start."""
        self._know(self._restarted())

    def exchange(self, id: str, metadata: dict[str, Any], answer: Answer) -> None:
        """Take back the answer to the query of this id, and append another answer in its place.

        ``restart`` must follow. Raises ValueError if a new asker would be needed and cannot be
        made.
        """
        if self._make is None:
            raise ValueError("to settle two answers the session must make a new asker")
        self._position = None
        self._log.retract(id, **metadata)
        stamp = self._stamp()
        stamp.pop(WHO, None)  # the answer says whose it is
        self._log.append(answer, **stamp)

    def known_and_told(self) -> tuple[list[Entry], list[Entry]]:
        """Return the standing entries, without repeats, as two lists.

        The first has those that the asker knew when it was made, and the second those it was told
        since.
        """
        entries = list(self._log)
        n = self._log.restarted
        before, since = (
            [e for e in some if e.stands and not e.repeat] for some in (entries[:n], entries[n:])
        )
        return before, since

    def _without_repeats(self) -> list[Entry]:
        """Return the standing entries without repeats, which the asker is not told."""
        return [entry for entry in self._log.standing if not entry.repeat]

    @property
    def _position_now(self) -> _Position:
        assert self._position is not None
        return self._position

    def _know(self, asker: Asker) -> None:
        """Replace the asker by one that knows all that is in the log."""
        self._position = _Position(asker, len(self._log))

    def _tell_next(self, now: _Position) -> None:
        """Tell the asker the next entry of the log that it does not know.

        After an interruption this is called again. If the asker no longer waits for the query, it
        was told already.
        """
        entry, asker = self._log[now.known], now.asker
        if entry.repeat or entry.retracted:
            self._position = _Position(asker, now.known + 1)
            return
        if any(query.id == entry.answer.query.id for query in asker.ask()):
            self._position = now = now._replace(telling=True)
            if now.contradicts is None:
                try:
                    asker.tell([entry.answer])
                except InconsistentAnswers as error:
                    self._position = now = now._replace(
                        contradicts=[name for _, name in error.answers]
                    )
            if now.contradicts is not None:
                asker.tell([entry.answer], "drop")
        elif not now.telling and counts(
            entry
        ):  # it was in place of a query, or comes from elsewhere
            if self._make is None:
                raise ValueError(_NOT_ITS_QUESTIONS)
            self._position = None
            self._know(self._restarted())
            return
        self._position = _Position(asker, now.known + 1, unmarked=now.contradicts)

    def _mark_contradiction(self) -> None:
        """Mark the last entry that was told as unused in the log, if the asker dropped it."""
        now = self._position_now
        if now.unmarked is not None:
            last = self._log[now.known - 1]
            if last.used:
                self._mark_unused(last.answer.query.id, now.unmarked)
            self._position = now._replace(unmarked=None)

    def _mark_unused(self, id: str, contradicts: Sequence[str]) -> None:
        self._log.mark_unused(id, **{CONTRADICTS: [name for name in contradicts if name != id]})

    def _resumed(self) -> Asker:
        """Return a new asker in the state that the log has."""
        before, since = self.known_and_told()
        if self._make is None:
            assert self._given is not None
            if not before and self._told_again(self._given, since):
                return self._given
            raise ValueError(_NOT_ITS_QUESTIONS)
        if len(since) > _MOST_TOLD_AGAIN:
            return self._restarted()
        try:
            asker = self._made(before)
        except InconsistentAnswers:  # with another comparator, perhaps
            return self._restarted()
        return asker if self._told_again(asker, since) else self._restarted()

    def _told_again(self, asker: Asker, entries: Sequence[Entry]) -> bool:
        """Tell a new asker these entries, and return whether its questions were the same."""
        for entry in entries:
            id = entry.answer.query.id
            if id not in {query.id for query in asker.ask()}:
                if counts(entry):
                    return False
                continue  # a practice question, say
            contradicts = tell(asker, entry.answer)
            if contradicts is None and not entry.used:
                return False
            if contradicts is not None and entry.used:  # a crash came between
                self._mark_unused(id, contradicts)
        return True

    def _restarted(self) -> Asker:
        """Return a new asker that knows all standing answers, except those that contradict others.

        The latter are marked as unused in the log.
        """
        before = self._without_repeats()
        ready = self._restarts.take(_key_of(before))
        asker, known, contradicts = ready or self._knowing(before)
        for i, (was, entry) in enumerate(zip(before, known, strict=True)):
            if was.used and not entry.used:
                self._mark_unused(entry.answer.query.id, contradicts[i])
            elif entry.used and not was.used:
                self._log.mark_used(entry.answer.query.id)
        self._log.mark_restart(**self._stamp())
        return asker

    def restarts(self, answers: Sequence[Answer]) -> Iterator[None]:
        """Return steps, each of which makes the asker that also knows one of these answers.

        That asker is used if this answer comes and the asker must then be made anew. Another thread
        may go through the steps.
        """
        before = self._without_repeats()
        after = [[*before, Entry(answer)] for answer in answers]

        def make(known: list[Entry]) -> Made:
            made = self._knowing(known)
            made[0].ask()  # the next question is computed now, too
            return made

        return self._restarts.steps({_key_of(known): partial(make, known) for known in after})

    def supposing(
        self, without: Collection[str], meant: Sequence[Answer]
    ) -> Callable[[], Supposed]:
        """Return a function that makes an asker as it would be with other answers.

        The other answers are those of the log now, without those with an id in ``without``, and
        with those in ``meant``. Nothing changes. Another thread may call the function.
        """
        standing = self._without_repeats()
        before = [entry for entry in standing if entry.answer.query.id not in without]
        before += [Entry(answer) for answer in meant]
        n = sum(entry.answer.verdict is not None for entry in before)

        def make() -> Supposed:
            asker, known, _ = self._knowing(before)
            used = sum(entry.used and entry.answer.verdict is not None for entry in known)
            return Supposed(asker, used, n)

        return make

    def _knowing(self, before: list[Entry]) -> Made:
        """Return an asker that knows these entries, except those that contradict others.

        Also return the entries, marked as used or not, and the ids of those that contradict others.
        """
        known = [replace(entry, used=True) if counts(entry) else entry for entry in before]
        contradicts: dict[int, list[str]] = {}
        while True:
            try:
                asker = self._made(known)
                break
            except InconsistentAnswers as error:
                names = [name for _, name in error.answers]
                told = [
                    i
                    for i, entry in enumerate(known)
                    if entry.used and entry.answer.verdict is not None
                ]
                last = next((i for i in reversed(told) if known[i].answer.query.id in names), None)
                if last is None:
                    raise
                known[last], contradicts[last] = replace(known[last], used=False), names
        return asker, known, contradicts

    def _made(self, known: list[Entry]) -> Asker:
        assert self._make is not None
        asker = self._make(list(known))
        if not isinstance(asker, Asker):
            raise TypeError(
                "the function given to Session must return what has ask, tell and result, not "
                f"{asker!r}"
            )
        return asker


def _key_of(entries: Iterable[Entry]) -> _Key:
    return tuple(
        (e.answer.query.id, e.answer.verdict, e.answer.swapped, e.answer.who) for e in entries
    )


def _check_makes(asker: type) -> None:
    """Raise TypeError for a class that cannot be called with only the known answers."""
    try:
        takes = list(signature(asker).parameters.values())
        signature(asker).bind([])
    except (TypeError, ValueError):
        takes = []
    if not takes or (
        isinstance(asker, Asker) and takes[0].name != "known" and takes[0].kind is not _ANY_NUMBER
    ):
        name = asker.__name__
        raise TypeError(
            f"a session takes an asker, or a function known -> asker, but {name} is a class: make "
            "one, "
            f"{name}(...), or give a function that does, lambda known: {name}(..., known=known)"
        )
