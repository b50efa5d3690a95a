"""Choice of questions to a tutor of whose answers a few may be wrong.

Each guess at which answers are wrong leaves a set of plausible scales, a *cell* (see
``comparators.polytope.cells``). All scales that are plausible form the union of the cells. An
answer to a new question cuts each cell in two. The part that fits the answer stays in the cell. The
other part stays too, as a new cell in which this answer is wrong.

So the value of a question is how little it leaves open over all cells. A cell with fewer wrong
answers counts more, because more of its answers can still turn out wrong. The question may also be
an old one asked again: the same answer then removes the cells in which the first answer was wrong.

The weights are those of Berlekamp's strategy for Ulam's game (Pelc 2002, Theoretical Computer
Science 270).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, cast

import numpy as np

from elicit._support.fixed_order import product
from elicit._support.threads import one_thread
from elicit.asking.cuts import cuts_towards, halvings, halvings_left
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import WRONG_ODDS, Comparator
from elicit.model.comparator_parts import Cell, simultaneous_bounds
from elicit.model.difference import tail_sums
from elicit.model.query import Answers, Verdict
from elicit.model.scale import Floats

# of the differences themselves, those of the greatest bounds, that are weighed against other
# questions
_OWN = 4
_MORE = 6.0  # times that a cell counts more for each further answer that may be wrong in it


class Confirming(NamedTuple):
    """A difference (k,) to ask about, and its row among the given ones, or -1 if it is new."""

    d: Floats
    row: int


@one_thread
def confirming_question(comparator: Comparator, d: Floats, limit: float) -> Confirming:
    """Return the question that is expected to bring upper bounds on d.e down most, in all cells.

    The bounds are to come down to ``limit``. The best question is the one whose answer is expected
    to leave the fewest halvings of bounds (``cuts.halvings``), in total over all differences and
    cells. A cell counts more if more of its answers can still be wrong.

    Parameters
    ----------
    comparator : Comparator
        A comparator with ``cells``, draws and answers. The draws give the probability of each
        answer. The bounds after an answer are those of each cell once it has learned the answer. No
        bound may rise by an answer; a polytope's never do.
    d : (n, k)
        Differences whose d.e is bounded; n > 0.
    limit : float

    Returns
    -------
    Confirming
        The same input gives the same question.
    """
    known = cast(_CellScales, comparator)
    parts = [_WeighedCell.of(cell, known.wrong, d) for cell in known.cells]
    most = np.max([part.high for part in parts], axis=0)
    own = np.argsort(-most, kind="stable")[:_OWN]
    again = known.answers.d[comparator.compare(known.answers.d) == Verdict.UNKNOWN]
    asked = [Confirming(d[i], int(i)) for i in own]
    asked += [Confirming(row, -1) for row in (*cuts_towards(known.draws, d, most, limit), *again)]
    return min(
        asked, key=lambda cut: round(_expected(cut.d, parts, limit), 9)
    )  # of equals the first


class _CellScales(Protocol):
    """The parts of a cell's comparator that are used here."""

    wrong: int
    cells: Sequence[Cell]
    draws: Draws
    answers: Answers


class _WeighedCell(NamedTuple):
    """A cell, how many more answers may be wrong in it, the differences, and their bounds in it."""

    cell: Cell
    left: int
    d: Floats  # (n, k)
    high: Floats  # (n,)

    @staticmethod
    def of(cell: Cell, wrong: int, d: Floats) -> _WeighedCell:
        """Return a cell with its bounds on d (n, k).

        In total ``wrong`` answers may be wrong, including those that are wrong in the cell.
        """
        high = simultaneous_bounds(cell.scales, d)[0]
        return _WeighedCell(cell, wrong - len(cell.wrong), d, high)

    def after(self, asked: Floats, limit: float) -> tuple[float, float]:
        """Return how many halvings are left in the two parts of the cell that a question makes.

        In the first part ``asked`` is better, and in the second worse. See ``cuts.halvings``.
        """
        rows = np.flatnonzero(self.high > limit)
        if not len(rows):
            return 0.0, 0.0
        high = self.high[rows]
        verdict = Verdict(int(self.cell.scales.compare(asked)[0]))
        if verdict is not Verdict.UNKNOWN:
            all_left = halvings(high, limit)
            return (all_left, 0.0) if verdict is Verdict.BETTER else (0.0, all_left)
        worse, better = halvings_left(self.cell.scales, asked[None], self.d[rows], high, limit)[0]
        return float(better), float(worse)

    def chance(self, asked: Floats) -> float:
        """Return the probability of the answer "better", if the true scale is in this cell."""
        gaps, weights, _ = cast(_CellScales, self.cell.scales).draws
        better = float(product(product(tail_sums(asked), gaps) > 0, weights))
        return (
            better if not self.left else (better + WRONG_ODDS * (1.0 - better)) / (1.0 + WRONG_ODDS)
        )


def _expected(asked: Floats, parts: Sequence[_WeighedCell], limit: float) -> float:
    """Return the expected log of the weighted halvings left after asking about ``asked`` (k,)."""
    better = sum(part.cell.weight * part.chance(asked) for part in parts)
    left = [1.0, 1.0]  # after "better", after "worse"
    for part in parts:
        halves = part.after(asked, limit)
        for answer in (0, 1):
            left[answer] += _MORE**part.left * halves[answer]
            if part.left:
                left[answer] += _MORE ** (part.left - 1) * halves[1 - answer]
    return float(better * np.log2(left[0]) + (1.0 - better) * np.log2(left[1]))
