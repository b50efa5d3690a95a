"""The state before the first answer: the loss that was possible, and if anything was open.

Computing it takes a second for a large problem, so the log keeps it, as metadata of a line that
says which question was asked. A program that does not know it reads such a log as before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from elicit.tutors.answer_log import Asked

START = "start"
"""The metadata field of an asked question that holds the state before the first answer."""


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
