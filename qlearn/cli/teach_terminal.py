"""A session in the terminal: questions as plain text, answers as lines."""

from __future__ import annotations

import io
import shutil
import sys
import textwrap
from typing import Literal

from elicit.model.comparator import Comparator
from elicit.model.query import Query
from elicit.person.findings import certainty, scale_rows
from elicit.person.interview import Subject
from elicit.person.session import Compares, Session
from elicit.person.showing import NARROWEST, Choice, Shown, practice, printable, show
from elicit.tutors.log_lines import BadLog
from qlearn.cli.options import fail

_Key = Choice | Literal["undo", "quit"]
_MEANS: dict[str, _Key] = {
    **dict.fromkeys(("a", "left", "1"), "a"),
    **dict.fromkeys(("b", "right", "2"), "b"),
    **dict.fromkeys(("e", "=", "equal", "same"), "equal"),
    **dict.fromkeys(("?", "cannot tell", "unknown"), "cannot tell"),
    **dict.fromkeys(("u", "undo"), "undo"),
    **dict.fromkeys(("q", "quit", "exit"), "quit"),
}
_KEYS = "a or b: that one; e: equal; ?: cannot tell; u: undo; q: quit"
_WIDEST = 100
_BAR = 40  # columns of an interval, at most
_LEAST_BAR = 10


class Terminal:
    """A session with the person at standard input. again: the command that goes on."""

    def __init__(self, session: Session, subject: Subject, again: str) -> None:
        self._session, self._subject, self._again = session, subject, again
        self._width = min(max(shutil.get_terminal_size().columns, NARROWEST), _WIDEST)
        for stream in (sys.stdin, sys.stdout):  # a name that the terminal cannot write, or a key that is no letter
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")

    def converse(self) -> int:
        """Ask until there is no question left, or the person leaves; returns the exit code."""
        try:
            code = self._ask_all()
        except KeyboardInterrupt:
            self._say("")
            code = self._leave(130)
        except (OSError, BadLog) as error:
            return fail(f"stopped: {error}. What was answered before is kept; to go on: {self._again}")
        return code

    def _ask_all(self) -> int:
        session, words = self._session, self._subject.words
        for part in (words.title, words.preamble):
            if part:
                self._say(part)
        answered = self._answered()
        if answered:
            self._say(f"Going on after {_answers(answered)}.")
        elif not self._practised():
            return self._leave(0)
        while True:
            query = session.question()
            shown = None if query is None else self._shown(query)
            if shown is not None and shown.exact:
                key = self._put(shown)
            else:  # an answer to rounded numbers could make what is said at the end untrue
                open_still = "" if shown is None else f" of whole numbers. {self._subject.finer}"
                self._say(f"\nThere are no more questions{open_still or '.'}")
                self._say("Enter: what was learned; u: undo; q: quit")
                key = self._read({"": "done"}, "done")
                if key == "done":
                    self._report()
                    return 0
            if key == "quit":
                return self._leave(0)
            if key == "undo":
                self._undo()

    def _practised(self) -> bool:
        """Put the practice question until it is answered; False where the person leaves."""
        subject = self._subject
        shown = practice(subject.labels, subject.words, subject.of, self._subject.seed)
        obvious = "A" if not shown.swapped else "B"
        self._say("\nFirst one to practise, whose answer does not count.\n")
        self._print(shown)
        key = self._read({}, "quit")
        if key == "quit":
            return False
        if key == obvious.lower():
            self._say("Just so. Now the questions that count.")
        else:
            self._say(f"Most would say {obvious}: all there are at the best level. Now the questions that count.")
        return True

    def _put(self, shown: Shown) -> str:
        """Put a question, and take its answer; what else the person wants is returned."""
        self._session.shown(shown.id, shown.swapped, shown=shown.record())
        self._say(f"\nQuestion {self._answered() + 1}\n")
        self._print(shown)
        key = self._read({}, "quit")
        if key in ("undo", "quit"):
            return key
        self._session.answer(shown.id, shown.verdict(key))  # type: ignore[arg-type]  # it is a Choice now
        return key

    def _undo(self) -> None:
        if not self._answered():
            self._say("There is no answer to undo.")
            return
        self._session.undo()
        self._say("Taken back.")

    def _report(self) -> None:
        session, subject = self._session, self._subject
        status = session.status()
        counts = (status.equal, "equal"), (status.cannot_tell, "cannot tell"), (status.unused, "not used")
        among = ", ".join(f"{n} {name}" for n, name in (*counts, (status.withdrawn, "taken back besides")) if n)
        self._say(f"\n{_answers(status.answered)}{f' ({among})' if among else ''}\n")
        if isinstance(session.asker, Compares):
            for line in scale_report(session.asker.comparator, subject.labels, self._width):
                print(line)
        self._say("")
        for line in subject.report(session.result()):
            self._say(line)
        for conflict in session.conflicts():
            self._say(f"\nThese {len(conflict)} answers do not go together; to change any one of them would mend it:")
            for entry in conflict:
                self._say(f"  - {self._shown(entry.answer.query).sentence(entry.answer.verdict)}")
        self._say(f"\nAll answers are in {session.log.path}.")

    def _leave(self, code: int) -> int:
        self._say(f"Kept: {_answers(self._answered())}. To go on:")
        print(f"  {printable(self._again)}", flush=True)
        return code

    def _read(self, more: dict[str, str], at_end: str) -> str:
        """The next line that means something; ``at_end`` where there are no more."""
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
                self._say(f"{said[:40]!r} is no answer. {_KEYS}")

    def _shown(self, query: Query) -> Shown:
        subject = self._subject
        return show(query, subject.words, subject.of, self._subject.seed, subject.labels)

    def _answered(self) -> int:
        return sum(not entry.retracted for entry in self._session.log)

    def _print(self, shown: Shown) -> None:
        print(shown.text(self._width))
        self._say(f"\n{_KEYS}")

    def _say(self, text: str) -> None:
        """A paragraph, wrapped, further lines of an item ("  - ...") indented; empty lines at its ends stay."""
        before, after = len(text) - len(text.lstrip("\n")), len(text) - len(text.rstrip("\n"))
        item = len(text) - len(text.lstrip(" -"))
        further = " " * (item + 2 * (item == 2))
        said = textwrap.wrap(
            printable(text.strip("\n")), self._width, subsequent_indent=further, break_on_hyphens=False
        )
        print("\n" * before + "\n".join(said) + "\n" * (after if said else 0), flush=True)


def _answers(n: int) -> str:
    return f"{n} answer{'' if n == 1 else 's'}"


def scale_report(comparator: Comparator, labels: tuple[str, ...], width: int) -> list[str]:
    """Lines of at most so many columns: what each level is worth, best first, from 0 to 100, with its interval."""
    rows = scale_rows(comparator, labels)
    name = min(max(len(row.label) for row in rows), width - 20)
    bar = min(_BAR, width - name - 22)
    said = f"What the levels are worth, from 0 to 100 (best guess, interval; {certainty(comparator)}):"
    lines = textwrap.wrap(said, width)
    for row in rows:
        known = "" if row.low == row.high else f"{row.low:.0f} to {row.high:.0f}"
        line = f"  {row.label[:name]:{name}} {row.value:5.0f}  {known:9}"
        lines.append(f"{line}  {_bar(row.low, row.value, row.high, bar) if bar >= _LEAST_BAR else ''}".rstrip())
    return lines


def _bar(low: float, value: float, high: float, width: int) -> str:
    """An interval of 0..100 as a line: "....--*---....."."""
    at = [min(width - 1, int(x / 100.0 * width)) for x in (low, value, high)]
    return "".join("*" if i == at[1] else "-" if at[0] <= i <= at[2] else "." for i in range(width))
