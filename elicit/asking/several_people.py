"""Choice of the one of several people to ask about a pair, and the verdict of all of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from elicit._support.fixed_order import product
from elicit.asking.answered_pairs import AnsweredPairs
from elicit.asking.question import Pair
from elicit.decision.verdicts import decide
from elicit.model.comparator import Comparator, bounds_of
from elicit.model.comparator_parts import best_guess, people_of, whom_of
from elicit.model.difference import tail_sums
from elicit.model.query import Verdict
from elicit.model.scale import Floats

_GUESS_GRID = 2.0**40
"""Best guesses that differ by less than the inverse of this count as equal, because rounding alone
makes such differences."""


@dataclass(frozen=True)
class CannotTell:
    """For each of several people, the pairs they could not tell or contradicted themselves on."""

    pairs: Mapping[str, AnsweredPairs] = field(default_factory=dict)

    def names(self, pair: Pair) -> tuple[str, ...]:
        """Return the names of the people who cannot tell this pair."""
        t = tail_sums((pair.left - pair.right)[None])
        said = {name: pairs.said(t)[0] for name, pairs in self.pairs.items()}
        return tuple(name for name, verdict in said.items() if verdict != Verdict.UNKNOWN)

    def adding(self, who: str | None, d: Floats) -> Self:
        """Return a copy with one more pair, of difference d (k,), that ``who`` cannot tell."""
        if who is None:
            return self
        pairs = self.pairs[who].copy() if who in self.pairs else AnsweredPairs(len(d))
        pairs.add(d, Verdict.EQUAL, binding=False)
        return type(self)({**self.pairs, who: pairs})


def addressed(comparator: Comparator, pair: Pair, cannot: CannotTell) -> Pair:
    """Return a pair addressed to a person, whom the comparator chooses.

    The comparator may ask the person about a shifted pair, with some of the best level added to one
    side and as much of the worst to the other. The pair is returned as it is if it names a person
    already, or if the comparator is of one person.
    """
    people = people_of(comparator)
    if pair.who is not None or not people:
        return pair
    left, right, about = pair.left, pair.right, pair.about
    asked = whom_of(comparator, left - right, cannot.names(pair))
    if asked is None:
        return pair._replace(who=people[0])
    if (asked.d != left - right).any():
        more = asked.d - (left - right)
        left, right = left + np.maximum(more, 0.0), right + np.maximum(-more, 0.0)
        total = max(left.sum(), right.sum())
        left, right = left / total, right / total
        about = f"{about} (mixed with the worst and the best level)"
    return pair._replace(left=left, right=right, about=about, who=asked.who)


def nobody_left(comparator: Comparator, pair: Pair, cannot: CannotTell) -> bool:
    """Return whether no further answer about a pair would help, whoever is asked."""
    return whom_of(comparator, pair.left - pair.right, cannot.names(pair)) is None


def verdict_of_all(
    comparator: Comparator, pair: Pair, cannot: CannotTell, indifference: float
) -> Verdict:
    """Return the verdict of several people on a pair; UNKNOWN if another person is to be asked.

    If no further answer would help, the comparator's best guess decides.
    """
    d = (pair.left - pair.right)[None]
    now = Verdict(int(decide(comparator, d).verdicts[0]))
    if now != Verdict.UNKNOWN:
        return now
    low, high = bounds_of(comparator, d)
    if max(-low[0], high[0]) <= indifference:
        return Verdict.EQUAL
    if not nobody_left(comparator, pair, cannot):
        return Verdict.UNKNOWN
    at = float(product(tail_sums(d), np.diff(best_guess(comparator)))[0])
    return Verdict(int(np.sign(round(at * _GUESS_GRID))))
