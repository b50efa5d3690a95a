"""The two comparators that learn nothing from answers: Dominance, which asks least, and AlwaysAsk, which asks most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from elicit.decision.comparator_rule import Rule, asking, silent
from elicit.decision.verdicts import decide_by
from elicit.model.comparator import TIE, Verdicts, check_answers, check_levels, check_tie
from elicit.model.query import Answers
from elicit.model.scale import Floats, as_differences, order_bounds, tail_sums, values_of


@dataclass(frozen=True)
class _Unlearning:
    """Only the order of the levels is known, and no answer changes that."""

    rule: ClassVar[Rule]  # what it knows, as plain arrays
    k: int
    tie: float = TIE  # learners go by it (see PolytopeComparator); verdicts and bounds do not

    def __post_init__(self) -> None:
        object.__setattr__(self, "k", check_levels(self.k))
        object.__setattr__(self, "tie", check_tie(self.tie))

    @property
    def values(self) -> Floats:
        """(k,) the centre of K_0: equal gaps."""
        return values_of(np.full(self.k - 1, 1.0 / (self.k - 1)))

    def update(self, answers: Answers) -> Self:
        """Itself: answers teach it nothing."""
        check_answers(answers, self.k)
        return self

    def compare(self, d: ArrayLike) -> Verdicts:
        """Verdicts (n,) on differences d (n, k)."""
        return decide_by(self.rule, as_differences(d, self.k)).verdicts

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Least and greatest d.e (n,) over every ordered scale."""
        return order_bounds(tail_sums(as_differences(d, self.k)), 0.0)

    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Upper bounds (n,) on d.e over every ordered scale, and their confidence, 1."""
        return self.bounds(d)[1], 1.0


class Dominance(_Unlearning):
    """Eq. (4) alone: decides what holds for every scale, and needs no answers."""

    rule = silent()


class AlwaysAsk(_Unlearning):
    """UNKNOWN for every difference but 0. With a truthful tutor it is the oracle baseline."""

    rule = asking()
