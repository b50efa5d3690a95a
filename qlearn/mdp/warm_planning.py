"""Approximate solutions of large MDPs, each from a solution nearby.

The method is sweeps of value iteration that stop early. Sweeps need a long time to move all values
up or down together, and a short time to settle the differences between states. But the common part
is known at once: after changes between ``low`` and ``high``, the values still have between discount
/ (1 - discount) times these to go (MacQueen 1966). So sweeps stop once high - low is small, and the
common part is added. If states mix slowly, as on grids, thousands of sweeps would be needed. Then
linear systems are solved instead.

Nothing here is exact, and nothing relies on it: callers that need certainty bound the error
(``loss_bound``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from elicit._support.threads import one_thread
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn.mdp.blocks import in_blocks, some_rows
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions, valued

_LOOK = 4  # sweeps between two measurements of their pace
_WORTH = 40  # a linear system takes about as long as this many sweeps
_ROUNDS = 200  # largest number of policies
_ROUNDING = 1e-14  # sweeps need not get below this width
_COARSE = 4e-6  # single precision sweeps shares to this width, forty times its rounding
_LARGE = 4_000_000  # with more products in a sweep, single precision is worth a copy of the chain
_MOST_COARSE = 30  # largest number of sweeps in single precision
_AT_ONCE = 1 << 14  # states whose changes are in memory at the same time
_FINEST = 1e-8  # values that choose questions are swept no further than to this width
_SLOW = 0.8  # sweeps that leave more than this share of the last width are too slow


@one_thread
def nearly_optimal(
    mdp: OrdinalMDP,
    gain: Floats,
    ends: Floats,
    start: Floats,
    within: float,
    last: Actions | None = None,
    states: Actions | None = None,
) -> tuple[Floats, Actions, float]:
    """Return the greatest discounted total (S,) of rewards ``gain`` (S, A), to about ``within``.

    Also return a policy (S,) that is nearly greedy for it, and an upper bound on what the total
    lacks at any state. A terminal state's total is ``ends`` (S,). The method is modified policy
    iteration (Puterman and Shin 1978) from ``start`` (S,).

    Actions of the policy ``last`` (S,) are kept if they are as good, to within (1 - discount)
    ``within``. If ``states`` (n,) are given, sweeps end once the totals are good enough at these
    states, as far as their changes tell. The upper bound is then of these states alone, and proves
    nothing.
    """
    rows, ratio = np.arange(mdp.n_states), mdp.discount / (1 - mdp.discount)
    ends = np.where(mdp.terminal, ends, 0.0)
    v = np.where(mdp.terminal, ends, start)
    policy = np.argmax(mdp.admissible, axis=1) if last is None else last
    slack = 0.0 if last is None else (1 - mdp.discount) * within
    for left in reversed(range(_ROUNDS)):
        best, greedy, low, high = _improved(mdp, gain, ends, v, last, slack, states)
        same = greedy == policy
        policy, v = greedy, best
        if ratio * (high - low) <= within or (same.all() and high - low <= _ROUNDING) or not left:
            break  # low and high are about the present value, also if rounds have run out
        own, final = gain[rows, policy][:, None], ends[:, None]
        to = float(high - low) / 10
        v = _followed(mdp, _chain(mdp, policy), own, final, v[:, None], to, states)[:, 0]
    middle = _to_go(mdp, low, high)
    return np.where(mdp.terminal, v, v + middle), policy, float(ratio * high - middle)


@one_thread
def nearly_valued(
    mdp: OrdinalMDP,
    policy: Actions,
    start: Floats | None,
    within: float,
    states: Actions | None = None,
) -> Floats:
    """Return the approximate vector value of a deterministic policy (S,), as shares (S, k).

    ``evaluate_policy`` gives the exact one. The accuracy is this: if the tail sums of these shares
    were backed up along the policy, the changes would differ from state to state by little more
    than ``within``. If some states are terminal, the changes themselves would be as small. The
    sweeps begin at the shares ``start`` (S, k), if there are any. If ``states`` (n,) are given,
    only the changes at these states count.
    """
    levels, chain = np.arange(mdp.k - 1), _chain(mdp, policy)
    ends = ((mdp.final_level[:, None] > levels) & mdp.terminal[:, None]).astype(np.float64)
    gain: Floats = np.where(
        mdp.levels[np.arange(mdp.n_states), policy][:, None] > levels, 1.0 - mdp.discount, 0.0
    )
    tails = np.full(gain.shape, 0.5) if start is None else np.ascontiguousarray(tail_sums(start))
    tails[mdp.terminal] = ends[mdp.terminal]
    shares = _shares_of(_followed(mdp, chain, gain, ends, tails, within, states))
    negative = (shares if states is None else shares[states]).min() < -within
    if negative and states is not None and within > _FINEST:
        # the middle of the changes is off by up to discount / (1 - discount) of half their width
        np.maximum(shares, 0.0, out=shares)
        del chain, gain, ends, tails
        return nearly_valued(mdp, policy, shares, within / 10, states)
    if negative:
        # all columns were moved too far together, as can happen if some states already have all
        # that they will ever have; cutting off the negative part would tear states apart
        shares = _shares_of(valued(mdp, chain, gain, ends))
    np.maximum(shares, 0.0, out=shares)
    shares /= shares.sum(axis=1, keepdims=True)
    return shares


def _chain(mdp: OrdinalMDP, policy: Actions) -> sparse.csr_array:
    """Return the transition matrix (S, S) of a policy."""
    return mdp.transitions[np.arange(mdp.n_states) * mdp.n_actions + policy]


def _followed(
    mdp: OrdinalMDP,
    chain: sparse.csr_array,
    gain: Floats,
    ends: Floats,
    v: Floats,
    within: float,
    states: Actions | None = None,
) -> Floats:
    """Return discounted totals (S, c) of rewards ``gain`` (S, c) in a chain, from v (S, c).

    Terminal states' totals are ``ends`` (S, c). Sweeps go on until no column's changes differ by
    more than ``within`` from state to state, or among ``states`` (n,). v is overwritten.
    """
    if chain.nnz * v.shape[1] >= _LARGE and v.shape[1] > 1:
        v, done = _followed_coarsely(mdp, chain, gain, ends, v, within, states)
        if done:
            return v
    ended, widths = bool(mdp.terminal.any()), list[float]()
    while True:
        v, low, high = _swept(mdp, chain, gain, ends, v, states)
        width = mdp.discount * float((high - low).max())
        if width <= max(within, _ROUNDING):
            if not ended:
                v += _to_go(mdp, low, high)
            return v
        widths.append(width)
        if len(widths) % _LOOK == 0 and len(widths) > _LOOK:
            pace = (width / widths[-_LOOK - 1]) ** (1 / _LOOK)
            if not pace < 1 or np.log(within / width) < _WORTH * np.log(pace):
                return valued(mdp, chain, gain, ends)


def _followed_coarsely(
    mdp: OrdinalMDP,
    chain: sparse.csr_array,
    gain: Floats,
    ends: Floats,
    v: Floats,
    within: float,
    states: Actions | None,
) -> tuple[Floats, bool]:
    """Return the totals of ``_followed`` by sweeps in single precision, and if they suffice.

    Single precision needs half the memory and time. The sweeps end at ``within``, at the limit of
    single precision, or once they are too slow.
    """
    coarse = sparse.csr_array(
        (chain.data.astype(np.float32), chain.indices, chain.indptr), shape=chain.shape
    )
    gains, finals, now = (x.astype(np.float32) for x in (gain, ends, v))
    widths = [np.inf, np.inf]
    for _ in range(_MOST_COARSE):
        now, low, high = _swept(mdp, coarse, gains, finals, now, states)
        width = mdp.discount * float((high - low).max())
        if width <= max(within, _COARSE) or width > _SLOW * widths[-2]:
            break
        widths.append(width)
    if not mdp.terminal.any():
        now += _to_go(mdp, low, high)
    return np.asarray(now, dtype=np.float64), width <= within


def _swept(
    mdp: OrdinalMDP,
    chain: sparse.csr_array,
    gain: Any,
    ends: Any,
    v: Any,
    states: Actions | None = None,
) -> tuple[Any, Floats, Floats]:
    """Return the values (S, c) after one sweep, and each column's least and greatest change.

    A sweep gives ``gain`` plus discounted v (S, c), and ``ends`` (S, c) in terminal states. If
    ``states`` (n,) are given, the changes are those at these states.
    """

    def sweep(first: int, last: int) -> tuple[Any, Floats]:
        here = slice(first, last)
        found = some_rows(chain, first, last) @ v
        found *= mdp.discount
        found += gain[here]
        ended = mdp.terminal[here]
        if ended.any():
            found[ended] = ends[here][ended]
        changes: list[Floats] = []
        if states is not None:
            return found, np.empty((2, v.shape[1]))
        for start in range(0, last - first, _AT_ONCE):  # never all changes in memory
            some = found[start : start + _AT_ONCE]
            moved = some - v[first + start : first + start + len(some)]
            changes.append(np.array([moved.min(axis=0), moved.max(axis=0)]))
        return found, np.array(_over_all(changes))

    blocks = in_blocks(sweep, mdp.n_states, chain.nnz * v.shape[1])
    new = blocks[0][0] if len(blocks) == 1 else np.concatenate([found for found, _ in blocks])
    if states is not None:
        moved = new[states] - v[states]
        return new, moved.min(axis=0), moved.max(axis=0)
    return new, *_over_all([change for _, change in blocks])


def _improved(
    mdp: OrdinalMDP,
    gain: Floats,
    ends: Floats,
    v: Floats,
    last: Actions | None,
    slack: float,
    states: Actions | None,
) -> tuple[Floats, Actions, Floats, Floats]:
    """Return the values (S,) after one sweep, the actions (S,) that attain them, and two numbers.

    The numbers are the least and the greatest change from v (S,), over ``states`` (n,) if they are
    given. Of equally good actions the first is taken, but those of ``last`` (S,) are kept if they
    are as good to within ``slack``.
    """
    best, greedy, m = np.empty_like(v), np.empty(len(v), dtype=np.int64), mdp.n_actions

    def sweep(first: int, end: int) -> Floats:
        here = slice(first, end)
        found = some_rows(mdp.transitions, first * m, end * m) @ v
        q = gain[here] + mdp.discount * found.reshape(-1, m)
        q[mdp.terminal[here]] = ends[here][mdp.terminal[here], None]
        q[~mdp.admissible[here]] = -np.inf
        greedy[here] = q.argmax(axis=1)
        rows = np.arange(end - first)
        best[here] = q[rows, greedy[here]]
        if last is not None:
            kept = q[rows, last[here]] >= best[here] - slack
            greedy[here][kept] = last[here][kept]
        moved = best[here] - v[here]
        return np.array([moved.min(), moved.max()])

    low, high = _over_all(in_blocks(sweep, mdp.n_states, mdp.transitions.nnz))
    if states is not None:
        some = best[states] - v[states]
        low, high = some.min(), some.max()
    return best, greedy, low, high


def _over_all(changes: list[Floats]) -> tuple[Floats, Floats]:
    """Return the least and the greatest change of each column over all blocks.

    If states are terminal, 0 is among the changes.
    """
    both = np.array(changes)
    return both[:, 0].min(axis=0), both[:, 1].max(axis=0)


def _to_go(mdp: OrdinalMDP, low: Floats, high: Floats) -> Floats:
    """Return the amount to add to all values after a sweep's changes between ``low`` and ``high``.

    It is the middle of what is still to come, or 0 if some states are terminal.
    """
    middle: Floats = mdp.discount / (1 - mdp.discount) * (low + high) / 2
    return np.zeros_like(middle) if mdp.terminal.any() else middle


def _shares_of(tails: Floats) -> Floats:
    """Return the shares (S, k) whose tail sums are these (S, k - 1)."""
    shares = np.empty((len(tails), tails.shape[1] + 1))
    shares[:, 0], shares[:, 1:] = 1.0, tails
    shares[:, :-1] -= tails
    return shares
