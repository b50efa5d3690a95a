"""MO-Gymnasium's deep-sea-treasure as a problem of two objectives without an order: treasure, and
little time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from elicit.model.scale import Floats
from qlearn import OrdinalMDP, evaluate_policy
from qlearn.mdp.planning import Actions, optimal_policy
from qlearn.problems.gymnasium import deep_sea_treasure


class Treasure(NamedTuple):
    """``mdp``: its tables. ``worth`` (k, 2): what a share of time at each level counts towards the
    two objectives, so that a policy's shares times it are its discounted treasure over the
    greatest, and 1 less its discounted time at sea over the longest there can be: the package's two
    returns, each brought to 0..1."""

    mdp: OrdinalMDP
    worth: Floats

    def train(self, weights: Floats) -> Actions:
        """An optimal policy for weights (2,)."""
        return optimal_policy(self.mdp, self.worth @ weights, np.zeros(self.mdp.n_states, np.int64))

    def objectives(self, policy: Actions) -> Floats:
        """(2,) of a policy, from the start."""
        return np.asarray(self.mdp.initial @ evaluate_policy(self.mdp, policy) @ self.worth)


def treasure(discount: float = 0.95) -> Treasure:
    """The problem. Raises ImportError without the packages."""
    mdp = deep_sea_treasure(discount)
    values = np.array([0.0, *(float(label.split()[1]) for label in mdp.labels[1:])])
    # a treasure reached after T steps is rewarded at the T-th, a step before the time that lasts
    # begins
    return Treasure(mdp, np.column_stack([values / values.max() / discount, values > 0]))
