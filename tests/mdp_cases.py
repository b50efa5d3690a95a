"""MDPs for tests of all folders."""

from typing import Any

import numpy as np

from qlearn import OrdinalMDP, draw_values, policy_loss
from tests.scale_arithmetic import Floats, values_of


def messy_mdp(
    seed: int, n: int = 10, m: int = 3, k: int = 4, discount: float = 0.9, n_terminal: int = 2
) -> tuple[OrdinalMDP, Floats]:
    """A random MDP with terminal states, inadmissible actions and successors that appear twice; and
    hidden values.
    """
    rng = np.random.default_rng(seed)
    levels = rng.integers(k, size=(n, m))
    terminal = np.arange(n) >= n - n_terminal
    levels[terminal] = levels[terminal, :1]
    admissible = rng.random((n, m)) < 0.75
    admissible[np.arange(n), rng.integers(m, size=n)] = True
    mdp = OrdinalMDP(
        rng.integers(n, size=(n, m, 3)),
        rng.dirichlet(np.ones(3), size=(n, m)),
        levels,
        discount,
        tuple(f"level {i}" for i in range(k)),
        terminal=terminal,
        admissible=admissible,
    )
    return mdp, draw_values(k, seed)


def losses_under(mdp: OrdinalMDP, policy: Any, gaps: Floats) -> Floats:
    """Return the policy's greatest loss under each column of gaps, by solving the MDP for each."""
    return np.array(
        [policy_loss(mdp, policy, values_of(np.maximum(g, 1e-9))).max() for g in gaps.T]
    )
