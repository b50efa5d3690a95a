"""Errors of the file system as sentences: what happened, with which path, and what to do."""

from __future__ import annotations

import errno
import os
from pathlib import Path

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)


def in_words(error: BaseException) -> str:
    """Return the message of an error; for an error of the file system, as a plain sentence.

    Parameters
    ----------
    error : BaseException

    Returns
    -------
    str
        ``str(error)`` if the error is not one of the file system.

    Examples
    --------
    >>> in_words(FileNotFoundError(2, "No such file or directory", "no/such/folder/answers.jsonl"))
    'there is no folder no/such/folder for answers.jsonl: check the path, or make the folder first'
    """
    if not isinstance(error, OSError) or error.errno is None:
        return str(error)
    why = error.strerror or str(error)
    if error.filename is None:
        return why
    name = os.fsdecode(error.filename) if not isinstance(error.filename, int) else error.filename
    path = Path(str(name))
    if isinstance(error, FileNotFoundError):
        if not path.parent.is_dir():
            return (
                f"there is no folder {path.parent} for {path.name}: check the path, or make the "
                "folder first"
            )
        return f"there is no file {path}: check the name, and the folder that you are in"
    if isinstance(error, NotADirectoryError):
        return f"a part of the path {path} is a file, not a folder: check the path"
    if isinstance(error, IsADirectoryError):
        return f"{path} is a folder: name a file"
    if isinstance(error, FileExistsError):
        return f"{path} exists already: name another one"
    if isinstance(error, PermissionError):
        return f"{path} may not be read or written by you: change its permissions, or name another"
    if error.errno in _NO_ROOM:
        return f"{path} cannot be written, for the disk is full: free some space, and try again"
    return f"{path} cannot be read or written ({why}): name another file"
