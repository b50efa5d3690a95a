"""Sweeps over the states of large MDPs, in code that numba can compile.

Each sum has SciPy's order, so results are the same to the last bit, compiled or not. What is gained
is time: the values of successors are fetched ahead. Successors and their places are unsigned
numbers, because signed ones are checked for being negative.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from elicit._support.jit import compiled_beside, written_out
from elicit._support.prefetch import prefetch
from elicit.model.scale import Floats
from qlearn.mdp.backup import model_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP

# successors between the one whose value is fetched and the one that is added; with 32 a sweep of
# single values at a million states takes a fifth longer, without fetching more than twice as long
_AHEAD = 64

# Rows between the one whose transitions are fetched and the one that is swept. A policy's rows lie
# apart in memory, where a processor does not foresee them. With 4 or 16 in place of 8, a sweep of
# single values takes as long; without fetching, 1.8 times as long (300,000 states).
_ROWS_AHEAD = 8
_RING = 2 * _ROWS_AHEAD  # states whose needed actions are known at the same time
_A_LINE = np.uint64(8)  # probabilities in a cache line


def arrays_of(mdp: OrdinalMDP) -> tuple[Any, Any, Any]:
    """Return the ends of rows, successors and probabilities, as compiled sweeps read them."""
    model = model_of(mdp)
    return model.ends, _unsigned(model.successors), model.probabilities


def _unsigned(numbers: Any) -> Any:
    return numbers.view(f"u{numbers.itemsize}")


@written_out
def _fetch(ends: Any, successors: Any, probabilities: Any, row: int) -> None:
    """Hint that the transitions of a row will be read soon."""
    for at in range(np.uint64(ends[row]), np.uint64(ends[row + 1]), _A_LINE):
        prefetch(successors, at)
        prefetch(probabilities, at)


def sweep_together(
    first: int,
    rows: Any,
    ends: Any,
    successors: Any,
    probabilities: Any,
    gain: Any,
    discount: Any,
    v: Any,
    new: Any,
) -> None:
    """Write the result of ``sweep_rows``, with a product of sparse matrices."""
    some = slice(first, first + len(new))
    chain = _matrix(ends, successors, probabilities, len(v))[rows[some]]
    new[:] = chain.astype(v.dtype, copy=False) @ v
    new *= discount
    new += gain[some]


@compiled_beside(sweep_together, unlocked=True)
def sweep_rows(
    first: int,
    rows: Any,
    ends: Any,
    successors: Any,
    probabilities: Any,
    gain: Any,
    discount: Any,
    v: Any,
    new: Any,
) -> None:
    """Write gain (S, c) plus discounted v (S, c) of the successors into new (n, c).

    The first of the n states is ``first``. State s has the transitions of row ``rows[s]``. All is
    computed in the precision of v and ``discount``.
    """
    n, c = new.shape
    total = np.empty(c, v.dtype)
    for i in range(n):
        s = first + i
        if i + _ROWS_AHEAD < n:
            _fetch(ends, successors, probabilities, rows[s + _ROWS_AHEAD])
        start, end = np.uint64(ends[rows[s]]), np.uint64(ends[rows[s] + 1])
        # the successors of the next state are fetched while this one's are added
        ahead, last = end, end
        if i + 1 < n:
            ahead, last = np.uint64(ends[rows[s + 1]]), np.uint64(ends[rows[s + 1] + 1])
        for j in range(c):
            total[j] = 0.0
        for at in range(start, end):
            if ahead < last:
                prefetch(v, successors[ahead])
                ahead += np.uint64(1)
            t, p = successors[at], v.dtype.type(probabilities[at])
            for j in range(c):
                total[j] += p * v[t, j]
        for j in range(c):
            new[i, j] = total[j] * discount + gain[s, j]


def products_together(
    first: int, ends: Any, successors: Any, probabilities: Any, v: Any, needed: Any, found: Any
) -> None:
    """Write the result of ``products``, with a product of sparse matrices."""
    m = found.shape[1]
    matrix = _matrix(ends, successors, probabilities, len(v))
    found[:] = 0.0
    found[needed] = matrix[np.flatnonzero(needed.reshape(-1)) + first * m] @ v


@compiled_beside(products_together, unlocked=True)
def products(
    first: int, ends: Any, successors: Any, probabilities: Any, v: Any, needed: Any, found: Any
) -> None:
    """Write the mean v (S,) of the successors of needed (n, A) actions into found (n, A).

    The first of the n states is ``first``. The mean is 0 where it is not needed.
    """
    n, m = found.shape
    ahead = np.uint64(min(_AHEAD, len(successors)))
    last = np.uint64(len(successors)) - ahead
    for i in range(n):
        for a in range(m):
            total = 0.0
            if needed[i, a]:
                row = (first + i) * m + a
                for at in range(np.uint64(ends[row]), np.uint64(ends[row + 1])):
                    if at < last:
                        prefetch(v, successors[at + ahead])
                    total += probabilities[at] * v[successors[at]]
            found[i, a] = total


def pass_on_together(
    first: int,
    rows: Any,
    ends: Any,
    successors: Any,
    probabilities: Any,
    discount: Any,
    change: Any,
    active: Any,
    new: Any,
) -> None:
    """Write the result of ``pass_on``, with a product of sparse matrices."""
    chain = _matrix(ends, successors, probabilities, len(change))[rows[first : first + len(new)]]
    new[:] = chain.astype(change.dtype, copy=False) @ np.where(active[:, None], change, 0.0)
    new *= discount


@compiled_beside(pass_on_together, unlocked=True)
def pass_on(
    first: int,
    rows: Any,
    ends: Any,
    successors: Any,
    probabilities: Any,
    discount: Any,
    change: Any,
    active: Any,
    new: Any,
) -> None:
    """Write the discounted change (S, c) of the active (S,) successors into new (n, c).

    The first of the n states is ``first``. State s has the transitions of row ``rows[s]``. Other
    successors count as unchanged, and are not read.
    """
    n, c = new.shape
    total = np.empty(c, change.dtype)
    for i in range(n):
        s = first + i
        if i + _ROWS_AHEAD < n:
            _fetch(ends, successors, probabilities, rows[s + _ROWS_AHEAD])
        start, end = np.uint64(ends[rows[s]]), np.uint64(ends[rows[s] + 1])
        # the successors of the next state are fetched while this one's are added
        ahead, last = end, end
        if i + 1 < n:
            ahead, last = np.uint64(ends[rows[s + 1]]), np.uint64(ends[rows[s + 1] + 1])
        for j in range(c):
            total[j] = 0.0
        for at in range(start, end):
            if ahead < last:
                if active[successors[ahead]]:
                    prefetch(change, successors[ahead])
                ahead += np.uint64(1)
            t = successors[at]
            if active[t]:
                p = change.dtype.type(probabilities[at])
                for j in range(c):
                    total[j] += p * change[t, j]
        for j in range(c):
            new[i, j] = total[j] * discount


def take_in_together(
    change: Any, middle: Any, common: Any, least: Any, total: Any, active: Any, left: Any
) -> None:
    """Write the result of ``take_in`` in NumPy."""
    total += change + common
    change -= middle
    active[:] = (np.abs(change) > least).any(axis=1)
    rest = change[~active].astype(np.float64)
    left[:] = rest.cumsum(axis=0)[-1] if len(rest) else 0.0  # a sum in the order of the states


@compiled_beside(take_in_together)
def take_in(
    change: Any, middle: Any, common: Any, least: Any, total: Any, active: Any, left: Any
) -> None:
    """Add change (S, c) and ``common`` (c,) to total (S, c), and subtract middle (c,) from change.

    Then flag the active (S,) states: those of which some change exceeds ``least``. Write the sum of
    the others' changes into ``left`` (c,).
    """
    n, c = change.shape
    for j in range(c):
        left[j] = 0.0
    for s in range(n):
        moves = False
        for j in range(c):
            total[s, j] += change[s, j] + common[j]
            change[s, j] -= middle[j]
            moves |= abs(change[s, j]) > least
        active[s] = moves
        if not moves:
            for j in range(c):
                left[j] += change[s, j]


class Rewards(NamedTuple):
    """Rewards of an MDP's actions, and which actions there are."""

    gain: Floats  # (S, A)
    final: Floats  # (S,) values of the terminal states
    terminal: NDArray[np.bool_]  # (S,)
    admissible: NDArray[np.bool_]  # (S, A)
    discount: float


class GreedyRule(NamedTuple):
    """The way in which ``improve`` chooses an action, and the ones it looks at.

    If ``remember``, all are looked at, and the means of their successors' values are written into
    ``means``. Otherwise an action is left out if by these means, or by rewards alone if there are
    none, it is worse than another one by more than ``room``.
    """

    means: NDArray[np.float32]  # (S, A), or (0, A) if there are none
    remember: bool
    room: float
    last: NDArray[np.int64]  # (S,) actions that stay if they are as good to within slack, or (0,)
    slack: float


def improve_together(
    first: int,
    transitions: Any,
    v: Any,
    rewards: Rewards,
    choosing: GreedyRule,
    best: Any,
    greedy: Any,
) -> None:
    """Write the result of ``improve``, with a product of sparse matrices."""
    gain, final, terminal, admissible, discount = rewards
    means, remember, room, last, slack = choosing
    n, m = len(best), gain.shape[1]
    here, at = slice(first, first + n), np.arange(n)
    needed = np.ones((n, m), dtype=np.bool_)
    if not remember:
        q = gain[here] + discount * means[here].astype(np.float64) if len(means) else gain[here]
        q = np.where(admissible[here], q, -np.inf)
        needed = (q >= q.max(axis=1, keepdims=True) - room) & admissible[here]
        needed |= terminal[here, None]
        if len(last):
            needed[at, last[here]] = True
    found = np.empty((n, m))
    ends, successors, probabilities = transitions
    products(first, ends, successors, probabilities, v, needed, found)
    if remember:
        means[here] = found
    q = gain[here] + discount * found
    q[~needed] = -np.inf
    q[terminal[here]] = final[here][terminal[here], None]
    q[~admissible[here]] = -np.inf
    greedy[:] = q.argmax(axis=1)
    best[:] = q[at, greedy]
    if len(last):
        kept = q[at, last[here]] >= best - slack
        greedy[kept] = last[here][kept]


@compiled_beside(improve_together, unlocked=True)
def improve(
    first: int,
    transitions: Any,
    v: Any,
    rewards: Rewards,
    choosing: GreedyRule,
    best: Any,
    greedy: Any,
) -> None:
    """Write the greatest reward plus discounted v (S,) of n states, and the action that has it.

    The first of the n states is ``first``, and ``transitions`` are ``arrays_of`` the MDP. ``best``
    (n,) are the values, and ``greedy`` (n,) the first of the best actions, unless the action of
    ``choosing.last`` stays.
    """
    ends, successors, probabilities = transitions
    gain, final, terminal, admissible, discount = rewards
    means, remember, room, last, slack = choosing
    n, m = len(best), gain.shape[1]
    ahead = np.uint64(min(_AHEAD, len(successors)))
    end = np.uint64(len(successors)) - ahead
    q, needed = np.empty(m), np.ones((_RING, m), dtype=np.bool_)
    for i in range(0 if remember else -_ROWS_AHEAD, n):
        j = i + _ROWS_AHEAD
        if j < n and not remember:  # look which actions are needed, and fetch their transitions
            s = first + j
            least = -np.inf
            for a in range(m):
                if admissible[s, a]:
                    q[a] = gain[s, a]
                    if len(means) > 0:
                        q[a] += discount * np.float64(means[s, a])
                    least = max(least, q[a] - room)
            for a in range(m):
                may = terminal[s] or (len(last) > 0 and a == last[s])
                needed[j % _RING, a] = may or (admissible[s, a] and q[a] >= least)
                if needed[j % _RING, a]:
                    _fetch(ends, successors, probabilities, s * m + a)
        if i < 0:
            continue
        s = first + i
        if i + 1 < n and not remember:  # fetch the values of the next state's successors
            for a in range(m):
                if needed[(i + 1) % _RING, a]:
                    row = (s + 1) * m + a
                    for at in range(np.uint64(ends[row]), np.uint64(ends[row + 1])):
                        prefetch(v, successors[at])
        top, taken = -np.inf, -1
        for a in range(m):
            q[a] = -np.inf
            if not needed[i % _RING, a]:
                continue
            total, row = 0.0, s * m + a
            if remember:
                for at in range(np.uint64(ends[row]), np.uint64(ends[row + 1])):
                    if at < end:
                        prefetch(v, successors[at + ahead])
                    total += probabilities[at] * v[successors[at]]
                means[s, a] = total
            else:
                for at in range(np.uint64(ends[row]), np.uint64(ends[row + 1])):
                    total += probabilities[at] * v[successors[at]]
            if admissible[s, a]:
                q[a] = final[s] if terminal[s] else gain[s, a] + discount * total
                if taken < 0 or q[a] > top:
                    top, taken = q[a], a
        best[i], greedy[i] = top, taken
        if len(last) > 0 and q[last[s]] >= top - slack:
            greedy[i] = last[s]


def _matrix(ends: Any, successors: Any, probabilities: Any, states: int) -> sparse.csr_array:
    columns = successors.view(f"i{successors.itemsize}")
    return sparse.csr_array((probabilities, columns, ends), shape=(len(ends) - 1, states))
