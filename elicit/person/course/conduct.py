"""Conduct of a person so far, from the log alone: runs of one answer, the checks, and the pace.

A check is a question whose answer can be compared with something: an earlier question put again, or
two neighbouring levels, whose order is known. Whoever answers by chance differs in about half of
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Literal

from elicit.model.query import Answer, Verdict
from elicit.tutors.answer_log import EXPECTED, RESOLVED, Entry

Kind = Literal["a", "b", "equal", "cannot tell"]

ORDER = "order/"
"""Start of the id of a check question about two neighbouring levels."""
IN_CONFLICT = "in conflict"
"""The metadata of an answer that was taken back because it contradicted others."""
SETTLED = "settled/"
"""Start of the id of an answer that stands for two that differed."""
UNSURE_OFFER = 3
"""Answers "cannot tell" in a row after which the person is offered something else."""
_UNSURE = 12  # answers "cannot tell" in a row after which the questions are said not to work
_EQUAL = 10  # answers "equally good" in a row
_SIDE = 12  # choices of one side in a row: by chance 1 in 2,048, for sides are shuffled
_TAKEN_BACK = 5  # answers taken back as contradictions, and a share, after which that is said:
_SHARE_TAKEN_BACK = 1 / 4  # of those given. In 50 sessions with 10% or 15% errors none came so far
_FEW = 3  # answers of one kind that are worth a remark at the end
_SIDE_AT_END = 8
_DIFFERED = 2  # checks answered otherwise that are worth a remark
_BY_CHANCE = 0.5  # share of the checks that answers by chance answer otherwise, at least
_BY_SLIPS = 0.15  # share that somebody answers otherwise who means the answers
_LIKELIER = 2.0  # so many times likelier by chance is said
LEAST_CHECKS = 5
"""Checks before the end. Answers by chance pass so many in at most 1 of 32 cases."""
MOST_CHECKS = 11
"""Checks after which whoever has not passed is told so."""
_MORE_ALIKE = 2  # further checks that must be answered alike for each that was not
SECONDS = 20.0
"""Seconds that a question is taken to last until the person's own pace is known."""
HASTY = 1.0
"""Seconds in which hardly anyone reads a question."""
FEW_HASTY = 3
"""Answers in under a second that are worth a remark."""
_HASTY_SHARE = 0.2  # share of them that is worth a remark at the end
_KNOWN_AFTER = 3  # answers
_BREAK = 300.0  # seconds: whoever takes longer was away, and the rest does not count


def choice_of(answer: Answer) -> Kind:
    """Return what was chosen on the screen."""
    if answer.verdict is None:
        return "cannot tell"
    if answer.verdict is Verdict.EQUAL:
        return "equal"
    return "a" if (answer.verdict is Verdict.BETTER) != answer.swapped else "b"


def repeats_in(log: Iterable[Entry]) -> list[Entry]:
    """Return the repeats that count: those that stand, and those that the person has settled."""
    return [
        entry
        for entry in log
        if entry.repeat and (entry.retraction is None or RESOLVED in entry.retraction)
    ]


def differs(entry: Entry) -> bool:
    """Return whether a repeat was answered otherwise than the first time."""
    return bool(entry.metadata[EXPECTED] != entry.answer.verdict)


@dataclass(frozen=True)
class Conduct:
    """Conduct in a log: how its answers were given.

    Attributes
    ----------
    answered
        Answers that stand, without repeats.
    with_verdict
        Those among them that say which is better, or equal.
    checks, differed
        Number of checks, and of those answered otherwise than before or against the order of the
        levels.
    last
        The last choice on the screen; None if there is no answer.
    in_a_row
        How many answers at the end are that choice.
    taken_back
        Answers taken back because they contradicted others.
    """

    answered: int
    with_verdict: int
    checks: int
    differed: int
    last: Kind | None
    in_a_row: int
    taken_back: int = 0

    @staticmethod
    def of(log: Sequence[Entry]) -> Conduct:
        """Return the conduct of the answers of a log."""
        standing = [entry for entry in log if entry.stands and not entry.repeat]
        repeats = repeats_in(log)
        order = [
            entry
            for entry in log
            if entry.answer.query.id.startswith(ORDER)
            and (entry.retraction is None or RESOLVED in entry.retraction)
            and entry.answer.verdict is not None
        ]
        said = [choice_of(entry.answer) for entry in log if entry.stands]
        last = said[-1] if said else None
        row = 0
        while row < len(said) and said[-1 - row] == last:
            row += 1
        return Conduct(
            answered=len(standing),
            with_verdict=sum(entry.answer.verdict is not None for entry in standing),
            checks=len(repeats) + len(order),
            differed=sum(map(differs, repeats))
            + sum(entry.answer.verdict is Verdict.WORSE for entry in order),
            last=last,
            in_a_row=row,
            taken_back=sum(IN_CONFLICT in (entry.retraction or {}) for entry in log),
        )

    @property
    def given(self) -> int:
        """Answers that stand, without repeats, and those taken back as contradictions."""
        return self.answered + self.taken_back

    @property
    def like_chance(self) -> bool:
        """True if the checks were answered about as they are by chance."""
        likelier = (_BY_CHANCE / _BY_SLIPS) ** self.differed
        likelier *= ((1 - _BY_CHANCE) / (1 - _BY_SLIPS)) ** (self.checks - self.differed)
        return self.differed >= _DIFFERED and likelier >= _LIKELIER

    @property
    def passed(self) -> bool:
        """True if there were enough checks, and enough of them were answered alike.

        About 6% of people who answer by chance come so far, and 98% of those who answer one check
        in 20 differently.
        """
        alike = self.checks - self.differed
        return alike >= LEAST_CHECKS + _MORE_ALIKE * self.differed

    @property
    def unresolved(self) -> bool:
        """True if some check was answered otherwise, and more checks would tell what it means."""
        may = self.checks < MOST_CHECKS and not self.like_chance
        return self.differed > 0 and may and not self.passed

    @property
    def by_chance(self) -> str:
        """A sentence on how often answers by chance would do as well in the checks, or ""."""
        if not self.checks:
            return ""
        as_well = sum(math.comb(self.checks, n) for n in range(self.differed + 1))
        cases = 2**self.checks // as_well
        often = "half of the cases or more" if cases < 2 else f"at most 1 of {cases} cases"
        return f"Answers by chance would do as well in {often}."

    @property
    def offers(self) -> bool:
        """True if the person could not tell in several questions in a row, just now."""
        return (
            self.last == "cannot tell" and self.in_a_row > 0 and self.in_a_row % UNSURE_OFFER == 0
        )

    def caution(self, at_end: bool = False) -> str | None:
        """Return a sentence on why the answers say little, or None.

        Parameters
        ----------
        at_end : bool
            True if nothing more is asked: then fewer answers of one kind are worth a remark.

        Returns
        -------
        str or None
        """
        n, all_alike = self.in_a_row, at_end and self.in_a_row >= self.answered
        if self.last == "cannot tell" and n >= (_FEW if all_alike else _UNSURE):
            return (
                f"You could not tell in {n} questions in a row, so nothing can be concluded from "
                "them."
            )
        if self.last == "equal" and n >= (_FEW if all_alike else _EQUAL):
            return (
                f"You called {n} pairs in a row equally good. Either the conditions matter little "
                "to you, or the questions do not show what matters."
            )
        if self.last in ("a", "b") and n >= (_SIDE_AT_END if all_alike else _SIDE):
            side = self.last.upper()
            return (
                f"You chose {side} {n} times in a row, although the sides are shuffled. Answers "
                "that do not depend on the question would look the same."
            )
        back = self.taken_back
        if back >= _TAKEN_BACK and back >= _SHARE_TAKEN_BACK * self.given:
            return (
                f"You took back {back} answers because they contradicted others. Perhaps one that "
                "you kept is not what you mean. Answers given by chance would look the same."
            )
        few_alike = 2 * self.differed >= max(self.checks, 1) or (
            self.differed >= _DIFFERED and not self.passed
        )
        failed = self.checks >= MOST_CHECKS and not self.passed
        if self.like_chance or failed or (at_end and few_alike):
            return (
                f"You answered {self.differed} of {self.checks} check questions differently from "
                "before, or against the order of the levels. Answers given by chance would look "
                "the same."
            )
        return None


@dataclass(frozen=True)
class Pace:
    """The pace of the answers in a log.

    Attributes
    ----------
    seconds
        Seconds a question: the median of the person's own, once three are known.
    spent
        Seconds spent on all answers so far, without breaks.
    hasty
        Number of answers that came in under a second.
    timed
        Number of answers whose time is known.
    """

    seconds: float = SECONDS
    spent: float = 0.0
    hasty: int = 0
    timed: int = 0

    @staticmethod
    def of(log: Iterable[Entry]) -> Pace:
        """Return the pace of the answers of a log that stand."""
        said = [entry.metadata.get("latency") for entry in log if entry.stands]
        took = [float(one) for one in said if isinstance(one, int | float) and one >= 0]
        own = median(took) if len(took) >= _KNOWN_AFTER else SECONDS
        return Pace(
            seconds=max(own, HASTY),
            spent=sum(one if one <= _BREAK else own for one in took),
            hasty=sum(one < HASTY for one in took),
            timed=len(took),
        )

    def remark(self) -> str | None:
        """Return a sentence on answers that came very fast, or None if they were few."""
        if self.hasty < FEW_HASTY or self.hasty < _HASTY_SHARE * self.timed:
            return None
        return (
            f"{self.hasty} of {self.timed} answers came in under a second, which is hardly enough "
            "to read a question."
        )

    def questions_in(self, minutes: int) -> int:
        """Return how many more questions fit into so many minutes, of which some are spent."""
        return max(0, round((60 * minutes - self.spent) / self.seconds))

    def minutes_for(self, questions: float) -> int:
        """Return how many whole minutes so many questions take, at least 1."""
        return max(1, round(questions * self.seconds / 60))
