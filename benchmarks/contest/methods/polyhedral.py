"""Polyhedral questions (Toubia, Hauser and Simester 2004), with the authors' own choice sets.

What agrees with the answers is a polytope of scales. Its analytic centre is the estimate, and an
ellipsoid around the centre gives its longest axis. Where the axis leaves the polytope there are two
scales. For each of them the question has the alternative that it likes best, among those that the
centre values at no more than a budget; so both are about equally good for the centre, and the
answer cuts near the middle. The authors' alternatives are products of a conjoint design. Here they
are lotteries over the policies of a coverage set: any of them is a vector that can be had.

If answers contradict each other, all are relaxed by the least amount that leaves a scale, as the
authors propose for answers with errors. The method has no rule to stop: the authors ask a fixed
number of questions.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.small_mdp import Policy, SmallMDP, coverage_set, tails_of
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP


class Polyhedral:
    """The analytic centre and the longest axis of what is possible."""

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._small = SmallMDP(mdp)
        _, self._shares = coverage_set(self._small, self._rng)
        self._tails = tails_of(self._shares)
        self._rows = np.empty((0, mdp.k - 1))
        self._centre, self._slack = np.full(mdp.k - 1, 1.0 / (mdp.k - 1)), np.empty(0)

    def question(self) -> Question | None:
        if len(self._shares) < 2:
            return None
        rows, slack = self._constraints()
        scaled = rows / slack[:, None]
        p = len(self._centre)
        flat = np.linalg.svd(np.ones((1, p)))[2][1:]  # directions that keep the total
        sizes, axes = np.linalg.eigh(flat @ (scaled.T @ scaled) @ flat.T)
        for axis in (axes[:, i] @ flat for i in range(len(sizes))):  # the longest first
            axis = axis if axis[np.argmax(np.abs(np.round(axis, 9)))] > 0 else -axis
            ends = [self._end(rows, slack, sign * axis) for sign in (1.0, -1.0)]
            for _ in range(10):
                budget = self._budget()
                sides = [self._best_within(end, budget) for end in ends]
                if np.abs(sides[0] - sides[1]).max() > 1e-6:
                    self._asked = tails_of(sides[0] - sides[1])
                    return sides[0], sides[1]
        return None

    def tell(self, verdict: int) -> None:
        if verdict:
            row = verdict * self._asked
            self._rows = np.vstack([self._rows, row / np.abs(row).max()])
            self._find_centre()

    def policy(self) -> Policy:
        return self._small.best(self._centre)[0]

    def _constraints(self) -> tuple[Floats, Floats]:
        """Return rows (n, p) of which none may fall below 0, and what the centre has to spare."""
        rows = np.concatenate([np.eye(len(self._centre)), self._rows])
        relaxed = np.concatenate([self._centre, self._slack])
        return rows, relaxed

    def _end(self, rows: Floats, slack: Floats, axis: Floats) -> Floats:
        """Return the scale at which the axis leaves the polytope."""
        falls = -(rows @ axis)
        with np.errstate(divide="ignore"):
            steps = np.where(falls > 1e-12, slack / np.maximum(falls, 1e-300), np.inf)
        return self._centre + steps.min() * axis

    def _budget(self) -> float:
        worth = self._tails @ self._centre
        return float(self._rng.uniform(worth.min(), worth.max()))

    def _best_within(self, gaps: Floats, budget: float) -> Floats:
        """Return the best lottery (k,) for a scale that costs the centre no more than the budget.

        It is one policy within the budget, or a mixture of one within and one beyond that spends
        all of it.
        """
        worth, cost = self._tails @ gaps, self._tails @ self._centre
        within, beyond = np.flatnonzero(cost <= budget), np.flatnonzero(cost > budget)
        first = int(within[np.argmax(np.round(worth[within], 12))])
        best, chances = worth[first], np.eye(len(cost))[first]
        if len(beyond):
            apart = np.maximum(cost[beyond] - cost[within, None], 1e-300)
            share = np.clip((budget - cost[within, None]) / apart, 0.0, 1.0)
            mixed = (1 - share) * worth[within, None] + share * worth[beyond]
            i, j = np.unravel_index(np.argmax(np.round(mixed, 12)), mixed.shape)
            if mixed[i, j] > best + 1e-12:
                chances = np.zeros(len(cost))
                chances[within[i]], chances[beyond[j]] = 1 - share[i, j], share[i, j]
        return chances @ self._shares

    def _find_centre(self) -> None:
        """Find the analytic centre by Newton's method, after relaxing what contradicts."""
        p, n = len(self._centre), len(self._rows)
        # the scale with the largest slack, which is negative if answers contradict each other
        most = linprog(
            np.append(np.zeros(p), -1.0),
            A_ub=np.block([[-self._rows, np.ones((n, 1))], [-np.eye(p), np.ones((p, 1))]]),
            b_ub=np.zeros(n + p),
            A_eq=[np.append(np.ones(p), 0.0)],
            b_eq=[1.0],
            bounds=[(0, None)] * p + [(None, None)],
            method="highs",
        )
        spare, g = float(most.x[-1]), np.maximum(most.x[:-1], 0.0)
        if spare < 1e-7:  # contradictions: relax the answers, not the order
            least = linprog(
                np.append(np.zeros(p), 1.0),
                A_ub=np.block([-self._rows, -np.ones((n, 1))]),
                b_ub=np.zeros(n),
                A_eq=[np.append(np.ones(p), 0.0)],
                b_eq=[1.0],
                bounds=[(1e-4, None)] * p + [(0, None)],
                method="highs",
            )
            g, relax = least.x[:-1], float(least.x[-1]) + 1e-3
        else:
            relax = 0.0
        rows = np.concatenate([np.eye(p), self._rows])
        more = np.concatenate([np.zeros(p), np.full(n, relax)])
        flat = np.linalg.svd(np.ones((1, p)))[2][1:]
        for _ in range(200):
            inverse = 1.0 / (rows @ g + more)
            slope = flat @ (rows.T @ inverse)
            bend = flat @ ((rows.T * inverse**2) @ rows) @ flat.T
            step = np.linalg.solve(bend, slope)
            decrement = float(slope @ step)
            g = g + (step / (1.0 + np.sqrt(max(decrement, 0.0)))) @ flat
            if decrement < 1e-12:
                break
        self._centre, self._slack = g, self._rows @ g + relax
