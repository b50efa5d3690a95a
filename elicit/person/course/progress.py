"""Progress of an interview, for whoever runs a study of several people."""

from __future__ import annotations

from dataclasses import dataclass

from elicit.model.comparator import Comparator
from elicit.tutors.answer_log import Entry


@dataclass(frozen=True, eq=False)
class Progress:
    """The point at which an interview stood after its last message.

    Attributes
    ----------
    entries : tuple of Entry
        The answers so far, also those that were taken back.
    comparator : Comparator or None
        What is known of the person's scale. None if the asker does not say.
    stage : str or None
        The stage of the last screen. None as long as the person did not come.
    settled : bool
        True if that screen was a result that is settled.
    minutes : int or None
        The time that the person planned.
    """

    entries: tuple[Entry, ...]
    comparator: Comparator | None
    stage: str | None = None
    settled: bool = False
    minutes: int | None = None

    @property
    def answered(self) -> int:
        """Number of answers that stand, without the repeated questions."""
        return sum(not entry.retracted and not entry.repeat for entry in self.entries)

    @property
    def last(self) -> str | None:
        """The time of the last answer, as the log has it."""
        times = [entry.metadata.get("time") for entry in self.entries]
        return times[-1] if times else None
