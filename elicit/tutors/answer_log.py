"""The answer log: append-only, and the single source of truth. Comparators are rebuilt from it.

A log on disk is JSON lines: a header, then one line an answer or a retraction. Every append is on the
disk before it returns, so a crash loses at most the line that was being written. The log reads no
clock: a caller who wants times gives them as metadata.

An answer is taken back by a line {"retract": id, ...}; nothing is deleted. It concerns the answers before it that have
this id, so the query can be answered anew. It has none of an answer's fields: a reader that knows no retractions stops
there with BadLog, instead of learning from what was taken back.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import index
from pathlib import Path
from typing import Any, Self, SupportsIndex, overload

from elicit.model.query import Answer, Answers, Query, Verdict

FORMAT = "elicit answers"
VERSION = 1
_START = f'{{"format": "{FORMAT}"'
_FIELDS = ("id", "left", "right", "verdict", "swapped", "about", "used")
_RETRACT = "retract"
EXPECTED = "expected"
"""The metadata of an audit's answer: the verdict that the other answers imply."""


class BadLog(ValueError):
    """A file that is no answer log, that is damaged, or that is not the log it was taken for.

    ``line`` is the number of the offending line, the first being 1; None if it is not one line's fault.
    """

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


@dataclass(frozen=True)
class Entry:
    """One answer of a log, whether comparators learn from it, and the caller's metadata. ``retraction`` is
    None while the answer stands; then the metadata of the line that took it back, and ``used`` is False."""

    answer: Answer
    used: bool = True
    metadata: Mapping[str, Any] = field(default_factory=dict)
    retraction: Mapping[str, Any] | None = None

    @property
    def retracted(self) -> bool:
        """Whether the answer was taken back."""
        return self.retraction is not None


def entries_of(log: Iterable[Entry | Answer]) -> list[Entry]:
    """The entries of a log, of some of its entries, or of Answers to queries. Raises TypeError for anything else, such
    as ``Answers``, which do not say what was shown left and right."""
    entries = [Entry(item) if isinstance(item, Answer) else item for item in log]
    for item in entries:
        if not isinstance(item, Entry):
            raise TypeError(f"a log holds entries or Answers, not {item!r}; AnswerLog.read(path) reads a file")
    return entries


class AnswerLog:
    """All answers of a run, in the order in which they were told: ``log[i]`` is an ``Entry``, ``log[i:j]`` several.

    path: the file to write; an existing log is continued. None keeps the log in memory. k: the number of levels; None
    takes it from the file, else from the first answer. header: further JSON fields for the header line, such as the
    names of the levels. Where the file has them already they must agree. Raises BadLog where the file is no log, is
    damaged before its last line, or disagrees with k or header; OSError where it cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike[str] | None = None, k: int | None = None, header: Mapping[str, Any] | None = None
    ) -> None:
        given = {"format": FORMAT, "version": VERSION, **({} if k is None else {"k": k}), **(header or {})}
        if header and not {"format", "version", "k"}.isdisjoint(header):
            raise ValueError(f"a header's format, version and k are not free fields: {dict(header)}")
        self._path = None if path is None else Path(path)
        self._header: dict[str, Any] = json.loads(_dump(given, "header"))
        self._entries: list[Entry] = []
        self._read_only = False
        self._size = self._kept = 0  # bytes in the file, and those of its whole lines
        self._joint = b""  # what the next line needs before it
        if self._path is None:
            return
        new = not self._path.exists()
        with open(self._path, "ab"):  # what cannot be written must show before the first question
            pass
        if new and os.name == "posix":  # put the name on the disk too; not every system can or needs to
            directory = os.open(self._path.parent, os.O_RDONLY)
            try:
                os.fsync(directory)
            finally:
                os.close(directory)
        self._load(self._path)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """The log in a file, for reading only; the file is not touched. Raises BadLog, FileNotFoundError."""
        log = cls()
        log._path, log._read_only = Path(path), True
        log._load(log._path)
        return log

    @property
    def k(self) -> int | None:
        """Number of levels; None as long as nothing says so."""
        return self._header.get("k")

    @property
    def header(self) -> dict[str, Any]:
        """The fields of the header line (a copy)."""
        return dict(self._header)

    def append(self, answer: Answer, used: bool = True, **metadata: Any) -> None:
        """Add an answer; when this returns it is on the disk, and when it raises nothing has changed.

        used=False records an answer that comparators are not to learn from. metadata: any JSON, such as a time. Raises
        ValueError on another number of levels or metadata that is no JSON, BadLog if someone else wrote to the file,
        OSError if writing fails.
        """
        k = len(answer.query.left)
        if self.k not in (None, k):
            raise ValueError(f"this log is about {self.k} levels, but query {answer.query.id} is about {k}")
        if not metadata.keys().isdisjoint(_FIELDS):
            raise ValueError(f"metadata may not be named like a field of the answer: {sorted(metadata)}")
        line = _dump(
            {
                "id": answer.query.id,
                "left": answer.query.left.tolist(),
                "right": answer.query.right.tolist(),
                "verdict": answer.verdict,
                "swapped": bool(answer.swapped),
                "about": answer.query.about,
                "used": bool(used),
                **metadata,
            },
            "metadata",
        )
        header = self._header if self.k is not None else {"format": FORMAT, "version": VERSION, "k": k, **self._header}
        self._put(header, line)
        self._entries.append(_entry(json.loads(line)))

    def retract(self, id: str, **metadata: Any) -> None:
        """Take back all answers so far to the query of this id, by adding a line: they stay in the log, marked, but are
        no longer among ``answers()``. metadata: any JSON, such as the reason. Raises ValueError where no answer of this
        id stands, and otherwise like ``append``."""
        if not metadata.keys().isdisjoint((*_FIELDS, _RETRACT)):
            raise ValueError(f"a retraction's metadata may not be named like a field of the log: {sorted(metadata)}")
        line = _dump({_RETRACT: id, **metadata}, "metadata")
        after = _without(self._entries, json.loads(line))
        self._put(self._header, line)
        self._entries = after

    def answers(self) -> Answers:
        """What a comparator learns from: the answers used and not taken back, without "cannot tell", in order.
        Raises ValueError for an empty log that does not know its number of levels."""
        if self.k is None:
            raise ValueError("an empty log does not know its number of levels: give k to AnswerLog")
        return Answers.of([entry.answer for entry in self._entries if entry.used], self.k)

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[Entry]:
        return iter(tuple(self._entries))

    @overload
    def __getitem__(self, rows: SupportsIndex) -> Entry: ...

    @overload
    def __getitem__(self, rows: slice) -> tuple[Entry, ...]: ...

    def __getitem__(self, rows: SupportsIndex | slice) -> Entry | tuple[Entry, ...]:
        if isinstance(rows, slice):
            return tuple(self._entries[rows])
        try:
            return self._entries[rows]
        except IndexError:
            raise IndexError(f"there is no answer {index(rows)}: the log has {len(self)}, counted from 0") from None

    def __repr__(self) -> str:
        back = sum(entry.retracted for entry in self._entries)
        parts = [f"{len(self)} answers{f', {back} of them retracted' if back else ''}", f"k={self.k}"]
        parts += [] if self._path is None else [f"path={str(self._path)!r}"]
        return f"AnswerLog({', '.join([*parts, *(['read only'] if self._read_only else [])])})"

    def _put(self, header: dict[str, Any], line: bytes) -> None:
        """A line at the end of the log, after the header if there is none in the file."""
        if self._read_only:
            raise ValueError(f"this log was opened for reading: AnswerLog({str(self._path)!r}) continues the file")
        if self._path is not None:
            first = b"" if self._kept else _dump(header, "header")
            self._write(self._path, self._joint + first + line)
        self._header, self._joint = header, b""

    def _write(self, path: Path, data: bytes) -> None:
        with open(path, "ab", buffering=0) as file:
            size = os.fstat(file.fileno()).st_size
            if size != self._size:
                raise BadLog(
                    f"{path} has {size} bytes, not the {self._size} that this log left there: something else wrote "
                    "to it. Give each run a log of its own, or open the log again to continue from what is there"
                )
            try:
                if size != self._kept:
                    file.truncate(self._kept)
                written = file.write(data)
                if written != len(data):
                    raise OSError(f"only {written} of {len(data)} bytes could be written to {path}: is the disk full?")
                os.fsync(file.fileno())
            except BaseException:
                # half a line in the middle would spoil the file for good
                file.truncate(self._kept)
                self._size = self._kept
                raise
        self._size = self._kept = self._kept + len(data)

    def _load(self, path: Path) -> None:
        data = path.read_bytes()
        *lines, last = data.split(b"\n")
        self._size = self._kept = len(data)
        if last and _is_torn(last, first=not lines):
            self._kept -= len(last)  # never acknowledged as written: the next append takes it out of the file
        elif last:
            lines.append(last)  # whole but for its end: the line feed is what the crash took
            self._joint = b"\n"
        if not lines:
            return
        self._header = _checked_header(lines[0], self._header, path)
        for number, line in enumerate(lines[1:], start=2):
            try:
                fields = json.loads(line)
                if isinstance(fields, dict) and _RETRACT in fields and fields.keys().isdisjoint(_FIELDS):
                    self._entries = _without(self._entries, fields)
                    continue
                entry = _entry(fields)
            except (ValueError, TypeError, KeyError, AttributeError) as error:
                text = line[:60].decode("utf-8", "replace")
                why = f"it has no field {error}" if isinstance(error, KeyError) else str(error)
                damage = f"line {number} of {path} is damaged ({why}): {text!r}. Correct or delete that line"
                raise BadLog(damage, number) from None
            if (found := len(entry.answer.query.left)) != self.k:
                about = f"line {number} of {path} is about {found} levels"
                raise BadLog(f"{about}, but its header says k = {self.k}", number)
            self._entries.append(entry)


def _dump(fields: Mapping[str, Any], what: str) -> bytes:
    """One line of JSON; Python writes floats so that they read back to the last bit."""
    try:
        return (json.dumps(fields, allow_nan=False) + "\n").encode("ascii")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must be plain JSON: {error}") from None


def _entry(fields: Any) -> Entry:
    """The entry in one parsed line. Raises ValueError, TypeError or KeyError."""
    if not isinstance(fields, dict):
        raise ValueError("it is no JSON object")
    for name, kind in (("id", str), ("about", str), ("swapped", bool), ("used", bool)):
        if not isinstance(fields[name], kind):
            raise ValueError(f"its {name} is {fields[name]!r}")
    verdict = fields["verdict"]
    if verdict is not None and (type(verdict) is not int or verdict not in (-1, 0, 1)):
        raise ValueError(f"its verdict is {verdict!r}, not -1, 0, 1 or null")
    query = Query(fields["id"], fields["left"], fields["right"], fields["about"])
    answer = Answer(query, None if verdict is None else Verdict(verdict), fields["swapped"])
    return Entry(answer, fields["used"], {name: fields[name] for name in fields if name not in _FIELDS})


def _without(entries: list[Entry], fields: dict[str, Any]) -> list[Entry]:
    """The entries after a parsed retraction line. Raises ValueError where it takes back nothing."""
    name = fields[_RETRACT]
    told = {key: fields[key] for key in fields if key != _RETRACT}
    mine = {i: entry for i, entry in enumerate(entries) if entry.answer.query.id == name}
    if all(entry.retracted for entry in mine.values()):
        why = "was retracted already, and none was given since" if mine else "cannot be retracted: this log has none"
        raise ValueError(f"the answer with the id {name!r} {why}")
    back = {i: replace(entry, used=False, retraction=told) for i, entry in mine.items() if not entry.retracted}
    return [back.get(i, entry) for i, entry in enumerate(entries)]


def _is_torn(line: bytes, first: bool) -> bool:
    """Whether an unfinished last line is what a crash leaves. No proper beginning of a JSON object is JSON."""
    try:
        json.loads(line)
    except ValueError:
        text = line.decode("utf-8", "replace")
        return not first or text.startswith(_START) or _START.startswith(text)
    return False


def _checked_header(line: bytes, wanted: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """The header of a file, if it is one of a log that can be continued as wanted."""
    header = None
    with suppress(ValueError):
        header = json.loads(line)
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        text = line[:60].decode("utf-8", "replace")
        raise BadLog(f"{path} is no answer log: its first line is {text!r}, not {_START}, ...}}", 1)
    if header.get("version") != VERSION:
        raise BadLog(f"{path} is of version {header.get('version')!r}; this program reads version {VERSION}", 1)
    if type(header.get("k")) is not int or header["k"] < 2:
        raise BadLog(f"the header of {path} gives k = {header.get('k')!r}, not a number of levels", 1)
    for name, value in wanted.items():
        if name in header and header[name] != value:
            other = f"{path} is another log: its header says {name} = {header[name]!r}, not {value!r}"
            raise BadLog(f"{other}. Choose another file, or open it as what it is", 1)
    return header
