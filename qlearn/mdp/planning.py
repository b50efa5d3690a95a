"""Planning with a known scale: solving an MDP, and the value of a given policy.

Values are in shares: v = (1 - discount) times the discounted sum of rewards on a scale from 0 to 1.
So v is between 0 and 1 whatever the discount, and a policy's vector value is a distribution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from elicit._support.threads import one_thread
from elicit._support.validation import is_number, require
from elicit.model.scale import Floats
from qlearn.mdp.array_checks import Flags, reject
from qlearn.mdp.linear_systems import discounted_totals
from qlearn.mdp.ordinal_mdp import OrdinalMDP

Actions = NDArray[np.int64]

_TIE = 1e-13  # two actions' values differ by less than this through rounding alone
_FLOOR = 2.0**-50  # a sweep's change below this is rounding


@one_thread
def value_iteration(
    mdp: OrdinalMDP, values: ArrayLike, tolerance: float = 1e-10
) -> tuple[Floats, Actions]:
    """Return the optimal value v (S,) in shares and an optimal policy (S,), for a known scale.

    The value satisfies the paper's eq. (2), v(s) = max_a (1 - discount) e_level(s,a) + discount *
    sum p(s, a, s') v(s') over admissible a, and |v - v*| <= ``tolerance`` at every state. A
    terminal state's v is its normalised value exactly. Policy iteration finds the solution. Bellman
    sweeps then prove it: |v - v*| <= (last change) * discount / (1 - discount).

    Parameters
    ----------
    mdp : OrdinalMDP
    values : (k,)
        The scale, which is normalised to 0..1.
    tolerance : float
        A share of the value range.

    Returns
    -------
    v : (S,)
    policy : (S,)
        Greedy for v. Actions within 1e-13 of the best tie, and the lowest index is taken.

    Raises
    ------
    ValueError
        For bad ``values``, or a ``tolerance`` too small for floats.
    """
    gain, ends = rewarded(mdp, mdp.normalise(values))
    holds = is_number(tolerance) and tolerance > 0
    require(holds, "tolerance", "a positive number (a share of the value range)", tolerance)
    v = policy_iteration(mdp, gain, ends)[0]
    while True:
        previous, q = v, backed_up(mdp, gain, ends, v)
        v = q.max(axis=1)
        change = float(np.abs(v - previous).max())
        bound = change * mdp.discount / (1 - mdp.discount)
        if bound <= tolerance:
            return np.clip(v, 0.0, 1.0), _first_best(q)  # rounding may leave 1 + 1e-15
        if change <= _FLOOR:
            raise ValueError(
                f"tolerance {tolerance:g} is finer than floats can certify at discount "
                f"{mdp.discount:g}; "
                f"{2 * _FLOOR / (1 - mdp.discount):.1g} can be"
            )


@one_thread
def evaluate_policy(mdp: OrdinalMDP, policy: ArrayLike) -> Floats:
    """Return the vector value of a policy, as shares (S, k), by the paper's eq. (3).

    For every scale e, the policy's numeric value is ``evaluate_policy(mdp, policy) @ e``, in the
    unit of e (the paper's proposition 1).

    Parameters
    ----------
    mdp : OrdinalMDP
        The problem.
    policy : (S,) int or (S, A)
        The action in each state, or the probability of each action. Entries at terminal states are
        not read.

    Returns
    -------
    (S, k)
        Row s says how the discounted time of a run from s divides among the levels, and sums to 1.
        A terminal state's row is the unit vector of its level.

    Raises
    ------
    ValueError
        If the policy has another shape or type, has an inadmissible action, or its probabilities do
        not sum to 1.
    """
    rule = _rule(mdp, policy)
    pairs = mdp.levels.size
    levels = sparse.csr_array(
        (np.ones(pairs), mdp.levels.ravel(), np.arange(pairs + 1)), shape=(pairs, mdp.k)
    )
    gain = (1 - mdp.discount) * (rule @ levels).toarray()
    ends = np.where(mdp.terminal[:, None], np.eye(mdp.k)[mdp.final_level], 0.0)
    shares = np.maximum(
        valued(mdp, rule @ mdp.transitions, gain, ends), 0.0
    )  # rounding may leave -1e-20
    live = ~mdp.terminal
    shares[live] /= shares[live].sum(axis=1, keepdims=True)
    return shares


@one_thread
def policy_loss(
    mdp: OrdinalMDP,
    policy: ArrayLike,
    values: ArrayLike,
    tolerance: float = 1e-10,
    optimum: Floats | None = None,
) -> Floats:
    """Return the loss (S,) of following ``policy`` from each state, against an optimal policy.

    It is v* - v^policy on the scale ``values`` (k,), in shares, so it is a share of the value range
    e_k - e_1, from 0 to 1. It is accurate to ``tolerance``. Negative differences, which are within
    that, are set to 0.

    Parameters
    ----------
    mdp : OrdinalMDP
    policy : (S,) or (S, A)
    values : (k,)
    tolerance : float
    optimum : (S,), optional
        v*, if ``value_iteration`` has found it before.

    Returns
    -------
    (S,)

    Raises
    ------
    ValueError
        As ``value_iteration`` and ``evaluate_policy`` do.
    """
    e, rule = mdp.normalise(values), _rule(mdp, policy)
    v = value_iteration(mdp, values, tolerance)[0] if optimum is None else optimum
    gain, ends = (1 - mdp.discount) * (rule @ e[mdp.levels].ravel()), rewarded(mdp, e)[1]
    # with one scale this is k times cheaper than the policy's vector value
    loss: Floats = np.maximum(
        v - valued(mdp, rule @ mdp.transitions, gain[:, None], ends[:, None])[:, 0], 0.0
    )
    return loss


def rewarded(mdp: OrdinalMDP, e: Floats) -> tuple[Floats, Floats]:
    """Return the reward of each action (S, A) and each terminal state's value (S,), in shares."""
    gain: Floats = (1 - mdp.discount) * e[mdp.levels]
    return gain, np.where(mdp.terminal, e[mdp.final_level], 0.0)


def backed_up(mdp: OrdinalMDP, gain: Floats, ends: Floats, v: Floats) -> Floats:
    """Return the value of each action (S, A): its reward, plus the discounted value after it.

    ``gain`` (S, A) are the rewards, ``v`` (S,) the values of next states, and ``ends`` (S,) those
    of terminal states. For a known scale ``rewarded`` returns ``gain`` and ``ends``. At a terminal
    state each action has the state's value. The value of an inadmissible action is -inf.
    """
    q: Floats = gain + mdp.discount * (mdp.transitions @ v).reshape(mdp.levels.shape)
    q[mdp.terminal] = ends[mdp.terminal, None]
    q[~mdp.admissible] = -np.inf
    return q


def _first_best(q: Floats) -> Actions:
    best: Actions = np.argmax(q >= q.max(axis=1, keepdims=True) - _TIE, axis=1)
    return best


@one_thread
def policy_iteration(
    mdp: OrdinalMDP, gain: Floats, ends: Floats, start: Actions | None = None
) -> tuple[Floats, Actions]:
    """Return the greatest discounted total v (S,) of rewards ``gain`` (S, A), and its policy (S,).

    A terminal state's total is ``ends`` (S,). The method is Howard's algorithm. The actions of
    ``start`` (S,) are kept if they are as good. The result is accurate, but not proven: callers
    that need certainty must prove it.
    """
    rows = np.arange(mdp.n_states)
    v = ends = np.where(mdp.terminal, ends, 0.0)
    policy = _first_best(backed_up(mdp, gain, ends, v)) if start is None else start
    for _ in range(100):
        chain = mdp.transitions[rows * mdp.n_actions + policy]
        v = valued(mdp, chain, gain[rows, policy][:, None], ends[:, None])[:, 0]
        q = backed_up(mdp, gain, ends, v)
        better = ~mdp.terminal & (q.max(axis=1) > q[rows, policy] + _TIE)
        if not better.any():
            break
        policy = np.where(better, _first_best(q), policy)
    return v, policy


def optimal_policy(mdp: OrdinalMDP, values: Floats, start: Actions) -> Actions:
    """Return an optimal policy (S,) for the scale ``values`` (k,), from 0 to 1.

    Of equally good actions it takes the first. The search begins at ``start`` (S,), which changes
    its time, but not its result.
    """
    gain, ends = rewarded(mdp, np.asarray(values))
    v, _ = policy_iteration(mdp, gain, ends, start)
    return _first_best(backed_up(mdp, gain, ends, v))


def valued(mdp: OrdinalMDP, chain: sparse.csr_array, gain: Floats, ends: Floats) -> Floats:
    """Return discounted totals (S, c) of rewards ``gain`` (S, c) in a Markov chain (S, S).

    A terminal state's totals are its ``ends`` (S, c), which are 0 at the other states.
    """
    total, live = ends.copy(), ~mdp.terminal
    chain = chain[live]
    total[live] = discounted_totals(
        chain[:, live], gain[live] + mdp.discount * (chain @ ends), mdp.discount
    )
    return total


def _rule(mdp: OrdinalMDP, policy: ArrayLike) -> sparse.csr_array:
    """Return a policy as CSR (S, S*A): row s has the probability of a in column s*A + a."""
    n, m = mdp.levels.shape
    given, live = np.asarray(policy), ~mdp.terminal
    weights = np.zeros((n, m))
    if given.shape == (n,) and given.dtype.kind in "iu":
        reject(
            "policy", given, live & ((given < 0) | (given >= m)), f"must be an action in 0..{m - 1}"
        )
        weights[live, given[live]] = 1.0
    elif given.shape == (n, m) and given.dtype.kind in "iuf":
        weights[live] = given[live]
        proper = (weights >= 0).all(axis=1) & (np.abs(weights.sum(axis=1) - 1) <= 1e-9)
        reject("policy", given, live & ~proper, "must be probabilities that sum to 1")
        weights[live] /= weights[live].sum(axis=1, keepdims=True)
    else:
        raise ValueError(
            f"policy must be ({n},) integers, one action a state, or ({n}, {m}) probabilities of "
            "the actions, "
            f"not {given.shape} of type {given.dtype}"
        )
    stray: Flags = np.any((weights > 0) & ~mdp.admissible, axis=1)
    offered = np.flatnonzero(mdp.admissible[np.argmax(stray)]).tolist()
    reject("policy", given, stray, f"must take admissible actions only, which are {offered}")
    weights[mdp.terminal, np.argmax(mdp.admissible[mdp.terminal], axis=1)] = 1.0
    state, action = np.nonzero(weights)
    return sparse.csr_array((weights[state, action], (state, state * m + action)), shape=(n, n * m))
