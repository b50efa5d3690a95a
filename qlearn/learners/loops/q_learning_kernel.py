"""The Q-learning loop in compiled code: arrays and a cursor.

The loop runs until it is done or meets a pair that it cannot decide. The cursor says where it
stands, perhaps in the middle of a step's comparisons. Calling it again with a verdict goes on from
there. Random numbers are a hash of (key, purpose, counters): see ``elicit._support.hashing.fold``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import mix, unit
from elicit._support.jit import compiled, compiled_in_parts
from elicit.decision.comparator_rule import Rule
from elicit.lp.primal_simplex import Known
from elicit.lp.sign_proofs import BY_DOMINANCE
from elicit.model.difference_kernel import BETTER, LEFT_OPEN, UNKNOWN
from elicit.tutors.simulated_kernel import NOBODY, respond
from qlearn.learners.loops.action_pair_kernel import (
    BY_TUTOR,
    NO_TIER,
    ROOM_IN_RULE,
    USED,
    DecidingArrays,
    by_order,
    certified,
    decide_action_pair,
    difference,
    full,
    keep,
    learn_pair,
)

DONE, ASK, DEFER, FULL = range(4)
EXPLORE, ACTION, TRANSITION, RESTART, FIRST_BEST, AUDITS = (
    1,
    2,
    3,
    4,
    5,
    6,
)  # purposes of random numbers
STEP, STATE, POSITION, LAST, NEXT, EPISODE, AGE = range(7)  # the entries of the cursor
IDLE = -1  # POSITION between two steps


class Model(NamedTuple):
    """The MDP and the settings, as arrays that the loop reads."""

    successors: NDArray[np.int64]  # (S, A, b)
    cumulative: NDArray[np.float64]  # (S, A, b) running sums of the probabilities
    levels: NDArray[np.int64]  # (S, A)
    actions: NDArray[np.int64]  # (S, A) admissible actions first
    n_actions: NDArray[np.int64]  # (S,) number of admissible actions
    terminal: NDArray[np.bool_]  # (S,)
    initial: NDArray[np.float64]  # (S,) running sums of the initial distribution
    rates: NDArray[np.float64]  # learning rate by number of earlier visits of (s, a)
    discount: float
    epsilons: NDArray[np.float64]  # probability of exploring, by step; the last one stays
    steps: int
    episode_length: int  # 0: episodes end in terminal states only
    key: Any  # np.uint64

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        """Return the same object, so that a copied learner needs no new compilation."""
        return self


class State(NamedTuple):
    """The arrays of a run that the loop changes."""

    q: NDArray[np.float64]  # (S, A, k) shares
    best: NDArray[np.int64]  # (S,) B(s)
    visits: NDArray[np.int64]  # (S, A)
    cursor: NDArray[np.int64]  # (7,)
    decided: NDArray[np.int64]  # comparisons decided here, by tier


@compiled
def draw(cumulative: Any, u: float) -> int:
    """Return the first index whose running sum of probabilities exceeds u.

    If rounding leaves none, it is the last index with a probability above 0.
    """
    below = cumulative[-1] * (1.0 - 2.0**-53)  # the greatest number less than the total
    return int(np.searchsorted(cumulative, min(u, below), side="right"))


@compiled
def advance(state: State, model: Model, verdict: int, deciding: DecidingArrays) -> int:
    """Run the paper's Algorithm 1 from the cursor on.

    ``verdict`` decides the pair at the cursor (UNKNOWN: none yet). Comparisons are kept for a
    watcher unless equality or dominance decided them.

    Return DONE at the end, and FULL if what was kept must be passed on first. If the loop stops at
    a pair, return ASK if only the tutor can decide it, and DEFER if perhaps the elicitation can.
    """
    rule, asking, oracle, certificates, kept, _, told = deciding
    dominance, plain, fill = rule.dominance, asking.plain, told.fill
    turns = oracle.kind != NOBODY
    used, room = kept.used, len(kept.tiers)
    least, sides, tiers = certificates
    q, best, cursor, decided = state.q, state.best, state.cursor, state.decided
    actions, (m, k) = model.actions, state.q.shape[1:]
    d, t = np.empty(k), np.empty(k - 1)
    while True:
        if cursor[POSITION] == IDLE:
            if cursor[STEP] >= model.steps:
                return DONE
            learn(state, model)
        s = cursor[STATE]
        while cursor[POSITION] < cursor[LAST]:
            challenger = actions[s, cursor[POSITION]]
            incumbent = best[s]
            if challenger != incumbent:
                if verdict == UNKNOWN:
                    if full(used, room, fill):
                        return FULL
                    row = s * m + challenger
                    verdict = difference(q, s, challenger, incumbent, d, t)
                    tier = by_order(verdict, dominance)
                    if tier == NO_TIER and plain and certified(least, sides, row, t):
                        verdict, tier = sides[row], tiers[row]
                    if tier == NO_TIER and turns:
                        verdict, tier = respond(t, oracle), BY_TUTOR
                    elif tier == NO_TIER:
                        verdict, tier = decide_action_pair(
                            q, s, challenger, incumbent, row, d, t, deciding
                        )
                    if verdict == LEFT_OPEN:
                        return FULL if tier == NO_TIER else DEFER
                    if verdict == UNKNOWN:
                        return ASK
                    if tier > BY_DOMINANCE and room > 0:
                        keep(d, verdict, tier, kept)
                    decided[tier] += 1
                if verdict == BETTER:  # Alg. 2, l. 7 and 15; equal keeps the incumbent
                    best[s] = challenger
                verdict = UNKNOWN
            cursor[POSITION] += 1
        cursor[POSITION] = IDLE
        cursor[STATE] = cursor[NEXT]
        cursor[STEP] += 1


@compiled_in_parts
def advance_and_ask(
    state: State, model: Model, verdict: int, deciding: DecidingArrays
) -> tuple[int, Known]:
    """Run ``advance``, and ask the tutor about undecided pairs as long as ``learn_pair`` can.

    Return the code of ``advance``, and the facts about K_t after these answers.
    """
    _, asking, oracle, certificates, kept, tutor, told = deciding
    q, best, cursor, decided = state.q, state.best, state.cursor, state.decided
    rule, k = deciding.rule, q.shape[2]
    d, t = np.empty(k), np.empty(k - 1)
    while True:
        now = DecidingArrays(rule, asking, oracle, certificates, kept, tutor, told)
        code = advance(state, model, verdict, now)
        if code != ASK or told.fill[ROOM_IN_RULE] == 0:
            return code, rule.known
        if told.fill[USED] == told.fill[ROOM_IN_RULE]:
            return FULL, rule.known
        s = cursor[STATE]
        challenger = model.actions[s, cursor[POSITION]]
        verdict, tier, known = learn_pair(q, s, challenger, best[s], d, t, now)
        if verdict == UNKNOWN:
            return code, known
        rule = Rule(
            rule.kind, rule.dominance, known, rule.scales, rule.weights, rule.level, rule.grows
        )
        if len(kept.tiers) > 0:
            keep(d, verdict, tier, kept)
        decided[tier] += 1


@compiled
def learn(state: State, model: Model) -> None:
    """Act, observe and update: lines 7 to 10 of the paper's Algorithm 1.

    The cursor is then at lines 11 to 15, which compare actions.
    """
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
    ended = model.terminal[successor] or (
        model.episode_length > 0 and cursor[AGE] >= model.episode_length
    )
    if ended:
        cursor[EPISODE] += 1
        cursor[AGE] = 0
        successor = draw(model.initial, unit(mix(mix(model.key, RESTART), cursor[EPISODE])))
    cursor[NEXT] = successor
