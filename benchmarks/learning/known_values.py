"""The limit that interactive learning is measured against: the same compiled loop, told what the
levels are worth.
"""

from __future__ import annotations

from time import process_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import compiled
from elicit.model.scale import Floats
from qlearn import InteractiveQLearning
from qlearn.learners.loops.q_learning_kernel import (
    IDLE,
    LAST,
    NEXT,
    POSITION,
    STATE,
    STEP,
    Model,
    State,
    learn,
)


@compiled
def advance_knowing(state: State, model: Model, e: Any, worth: Any) -> None:
    """All steps of Q-learning on share vectors, where e (k,) is known and the worth (S, A) of each
    vector is kept.
    """
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


class Known(NamedTuple):
    """CPU seconds of all steps, and where they led: actions (S,) and share vectors (S, A, k)."""

    seconds: float
    policy: NDArray[np.int64]
    q: Floats


class Knowing:
    """The run that a learner has before it, by one who knows the values: from a copy of the very
    state that the learner starts from, with the same MDP, settings and random numbers. ``learner``
    must not have been asked yet; ``e`` (k,) are the values, from 0 to 1."""

    def __init__(self, learner: InteractiveQLearning, e: Floats) -> None:
        state: Any = learner.state
        if state.cursor[STEP]:
            raise ValueError(
                f"the learner has done {state.cursor[STEP]} steps already: take a new one"
            )
        self._state, self._model = State(*(array.copy() for array in state)), learner.model
        self._e = np.array(e, dtype=np.float64)
        self._worth = first_worth(self._state, self._e)

    def run(self) -> Known:
        """All steps; only the loop is timed."""
        start = process_time()
        with np.errstate(all="ignore"):  # the hash wraps around
            advance_knowing(self._state, self._model, self._e, self._worth)
        return Known(process_time() - start, self._state.best, self._state.q)
