"""Finished rows on disk, where no way of ending a process can lose them."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

if sys.platform != "win32":
    import fcntl

__all__ = ["Journal"]

_AS_IS = getattr(os, "O_BINARY", 0)  # Windows would write other ends of lines
_START = b'{"key": "'


class Journal:
    """Finished rows on disk: a line of JSON a row, on the disk before anything else happens, so that a kill -9 at any
    moment loses none of them.

    ``rows`` maps keys to rows. A last line that was cut short is removed: its row has not finished. One process at
    a time: a journal that another process has open raises BlockingIOError. (Where the system has no file locks two
    processes append whole lines of equal rows, and only time is lost.) A file that is no journal raises ValueError,
    and is not touched; ``fresh`` empties one that is.
    """

    def __init__(self, path: Path, *, fresh: bool = False) -> None:
        self.rows: dict[str, Any] = {}
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | _AS_IS, 0o666)
        try:
            _lock(self._file, path)
            text = path.read_bytes()
            if not text.startswith(_START[: len(text)]):
                raise ValueError(f"{path} is no journal, it begins {text[:40]!r}: move it away, or name another file")
            if fresh:
                text = b""
            whole = text.rfind(b"\n") + 1
            for number, line in enumerate(text[:whole].splitlines(), start=1):
                try:
                    entry = json.loads(line)
                    self.rows[entry["key"]] = entry["row"]
                except (ValueError, TypeError, KeyError):
                    found = f"line {number} of {path} is no finished row but {line[:40]!r}"
                    raise ValueError(f"{found}: move the file away, or start over (fresh)") from None
            os.ftruncate(self._file, whole)
        except BaseException:
            self.close()
            raise

    def append(self, key: str, text: str) -> None:
        """Keep a row, given as JSON on one line."""
        line = _START + f'{key}", "row": {text}}}\n'.encode()
        if os.write(self._file, line) != len(line):
            raise OSError("a row could not be written to the journal whole: is the disk full?")
        os.fsync(self._file)

    def close(self) -> None:
        """Let other processes have it."""
        os.close(self._file)


def _lock(file: int, path: Path) -> None:
    """Hold the file until it is closed, or the process is gone."""
    if sys.platform != "win32":
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BlockingIOError(f"another process is writing to {path}: wait for it, or take another place") from None
        except OSError:  # a file system without locks
            pass
