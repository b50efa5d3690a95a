"""How much a policy can still lose, whatever the plausible scale: an upper bound, and the confidence in it.

For any V (S, k) let A(s, a) = Q(s, a) - V(s), a share vector's worth of advantage. Under a scale e the optimum exceeds
V.e by no more than the greatest discounted total of A.e that any policy can collect. Each A(s, a).e is bounded over all
plausible scales at once (``elicit.comparator.simultaneous_bounds``), and what can be collected of these bounds is a
scalar MDP, solved here: at most their greatest over 1 - discount, and mostly far less, for few pairs are open and no run
is always at one of them. Nothing need be exact but these bounds: V's own error is bounded along with the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit.comparator import Comparator, simultaneous_bounds
from elicit.scale import Floats, tail_sums
from qlearn.backup import model_of, q_of
from qlearn.mdp import OrdinalMDP
from qlearn.planning import Actions, _solve, evaluate_policy

_ROUNDING = 1e-14  # more than the rounding of one advantage
_TIE = 1e-13


class Guarantee(NamedTuple):
    """``loss_bound``: the policy loses at most this share of the value range, from whatever state; ``confidence``: the
    probability of that, 1 where it is proven (if the answers were right), nan where none can be stated."""

    loss_bound: float
    confidence: float


class Advantages(NamedTuple):
    """What a policy of vector value ``v`` (S, k) forgoes: of each admissible (state, action) that it does not take, in
    order, Q(s, a) - V(s) as a row of ``d`` (n, k)."""

    policy: Actions  # (S,)
    v: Floats
    q: Floats  # (S, A, k)
    states: NDArray[np.int64]  # (n,)
    actions: NDArray[np.int64]  # (n,)
    d: Floats
    doubt: float  # no ordered scale sees the policy's own advantages, which should be 0, farther from it


def advantages(mdp: OrdinalMDP, policy: ArrayLike) -> Advantages:
    """The advantages over a deterministic policy (S,). Raises ValueError as ``evaluate_policy`` does."""
    taken = np.asarray(policy)
    v = evaluate_policy(mdp, taken)
    q = q_of(np.arange(mdp.n_states), v, model_of(mdp))
    wanted = mdp.admissible & ~mdp.terminal[:, None]
    live = np.flatnonzero(~mdp.terminal)
    own = np.abs(tail_sums(q[live, taken[live]] - v[live])).max(initial=0.0)
    wanted[live, taken[live]] = False
    states, actions = np.nonzero(wanted)
    return Advantages(taken, v, q, states, actions, q[states, actions] - v[states], float(own) + _ROUNDING)


def loss_bound(mdp: OrdinalMDP, policy: ArrayLike, comparator: Comparator) -> Guarantee:
    """An upper bound on what ``policy`` (S,) loses from any state, in shares of the value range, over all scales that
    the comparator holds plausible. It reads the MDP's transition probabilities. Raises ValueError."""
    over = advantages(mdp, policy)
    high, confidence = simultaneous_bounds(comparator, over.d)
    return Guarantee(float(collected(mdp, over, high).max(initial=0.0)), confidence)


def collected(mdp: OrdinalMDP, over: Advantages, high: Floats) -> Floats:
    """Upper bounds (S,), at most 1, on the discounted total of advantages that any policy collects from each state,
    if each is at most ``high`` (n,)."""
    gain = np.full(mdp.levels.shape, -np.inf)
    live = np.flatnonzero(~mdp.terminal)
    gain[live, over.policy[live]] = 0.0
    gain[over.states, over.actions] = high
    gain[live] += _ROUNDING
    total = np.zeros(mdp.n_states)
    if gain.max() > _ROUNDING:
        total = _greatest_total(mdp, gain)
    total[live] += over.doubt / (1 - mdp.discount)
    return np.clip(total, 0.0, 1.0)


def _greatest_total(mdp: OrdinalMDP, gain: Floats) -> Floats:
    """The greatest expected discounted total (S,) of gain (S, A), rounded up: policy iteration proposes, a sweep
    certifies. -inf: no such action; terminal states gain nothing."""
    rows, live = np.arange(mdp.n_states), ~mdp.terminal
    policy, v = gain.argmax(axis=1), np.zeros(mdp.n_states)

    def action_values() -> Floats:
        q: Floats = gain + mdp.discount * (mdp.transitions @ v).reshape(gain.shape)
        q[mdp.terminal] = 0.0
        return q

    for _ in range(50):
        chain = mdp.transitions[rows * mdp.n_actions + policy][live]
        v[live] = _solve(chain[:, live], gain[rows, policy][live][:, None], mdp.discount)[:, 0]
        q = action_values()
        better = q.max(axis=1) > q[rows, policy] + _TIE
        if not better.any():
            break
        policy = np.where(better, q.argmax(axis=1), policy)
    change = float((q.max(axis=1) - v).max())
    return np.where(live, v + (max(change, 0.0) + _ROUNDING) / (1 - mdp.discount), 0.0)
