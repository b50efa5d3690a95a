"""The words of a problem, and sentences that a conclusion about a policy or a choice shares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elicit.asking.choose_from_list import Choice
from elicit.model.comparator_parts import wrong_of
from elicit.model.outcomes import assumed_of_answers
from elicit.person.course.conclusion import (
    NO_LOSS,
    capital,
    in_unit,
    per_hundred,
    with_probability,
)
from elicit.person.showing import Words
from qlearn.learners.learner import Result

_LITTLE = 4.0  # tolerances that count as little (see InWords.little)
_STATED = 0.01  # finer numbers make nobody surer
_OF_BEFORE = 2 / 3  # a loss is not little if it is a larger share of that before the first answer


@dataclass(frozen=True)
class InWords:
    """The words of a problem, in which a result is told.

    Attributes
    ----------
    labels, words
        Those of the problem.
    tolerance
        The share of the value range at which questions end.
    states, plan
        What the problem calls states, in the plural, and a policy.
    legend
        What the names of states and actions mean, in sentences.
    state_words
        A function that returns a state in words, from its name.
    alternative
        What the problem calls an alternative, in the singular, such as "treatment".
    caveat
        A function that returns sentences on what a plan must not be taken for, or "".
    """

    labels: tuple[str, ...]
    words: Words
    tolerance: float
    states: str = "states"
    plan: str = "plan"
    legend: str = ""
    state_words: Callable[[str], str] = str
    alternative: str = "alternative"
    caveat: Callable[[], str] = str

    @property
    def little(self) -> float:
        """The share of the value range that counts as little.

        Stopping is offered if no more can be lost, and alternatives that are worth so much less
        than the best are named beside it.
        """
        return _LITTLE * self.tolerance

    def stated(self, loss: float) -> float:
        """Return a bound on a loss as it is stated: no finer than 1 in 100, or the tolerance."""
        return loss if loss < NO_LOSS else max(loss, min(_STATED, self.tolerance))

    def loss(self, share: float) -> str:
        """Return a loss in the problem's own unit, as a text that follows "it loses at most"."""
        return in_unit(share, self.words.unit, self.labels, self.words.loss)


def size_of(told: InWords, loss: float, what: str, confidence: float) -> str:
    """Return a sentence on how much a loss is, in the problem's own unit, or "" if unknown.

    Nothing is said of a loss that is shown as none, because "as if 0 in 100 patients died" has no
    size. ``what`` is the loss in words, before "at most" and its size, and ``confidence`` how sure
    that is.
    """
    if np.isnan(loss) or loss < NO_LOSS:
        return ""
    sure = with_probability(confidence)
    end = f" ({sure})" if sure else ""
    return f"{capital(what)} at most {told.loss(loss)}{end}."


def size_and_end(told: InWords, loss: float, what: str, confidence: float, settled: bool) -> str:
    """Return ``size_of`` and, if it is not ``settled``, when questions end.

    The result is "" if nothing can be lost.
    """
    size = size_of(told, loss, what, confidence)
    return size if settled or loss < NO_LOSS else f"{size} {until(told)}".strip()


def until(told: InWords) -> str:
    """Return a sentence on when questions end."""
    return f"The result counts as settled below {per_hundred(told.tolerance)}."


def is_little(told: InWords, loss: float, before: float | None) -> bool:
    """Return whether so little can be lost that more questions may not be worth it."""
    return loss <= (told.little if before is None else min(told.little, _OF_BEFORE * before))


def sure_of(result: Result | Choice) -> str:
    """Return a sentence on how certain the bound on the loss is."""
    sure = condition_of(result)
    return "How sure this is cannot be stated." if sure is None else f"This holds {sure}."


def condition_of(result: Result | Choice) -> str | None:
    """Return how certain the bound on the loss is, such as "with 95% probability", or None."""
    if result.confidence == 1.0:
        return assumed_of_answers(wrong_of(result.comparator), "your")
    return with_probability(result.confidence) or None
