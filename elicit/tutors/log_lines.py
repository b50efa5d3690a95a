"""The text of an answer log: JSON lines, each ending in a checksum that chains it to the line before.

So a bit that flips, a line that is edited, left out or moved is noticed when the log is read; not so whole lines that
are missing at the end. A checksum is against accidents: whoever means to forge a log can compute it.
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
SEALED = "sealed"
"""The event after which the lines of a log of version 1 have checksums. Its own one is over all that is before it."""

_START = f'{{"format": "{FORMAT}"'
_SEAL = f'{{"{EVENT}": "{SEALED}"'.encode()
_DIGITS = 16
_END = len(f', "{CHECK}": "{"0" * _DIGITS}"}}')


class BadLog(ValueError):
    """A file that is no answer log, that is damaged, or that is not the log it was taken for.

    ``line`` is the number of the offending line, the first being 1; None if it is not one line's fault.
    """

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


def json_of(fields: Mapping[str, Any], what: str) -> bytes:
    """One line of JSON, without its end; Python writes floats so that they read back to the last bit. Raises
    ValueError where ``what`` is no JSON."""
    try:
        return json.dumps(fields, allow_nan=False).encode("ascii")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must be plain JSON: {error}") from None


def with_check(text: bytes, before: str) -> tuple[bytes, str]:
    """A line of this JSON object after a line with the checksum ``before``, and its own checksum."""
    body = text[:-1]
    check = _digest(before.encode("latin-1") + body)
    return body + f', "{CHECK}": "{check}"}}\n'.encode("ascii"), check


def sealed(text: bytes) -> tuple[bytes, str]:
    """The line that seals a log of version 1 with this content, and its checksum."""
    return with_check(json_of({EVENT: SEALED, "version": VERSION}, "a seal"), _digest(text))


@dataclass
class Lines:
    """What a file holds. ``lines``: number, whether it has a checksum, and the fields, of all lines after the header
    (of seals none). ``kept``: bytes of whole lines; ``joint``: what the next line needs before it; ``check``: the
    checksum of the last line, None where it has none; ``header``: None in an empty file."""

    header: dict[str, Any] | None = None
    lines: list[tuple[int, bool, Any]] = field(default_factory=list)
    kept: int = 0
    joint: bytes = b""
    check: str | None = ""


def parse(data: bytes, path: Path, faults: list[BadLog]) -> Lines:
    """The lines of a file. What is wrong with one is added to ``faults``, and it is left out; a last line that was
    never finished is no fault. Raises BadLog where the header is none."""
    *lines, last = data.split(b"\n")
    found = Lines(kept=len(data))
    if last and _is_torn(last, first=not lines):
        found.kept -= len(last)  # never acknowledged as written: the next append takes it out of the file
    elif last:
        lines.append(last)  # whole but for its end: the line feed is what the crash took
        found.joint = b"\n"
    if not lines:
        return found
    found.header, checks = _header(lines[0], path)
    place = 0
    for number, line in enumerate(lines, start=1):
        start, place = place, place + len(line) + 1
        if number == 1:
            continue
        seals = not checks and line.startswith(_SEAL)
        if seals:
            checks = {_digest(data[:start])}
        try:
            fits = True
            if checks:
                fits, checks = _follow(line, checks)
            fields = json.loads(line)
        except ValueError as error:
            faults.append(damage(path, number, line, str(error)))
            continue
        if not checks and isinstance(fields, dict) and {EVENT, CHECK} <= fields.keys():
            fits, checks = False, {_stated(line)}
        if not fits:
            what = "some line up to it was changed" if seals else "it was changed, or a line before it is missing"
            faults.append(damage(path, number, line, f"its checksum does not fit: {what}"))
        elif not seals:
            if checks:
                del fields[CHECK]
            found.lines.append((number, bool(checks), fields))
    found.check = next(iter(checks), None)
    return found


def damage(path: Path, number: int, line: bytes, why: str) -> BadLog:
    """The error for a line that is damaged."""
    text = line[:60].decode("utf-8", "replace")
    return BadLog(
        f"line {number} of {path} is damaged ({why}): {text!r}. Take a copy of the file from before; or keep what is "
        f"whole: qlearn log merge --salvage --out NEW {path}",
        number,
    )


def _follow(line: bytes, before: set[str]) -> tuple[bool, set[str]]:
    """Whether a line fits to one of the checksums before it, and the checksums that the next line may chain to: its
    own; of a damaged line that which it should have, and that which stands there."""
    own = {check: with_check(line[:-_END] + b"}", check) for check in sorted(before)}
    for text, check in own.values():
        if text[:-1] == line:
            return True, {check}
    return False, {check for _, check in own.values()} | {_stated(line)}


def _stated(line: bytes) -> str:
    """What stands where a line has its checksum."""
    return line[-_DIGITS - 2 : -2].decode("latin-1")


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=_DIGITS // 2).hexdigest()


def _is_torn(line: bytes, first: bool) -> bool:
    """Whether an unfinished last line is what a crash leaves. No proper beginning of a JSON object holds a whole one:
    where there is one, what follows it was a line feed once."""
    text = line.decode("utf-8", "replace")
    with suppress(ValueError):
        if isinstance(json.JSONDecoder().raw_decode(text)[0], dict):
            return False
    return not first or text.startswith(_START) or _START.startswith(text)


def _header(line: bytes, path: Path) -> tuple[dict[str, Any], set[str]]:
    """The header of a file, and its checksum, if its version has one."""
    header = None
    with suppress(ValueError):
        header = json.loads(line)
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        text = line[:60].decode("utf-8", "replace")
        raise BadLog(f"{path} is no answer log: its first line is {text!r}, not {_START}, ...}}", 1)
    if type(header.get("version")) is not int or header["version"] not in (1, VERSION):
        reads = f"this program reads versions 1 and {VERSION}"
        raise BadLog(f"{path} is of version {header.get('version')!r}; {reads}", 1)
    checks: set[str] = set()
    if header["version"] == VERSION:
        fits, checks = _follow(line, {""})
        if not fits:
            raise damage(path, 1, line, "its checksum does not fit: it was changed")
        del header[CHECK]
    if type(header.get("k")) is not int or header["k"] < 2:
        raise BadLog(f"the header of {path} gives k = {header.get('k')!r}, not a number of levels", 1)
    return header, checks
