"""A sweep of value iteration on share vectors, a block of states at a time, in compiled code.

Only V is kept for all states. Q(s, a) is computed for a single state at a time, in a small array.
Each state has a cursor: the action that is compared next. If compiled code cannot decide that
comparison, the state waits, while the other states go on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import unlocked
from elicit.model.comparator import Tier
from elicit.model.difference_kernel import BETTER, LEFT_OPEN, UNKNOWN
from elicit.model.scale import Floats
from elicit.tutors.simulated_kernel import NOBODY, respond
from qlearn.learners.loops.action_pair_kernel import (
    BY_TUTOR,
    NO_TIER,
    DecidingArrays,
    by_order,
    certified,
    decide_action_pair,
    difference,
    keep,
)
from qlearn.mdp.backup import MdpArrays, back_up_from

DONE, ANSWERED = -1, 0  # codes of a state beside UNKNOWN and LEFT_OPEN


class Work(NamedTuple):
    """The arrays that a sweep reads and writes."""

    v: Floats  # (S, k) V of the last sweep
    following: Floats  # (S, k) V of this sweep, written once a state is done
    best: NDArray[np.int64]  # (S,) each state's best action so far; read only
    cursor: NDArray[np.int32]  # (S,) its next challenger; read only


class Outcome(NamedTuple):
    """The outcome of a sweep over n states."""

    best: NDArray[np.int64]  # (n,)
    cursor: NDArray[np.int32]  # (n,)
    code: NDArray[
        np.int8
    ]  # (n,) DONE, ANSWERED, LEFT_OPEN, or UNKNOWN if only the tutor can decide the pair
    tiers: NDArray[np.int64]  # (len(Tier),) comparisons by the tier that decided them
    # (2, k - 1) the least and the greatest change of each tail sum of V at the states that are done
    change: Floats


def no_outcome(n: int, k: int) -> Outcome:
    """Return an Outcome with nothing in it yet, for n states of k levels."""
    return Outcome(
        np.empty(n, dtype=np.int64),
        np.empty(n, dtype=np.int32),
        np.empty(n, dtype=np.int8),
        np.zeros(len(Tier), dtype=np.int64),
        np.stack([np.full(k - 1, np.inf), np.full(k - 1, -np.inf)]),
    )


@unlocked
def sweep(states: Any, work: Work, model: MdpArrays, deciding: DecidingArrays, out: Outcome) -> int:
    """Back up each of the states (n,), and compare its actions from its cursor on.

    Each action is compared with the best of those before it. Return the number of states reached.
    The sweep stops if there may be no room to keep the next state's comparisons.

    If there is an oracle, a simulated tutor that answers in place of the comparator, one challenger
    of each state is compared, by order, a certificate or the oracle, so that all states take turns.
    The state's code is then ANSWERED. The sweep stops after a state for which the oracle returns
    LEFT_OPEN.
    """
    rule, asking, oracle, certificates, kept, _, _ = deciding
    keeps = len(kept.tiers) > 0
    v, following = work.v, work.following
    ends, terminal, cursor, incumbents = model.ends, model.terminal, work.cursor, work.best
    best_now, cursor_now, code_now, tiers = out.best, out.cursor, out.code, out.tiers
    arrays, discount = (model.successors, model.probabilities, ends, model.levels), model.discount
    turns = oracle.kind != NOBODY
    m, k = model.n_actions, v.shape[1]
    dominance, plain = rule.dominance, asking.plain
    least, sides, certificate_tiers = certificates
    d, t, vectors = np.empty(k), np.empty(k - 1), np.empty((1, m, k))
    q = vectors[0]
    low, high = out.change[0], out.change[1]
    for i in range(len(states)):
        if keeps and kept.used[0] + m > len(kept.tiers):
            return i
        s = states[i]
        best, code, at = incumbents[s], DONE, m
        if terminal[s]:
            for j in range(k):
                following[s, j] = v[s, j]
                if j > 0:
                    low[j - 1], high[j - 1] = min(low[j - 1], 0.0), max(high[j - 1], 0.0)
        else:
            back_up_from(s, v, arrays, discount, q)
            for a in range(cursor[s], m):
                row = s * m + a
                if a == best or ends[row] == ends[row + 1]:
                    continue
                verdict = difference(vectors, 0, a, best, d, t)
                tier = by_order(verdict, dominance)
                if tier == NO_TIER and plain and certified(least, sides, row, t):
                    verdict, tier = sides[row], certificate_tiers[row]
                if tier == NO_TIER and turns:
                    verdict, tier = respond(t, oracle), BY_TUTOR
                elif tier == NO_TIER:
                    verdict, tier = decide_action_pair(vectors, 0, a, best, row, d, t, deciding)
                if verdict in (UNKNOWN, LEFT_OPEN):
                    code, at = verdict, a
                    break
                tiers[tier] += 1
                if keeps:
                    keep(d, verdict, tier, kept)
                if verdict == BETTER:
                    best = a
                if turns:
                    code, at = ANSWERED, a + 1
                    break
            if code == DONE:
                total = 0.0
                for j in range(k - 1, -1, -1):
                    if j > 0:
                        total += q[best, j] - v[s, j]
                        low[j - 1], high[j - 1] = min(low[j - 1], total), max(high[j - 1], total)
                    following[s, j] = q[best, j]
        best_now[i], cursor_now[i], code_now[i] = best, at, code
        if turns and code == LEFT_OPEN:
            return i + 1
    return len(states)
