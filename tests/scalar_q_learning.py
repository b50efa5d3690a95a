"""Ordinary Q-learning on values that are known: what interactive Q-learning comes to where all is
asked.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from qlearn import OrdinalMDP
from qlearn.learners.loops.q_learning_kernel import FIRST_BEST
from qlearn.reference import Learned, Walk, actions, pick
from tests.scale_arithmetic import Floats


def scalar_q_learning(
    mdp: OrdinalMDP,
    values: ArrayLike,
    *,
    steps: int,
    epsilon: float | Floats,
    rates: Sequence[float] | Floats,
    key: int,
    start: str = "worst",
    episode_length: int | None = None,
) -> Learned:
    """Ordinary Q-learning on the true ``values`` (k,), with B(s) tracked as in Algorithm 1: what a
    learner does that always asks a tutor who never errs. Q (S, A) is in shares of the value range,
    from 0 to 1."""
    e = mdp.normalise(values)
    q = np.full((mdp.n_states, mdp.n_actions), float(start == "best"))
    q[mdp.terminal] = e[mdp.final_level[mdp.terminal], None]
    best = [pick(actions(mdp, s), key, FIRST_BEST, s) for s in range(mdp.n_states)]
    comparisons = []
    walk = Walk(mdp, key, epsilon, episode_length)
    for t in range(steps):
        s = walk.state
        a = walk.choose(best[s], t)
        following, visit = walk.simulate(a)
        reward = (1 - mdp.discount) * e[mdp.levels[s, a]]
        q[s, a] += rates[visit] * (reward + mdp.discount * q[following, best[following]] - q[s, a])
        for other in [a] if a != best[s] else actions(mdp, s):
            incumbent = best[s]
            if other != incumbent:
                best[s] = other if q[s, other] > q[s, incumbent] else incumbent
                comparisons.append((s, other, incumbent, best[s]))
    return Learned(q, best, comparisons)
