"""Active preference-based reward learning, after APReL (Biyik, Talati and Sadigh 2022).

Written anew after the package's code, with its defaults: a set of 40 trajectories, questions chosen
among all their pairs, a softmax model of the user, and 100 samples of weights of length one by
Metropolis-Hastings. ``tests/benchmarks/contest/test_methods.py`` compares acquisition functions,
chosen questions and means of the sampler with figures that the package itself computed.
Differences:

- Features are tail sums, and no weight is negative: that is the order of the levels.
- A trajectory is the expected shares of a run. Half of the set follow policies that are best for
  some scale; the package's examples have random ones only.
- Volume removal is that of Sadigh et al. (2017), with their model of an answer. The package's code
  maximises the sum of the squared chances of the answers, which is greatest for the question whose
  answer is surest; the least sum, in turn, is that of two equal trajectories.
- Max regret is that of Wilde, Kulic and Smith (2020), by ratios, as IDRL's code has it: how much
  reward each scale loses by the other's best trajectory. The package's code divides the reward of
  one trajectory under two scales. So it asked, on the development seeds, 9 times of 10 about two
  equal trajectories. (As published it stops with an error: its set of trajectories has no length.)
- The policy is the best one for the mean weights. The package itself stops at the weights.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from scipy.special import expit

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.samplers import UnitWeights
from benchmarks.contest.small_mdp import Policy, SmallMDP, tails_of, trajectory_set
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

TRAJECTORIES = 40
BETAS = {"truthful": 100.0, "flips": 10.0, "eq. (6)": 20.0, "person": 20.0}
"""The user's rationality, by tutor: chosen on the development seeds."""
LAMBDA = 0.01
"""Weight of the distance of two weights beside their probabilities, in disagreement."""

Rule = Callable[["Belief"], tuple[int, int]]


class Belief:
    """The belief that a rule for questions sees: features (n, p) of trajectories, drawn weights."""

    def __init__(self, features: Floats, beta: float, rng: np.random.Generator) -> None:
        self.features, self.beta, self.rng = features, beta, rng
        self.pairs = np.array(list(combinations(range(len(features)), 2)))
        self.belief = UnitWeights(features.shape[1], beta, rng)

    @property
    def weights(self) -> Floats:
        """(m, p) samples."""
        return self.belief.weights

    @property
    def logs(self) -> Floats:
        """(m,) logarithms of their chances, but for a constant."""
        return self.belief.logs

    def rewards(self) -> Floats:
        """Return the rewards (pairs, m) of the first less the second, times beta."""
        d = self.features[self.pairs[:, 0]] - self.features[self.pairs[:, 1]]
        return np.asarray(self.beta * (d @ self.weights.T))

    def best_ones(self) -> list[int]:
        """Return the best trajectory for each sample."""
        rewards = np.round(self.features @ self.weights.T, 12)
        return [int(i) for i in rewards.argmax(axis=0)]


def mutual_information(chance: Floats) -> Floats:
    """Return bits of information (pairs,) from chances (pairs, m)."""
    both = np.stack([chance, 1.0 - chance])
    mean = both.mean(axis=2, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.where(both > 0, both * np.log2(both / mean), 0.0)
    return parts.mean(axis=2).sum(axis=0)


def volume_removal(rewards: Floats) -> Floats:
    """Return the volume (pairs,) that either answer removes at the least (Sadigh et al. 2017).

    ``rewards`` (pairs, m) are the rewards of the first less the second, times beta. Their model of
    an answer is min(1, exp(reward)), so two equal trajectories remove nothing.
    """
    first = -np.expm1(np.minimum(rewards, 0.0)).mean(axis=1)
    second = -np.expm1(np.minimum(-rewards, 0.0)).mean(axis=1)
    return np.minimum(first, second)


def disagreement(weights: Floats, logs: Floats) -> float:
    """Return how far two weights (2, p) disagree (Katz et al. 2019)."""
    return float(np.exp(logs).prod() + LAMBDA * np.linalg.norm(weights[0] - weights[1]))


def regret(weights: Floats, logs: Floats, features: Floats) -> float:
    """Return the regret of two weights (2, p), each with its best trajectory (Wilde et al. 2020).

    How much of its own best reward each gives up by the other's trajectory, times their chances.
    """
    own = features @ weights.T  # (trajectory, weights)
    given_up = 2.0 - own[1, 0] / own[0, 0] - own[0, 1] / own[1, 1]
    return float(np.exp(logs).prod() * given_up)


def _greatest(scores: Floats) -> int:
    """Return the first of the greatest scores, which may all be tiny."""
    return int(np.argmax(np.round(scores / max(float(scores.max()), 1e-300), 9)))


def by_information(belief: Belief) -> tuple[int, int]:
    """Choose the pair with the most information."""
    i, j = belief.pairs[_greatest(mutual_information(expit(belief.rewards())))]
    return int(i), int(j)


def by_volume(belief: Belief) -> tuple[int, int]:
    """Choose the pair whose answer removes the most."""
    i, j = belief.pairs[_greatest(volume_removal(belief.rewards()))]
    return int(i), int(j)


def by_disagreement(belief: Belief) -> tuple[int, int]:
    """Choose the best trajectories of the two samples that disagree most."""
    w, likely = belief.weights, np.exp(belief.logs)
    apart = np.linalg.norm(w[:, None] - w[None], axis=2)
    return _of_two_samples(belief, np.outer(likely, likely) + LAMBDA * apart)


def by_regret(belief: Belief) -> tuple[int, int]:
    """Choose the best trajectories of the two samples with the greatest regret."""
    likely, chosen = np.exp(belief.logs), belief.best_ones()
    rewards = np.maximum(belief.features[chosen] @ belief.weights.T, 1e-12)  # (best of i, under j)
    given_up = 1.0 - rewards / np.diag(rewards)
    return _of_two_samples(belief, np.outer(likely, likely) * (given_up + given_up.T))


def _of_two_samples(belief: Belief, scores: Floats) -> tuple[int, int]:
    first, second = np.triu_indices(len(scores), 1)
    best = belief.best_ones()
    at = _greatest(scores[first, second])
    return best[first[at]], best[second[at]]


def by_thompson(belief: Belief) -> tuple[int, int]:
    """Draw two different ones among the best trajectories of the samples (Tucker et al. 2019)."""
    best, inverse = np.unique(belief.best_ones(), return_inverse=True)
    if len(best) < 2:
        others = np.setdiff1d(np.arange(len(belief.features)), best)
        return int(best[0]), int(belief.rng.choice(others))
    likely = np.bincount(inverse, weights=np.exp(belief.logs))
    if np.count_nonzero(likely) < 2:
        likely = np.ones(len(best))
    i, j = belief.rng.choice(best, size=2, replace=False, p=likely / likely.sum())
    return int(i), int(j)


RULES: dict[str, Rule] = {
    "mutual information": by_information,
    "volume removal": by_volume,
    "max regret": by_regret,
    "disagreement": by_disagreement,
    "thompson": by_thompson,
}


class APReL:
    """One acquisition function. It has no rule to stop."""

    def __init__(self, rule: str) -> None:
        self._rule = RULES[rule]

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._small = SmallMDP(mdp)
        self._set = trajectory_set(self._small, TRAJECTORIES, rng)
        self._belief = Belief(tails_of(self._set), BETAS[told.law], rng)

    def question(self) -> Question | None:
        i, j = self._rule(self._belief)
        self._tails = self._belief.features[i] - self._belief.features[j]
        return self._set[i], self._set[j]

    def tell(self, verdict: int) -> None:
        self._belief.belief.tell(self._tails, verdict)

    def policy(self) -> Policy:
        mean = self._belief.belief.mean
        return self._small.best(mean / mean.sum())[0]
