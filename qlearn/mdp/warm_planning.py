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

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from elicit._support.threads import one_thread
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn.mdp.blocks import in_blocks, some_rows
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions, valued
from qlearn.mdp.sweep_kernels import (
    GreedyRule,
    Rewards,
    arrays_of,
    improve,
    pass_on,
    sweep_rows,
    take_in,
)

_LOOK = 4  # sweeps between two measurements of their pace
_WORTH = 40  # a linear system takes about as long as this many sweeps
_ROUNDS = 200  # largest number of policies
_ROUNDING = 1e-14  # sweeps need not get below this width
# With more products in a sweep than this, passing on changes, fetching successors ahead and leaving
# out actions are worth their code.
LARGE = 4_000_000
_MOST_CHANGES = 30  # largest number of sweeps that pass on changes
_STILL = 0.25  # changes that differ from most others' by less than this part are not passed on
_AT_ONCE = 1 << 14  # states whose changes are in memory at the same time
_FINEST = 1e-8  # values that choose questions are swept no further than to this width
_SLOW = 0.8  # sweeps that leave more than this share of the last width are too slow
_FEW = 0.6  # it pays to leave out actions if at most this share of them is left
_LOOKED_AT = 1000  # states by which that share is estimated


class Seen:
    """The values and means of an earlier sweep, which show that some actions are not the best now.

    An action's mean is the expected value of its next state. If all values v have changed by
    between ``low`` and ``high`` since, each mean has too. So an action that was worse than another
    one by more than discount * (high - low) is still worse. Before the first sweep, values and
    means count as 0.
    """

    def __init__(self) -> None:
        self._v: Floats | None = None  # (S,)
        self._means: NDArray[np.float32] | None = None  # (S, A)

    def room(self, v: Floats, discount: float) -> float:
        """Return by how much an action must have been worse than another to be worse still.

        The present values are v (S,).
        """
        moved, size = (v, 0.0) if self._v is None else (v - self._v, float(np.abs(self._v).max()))
        rounding = 2.0**-22 * size + 1e-12  # means are kept in single precision
        return discount * float(moved.max() - moved.min()) + rounding

    def may_be_best(
        self, mdp: OrdinalMDP, gain: Floats, room: float, here: slice | Actions
    ) -> NDArray[np.bool_]:
        """Return flags (n, A) of the actions that may be the best in states (n,)."""
        q = gain[here] if self._means is None else gain[here] + mdp.discount * self._means[here]
        q = np.where(mdp.admissible[here], q, -np.inf)
        return np.asarray(q >= q.max(axis=1, keepdims=True) - room)

    def means(self, actions: int) -> NDArray[np.float32]:
        """Return the old means (S, A), or an array (0, A) if there are none."""
        return np.empty((0, actions), dtype=np.float32) if self._means is None else self._means

    def forget(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Forget the old means, and return an array (S, A) for new ones.

        So an interrupted sweep leaves no array in which old and new means are mixed.
        """
        means, self._means, self._v = self._means, None, None
        return np.empty(shape, dtype=np.float32) if means is None else means

    def keep(self, v: Floats, means: NDArray[np.float32]) -> None:
        """Keep the means (S, A) of the successors' values v (S,)."""
        self._v, self._means = v.copy(), means


class _Rows(NamedTuple):
    """The transitions under a policy, as ``sweep_rows`` reads them."""

    rows: NDArray[np.integer[Any]]  # (S,) the row of each state
    ends: NDArray[np.integer[Any]]
    successors: NDArray[np.integer[Any]]
    probabilities: NDArray[np.floating[Any]]


class _Chain:
    """The transitions under a policy, in each form that a sweep may need."""

    def __init__(self, mdp: OrdinalMDP, policy: Actions) -> None:
        self._mdp = mdp
        self._rows = np.arange(mdp.n_states) * mdp.n_actions + policy
        self.nnz = int(np.diff(mdp.transitions.indptr)[self._rows].sum())

    @cached_property
    def matrix(self) -> sparse.csr_array:
        """The transitions as a matrix (S, S)."""
        return self._mdp.transitions[self._rows]

    def in_place(self) -> _Rows:
        """Return the policy's rows as indices into the MDP's own arrays, which are not copied."""
        return _Rows(self._rows, *arrays_of(self._mdp))


@one_thread
def nearly_optimal(
    mdp: OrdinalMDP,
    gain: Floats,
    ends: Floats,
    start: Floats,
    within: float,
    last: Actions | None = None,
    states: Actions | None = None,
    seen: Seen | None = None,
) -> tuple[Floats, Actions, float]:
    """Return the greatest discounted total (S,) of rewards ``gain`` (S, A), to about ``within``.

    Also return a policy (S,) that is nearly greedy for it, and an upper bound on how far the total
    is below the exact one at any state. A terminal state's total is ``ends`` (S,). The method is
    modified policy iteration (Puterman and Shin 1978) from ``start`` (S,).

    Actions of the policy ``last`` (S,) are kept if they are as good, to within (1 - discount)
    ``within``. If ``states`` (n,) are given, sweeps end once the totals are good enough at these
    states, as far as their changes tell. The upper bound is then of these states alone, and proves
    nothing.

    ``seen`` holds what an earlier call for this MDP has seen. It saves time in large models, and
    changes no number.
    """
    rows, ratio = np.arange(mdp.n_states), mdp.discount / (1 - mdp.discount)
    ends = np.where(mdp.terminal, ends, 0.0)
    v = np.where(mdp.terminal, ends, start)
    policy = np.argmax(mdp.admissible, axis=1) if last is None else last
    slack = 0.0 if last is None else (1 - mdp.discount) * within
    seen = Seen() if seen is None else seen
    for left in reversed(range(_ROUNDS)):
        best, greedy, low, high = _improved(mdp, gain, ends, v, last, slack, states, seen)
        same = greedy == policy
        policy, v = greedy, best
        if ratio * (high - low) <= within or (same.all() and high - low <= _ROUNDING) or not left:
            break  # low and high are about the present value, also if rounds have run out
        own, final = gain[rows, policy][:, None], ends[:, None]
        to = float(high - low) / 10
        v = _followed(mdp, _Chain(mdp, policy), own, final, v[:, None], to, states)[:, 0]
    middle = _to_go(mdp, low, high)
    return np.where(mdp.terminal, v, v + middle), policy, float(ratio * high - middle)


@one_thread
def nearly_valued(
    mdp: OrdinalMDP,
    policy: Actions,
    start: Floats | None,
    within: float,
    states: Actions | None = None,
    before: Actions | None = None,
) -> Floats:
    """Return the approximate vector value of a deterministic policy (S,), as shares (S, k).

    ``evaluate_policy`` gives the exact one. The accuracy is this: if the tail sums of these shares
    were backed up along the policy, the changes would differ from state to state by little more
    than ``within``. If some states are terminal, the changes themselves would be as small. The
    sweeps begin at the shares ``start`` (S, k), if there are any. If ``states`` (n,) are given,
    only the changes at these states count.

    If the shares ``start`` are the value of another policy ``before`` (S,) to about the same
    accuracy, a large model is swept only where the difference between the policies matters.
    """
    levels, chain = np.arange(mdp.k - 1), _Chain(mdp, policy)
    ends: Floats = np.broadcast_to(0.0, (mdp.n_states, len(levels)))  # takes no memory
    if mdp.terminal.any():
        ends = ((mdp.final_level[:, None] > levels) & mdp.terminal[:, None]).astype(np.float64)
    shape = mdp.n_states, len(levels)
    tails = np.full(shape, 0.5) if start is None else np.ascontiguousarray(tail_sums(start))
    tails[mdp.terminal] = ends[mdp.terminal]
    done = False
    if chain.nnz * len(levels) >= LARGE and len(levels) > 1:
        since = before if start is not None else None
        done = _changed(mdp, policy, chain, ends, tails, within, states, since)
    if not done:
        gain = _tails_of_levels(mdp, policy, slice(None))
        tails = _followed(mdp, chain, gain, ends, tails, within, states)
        del gain
    shares = _shares_of(tails)
    del tails
    negative = (shares if states is None else shares[states]).min() < -within
    if negative and states is not None and within > _FINEST:
        # the middle of the changes is off by up to discount / (1 - discount) of half their width
        np.maximum(shares, 0.0, out=shares)
        del chain, ends
        return nearly_valued(mdp, policy, shares, within / 10, states)
    if negative:
        # all columns were moved too far together, as can happen if some states already have all
        # that they will ever have; cutting off the negative part would tear states apart
        gain = _tails_of_levels(mdp, policy, slice(None))
        shares = _shares_of(valued(mdp, chain.matrix, gain, ends))
    np.maximum(shares, 0.0, out=shares)
    shares /= shares.sum(axis=1, keepdims=True)
    return shares


def _tails_of_levels(mdp: OrdinalMDP, policy: Actions, states: slice | Actions) -> Floats:
    """Return the tail sums (n, k - 1) of what a policy (S,) earns at once in states (n,)."""
    earned = mdp.levels[np.arange(mdp.n_states)[states], policy[states]]
    return np.where(earned[:, None] > np.arange(mdp.k - 1), 1.0 - mdp.discount, 0.0)


def _changed(
    mdp: OrdinalMDP,
    policy: Actions,
    chain: _Chain,
    ends: Floats,
    tails: Floats,
    within: float,
    states: Actions | None,
    before: Actions | None,
) -> bool:
    """Turn the tail sums (S, k - 1) of a start into those of a policy's value, by their changes.

    A sweep adds to the tail sums how they change, and passes these changes on to the predecessors.
    What changes in most states alike is added at once, with all that it will become. The changes
    of states that differ from that by little are not passed on. So a sweep reads few states at
    first, if the policy differs in few states from that of the start, and few again at the end.
    Changes are kept in single precision, which does not limit the accuracy of the tail sums.

    Return whether the changes of the last sweep, over all states or ``states`` (n,), differ by no
    more than ``within``. Sweeps end earlier if they are too slow.
    """
    rows, ended = chain.in_place(), bool(mdp.terminal.any())
    change = _first_change(mdp, policy, rows, ends, tails, before)
    some = np.linspace(0, len(change) - 1, _LOOKED_AT).astype(np.int64)
    active, left = np.empty(len(change), dtype=np.bool_), np.zeros(change.shape[1])
    new, least, widths = np.empty_like(change), np.float32(_STILL * within), [np.inf, np.inf]
    onwards = mdp.discount / (1 - mdp.discount)
    for _ in range(_MOST_CHANGES):
        width = mdp.discount * float(np.ptp(change if states is None else change[states], 0).max())
        middle = np.zeros_like(change[0]) if ended else np.median(change[some], axis=0)
        common = np.zeros_like(left) if ended else onwards * (middle + left / len(change))
        take_in(change, middle, common, least, tails, active, left)
        if width <= within or width > _SLOW * widths[-2]:
            return width <= within
        widths.append(width)
        _pass_on(mdp, rows, change, active, new)
        change, new = new, change
    return False


def _pass_on(
    mdp: OrdinalMDP,
    rows: _Rows,
    change: NDArray[np.float32],
    active: NDArray[np.bool_],
    new: NDArray[np.float32],
) -> None:
    """Write how the changes (S, c) of active (S,) states change their predecessors into new."""

    def sweep(first: int, last: int) -> None:
        part = new[first:last]
        pass_on(first, *rows, np.float32(mdp.discount), change, active, part)
        part[mdp.terminal[first:last]] = 0.0

    in_blocks(sweep, len(change), len(rows.successors) // mdp.n_actions * change.shape[1])


def _first_change(
    mdp: OrdinalMDP,
    policy: Actions,
    rows: _Rows,
    ends: Floats,
    tails: Floats,
    before: Actions | None,
) -> NDArray[np.float32]:
    """Return how one sweep along a policy changes tail sums (S, k - 1).

    If they are those of the value of the policy ``before`` (S,), they change only where the
    policies differ.
    """
    change, at_once = np.zeros(tails.shape, dtype=np.float32), _AT_ONCE
    live = ~mdp.terminal if before is None else ~mdp.terminal & (policy != before)
    where = np.flatnonzero(live)
    for start in range(0, len(where), at_once):
        here = where[start : start + at_once]
        found, gain = np.empty((len(here), tails.shape[1])), _tails_of_levels(mdp, policy, here)
        sweep_rows(0, rows.rows[here], *rows[1:], gain, mdp.discount, tails, found)
        change[here] = found - tails[here]
    return change


def _followed(
    mdp: OrdinalMDP,
    chain: _Chain,
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
    large = chain.nnz * v.shape[1] >= LARGE
    ended, widths = bool(mdp.terminal.any()), list[float]()
    transitions: sparse.csr_array | _Rows = chain.in_place() if large else chain.matrix
    while True:
        v, low, high = _swept(mdp, transitions, gain, ends, v, states)
        width = mdp.discount * float((high - low).max())
        if width <= max(within, _ROUNDING):
            if not ended:
                v += _to_go(mdp, low, high)
            return v
        widths.append(width)
        if len(widths) % _LOOK == 0 and len(widths) > _LOOK:
            pace = (width / widths[-_LOOK - 1]) ** (1 / _LOOK)
            if not pace < 1 or np.log(within / width) < _WORTH * np.log(pace):
                return valued(mdp, chain.matrix, gain, ends)


def _swept(
    mdp: OrdinalMDP,
    chain: sparse.csr_array | _Rows,
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
        if isinstance(chain, _Rows):
            found = np.empty((last - first, v.shape[1]), dtype=v.dtype)
            sweep_rows(first, *chain, gain, v.dtype.type(mdp.discount), v, found)
        else:
            found = some_rows(chain, first, last) @ v
            found *= mdp.discount
            found += gain[here]
        ended = mdp.terminal[here]
        if ended.any():
            found[ended] = ends[here][ended]
        return found, _change(found, v[here], states)

    work = len(chain.probabilities) if isinstance(chain, _Rows) else chain.nnz
    blocks = in_blocks(sweep, mdp.n_states, work * v.shape[1])
    new = blocks[0][0] if len(blocks) == 1 else np.concatenate([found for found, _ in blocks])
    return new, *_over_all([change for _, change in blocks], new, v, states)


def _improved(
    mdp: OrdinalMDP,
    gain: Floats,
    ends: Floats,
    v: Floats,
    last: Actions | None,
    slack: float,
    states: Actions | None,
    seen: Seen,
) -> tuple[Floats, Actions, Floats, Floats]:
    """Return the values (S,) after one sweep, the actions (S,) that attain them, and two numbers.

    The numbers are the least and the greatest change from v (S,), over ``states`` (n,) if they are
    given. Of equally good actions the first is taken, but those of ``last`` (S,) are kept if they
    are as good to within ``slack``. In a large model, actions that cannot be the best by what was
    ``seen`` are left out.
    """
    best, greedy, m = np.empty_like(v), np.empty(len(v), dtype=np.int64), mdp.n_actions
    large, room, means = mdp.transitions.nnz >= LARGE, np.inf, None
    if large:
        room = seen.room(v, mdp.discount)
        some = np.linspace(0, len(v) - 1, _LOOKED_AT).astype(np.int64)
        if seen.may_be_best(mdp, gain, room, some).mean() > _FEW:
            room, means = np.inf, seen.forget(gain.shape)
    rewards = Rewards(gain, ends, mdp.terminal, mdp.admissible, mdp.discount)
    known = seen.means(m) if means is None else means
    kept = np.empty(0, dtype=np.int64) if last is None else last
    choosing = GreedyRule(known, means is not None, room, kept, slack)

    def choose(first: int, end: int) -> None:
        here = slice(first, end)
        q = gain[here] + mdp.discount * (
            some_rows(mdp.transitions, first * m, end * m) @ v
        ).reshape(-1, m)
        q[mdp.terminal[here]] = ends[here][mdp.terminal[here], None]
        q[~mdp.admissible[here]] = -np.inf
        greedy[here] = q.argmax(axis=1)
        rows = np.arange(end - first)
        best[here] = q[rows, greedy[here]]
        if last is not None:
            stay = q[rows, last[here]] >= best[here] - slack
            greedy[here][stay] = last[here][stay]

    def choose_of_few(first: int, end: int) -> None:
        at = slice(first, end)
        improve(first, arrays_of(mdp), v, rewards, choosing, best[at], greedy[at])

    def sweep(first: int, end: int) -> Floats:
        if large:
            for start in range(first, end, _AT_ONCE):
                choose_of_few(start, min(end, start + _AT_ONCE))
        elif end > first:
            choose(first, end)
        return _change(best[first:end], v[first:end], states)

    changes = in_blocks(sweep, mdp.n_states, mdp.transitions.nnz)
    if means is not None:
        seen.keep(v, means)
    return best, greedy, *_over_all(changes, best, v, states)


def _change(new: Any, v: Any, states: Actions | None) -> Floats:
    """Return the least and the greatest change (2, ...) of a block of states.

    They are computed in parts, so that the changes of all states are never in memory at the same
    time. With ``states`` given, the changes of a block do not count, and the result is arbitrary.
    """
    if states is not None:
        return np.empty((2, *v.shape[1:]))
    ends = []
    for start in range(0, len(v), _AT_ONCE):
        moved = new[start : start + _AT_ONCE] - v[start : start + _AT_ONCE]
        ends.append((moved.min(axis=0), moved.max(axis=0)))
    low, high = zip(*ends, strict=True)
    return np.array([np.min(low, axis=0), np.max(high, axis=0)])


def _over_all(
    changes: list[Floats], new: Any, v: Any, states: Actions | None
) -> tuple[Floats, Floats]:
    """Return the least and the greatest change from v to new over all blocks.

    If ``states`` (n,) are given, it is of these alone.
    """
    if states is not None:
        moved = new[states] - v[states]
        return moved.min(axis=0), moved.max(axis=0)
    both = np.array(changes)
    return both[:, 0].min(axis=0), both[:, 1].max(axis=0)


def run_compiled(mdp: OrdinalMDP) -> None:
    """Run the compiled sweeps of large models once, so that their machine code is kept."""
    n, policy = mdp.n_states, np.argmax(mdp.admissible, axis=1)
    chain, v, tails = _Chain(mdp, policy), np.zeros((n, 2)), np.full((n, mdp.k - 1), 0.5)
    for kind in (np.float64, np.float32):
        each = v.astype(kind)
        _swept(mdp, chain.in_place(), each, each, each)
    _changed(mdp, policy, chain, np.zeros_like(tails), tails, 1e-3, None, None)
    gain, final = np.zeros(mdp.levels.shape), np.zeros(n)
    rewards = Rewards(gain, final, mdp.terminal, mdp.admissible, mdp.discount)
    choosing = GreedyRule(Seen().forget(gain.shape), True, np.inf, policy, 0.0)
    taken = np.empty(n, dtype=np.int64)
    improve(0, arrays_of(mdp), final, rewards, choosing, np.empty(n), taken)


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
