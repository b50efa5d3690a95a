"""Policy comparisons for vector rewards (Shao et al., NeurIPS 2023).

The authors' first algorithm, for a user whose value is linear in the objectives with unknown
weights of at least 0. Objectives are tail sums, so the weights are the gaps between levels.

1. A benchmark: the best of the policies that each maximise one objective, by comparing them.
2. Basis policies without a question: in each step one that gains most, or loses most, along some
   direction at right angles to the value vectors so far.
3. For each basis policy the ratio of its value to the benchmark's, by binary search: it is compared
   with a mixture of the benchmark and "do nothing", here the worst level for ever.
4. The weights solve the linear equations that the ratios make.

The authors do the searches one after the other. Here the next question is about the ratio that is
known least, which takes as many questions in all and leaves a better estimate on the way.

The authors' bounds on weights are not needed: the order of the levels says that none is negative.
Before a ratio is known its middle value is used, so that there is an estimate at any time. It ends
once every ratio is known to ``PRECISION``, and then claims a near-optimal policy from the start.
It has no model of errors.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import nnls

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.small_mdp import Policy, SmallMDP, tails_of
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

PRECISION = 0.01
"""Of a ratio: half the length of its interval."""
MOST = 2.0
"""The greatest ratio that is looked for at first; it doubles while that is too small."""


class PolicyComparisons:
    """Basis policies, and binary searches for what they are worth."""

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        self._small = SmallMDP(mdp)
        p = mdp.k - 1
        single = self._small.best(np.eye(p))
        self._single = [self._small.from_start(policy) for policy in single]
        self._benchmark, self._next = 0, 1
        self._bottom = np.eye(mdp.k)[0]
        self._basis: list[Floats] = []
        self._ranges: list[tuple[float, float]] = []
        self._closed: list[bool] = []
        self._weights = np.full(p, 1.0 / p)

    def question(self) -> Question | None:
        while self._next < len(self._single):
            left, right = self._single[self._benchmark], self._single[self._next]
            if np.abs(left - right).max() > 1e-9:
                return left, right
            self._next += 1
        if not self._basis:
            self._find_basis()
        lengths = [round(high - low, 9) for low, high in self._ranges]
        unknown = [
            i
            for i in range(1, len(self._basis))
            if not self._closed[i] or lengths[i] / 2 > PRECISION
        ]
        if not unknown:
            return None
        i = max(unknown, key=lambda i: (not self._closed[i], lengths[i]))
        low, high = self._ranges[i]
        self._at, self._ratio = i, (low + high) / 2 if self._closed[i] else high
        return self._compared(i, self._ratio)

    def tell(self, verdict: int) -> None:
        if not self._basis:
            if verdict < 0:
                self._benchmark = self._next
            self._next += 1
            return
        i, ratio = self._at, self._ratio
        low, high = self._ranges[i]
        if verdict > 0 and not self._closed[i]:
            self._ranges[i] = high, 2 * high
        elif verdict > 0:
            self._ranges[i] = ratio, high
        elif verdict < 0:
            self._ranges[i] = (low, high) if not self._closed[i] else (low, ratio)
        else:
            self._ranges[i] = ratio, ratio
        self._closed[i] |= verdict <= 0
        self._estimate()

    def policy(self) -> Policy:
        return self._small.best(self._weights)[0]

    def _compared(self, i: int, ratio: float) -> Question:
        """Ask whether basis policy i is worth more than ``ratio`` times the benchmark."""
        ours, benchmark = self._basis[i], self._basis[0]
        if ratio <= 1.0:
            return ours, ratio * benchmark + (1 - ratio) * self._bottom
        return ours / ratio + (1 - 1 / ratio) * self._bottom, benchmark

    def _find_basis(self) -> None:
        self._basis = [self._single[self._benchmark]]
        while True:
            tails = tails_of(np.array(self._basis))
            free = null_space(tails, rcond=1e-7).T
            if not len(free):
                break
            found, size = None, 1e-6
            for direction in np.concatenate([free, -free]):
                shares = self._small.from_start(self._small.best(direction)[0])
                along = abs(float(tails_of(shares) @ direction))
                if round(along, 9) > size:
                    found, size = shares, along
            if found is None:
                break
            self._basis.append(found)
        self._ranges = [(0.0, MOST)] * len(self._basis)
        self._closed = [False] * len(self._basis)
        self._closed[0] = True

    def _estimate(self) -> None:
        tails = tails_of(np.array(self._basis))
        rows, sides = [tails[0]], [1.0]
        for i in range(1, len(tails)):
            ratio = sum(self._ranges[i]) / 2 if self._closed[i] else min(1.0, self._ranges[i][1])
            rows.append(ratio * tails[0] - tails[i])
            sides.append(0.0)
        weights, _ = nnls(np.array(rows), np.array(sides))
        if weights.sum() > 0:
            self._weights = weights / weights.sum()
