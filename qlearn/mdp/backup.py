"""Bellman backups of share vectors (the paper's eq. (3)), a state at a time, for compiled code.

Q is never kept for all states.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import compiled, compiled_beside
from elicit._support.prefetch import prefetch
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

# numbers in V from which on it exceeds a processor's nearest caches, and its rows are fetched ahead
_FAR = 1 << 18


class MdpArrays(NamedTuple):
    """The MDP as arrays for a sweep; row s*A + a of ``OrdinalMDP.transitions`` is of (s, a)."""

    successors: NDArray[np.integer[Any]]  # (n,)
    probabilities: Floats  # (n,)
    ends: NDArray[
        np.integer[Any]
    ]  # (S*A + 1,) the start of each row, and the last end; an empty row is inadmissible
    levels: NDArray[np.integer[Any]]  # (S*A,)
    terminal: NDArray[np.bool_]  # (S,)
    n_actions: int
    discount: float

    def __deepcopy__(self, memo: dict[int, Any]) -> MdpArrays:
        """Return the same object in place of a copy.

        A copy's arrays would be writeable, and loops would be compiled again for them.
        """
        return self


def model_of(mdp: OrdinalMDP) -> MdpArrays:
    """Return the MDP's own arrays, all read-only.

    Otherwise some might be writeable, and loops would be compiled for both kinds.
    """
    p, levels = mdp.transitions, mdp.levels.reshape(-1)
    indices, data, ends = _to_read(p.indices), _to_read(p.data), _to_read(p.indptr)
    return MdpArrays(
        indices, data, ends, _to_read(levels), _to_read(mdp.terminal), mdp.n_actions, mdp.discount
    )


def _to_read(array: Any) -> Any:
    view = array.view()
    view.flags.writeable = False
    return view


@compiled
def back_up_from(s: int, v: Any, arrays: Any, discount: float, q: Any) -> None:
    """Write Q(s, .), in shares, into q (A, k).

    Rows of inadmissible actions are left as they are. ``arrays`` are the first four arrays of
    ``MdpArrays``: passing all of them for every state takes longer.
    """
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


def back_up_together(states: Any, v: Any, model: MdpArrays, q: Any) -> None:
    """Write the result of ``back_up_all`` in NumPy, all rows at once.

    It adds all first successors, then all second ones, and so on.
    """
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
def back_up_all(states: Any, v: Any, model: MdpArrays, q: Any) -> None:
    """Write Q (n, A, k) of n states into q, by ``OrdinalMDP``'s rules for terminal states.

    For a terminal state it is the state's value whatever the action. For an inadmissible action it
    is all on the worst level.
    """
    m, k = q.shape[1:]
    arrays = model.successors, model.probabilities, model.ends, model.levels
    far = v.size > _FAR
    for i in range(len(states)):
        s = states[i]
        if far and i + 1 < len(states):
            row = states[i + 1] * m
            for at in range(model.ends[row], model.ends[row + m]):
                prefetch(v, np.uint64(model.successors[at]))
        for a in range(m):
            for j in range(k):
                q[i, a, j] = v[s, j] if model.terminal[s] else (1.0 if j == 0 else 0.0)
        if not model.terminal[s]:
            back_up_from(s, v, arrays, model.discount, q[i])


def q_of(states: NDArray[np.int64], v: Floats, model: MdpArrays) -> Floats:
    """Return Q (n, A, k) of these states for next-state values V (S, k).

    See ``back_up_all``.
    """
    q = np.empty((len(states), model.n_actions, v.shape[1]))
    back_up_all(states, v, model, q)
    return q
