"""The advantages of a large model that may still matter, without the vectors of all the others.

Most alternatives are clearly worse than the policy's action. Three numbers of each suffice to show
this: its advantage in the middle of a box that contains all plausible scales, and how much more it
may be along the two widest sides of the box. Along each other side, all advantages differ from
those of the levels by no more than the states' values differ.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit.model.comparator import Comparator
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn.certificates.advantages import ROUNDING, STATES_AT_ONCE, Advantages
from qlearn.certificates.box_bounds import box_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions
from qlearn.mdp.sweep_kernels import arrays_of, sweep_rows

_WIDEST = 2  # sides of the box along which each advantage is computed


class Screened(NamedTuple):
    """The advantages over a policy that may matter, and upper bounds on all others."""

    advantages: Advantages
    rest: NDArray[np.float32]  # (S, A) upper bounds; -inf for those listed, and where there is none
    left_out: int  # number of the others


class _Shadow(NamedTuple):
    """The policy's value V in the middle of a box of scales, and along its widest sides."""

    values: NDArray[np.float32]  # (S, 3) or fewer columns
    levels: NDArray[np.float32]  # (k, 3) the same of what each level earns at once
    apart: Floats  # (k, k) greatest advantage of one level over another along all other sides
    rounding: float


def screened(
    mdp: OrdinalMDP, policy: Actions, v: Floats, comparator: Comparator, least: float
) -> Screened | None:
    """Return the advantages over a policy whose upper bounds may exceed ``-least``.

    Parameters
    ----------
    mdp : OrdinalMDP
    policy : (S,) actions
    v : (S, k) shares
        The policy's value, or an approximation of it.
    comparator : Comparator
    least : float
        A share of the value range.

    Returns
    -------
    Screened or None
        None if the comparator has no proven box.
    """
    if (box := box_of(comparator)) is None:
        return None
    doubt, size = _own_advantages(mdp, policy, v)
    shadow = _shadow(mdp, v, *box[:2], size)
    found = np.arange(mdp.n_actions) != policy[:, None]
    found &= mdp.admissible & ~mdp.terminal[:, None]
    rest, wanted = np.full(found.shape, -np.inf, dtype=np.float32), np.count_nonzero(found)
    ends, successors, probabilities = arrays_of(mdp)
    for first in range(0, mdp.n_states, STATES_AT_ONCE):
        here = slice(first, min(first + STATES_AT_ONCE, mdp.n_states))
        rows = np.arange(here.start * mdp.n_actions, here.stop * mdp.n_actions)
        levels = mdp.levels[here]
        high = np.empty((len(rows), shadow.values.shape[1]), dtype=np.float32)
        gain, discount = shadow.levels[levels.reshape(-1)], np.float32(mdp.discount)
        sweep_rows(0, rows, ends, successors, probabilities, gain, discount, shadow.values, high)
        by_action = high.reshape(*levels.shape, -1)
        by_action -= shadow.values[here, None]
        own = mdp.levels[np.arange(here.start, here.stop), policy[here]]
        bound = shadow.apart[levels, own[:, None]] + shadow.rounding
        bound += by_action[..., 0]
        bound += np.abs(by_action[..., 1:]).sum(axis=2)
        out = found[here] & (bound <= -least)
        rest[here][out] = np.nextafter(bound[out].astype(np.float32), np.float32(np.inf))
        found[here] &= ~out
    states, actions = np.nonzero(found)
    rows, d = states * mdp.n_actions + actions, np.empty((len(states), mdp.k))
    for start in range(0, len(rows), STATES_AT_ONCE):
        some = slice(start, start + STATES_AT_ONCE)
        gain = _earned(mdp, mdp.levels[states[some], actions[some]])
        sweep_rows(0, rows[some], ends, successors, probabilities, gain, mdp.discount, v, d[some])
        d[some] -= v[states[some]]
    advantages = Advantages(policy, v, states, actions, d, doubt)
    return Screened(advantages, rest, int(wanted) - len(states))


def _own_advantages(mdp: OrdinalMDP, policy: Actions, v: Floats) -> tuple[float, float]:
    """Return the doubt that ``Advantages`` has, and the greatest size of the policy's own ones."""
    live, (ends, successors, probabilities) = np.flatnonzero(~mdp.terminal), arrays_of(mdp)
    above, below = 0.0, 0.0
    for start in range(0, len(live), STATES_AT_ONCE):
        some = live[start : start + STATES_AT_ONCE]
        q, rows = np.empty((len(some), mdp.k)), some * mdp.n_actions + policy[some]
        gain = _earned(mdp, mdp.levels[some, policy[some]])
        sweep_rows(0, rows, ends, successors, probabilities, gain, mdp.discount, v, q)
        q -= v[some]
        own = tail_sums(q)
        above, below = max(above, float(own.max())), max(below, -float(own.min()))
    return above + below + ROUNDING, max(above, below) + ROUNDING


def _shadow(mdp: OrdinalMDP, v: Floats, axes: Floats, reach: Floats, size: float) -> _Shadow:
    """Return V along the sides of a box (see ``box_bounds``).

    No tail sum of the policy's own advantages is greater than ``size``.
    """
    p = len(axes)
    middle, half = (reach[:p] - reach[p:]) / 2, np.maximum(reach[:p] + reach[p:], 0.0) / 2
    order = np.argsort(-half, kind="stable")
    widest, others = order[:_WIDEST], order[_WIDEST:]
    seen = np.concatenate([product(axes, middle)[:, None], axes[:, widest] * half[widest]], axis=1)
    values = np.empty((mdp.n_states, seen.shape[1]), dtype=np.float32)
    low, high = np.full(p, np.inf), np.full(p, -np.inf)
    for start in range(0, mdp.n_states, STATES_AT_ONCE):
        some = slice(start, start + STATES_AT_ONCE)
        tails = tail_sums(v[some])
        values[some] = product(tails, seen)
        along = product(tails, axes)
        low, high = np.minimum(low, along.min(axis=0)), np.maximum(high, along.max(axis=0))
    at_once = (1 - mdp.discount) * tail_sums(np.eye(mdp.k))  # (k, p)
    along = product(at_once, axes)[:, others]
    apart = np.abs(along[:, None] - along) + mdp.discount * (high - low)[others]
    apart += size * np.sqrt(p)  # V of a state is what it earns and what comes next only nearly
    longest = int(np.diff(mdp.transitions.indptr).max())
    most = float(np.abs(values).max(axis=0).sum()) + 1.0
    rounding = (longest + 16) * 2.0**-22 * most  # sums are in single precision
    return _Shadow(
        values,
        product(at_once, seen).astype(np.float32),
        np.asarray((apart * half[others]).sum(axis=2)),
        rounding,
    )


def _earned(mdp: OrdinalMDP, levels: NDArray[np.integer[Any]]) -> Floats:
    """Return what these levels (n,) earn at once, as shares (n, k)."""
    earned = np.zeros((len(levels), mdp.k))
    earned[np.arange(len(levels)), levels] = 1.0 - mdp.discount
    return earned
