"""Streams of differences as a learner really puts them to a comparator, recorded while it learns.

A learner compares vectors that are nearly equal, near ties and again and again the same, and asks the
tutor in between. Random differences over a random K_t have none of that, so costs are measured on these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from elicit import Answers, PolytopeComparator, TruthfulTutor, Verdict
from elicit.comparator import Decisions, Verdicts
from elicit.lp import TIE_BAND
from elicit.scale import Floats, dominance, tail_sums
from qlearn import InteractiveQLearning, InteractiveValueIteration, drive, random_mdp

Kind: TypeAlias = Literal["Q-learning", "IVI"]
KINDS: tuple[Kind, ...] = ("Q-learning", "IVI")


class Segment(NamedTuple):
    """The differences d (n, k) put to the comparator while it knew the first ``known`` answers."""

    known: int
    d: Floats


@dataclass(frozen=True)
class Stream:
    """What one run put to its comparator, in order. ``answers``: all that were told; ``decided``: the
    run's own counts by tier, of the comparisons it acted on; ``values`` (k,): the tutor's scale."""

    kind: Kind
    k: int
    values: Floats
    answers: Answers
    segments: tuple[Segment, ...]
    decided: Mapping[str, int]

    def __len__(self) -> int:
        return sum(len(segment.d) for segment in self.segments)

    def steps(self) -> Iterator[tuple[Answers, Floats]]:
        """For each segment: the answers that it knows and the one before it did not, and its differences."""
        before = 0
        for known, d in self.segments:
            yield self.answers[before:known], d
            before = known

    def take(self, chosen: NDArray[np.bool_]) -> Stream:
        """The same stream with only some of its rows, but all its answers; ``chosen`` (len(self),)."""
        ends = np.cumsum([len(segment.d) for segment in self.segments])[:-1]
        parts = zip(self.segments, np.split(chosen, ends), strict=True)
        return replace(self, segments=tuple(Segment(known, d[part]) for (known, d), part in parts))

    @property
    def dominated(self) -> float:
        """Share of the differences put to the comparator that are equal or settled by dominance."""
        settled = sum(np.count_nonzero(dominance(tail_sums(d)) != Verdict.UNKNOWN) for _, d in self.segments)
        return settled / max(1, len(self))


class Recorder:
    """A polytope comparator that writes down what it is asked. Satisfies elicit.Comparator."""

    def __init__(self, inner: PolytopeComparator, record: list[tuple[int, list[Floats]]]) -> None:
        self._inner = inner
        self._record = record
        self._asked: list[Floats] = []
        record.append((len(inner.answers), self._asked))

    @property
    def k(self) -> int:
        """Number of levels."""
        return self._inner.k

    @property
    def values(self) -> Floats:
        """(k,) the inner comparator's guess at the scale."""
        return self._inner.values

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """The inner comparator's bounds; not recorded."""
        return self._inner.bounds(d)

    def compare(self, d: ArrayLike) -> Verdicts:
        """Verdicts (n,) on d (n, k), recorded."""
        return self.decide(d).verdicts

    def decide(self, d: ArrayLike) -> Decisions:
        """Verdicts and tiers (n,) of d (n, k), recorded."""
        rows = np.atleast_2d(np.array(d, dtype=np.float64))
        self._asked.append(rows)
        return self._inner.decide(rows)

    def update(self, answers: Answers) -> Recorder:
        """A recorder of what comes after these answers, in the same record."""
        return Recorder(self._inner.update(answers), self._record)


def record(kind: Kind, k: int, seed: int = 0, *, steps: int = 100_000, tolerance: float = 0.0005) -> Stream:
    """Run a learner with a truthful tutor on random_mdp(100, 5, k) and record what it puts to the comparator.

    That is more than what it acts on and, of Q-learning, less than what it compares: its loop settles equal and
    dominated pairs by itself and looks ahead over the other pairs of the step it stands at; and each answered pair
    is put to the comparator once more. ``steps`` is for Q-learning, ``tolerance`` for value iteration.
    """
    mdp, values = random_mdp(100, 5, k, rng=seed)
    rows: list[tuple[int, list[Floats]]] = []
    recorder = Recorder(PolytopeComparator(k), rows)
    learner: InteractiveQLearning | InteractiveValueIteration
    if kind == "Q-learning":
        learner = InteractiveQLearning(mdp, recorder, steps=steps, epsilon=0.1, rng=seed)
    else:
        learner = InteractiveValueIteration(mdp, recorder, tolerance=tolerance, rng=seed)
    result = drive(learner, TruthfulTutor(values))
    segments = tuple(Segment(known, np.concatenate(d) if d else np.empty((0, k))) for known, d in rows)
    return Stream(kind, k, values, result.answers, segments, result.decided)


def needed_rows(answers: Answers, margin: float) -> int:
    """How many of the answers' inequalities cut K_t: the others follow from them."""
    rows, limits = cuts(answers)
    keep = np.ones(len(rows), dtype=bool)
    for i, row in enumerate(rows):
        keep[i] = False
        others = -rows[keep] if keep.any() else None
        above = -limits[keep] if keep.any() else None
        least = linprog(row, others, above, np.ones((1, len(row))), [1.0], (margin, None)).fun
        keep[i] = least < limits[i] - 1e-9
    return int(keep.sum())


def cuts(answers: Answers) -> tuple[Floats, Floats]:
    """Rows (m, p) and limits (m,) of the answers' inequalities rows.g >= limits in gap space, each row with a
    largest entry of 1; an answer EQUAL gives both sides of its band."""
    t = tail_sums(answers.d)
    size = np.abs(t).max(axis=1, initial=0.0)
    band = TIE_BAND * np.abs(answers.d).sum(axis=1) / np.where(size > 0, size, 1.0)
    rows, limits = [], []
    for row, y, width in zip(unit(t), answers.y, band, strict=True):
        for sign in (1, -1) if y == 0 else (int(y),):
            rows.append(sign * row)
            limits.append(-width if y == 0 else 0.0)
    return np.array(rows).reshape(-1, answers.k - 1), np.array(limits)


def unit(t: Floats) -> Floats:
    """Each row of t (n, p) or (p,) scaled to a largest entry of 1."""
    size = np.abs(t).max(axis=-1, keepdims=True)
    return np.asarray(t / np.where(size > 0, size, 1.0))
