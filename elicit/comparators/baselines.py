"""Comparators that ignore answers: Dominance asks the least, AlwaysAsk asks the most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from elicit.decision.comparator_rule import Rule, asking, silent
from elicit.decision.verdicts import decide_by_rule
from elicit.model.comparator import TIE, Verdicts, check_answers, check_levels, check_tie
from elicit.model.difference import as_differences, tail_sums
from elicit.model.query import Answers
from elicit.model.scale import Floats, order_bounds, values_of


@dataclass(frozen=True)
class _Unlearning:
    """A comparator that knows only the order of the levels, whatever the answers."""

    rule: ClassVar[Rule]  # the comparator's knowledge, as plain arrays
    k: int
    tie: float = TIE  # used by learners (see PolytopeComparator), not by verdicts and bounds

    def __post_init__(self) -> None:
        object.__setattr__(self, "k", check_levels(self.k))
        object.__setattr__(self, "tie", check_tie(self.tie))

    @property
    def values(self) -> Floats:
        """The scale (k,) with equal gaps, which is the centre of all ordered scales."""
        return values_of(np.full(self.k - 1, 1.0 / (self.k - 1)))

    def update(self, answers: Answers) -> Self:
        """Return the comparator itself, because it learns nothing from answers.

        Parameters
        ----------
        answers : Answers
            They are checked and then ignored.

        Returns
        -------
        Self
        """
        check_answers(answers, self.k)
        return self

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts (n,) on differences (n, k)."""
        return decide_by_rule(self.rule, as_differences(d, self.k)).verdicts

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return the least and the greatest d.e (n,) of rows (n, k) over every ordered scale."""
        return order_bounds(tail_sums(as_differences(d, self.k)), 0.0)

    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e over every ordered scale, and their confidence.

        Returns
        -------
        hi : (n,) in units of e_k - e_1
        confidence : float
            Always 1.
        """
        return self.bounds(d)[1], 1.0


class Dominance(_Unlearning):
    """A comparator that decides by dominance alone: only differences on which every scale agrees.

    It needs no answers. Dominance is the paper's eq. (4).

    Parameters
    ----------
    k : int
        Number of levels.
    tie : float
        Largest |d.e| that the tutor may call equal, as in ``PolytopeComparator``. Learners use it;
        verdicts and bounds do not depend on it.
    """

    rule = silent()


class AlwaysAsk(_Unlearning):
    """A comparator that says UNKNOWN for every difference but 0.

    So the tutor decides everything, and a truthful tutor makes it a baseline without errors.

    Parameters
    ----------
    k : int
        Number of levels.
    tie : float
        Largest |d.e| that the tutor may call equal, as in ``PolytopeComparator``. Learners use it;
        verdicts and bounds do not depend on it.
    """

    rule = asking()
