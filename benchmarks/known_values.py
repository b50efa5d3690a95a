"""The limit that interactive learning is measured against: the same compiled loop, told what the levels are worth."""

from __future__ import annotations

from typing import Any

import numpy as np

from elicit.jit import compiled
from qlearn.kernel import IDLE, LAST, NEXT, POSITION, STATE, STEP, Model, State, learn


@compiled
def advance_knowing(state: State, model: Model, e: Any, worth: Any) -> None:
    """All steps of Q-learning on share vectors, where e (k,) is known and the worth (S, A) of each vector is kept."""
    q, best, cursor = state.q, state.best, state.cursor
    k = q.shape[2]
    while cursor[STEP] < model.steps:
        s, before = cursor[STATE], best[cursor[STATE]]
        learn(state, model)
        first, last = cursor[POSITION], cursor[LAST]
        a = before if last - first != 1 or model.n_actions[s] == 1 else model.actions[s, first]
        total = 0.0
        for i in range(k):
            total += q[s, a, i] * e[i]
        worth[s, a] = total
        for position in range(first, last):
            challenger = model.actions[s, position]
            if worth[s, challenger] > worth[s, best[s]]:
                best[s] = challenger
        cursor[POSITION] = IDLE
        cursor[STATE] = cursor[NEXT]
        cursor[STEP] += 1


def first_worth(state: State, e: Any) -> Any:
    """The worth (S, A) of the vectors that a run starts from."""
    return np.einsum("sai,i->sa", state.q, e)
