"""An ordinal MDP as dense arrays, to solve it for many scales at once.

The problems of the contest have some dozens of states. Policies are compared from where episodes
start, by their tail sums: the share of time at or above each level but the worst. The value of a
policy is the product of its tail sums and the gaps between levels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

Policy = NDArray[np.int64] | Floats  # (S,) actions, or (S, A) probabilities
_TIE = 1e-9  # of values; actions so close are equally good, and the first is taken
_NEVER = -1e6  # the gain of an action that is not admissible


def values_of(gaps: Floats) -> Floats:
    """Return the values (..., k) of the levels, from gaps (..., k - 1) between them."""
    return np.concatenate([np.zeros((*gaps.shape[:-1], 1)), np.cumsum(gaps, axis=-1)], axis=-1)


def tails_of(shares: Floats) -> Floats:
    """Return the tail sums (..., k - 1) of share vectors (..., k)."""
    return np.cumsum(shares[..., :0:-1], axis=-1)[..., ::-1]


class SmallMDP:
    """Dense arrays of an ordinal MDP, and exact solutions by policy iteration."""

    def __init__(self, mdp: OrdinalMDP) -> None:
        self.mdp = mdp
        self.k = mdp.k
        n, m = mdp.levels.shape
        self._moves = np.asarray(mdp.transitions.toarray()).reshape(n, m, n)
        self._levels = np.where(mdp.terminal[:, None], mdp.final_level[:, None], mdp.levels)
        self._open = mdp.admissible | mdp.terminal[:, None]
        for s in np.flatnonzero(mdp.terminal):
            self._moves[s] = 0.0
            self._moves[s, :, s] = 1.0
        self._discount = mdp.discount
        self._states = np.arange(n)
        self.starts = np.flatnonzero(mdp.initial > 0)

    def best(self, gaps: Floats) -> NDArray[np.int64]:
        """Return optimal policies (m, S) for gaps (m, k - 1), which may be negative."""
        return self.best_for(values_of(np.atleast_2d(gaps)))

    def best_for(self, values: Floats) -> NDArray[np.int64]:
        """Return optimal policies (m, S) for values of levels (m, k)."""
        gain = (1.0 - self._discount) * values[:, self._levels]
        gain = np.where(self._open, gain, _NEVER)
        policy = gain.argmax(axis=2)
        for _ in range(200):
            q = self._q(gain, policy)
            chosen = np.take_along_axis(q, policy[..., None], axis=2)[..., 0]
            better = q.max(axis=2) > chosen + _TIE
            if not better.any():
                break
            policy = np.where(better, q.argmax(axis=2), policy)
        first: NDArray[np.int64] = (q >= q.max(axis=2, keepdims=True) - _TIE).argmax(axis=2)
        return first

    def _q(self, gain: Floats, policy: NDArray[np.int64]) -> Floats:
        """Return the values (m, S, A) of actions that are followed by each of m policies."""
        chains = self._moves[self._states, policy]
        reward = np.take_along_axis(gain, policy[..., None], axis=2)
        v = np.linalg.solve(np.eye(len(self._states)) - self._discount * chains, reward)[..., 0]
        return gain + self._discount * np.einsum("sat,mt->msa", self._moves, v, optimize=True)

    def shares(self, policy: Policy) -> Floats:
        """Return the shares (S, k) of time at each level from each state."""
        weights = self.weights(policy)
        chain = np.einsum("sa,sat->st", weights, self._moves)
        gain = (1.0 - self._discount) * np.einsum(
            "sa,sak->sk", weights, np.eye(self.k)[self._levels]
        )
        found = np.linalg.solve(np.eye(len(self._states)) - self._discount * chain, gain)
        found = np.maximum(found, 0.0)
        return found / found.sum(axis=1, keepdims=True)

    def weights(self, policy: Policy) -> Floats:
        """Return the probabilities (S, A) of the actions."""
        if policy.ndim == 2:
            return np.asarray(policy, dtype=np.float64)
        return np.eye(self._levels.shape[1])[policy]

    def from_start(self, policy: Policy) -> Floats:
        """Return the shares (k,) from where episodes start."""
        return self.mdp.initial @ self.shares(policy)

    def losses(self, policy: Policy, values: Floats, optimum: Floats) -> tuple[float, float]:
        """Return the loss at the worst state and from the start; ``optimum`` (S,) is v*."""
        loss = np.maximum(optimum - self.shares(policy) @ values, 0.0)
        return float(loss.max()), float(self.mdp.initial @ loss)

    def mixed(self, policies: NDArray[np.int64], chances: Floats) -> Floats:
        """Return the policy (S, A) that from the start does what a lottery over policies does.

        Where no episode comes it follows the likeliest of them.
        """
        weights = np.zeros(self._levels.shape)
        for policy, chance in zip(policies, chances, strict=True):
            chain = self._moves[self._states, policy]
            visits = np.linalg.solve(
                (np.eye(len(self._states)) - self._discount * chain).T, self.mdp.initial
            )
            weights[self._states, policy] += chance * np.maximum(visits, 0.0)
        likeliest = self.weights(policies[int(np.argmax(np.round(chances, 9)))])
        total = weights.sum(axis=1, keepdims=True)
        return np.where(total > 1e-12, weights / np.maximum(total, 1e-12), likeliest)

    def random_policy(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Return a policy whose actions are drawn uniformly."""
        return np.where(self._open, rng.random(self._open.shape), -1.0).argmax(axis=1)


def drawn_gaps(k: int, count: int, rng: np.random.Generator) -> Floats:
    """Return gaps (count, k - 1) drawn uniformly from all that total 1."""
    return rng.dirichlet(np.ones(k - 1), size=count)


def coverage_set(small: SmallMDP, rng: np.random.Generator) -> tuple[NDArray[np.int64], Floats]:
    """Return policies (n, S) that are best for some scale, and their shares (n, k) from the start.

    Scales are drawn until 200 of them; policies with the same shares count once.
    """
    policies = small.best(drawn_gaps(small.k, 200, rng))
    policies = np.unique(policies, axis=0)
    shares = np.array([small.from_start(policy) for policy in policies])
    _, first = np.unique(np.round(shares, 7), axis=0, return_index=True)
    first.sort()
    return policies[first], shares[first]


def trajectory_set(small: SmallMDP, count: int, rng: np.random.Generator) -> Floats:
    """Return shares (count, k) of runs that begin where an episode may start.

    Every other one follows a policy that is best for a drawn scale, the others a random policy.
    """
    half = count // 2
    policies = [*small.best(drawn_gaps(small.k, half, rng))]
    policies += [small.random_policy(rng) for _ in range(count - half)]
    starts = rng.choice(len(small.mdp.initial), size=count, p=small.mdp.initial)
    return np.array([small.shares(policy)[s] for policy, s in zip(policies, starts, strict=True)])
