"""Ordered preference elicitation with a Gaussian process (Zintgraf et al., AAMAS 2018).

Written anew after the authors' code, with its defaults but for the noise: a Gaussian process over
the value vectors of a coverage set, with a squared exponential kernel of variance .64 and width
.15, a prior mean of zero, the probit likelihood of Chu and Ghahramani (2005) and Laplace's
approximation. The next question compares the winner of the last one with the policy of the greatest
expected improvement that the winner has not met; the first one compares two random policies. The
estimate is the policy with the greatest mean. It ends when no policy is left to compare.

Objectives are tail sums, each scaled to 0..1 over the coverage set. That more is better is told as
in the authors' Figure 4: in the first five questions the new policy beats the worst vector (all 0)
and loses to the best one (all 1), without a question. Of their variants (a prior mean that is zero,
linear, or linear at first; such comparisons never, at first, or always) this one lost least on the
development seeds. The utility need not be linear.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.small_mdp import Policy, SmallMDP, coverage_set, tails_of
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

VARIANCE, WIDTH, IMPROVEMENT = 0.8**2, 0.15, 0.01
NOISE = {"truthful": 0.01, "flips": 0.2, "eq. (6)": 0.01, "person": 0.1}
"""Standard deviation of the utility's noise, by tutor. The authors' is .01; these were chosen on
the development seeds."""
REFERENCES = 5
"""Questions in which the new policy is compared with the worst and the best vector, too."""


class GaussianProcess:
    """The process at points (n, p), after answers (winner, loser).

    The prior mean is zero, or with ``linear`` the mean of the objectives.
    """

    def __init__(self, points: Floats, noise: float, linear: bool = False) -> None:
        apart = ((points[:, None] - points[None]) ** 2).sum(axis=2)
        self._cov = VARIANCE * np.exp(-apart / (2 * WIDTH**2))
        self._prior = points.mean(axis=1) if linear else np.zeros(len(points))
        self._noise = noise
        self._wins: list[tuple[int, int]] = []
        self.mean, self.variance = self._prior, np.diag(self._cov).copy()

    def tell(self, *wins: tuple[int, int]) -> None:
        """Take answers (winner, loser), and find the mean and variance of every point."""
        self._wins += wins
        self._find()

    def _find(self) -> None:
        wins = np.array(self._wins)
        seen, places = np.unique(wins, return_inverse=True)
        wins = places.reshape(-1, 2)
        n, m = len(seen), len(wins)
        rows = np.zeros((m, n))
        rows[np.arange(m), wins[:, 0]] = 1.0
        rows[np.arange(m), wins[:, 1]] = -1.0
        rows /= np.sqrt(2) * self._noise
        cov = self._cov[np.ix_(seen, seen)] + self._noise**2 * np.eye(n)
        inverse = np.linalg.inv(cov)
        prior = self._prior[seen]
        f = prior.copy()
        for _ in range(200):
            z = rows @ f
            ratio = np.exp(norm.logpdf(z) - norm.logcdf(z))
            bend = inverse + (rows.T * (ratio * (ratio + z))) @ rows
            step = np.linalg.solve(bend, rows.T @ ratio - inverse @ (f - prior))
            size = float(np.abs(step).max())
            f = f + step / max(1.0, size / 0.1)
            if size < 1e-9:
                break
        z = rows @ f
        ratio = np.exp(norm.logpdf(z) - norm.logcdf(z))
        curved = (rows.T * (ratio * (ratio + z))) @ rows
        across = self._cov[:, seen]
        self.mean = self._prior + across @ inverse @ (f - prior)
        # cov (W cov + 1)^-1 W, without the inverse of W, which has none
        shrink = np.linalg.solve(np.eye(n) + curved @ cov, curved)
        taken = np.einsum("ij,jk,ik->i", across, shrink, across)
        self.variance = np.maximum(np.diag(self._cov) - taken, 1e-12)

    def improvement(self, best: float) -> Floats:
        """Return the expected improvement (n,) on a utility."""
        spread = np.sqrt(self.variance)
        gain = self.mean - best - IMPROVEMENT
        return gain * norm.cdf(gain / spread) + spread * norm.pdf(gain / spread)


class OrderedElicitation:
    """The winner so far against the policy that promises most."""

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        self._rng = rng = np.random.default_rng(seed)
        self._policies, self._shares = coverage_set(SmallMDP(mdp), rng)
        tails = tails_of(self._shares)
        low, high = tails.min(axis=0), tails.max(axis=0)
        scaled = (tails - low) / np.where(high > low, high - low, 1.0)
        # the last two points are the worst and the best vector
        ends = np.repeat([[0.0], [1.0]], scaled.shape[1], axis=1)
        self._process = GaussianProcess(np.concatenate([scaled, ends]), NOISE[told.law])
        self._winner = -1
        self._met: set[tuple[int, int]] = set()
        self._asked: list[int] = []

    def question(self) -> Question | None:
        n = len(self._policies)
        best = float(self._process.mean[self._asked].max()) if self._asked else 0.0
        promise = np.round(self._process.improvement(best)[:n], 12)
        order = np.argsort(-promise, kind="stable")
        if self._winner < 0:  # all promise the same
            order = self._rng.permutation(n)
            self._winner = int(order[0])
        for other in order:
            if other != self._winner and (self._winner, int(other)) not in self._met:
                self._other = int(other)
                return self._shares[self._winner], self._shares[self._other]
        return None

    def tell(self, verdict: int) -> None:
        left, right = self._winner, self._other
        self._met |= {(left, right), (right, left)}
        self._asked += [left, right]
        wins = []
        if len(self._asked) <= 2 * REFERENCES:
            worst, best = len(self._policies), len(self._policies) + 1
            new = (left, right) if len(self._asked) == 2 else (right,)
            wins += [pair for i in new for pair in ((i, worst), (best, i))]
        if verdict:
            self._winner, loser = (left, right) if verdict > 0 else (right, left)
            wins.append((self._winner, loser))
        if wins:
            self._process.tell(*wins)

    def policy(self) -> Policy:
        means = self._process.mean[: len(self._policies)]
        return self._policies[int(np.argmax(np.round(means, 9)))]
