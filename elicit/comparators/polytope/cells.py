"""The plausible set K_t if some answers may be wrong: a union of polytopes, the *cells*.

Each cell stands for a guess at which answers are wrong. Its scales satisfy all other answers, and
the opposite of the wrong ones. With at most m wrong answers, K_t is the union of all cells of at
most m wrong answers. Asking is then Ulam's game: to find something out by questions of which m may
be answered wrongly (Pelc 2002, Theoretical Computer Science 270).

Cells overlap only in their faces. A new answer splits a cell if it is true of some of its scales
and false of others. If it is true of all of them, the cell stays as it is, and the answer cannot be
wrong in it. So most of the possible cells are empty, and these are never made.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from elicit._support.fixed_order import product
from elicit.decision.comparator_rule import Rule, nothing, unaided
from elicit.decision.verdicts import decide
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import WRONG_ODDS, Decisions, Verdicts
from elicit.model.comparator_parts import Cell
from elicit.model.query import Answers, InconsistentAnswers, Verdict
from elicit.model.scale import Floats

if TYPE_CHECKING:
    from elicit.comparators.polytope.comparator import PolytopeComparator

# share of the tie by which scales that call an "equal" wrong reach into the band: more than
# rounding
_OVERLAP = 1e-12

_FLAT = 1e-300  # a variance no larger counts as this


class PolytopeCell(NamedTuple):
    """One cell: the scales that fit the answers if those in ``wrong`` are wrong.

    ``scales`` is a comparator that has learned the answers with the wrong ones flipped, except
    answers that followed from earlier ones. ``wrong`` holds the rows of the wrong answers.
    """

    scales: PolytopeComparator
    wrong: tuple[int, ...]


class Cells:
    """All cells of at most ``most`` wrong answers, those with the fewest first.

    The object never changes.
    """

    def __init__(self, parts: Sequence[PolytopeCell], most: int) -> None:
        self.parts = tuple(sorted(parts, key=lambda part: (len(part.wrong), part.wrong)))
        self.most = most

    def update(self, answers: Answers, first: int) -> Cells:
        """Return the cells after further answers, whose rows begin with ``first``.

        There may be none: then more than ``most`` answers are wrong.
        """
        parts = self.parts
        for i in range(len(answers)):
            parts = tuple(
                new for part in parts for new in self._divided(part, answers[i : i + 1], first + i)
            )
        return Cells(parts, self.most)

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """The cells with their weights."""
        return tuple(
            Cell(*part, weight)
            for part, weight in zip(self.parts, self.weights.tolist(), strict=True)
        )

    def decide_rest(self, d: Floats) -> Decisions:
        """Return verdicts (n,) and tiers (n,) of differences d (n, k).

        A difference is decided if the verdicts in all cells agree. EQUAL agrees with BETTER and
        with WORSE (see ``agreed``).
        """
        verdicts, tiers = np.full(len(d), Verdict.EQUAL, np.int8), np.zeros(len(d), np.int8)
        rows = np.arange(len(d))
        for part in self.parts:
            found = decide(part.scales, d[rows])
            verdicts[rows] = agreed(verdicts[rows], found.verdicts)
            tiers[rows] = np.maximum(tiers[rows], found.tiers)
            rows = rows[verdicts[rows] != Verdict.UNKNOWN]
        return Decisions(verdicts, tiers)

    @property
    def rule(self) -> Rule:
        """The rule for compiled loops: the only cell's, or dominance alone if there are more."""
        if len(self.parts) == 1:
            return self.parts[0].scales.rule
        return nothing() if all(part.scales.rule.dominance for part in self.parts) else unaided()

    def bounds(self, d: Floats) -> tuple[Floats, Floats]:
        """Return bounds lo (n,), hi (n,) on d.e over all cells, for differences d (n, k)."""
        each = np.array([part.scales.bounds(d) for part in self.parts])
        return each[:, 0].min(axis=0), each[:, 1].max(axis=0)

    def greatest(self, d: Floats) -> Floats:
        """Return upper bounds (n,) on d.e over all cells, for valid differences d (n, k)."""
        high = np.full(len(d), -np.inf)
        for part in self.parts:
            high = np.maximum(high, part.scales.simultaneous_bounds(d)[0])
        return high

    @cached_property
    def weights(self) -> Floats:
        """Weights (c,) of the cells, of total 1: volume times ``WRONG_ODDS`` for each wrong answer.

        The volume is estimated from how widely draws scatter.
        """
        if len(self.parts) == 1:
            return np.ones(1)
        logs = np.array([log_volume(part.scales.draws) for part in self.parts])
        wrong = np.array([len(part.wrong) for part in self.parts])
        weights = np.exp(logs - logs.max()) * WRONG_ODDS**wrong
        return np.asarray(weights / weights.sum())

    @property
    def values(self) -> Floats:
        """The mean (k,) of the cells' central scales."""
        return product(self.weights, np.array([part.scales.values for part in self.parts]))

    @property
    def draws(self) -> Draws:
        """The draws of all cells together, with each cell's weight."""
        if len(self.parts) == 1:
            return self.parts[0].scales.draws
        gaps, weights, precision = zip(*(part.scales.draws for part in self.parts), strict=True)
        weighed = [share * own for share, own in zip(self.weights, weights, strict=True)]
        return Draws(
            np.concatenate(gaps, axis=1), np.concatenate(weighed), np.concatenate(precision)
        )

    def _divided(self, part: PolytopeCell, one: Answers, row: int) -> Iterator[PolytopeCell]:
        """Yield the non-empty parts of a cell: where the answer is right, and where it is wrong."""
        scales, y = part.scales, int(one.y[0])
        wrong = (*part.wrong, row)
        may = len(part.wrong) < self.most
        if y == 0:
            if (within := _told(scales, one)) is not None:
                yield PolytopeCell(within, part.wrong)
            for outside in _unequal(one, scales.tie) if may else ():
                if (beyond := _told(scales, outside)) is not None:
                    yield PolytopeCell(beyond, wrong)
            return
        verdict = Verdict(int(scales.compare(one.d)[0]))
        if verdict is not Verdict.UNKNOWN:  # the answer follows from the cell, or its opposite does
            if verdict != -y:
                yield part
            elif may:
                yield PolytopeCell(scales, wrong)
            return
        if (right := _told(scales, one)) is not None:
            yield PolytopeCell(right, part.wrong)
        if may and (flipped := _told(scales, Answers(one.d, -one.y, one.ids, one.who))) is not None:
            yield PolytopeCell(flipped, wrong)


def agreed(verdicts: Verdicts, others: Verdicts) -> Verdicts:
    """Return verdicts (n,) over the union of two sets of scales, from those over each.

    EQUAL agrees with BETTER and with WORSE, because both allow d.e = 0.
    """
    both = np.where(verdicts == Verdict.EQUAL, others, verdicts)
    return np.where(
        (others != both) & (others != Verdict.EQUAL), np.int8(Verdict.UNKNOWN), both
    ).astype(np.int8)


def too_many_wrong(
    blank: PolytopeComparator, loose: PolytopeComparator, answers: Answers, most: int
) -> InconsistentAnswers:
    """Return the error that says that more than ``most`` of the answers are wrong.

    ``blank`` is the comparator without answers, and ``loose`` the same with a margin of 0.
    """
    return InconsistentAnswers(partial(_explained, blank, loose, answers, most))


def _explained(
    blank: PolytopeComparator, loose: PolytopeComparator, answers: Answers, most: int
) -> tuple[str, tuple[tuple[int, str], ...], bool]:
    """Return the parts of the error: a sentence, (row, id) of some answers, and a flag.

    More than ``most`` of these answers are wrong. Without any one of them, that would not follow.
    The flag says whether a margin of 0 would allow the answers.
    """

    def possible(rows: Sequence[int], blank: PolytopeComparator) -> bool:
        some = answers.take(rows)
        return bool(Cells([PolytopeCell(blank, ())], most).update(some, 0).parts)

    rows = list(range(len(answers)))
    for row in rows[::-1]:
        rest = [other for other in rows if other != row]
        if not possible(rest, blank):
            rows = rest
    found = tuple((row, answers.ids[row]) for row in rows)
    listed = ", ".join(f"row {row} (id {name})" for row, name in found)
    said = (
        f"more than {most} of these {len(rows)} answers are wrong: {listed}. Without any one of "
        f"them, {most} wrong "
        "ones could explain the rest: drop or correct one of them, or allow for more, wrong="
        f"{most + 1}."
    )
    margin = blank.margin > 0 and possible(rows, loose)
    if margin:
        said += (
            f" With a margin of 0 they would be: the margin {blank.margin:g} is above the least "
            "gap they allow."
        )
    return said, found, margin


def _told(scales: PolytopeComparator, one: Answers) -> PolytopeComparator | None:
    """Return a cell's comparator after an answer, or None if no scale is left."""
    try:
        return scales.update(one)
    except InconsistentAnswers:
        return None


def _unequal(one: Answers, tie: float) -> Iterator[Answers]:
    """Yield two answers, one of which holds if "equal" is wrong: d.e >= tie, and -d.e >= tie.

    Each is written as an answer that left is better, after the share ``tie`` of the best level was
    subtracted from left.
    """
    shift = max(0.0, tie - _OVERLAP * max(tie, float(np.abs(one.d[:, 1:]).max(initial=0.0))))
    for sign in (1, -1):
        d = sign * one.d
        d[:, -1] -= shift
        yield Answers(d, [1], one.ids)


def log_volume(draws: Draws) -> float:
    """Return the logarithm of the volume of a set of scales, up to a constant, from draws.

    It is the volume of the ellipsoid with the draws' covariance. It is rounded, so that choices do
    not depend on the last bit.
    """
    gaps = draws.gaps[:-1]  # the last gap follows from the others
    if not len(gaps):
        return 0.0
    spread = gaps - product(gaps, draws.weights)[:, None]
    left = product(spread * draws.weights, spread.T)
    total = 0.0
    for j in range(len(left)):  # Gaussian elimination
        pivot = float(left[j, j])
        total += 0.5 * np.log(max(pivot, _FLAT))
        if pivot > _FLAT:  # else the draws do not spread this way, and the row is rounding
            left = left - np.outer(left[:, j], left[j]) / pivot
    return float(np.round(total, 6))
