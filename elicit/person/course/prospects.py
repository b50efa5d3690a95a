"""Prospects of an interview: what so many questions will likely prove, by simulated sessions."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from elicit.model.query import Answer
from elicit.person.asker import Asker, Compares, tell
from elicit.person.course.repeats import LEAST_CHECKS
from elicit.person.outlook import plausible_tutors

_RUNS = 12  # simulated sessions at most
_FEWEST = 4  # sessions that are worth a sentence
_SECONDS = 60.0  # time limit of all of them, except for a last step
_CHECKS = 5  # one question in so many is a check, which proves nothing new, but at least four are


@dataclass(frozen=True)
class Prospect:
    """Outcomes of simulated sessions that end after so many questions.

    Attributes
    ----------
    questions : int
        The questions, checks among them.
    sessions : int
        Number of simulated sessions.
    settled : int
        Sessions in which nothing was left to ask by then.
    loss : float
        Median of what could still be lost, a share of the value range. It is nan if unknown.
    """

    questions: int
    sessions: int
    settled: int
    loss: float


class Prospects:
    """What so many questions will likely prove. One thread may compute it while others read.

    Parameters
    ----------
    twin : Asker
        A copy of the asker before its first answer. It is not changed.
    questions : sequence of int
        Numbers of questions, ascending.
    seed : int
        Seed of the simulations.
    ends : callable
        Returns whether a session ends in front of a query.
    """

    def __init__(
        self, twin: Asker, questions: Sequence[int], seed: int, ends: Callable[..., bool]
    ) -> None:
        self._twin, self._questions, self._seed, self._ends = twin, tuple(questions), seed, ends
        self._losses: list[list[float]] = []  # of each session, after each number of questions
        self._lengths: list[int] = []
        self.ready = False
        """True if nothing will be added."""

    def steps(self) -> Iterator[None]:
        """Compute in steps, of one simulated answer each."""
        try:
            until = time.monotonic() + _SECONDS
            known = self._twin.comparator if isinstance(self._twin, Compares) else None
            for says in plausible_tutors(known, self._seed, "prospects", range(_RUNS)):
                asker, asked, losses = copy.deepcopy(self._twin), 0, []
                for budget in self._questions:
                    while asked < _proving(budget):
                        query = next(iter(asker.ask()), None)
                        if query is None or self._ends(query):
                            break
                        tell(asker, Answer(query, says(query)))
                        asked += 1
                        yield
                        if time.monotonic() > until:
                            return
                    losses.append(_loss(asker))
                    yield
                self._losses.append(losses)
                self._lengths.append(asked)
        finally:
            self.ready = True

    def found(self) -> list[Prospect]:
        """Return what is known by now, for each number of questions; empty if it is too little."""
        lengths, losses = [*self._lengths], [*self._losses]
        n = len(lengths)
        if n < _FEWEST:
            return []
        return [
            Prospect(
                budget,
                n,
                sum(length < _proving(budget) for length in lengths),
                sorted(one[i] for one in losses[:n])[n // 2],
            )
            for i, budget in enumerate(self._questions)
        ]

    def length(self) -> int | None:
        """Return how many questions, checks among them, suffice in half of the sessions, or None.

        None if too few sessions were simulated, or half of them did not end.
        """
        lengths = sorted(self._lengths)
        if len(lengths) < _FEWEST:
            return None
        half = lengths[len(lengths) // 2]
        if half >= _proving(self._questions[-1]):
            return None
        return half + max(LEAST_CHECKS, half // (_CHECKS - 1))


def _proving(questions: int) -> int:
    """Return how many of so many questions are no checks."""
    return max(0, questions - max(LEAST_CHECKS, questions // _CHECKS))


def _loss(asker: Asker) -> float:
    loss = getattr(copy.deepcopy(asker).result(), "loss_bound", math.nan)
    return float(loss) if isinstance(loss, int | float) else math.nan
