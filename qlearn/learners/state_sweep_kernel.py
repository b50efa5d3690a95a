"""One sweep of value iteration on share vectors, a block of states at a time, in code that numba can compile.

Q(s, a) of one state fits into a small scratch, so only V is kept. A state whose pair neither the rule nor the
indifference settles is left waiting, its cursor at that pair, while the other states go on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.jit import compiled, unlocked
from elicit.asking.elicitation_kernel import NOTHING_LOOKED_UP, AskingRule, judge_pair
from elicit.decision.judge import holds
from elicit.lp.sign import (
    BETTER,
    BY_DOMINANCE,
    BY_EQUAL,
    BY_SCREEN,
    EQUAL,
    UNKNOWN,
    UNSETTLED,
    WORSE,
    by_dominance,
)
from elicit.model.comparator import Tier
from elicit.model.scale import Floats
from qlearn.mdp.backup import Model, back_up_from

DONE = 0  # beside UNKNOWN and UNSETTLED: how a state's competition stands


class Work(NamedTuple):
    """What a sweep reads and writes."""

    v: Floats  # (S, k) V of the last sweep
    following: Floats  # (S, k) V of this sweep, written where a state is done
    best: NDArray[np.int64]  # (S,) each state's best action so far; read only
    cursor: NDArray[np.int32]  # (S,) its next challenger; read only
    floors: NDArray[np.float32]  # (S*A, p) how far the tail sums of (s, a) may sink (``elicit.decision.judge.judge``)
    sides: NDArray[np.int8]  # (S*A,) the verdict that then holds, times its tier; 0: none


class Found(NamedTuple):
    """What a sweep found out about a list of n states."""

    best: NDArray[np.int64]  # (n,)
    cursor: NDArray[np.int32]  # (n,)
    code: NDArray[np.int8]  # (n,) DONE, or of the pair at the cursor: UNKNOWN to all but the tutor, or UNSETTLED
    tiers: NDArray[np.int64]  # (len(Tier),) comparisons by who settled them
    change: Floats  # (1,) the greatest change of a tail sum of V at a state that is done


def found(n: int) -> Found:
    """Room for what a sweep finds out about n states."""
    return Found(
        np.empty(n, dtype=np.int64),
        np.empty(n, dtype=np.int32),
        np.empty(n, dtype=np.int8),
        np.zeros(len(Tier), dtype=np.int64),
        np.zeros(1),
    )


@unlocked
def compete(
    states: Any, enough: int, work: Work, model: Model, rule: Any, asking: AskingRule, opened: Any, out: Found
) -> int:
    """Back up each of the states (n,) and let its actions compete from its cursor on; stop once ``enough`` of them
    have to wait. Returns how many were reached.

    ``opened`` is as for ``by_order``, or (0,).
    """
    v, following, floors, sides = work.v, work.following, work.floors, work.sides
    ends, terminal, cursor, incumbents = model.ends, model.terminal, work.cursor, work.best
    best_now, cursor_now, code_now, tiers = out.best, out.cursor, out.code, out.tiers
    arrays, discount, plain = (
        (model.successors, model.probabilities, ends, model.levels),
        model.discount,
        asking.plain,
    )
    m, k = model.n_actions, v.shape[1]
    q, d, t = np.empty((m, k)), np.empty(k), np.empty(k - 1)
    sums, floor = np.empty((2, k - 1)), np.empty(k - 1)
    waiting, change = 0, 0.0
    for i in range(len(states)):
        if waiting == enough:
            out.change[0] = change
            return i
        s = states[i]
        best, code, at = incumbents[s], DONE, m
        if terminal[s]:
            for j in range(k):
                following[s, j] = v[s, j]
        else:
            back_up_from(s, v, arrays, discount, q)
            for a in range(cursor[s], m):
                row = s * m + a
                if a == best or ends[row] == ends[row + 1]:
                    continue
                verdict = difference(q, a, best, d, t)
                side = sides[row]
                if verdict != UNKNOWN:
                    verdict, tier = by_order(t, verdict, opened)
                elif side != 0 and plain and holds(t, 1 if side > 0 else -1, floors[row]):
                    verdict, tier = (BETTER, side) if side > 0 else (WORSE, -side)
                else:
                    judged = judge_pair(d, t, sums, floor, rule, asking, NOTHING_LOOKED_UP)
                    verdict, tier = UNSETTLED if judged.audited else judged.verdict, judged.tier
                    if judged.certified:
                        sides[row] = verdict * tier
                        round_up(floor, floors[row])
                if verdict in (UNKNOWN, UNSETTLED):
                    code, at = verdict, a
                    waiting += 1
                    break
                tiers[tier] += 1
                if verdict == BETTER:
                    best = a
            if code == DONE:
                total = 0.0
                for j in range(k - 1, -1, -1):
                    if j > 0:
                        total += q[best, j] - v[s, j]
                        change = max(change, abs(total))
                    following[s, j] = q[best, j]
        best_now[i], cursor_now[i], code_now[i] = best, at, code
    out.change[0] = change
    return len(states)


@compiled
def by_order(t: Any, verdict: int, opened: Any) -> tuple[int, int]:
    """Verdict and tier of a pair that eq. (4) settles, on a scale some of whose gaps are known to be 0: where
    ``opened`` (p,) is 0. Overwrites t."""
    for j in range(len(opened)):
        t[j] *= opened[j]
    left = by_dominance(t) if len(opened) > 0 else verdict
    if left != verdict:
        return left, BY_SCREEN
    return verdict, BY_EQUAL if verdict == EQUAL else BY_DOMINANCE


@compiled
def round_up(numbers: Any, into: Any) -> None:
    """Half-size numbers that are not less: half the memory, and a floor may only be too high."""
    for j in range(len(numbers)):
        number = max(numbers[j], -1e38)
        into[j] = number
        if into[j] < number:
            into[j] = number + abs(number) * 2.0**-22 + 2.0**-126


@compiled
def difference(q: Any, a: int, b: int, d: Any, t: Any) -> int:
    """Q(s, a) - Q(s, b) into d (k,), its tail sums into t (p,), and their verdict by eq. (4)."""
    k = len(d)
    total = 0.0
    some_up, some_down = False, False
    for j in range(k - 1, 0, -1):
        d[j] = q[a, j] - q[b, j]
        total += d[j]
        t[j - 1] = total
        some_up = some_up or total > 0.0
        some_down = some_down or total < 0.0
    d[0] = q[a, 0] - q[b, 0]
    if some_up:
        return UNKNOWN if some_down else BETTER
    return WORSE if some_down else EQUAL
