"""A session in the terminal: questions as plain text, answers as lines."""

from __future__ import annotations

import io
import shutil
import sys
import textwrap
import time
from collections.abc import Iterator, Sequence
from typing import Any, Literal

from elicit._support.file_errors import in_words
from elicit.person.course.counts import Counts, in_answers
from elicit.person.findings import ScaleRow, guess_in_words, is_narrower
from elicit.person.interview import Interview, Subject
from elicit.person.report import NAMED
from elicit.person.session import Session
from elicit.person.showing import NARROWEST, Choice, printable
from elicit.tutors.log_file import BadLog
from qlearn.cli.options import fail

Until = Literal["values", "settled"]
"""When the questions end: once every value is known, or once the result is settled."""
_Key = Choice | Literal["undo", "why", "finish", "quit"]
_MEANS: dict[str, _Key] = {
    "a": "a",
    "b": "b",
    **dict.fromkeys(("e", "equal"), "equal"),
    **dict.fromkeys(("?", "cannot tell"), "cannot tell"),
    **dict.fromkeys(("u", "undo", "take back"), "undo"),
    **dict.fromkeys(("w", "why"), "why"),
    **dict.fromkeys(("f", "finish now"), "finish"),
    **dict.fromkeys(("q", "quit"), "quit"),
}
# only the keys and the words that this line offers are answers
_KEYS = "a or b: that one; e: equal; ?: cannot tell; u: take back; w: why; f: finish now; q: quit"
_KEYS_AT_THE_END = "Enter: what was learned; u: take back; q: quit"
_KEYS_WITH_MORE = "Enter: what was learned; m: more questions; u: take back; q: quit"
_WIDEST = 100
_MOST_CHANGES = 12  # lines of a table
_BAR = 40  # columns of an interval, at most
_LEAST_BAR = 10
_PATIENCE = 5.0  # seconds that a person waits for the results of the choices in a conflict
_LOOK = 0.05  # seconds between two looks at it


class Terminal:
    """A session with the person at standard input.

    again: the command that resumes the session. questions: how many the person has time for, if
    they say. until: when the questions end; None for "values", or as the log says.
    """

    def __init__(
        self,
        session: Session,
        subject: Subject,
        again: str,
        questions: int | None = None,
        until: Until | None = None,
    ) -> None:
        self._questions, self._until = questions, until
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
        """Ask until no question is left, or the person leaves; return the exit code."""
        with self._interview:
            try:
                code = self._ask_all()
            except KeyboardInterrupt:
                self._say("")
                code = self._leave(130)
            except (OSError, BadLog) as error:
                kept = f"What was answered before is kept; to go on: {self._again}"
                return fail(f"stopped: {in_words(error)}. {kept}")
            return code

    def _ask_all(self) -> int:
        screen = self._handle("state")
        for part in (screen["title"], screen["preamble"]):
            if part:
                self._say(part)
        self._legend(screen["legend"])
        if screen["note_beside"]:
            self._say(screen["note_beside"])
        if screen["answered"]:
            self._say(f"Going on after {in_answers(screen['answered'])}.")
            if self._questions is not None or self._until is not None:
                further = screen["answered"] + self._questions if self._questions else ""
                screen = self._handle(
                    "start", budget=f"{further}", until=self._until or screen["until"]
                )
        while True:
            if screen["note"]:
                self._say(screen["note"])
                screen["note"] = None  # once
                if screen["may_practise"]:
                    self._say("u: try again")
            match screen["stage"]:
                case "welcome":
                    self._welcome(screen["welcome"])
                    until = self._until or "values"
                    screen = self._handle("start", budget=f"{self._questions or ''}", until=until)
                    continue
                case "practice":
                    self._say("\nPractice question: your answer is not saved.\n")
                    key = self._put()
                case "question":
                    self._say(
                        f"\nQuestion {screen['question']['number']}{self._more_to_come(screen)}\n"
                    )
                    if screen["question"]["check"]:
                        self._say(screen["question"]["check"])
                    key = self._put()
                case "conflict" | "offer":
                    after = self._one_of(screen)
                    if after is None:
                        return self._leave(0)
                    screen = after
                    continue
                case _:
                    self._say(f"\n{self._at_the_end(screen['end'])}")
                    keys = _KEYS_WITH_MORE if screen["end"]["more"] else _KEYS_AT_THE_END
                    self._say(keys)
                    key = self._read({"": "done", "m": "more"}, "done", keys)
            match key:
                case "done":
                    self._report(screen)
                    return 0
                case "quit":
                    return self._leave(0)
                case "more":
                    screen = self._handle("more")
                case "finish":
                    screen = self._handle("finish")
                case "why":
                    self._why(screen)
                case "undo" if screen["stage"] != "practice":
                    if screen["may_practise"]:
                        screen = self._handle("practise")
                    elif screen["last"] is None:
                        self._say("There is no answer to take back.")
                    else:
                        screen = self._handle("undo", id=screen["last"]["id"])
                case _ if screen["stage"] == "practice":
                    screen = self._handle("practised", choice=key)
                case _:
                    screen = self._handle("answer", id=screen["question"]["id"], choice=key)

    def _at_the_end(self, end: dict[str, Any]) -> str:
        """Return a sentence on whether more could be asked."""
        if end["open"]:
            return f"There are no more questions in whole numbers. {self._finer}"
        if end["finished"]:
            return "There are no more questions."
        return "This is the result so far. More could be asked."

    def _legend(self, legend: dict[str, Any]) -> None:
        """Print what the levels mean, best first."""
        if legend["duration"]:
            self._say(legend["duration"])
        for level in legend["levels"]:
            if level["meaning"]:
                self._say(f"  - {level['label']}: {level['meaning']}")

    def _welcome(self, welcome: dict[str, Any]) -> None:
        """Print what is at stake, and that the person can leave at any time."""
        for sentence in (welcome["compare"], welcome["purpose"], welcome["before"]):
            if sentence:
                self._say(sentence)
        self._say("Your answers stay on this computer. You can finish at any time with f.")

    def _one_of(self, screen: dict[str, Any]) -> dict[str, Any] | None:
        """Print a conflict or an offer; return the screen after the choice, or None to leave."""
        found = screen[screen["stage"]]
        self._say(f"\n{found['heading']}. {found['text']}")
        for answer in found.get("answers", []):
            self._say(f"  - {answer['name']}: {answer['sentence']}")
        options = found.get("choices") or found["options"]
        left = self._consequences(found["id"]) if screen["stage"] == "conflict" else {}
        for number, option in enumerate(options, 1):
            after = left.get(option.get("choice"), "")
            self._say(f"{number}: {option['label']}.{f' {after}' if after else ''}")
        numbers = {f"{i}": f"{i}" for i in range(1, len(options) + 1)}
        key = self._read(
            numbers, "quit", f"a number from 1 to {len(options)}; u: take back; q: quit"
        )
        if key == "quit":
            return None
        if key == "undo":
            return self._handle("undo", id=screen["last"]["id"])
        chosen = options[int(key) - 1]
        if screen["stage"] == "conflict":
            return self._handle("settle", id=found["id"], choice=chosen["choice"])
        return (
            None if chosen["option"] == "pause" else self._handle("choose", option=chosen["option"])
        )

    def _consequences(self, id: str) -> dict[str, str]:
        """Return the result of each choice in a conflict, as far as it is known within seconds."""
        until = time.monotonic() + _PATIENCE
        while True:
            found = self._handle("consequences", id=id)
            if found["ready"] or time.monotonic() > until:
                return dict(found["choices"])
            time.sleep(_LOOK)

    def _put(self) -> str:
        """Show the question, and return the person's command."""
        assert self._interview.shown is not None
        print(self._interview.shown.text(self._width))
        self._say(f"\n{_KEYS}")
        return self._read({}, "quit", _KEYS)

    def _why(self, screen: dict[str, Any]) -> None:
        """Print why the question is asked, and how many come after it, as far as it is known."""
        if screen["stage"] == "practice":
            self._say("It is there to try the keys.")
            return
        beside = self._handle("outlook", id=screen["question"]["id"])
        for sentence in (*beside["why"], "" if beside["rose"] else beside["forecast"]):
            if sentence:
                self._say(printable(sentence))
        if not beside["ready"] and not beside["why"]:
            self._say("Still being worked out: ask again in a moment.")
        elif not beside["why"]:
            self._say("Nothing is known of that.")

    def _more_to_come(self, screen: dict[str, Any]) -> str:
        beside = self._handle("outlook", id=screen["question"]["id"])
        if beside["to_come"] is None:
            return f" (at least {beside['at_least']} more)" if beside["at_least"] else ""
        least, most = beside["to_come"]
        if not most:
            return " (close to the end)"
        if beside["near"]:
            return f" (probably close to the end, at most about {most} more)"
        rose = f": {beside['forecast']}" if beside["rose"] else ""
        return f" (about {f'{least} to {most}' if least < most else most} more{rose})"

    def _report(self, screen: dict[str, Any]) -> None:
        say_report(screen, self._width)
        self._say(f"\nAll answers are in {self._log.path}.")

    def _leave(self, code: int) -> int:
        self._say(f"Kept: {in_answers(Counts.of(self._log).answered)}. To go on:")
        print(f"  {printable(self._again)}", flush=True)
        return code

    def _handle(self, do: str, **parts: str) -> dict[str, Any]:
        return self._interview.handle({"do": do, **parts})

    def _read(self, more: dict[str, str], at_end: str, keys: str) -> str:
        """Return the next line that is one of the possible commands.

        ``at_end`` is returned if the input ends. ``keys`` is printed after any other line.
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
            if said in more or (meant is not None and (not more or meant in ("undo", "quit"))):
                assert meant is not None
                return meant
            if said:
                self._say(f"{said[:40]!r} is no answer here. {keys}")

    def _say(self, text: str) -> None:
        say(text, self._width)


def say(text: str, width: int) -> None:
    """Print a paragraph, wrapped to a width.

    Further lines of an item ("  - ...") are indented. Empty lines at the ends of the text stay.
    """
    before, after = len(text) - len(text.lstrip("\n")), len(text) - len(text.rstrip("\n"))
    item = len(text) - len(text.lstrip(" -"))
    further = " " * (item + 2 * (item == 2))
    said = textwrap.wrap(
        printable(text.strip("\n")),
        width,
        subsequent_indent=further,
        break_on_hyphens=False,
    )
    print("\n" * before + "\n".join(said) + "\n" * (after if said else 0), flush=True)


def say_report(screen: dict[str, Any], width: int) -> None:
    """Print the result on the screen at the end."""
    for line in report_lines(screen, width):
        if line.startswith("    "):  # a row of the scale, which fits
            print(line)
        else:
            say(line, width)


def report_lines(screen: dict[str, Any], width: int) -> list[str]:
    """Return the result on the screen at the end, as lines and paragraphs."""
    end = screen["end"]
    scale = []
    if end["scale"]:
        rows = [ScaleRow(**row) for row in end["scale"]]
        scale = ["", *scale_report(rows, end["certainty"], width), *end["scale_notes"], ""]
    lines = ["", *filter(None, [end["headline"], end["caution"]])]
    if end["follows"]:  # whoever wanted to know the values sees them first
        lines += scale
    said = (
        end["follows"],
        end["effect"],
        end["reason"],
        *(f"{words}: {end[name]}" for name, words in NAMED.items() if end[name]),
        *end["remarks"],
    )
    lines += [sentence for sentence in said if sentence]
    lines += ["", " ".join(filter(None, [end["given"], end["checks"], end["by_chance"]]))]
    if not end["follows"]:
        lines += scale
    lines += end["statements"]
    if changes := end["changes"]:
        lines += _table_lines(changes)
        if changes["open"]:
            lines += _table_lines(changes["open"])
    for conflict in end["conflicts"]:
        many = "These answers contradict each other. Taking back any one of them fixes it."
        one = "This answer goes against the order of the levels."
        lines.append(f"\n{one if len(conflict) == 1 else many}")
        lines += [f"  - {entry['sentence']}" for entry in conflict]
    return [*lines, "", *filter(None, [end["source"], *end["limits"]])]


def _table_lines(table: dict[str, Any]) -> Iterator[str]:
    """Return the title, the note and the first rows of a table."""
    yield f"\n{table['title']}."
    yield from table["note"].split("\n")
    for i, (first, *cells) in enumerate(table["rows"][:_MOST_CHANGES]):
        if table["of"] == "state":
            other, mine, *why = cells
            yield f"  - {first}: {mine}, not {other} ({'; '.join(why)})"
        elif table["of"] == "undecided state":
            other, mine, *why = cells
            yield f"  - {first}: {other}, perhaps {mine} ({'; '.join(why)})"
        else:
            each = zip(table["columns"][1:], cells, strict=True)
            mark = f" ({table['mark']})" if i == table["marked"] else ""
            yield f"  - {first}{mark}: {', '.join(f'{name} {cell}' for name, cell in each)}"
    more = len(table["rows"]) - _MOST_CHANGES
    if more > 0:
        yield f"  - and {more} more"


def scale_report(rows: Sequence[ScaleRow], certainty: str, width: int) -> list[str]:
    """Return lines with the value of each level and its interval.

    The best level comes first, values run from 0 to 100, and lines have at most ``width`` columns.
    """
    name = min(max(len(row.label) for row in rows), width - 24)
    has_given = any(is_narrower(row.given, row.low, row.high) for row in rows)
    bar = min(_BAR, width - name - 27 - 11 * has_given)
    between = f"range if no answer is a mistake, range {certainty}"
    said = (
        "What the levels are worth, from 0 to 100: 60 is as good as 60 of 100 at the best level "
        f"and 40 at the worst (best guess, {between if has_given else f'interval; {certainty}'})"
    )
    lines = textwrap.wrap(said, width)
    for row in rows:
        known = "" if row.low == row.high else f"{row.low:.0f} to {row.high:.0f}"
        guessed = row.known
        guess = guess_in_words(row.value, guessed, row.rough) if guessed or row.rough else "unknown"
        picture = _bar(row.low, row.value if guessed else None, row.high, bar)
        line = f"    {row.label[:name]:{name}} {guess:>8}  "
        if has_given:
            line += f"{'{:.0f} to {:.0f}'.format(*row.given) if row.given else '':9}  "
        line += f"{known:9}"
        lines.append(f"{line}  {picture if bar >= _LEAST_BAR else ''}".rstrip())
    return lines


def _bar(low: float, value: float | None, high: float, width: int) -> str:
    """Return an interval of 0..100 as a line: "....--*---.....", without "*" if it has no guess."""
    at = [min(width - 1, int(x / 100.0 * width)) for x in (low, value or 0.0, high)]
    return "".join(
        "*" if value is not None and i == at[1] else "-" if at[0] <= i <= at[2] else "."
        for i in range(width)
    )
