"""The file of an answer log: one writer at a time, and what was appended is on the disk."""

import os
import stat
import sys
import weakref
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from elicit.tutors.log_lines import BadLog

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

_FAR = 1 << 30  # where Windows locks a byte: there nobody reads, whom it would keep from it


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

    The lock ends when it is closed (or let go of, or the process ends). A new file can be read by
    its owner only.

    Raises BadLog for any other file; BlockingIOError, which names the process if it can, where
    another one has the lock; OSError where the file cannot be written.
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
        """Give the file and its lock free."""
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
        """Note how many bytes are whole lines; the next append removes what is behind them."""
        self._kept = size

    @property
    def kept(self) -> int:
        """Bytes of whole lines."""
        return self._kept

    def append(self, data: bytes) -> None:
        """Add to the end; when this returns it is on the disk.

        When it raises, the file ends where it did. Raises ValueError if it was closed, BadLog if
        someone else wrote to it, OSError if writing fails.
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
            # half a line in the middle would spoil the file for good; what cannot be taken out now
            # goes next time
            with suppress(OSError):
                self._file.truncate(self._kept)
            self._size = os.fstat(self._file.fileno()).st_size
            raise

    def _check_mine(self) -> None:
        """Raise BadLog if the file is not as it was left.

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
    """Hold the file until it is closed, or the process is gone.

    On a file system without locks each append still notices that another one came between.
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
    """Return who has the lock, if the system tells (Linux)."""
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
