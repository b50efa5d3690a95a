"""The result of ``InteractiveTraining`` and its status, in sentences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

from elicit.asking.question import Audit
from elicit.model.comparator import Comparator
from elicit.model.outcomes import Status
from elicit.model.query import Answers
from elicit.model.scale import Floats
from qlearn.certificates.loss_bound import Guarantee


class TrainedPolicy(NamedTuple):
    """A policy that was added to the training.

    Attributes
    ----------
    policy : object
        The policy, as it was given.
    shares : (k,)
        Its shares, of total 1.
    error : float
        The value of the shares under any scale is within this of the true one, as a share of the
        value range.
    trained_on : (k,) or None
        The scale that the policy was trained on, or None.
    """

    policy: Any
    shares: Floats
    error: float
    trained_on: Floats | None


@dataclass(frozen=True, eq=False, repr=False)
class TrainingResult:
    """The result of an interactive training so far.

    Attributes
    ----------
    policy : object
        The best policy at the comparator's central scale, None before the first.
    shares : (k,)
        The shares of ``policy``, None before the first.
    status : Status
        Why the training stopped, or what it waits for.
    asked : int
        Number of questions answered, without audits.
    trained : int
        Number of policies trained on a scale that ``InteractiveTraining`` gave.
    observed_gap : float
        A lower bound on how far some training fell short of its optimum: the most by which another
        policy is better, at the scale that was trained on.
    policies : tuple of TrainedPolicy
        All policies that were added, in order.
    comparator : Comparator
        The comparator with all answers that it learned.
    answers : Answers
        These answers.
    audits : tuple of Audit
        The decided comparisons that were put to the tutor all the same, with the answers.
    cannot_tell : int
        Number of questions that got no verdict.
    guarantee : function
        Computes ``loss_bound`` and ``confidence``.
    """

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
            f"TrainingResult(status={self.status.name}, asked={self.asked}, "
            f"trained={self.trained}, "
            f"observed_gap={self.observed_gap:.3g})"
        )

    @cached_property
    def _guaranteed(self) -> Guarantee:
        return self.guarantee()

    @property
    def loss_bound(self) -> float:
        """Upper bound on the policy's loss against all policies, a share of the value range.

        It holds if each training came within ``optimality_gap`` of its optimum. It is nan if no gap
        was given, or if the policies refute the gap.
        """
        return float(self._guaranteed.loss_bound)

    @property
    def confidence(self) -> float:
        """The probability that ``loss_bound`` holds, if each training came within its gap.

        It is the comparator's confidence, minus the probability that a measured share is off by
        more than ``STANDARD_ERRORS`` standard errors. The comparator's confidence is 1 if the bound
        is proven for every scale that fits the answers. The result is nan if there is no bound, or
        if no probability can be stated.
        """
        return float(self._guaranteed.confidence)

    @property
    def audited(self) -> int:
        """Number of decided comparisons that were still put to the tutor, to find errors."""
        return len(self.audits)
