"""The command ``qlearn log``: show, check, merge and export answer logs."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qlearn.cli.options import fail

if TYPE_CHECKING:
    from elicit.tutors.answer_log import AnswerLog, Entry
    from elicit.tutors.log_file import BadLog


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser's subcommands."""
    command = commands.add_parser(
        "log",
        help="show, check, merge and export logs of answers",
        description="Logs of answers, as elicit.AnswerLog and elicit.Session write them. A log "
        "that is being written "
        "can be shown, checked and exported meanwhile. The exit code is 1 where a log is damaged, "
        "or none.",
    )
    todo = command.add_subparsers(title="what to do", required=True, metavar="WHAT")
    for name, run, text in (
        ("show", show, "a table of the answers, for people"),
        ("check", check, "say whether a log is whole, or which lines are damaged"),
        ("merge", merge, "several logs of one problem as one new log"),
        (
            "export",
            export,
            "what a comparator learns from, as CSV: id, d_1, ..., d_k (left - right), answer",
        ),
    ):
        one = todo.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        one.set_defaults(command=run)
        one.add_argument("files", nargs="+", type=Path, metavar="FILE", help="a log")
        if name == "merge":
            one.add_argument(
                "--out",
                type=Path,
                required=True,
                metavar="NEW",
                help="the file to write; a new one",
            )
            one.add_argument(
                "--salvage",
                action="store_true",
                help="of a damaged log, write what stands before the damage",
            )
        if name == "export":
            one.add_argument(
                "--out", type=Path, metavar="CSV", help="the file to write [standard output]"
            )


def show(files: list[Path]) -> int:
    """Print the answers of each log, and return the exit code."""
    from elicit.person.course.counts import Counts, numbered

    code = 0
    for path in files:
        log, faults = _read(path)
        code |= _complain(faults)
        if log is None:
            continue
        fields = ", ".join(
            f"{name}: {value}"
            for name, value in log.header.items()
            if name not in ("format", "version")
        )
        print(f"{path} ({fields or 'empty'})")
        rows: list[tuple[str, ...]] = [
            ("", "time", "who", "question", "answer", "seconds", "about")
        ]
        shown = {asked.query.id: asked.metadata.get("shown") for asked in log.asked}
        labels = log.header.get("labels")
        rows += [
            _row(number, entry, shown.get(entry.answer.query.id), labels)
            for number, entry in numbered(log)
        ]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            print(
                "  ".join(
                    cell.ljust(width) for cell, width in zip(row, widths, strict=True)
                ).rstrip()
            )
        print(Counts.of(log).sentence)
    return code


def check(files: list[Path]) -> int:
    """Print whether each log is undamaged, and return the exit code."""
    from elicit.person.course.counts import Counts

    code = 0
    for path in files:
        log, faults = _read(path)
        code |= _complain(faults)
        if log is not None and not faults:
            print(f"{path}: whole; {Counts.of(log).sentence}")
    return code


def merge(files: list[Path], out: Path, salvage: bool) -> int:
    """Merge several logs into one, and return the exit code."""
    from elicit.tutors.merge_logs import merge_logs

    found = [_read(path) for path in files]
    faults = [fault for _, some in found for fault in some]
    code = _complain(faults)
    logs = [log for log, _ in found if log is not None]
    if faults and (not salvage or len(logs) < len(files)):
        return fail(f"nothing was written to {out}")
    try:
        merge_logs(logs, out)
    except (ValueError, OSError) as error:
        return fail(error)
    print(f"written to {out}: {sum(map(len, logs))} answers of {len(logs)} logs", end="")
    print(
        "; what stood behind the damage is not among them, also where it took back an answer"
        if faults
        else ""
    )
    return code


def export(files: list[Path], out: Path | None) -> int:
    """Write the answers of all logs as CSV, and return the exit code."""
    found = [_read(path) for path in files]
    if code := _complain([fault for _, faults in found for fault in faults]):
        return code
    answers = None
    try:
        for log, _ in found:
            if log is not None:
                answers = log.answers() if answers is None else answers + log.answers()
        if answers is not None:
            answers.to_csv(sys.stdout if out is None else out)
    except (ValueError, OSError) as error:
        return fail(error)
    return 0


def _read(path: Path) -> tuple[AnswerLog | None, list[BadLog | OSError]]:
    """Return the log in a file up to any damage, and the errors found.

    The log is None if the file is no log.
    """
    from elicit.tutors.answer_log import AnswerLog
    from elicit.tutors.log_file import BadLog

    faults: list[BadLog] = []
    try:
        return AnswerLog.read(path, faults), [*faults]
    except (BadLog, OSError) as error:
        return None, [error]


def _complain(faults: list[BadLog | OSError]) -> int:
    code = 0
    for fault in faults:
        code = fail(fault)
    return code


def _row(
    number: int, entry: Entry, put: Mapping[str, Any] | None, labels: Sequence[str] | None
) -> tuple[str, ...]:
    """Return an answer as cells of a table, in the words of the screen if the log has them."""
    from elicit.person.course.counts import status_of

    verdict = entry.answer.verdict
    sides, about = {1: "left", -1: "right"}, " ".join(entry.answer.query.about.split())
    shown = " (shown right to left)" if entry.answer.swapped else ""
    if put is not None and labels is not None:
        sides = {1: "B", -1: "A"} if entry.answer.swapped else {1: "A", -1: "B"}
        about = "; ".join(f"{side.upper()}: {_counted(put[side], labels)}" for side in "ab")
        about, shown = f"{about} (of {put['of']} {put['unit']})", ""
    word = "cannot tell" if verdict is None else {0: "equal", **sides}[int(verdict)]
    status = status_of(entry)
    told = {"ignored": ", unused", "taken back": ", taken back", "not kept": ", not kept"}
    state = (", repeat" if entry.repeat else "") + told.get(status, "")
    said = {
        name: str(entry.metadata[name])
        for name in ("time", "who", "latency")
        if name in entry.metadata
    }
    time, who, latency = (said.get(name, "") for name in ("time", "who", "latency"))
    query = entry.answer.query
    return (
        str(number),
        time,
        who,
        query.id,
        word + shown + state,
        latency,
        about,
    )


def _counted(counts: Sequence[int], labels: Sequence[str]) -> str:
    """Return counts (k,) of outcomes in words, best level first."""
    named = [f"{n} {label}" for n, label in zip(counts, labels, strict=True) if n]
    return " and ".join(reversed(named))
