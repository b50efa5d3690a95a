"""The file of an answer log: JSON lines, each ending in a checksum, and one writer at a time.

What was appended is on the disk. The checksum of a line covers the checksum of the line before. So
reading notices a changed bit, and a line that was edited, removed or moved. It does not notice if
whole lines are missing at the end. Checksums are against accidents: a forger can compute them too.
"""

import hashlib
import json
import os
import stat
import sys
import weakref
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

FORMAT = "elicit answers"
VERSION = 2
EVENT = "event"
CHECK = "check"

_START = f'{{"format": "{FORMAT}"'
_DIGITS = 16
_END = len(f', "{CHECK}": "{"0" * _DIGITS}"}}')
_FAR = 1 << 30  # where Windows locks a byte: there nobody reads, whom it would keep from it


class BadLog(ValueError):
    """Error for a file that is no answer log, is damaged, or is not the log that was expected.

    Parameters
    ----------
    message : str
        The sentence.
    line : int, optional
        The number of the bad line, counted from 1. None: no single line is bad.
    """

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


def json_of(fields: Mapping[str, Any], what: str) -> bytes:
    """Return a line of JSON, as bytes without a line feed.

    Python writes floats so that reading gives the same number to the last bit. Raises ValueError,
    which names ``what``, if the fields cannot be JSON.
    """
    try:
        return json.dumps(fields, allow_nan=False).encode("ascii")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must be plain JSON: {error}") from None


def with_check(text: bytes, before: str) -> tuple[bytes, str]:
    """Return the line of a JSON object with its checksum, and the checksum.

    ``before`` is the checksum of the line before.
    """
    body = text[:-1]
    check = _digest(before.encode("latin-1") + body)
    return body + f', "{CHECK}": "{check}"}}\n'.encode("ascii"), check


@dataclass
class Lines:
    """The content of a log file, as far as it can be trusted.

    Attributes
    ----------
    header : dict or None
        The header's fields; None in an empty file.
    lines : list of (int, dict)
        The number and the fields of each line after the header, up to any damage.
    kept : int
        Number of bytes in whole lines.
    joint : bytes
        Bytes to write before the next line.
    check : str
        The checksum of the last line.
    damage : BadLog or None
        The error for the first line whose checksum is wrong, if there is one.
    """

    header: dict[str, Any] | None = None
    lines: list[tuple[int, dict[str, Any]]] = field(default_factory=list)
    kept: int = 0
    joint: bytes = b""
    check: str = ""
    damage: BadLog | None = None


def parse(data: bytes, path: Path) -> Lines:
    """Return the lines of a file, up to the first damaged one.

    An unfinished last line, which a crash leaves, is no damage. Raises BadLog if the first line is
    no header.
    """
    *lines, last = data.split(b"\n")
    found = Lines(kept=len(data))
    if last and _is_torn(last, first=not lines):
        found.kept -= len(
            last
        )  # never acknowledged as written: the next append takes it out of the file
    elif last:
        lines.append(last)  # whole, except that the crash took its line feed
        found.joint = b"\n"
    if not lines:
        return found
    found.header, found.check = _header(lines[0], path)
    for number, line in enumerate(lines[1:], start=2):
        check = _check_after(line, found.check)
        try:
            fields = json.loads(line)
            wrong = (
                "its checksum does not fit: it was changed, or a line before it is missing"
                if check is None
                else ""
            )
        except ValueError as error:
            wrong = str(error)
        if wrong or check is None:
            found.damage = damage(
                path, number, line, wrong, f"or save the {len(found.lines)} events before it"
            )
            break
        del fields[CHECK]
        found.lines.append((number, fields))
        found.check = check
    return found


def damage(
    path: Path, number: int, line: bytes, why: str, advice: str = "or keep what is whole"
) -> BadLog:
    """Return the error for a damaged line. ``advice`` says what ``--salvage`` does."""
    text = line[:60].decode("utf-8", "replace")
    return BadLog(
        f"line {number} of {path} is damaged ({why}): {text!r}. Take a copy of the file from "
        f"before; {advice}: "
        f"qlearn log merge --salvage --out NEW {path}",
        number,
    )


def _check_after(line: bytes, before: str) -> str | None:
    """Return a line's checksum if it is right for a line after ``before``, else None."""
    text, check = with_check(line[:-_END] + b"}", before)
    return check if text[:-1] == line else None


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=_DIGITS // 2).hexdigest()


def _is_torn(line: bytes, first: bool) -> bool:
    """Return whether a file's last line is one that a crash left unfinished.

    Such a line is the beginning of a JSON object. A line that contains a whole object is not: it
    was complete, and has lost its line feed since.
    """
    text = line.decode("utf-8", "replace")
    with suppress(ValueError):
        if isinstance(json.JSONDecoder().raw_decode(text)[0], dict):
            return False
    return not first or text.startswith(_START) or _START.startswith(text)


def _header(line: bytes, path: Path) -> tuple[dict[str, Any], str]:
    """Return the header of a file, and its checksum. Raises BadLog."""
    header = None
    with suppress(ValueError):
        header = json.loads(line)
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        text = line[:60].decode("utf-8", "replace")
        raise BadLog(f"{path} is no answer log: its first line is {text!r}, not {_START}, ...}}", 1)
    version = header.get("version")
    if type(version) is not int or version != VERSION:
        why = ", which no release has written" if version == 1 and type(version) is int else ""
        raise BadLog(
            f"{path} is a log of version {version!r}{why}: this program reads version {VERSION}", 1
        )
    check = _check_after(line, "")
    if check is None:
        text = line[:60].decode("utf-8", "replace")
        raise BadLog(
            f"line 1 of {path} is damaged (its checksum does not fit: it was changed): {text!r}. "
            "Take a copy of the "
            "file from before",
            1,
        )
    del header[CHECK]
    if type(header.get("k")) is not int or header["k"] < 2:
        raise BadLog(
            f"the header of {path} gives k = {header.get('k')!r}, not a number of levels", 1
        )
    return header, check


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file.

    Raises BadLog for any other file, FileNotFoundError and other OSErrors.
    """
    check_regular(path, path.stat().st_mode)
    return path.read_bytes()


def check_regular(path: Path, mode: int) -> None:
    """Raise BadLog for a directory, a device, a pipe or a socket."""
    if not stat.S_ISREG(mode):
        kinds = {stat.S_IFDIR: "a directory", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
        kind = kinds.get(stat.S_IFMT(mode), "a device")
        raise BadLog(
            f"{path} is {kind}: an answer log is a regular file. Name a file that exists, or a new "
            "one"
        )


class LogFile:
    """A regular file, open for appending, and locked.

    The lock ends when the object is closed or deleted, or the process ends. A new file can be read
    by its owner only.

    Raises BadLog for any other file. Raises BlockingIOError, with the process's number if known, if
    another process has the lock, and OSError if the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        with suppress(FileNotFoundError):
            check_regular(
                path, path.stat().st_mode
            )  # before opening: to open a pipe can wait for ever
        new = not path.exists()
        self._path = path
        self._file: BinaryIO = open(path, "a+b", buffering=0, opener=_open_private)  # noqa: SIM115
        self.close = weakref.finalize(self, self._file.close)
        """Close the file, and release its lock."""
        try:
            check_regular(path, os.fstat(self._file.fileno()).st_mode)
            _lock(self._file, path)
        except BaseException:
            self.close()
            raise
        self._file.seek(0)
        self.content = self._file.read()
        """The file's content when it was opened."""
        self._size = self._kept = len(
            self.content
        )  # bytes in the file, and those of its whole lines
        if (
            new and os.name == "posix"
        ):  # put the name on the disk too; not every system can or needs to
            directory = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(directory)
            finally:
                os.close(directory)

    def keep(self, size: int) -> None:
        """Set the number of bytes that are whole lines; the next append removes what follows."""
        self._kept = size

    @property
    def kept(self) -> int:
        """The number of bytes that are whole lines."""
        return self._kept

    def append(self, data: bytes) -> None:
        """Add bytes to the end. When this returns, they are on the disk.

        If it raises, the file ends where it did before. Raises ValueError if the file was closed,
        BadLog if another program wrote to it, and OSError if writing fails.
        """
        if self._file.closed:
            raise ValueError(f"the log {self._path} was closed: open it again to go on")
        self._check_mine()
        try:
            if self._size != self._kept:
                self._file.truncate(self._kept)
            written = self._file.write(data)
            if written != len(data):
                raise OSError(
                    f"only {written} of {len(data)} bytes could be written to {self._path}: is the "
                    "disk full?"
                )
            os.fsync(self._file.fileno())
            self._size = self._kept = self._kept + len(data)
        except BaseException:
            # half a line in the middle would spoil the file for good; if it cannot be removed now,
            # the next append removes it
            with suppress(OSError):
                self._file.truncate(self._kept)
            self._size = os.fstat(self._file.fileno()).st_size
            raise

    def _check_mine(self) -> None:
        """Raise BadLog if another program has changed the file since the last append.

        Not every program asks for the lock.
        """
        mine = os.fstat(self._file.fileno())
        try:
            same = os.path.samestat(mine, self._path.stat())
        except FileNotFoundError:
            same = False
        if not same:
            raise BadLog(
                f"{self._path} was moved, deleted or replaced while this log was open: what is "
                "appended now would be "
                "lost. Open the log again to continue from what is there"
            )
        if mine.st_size != self._size:
            raise BadLog(
                f"{self._path} has {mine.st_size} bytes, not the {self._size} that this log left "
                "there: something else "
                "wrote to it. Give each run a log of its own, or open the log again to continue "
                "from what is there"
            )


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def _lock(file: BinaryIO, path: Path) -> None:
    """Lock the file until it is closed or the process ends.

    Some file systems have no locks. There each append still notices if another process wrote.
    """
    try:
        if sys.platform == "win32":
            file.seek(_FAR)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):  # the latter is how Windows says it
        raise BlockingIOError(
            f"{path} is being written to by {_holder(file)}: a log has one writer at a time. End "
            "that one, or give "
            "this one a log of its own; AnswerLog.read and qlearn log show read it meanwhile"
        ) from None
    except OSError:
        pass


def _holder(file: BinaryIO) -> str:
    """Return the number of the process that holds the lock, as text, if the system tells it.

    Linux does.
    """
    inode = str(os.fstat(file.fileno()).st_ino)
    with suppress(OSError):
        for line in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            # such as "1: FLOCK  ADVISORY  WRITE 1234 08:01:5678 0 EOF"; a process that waits has
            # "->" before FLOCK
            fields = line.split()
            if fields[1] == "FLOCK" and fields[5].split(":")[-1] == inode:
                mine = int(fields[4]) == os.getpid()
                return (
                    "another AnswerLog of this program, not closed yet"
                    if mine
                    else f"process {fields[4]}"
                )
    return "another program"
