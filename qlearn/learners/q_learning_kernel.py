"""The Q-learning loop as arrays and a cursor: runs until it is done or meets a pair it cannot decide.

Plain scalar code over arrays, compiled where numba is installed; both ways give the same numbers. The cursor says
where the loop stands (in the middle of a step's comparisons, if need be); calling again with a verdict goes on from
there. Random numbers are a hash of (key, purpose, counters): see ``elicit._support.hashing.fold``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing_kernel import mix, unit
from elicit._support.jit import compiled
from elicit.asking.elicitation_kernel import NOTHING_LOOKED_UP, AskingRule, judge_pair
from elicit.decision.judge import holds
from elicit.decision.rule import Rule
from elicit.lp.sign import (
    BETTER,
    BY_DOMINANCE,
    BY_EQUAL,
    BY_SCREEN,
    BY_SIMPLEX,
    EQUAL,
    UNKNOWN,
    UNSETTLED,
    WORSE,
    by_dominance,
)
from elicit.model.comparator import Tier
from elicit.tutors.simulated_kernel import NOBODY, Respondent, respond

DONE, ASK, DEFER, FULL = range(4)
EXPLORE, ACTION, TRANSITION, RESTART, FIRST_BEST, AUDITS = 1, 2, 3, 4, 5, 6  # purposes of random numbers
STEP, STATE, POSITION, LAST, NEXT, EPISODE, AGE, KEPT = range(8)  # what the cursor holds
IDLE = -1  # POSITION between two steps
BY_TUTOR = int(Tier.TUTOR)


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
    epsilons: NDArray[np.float64]  # chance of exploring by step; the last one stays
    steps: int
    episode_length: int  # 0: episodes end in terminal states only
    dominance: bool  # whether eq. (4) may decide
    key: Any  # np.uint64


class State(NamedTuple):
    """What the loop changes."""

    q: NDArray[np.float64]  # (S, A, k) shares
    best: NDArray[np.int64]  # (S,) B(s)
    visits: NDArray[np.int64]  # (S, A)
    cursor: NDArray[np.int64]  # (8,)
    decided: NDArray[np.int64]  # comparisons settled here, by tier
    floors: NDArray[np.float64]  # (S, A, p) how far the tail sums of (s, a) may sink (``elicit.decision.judge.judge``)
    sides: NDArray[np.int8]  # (S, A) the verdict that then holds, times its tier; 0: none


class Kept(NamedTuple):
    """The comparisons that neither equality nor dominance settled, for whoever watches; c = 0: nobody does."""

    d: NDArray[np.float64]  # (c, k)
    verdicts: NDArray[np.int8]  # (c,)
    tiers: NDArray[np.int8]  # (c,)


@compiled
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


@compiled
def difference(q: Any, state: int, challenger: int, incumbent: int, d: Any, t: Any) -> int:
    """Q(s, challenger) - Q(s, incumbent) into d, its tail sums into t, and their verdict by eq. (4)."""
    total = -0.0
    for j in range(len(d) - 1, 0, -1):
        d[j] = q[state, challenger, j] - q[state, incumbent, j]
        total += d[j]
        t[j - 1] = total
    d[0] = q[state, challenger, 0] - q[state, incumbent, 0]
    return by_dominance(t)


@compiled
def advance(
    state: State, model: Model, verdict: int, rule: Rule, asking: AskingRule, oracle: Respondent, kept: Kept
) -> int:
    """Run Algorithm 1 from the cursor; ``verdict`` settles the pair it stands at (UNKNOWN: none yet).
    With an ``oracle`` it is asked whatever dominance leaves open.

    Returns DONE; FULL where ``kept`` must be emptied first; or, with the cursor at a pair, ASK where only the tutor
    can settle it and DEFER where perhaps the elicitation can.
    """
    q, best, cursor, decided = state.q, state.best, state.cursor, state.decided
    floors, sides = state.floors, state.sides
    k = q.shape[2]
    d, t, work = np.empty(k), np.empty(k - 1), np.empty((2, k - 1))
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
                if verdict == UNKNOWN:
                    verdict, tier = difference(q, s, challenger, incumbent, d, t), BY_DOMINANCE
                    if verdict == EQUAL:
                        tier = BY_EQUAL
                    elif verdict == UNKNOWN or not model.dominance:
                        if len(kept.tiers) > 0 and cursor[KEPT] == len(kept.tiers):
                            return FULL
                        side = sides[s, challenger]
                        if oracle.kind != NOBODY:
                            verdict, tier = respond(t, work[0], oracle), BY_TUTOR
                            if verdict == UNSETTLED:
                                return DEFER
                        elif side != 0 and asking.plain and holds(t, 1 if side > 0 else -1, floors[s, challenger]):
                            verdict, tier = (BETTER, int(side)) if side > 0 else (WORSE, -int(side))
                        else:
                            floor = floors[s, challenger]
                            judged = judge_pair(d, t, work, floor, rule, asking, NOTHING_LOOKED_UP)
                            verdict, tier = judged.verdict, judged.tier
                            sides[s, challenger] = 0
                            if verdict in (UNSETTLED, UNKNOWN):
                                return DEFER if verdict == UNSETTLED or judged.audited else ASK
                            if judged.certified:
                                sides[s, challenger] = verdict * (BY_SCREEN if tier == BY_SIMPLEX else tier)
                        if len(kept.tiers) > 0:
                            for j in range(k):
                                kept.d[cursor[KEPT], j] = d[j]
                            kept.verdicts[cursor[KEPT]] = verdict
                            kept.tiers[cursor[KEPT]] = tier
                            cursor[KEPT] += 1
                    decided[tier] += 1
                if verdict == BETTER:  # Alg. 2, l. 7 and 15; equal keeps the incumbent
                    best[s] = challenger
                verdict = UNKNOWN
            cursor[POSITION] += 1
        cursor[POSITION] = IDLE
        cursor[STATE] = cursor[NEXT]
        cursor[STEP] += 1


@compiled
def learn(state: State, model: Model) -> None:
    """Lines 7 to 10 of Algorithm 1: act, observe, update; then set the cursor to lines 11 to 15."""
    q, best, visits, cursor = state.q, state.best, state.visits, state.cursor
    s, step = cursor[STATE], cursor[STEP]
    position = IDLE
    epsilon = model.epsilons[min(step, len(model.epsilons) - 1)]
    if unit(mix(mix(model.key, EXPLORE), step)) < epsilon:  # Alg. 1, l. 7
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
