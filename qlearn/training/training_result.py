"""What ``InteractiveTraining`` has found, and where it stands, in sentences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

from elicit.asking.elicitation import Audit
from elicit.model.comparator import Comparator
from elicit.model.outcomes import Status
from elicit.model.query import Answers
from elicit.model.scale import Floats
from qlearn.certificates.loss_bound import Guarantee


class TrainedPolicy(NamedTuple):
    """A policy that was brought in: its ``shares`` (k,), of total 1, which no scale sees farther than ``error`` from
    the true ones, and the scale (k,) that it was trained on, or None."""

    policy: Any
    shares: Floats
    error: float
    trained_on: Floats | None


@dataclass(frozen=True, eq=False, repr=False)
class TrainingResult:
    """What is known so far. ``policy``: the best at the comparator's central scale, None before the first, and its
    ``shares`` (k,); ``asked``: questions told, audits not counted; ``trained``: policies trained on a scale it gave;
    ``policies``: all that were brought in, in order; ``observed_gap``: by how much a policy beat another one, at most,
    at the scale that the latter was trained on: so much at least that training fell short of its optimum."""

    policy: Any
    shares: Floats | None
    status: Status
    asked: int
    trained: int
    observed_gap: float
    policies: tuple[TrainedPolicy, ...]
    comparator: Comparator
    answers: Answers
    audits: tuple[Audit, ...]
    cannot_tell: int
    guarantee: Callable[[], Guarantee] = field(repr=False)

    def __repr__(self) -> str:
        return (
            f"TrainingResult(status={self.status.name}, asked={self.asked}, trained={self.trained}, "
            f"observed_gap={self.observed_gap:.3g})"
        )

    @cached_property
    def _guaranteed(self) -> Guarantee:
        return self.guarantee()

    @property
    def loss_bound(self) -> float:
        """The policy loses at most this share of the value range against the best there is, if each training came
        within ``optimality_gap`` of its optimum. nan where no gap was given, or where it is seen not to hold."""
        return float(self._guaranteed.loss_bound)

    @property
    def confidence(self) -> float:
        """How certain ``loss_bound`` is, if the gap holds: that of the comparator (1: proven of every scale that fits
        the answers), less the chance that measured shares are off by more than ``STANDARD_ERRORS``; nan where no bound
        or no confidence can be stated."""
        return float(self._guaranteed.confidence)

    @property
    def audited(self) -> int:
        """How many settled comparisons were put to the tutor."""
        return len(self.audits)
