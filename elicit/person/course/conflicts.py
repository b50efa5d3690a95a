"""Conflicts: answers that contradict each other, and what each choice of the person would change.

``TakenAsRight`` finds the answers, and what follows from them all. ``Consequences`` has the values
of levels, and the answers kept, after each choice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, Generic, TypeVar

from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator, bounds_of
from elicit.model.comparator_parts import tie_of, unordered_of
from elicit.model.query import Answers, InconsistentAnswers
from elicit.model.scale import Floats
from elicit.tutors.answer_log import Entry

# share of the value range by which two sides called equal may differ without a contradiction: half
# a person of ten
_ABOUT_EQUAL = 0.05
_CERTAIN = 1e-9  # difference, a share of the value range, from which one side is certainly better

T = TypeVar("T")


class TakenAsRight:
    """Answers that are each taken as right, even if the asker's comparator allows for errors.

    With a comparator other than a polytope, two things that a person calls equal may still differ
    by 5% of the value range, or by its ``tie`` if that is more. Every ``told`` below is a sequence
    of answers with a verdict, in their order.

    Parameters
    ----------
    known : callable
        Returns the asker's comparator, or None if it has none.
    """

    def __init__(self, known: Callable[[], Comparator | None]) -> None:
        self._known = known
        # a comparator that takes all answers as true, those it was offered, and those it took
        self._learned: tuple[PolytopeComparator, list[Any], list[Entry]] | None = None

    def forget(self) -> None:
        """Discard what was learned. It is learned again when it is next needed."""
        self._learned = None

    def conflicts(self, told: Sequence[Entry]) -> tuple[tuple[Entry, ...], ...]:
        """Return sets of answers that contradict each other, whatever the scale.

        If any one of a set were withdrawn, the others of that set would be consistent. No answer is
        in two sets. Answers of different people do not contradict each other.
        """
        people = dict.fromkeys(entry.answer.who for entry in told)
        each = ([entry for entry in told if entry.answer.who == who] for who in people)
        return tuple(found for own in each for found in self._conflicts_of(own))

    def _conflicts_of(self, rest: list[Entry]) -> list[tuple[Entry, ...]]:
        """Return the ``conflicts`` among the answers of one person."""
        found: list[tuple[Entry, ...]] = []
        while rest:
            comparator = self._empty(len(rest[0].answer.query.left))
            try:
                comparator.update(Answers.of([entry.answer for entry in rest], comparator.k))
                break
            except InconsistentAnswers as error:
                rows = sorted({row for row, _ in error.answers})
                found.append(tuple(rest[row] for row in rows))
                rest = [entry for row, entry in enumerate(rest) if row not in rows]
        return found

    def contradiction(self, told: Sequence[Entry]) -> tuple[Entry, ...]:
        """Return answers that contradict each other, with the last answer among them.

        They are of the person who gave that one. The result is empty if it contradicts no earlier
        ones.
        """
        *earlier, last = rest = [e for e in told if e.answer.who == told[-1].answer.who]
        comparator, kept = self._learn(earlier, len(last.answer.query.left))
        among: tuple[Entry, ...] = ()
        try:
            comparator = comparator.update(Answers.of([last.answer], comparator.k))
            kept = [*kept, last]
        except InconsistentAnswers as error:
            both = [*kept, last]
            among = tuple(both[row] for row in sorted({row for row, _ in error.answers}))
        self._learned = comparator, _said(rest), kept
        return among

    def imply(self, told: Sequence[Entry], d: Floats) -> bool:
        """Return whether the answers of one person say which side of a difference d (k,) is better.

        Answers that contradict earlier ones are left out.
        """
        comparator, _ = self._learn(told, len(d))
        low, high = bounds_of(comparator, d[None, :])
        return bool(low[0] > _CERTAIN or high[0] < -_CERTAIN)

    def comparator(self, told: Sequence[Entry]) -> PolytopeComparator | None:
        """Return a comparator that has learned the answers, or None.

        It is None if there are none, if they contradict each other, if several people gave them, or
        if the order of two levels is open.
        """
        known = self._known()
        opens = known is not None and unordered_of(known) is not None
        if not told or opens or len({entry.answer.who for entry in told}) > 1:
            return None
        comparator, kept = self._learn(told, len(told[0].answer.query.left))
        return comparator if len(kept) == len(told) else None

    def _learn(self, told: Sequence[Entry], k: int) -> tuple[PolytopeComparator, list[Entry]]:
        """Return a comparator that takes answers as facts, and the answers that it has learned.

        Answers that contradict earlier ones are left out. The result is kept, because it is often
        needed again for the same answers.
        """
        said = _said(told)
        if self._learned is not None and self._learned[1] == said:
            return self._learned[0], self._learned[2]
        comparator, kept = self._empty(k), list[Entry]()
        for entry in told:
            try:
                comparator = comparator.update(Answers.of([entry.answer], comparator.k))
                kept.append(entry)
            except InconsistentAnswers:
                pass  # brought up when it was the last one
        self._learned = comparator, said, kept
        return comparator, kept

    def _empty(self, k: int) -> PolytopeComparator:
        """Return a comparator without answers that takes each answer as true."""
        known = self._known()
        if known is None:
            return PolytopeComparator(k)
        if isinstance(known, PolytopeComparator):
            return PolytopeComparator(k, known.margin, known.prior, known.tie)
        # who counts in ten people must round, and such a comparator learns how far "equal" reaches
        return PolytopeComparator(k, tie=max(tie_of(known), _ABOUT_EQUAL))


def _said(entries: Sequence[Entry]) -> list[Any]:
    """Return the ids and verdicts of answers, by which two lists of answers are compared."""
    return [(entry.answer.query.id, entry.answer.verdict) for entry in entries]


class Consequences(Generic[T]):
    """The consequences of each choice in a conflict. One thread computes them while others read.

    Parameters
    ----------
    id : str
        Of the conflict.
    suppose : mapping
        For each choice, a function that returns the state after it.
    sentence : callable
        Takes such a state, and returns it in a few words.
    """

    def __init__(
        self,
        id: str,
        suppose: Mapping[str, Callable[[], T]],
        sentence: Callable[[T], str],
    ) -> None:
        self.id = id
        self._suppose, self._sentence = dict(suppose), sentence
        self._found: dict[str, str] = {}
        self.ready = False
        """True if nothing will be added."""

    def steps(self) -> Iterator[None]:
        """Compute the consequences of one choice in each step.

        A choice is left out if its function raises ValueError, as for answers that contradict each
        other.
        """
        try:
            for choice, suppose in self._suppose.items():
                with suppress(ValueError):  # also for answers that contradict each other
                    self._found[choice] = self._sentence(suppose())
                yield
        finally:
            self.ready = True

    def found(self) -> dict[str, str]:
        """Return the sentences that are known by now, by choice."""
        return dict(self._found)
