"""Backing up share vectors, eq. (3), a state at a time, in code that numba can compile: Q is never
kept for all.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import compiled, compiled_beside
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP


class Model(NamedTuple):
    """The MDP as a sweep reads it; row s*A + a of ``OrdinalMDP.transitions`` belongs to (s, a)."""

    successors: NDArray[np.integer[Any]]  # (n,)
    probabilities: Floats  # (n,)
    ends: NDArray[
        np.integer[Any]
    ]  # (S*A + 1,) where each row starts, and the last ends; an empty one is inadmissible
    levels: NDArray[np.integer[Any]]  # (S*A,)
    terminal: NDArray[np.bool_]  # (S,)
    n_actions: int
    discount: float

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        """Itself: copies of its arrays could be written to, and a copied learner would be compiled
        for anew.
        """
        return self


def model_of(mdp: OrdinalMDP) -> Model:
    """The MDP's own arrays, to read: whether they could be written to is chance, and would be
    compiled for anew.
    """
    p, levels = mdp.transitions, mdp.levels.reshape(-1)
    indices, data, ends = _to_read(p.indices), _to_read(p.data), _to_read(p.indptr)
    return Model(
        indices, data, ends, _to_read(levels), _to_read(mdp.terminal), mdp.n_actions, mdp.discount
    )


def _to_read(array: Any) -> Any:
    view = array.view()
    view.flags.writeable = False
    return view


@compiled
def back_up_from(s: int, v: Any, arrays: Any, discount: float, q: Any) -> None:
    """Q(s, .) into q (A, k), eq. (3) in shares; rows of inadmissible actions are left as they are.
    ``arrays`` are the model's first four: to hand over all of it for every state costs more."""
    successors, probabilities, ends, levels = arrays
    m, k = q.shape
    for a in range(m):
        row = s * m + a
        first, last = ends[row], ends[row + 1]
        if first == last:
            continue
        for i in range(k):
            q[a, i] = 0.0
        for j in range(first, last):
            p, t = probabilities[j], successors[j]
            for i in range(k):
                q[a, i] += p * v[t, i]
        for i in range(k):
            q[a, i] *= discount
        q[a, levels[row]] += 1.0 - discount


def back_up_together(states: Any, v: Any, model: Model, q: Any) -> None:
    """``back_up_all``, all rows at once: first all first successors, then all second ones."""
    m, k = q.shape[1:]
    rows = (np.asarray(states)[:, None] * m + np.arange(m)).reshape(-1)
    first, into = model.ends[rows], q.reshape(-1, k)
    count = np.where(np.repeat(model.terminal[states], m), 0, model.ends[rows + 1] - first)
    into[:] = np.where(count[:, None] > 0, 0.0, np.arange(k) == 0)
    live = np.argsort(-count, kind="stable")
    for j in range(int(count.max(initial=0))):
        live = live[: np.count_nonzero(count[live] > j)]
        at = first[live] + j
        into[live] += model.probabilities[at, None] * v[model.successors[at]]
    live = np.flatnonzero(count)
    into[live] *= model.discount
    into[live, model.levels[rows[live]]] += 1.0 - model.discount
    ended = np.flatnonzero(model.terminal[states])
    q[ended] = v[states[ended], None, :]


@compiled_beside(back_up_together)
def back_up_all(states: Any, v: Any, model: Model, q: Any) -> None:
    """Q (n, A, k) of n states, as ``OrdinalMDP`` has it: a terminal state's value whatever the
    action, and all on the worst level where an action is inadmissible."""
    m, k = q.shape[1:]
    arrays = model.successors, model.probabilities, model.ends, model.levels
    for i in range(len(states)):
        s = states[i]
        for a in range(m):
            for j in range(k):
                q[i, a, j] = v[s, j] if model.terminal[s] else (1.0 if j == 0 else 0.0)
        if not model.terminal[s]:
            back_up_from(s, v, arrays, model.discount, q[i])


def q_of(states: NDArray[np.int64], v: Floats, model: Model) -> Floats:
    """Q (n, A, k) of these states after V (S, k), as ``back_up_all`` has it."""
    q = np.empty((len(states), model.n_actions, v.shape[1]))
    back_up_all(states, v, model, q)
    return q
