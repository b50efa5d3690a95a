"""Counts of the answers in a log, and the sentence on them in every screen, report and command."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Literal

from elicit.model.query import Verdict
from elicit.person.course.conclusion import listed
from elicit.person.course.conduct import (
    IN_CONFLICT,
    ORDER,
    SETTLED,
    differs,
    repeats_in,
    was_settled,
)
from elicit.tutors.answer_log import EXPECTED, REPEATS, RESOLVED, Entry

KEPT = "kept"
"""The metadata of an answer that was not kept: the id of the answer that was kept instead."""

Status = Literal[
    "learned from",
    "cannot tell",
    "ignored",
    "agrees",
    "differs",
    "checks the order",
    "taken back",
    "not kept",
]


def status_of(entry: Entry) -> Status:
    """Return what became of an answer, in the words of every list, report and table.

    A repeat that "agrees" confirms the answer that is learned from, and is not learned again. One
    that "differs" is not settled: the first answer is the one learned from. An answer that "checks
    the order" is about two neighbouring levels, whose order is known before. Of answers that
    contradict each other, and of a repeat and a first answer that differ, the person may keep one:
    the others are "not kept".
    """
    if entry.repeat and was_settled(entry):
        said = entry.answer.verdict
        meant = (entry.retraction or {})[RESOLVED]
        return "agrees" if meant == (None if said is None else int(said)) else "not kept"
    if entry.retracted:
        kept_other = was_settled(entry) or IN_CONFLICT in (entry.retraction or {})
        return "not kept" if kept_other else "taken back"
    if entry.repeat:
        return "differs" if differs(entry) else "agrees"
    if entry.answer.verdict is None:
        return "cannot tell"
    if not entry.used:
        return "ignored"
    return "checks the order" if entry.answer.query.id.startswith(ORDER) else "learned from"


def stands(status: Status) -> bool:
    """Return whether an answer of this status stands. The others are struck through in lists."""
    return status not in ("taken back", "not kept")


def remarks_on(
    entry: Entry, numbers: Mapping[str, int], in_conflict: bool = False
) -> tuple[str, ...]:
    """Return remarks on an answer, for a list of all answers.

    Parameters
    ----------
    entry : Entry
    numbers : mapping
        The number of each question, by its id.
    in_conflict : bool
        True if the answer contradicts others.

    Returns
    -------
    tuple of str
    """
    status, back = status_of(entry), entry.retraction or {}
    checked = numbers.get(str(entry.metadata.get(REPEATS)), "before")
    said = []
    if status == "taken back":
        said.append("taken back")
    elif status == "not kept" and IN_CONFLICT in back:
        number = numbers.get(str(back.get(KEPT)))
        other = "another" if number is None else f"answer {number}, which you kept"
        said.append(f"not kept: it contradicted {other}")
    elif status == "not kept":
        first = entry.repeat and back[RESOLVED] == entry.metadata.get(EXPECTED)
        instead = f"you meant answer {checked}" if first else "another answer replaces it"
        said.append(f"not kept: {instead}")
    if stands(status) and in_conflict:
        said.append("contradicts others")
    if status == "ignored":
        said.append("ignored")
    if entry.repeat:
        agrees = ": you meant this answer" if was_settled(entry) else ": as before"
        how = {"agrees": agrees, "differs": f": differs from answer {checked}, which counts"}
        said.append(f"check of answer {checked}{how.get(status, '')}")
    if entry.answer.query.id.startswith(ORDER):
        said.append("check of the order")
    if entry.answer.query.id.startswith(SETTLED):
        said.append("what you meant, after a check")
    return tuple(said)


@dataclass(frozen=True)
class Counts:
    """Numbers of answers of each kind in a log.

    Attributes
    ----------
    answered
        Answers that stand. ``learned``, ``cannot_tell``, ``unused``, ``agreeing``, ``differing``
        and ``ordering`` add up to this number (see ``status_of``).
    repeated
        Answers to repeated questions, also if the person settled a difference for another answer.
    alike
        Those of them that are the same as before.
    equal
        Answers "equally good" among those learned from.
    cannot_tell
        Answers "cannot tell".
    unused
        Answers that are ignored because they contradict others.
    agreeing, differing
        Repeats that agree with the answer learned from, and others that stand.
    ordering
        Answers that check the order of the levels.
    withdrawn
        Answers that the person took back, which are not in ``answered``.
    not_kept
        Answers in whose place the person kept another one. They are not in ``answered`` either.
    """

    answered: int = 0
    repeated: int = 0
    alike: int = 0
    equal: int = 0
    cannot_tell: int = 0
    unused: int = 0
    agreeing: int = 0
    differing: int = 0
    withdrawn: int = 0
    not_kept: int = 0
    ordering: int = 0

    @staticmethod
    def of(log: Iterable[Entry]) -> Counts:
        """Return the counts of a log."""
        entries = [*log]
        again = repeats_in(entries)
        n = Counter(map(status_of, entries))
        return Counts(
            answered=sum(map(is_counted, entries)),
            repeated=len(again),
            alike=sum(not differs(entry) for entry in again),
            equal=sum(
                status_of(entry) == "learned from" and entry.answer.verdict is Verdict.EQUAL
                for entry in entries
            ),
            cannot_tell=n["cannot tell"],
            unused=n["ignored"],
            agreeing=n["agrees"],
            differing=n["differs"],
            withdrawn=n["taken back"],
            not_kept=n["not kept"],
            ordering=n["checks the order"],
        )

    @property
    def learned(self) -> int:
        """Number of answers that comparators learn from, without checks of the order."""
        others = self.cannot_tell + self.unused + self.agreeing + self.differing + self.ordering
        return self.answered - others

    def record(self) -> dict[str, int]:
        """Return the counts as JSON."""
        return {name.replace("_", " "): n for name, n in asdict(self).items()}

    @staticmethod
    def read(record: Mapping[str, int]) -> Counts:
        """Return the counts of a JSON record. A missing count is 0."""
        return Counts(**{name.replace(" ", "_"): n for name, n in record.items()})

    @property
    def sentence(self) -> str:
        """Sentences on the numbers of answers of each kind.

        The numbers add up: those of the first sentence to the answers that stand.
        """
        equal = f" ({self.equal} of them “equally good”)" if self.equal else ""
        agrees = "a repeat that agrees (it confirms, and is not learned again)"
        if self.agreeing > 1:
            agrees = "repeats that agree (they confirm, and are not learned again)"
        differs = "a repeat that differs from the first answer, which counts"
        if self.differing > 1:
            differs = "repeats that differ from the first answers, which count"
        orders = "a check of the order of the levels"
        if self.ordering > 1:
            orders = "checks of the order of the levels"
        kinds = (
            (self.learned, f"learned from{equal}"),
            (self.agreeing, agrees),
            (self.differing, differs),
            (self.ordering, orders),
            (self.cannot_tell, "“cannot tell”"),
            (self.unused, "ignored for contradicting others"),
        )
        among = [f"{_are(n)} {words}" for n, words in kinds if n]
        gone = [
            f"{_were(n)} {words}"
            for n, words in ((self.withdrawn, "taken back"), (self.not_kept, "not kept"))
            if n
        ]
        found = f": {listed(among)}" if among else ""
        besides = f" Besides these, {listed(gone)}." if gone else ""
        verb = {0: "", 1: " stands"}.get(self.answered, " stand")
        return f"{in_answers(self.answered)}{verb}{found}.{besides}"

    @property
    def checks(self) -> str:
        """A sentence on how repeated questions were answered, or ""."""
        if not self.repeated:
            return ""
        questions = "question was" if self.repeated == 1 else "questions were"
        return f"{self.alike} of {self.repeated} repeated {questions} answered as before."


def is_counted(entry: Entry) -> bool:
    """Return whether an answer is one of ``Counts.answered``."""
    return stands(status_of(entry))


def numbered(log: Iterable[Entry]) -> list[tuple[int, Entry]]:
    """Return the entries of a log with the numbers of their questions.

    Questions are numbered in the order in which they were answered first. A number stays the same
    when an answer is taken back, and when the question is put anew.
    """
    numbers: dict[str, int] = {}
    return [
        (numbers.setdefault(_question_of(entry.answer.query.id), len(numbers) + 1), entry)
        for entry in log
    ]


def number_of(log: Iterable[Entry], id: str) -> int:
    """Return the number of a question: its own if it was answered before, else the next one."""
    numbers = {_question_of(entry.answer.query.id): number for number, entry in numbered(log)}
    return numbers.get(_question_of(id), len(numbers) + 1)


def _question_of(id: str) -> str:
    """Return the id of the question that was put, also for an answer that stands for two."""
    return id.removeprefix(SETTLED)


def _were(n: int) -> str:
    return f"{n} {'was' if n == 1 else 'were'}"


def _are(n: int) -> str:
    return f"{n} {'is' if n == 1 else 'are'}"


def in_answers(n: int) -> str:
    """Return a number of answers in words."""
    return f"{n} answer{'' if n == 1 else 's'}"
