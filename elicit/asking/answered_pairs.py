"""The pairs of vectors that the tutor has answered, looked up by their difference.

Where a pair was compared does not matter, nor which of its vectors stood left.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import expect
from elicit.model.comparator import Verdicts
from elicit.model.difference import tail_sums
from elicit.model.difference_kernel import NOT_THERE, PairTable, find_all
from elicit.model.pairs import marks_of
from elicit.model.query import Verdict
from elicit.model.scale import Floats


class AnsweredPairs:
    """The tutor's answers to pairs, looked up by difference.

    Two differences within ``pairs.nearness`` count as the same pair. Of several answers to a pair
    the latest counts.
    """

    def __init__(self, k: int) -> None:
        nothing = np.empty(0, np.int64)
        self.table = PairTable(
            marks=np.empty(0),
            rows=nothing,
            sums=np.empty((8, k - 1)),
            said=np.empty(8, np.int8),
            binding=np.zeros(8, np.bool_),
        )

    def __len__(self) -> int:
        return len(self.table.rows)

    def copy(self) -> AnsweredPairs:
        """Return a copy. Additions to it leave this table unchanged."""
        new = object.__new__(AnsweredPairs)
        new.table = self.table._replace(
            said=self.table.said.copy(), binding=self.table.binding.copy()
        )
        return new  # rows behind the last are free: adding one overwrites them

    @property
    def any_binding(self) -> bool:
        """Return whether some answer is binding: no model may overrule it."""
        return bool(self.table.binding[: len(self)].any())

    def add(self, d: Floats, verdict: int, *, binding: bool) -> None:
        """Keep the verdict of an answer about a difference d (k,)."""
        self._add(d[None], np.array([verdict], np.int8), np.array([binding]))

    def add_many(self, d: Floats, verdicts: Verdicts) -> None:
        """Keep the verdicts (n,) of answers about different pairs, given by differences d (n, k).

        "Equal" is binding.
        """
        self._add(d, verdicts, verdicts == Verdict.EQUAL)

    def said(self, t: Floats) -> Verdicts:
        """Return the answers (n,) to pairs with tail sums t (n, p), UNKNOWN where there is none."""
        rows, ways = self._find(t)
        return np.where(rows == NOT_THERE, Verdict.UNKNOWN, ways * self.table.said[rows]).astype(
            np.int8
        )

    def _find(self, t: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the table's row (n,) of each pair, and 1 (n,), or -1 where the pair is flipped.

        The pairs have tail sums t (n, p). The result is that of ``find``.
        """
        rows, ways = np.full(len(t), NOT_THERE), np.ones(len(t), np.int64)
        if len(self):
            expect(find_all, 1e-5 * t.size)
            find_all(np.ascontiguousarray(t), self.table, rows, ways)
        return rows, ways

    def _add(self, d: Floats, verdicts: Verdicts, binding: NDArray[np.bool_]) -> None:
        t = tail_sums(d)
        rows, ways = self._find(t)
        old, new = rows != NOT_THERE, rows == NOT_THERE
        self.table.said[rows[old]] = (ways * verdicts)[old]
        self.table.binding[rows[old]] |= binding[old]
        if not new.any():
            return
        table, first, after = self.table, len(self), len(self) + int(new.sum())
        if after > len(table.said):
            table = table._replace(
                sums=np.resize(table.sums, (2 * after, t.shape[1])),
                said=np.resize(table.said, 2 * after),
                binding=np.resize(table.binding, 2 * after),
            )
        added = slice(first, after)
        table.sums[added], table.said[added] = t[new], verdicts[new]
        table.binding[added] = binding[new]
        marks = np.concatenate([table.marks, marks_of(t[new])])
        order = marks.argsort(kind="stable")
        rows = np.concatenate([table.rows, np.arange(first, after)])
        self.table = table._replace(marks=marks[order], rows=rows[order])
