"""The pairs of vectors that the tutor has answered, looked up by their difference.

Where a pair was compared does not matter, nor which of its vectors stood left.
"""

from __future__ import annotations

import numpy as np

from elicit._support.jit import expect
from elicit.model.comparator import Verdicts
from elicit.model.difference import tail_sums
from elicit.model.difference_kernel import NOT_THERE, PairTable, find, find_all, mark_of
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
        t = np.ascontiguousarray(tail_sums(d))
        row, way = find(t, self.table)
        if row == NOT_THERE:
            self._append(t, verdict, binding)
        else:
            self.table.said[row] = way * verdict
            self.table.binding[row] |= binding

    def add_many(self, d: Floats, verdicts: Verdicts) -> None:
        """Keep the verdicts (n,) of answers about differences d (n, k). "Equal" is binding."""
        for row, verdict in zip(d, verdicts.tolist(), strict=True):
            self.add(row, verdict, binding=verdict == Verdict.EQUAL)

    def said(self, t: Floats) -> Verdicts:
        """Return the answers (n,) to pairs with tail sums t (n, p), UNKNOWN where there is none."""
        rows, ways = np.full(len(t), NOT_THERE), np.ones(len(t), np.int64)
        if len(self):
            expect(find_all, 1e-5 * t.size)
            find_all(np.ascontiguousarray(t), self.table, rows, ways)
        return np.where(rows == NOT_THERE, Verdict.UNKNOWN, ways * self.table.said[rows]).astype(
            np.int8
        )

    def _append(self, t: Floats, verdict: int, binding: bool) -> None:
        table, row = self.table, len(self)
        if row == len(table.said):
            table = table._replace(
                sums=np.resize(table.sums, (2 * row, len(t))),
                said=np.resize(table.said, 2 * row),
                binding=np.resize(table.binding, 2 * row),
            )
        table.sums[row], table.said[row], table.binding[row] = t, verdict, binding
        mark = mark_of(t)
        at = int(table.marks.searchsorted(mark))
        self.table = table._replace(
            marks=np.concatenate([table.marks[:at], [mark], table.marks[at:]]),
            rows=np.concatenate([table.rows[:at], [row], table.rows[at:]]),
        )
