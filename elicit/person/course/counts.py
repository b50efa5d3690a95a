"""Counts of the answers in a log, and the sentence on them in every screen, report and command."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass

from elicit.model.query import Verdict
from elicit.person.course.conclusion import listed
from elicit.person.course.conduct import IN_CONFLICT, SETTLED, differs, repeats_in, was_settled
from elicit.tutors.answer_log import Entry


@dataclass(frozen=True)
class Counts:
    """Numbers of answers of each kind in a log.

    Attributes
    ----------
    answered
        Answers that count: those that stand, and each answer to a repeated question, even if the
        person has settled a difference since. Except for the last two, all other numbers are parts
        of this one.
    repeated
        Answers to repeated questions.
    alike
        Those of them that are the same as before.
    equal, cannot_tell
        Answers "equally good" and "cannot tell".
    unused
        Answers that are ignored because they contradict others.
    withdrawn
        Answers that the person took back, which are not in ``answered``.
    not_kept
        Answers that the person did not keep because they contradicted others, which are not in
        ``answered`` either.
    """

    answered: int = 0
    repeated: int = 0
    alike: int = 0
    equal: int = 0
    cannot_tell: int = 0
    unused: int = 0
    withdrawn: int = 0
    not_kept: int = 0

    @staticmethod
    def of(log: Iterable[Entry]) -> Counts:
        """Return the counts of a log."""
        entries = [*log]
        again = repeats_in(entries)
        first = [entry for entry in entries if entry.stands and not entry.repeat]
        said = [entry.answer.verdict for entry in entries if is_counted(entry)]
        back = [entry for entry in entries if entry.retracted and not was_settled(entry)]
        return Counts(
            answered=len(said),
            repeated=len(again),
            alike=sum(not differs(entry) for entry in again),
            equal=said.count(Verdict.EQUAL),
            cannot_tell=said.count(None),
            unused=sum(not entry.used for entry in first),
            withdrawn=len(back) - sum(IN_CONFLICT in (entry.retraction or {}) for entry in back),
            not_kept=sum(IN_CONFLICT in (entry.retraction or {}) for entry in back),
        )

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

        The numbers are no parts of a sum: a repeated question may be answered "equally good".
        """
        kinds = (
            (self.repeated, "to repeated questions"),
            (self.equal, "“equally good”"),
            (self.cannot_tell, "“cannot tell”"),
            (self.unused, "ignored for contradicting others"),
        )
        among = [f"{_were(n)} {words}" for n, words in kinds if n]
        back = f" {_were(self.withdrawn, ' more')} taken back." if self.withdrawn else ""
        if self.not_kept:
            back += f" {_were(self.not_kept, ' more')} not kept, for contradicting others."
        of_these = f" Of these, {listed(among)}." if among else ""
        return f"{in_answers(self.answered)}.{of_these}{back}"

    @property
    def checks(self) -> str:
        """A sentence on how repeated questions were answered, or ""."""
        if not self.repeated:
            return ""
        questions = "question was" if self.repeated == 1 else "questions were"
        return f"{self.alike} of {self.repeated} repeated {questions} answered as before."


def is_counted(entry: Entry) -> bool:
    """Return whether an answer is one of ``Counts.answered``."""
    return entry.stands or (entry.repeat and was_settled(entry))


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


def _were(n: int, more: str = "") -> str:
    return f"{n}{more} {'was' if n == 1 else 'were'}"


def in_answers(n: int) -> str:
    """Return a number of answers in words."""
    return f"{n} answer{'' if n == 1 else 's'}"
