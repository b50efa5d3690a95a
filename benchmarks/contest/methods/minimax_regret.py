"""Minimax regret with its own policy (Regan and Boutilier 2009, 2010), by bound queries.

The incumbent is the policy whose greatest regret over all scales that are still possible is least.
It may be random: a lottery over policies, here as a policy with probabilities of actions. The
questions are the authors': is level j worth more than b? As a comparison: level j for certain, or
the best level with chance b and the worst otherwise. b is the middle of what level j may be worth.

- Halve the largest gap: the level whose range of possible values is longest.
- Current solution: the level whose range counts most, times the share of time that either the
  incumbent or its adversary spends there.

The authors solve a linear program for the incumbent and an integer program for its adversary, and
later use nondominated policies. Here the set of scales is given by its vertices. The regret is
convex in the scale, so its maximum is at a vertex, where the adversary is an ordinary optimal
policy. The incumbent is a linear program over lotteries, whose columns, policies, are generated
until none improves it. Both are exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.small_mdp import Policy, SmallMDP, tails_of
from benchmarks.contest.vertices import ScaleSet
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

TOLERANCE = 0.01
"""The greatest regret from the start at which it stops: what it then proves."""


class MinimaxRegret:
    """Either rule for the next question; ``question`` is None once the regret is proven small."""

    def __init__(self, rule: str) -> None:
        self._rule = rule

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        self._small, self._scales = SmallMDP(mdp), ScaleSet(mdp.k)
        self._solved: dict[bytes, tuple[int, float]] = {}  # vertex: best policy's row, its value
        self._rows: dict[bytes, int] = {}
        self._policies: list[NDArray[np.int64]] = []
        self._shares: list[Floats] = []
        self._solve()

    def question(self) -> Question | None:
        if self.regret <= TOLERANCE:
            return None
        low, high = self._scales.ranges()
        lengths = high - low
        if self._rule == "current solution":
            lengths = lengths * np.maximum(self._incumbent, self._adversary)
        j = int(np.argmax(np.round(lengths, 12)))
        middle = (low[j] + high[j]) / 2
        if high[j] - low[j] < 1e-9:
            return None
        k = self._small.k
        certain, gamble = np.eye(k)[j], (1 - middle) * np.eye(k)[0] + middle * np.eye(k)[-1]
        self._row = tails_of(certain - gamble)
        return certain, gamble

    def tell(self, verdict: int) -> None:
        if verdict >= 0:
            self._scales.cut(self._row)
        if verdict <= 0:
            self._scales.cut(-self._row)
        self._solve()

    def policy(self) -> Policy:
        used = np.flatnonzero(self._chances > 1e-9)
        policies = np.array([self._policies[i] for i in used])
        return self._small.mixed(policies, self._chances[used])

    def _solve(self) -> None:
        """Find the incumbent, its greatest regret, and the adversary who shows it."""
        vertices = self._scales.vertices
        keys = [np.round(vertex, 12).tobytes() for vertex in vertices]
        new = [i for i, key in enumerate(keys) if key not in self._solved]
        if new:
            for i, policy in zip(new, self._small.best(vertices[new]), strict=True):
                row = self._known(policy)
                value = float(tails_of(self._shares[row]) @ vertices[i])
                self._solved[keys[i]] = row, value
        most = np.array([self._solved[key][1] for key in keys])
        for _ in range(100):
            tails = tails_of(np.array(self._shares))
            reached = vertices @ tails.T  # (vertices, policies)
            found = linprog(
                np.append(np.zeros(len(tails)), 1.0),
                A_ub=-np.column_stack([reached, np.ones(len(most))]),
                b_ub=-most,
                A_eq=[np.append(np.ones(len(tails)), 0.0)],
                b_eq=[1.0],
                bounds=[(0, None)] * len(tails) + [(None, None)],
                method="highs",
            )
            weights = -np.asarray(found.ineqlin.marginals)
            mixture = weights @ vertices / weights.sum()
            row = self._known(self._small.best(mixture)[0])
            better = float(tails_of(self._shares[row]) @ mixture)
            if better <= float((reached.T @ (weights / weights.sum())).max()) + 1e-7:
                break
        self._chances = np.zeros(len(self._policies))
        self._chances[: len(tails)] = np.maximum(found.x[:-1], 0.0)
        self._chances /= self._chances.sum()
        self._incumbent = self._chances @ np.array(self._shares)
        regrets = most - vertices @ tails_of(self._incumbent)
        worst = int(np.argmax(np.round(regrets, 9)))
        self.regret = float(regrets[worst])
        self._adversary = self._shares[self._solved[keys[worst]][0]]

    def _known(self, policy: NDArray[np.int64]) -> int:
        """Return the row of a policy, which is kept."""
        key = policy.tobytes()
        if key not in self._rows:
            self._rows[key] = len(self._policies)
            self._policies.append(policy)
            self._shares.append(self._small.from_start(policy))
        return self._rows[key]
