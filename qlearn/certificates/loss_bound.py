"""Upper bound on a policy's loss over all plausible scales, and the confidence in it.

For any V (S, k) let A(s, a) = Q(s, a) - V(s), a difference of share vectors. Under a scale e,
consider the MDP whose rewards are A.e. Its optimal value is by how much the best policy exceeds
V.e. It is not negative.

- If scales are *proven* plausible (a polytope), each A(s, a).e is bounded over all of them at once
  (``simultaneous_bounds``). The optimal value of the MDP with these bounds as rewards is at least
  the loss. It is mostly far less than the greatest bound over 1 - discount, because few pairs are
  open, and no run is always at one of them. If the plausible scales are a union of cells, the bound
  is the greatest of the bounds over each cell.
- If scales are *drawn* (a posterior, an ensemble of fits), the loss is bounded under each draw,
  tightly. The bound is the quantile of these losses at the comparator's level. It does not combine
  bounds that hold under different scales, and so is several times smaller.

V need not be the policy's value exactly. Let R(s) = A(s, policy(s)), which is 0 if V is exact. Let
R.e lie between -below and above under each ordered scale. (Its tail sums do.) The policy's value is
V.e plus the total of R.e along its own runs, which is at least -below / (1 - discount). The optimum
is V.e plus the total of A.e along its runs. There the policy's own actions count as 0, and in truth
gain up to ``above``. So the loss is at most the total with 0 for these actions, plus (above +
below) / (1 - discount). If no state is terminal, a constant can be added to V so that 0 lies in the
middle. Then only differences of R between states count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.threads import one_thread
from elicit.lp.hit_and_run import Draws, draws_within
from elicit.lp.region import Region
from elicit.model.comparator import Comparator, offers
from elicit.model.comparator_parts import (
    bounds_above,
    cells_of,
    draws_in,
    simultaneous_bounds,
    stated_confidence,
    trusted_share,
    unordered_of,
)
from elicit.model.needs import Needs
from elicit.model.scale import Floats
from qlearn.certificates.advantages import ROUNDING, Advantages, advantages_over
from qlearn.certificates.drawn_losses import loss_over_draws
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import backed_up, policy_iteration
from qlearn.mdp.warm_planning import nearly_optimal

_SWEEPS = 50  # largest number that may refute a bound; a full solution takes about as long
_CLEARLY = 1e-9  # more than the rounding of all these sweeps

BOUNDING = Needs(
    used=("simultaneous_bounds", "bounds_above", "cells", "draws", "level", "confidence")
)
"""The optional parts of a comparator by which a loss is bounded."""


class Guarantee(NamedTuple):
    """An upper bound on what a policy loses, and the confidence in it.

    Attributes
    ----------
    loss_bound : float
        A share of the value range. It holds from every state.
    confidence : float
        The probability that the bound holds. It is 1 if the bound is proven (given that the answers
        are right), and nan if no probability can be stated.
    """

    loss_bound: float
    confidence: float


def loss_bound(mdp: OrdinalMDP, policy: ArrayLike, comparator: Comparator) -> Guarantee:
    """Return an upper bound on what a policy loses from any state, over all plausible scales.

    It is computed from the MDP's transition probabilities.

    Parameters
    ----------
    mdp : OrdinalMDP
    policy : (S,) actions
    comparator : Comparator
        Holds the plausible scales.

    Returns
    -------
    Guarantee
        The bound, a share of the value range, and the confidence in it.

    Raises
    ------
    ValueError
        As ``evaluate_policy`` does.
    """
    return guarantee(mdp, advantages_over(mdp, policy), comparator)


def loses_at_most(mdp: OrdinalMDP, policy: ArrayLike, comparator: Comparator, most: float) -> bool:
    """Return whether ``policy`` (S,) certainly loses at most ``most`` under every plausible scale.

    ``most`` is below 1, since no policy loses more than 1. The result is False if the bound cannot
    show it.
    """
    return guarantee(mdp, advantages_over(mdp, policy), comparator, most).loss_bound <= most


@one_thread
def guarantee(
    mdp: OrdinalMDP, advantages: Advantages, comparator: Comparator, enough: float | None = None
) -> Guarantee:
    """Return the loss bound of a policy, given the advantages over it.

    If the bound exceeds ``enough``, which is below 1, the result may be inf.
    """
    if unordered_of(comparator) is not None:
        # the doubt is of one tail sum; in the other order a tail sum is made of three of them,
        # t_i - t_(i+1) + t_(i+2)
        advantages = advantages._replace(doubt=3.0 * advantages.doubt)
    drawn = drawn_set(comparator)
    if drawn is not None:
        draws, level = drawn
        confidence = stated_confidence(comparator, level)
        return Guarantee(loss_over_draws(mdp, advantages, draws, level, enough), confidence)
    cells, most, confidence = cells_of(comparator), 0.0, 1.0
    least = -np.inf if enough is None else enough * (1 - mdp.discount)
    for cell in cells:
        high, confidence = bounds_above(cell.scales, advantages.d, least)
        if enough is not None:
            if _refuted(
                mdp, advantages.only(np.flatnonzero(high > least)), high[high > least], enough
            ):
                return Guarantee(np.inf, confidence)
            if offers(cell.scales, "bounds_above"):  # loose ones would prove less
                high, confidence = simultaneous_bounds(cell.scales, advantages.d)
        most = max(most, float(collected(mdp, advantages, high).max(initial=0.0)))
        if (
            enough is not None and most > enough and len(cells) > 1
        ):  # the other cells need not be looked at
            return Guarantee(np.inf, confidence)
    return Guarantee(most, confidence)


def _refuted(mdp: OrdinalMDP, advantages: Advantages, high: Floats, enough: float) -> bool:
    """Return whether a policy's loss bound certainly exceeds ``enough``.

    The loss bound is the most that a policy can collect of the upper bounds ``high`` (n,) on
    advantages. Value iteration that starts at 0 approaches it from below, and mostly exceeds
    ``enough`` after a few sweeps.
    """
    live, total = ~mdp.terminal, np.zeros(mdp.n_states)
    gain = np.full(mdp.levels.shape, -np.inf)
    gain[live, advantages.policy[live]] = 0.0
    gain[advantages.states, advantages.actions] = high
    for _ in range(_SWEEPS):
        before, total = total, backed_up(mdp, gain, np.zeros(mdp.n_states), total).max(axis=1)
        most = float(total.max(initial=0.0))
        to_come = float((total - before).max(initial=0.0)) * mdp.discount / (1 - mdp.discount)
        if most > enough + _CLEARLY or most + to_come <= enough:
            break
    return most > enough + _CLEARLY


def completed(
    found: Guarantee, mdp: OrdinalMDP, advantages: Advantages, comparator: Comparator
) -> Guarantee:
    """Return a guarantee whose bound is computed if it was left at inf, which means "too large".

    ``advantages`` may be of some states only. The bound is computed from those of all states.
    """
    if np.isfinite(found.loss_bound):
        return found
    return guarantee(mdp, advantages_over(mdp, advantages.policy, advantages.v), comparator)


def collected(
    mdp: OrdinalMDP,
    advantages: Advantages,
    high: Floats,
    start: Floats | None = None,
    within: float = 0.0,
    rest: NDArray[np.float32] | None = None,
) -> Floats:
    """Return upper bounds on the discounted total of advantages that a policy can collect.

    There is a bound for each state that it starts from.

    Parameters
    ----------
    mdp : OrdinalMDP
    advantages : Advantages
    high : (n,)
        Upper bounds on the advantages.
    start : (S,), optional
        Totals found earlier. They are improved step by step until they are tight to about
        ``within``, which is faster for large models. Default: solve exactly.
    within : float
        A share of the value range.
    rest : (S, A), optional
        Upper bounds on further advantages; -inf where there is none.

    Returns
    -------
    (S,) shares of the value range, at most 1
    """
    gain = np.full(mdp.levels.shape, -np.inf) if rest is None else rest.astype(np.float64)
    live = np.flatnonzero(~mdp.terminal)
    gain[live, advantages.policy[live]] = 0.0
    gain[advantages.states, advantages.actions] = high
    gain[live] += ROUNDING
    total = np.zeros(mdp.n_states)
    if gain.max() > ROUNDING:
        total = greatest_total(mdp, gain, start, within)
    total[live] += advantages.doubt / (1 - mdp.discount)
    return np.clip(total, 0.0, 1.0)


def greatest_total(
    mdp: OrdinalMDP, gain: Floats, start: Floats | None = None, within: float = 0.0
) -> Floats:
    """Return the greatest expected discounted total (S,) of rewards ``gain`` (S, A), rounded up.

    Policy iteration proposes it, and a sweep of value iteration proves it. A gain of -inf marks an
    action that does not exist. Terminal states gain nothing.
    """
    live, ends = ~mdp.terminal, np.zeros(mdp.n_states)
    gain = np.where(live[:, None], gain, 0.0)
    if start is None:
        v, _ = policy_iteration(mdp, gain, ends, gain.argmax(axis=1))
        swept = (gain + mdp.discount * (mdp.transitions @ v).reshape(gain.shape)).max(axis=1)
        more = max(0.0, float((swept - v)[live].max(initial=0.0))) / (1 - mdp.discount)
    else:
        v, _, more = nearly_optimal(mdp, gain, ends, start, within)
    return np.where(live, v + (more + ROUNDING / (1 - mdp.discount)), 0.0)


def drawn_set(comparator: Comparator) -> tuple[Draws, float] | None:
    """Return a comparator's draws, and the share of their weight under which its bounds hold.

    The result is None if its bounds do not depend on draws.
    """
    level = trusted_share(comparator)
    draws = None if level is None else draws_in(comparator)
    return None if level is None or draws is None else (Draws(*draws), level)


def draws_of(comparator: Comparator) -> Draws:
    """Return a comparator's draws, or draws from all ordered scales if it has none."""
    own = draws_in(comparator)
    if own is not None:
        return Draws(*own)
    p = comparator.k - 1
    return draws_within(
        Region(0.0, np.empty((0, p)), np.empty(0), np.empty(0, np.int64)), np.full(p, 1.0 / p)
    )
