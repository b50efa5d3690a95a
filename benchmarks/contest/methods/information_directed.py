"""Information directed reward learning: IDRL (Lindner et al., NeurIPS 2021).

Written anew after the authors' code. Each question in two steps:

1. Plausibly optimal policies by Thompson sampling from a Gaussian over rewards. Of these, the two
   whose difference of return is most uncertain.
2. The question that tells most of this difference: the one after which its variance is least, as
   if it had been answered.

The Gaussian is over the gaps between levels. Its prior has the mean and covariance of uniformly
drawn ordered scales (the authors': mean zero), and Laplace's approximation takes in the answers, as
in the authors' version for preferences with networks. Their tables instead read an answer as a
noisy difference of plus or minus one. The variance that an answer would leave is compared with a
figure that the authors' code computed. The Gaussian knows the order of the levels only from its
mean, as it has a place for nothing else. The questions compare 40 trajectories and the policies of
step 1. The estimate is the best policy for the mean. It has no rule to stop.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.special import expit

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.small_mdp import Policy, SmallMDP, tails_of, trajectory_set
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

CANDIDATES = 10
TRAJECTORIES = 40
STEEPNESS = {"truthful": 50.0, "flips": 20.0, "eq. (6)": 30.0, "person": 20.0}
"""Logits per unit of value, by tutor: chosen on the development seeds."""


class Laplace:
    """A Gaussian over gaps (p,), by the mode of the posterior and its curvature."""

    def __init__(self, p: int, steepness: float) -> None:
        self._c = steepness
        self._prior = np.full(p, 1.0 / p)
        # uniform on the simplex: its covariance, made regular along the total, which is fixed
        self._inverse = p * (p + 1.0) * (np.eye(p) + np.ones((p, p)) * 100.0)
        self._rows = np.empty((0, p))
        self.mean, self.covariance = self._prior, np.linalg.inv(self._inverse)

    def tell(self, row: Floats) -> None:
        """Take a difference (p,) that was answered "better"."""
        self._rows = np.vstack([self._rows, row])
        g = self.mean.copy()
        for _ in range(100):
            chance = expit(self._c * (self._rows @ g))
            slope = self._c * self._rows.T @ (1 - chance) - self._inverse @ (g - self._prior)
            bend = self._curvature(chance)
            step = np.linalg.solve(bend, slope)
            g, before = g + step / max(1.0, 5.0 * float(np.abs(step).max())), g
            if np.abs(g - before).max() < 1e-10:
                break
        self.mean = g
        bend = self._curvature(expit(self._c * (self._rows @ g)))
        self.covariance = np.linalg.inv(bend)

    def _curvature(self, chance: Floats) -> Floats:
        weights = self._c**2 * chance * (1 - chance)
        return self._inverse + (self._rows.T * weights) @ self._rows

    def left_after(self, d: Floats, about: Floats) -> Floats:
        """Return the variance of ``about`` (p,) after questions d (n, p), as if answered."""
        chance = expit(self._c * (d @ self.mean))
        weights = self._c**2 * chance * (1 - chance)
        along = d @ self.covariance
        gain = weights * (along @ about) ** 2 / (1 + weights * np.einsum("ij,ij->i", along, d))
        return float(about @ self.covariance @ about) - gain


class InformationDirected:
    """IDRL with policies and trajectories as questions."""

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._small = SmallMDP(mdp)
        self._set = trajectory_set(self._small, TRAJECTORIES, self._rng)
        self._belief = Laplace(mdp.k - 1, STEEPNESS[told.law])

    def question(self) -> Question | None:
        drawn = self._rng.multivariate_normal(
            self._belief.mean, self._belief.covariance, size=CANDIDATES, method="cholesky"
        )
        policies = np.unique(self._small.best(drawn), axis=0)
        shares = np.array([self._small.from_start(policy) for policy in policies])
        tails = tails_of(shares)
        options = np.concatenate([shares, self._set])
        features = tails_of(options)
        pairs = np.array(list(combinations(range(len(options)), 2)))
        d = features[pairs[:, 0]] - features[pairs[:, 1]]
        apart = np.array([tails[i] - tails[j] for i, j in combinations(range(len(tails)), 2)])
        if len(apart):
            spread = np.einsum("ij,jk,ik->i", apart, self._belief.covariance, apart)
            about = apart[int(np.argmax(np.round(spread, 12)))]
            left = self._belief.left_after(d, about)
            chosen = int(np.argmin(np.round(left, 14)))
        else:  # one plausible policy: anything that is uncertain
            spread = np.einsum("ij,jk,ik->i", d, self._belief.covariance, d)
            chosen = int(np.argmax(np.round(spread, 12)))
        i, j = pairs[chosen]
        self._tails = d[chosen]
        return options[i], options[j]

    def tell(self, verdict: int) -> None:
        if verdict:
            self._belief.tell(verdict * self._tails)

    def policy(self) -> Policy:
        return self._small.best(self._belief.mean)[0]
