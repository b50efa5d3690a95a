"""Errors of the file system say what happened, with which path, and what to do."""

import errno
import os
from pathlib import Path

import pytest

from elicit._support.file_errors import in_words


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("none.csv", "there is no file {}: check the name, and the folder that you are in"),
        ("no/none.csv", "there is no folder {} for none.csv: check the path"),
        ("here.txt/none.csv", "a part of the path {} is a file, not a folder"),
        (".", "{} is a folder: name a file"),
    ],
)
def test_a_file_that_cannot_be_read(path: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "here.txt").touch()
    whole = tmp_path / path
    with pytest.raises(OSError, match="Errno") as raised:
        whole.read_text()
    named = whole.parent if path == "no/none.csv" else whole
    assert in_words(raised.value).startswith(said.format(named))
    assert "Errno" not in in_words(raised.value)


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.EACCES, "log.jsonl may not be read or written by you: change its permissions"),
        (errno.EEXIST, "log.jsonl exists already: name another one"),
        (errno.ENOSPC, "log.jsonl cannot be written, for the disk is full: free some space"),
        (errno.EIO, "log.jsonl cannot be read or written (Input/output error): name another file"),
    ],
)
def test_other_errors_name_the_path(number: int, said: str) -> None:
    assert in_words(OSError(number, os.strerror(number), "log.jsonl")).startswith(said)
    assert in_words(OSError(number, os.strerror(number))) == os.strerror(number)


def test_what_says_it_already_stays() -> None:
    assert in_words(BlockingIOError("log.jsonl is in use")) == "log.jsonl is in use"
    assert in_words(ValueError("no")) == "no"
