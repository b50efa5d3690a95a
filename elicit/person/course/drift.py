"""Drift within a session: a test of whether repeats differ more often in one of its halves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

from elicit.person.course.conduct import differs, repeats_in
from elicit.tutors.answer_log import Entry

_SIGNIFICANT = 0.05  # p-value below which a difference is said: 1 in 20 without any drift


@dataclass(frozen=True)
class Drift:
    """Numbers of repeats in each half of a session, and of those answered differently.

    Attributes
    ----------
    first, second
        Number of repeats in each half.
    first_differed, second_differed
        Number of these that were answered differently from the first time.
    """

    first: int
    first_differed: int
    second: int
    second_differed: int

    @staticmethod
    def of(log: Sequence[Entry]) -> Drift:
        """Return the drift in a log, whose halves have the same number of lines."""
        again = {id(entry) for entry in repeats_in(log)}
        halves = log[: len(log) // 2], log[len(log) // 2 :]
        counts = [
            (len(repeats), sum(map(differs, repeats)))
            for half in halves
            for repeats in [[entry for entry in half if id(entry) in again]]
        ]
        return Drift(*counts[0], *counts[1])

    @property
    def p_value(self) -> float:
        """Two-sided p-value of Fisher's exact test."""
        differed, n = self.first_differed + self.second_differed, self.first + self.second
        least, most = max(0, differed - self.second), min(differed, self.first)
        ways = [
            comb(self.first, i) * comb(self.second, differed - i) for i in range(least, most + 1)
        ]
        found = ways[self.first_differed - least]
        return sum(one for one in ways if one <= found) / comb(n, differed)

    def remark(self) -> str | None:
        """Return a sentence on a significant drift, or None."""
        if self.p_value >= _SIGNIFICANT:
            return None
        said = (
            f"You answered {self.first_differed} of {self.first} repeated questions differently in "
            f"the first half, and {self.second_differed} of {self.second} in the second."
        )
        if self.second_differed * self.first > self.first_differed * self.second:
            return f"{said} Your later answers may be less reliable: a break can help."
        return f"{said} Your first answers may be less reliable: you can take them back."
