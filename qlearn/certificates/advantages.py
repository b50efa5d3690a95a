"""Advantages of the actions that a policy does not take, as differences of share vectors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions, evaluate_policy

ROUNDING = 1e-14  # an upper bound on the rounding error of one advantage
STATES_AT_ONCE = 1 << 14  # states whose Q is in memory at the same time


class Advantages(NamedTuple):
    """The advantages Q(s, a) - V(s) over a policy whose value is ``v``, exact or approximate.

    There is a row for each admissible (state, action) that the policy does not take, sorted by
    state, then by action. The rows may be those of some states only.
    """

    policy: Actions  # (S,)
    v: Floats  # (S, k)
    states: NDArray[np.int64]  # (n,)
    actions: NDArray[np.int64]  # (n,)
    d: Floats  # (n, k)
    # bound on the spread of the policy's own advantages, which are 0 if v is exact, on every scale
    doubt: float

    def only(self, rows: NDArray[np.int64]) -> Advantages:
        """Return a copy with only these rows."""
        return self._replace(states=self.states[rows], actions=self.actions[rows], d=self.d[rows])


def advantages_over(
    mdp: OrdinalMDP,
    policy: ArrayLike,
    v: Floats | None = None,
    states: NDArray[np.int64] | None = None,
) -> Advantages:
    """Return the advantages over a deterministic policy.

    Parameters
    ----------
    mdp : OrdinalMDP
    policy : (S,) actions
    v : (S, k) shares, optional
        The policy's value, or an approximation of it. Default: the exact value.
    states : (n,) int, optional
        The states to look at, in ascending order. Default: all.

    Raises
    ------
    ValueError
        As ``evaluate_policy`` does.
    """
    taken = np.asarray(policy)
    v = evaluate_policy(mdp, taken) if v is None else v
    states = np.flatnonzero(~mdp.terminal) if states is None else states[~mdp.terminal[states]]
    wanted = mdp.admissible[states]
    wanted[np.arange(len(states)), taken[states]] = False
    place, actions = np.nonzero(wanted)
    d, model = np.empty((len(place), mdp.k)), model_of(mdp)
    ends, above, below = np.searchsorted(place, np.arange(len(states) + 1)), 0.0, 0.0
    for start in range(0, len(states), STATES_AT_ONCE):
        some = states[start : start + STATES_AT_ONCE]
        rows = slice(ends[start], ends[start + len(some)])
        advantages = q_of(some, v, model)
        advantages -= v[some][:, None]
        d[rows] = advantages[place[rows] - start, actions[rows]]
        own = tail_sums(advantages[np.arange(len(some)), taken[some]])
        above, below = max(above, float(own.max())), max(below, -float(own.min()))
    return Advantages(taken, v, states[place], actions, d, above + below + ROUNDING)
