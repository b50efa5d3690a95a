"""The two simplest ways to ask: random pairs of policies, and bisection of each level."""

from __future__ import annotations

import numpy as np

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.samplers import Posterior
from benchmarks.contest.small_mdp import Policy, SmallMDP, tails_of
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP


class RandomPairs:
    """Two random policies from a random start, and the mean of a posterior: no thought at all.

    The estimate is not simple: it knows the law of the tutor's errors. So a method below this one
    asks worse than at random, or learns less from what it hears.
    """

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._small = SmallMDP(mdp)
        self._posterior = Posterior(mdp.k, told, self._rng)

    def question(self) -> Question | None:
        for _ in range(100):
            start = int(self._rng.choice(self._small.starts))
            left, right = (self._run(start) for _ in range(2))
            self._tails = tails_of(left - right)
            if self._tails.min() < -1e-9 and self._tails.max() > 1e-9:  # not told by dominance
                break
        return left, right

    def tell(self, verdict: int) -> None:
        self._posterior.tell(self._tails, verdict)

    def policy(self) -> Policy:
        return self._small.best(self._posterior.mean)[0]

    def _run(self, start: int) -> Floats:
        return self._small.shares(self._small.random_policy(self._rng))[start]


class Bisection:
    """The standard gamble: level j for certain, or the best level with chance b, else the worst.

    Of the level whose value is known least, b is the middle; the order of the levels tightens the
    others. It ends when every level is known within half a percent of the range either way: then no
    policy that is best for the middle values loses more than one percent. It takes every answer for
    right.
    """

    WITHIN = 0.005

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        self._small = SmallMDP(mdp)
        self._low, self._high = np.zeros(mdp.k), np.ones(mdp.k)
        self._high[0], self._low[-1] = 0.0, 1.0

    def question(self) -> Question | None:
        lengths = self._high - self._low
        if lengths.max() <= 2 * self.WITHIN:
            return None
        self._level = int(np.argmax(np.round(lengths, 12)))
        self._chance = float(self._low[self._level] + self._high[self._level]) / 2
        certain = np.eye(mdp_k := len(lengths))[self._level]
        gamble = np.eye(mdp_k)[0] * (1 - self._chance) + np.eye(mdp_k)[-1] * self._chance
        return certain, gamble

    def tell(self, verdict: int) -> None:
        j, b = self._level, self._chance
        if verdict >= 0:
            self._low[j:] = np.maximum(self._low[j:], b)
        if verdict <= 0:
            self._high[: j + 1] = np.minimum(self._high[: j + 1], b)

    def policy(self) -> Policy:
        return self._small.best_for((self._low + self._high)[None] / 2)[0]
