"""A session in the terminal: questions as plain text, answers as lines."""

from __future__ import annotations

import io
import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import Any, Literal

from elicit.person.findings import ScaleRow
from elicit.person.interview import Interview, Subject
from elicit.person.session import Session
from elicit.person.showing import NARROWEST, Choice, printable
from elicit.tutors.log_lines import BadLog
from qlearn.cli.options import fail

_Key = Choice | Literal["undo", "why", "quit"]
_MEANS: dict[str, _Key] = {
    **dict.fromkeys(("a", "left", "1"), "a"),
    **dict.fromkeys(("b", "right", "2"), "b"),
    **dict.fromkeys(("e", "=", "equal", "same"), "equal"),
    **dict.fromkeys(("?", "cannot tell", "unknown"), "cannot tell"),
    **dict.fromkeys(("u", "undo"), "undo"),
    **dict.fromkeys(("w", "why"), "why"),
    **dict.fromkeys(("q", "quit", "exit"), "quit"),
}
_KEYS = "a or b: that one; e: equal; ?: cannot tell; u: undo; w: why; q: quit"
_KEYS_AT_THE_END = "Enter: what was learned; u: undo; q: quit"
_WIDEST = 100
_BAR = 40  # columns of an interval, at most
_LEAST_BAR = 10


class Terminal:
    """A session with the person at standard input. again: the command that goes on."""

    def __init__(self, session: Session, subject: Subject, again: str) -> None:
        self._interview, self._log, self._again = Interview(session, subject), session.log, again
        self._finer = subject.finer
        self._width = min(max(shutil.get_terminal_size().columns, NARROWEST), _WIDEST)
        for stream in (
            sys.stdin,
            sys.stdout,
        ):  # a name that the terminal cannot write, or a key that is no letter
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")

    def converse(self) -> int:
        """Ask until there is no question left, or the person leaves; returns the exit code."""
        with self._interview:
            try:
                code = self._ask_all()
            except KeyboardInterrupt:
                self._say("")
                code = self._leave(130)
            except (OSError, BadLog) as error:
                return fail(
                    f"stopped: {error}. What was answered before is kept; to go on: {self._again}"
                )
            return code

    def _ask_all(self) -> int:
        screen = self._handle("state")
        for part in (screen["title"], screen["preamble"]):
            if part:
                self._say(part)
        if screen["answered"]:
            self._say(f"Going on after {_answers(screen['answered'])}.")
        while True:
            if screen["note"]:
                self._say(screen["note"])
                screen["note"] = None  # once
            match screen["stage"]:
                case "practice":
                    self._say("\nFirst one to practise, whose answer does not count.\n")
                    key = self._put()
                case "question":
                    self._say(
                        f"\nQuestion {screen['question']['number']}{self._more_to_come(screen)}\n"
                    )
                    key = self._put()
                case _:
                    open_still = (
                        f" of whole numbers. {self._finer}" if screen["end"]["open"] else "."
                    )
                    self._say(f"\nThere are no more questions{open_still}")
                    self._say(_KEYS_AT_THE_END)
                    key = self._read({"": "done"}, "done", _KEYS_AT_THE_END)
            match key:
                case "done":
                    self._report(screen["end"])
                    return 0
                case "quit":
                    return self._leave(0)
                case "why":
                    self._why(screen)
                case "undo" if screen["stage"] != "practice":
                    if screen["last"] is None:
                        self._say("There is no answer to undo.")
                    else:
                        screen = self._handle("undo", id=screen["last"]["id"])
                case _ if screen["stage"] == "practice":
                    screen = self._handle("practised", choice=key)
                case _:
                    screen = self._handle("answer", id=screen["question"]["id"], choice=key)

    def _put(self) -> str:
        """Show the question; what the person wants."""
        assert self._interview.shown is not None
        print(self._interview.shown.text(self._width))
        self._say(f"\n{_KEYS}")
        return self._read({}, "quit", _KEYS)

    def _why(self, screen: dict[str, Any]) -> None:
        """Why the question is asked, and how many come after it, as far as that was computed
        meanwhile.
        """
        if screen["stage"] == "practice":
            self._say("To try the keys.")
            return
        beside = self._handle("outlook", id=screen["question"]["id"])
        for sentence in beside["why"]:
            self._say(printable(sentence))
        if not beside["ready"] and not beside["why"]:
            self._say("Still being worked out: ask again in a moment.")
        elif not beside["why"]:
            self._say("Nothing is known of that.")

    def _more_to_come(self, screen: dict[str, Any]) -> str:
        to_come = self._handle("outlook", id=screen["question"]["id"])["to_come"]
        if to_come is None:
            return ""
        least, most = to_come
        return (
            f" (about {f'{least} to {most}' if least < most else most} more)"
            if most
            else " (perhaps the last one)"
        )

    def _report(self, end: dict[str, Any]) -> None:
        counts = end["counts"]
        kinds = ("equal", "equal"), ("cannot tell", "cannot tell"), ("unused", "not used")
        among = ", ".join(
            f"{counts[n]} {name}"
            for n, name in (*kinds, ("withdrawn", "more taken back"))
            if counts[n]
        )
        self._say(f"\n{_answers(counts['answered'])}{f' ({among})' if among else ''}\n")
        if end["scale"]:
            for line in scale_report(
                [ScaleRow(**row) for row in end["scale"]], end["certainty"], self._width
            ):
                print(line)
        self._say("")
        for line in end["statements"]:
            self._say(line)
        for conflict in end["conflicts"]:
            self._say(
                f"\nThese {len(conflict)} answers do not go together; to change any one of them "
                "would mend it:"
            )
            for entry in conflict:
                self._say(f"  - {entry['sentence']}")
        self._say(f"\nAll answers are in {self._log.path}.")

    def _leave(self, code: int) -> int:
        answered = sum(not entry.retracted and not entry.repeat for entry in self._log)
        self._say(f"Kept: {_answers(answered)}. To go on:")
        print(f"  {printable(self._again)}", flush=True)
        return code

    def _handle(self, do: str, **parts: str) -> dict[str, Any]:
        return self._interview.handle({"do": do, **parts})

    def _read(self, more: dict[str, str], at_end: str, keys: str) -> str:
        """The next line that means something; ``at_end`` where there are no more; keys: what is
        said of others.
        """
        while True:
            print("> ", end="", flush=True)
            line = sys.stdin.readline()
            if not line:
                print()
                return at_end
            said = " ".join(line.lower().split())
            if not sys.stdin.isatty():
                print(printable(said[:40]))  # as a terminal would have shown it
            meant = more.get(said) or _MEANS.get(said)
            if meant is not None and (not more or meant in ("undo", "quit", *more.values())):
                return meant
            if said:
                self._say(f"{said[:40]!r} is no answer here. {keys}")

    def _say(self, text: str) -> None:
        """A paragraph, wrapped, further lines of an item ("  - ...") indented; empty lines at its
        ends stay.
        """
        before, after = len(text) - len(text.lstrip("\n")), len(text) - len(text.rstrip("\n"))
        item = len(text) - len(text.lstrip(" -"))
        further = " " * (item + 2 * (item == 2))
        said = textwrap.wrap(
            printable(text.strip("\n")),
            self._width,
            subsequent_indent=further,
            break_on_hyphens=False,
        )
        print("\n" * before + "\n".join(said) + "\n" * (after if said else 0), flush=True)


def _answers(n: int) -> str:
    return f"{n} answer{'' if n == 1 else 's'}"


def scale_report(rows: Sequence[ScaleRow], certainty: str, width: int) -> list[str]:
    """Lines of at most so many columns: what each level is worth, best first, from 0 to 100, with
    its interval.
    """
    name = min(max(len(row.label) for row in rows), width - 20)
    bar = min(_BAR, width - name - 22)
    said = (
        "What the levels are worth, from 0 to 100: 60 is as good as 60 of 100 at the best level "
        "and 40 at the worst "
        f"(best guess, interval; {certainty})"
    )
    lines = textwrap.wrap(said, width)
    for row in rows:
        known = "" if row.low == row.high else f"{row.low:.0f} to {row.high:.0f}"
        line = f"  {row.label[:name]:{name}} {row.value:5.0f}  {known:9}"
        lines.append(
            f"{line}  {_bar(row.low, row.value, row.high, bar) if bar >= _LEAST_BAR else ''}".rstrip()  # noqa: E501
        )
    return lines


def _bar(low: float, value: float, high: float, width: int) -> str:
    """An interval of 0..100 as a line: "....--*---....."."""
    at = [min(width - 1, int(x / 100.0 * width)) for x in (low, value, high)]
    return "".join("*" if i == at[1] else "-" if at[0] <= i <= at[2] else "." for i in range(width))
