"""How much a policy can still lose, whatever the plausible scale: an upper bound, and the confidence in it.

For any V (S, k) let A(s, a) = Q(s, a) - V(s), a difference of share vectors. Under a scale e the optimum exceeds V.e by
the greatest discounted total of A.e that a policy can collect: a scalar MDP with non-negative values.

- Where scales are *proven* plausible (a polytope), each A(s, a).e is bounded over all of them at once
  (``simultaneous_bounds``), and what can be collected of these bounds is at least the loss. It is at
  most their greatest over 1 - discount, and mostly far less: few pairs are open, and no run is always at one of them.
- Where they are *drawn* (a posterior, an ensemble of fits), the loss is bounded under each draw, tightly, and the bound
  is the quantile of these losses at the comparator's level. No bounds need be combined that hold under different
  scales, which makes it several times smaller.

V need not be the policy's value exactly. Let R(s) = A(s, policy(s)), which then is not 0, and let it lie between -below
and above under each ordered scale (its tail sums do). The policy's value is V.e plus the total of R.e along its own
runs, which is at least -below / (1 - discount); the optimum is V.e plus the total of A.e along its runs, on which the
policy's own actions gain up to ``above`` where they would gain 0. So the loss is at most the total with 0 for these,
plus (above + below) / (1 - discount). Where no state is terminal, a constant can be added to V so that 0 lies in the
middle: what counts then is how far R differs from state to state. Nothing need be exact but the bounds themselves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from elicit._support.fixed_order import product
from elicit._support.threads import one_thread
from elicit.decision.votes import LEVEL_ROUNDING
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import Comparator, draws_in, simultaneous_bounds, stated_confidence, trusted_share
from elicit.model.scale import Floats, tail_sums
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions, evaluate_policy, policy_iteration
from qlearn.mdp.warm_planning import nearly_optimal

_ROUNDING = 1e-14  # more than the rounding of one advantage
BLOCK = 48  # draws looked at together
NUMBERS = 1 << 24  # in an array of scores at once
MOST_SWEEPS = 2000
STATES = 1 << 14  # whose Q is in memory at once


class Guarantee(NamedTuple):
    """``loss_bound``: the policy loses at most this share of the value range, from whatever state; ``confidence``: the
    probability of that, 1 where it is proven (if the answers were right), nan where none can be stated."""

    loss_bound: float
    confidence: float


class Advantages(NamedTuple):
    """What a policy of vector value ``v`` (S, k), or nearly, forgoes: of each admissible (state, action) that it does
    not take, in order, Q(s, a) - V(s) as a row of ``d`` (n, k). These may be of some states only."""

    policy: Actions  # (S,)
    v: Floats
    states: NDArray[np.int64]  # (n,)
    actions: NDArray[np.int64]  # (n,)
    d: Floats
    doubt: float  # under each ordered scale the policy's own advantages are at most so far apart, or from 0

    def only(self, rows: NDArray[np.int64]) -> Advantages:
        """These rows of them."""
        return self._replace(states=self.states[rows], actions=self.actions[rows], d=self.d[rows])


def advantages(
    mdp: OrdinalMDP, policy: ArrayLike, v: Floats | None = None, states: NDArray[np.int64] | None = None
) -> Advantages:
    """The advantages over a deterministic policy (S,), of all states, or of ``states`` (n,) in order; ``v`` (S, k): its
    vector value, or nearly (default: exactly). Raises ValueError as ``evaluate_policy`` does."""
    taken = np.asarray(policy)
    v = evaluate_policy(mdp, taken) if v is None else v
    states = np.flatnonzero(~mdp.terminal) if states is None else states[~mdp.terminal[states]]
    wanted = mdp.admissible[states]
    wanted[np.arange(len(states)), taken[states]] = False
    place, actions = np.nonzero(wanted)
    d, model = np.empty((len(place), mdp.k)), model_of(mdp)
    ends, above, below = np.searchsorted(place, np.arange(len(states) + 1)), 0.0, 0.0
    for start in range(0, len(states), STATES):
        some = states[start : start + STATES]
        rows = slice(ends[start], ends[start + len(some)])
        over = q_of(some, v, model)
        over -= v[some][:, None]
        d[rows] = over[place[rows] - start, actions[rows]]
        own = tail_sums(over[np.arange(len(some)), taken[some]])
        above, below = max(above, float(own.max())), max(below, -float(own.min()))
    return Advantages(taken, v, states[place], actions, d, above + below + _ROUNDING)


def loss_bound(mdp: OrdinalMDP, policy: ArrayLike, comparator: Comparator) -> Guarantee:
    """An upper bound on what ``policy`` (S,) loses from any state, in shares of the value range, over all scales that
    the comparator holds plausible. It reads the MDP's transition probabilities. Raises ValueError."""
    return guarantee(mdp, advantages(mdp, policy), comparator)


def loses_at_most(mdp: OrdinalMDP, policy: ArrayLike, comparator: Comparator, most: float) -> bool:
    """Whether no plausible scale lets ``policy`` (S,) lose more than this share of the value range."""
    return guarantee(mdp, advantages(mdp, policy), comparator, most).loss_bound <= most


@one_thread
def guarantee(mdp: OrdinalMDP, over: Advantages, comparator: Comparator, enough: float | None = None) -> Guarantee:
    """The same from a policy's advantages. With ``enough`` only whether the bound exceeds it need be right: a bound
    above may come out as inf."""
    drawn = drawn_set(comparator)
    if drawn is not None:
        draws, level = drawn
        confidence = stated_confidence(comparator, level)
        return Guarantee(loss_over_draws(mdp, over, draws, level, enough), confidence)
    high, confidence = simultaneous_bounds(comparator, over.d)
    return Guarantee(float(collected(mdp, over, high).max(initial=0.0)), confidence)


def drawn_set(comparator: Comparator) -> tuple[Draws, float] | None:
    """The draws that stand for what a comparator holds plausible, and the share of them that it trusts; None where it
    is not draws that its bounds rest on."""
    level = trusted_share(comparator)
    draws = None if level is None else draws_in(comparator)
    return None if level is None or draws is None else (Draws(*draws), level)


def loss_over_draws(
    mdp: OrdinalMDP, over: Advantages, draws: Draws, level: float, enough: float | None = None
) -> float:
    """The ``level`` quantile, over the draws, of an upper bound on the policy's loss: to about a
    hundredth of itself, unless ``MOST_SWEEPS`` end it before.

    Draws are taken in the order of a first bound, their greatest advantage over 1 - discount, so that most need no
    closer look. With ``enough`` it stops where the quantile is certain to exceed it, and returns inf.
    """
    doubt, t = over.doubt / (1 - mdp.discount), tail_sums(over.d)
    first = np.minimum((most_of(over.d, draws.gaps, axis=0) + _ROUNDING) / (1 - mdp.discount), 1.0)
    game, order, upper = _Game.of(mdp, over), np.argsort(-first, kind="stable"), first.copy()
    lower = np.zeros_like(first)
    spare, target = 1.0 - level + LEVEL_ROUNDING, -1.0 if enough is None else enough - doubt
    beyond = 0.0  # weight of the draws that are certain to lose more than the target
    width = max(1, min(BLOCK, NUMBERS // max(1, len(t))))
    for start in range(0, len(order), width):
        if first[order[start]] <= max(
            target, upper_quantile(upper[order[:start]], draws.weights[order[:start]], spare)
        ):
            break
        block = order[start : start + width]
        weights, gain = draws.weights[block], np.maximum(product(t, draws.gaps[:, block]), -1.0) + _ROUNDING
        room = np.inf if enough is None else spare - beyond
        small = upper_quantile(lower, draws.weights, spare)  # losses up to it do not matter to the quantile
        lower[block], upper[block] = game.losses(gain, target, weights, room, small)
        beyond += float(weights[lower[block] > target].sum())
        if enough is not None and beyond > spare:
            return np.inf
    return min(1.0, upper_quantile(upper, draws.weights, spare) + doubt)


def most_of(d: Floats, gaps: Floats, axis: int) -> Floats:
    """The greatest d.e, at least 0, of differences d (n, k) under scales of gaps (p, m), over the differences (axis 0)
    or over the scales (axis 1), without all n times m of them in memory."""
    found, step = np.zeros((gaps.shape[1], len(d))[axis]), max(1, NUMBERS // gaps.shape[1])
    for start in range(0, len(d), step):
        scores = product(tail_sums(d[start : start + step]), gaps).max(axis=axis)
        part = found if axis == 0 else found[start : start + step]
        np.maximum(part, scores, out=part)
    return found


def upper_quantile(x: Floats, weights: Floats, spare: float) -> float:
    """The least of x (m,) such that those above weigh at most ``spare``; 0 for none."""
    order = np.argsort(-x, kind="stable")
    above = np.cumsum(weights[order])
    i = int(np.searchsorted(above, spare, side="right"))
    return float(x[order[i]]) if i < len(x) else 0.0


class _Game(NamedTuple):
    """The scalar MDP of what can be collected: rows are the alternatives of live states, in order of states."""

    chain: sparse.csr_array  # (n, S) of the alternatives
    own: sparse.csr_array  # (live, S) of the policy's actions, which gain nothing
    live: NDArray[np.int64]
    starts: NDArray[np.int64]  # where the alternatives of each state with any begin
    owners: NDArray[np.int64]  # (j,) which of the live states these are
    discount: float

    @staticmethod
    def of(mdp: OrdinalMDP, over: Advantages) -> _Game:
        live, m = np.flatnonzero(~mdp.terminal), mdp.n_actions
        states, starts = np.unique(over.states, return_index=True)
        return _Game(
            chain=mdp.transitions[over.states * m + over.actions],
            own=mdp.transitions[live * m + over.policy[live]],
            live=live,
            starts=starts,
            owners=np.searchsorted(live, states),
            discount=mdp.discount,
        )

    def losses(self, gain: Floats, target: float, weights: Floats, room: float, small: float) -> tuple[Floats, Floats]:
        """Lower and upper bounds (b,) on the greatest total, from whatever state, of gains (n, b), until all are on
        one side of the target, or ``small``, or within a hundredth of each other, or more weight than there is room for
        is certain to exceed the target: sweeps from zero, with MacQueen's (1966) bounds."""
        b = gain.shape[1]
        total, ratio = np.zeros((self.own.shape[1], b)), self.discount / (1 - self.discount)
        low, high = np.zeros(b), np.full(b, np.inf)
        for _ in range(MOST_SWEEPS):
            new = self.discount * (self.own @ total)
            if len(self.starts):
                others = gain + self.discount * (self.chain @ total)
                new[self.owners] = np.maximum(new[self.owners], np.maximum.reduceat(others, self.starts, axis=0))
            change = (new - total[self.live]).max(axis=0, initial=0.0)
            total[self.live] = new
            low = total.max(axis=0)
            high = np.minimum(high, low + ratio * change + _ROUNDING)
            if target >= 0 and weights[low > target].sum() > room:
                break
            close = high - low <= 0.01 * high + 1e-9
            if ((low > target) & (target >= 0) | (high <= max(target, small)) | close).all():
                break
        return low, high


def collected(
    mdp: OrdinalMDP, over: Advantages, high: Floats, start: Floats | None = None, within: float = 0.0
) -> Floats:
    """Upper bounds (S,), at most 1, on the discounted total of advantages that any policy collects from each state,
    if each is at most ``high`` (n,). With ``start`` (S,), such totals of before, from there, and tight to about
    ``within`` alone: for large models."""
    gain = np.full(mdp.levels.shape, -np.inf)
    live = np.flatnonzero(~mdp.terminal)
    gain[live, over.policy[live]] = 0.0
    gain[over.states, over.actions] = high
    gain[live] += _ROUNDING
    total = np.zeros(mdp.n_states)
    if gain.max() > _ROUNDING:
        total = _greatest_total(mdp, gain, start, within)
    total[live] += over.doubt / (1 - mdp.discount)
    return np.clip(total, 0.0, 1.0)


def _greatest_total(mdp: OrdinalMDP, gain: Floats, start: Floats | None, within: float) -> Floats:
    """The greatest expected discounted total (S,) of gain (S, A), rounded up: policy iteration proposes, a sweep
    certifies. -inf: no such action; terminal states gain nothing."""
    live, ends = ~mdp.terminal, np.zeros(mdp.n_states)
    gain = np.where(live[:, None], gain, 0.0)
    if start is None:
        v, _ = policy_iteration(mdp, gain, ends, gain.argmax(axis=1))
        swept = (gain + mdp.discount * (mdp.transitions @ v).reshape(gain.shape)).max(axis=1)
        more = max(0.0, float((swept - v)[live].max(initial=0.0))) / (1 - mdp.discount)
    else:
        v, _, more = nearly_optimal(mdp, gain, ends, start, within)
    return np.where(live, v + (more + _ROUNDING / (1 - mdp.discount)), 0.0)
