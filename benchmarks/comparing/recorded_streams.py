"""Streams of comparisons as a learner really makes them, recorded while it learns.

A learner compares vectors that are nearly equal, near ties and again and again the same, and asks
the tutor in between. Random differences over a random K_t have none of that, so costs are measured
on these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from elicit import Answers, PolytopeComparator, TruthfulTutor, Verdict
from elicit._support.hashing import key_of
from elicit.lp.region import TIE_BAND
from elicit.model.comparator import Verdicts
from elicit.model.difference import dominance, tail_sums
from elicit.model.scale import Floats
from qlearn import random_mdp
from qlearn.learners.q_learning import rescaled_linear_rate
from qlearn.reference import interactive_q_learning, interactive_value_iteration

Kind: TypeAlias = Literal["Q-learning", "IVI"]
KINDS: tuple[Kind, ...] = ("Q-learning", "IVI")


class Segment(NamedTuple):
    """The differences d (n, k) put to the comparator while it knew the first ``known`` answers."""

    known: int
    d: Floats


@dataclass(frozen=True)
class Stream:
    """All comparisons of one run, in order. ``answers``: all that were told; ``values`` (k,): the
    tutor's scale.
    """

    kind: Kind
    k: int
    values: Floats
    answers: Answers
    segments: tuple[Segment, ...]

    def __len__(self) -> int:
        return sum(len(segment.d) for segment in self.segments)

    def steps(self) -> Iterator[tuple[Answers, Floats]]:
        """For each segment: the answers that it knows and the one before it did not, and its
        differences.
        """
        before = 0
        for known, d in self.segments:
            yield self.answers[before:known], d
            before = known

    def take(self, chosen: NDArray[np.bool_]) -> Stream:
        """Return the stream with all its answers, but of its rows only ``chosen`` (len(self),)."""
        ends = np.cumsum([len(segment.d) for segment in self.segments])[:-1]
        parts = zip(self.segments, np.split(chosen, ends), strict=True)
        return replace(self, segments=tuple(Segment(known, d[part]) for (known, d), part in parts))

    @property
    def dominated(self) -> float:
        """Share of the comparisons that equality or dominance settles."""
        settled = sum(
            np.count_nonzero(dominance(tail_sums(d)) != Verdict.UNKNOWN) for _, d in self.segments
        )
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
    def answers(self) -> Answers:
        """Return the answers that the inner comparator learned from."""
        return self._inner.answers

    @property
    def values(self) -> Floats:
        """(k,) the inner comparator's guess at the scale."""
        return self._inner.values

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """The inner comparator's bounds; not recorded."""
        return self._inner.bounds(d)

    def compare(self, d: ArrayLike) -> Verdicts:
        """Verdicts (n,) on d (n, k), recorded."""
        rows = np.atleast_2d(np.array(d, dtype=np.float64))
        self._asked.append(rows)
        return self._inner.compare(rows)

    def update(self, answers: Answers) -> Recorder:
        """A recorder of what comes after these answers, in the same record."""
        return Recorder(self._inner.update(answers), self._record)


def record(
    kind: Kind, k: int, seed: int = 0, *, steps: int = 100_000, tolerance: float = 0.0005
) -> Stream:
    """Run Algorithm 1 with epsilon .1, or interactive value iteration, with a truthful tutor on
    random_mdp(100, 5, k), line for line, and record every comparison. ``steps`` is for the one,
    ``tolerance`` for the other."""
    mdp, values = random_mdp(100, 5, k, seed=seed)
    rows: list[tuple[int, list[Floats]]] = []
    recorder, tutor = Recorder(PolytopeComparator(k), rows), TruthfulTutor(values)
    if kind == "Q-learning":
        rates = rescaled_linear_rate(mdp.discount)(np.arange(steps))
        _, known, _ = interactive_q_learning(
            mdp, recorder, tutor, steps=steps, epsilon=0.1, rates=rates, key=key_of(seed)
        )
    else:
        _, known, _ = interactive_value_iteration(mdp, recorder, tutor, tolerance=tolerance)
    segments = tuple(Segment(n, np.concatenate(d) if d else np.empty((0, k))) for n, d in rows)
    return Stream(kind, k, values, cast(Recorder, known).answers, segments)


def needed_rows(answers: Answers, margin: float) -> int:
    """Count the answers' inequalities that cut K_t: the others follow from them."""
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
    """Rows (m, p) and limits (m,) of the answers' inequalities rows.g >= limits in gap space, each
    row with a largest entry of 1; an answer EQUAL gives both sides of its band."""
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
