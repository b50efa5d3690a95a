"""A person's choices about the course of an interview, which are kept in the answer log.

In the log they are metadata of the lines that say which question was asked. A program that does not
know them reads such a log as before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from elicit.tutors.answer_log import Asked

CHOICES = "choices"
"""The metadata field of an asked question that holds the person's choices, if they changed."""


@dataclass
class Choices:
    """A person's choices about the course of an interview.

    Attributes
    ----------
    budget
        Number of questions that the person planned; None if they planned none.
    minutes
        Number of minutes that the person has; None if they did not say.
    offered
        Number of answers when the person last answered an offer.
    heard
        Number of answers when the person last continued after a caution.
    stopped
        True if they want the result now.
    more
        True if they want more questions than needed.
    other
        True if they want another kind of question.
    slowed
        True if they were told that some answers came very fast.
    passed
        Conflicts that are left as they are, each as the sorted ids of its answers.
    """

    budget: int | None = None
    minutes: int | None = None
    offered: int = 0
    heard: int = 0
    stopped: bool = False
    more: bool = False
    other: bool = False
    slowed: bool = False
    passed: tuple[tuple[str, ...], ...] = ()

    @staticmethod
    def of(asked: Iterable[Asked]) -> Choices:
        """Return the choices in the last line of a log that has any.

        A part that is missing or invalid has its initial value.
        """
        kept: Any = {}
        for one in asked:
            kept = one.metadata.get(CHOICES, kept)
        if not isinstance(kept, Mapping):
            return Choices()
        found = Choices()
        for name, least in (("budget", 1), ("minutes", 1), ("offered", 0), ("heard", 0)):
            if type(kept.get(name)) is int and kept[name] >= least:
                setattr(found, name, kept[name])
        for name in ("stopped", "more", "other", "slowed"):
            setattr(found, name, kept.get(name) is True)
        passed = kept.get("passed")
        if isinstance(passed, list):
            found.passed = tuple(
                tuple(map(str, among)) for among in passed if isinstance(among, list)
            )
        return found

    def record(self) -> dict[str, Any]:
        """Return the choices as JSON."""
        return {**asdict(self), "passed": [list(among) for among in self.passed]}

    def leave(self, ids: Iterable[str]) -> None:
        """Note that a conflict among the answers of these ids is left as it is."""
        among = tuple(sorted(ids))
        if among not in self.passed:
            self.passed = (*self.passed, among)

    def leaves(self, ids: Iterable[str]) -> bool:
        """Return whether a conflict among the answers of these ids was left as it is."""
        return tuple(sorted(ids)) in self.passed
