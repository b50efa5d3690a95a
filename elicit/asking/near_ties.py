"""The rule for near ties: after a few answers "equal" in a row, no more such pairs are asked.

The pairs are certainly near: their values differ by no more than about the tutor's tie.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

from elicit.model.comparator import ALLOWANCE, Comparator, bounds_of
from elicit.model.query import Answer, Verdict
from elicit.model.scale import Floats

_IN_A_ROW = 5
"""After this many answers "equal" in a row, no more pairs that are certainly no farther apart than
``ALLOWANCE`` ties are asked. With one tie in place of two, value iteration asked such tutors three
times as much as sharp ones (docs/about-equal.md)."""


@dataclass(frozen=True)
class NearTies:
    """The number of answers "equal" in a row to pairs that are certainly near.

    Answers to other pairs do not change the number.

    Attributes
    ----------
    tie : float
        The comparator's tie, a share of the value range.
    counts : bool
        False if there is no tie, or if there are several people, because one person cannot say what
        others would call equal. The number then stays 0.
    """

    tie: float
    counts: bool
    in_a_row: int = 0

    @property
    def near(self) -> float:
        """The largest |d.e| of a certainly near pair, as a share of the value range."""
        return ALLOWANCE * self.tie

    @property
    def gave_up(self) -> bool:
        """True if pairs that are certainly near are no longer asked."""
        return self.in_a_row >= _IN_A_ROW

    def after(self, comparator: Comparator, d: Floats, equal: bool) -> Self:
        """Return the count after an answer about d (k,), which said ``equal`` or not."""
        low, high = bounds_of(comparator, d[None, :])
        if max(-low[0], high[0]) > self.near * (1.0 + 1e-9):
            return self
        return replace(self, in_a_row=self.in_a_row + 1 if equal else 0)

    def after_all(self, comparator: Comparator, answers: Iterable[Answer]) -> Self:
        """Return the count after these answers. "Cannot tell" does not change it."""
        found = self
        for answer in answers if self.counts else ():
            equal = answer.verdict is Verdict.EQUAL
            if equal or (found.in_a_row and answer.verdict is not None):
                found = found.after(comparator, answer.query.d, equal)
        return found
