"""The text of an answer log: JSON lines, each ending in a checksum that chains it to the line
before.

So a bit that flips, a line that is edited, left out or moved is noticed when the log is read; not
so whole lines that are missing at the end. A checksum is against accidents: whoever means to forge
a log can compute it.
"""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FORMAT = "elicit answers"
VERSION = 2
EVENT = "event"
CHECK = "check"

_START = f'{{"format": "{FORMAT}"'
_DIGITS = 16
_END = len(f', "{CHECK}": "{"0" * _DIGITS}"}}')


class BadLog(ValueError):
    """A file that is no answer log, that is damaged, or that is not the log it was taken for.

    ``line`` is the number of the offending line, the first being 1; None if it is not one line's
    fault.
    """

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


def json_of(fields: Mapping[str, Any], what: str) -> bytes:
    """One line of JSON, without its end; Python writes floats so that they read back to the last
    bit. Raises ValueError where ``what`` is no JSON."""
    try:
        return json.dumps(fields, allow_nan=False).encode("ascii")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must be plain JSON: {error}") from None


def with_check(text: bytes, before: str) -> tuple[bytes, str]:
    """A line of this JSON object after a line with the checksum ``before``, and its own
    checksum.
    """
    body = text[:-1]
    check = _digest(before.encode("latin-1") + body)
    return body + f', "{CHECK}": "{check}"}}\n'.encode("ascii"), check


@dataclass
class Lines:
    """The content of a file.

    header: None in an empty file. lines: the number and the fields of each line after the header.
    kept: bytes of whole lines. joint: bytes that the next line needs before it. check: the checksum
    of the last line. damage: the error for the first line that does not follow from the one before;
    then ``lines`` are those before it.
    """

    header: dict[str, Any] | None = None
    lines: list[tuple[int, dict[str, Any]]] = field(default_factory=list)
    kept: int = 0
    joint: bytes = b""
    check: str = ""
    damage: BadLog | None = None


def parse(data: bytes, path: Path) -> Lines:
    """Return the lines of a file, up to the first damaged one. A last line that was never finished
    is no damage.

    Raises BadLog where the header is none.
    """
    *lines, last = data.split(b"\n")
    found = Lines(kept=len(data))
    if last and _is_torn(last, first=not lines):
        found.kept -= len(
            last
        )  # never acknowledged as written: the next append takes it out of the file
    elif last:
        lines.append(last)  # whole but for its end: the line feed is what the crash took
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
    """Return the error for a line that is damaged. The advice is what ``--salvage`` does."""
    text = line[:60].decode("utf-8", "replace")
    return BadLog(
        f"line {number} of {path} is damaged ({why}): {text!r}. Take a copy of the file from "
        f"before; {advice}: "
        f"qlearn log merge --salvage --out NEW {path}",
        number,
    )


def _check_after(line: bytes, before: str) -> str | None:
    """Return a line's checksum if it is the one that has to stand there after the checksum
    ``before``, else None.
    """
    text, check = with_check(line[:-_END] + b"}", before)
    return check if text[:-1] == line else None


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=_DIGITS // 2).hexdigest()


def _is_torn(line: bytes, first: bool) -> bool:
    """Whether an unfinished last line is what a crash leaves. No proper beginning of a JSON object
    holds a whole one: where there is one, what follows it was a line feed once."""
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
