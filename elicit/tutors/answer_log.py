"""The answer log: append-only, and the single source of truth. Comparators are rebuilt from it.

A log on disk is JSON lines: a header, then a line for each event. Each line has a checksum that
chains it to the line before (``log_file``). Every append is on the disk before it returns, so a
crash loses at most the line that was being written. Only one process at a time can write the file.
The log reads no clock: a caller who wants times gives them as metadata.

The events are:

- "asked": a question was put.
- "answered": the verdict 0 is "equal", and null "cannot tell".
- "withdrawn": all earlier answers with this id are taken back. The query can be answered anew.
- "unused": an answer contradicts others, and comparators do not learn it. "used": they learn it
  again, after others were withdrawn.
- "restarted": the asker was made anew, knowing the answers so far.

Nothing is deleted.
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from operator import index
from pathlib import Path
from typing import Any, NamedTuple, Self, SupportsIndex, TypeVar, overload

from elicit._support.closing import Closing
from elicit.model.query import Answer, Answers, Query, Verdict, as_who
from elicit.tutors.log_file import (
    CHECK,
    EVENT,
    FORMAT,
    VERSION,
    BadLog,
    Lines,
    LogFile,
    damage,
    json_of,
    parse,
    read_bytes,
    with_check,
)

T = TypeVar("T")

WHO = "who"
"""The field of an answer's line that names the person who gave it. In a log's header it names the
person who gave all answers."""

_FIELDS = ("id", "left", "right", "verdict", "swapped", "about", "used")
EXPECTED = "expected"
"""The metadata field, of an audit's answer, that holds the verdict implied by the other answers; of
a repeat's answer, the first answer's verdict."""
REPEATS = "repeats"
"""The metadata field of an answer to a repeated question that holds the id of the first.
Comparators do not learn such answers."""
RESOLVED = "resolved"
"""The metadata field of a withdrawal by which the person settled two answers that differ. It holds
the verdict that replaces both, or None for "cannot tell"."""
CONTRADICTS = "contradicts"
"""The metadata field of an answer marked as unused that holds the ids of the answers it
contradicts."""


@dataclass(frozen=True)
class Entry:
    """An answer in a log, whether comparators learn from it, and the caller's metadata.

    ``retraction`` is None while the answer stands. If the answer was taken back, it is the metadata
    of the line that did so, and ``used`` is False.
    """

    answer: Answer
    used: bool = True
    metadata: Mapping[str, Any] = field(default_factory=dict)
    retraction: Mapping[str, Any] | None = None

    @property
    def stands(self) -> bool:
        """True unless the answer was taken back."""
        return self.retraction is None

    @property
    def retracted(self) -> bool:
        """True if the answer was taken back."""
        return self.retraction is not None

    @property
    def repeat(self) -> bool:
        """True if the question was asked again to see whether the answers agree."""
        return REPEATS in self.metadata


@dataclass(frozen=True)
class Asked:
    """A question that was put to the tutor, and whether its sides were shown exchanged.

    ``metadata`` is the caller's, such as the words shown.
    """

    query: Query
    swapped: bool = False
    metadata: Mapping[str, Any] = field(default_factory=dict)


class _Doing(NamedTuple):
    """An event under way: what it changes in the log, and the file's lines once it is written."""

    change: Callable[[], None]
    header: dict[str, Any]
    lines: Lines


def entries_of(log: Iterable[Entry | Answer]) -> list[Entry]:
    """Return the entries of a log, of a part of it, or of Answers to queries, as a list.

    Raises TypeError for anything else, such as ``Answers``, which do not say what was shown left
    and right.
    """
    entries = [Entry(item) if isinstance(item, Answer) else item for item in log]
    for item in entries:
        if not isinstance(item, Entry):
            raise TypeError(
                f"a log holds entries or Answers, not {item!r}; AnswerLog.read(path) reads a file"
            )
    return entries


class AnswerLog(Closing):
    """All answers of a run, in the order in which they were told.

    ``log[i]`` is an ``Entry``, and ``log[i:j]`` a tuple of them.

    The file stays locked until ``close``, or until the log object is deleted. As a context manager
    the log closes at the end of the block. A new file can be read by its owner only.

    Parameters
    ----------
    path : str or path, optional
        The file to write. An existing log is continued. None: the log is kept in memory.
    k : int, optional
        Number of levels. None: that of the file, else that of the first answer.
    header : mapping, optional
        Further JSON fields for the header line, such as the names of the levels. An existing file
        must have the same fields.
    who : str, optional
        The person who gave all these answers. An existing file must be of the same person, or name
        nobody. None: the person whom the file names. If it names nobody, either each answer names
        its person or none does.

    Raises
    ------
    BadLog
        If the file is no log or no regular file, is damaged before its last line, disagrees with
        ``k`` or ``header``, or is of another person.
    BlockingIOError
        If another process writes to the file.
    OSError
        If it cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None = None,
        k: int | None = None,
        header: Mapping[str, Any] | None = None,
        who: str | None = None,
    ) -> None:
        fixed = {"format": FORMAT, "version": VERSION}
        person = {} if as_who(who) is None else {WHO: who}
        given = {**fixed, **({} if k is None else {"k": k}), **(header or {}), **person}
        if header and not {*fixed, "k", CHECK}.isdisjoint(header):
            raise ValueError(
                f"a header's format, version, k and check are not free fields: {dict(header)}"
            )
        self._path = None if path is None else _as_path(path)
        self._header: dict[str, Any] = json.loads(json_of(given, "header"))
        self._entries: list[Entry] = []
        self._asked: list[Asked] = []
        self._restarted = 0
        self._read_only = False
        self._file: LogFile | None = None
        self._lines = Lines()  # of the file: where the next one goes
        self._doing: _Doing | None = None
        if self._path is None:
            return
        self._file = LogFile(self._path)  # an unwritable file must show before the first question
        try:
            self._load(self._path, self._file.content, None)
            check_person(self, who)
        except BaseException:
            self.close()
            raise
        self._file.keep(self._lines.kept)

    @classmethod
    def read(cls, path: str | os.PathLike[str], faults: list[BadLog] | None = None) -> Self:
        """Return the log in a file, for reading only.

        The file is not changed and not locked. After a line that was changed or is missing, nothing
        can be trusted.

        Parameters
        ----------
        path : str or path
        faults : list, optional
            Receives the errors of a damaged log, which is then read as far as it can be trusted. If
            a line is intact but its content is impossible, only this line is left out. Without a
            list the first error is raised.

        Returns
        -------
        AnswerLog

        Raises
        ------
        BadLog
            If the file is no log or is damaged, and there is no list for ``faults``.
        FileNotFoundError
            If there is no such file.
        TypeError
            If ``path`` is no path.
        """
        path = _as_path(path)
        log = cls()
        log._path, log._read_only = path, True
        log._load(log._path, read_bytes(log._path), faults)
        return log

    def close(self) -> None:
        """Release the file for another writer. The log's contents can still be read."""
        if self._file is not None:
            self._file.close()

    @property
    def path(self) -> Path | None:
        """The file; None for a log in memory."""
        return self._path

    @property
    def k(self) -> int | None:
        """Number of levels; None until a header or an answer says it."""
        self._finish()
        return self._header.get("k")

    @property
    def who(self) -> str | None:
        """The person who gave all the answers; None if the log's header names nobody."""
        self._finish()
        found = self._header.get(WHO)
        return found if isinstance(found, str) else None

    @property
    def header(self) -> dict[str, Any]:
        """The fields of the header line (a copy)."""
        self._finish()
        return dict(self._header)

    @property
    def asked(self) -> tuple[Asked, ...]:
        """The questions that were put, in order. A question that was put twice is there twice."""
        self._finish()
        return tuple(self._asked)

    @property
    def restarted(self) -> int:
        """The number of entries that the log had at the last ``mark_restart``."""
        self._finish()
        return self._restarted

    @property
    def checksum(self) -> str | None:
        """Checksum of the last line on the disk; None for an empty file and a log in memory."""
        self._finish()
        return self._lines.check or None

    def append(self, answer: Answer, used: bool = True, **metadata: Any) -> None:
        """Add an answer. When this returns, the answer is on the disk.

        If it raises, nothing has changed. (Only Ctrl+C may interrupt it after the answer was
        added.)

        Parameters
        ----------
        answer : Answer
            The answer.
        used : bool
            False records an answer that comparators must not learn. Default: True.
        **metadata
            Any JSON, such as a time.

        Raises
        ------
        ValueError
            For another number of levels, for metadata that is no JSON or names another person than
            the answer, and for an answer of another person than the log's.
        BadLog
            If another program wrote to the file.
        OSError
            If writing fails.
        """
        told = {"verdict": answer.verdict, "swapped": bool(answer.swapped), "used": bool(used)}
        person = answer.who or self.who
        if person is not None:
            _check_same(self.who, person)
            _check_same(metadata.setdefault(WHO, person), person)
        self._put("answered", {**_fields_of(answer.query), **told}, metadata)

    def append_asked(self, query: Query, swapped: bool = False, **metadata: Any) -> None:
        """Record that a question is put to the tutor.

        Parameters
        ----------
        query : Query
            The question.
        swapped : bool
            True if its sides are exchanged. Default: False.
        **metadata
            Any JSON, such as the words shown.

        Raises
        ------
        ValueError, BadLog, OSError
            As for ``append``.
        """
        self._put("asked", {**_fields_of(query), "swapped": bool(swapped)}, metadata)

    def retract(self, id: str, **metadata: Any) -> None:
        """Take back all answers so far to the query of this id.

        A line is added to the file. The answers stay in the log, marked as taken back, and are no
        longer among ``answers()``.

        Parameters
        ----------
        id : str
            The id of the query.
        **metadata
            Any JSON, such as the reason.

        Raises
        ------
        ValueError
            If no answer of this id stands. Other errors are as for ``append``.
        """
        self._put("withdrawn", {"id": id}, metadata)

    def mark_unused(self, id: str, **metadata: Any) -> None:
        """Record that comparators are not to learn from an answer, since it contradicts others.

        Parameters
        ----------
        id : str
            The id of the query. Its last used answer is meant.
        **metadata
            Any JSON, added to the answer's.

        Raises
        ------
        ValueError
            If this query has no used answer. Other errors are as for ``append``.
        """
        self._put("unused", {"id": id}, metadata)

    def mark_used(self, id: str, **metadata: Any) -> None:
        """Record that comparators learn again from an answer that was marked as unused.

        The reason may be that the answers it contradicted were taken back.

        Parameters
        ----------
        id : str
            The id of the query. Its last unused answer is meant.
        **metadata
            Any JSON, added to the answer's.

        Raises
        ------
        ValueError
            If this query has no unused answer. Other errors are as for ``append``.
        """
        self._put("used", {"id": id}, metadata)

    def mark_restart(self, **metadata: Any) -> None:
        """Record that the asker was made anew here, knowing all answers that were not taken back.

        Parameters
        ----------
        **metadata
            Any JSON.

        Raises
        ------
        ValueError, BadLog, OSError
            As for ``append``.
        """
        self._put("restarted", {}, metadata)

    @property
    def standing(self) -> tuple[Entry, ...]:
        """The entries that were not taken back, including repeats and those that are not used."""
        return tuple(entry for entry in self if entry.stands)

    def answers(self) -> Answers:
        """Return the answers that a comparator learns from, in order.

        Returns
        -------
        Answers
            Those that are used, not taken back, and have a verdict.

        Raises
        ------
        ValueError
            For an empty log that does not know its number of levels.
        """
        if self.k is None:
            raise ValueError("an empty log does not know its number of levels: give k to AnswerLog")
        return Answers.of([entry.answer for entry in self if entry.used], self.k)

    def __len__(self) -> int:
        self._finish()
        return len(self._entries)

    def __iter__(self) -> Iterator[Entry]:
        self._finish()
        return iter(tuple(self._entries))

    @overload
    def __getitem__(self, rows: SupportsIndex) -> Entry: ...

    @overload
    def __getitem__(self, rows: slice) -> tuple[Entry, ...]: ...

    def __getitem__(self, rows: SupportsIndex | slice) -> Entry | tuple[Entry, ...]:
        self._finish()
        if isinstance(rows, slice):
            return tuple(self._entries[rows])
        try:
            return self._entries[rows]
        except IndexError:
            raise IndexError(
                f"there is no answer {index(rows)}: the log has {len(self)}, counted from 0"
            ) from None

    def __repr__(self) -> str:
        back = sum(entry.retracted for entry in self)
        parts = [
            f"{len(self)} answers{f', {back} of them retracted' if back else ''}",
            f"k={self.k}",
        ]
        parts += [] if self._path is None else [f"path={str(self._path)!r}"]
        return f"AnswerLog({', '.join([*parts, *(['read only'] if self._read_only else [])])})"

    def _put(self, event: str, fields: dict[str, Any], metadata: dict[str, Any]) -> None:
        """Write an event to the end of the log, after a header if the file has none yet."""
        self._finish()
        if self._read_only:
            raise ValueError(
                f"this log was opened for reading: AnswerLog({str(self._path)!r}) continues the "
                "file"
            )
        if not metadata.keys().isdisjoint((*_FIELDS, EVENT, CHECK)):
            raise ValueError(
                f"metadata may not be named like a field of the log: {sorted(metadata)}"
            )
        text = json_of({EVENT: event, **fields, **metadata}, "metadata")
        change = self._event(*_parts(json.loads(text)))
        header = self._header
        if self.k is None and "left" in fields:
            header = {"format": FORMAT, "version": VERSION, "k": len(fields["left"]), **header}
        try:
            if self._file is None:
                self._doing = _Doing(change, header, self._lines)
            else:
                data, lines = self._appended(self._file, header, text)
                self._doing = _Doing(change, header, lines)
                self._file.append(data)
        finally:
            self._finish()

    def _finish(self) -> None:
        """Apply the event under way to the log, once it is on the disk.

        Applying it twice does no harm, because Ctrl+C may come at any line. So every method that
        reads the log calls this first.
        """
        doing = self._doing
        if doing is not None and (self._file is None or self._file.kept == doing.lines.kept):
            doing.change()
            self._header, self._lines = doing.header, doing.lines
            self._doing = None

    def _appended(self, file: LogFile, header: dict[str, Any], text: bytes) -> tuple[bytes, Lines]:
        """Return the bytes that an event adds to the file, and the state of the file after it."""
        data, check = self._lines.joint, self._lines.check
        if header.get("k") is None:
            raise ValueError("an empty log does not know its number of levels: give k to AnswerLog")
        if not self._lines.kept:
            first, check = with_check(json_of(header, "header"), "")
            data += first
        line, check = with_check(text, check)
        return data + line, Lines(kept=self._lines.kept + len(data) + len(line), check=check)

    def _load(self, path: Path, data: bytes, faults: list[BadLog] | None) -> None:
        lines = parse(data, path)
        found = [] if lines.damage is None else [lines.damage]
        if lines.header is not None:
            self._header = _agreed(lines.header, self._header, path)
        for number, fields in lines.lines:
            try:
                self._event(*_parts(fields))()
            except (ValueError, TypeError, KeyError, AttributeError) as error:
                why = f"it has no field {error}" if isinstance(error, KeyError) else str(error)
                found.append(damage(path, number, data.split(b"\n", number)[number - 1], why))
        if faults is not None:
            faults.extend(sorted(found, key=lambda fault: fault.line or 0))
        elif found:
            raise min(found, key=lambda fault: fault.line or 0)
        lines.lines.clear()
        self._lines = lines

    def _event(
        self, event: str, fields: dict[str, Any], metadata: dict[str, Any]
    ) -> Callable[[], None]:
        """Return a function that applies a parsed event to this log. Calling it twice does no harm.

        Raises ValueError, TypeError or KeyError if it is no event, or cannot come next.
        """
        if event == "restarted":
            return self._restart
        if event == "withdrawn":
            return partial(self._exchange, _withdrawn(self._entries, fields["id"], metadata))
        if event in ("used", "unused"):
            return partial(
                self._exchange, _marked(self._entries, fields["id"], event == "used", metadata)
            )
        if event not in ("asked", "answered"):
            raise ValueError(f"no such event: {event!r}; was the file written by a newer program?")
        for name, kind in (("id", str), ("about", str), ("swapped", bool)):
            if not isinstance(fields[name], kind):
                raise ValueError(f"its {name} is {fields[name]!r}")
        query = Query(fields["id"], fields["left"], fields["right"], fields["about"])
        if self.k not in (None, len(query.left)):
            raise ValueError(
                f"this log is about {self.k} levels, but query {query.id} is about "
                f"{len(query.left)}"
            )
        if event == "asked":
            return partial(
                _end_with, self._asked, len(self._asked), Asked(query, fields["swapped"], metadata)
            )
        entry = _entry(query, fields, metadata, self.who)
        return partial(_end_with, self._entries, len(self._entries), entry)

    def _exchange(self, changed: dict[int, Entry]) -> None:
        for i, entry in changed.items():
            self._entries[i] = entry

    def _restart(self) -> None:
        self._restarted = len(self._entries)


def _as_path(path: object) -> Path:
    """Return a path given as text or as a path.

    For anything else, raises TypeError that says what to write.
    """
    try:
        return Path(path)  # type: ignore[arg-type]
    except TypeError:
        advice = f": the number of levels is k={path}" if type(path) is int else ""
        raise TypeError(
            f"path must be the name of a file, or None for a log in memory, not {path!r}{advice}"
        ) from None


def _end_with(items: list[T], n: int, last: T) -> None:
    """Replace all items after the first n by ``last``. Calling it twice does no harm."""
    items[n:] = [last]


def _fields_of(query: Query) -> dict[str, Any]:
    return {
        "id": query.id,
        "left": query.left.tolist(),
        "right": query.right.tolist(),
        "about": query.about,
    }


def _parts(fields: dict[str, Any]) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """Return the parts of a parsed line: its event, its fields, and the caller's metadata."""
    told = {name: fields[name] for name in fields if name not in _FIELDS and name != EVENT}
    return fields[EVENT], {name: fields[name] for name in _FIELDS if name in fields}, told


def _entry(
    query: Query, fields: Mapping[str, Any], metadata: Mapping[str, Any], who: str | None
) -> Entry:
    """Return the entry of an answer to this query. Its person is ``who`` if the line names nobody.

    Raises ValueError or KeyError.
    """
    if not isinstance(fields["used"], bool):
        raise ValueError(f"its used is {fields['used']!r}")
    verdict = fields["verdict"]
    if verdict is not None and (type(verdict) is not int or verdict not in (-1, 0, 1)):
        raise ValueError(f"its verdict is {verdict!r}, not -1, 0, 1 or null")
    said = metadata.get(WHO)
    person = said if isinstance(said, str) and said.strip() else who
    answer = Answer(query, None if verdict is None else Verdict(verdict), fields["swapped"], person)
    return Entry(answer, fields["used"], metadata)


def _withdrawn(entries: list[Entry], id: Any, told: Mapping[str, Any]) -> dict[int, Entry]:
    """Return changed copies of the entries that a withdrawal takes back.

    They are in a dict by their place in the log. Raises ValueError if there are none.
    """
    mine = {i: entry for i, entry in enumerate(entries) if entry.answer.query.id == id}
    people = sorted({e.answer.who for e in mine.values() if e.stands and e.answer.who})
    if len(people) > 1:
        raise ValueError(
            f"answers of {' and '.join(people)} to query {id} stand in this log: take back one in "
            "the log of that person, and merge the logs again"
        )
    if all(entry.retracted for entry in mine.values()):
        why = (
            "was retracted already, and none was given since"
            if mine
            else "cannot be retracted: this log has none"
        )
        raise ValueError(f"the answer with the id {id!r} {why}")
    return {
        i: replace(entry, used=False, retraction=told) for i, entry in mine.items() if entry.stands
    }


def _marked(entries: list[Entry], id: Any, used: bool, told: Mapping[str, Any]) -> dict[int, Entry]:
    """Return a changed copy of the last entry of this id, marked as used or unused.

    It is in a dict by its place in the log. Raises ValueError if there is no such entry.
    """
    for i in reversed(range(len(entries))):
        entry = entries[i]
        if entry.answer.query.id == id and entry.used != used and entry.stands:
            return {i: replace(entry, used=used, metadata={**entry.metadata, **told})}
    was = "unused" if used else "used"
    raise ValueError(
        f"no {was} answer has the id {id!r}: it was withdrawn, or marked already, or never given"
    )


def check_person(log: AnswerLog, who: str | None) -> None:
    """Raise BadLog if a log holds answers of another person than ``who``. None allows anybody.

    Answers that name nobody, and answers that were withdrawn, are ignored.
    """
    if who is None:
        return
    named = {log.who} | {entry.answer.who for entry in log.standing}
    if others := sorted(name for name in named if name not in (None, who)):
        held = ", ".join(map(repr, others))
        raise BadLog(
            f"{log.path or 'this log'} holds the answers of {held}, not of {who!r}. Keep the "
            f"answers of {who!r} in a file of their own"
        )


def _check_same(known: Any, who: str) -> None:
    """Raise ValueError if an answer of one person is given as one of another person."""
    if known is not None and known != who:
        raise ValueError(f"an answer of {who!r} cannot be logged as one of {known!r}")


def _agreed(header: dict[str, Any], wanted: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return the header of a file, after a check that the log can be continued as wanted."""
    for name, value in wanted.items():
        if name in ("format", "version", WHO) or (name in header and header[name] == value):
            continue
        found = (
            f"{name} = {header[name]!r}, not {value!r}"
            if name in header
            else f"nothing of {name}, not {value!r}"
        )
        other = f"{path} is another log: its header says {found}"
        raise BadLog(f"{other}. Choose another file, or open it as what it is", 1)
    return header
