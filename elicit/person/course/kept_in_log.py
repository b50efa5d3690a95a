"""An interview's own records in the answer log: the person's choices, and the state at the start.

They are metadata of the lines that say which question was asked. A program that does not know them
reads such a log as before. The state before the first answer is the loss that was possible, and
whether anything was open. Computing it takes a second for a large problem.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from elicit.person.course.level_questions import NARROW
from elicit.tutors.answer_log import Asked

CHOICES = "choices"
"""The metadata field of an asked question that holds the person's choices, if they changed."""
START = "start"
"""The metadata field of an asked question that holds the state before the first answer."""

_WIDE_BEFORE = 40.0  # width up to which questions went on by a record of an earlier version


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
    width
        Width, of 100, to which questions are to narrow the range of each level, also if the result
        is settled before. None: they end once it is settled.
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
    width: float | None = None
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
        for name in ("stopped", "other", "slowed"):
            setattr(found, name, kept.get(name) is True)
        found.width = _width_in(kept)
        passed = kept.get("passed")
        if isinstance(passed, list):
            found.passed = tuple(
                tuple(map(str, among)) for among in passed if isinstance(among, list)
            )
        return found

    @property
    def all_told(self) -> bool:
        """True if questions are to go on as long as they narrow any range that is worth one."""
        return self.width is not None and self.width <= NARROW

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


def _width_in(kept: Mapping[str, Any]) -> float | None:
    """Return the width in a record of choices. Earlier records have ``more`` or ``values``."""
    width: Any = kept.get("width")
    if type(width) in (int, float) and 0 < width <= 100:
        return float(width)
    if kept.get("more") is True:
        return NARROW
    return _WIDE_BEFORE if kept.get("values") is True else None


class Before(NamedTuple):
    """The state of knowledge before the first answer.

    Attributes
    ----------
    loss
        The share of the value range that could be lost, or None if unknown.
    finished
        True if nothing needed asking.
    """

    loss: float | None
    finished: bool

    @staticmethod
    def kept(asked: Iterable[Asked], facts: Sequence[tuple[str, str]]) -> Before | None:
        """Return the state before the first answer that a log has kept, or None.

        Parameters
        ----------
        asked : iterable of Asked
        facts : sequence of pairs
            All that the state depends on, such as the problem and the comparator. If the log has
            other facts, what it has kept does not count.
        """
        by = _as_json(facts)
        for one in asked:
            kept = one.metadata.get(START)
            if not isinstance(kept, Mapping) or kept.get("by") != by:
                continue
            loss, finished = kept.get("loss"), kept.get("finished")
            if isinstance(finished, bool) and (loss is None or type(loss) is float):
                return Before(loss, finished)
        return None

    def record(self, facts: Sequence[tuple[str, str]]) -> dict[str, Any]:
        """Return these attributes as JSON, together with ``facts``, on which they depend."""
        return {**self._asdict(), "by": _as_json(facts)}


def _as_json(facts: Sequence[tuple[str, str]]) -> list[list[str]]:
    return [list(pair) for pair in facts]


class _Begins(Protocol):
    """Protocol of an asker, with the parts that are needed here."""

    def ask(self) -> Sequence[object]:
        """Return the open questions."""

    def result(self) -> object:
        """Return the result so far."""


@dataclass(frozen=True, eq=False)
class Start:
    """The attributes of ``Before`` for a new session, each computed when it is first read."""

    asker: _Begins

    @cached_property
    def loss(self) -> float | None:
        """The share of the value range that could be lost, or None if unknown."""
        loss = getattr(self.asker.result(), "loss_bound", None)
        return float(loss) if isinstance(loss, float) and not np.isnan(loss) else None

    @cached_property
    def finished(self) -> bool:
        """True if nothing needs asking."""
        return not self.asker.ask()

    def computed(self) -> Before | None:
        """Return all attributes as ``Before`` if all of them were computed, otherwise None."""
        both = "loss" in vars(self) and "finished" in vars(self)
        return Before(self.loss, self.finished) if both else None
