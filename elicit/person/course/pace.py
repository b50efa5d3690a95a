"""A person's pace: seconds for each question, and answers that came too fast to be meant."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import median

from elicit.person.course.counts import is_counted
from elicit.tutors.answer_log import Entry

SECONDS = 20.0
"""Seconds that a question is taken to last until the person's own pace is known."""
HASTY = 1.0
"""Seconds in which hardly anyone reads a question."""
FEW_HASTY = 3
"""Answers in under a second that are worth a remark."""
_KNOWN_AFTER = 3  # answers: from then on the person's own times count, by a fifth more each time
_STEPS = 5
_BREAK = 300.0  # seconds: a person who takes longer was away, and the rest does not count


@dataclass(frozen=True)
class Pace:
    """The pace of the answers in a log.

    Attributes
    ----------
    seconds
        Seconds for each question: the median of the person's own, once seven are known. From the
        third answer on, it comes nearer to that with each answer, so that forecasts do not jump.
    spent
        Seconds spent on all answers so far, without breaks.
    hasty
        Number of answers that came in under a second.
    answered
        Number of answers, as the screens count them.
    """

    seconds: float = SECONDS
    spent: float = 0.0
    hasty: int = 0
    answered: int = 0

    @staticmethod
    def of(log: Iterable[Entry]) -> Pace:
        """Return the pace of the answers of a log that count."""
        said = [entry.metadata.get("latency") for entry in log if is_counted(entry)]
        took = [float(one) for one in said if isinstance(one, int | float) and one >= 0]
        share = min(1.0, max(0, len(took) - _KNOWN_AFTER + 1) / _STEPS)
        own = SECONDS + share * (median(took) - SECONDS) if share else SECONDS
        return Pace(
            seconds=max(own, HASTY),
            spent=sum(one if one <= _BREAK else own for one in took),
            hasty=sum(one < HASTY for one in took),
            answered=len(said),
        )

    def remark(self) -> str | None:
        """Return a sentence on answers that came very fast, or None if they were few.

        No share of all answers is asked for: more answers that take longer would then silence it,
        although the fast ones still count.
        """
        if self.hasty < FEW_HASTY:
            return None
        return (
            f"{self.hasty} of {self.answered} answers came in under a second, which is hardly "
            "enough to read a question."
        )

    def questions_in(self, minutes: int) -> int:
        """Return how many more questions fit into ``minutes``, of which some are already spent."""
        return max(0, round((60 * minutes - self.spent) / self.seconds))

    def minutes_for(self, questions: float) -> int:
        """Return how many whole minutes this number of questions takes, at least 1."""
        return max(1, round(questions * self.seconds / 60))
