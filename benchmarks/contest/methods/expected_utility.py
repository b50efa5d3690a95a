"""Expected value of information (Viappiani and Boutilier 2010): EUBO with a linear utility.

EUBO is the expected utility of the best option. The question is the pair of policies x and y that
maximises it: E max(x.g, y.g) over the drawn gaps g. Viappiani and Boutilier prove that this pair
also has the greatest expected value of information if the user never errs, and nearly the greatest
otherwise. Lin et al. (2022) and Astudillo et al. (qEUBO, 2023) maximise the same number with
Gaussian processes. On the same draws BoTorch's qEUBO agrees with this one to 1e-12
(``tests/benchmarks/contest/test_botorch.py``).

The authors' query iteration finds the pair. It divides the draws into those for which x is better
and the others. The best policy for the mean of each part is the new x or y. This is repeated as
long as E max increases, from several random starts, and the best pair found is asked about.

The policy returned is the best one for the mean scale. The method stops when the best question is
worth less than ``COST``.
"""

from __future__ import annotations

import numpy as np

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.samplers import Posterior
from benchmarks.contest.small_mdp import Policy, SmallMDP, tails_of
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

COST = 0.0001
"""Cost of a question, as a share of the value range: it stops below. Development seeds."""
STARTS = 6


class ExpectedUtility:
    """Pairs of policies from the start."""

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._small = SmallMDP(mdp)
        self._posterior = Posterior(mdp.k, told, self._rng)

    def question(self) -> Question | None:
        gaps = self._posterior.gaps
        now = float((tails_of(self._shares(self._posterior.mean[None])[0]) @ gaps.T).mean())
        found: list[tuple[float, Floats]] = []
        for _ in range(STARTS):
            pair = gaps[self._rng.choice(len(gaps), size=2, replace=False)]
            found.append(self._iterated(pair))
        worth, sides = max(found, key=lambda each: round(each[0], 9))
        if worth - now < COST:
            return None
        self._tails = tails_of(sides[0] - sides[1])
        return sides[0], sides[1]

    def tell(self, verdict: int) -> None:
        self._posterior.tell(self._tails, verdict)

    def policy(self) -> Policy:
        return self._small.best(self._posterior.mean)[0]

    def _iterated(self, pair: Floats) -> tuple[float, Floats]:
        """Return E max of two policies, and their shares (2, k), by query iteration."""
        gaps, best = self._posterior.gaps, -np.inf
        sides = self._shares(pair)
        for _ in range(20):
            values = tails_of(sides) @ gaps.T
            worth = float(values.max(axis=0).mean())
            if worth <= best + 1e-9:
                break
            best, kept = worth, sides
            left = values[0] > values[1] + 1e-12
            if left.all() or not left.any():
                break
            sides = self._shares(np.array([gaps[left].mean(axis=0), gaps[~left].mean(axis=0)]))
        return best, kept

    def _shares(self, gaps: Floats) -> Floats:
        return np.array([self._small.from_start(policy) for policy in self._small.best(gaps)])
