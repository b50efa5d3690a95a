"""The vertices of a set of scales: the ordered ones that agree with all answers.

In gaps this is a simplex that answers cut, one half-space at a time. There are four to six levels,
so the vertices are few and every optimum over the set is found among them.
"""

from __future__ import annotations

import numpy as np

from elicit.model.scale import Floats

_TOUCHES = 1e-10  # of a product of gaps and tail sums


class ScaleSet:
    """The set {g >= 0, sum g = 1, rows g >= 0} by its vertices (m, p)."""

    def __init__(self, k: int) -> None:
        self.vertices: Floats = np.eye(k - 1)
        self._tight = ~np.eye(k - 1, dtype=bool)  # (m, constraints)

    def cut(self, row: Floats) -> bool:
        """Keep what has row.g >= 0; return False, and change nothing, if that is nothing."""
        side = self.vertices @ row
        size = _TOUCHES * max(float(np.abs(row).max()), 1e-300)
        above, below = side > size, side < -size
        if not (side >= -size).any() or not above.any():
            return False
        ups, downs = np.flatnonzero(above), np.flatnonzero(below)
        need = self.vertices.shape[1] - 2
        points, marks = [], []
        for i in ups:
            for j in downs:
                both = self._tight[i] & self._tight[j]
                if both.sum() < need:
                    continue
                if (self._tight[:, both].all(axis=1)).sum() > 2:
                    continue  # not neighbours: a third vertex lies on all they share
                share = side[i] / (side[i] - side[j])
                points.append((1 - share) * self.vertices[i] + share * self.vertices[j])
                marks.append([*both, True])
        stay = ~below
        tight = np.column_stack([self._tight[stay], ~above[stay]])
        self.vertices = np.concatenate(
            [self.vertices[stay], np.array(points).reshape(-1, len(row))]
        )
        self._tight = np.concatenate(
            [tight, np.array(marks, dtype=bool).reshape(-1, tight.shape[1])]
        )
        return True

    def ranges(self) -> tuple[Floats, Floats]:
        """Return the least and the greatest value (k,) of each level."""
        values = np.cumsum(self.vertices, axis=1)
        low, high = values.min(axis=0), values.max(axis=0)
        return np.concatenate([[0.0], low]), np.concatenate([[0.0], high])
