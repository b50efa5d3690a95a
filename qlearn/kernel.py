"""The Q-learning loop as arrays and a cursor: runs until it is done or meets a pair it cannot decide.

Plain scalar code over arrays, so that compiling it is one decorator. The cursor says where the loop
stands (in the middle of a step's comparisons, if need be); calling again with a verdict goes on from
there. Random numbers are a hash of (key, purpose, counters): see ``elicit.seeds.fold``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

DONE, DEFER = 0, 1
WORSE, EQUAL, BETTER, UNKNOWN = -1, 0, 1, 2  # as elicit.Verdict
EXPLORE, ACTION, TRANSITION, RESTART, FIRST_BEST, AUDITS = 1, 2, 3, 4, 5, 6  # purposes of random numbers
STEP, STATE, POSITION, LAST, NEXT, EPISODE, AGE = range(7)  # what the cursor holds
IDLE = -1  # POSITION between two steps

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_ONE = np.uint64(1)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)


class Model(NamedTuple):
    """The MDP and the settings, as the loop reads them."""

    successors: NDArray[np.int64]  # (S, A, b)
    cumulative: NDArray[np.float64]  # (S, A, b) running sums of the probabilities
    levels: NDArray[np.int64]  # (S, A)
    actions: NDArray[np.int64]  # (S, A) admissible actions first
    n_actions: NDArray[np.int64]  # (S,) how many are admissible
    terminal: NDArray[np.bool_]  # (S,)
    initial: NDArray[np.float64]  # (S,) running sums of the initial distribution
    rates: NDArray[np.float64]  # learning rate by number of earlier visits of (s, a)
    discount: float
    epsilon: float
    steps: int
    episode_length: int  # 0: episodes end in terminal states only
    dominance: bool  # whether eq. (4) may decide
    key: Any  # np.uint64


class State(NamedTuple):
    """What the loop changes."""

    q: NDArray[np.float64]  # (S, A, k) shares
    best: NDArray[np.int64]  # (S,) B(s)
    visits: NDArray[np.int64]  # (S, A)
    cursor: NDArray[np.int64]  # (7,)
    decided: NDArray[np.int64]  # (2,) comparisons that were equal, and that dominance decided
    t: NDArray[np.float64]  # (k-1,) tail sums of the pair at the cursor


def mix(h: Any, counter: Any) -> Any:
    """One round of ``elicit.seeds.fold`` on unsigned 64-bit numbers."""
    z = h + (np.uint64(counter) + _ONE) * _GOLDEN
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    return z ^ (z >> _S31)


def unit(h: Any) -> float:
    """A hash as a number in [0, 1)."""
    return float(h >> _S11) * 2.0**-53


def draw(cumulative: Any, u: float) -> int:
    """The first index whose running sum exceeds u; the last with any probability if rounding hides it."""
    low, high = 0, len(cumulative) - 1
    total = cumulative[high]
    if u >= total:
        u = total * (1.0 - 2.0**-53)
    while low < high:
        middle = (low + high) // 2
        if cumulative[middle] > u:
            high = middle
        else:
            low = middle + 1
    return low


def compare(q: Any, state: int, challenger: int, incumbent: int, t: Any, dominance: bool) -> int:
    """Tail sums of Q(s, challenger) - Q(s, incumbent) into t, and their verdict by eq. (4)."""
    k = q.shape[2]
    total = 0.0
    some_up, some_down = False, False
    for j in range(k - 1, 0, -1):
        total += q[state, challenger, j] - q[state, incumbent, j]
        t[j - 1] = total
        some_up = some_up or total > 0.0
        some_down = some_down or total < 0.0
    if not some_up and not some_down:
        return EQUAL
    if dominance and not some_down:
        return BETTER
    if dominance and not some_up:
        return WORSE
    return UNKNOWN


def advance(state: State, model: Model, verdict: int) -> int:
    """Run Algorithm 1 from the cursor; ``verdict`` settles the pair it stands at (UNKNOWN: none yet).

    Returns DONE, or DEFER with the cursor at a pair that neither equality nor dominance decides.
    """
    q, best, cursor, decided, t = state.q, state.best, state.cursor, state.decided, state.t
    while True:
        if cursor[POSITION] == IDLE:
            if cursor[STEP] >= model.steps:
                return DONE
            learn(state, model)
        s = cursor[STATE]
        while cursor[POSITION] < cursor[LAST]:
            challenger = model.actions[s, cursor[POSITION]]
            incumbent = best[s]
            if challenger != incumbent:
                code = verdict
                if code == UNKNOWN:
                    code = compare(q, s, challenger, incumbent, t, model.dominance)
                    if code == UNKNOWN:
                        return DEFER
                    decided[1 if code != EQUAL else 0] += 1
                verdict = UNKNOWN
                if code == BETTER:  # Alg. 2, l. 7 and 15; equal keeps the incumbent
                    best[s] = challenger
            cursor[POSITION] += 1
        cursor[POSITION] = IDLE
        cursor[STATE] = cursor[NEXT]
        cursor[STEP] += 1


def learn(state: State, model: Model) -> None:
    """Lines 7 to 10 of Algorithm 1: act, observe, update; then set the cursor to lines 11 to 15."""
    q, best, visits, cursor = state.q, state.best, state.visits, state.cursor
    s, step = cursor[STATE], cursor[STEP]
    position = IDLE
    if unit(mix(mix(model.key, EXPLORE), step)) < model.epsilon:  # Alg. 1, l. 7
        position = int(unit(mix(mix(model.key, ACTION), step)) * model.n_actions[s])
        a = model.actions[s, position]
    else:
        a = best[s]
    visit = visits[s, a]
    visits[s, a] = visit + 1
    u = unit(mix(mix(mix(mix(model.key, TRANSITION), s), a), visit))
    successor = model.successors[s, a, draw(model.cumulative[s, a], u)]  # Alg. 1, l. 8
    rate = model.rates[visit]
    following = best[successor]
    for i in range(q.shape[2]):
        delta = model.discount * q[successor, following, i] - q[s, a, i]  # Alg. 1, l. 9, in shares
        if i == model.levels[s, a]:
            delta += 1.0 - model.discount
        q[s, a, i] += rate * delta  # Alg. 1, l. 10
    if a != best[s]:  # Alg. 1, l. 11 and 12: only a can have overtaken B(s)
        cursor[POSITION] = position
        cursor[LAST] = position + 1
    else:  # Alg. 1, l. 14: every action may have
        cursor[POSITION] = 0
        cursor[LAST] = model.n_actions[s]
    cursor[AGE] += 1
    ended = model.terminal[successor] or (model.episode_length > 0 and cursor[AGE] >= model.episode_length)
    if ended:
        cursor[EPISODE] += 1
        cursor[AGE] = 0
        successor = draw(model.initial, unit(mix(mix(model.key, RESTART), cursor[EPISODE])))
    cursor[NEXT] = successor
