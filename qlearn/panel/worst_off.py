"""The policy whose greatest loss to any member of a panel is the least.

The best policy for the mean of several scales can leave one person badly off. The policy here is
found by a linear program over occupancies (the discounted time that a policy spends at each state
and action). Such a policy may have to draw its actions: for two people who want opposite things,
half and half can be better for the worse off than either.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from elicit._support.threads import one_thread
from elicit.comparators.panel import Panel
from elicit.model.comparator_parts import best_guess, simultaneous_bounds
from elicit.model.scale import Floats
from qlearn.certificates.loss_bound import greatest_total
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import evaluate_policy, policy_loss, rewarded, value_iteration
from qlearn.panel.following import check_panel

_LEAST = 1e-12  # occupancies below that are rounding


@dataclass(frozen=True, eq=False)
class WorstOffPolicy:
    """A policy for the worst-off member of a panel. ``print`` says each member's loss.

    Losses are shares of the value range, from the MDP's initial distribution.

    Attributes
    ----------
    probabilities : (S, A)
        The probability of each action.
    losses : mapping of str to float
        The policy's loss to each member, if their scale is their comparator's best guess.
    bounds : mapping of str to float
        Upper bounds on these losses over all scales that the member's comparator holds plausible.
    excess : float
        Upper bound on the policy's greatest loss minus the least that any policy could have, over
        all scales that the members' comparators hold plausible.
    confidence : float
        The probability that all these bounds hold: 1 if they are proven, nan if none can be stated.
    policy : (S,) actions
        The best of the deterministic policies that were tried: each member's best policy, the best
        one for the mean, and the likeliest actions of ``probabilities``. There may be better ones.
    policy_losses : mapping of str to float
        The loss of ``policy`` to each member, as ``losses``.
    """

    probabilities: Floats
    losses: Mapping[str, float]
    bounds: Mapping[str, float]
    excess: float
    confidence: float
    policy: NDArray[np.int64]
    policy_losses: Mapping[str, float]

    @property
    def greatest(self) -> float:
        """The greatest of the losses."""
        return max(self.losses.values())

    def __str__(self) -> str:
        worst = max(self.losses, key=lambda name: self.losses[name])
        single = max(self.policy_losses.values())
        each = ", ".join(
            f"{name} {100 * self.losses[name]:.2f}% (at most {100 * self.bounds[name]:.2f}%)"
            for name in self.losses
        )
        return (
            f"The worst-off member, {worst}, loses {100 * self.greatest:.2f}% of the value range, "
            "if all scales are as the best guesses say. No policy has a smaller greatest loss.\n"
            f"Over all scales that are still open it is within {100 * self.excess:.2f}% of the "
            "least.\n"
            f"Loss of each, from where episodes start: {each}.\n"
            "The policy may draw its actions. The best one found that draws none has a greatest "
            f"loss of {100 * single:.2f}%."
        )


@one_thread
def policy_for_the_worst_off(mdp: OrdinalMDP, panel: Panel) -> WorstOffPolicy:
    """Return the policy whose greatest loss to any member of a panel is least.

    Parameters
    ----------
    mdp : OrdinalMDP
    panel : Panel
        The members' best guesses at their scales are taken as the scales. Their weights do not
        matter. Ask first, for example by policy iteration with the same panel, and give the
        result's comparator.

    Returns
    -------
    WorstOffPolicy

    Raises
    ------
    TypeError
        If ``mdp`` is no OrdinalMDP, or ``panel`` no Panel.
    ValueError
        If the MDP has another number of levels.

    Notes
    -----
    The loss is from the MDP's initial distribution, not at the worst state as ``Result.loss_bound``
    is. The policy is chosen for the best guesses alone. ``bounds`` and ``excess`` say what is
    proven of it for other plausible scales. A panel with ``aim="worst"`` makes ``qlearn.solve`` ask
    until ``excess`` is within the tolerance.
    """
    return worst_off(mdp, panel).policy


class WorstOff(NamedTuple):
    """A policy for the worst-off member, and differences to ask about.

    ``telling`` names the members, the most important first. Each comes with differences (n, k)
    about which their answer may narrow the bounds: first between whole policies, then between
    actions.
    """

    policy: WorstOffPolicy
    telling: Callable[[], list[tuple[str, float, Floats]]]


@one_thread
def worst_off(mdp: OrdinalMDP, panel: Panel) -> WorstOff:
    """Return the policy for the worst-off member, and which member to ask about what."""
    check_panel(mdp, panel)
    scales = {name: best_guess(member) for name, member in panel.members.items()}
    probabilities, weights = _least_greatest_loss(mdp, np.stack([*scales.values()]))
    best_of = {name: value_iteration(mdp, scale)[1] for name, scale in scales.items()}
    proven = _bounds(mdp, probabilities, panel, weights, best_of)
    tried = [*best_of.values(), value_iteration(mdp, panel.values)[1]]
    tried.append(np.argmax(np.round(probabilities, 9), axis=1))
    each = [_losses(mdp, policy, scales) for policy in tried]
    best = min(range(len(tried)), key=lambda i: round(max(each[i].values()), 12))
    found = WorstOffPolicy(
        probabilities,
        _losses(mdp, probabilities, scales),
        proven.bounds,
        proven.excess,
        proven.confidence,
        tried[best],
        each[best],
    )
    return WorstOff(found, partial(_telling, mdp, panel, proven))


def _losses(
    mdp: OrdinalMDP, policy: NDArray[np.int64] | Floats, scales: Mapping[str, Floats]
) -> dict[str, float]:
    """Return a policy's loss to each person, by name, from the initial distribution."""
    return {
        name: float(mdp.initial @ policy_loss(mdp, policy, scale)) for name, scale in scales.items()
    }


def _least_greatest_loss(mdp: OrdinalMDP, scales: Floats) -> tuple[Floats, Floats]:
    """Return action probabilities (S, A) whose greatest loss under any scale is least, and weights.

    The scales are (n, k). The weights (n,), of total 1, are the dual solution and prove it: no
    policy has a smaller weighted mean of losses.

    The unknowns of the program are the greatest loss and the occupancy of each admissible (s, a) in
    states that are not terminal, in total at most 1.
    """
    from scipy.optimize import linprog

    live, m = ~mdp.terminal, mdp.n_actions
    columns = np.flatnonzero((mdp.admissible & live[:, None]).ravel())
    moves = mdp.transitions[columns]
    flow = sparse.csr_array(
        (np.ones(len(columns)), (columns // m, np.arange(len(columns)))),
        shape=(mdp.n_states, len(columns)),
    )
    flow = (flow - mdp.discount * moves.T.tocsr())[live]
    worth, start, optimum = [], [], []
    for scale in scales:
        gain, ends = rewarded(mdp, scale)
        worth.append((gain.ravel()[columns] + mdp.discount * (moves @ ends)) / (1 - mdp.discount))
        start.append(float(mdp.initial @ ends))
        optimum.append(float(mdp.initial @ value_iteration(mdp, scale)[0]))
    losses = np.column_stack([-np.stack(worth), -np.ones(len(scales))])
    found = linprog(
        np.concatenate([np.zeros(len(columns)), [1.0]]),
        A_ub=losses,
        b_ub=np.array(start) - np.array(optimum),
        A_eq=sparse.hstack([flow, sparse.csr_array((int(live.sum()), 1))]).tocsr(),
        b_eq=(1 - mdp.discount) * mdp.initial[live],
        method="highs",
    )
    if found.status != 0:
        raise RuntimeError(f"the linear program over occupancies was not solved: {found.message}")
    chances = np.zeros(mdp.levels.shape)
    chances.flat[columns] = np.where(found.x[:-1] > _LEAST, found.x[:-1], 0.0)
    total = chances.sum(axis=1, keepdims=True)
    unvisited = total[:, 0] == 0  # actions there do not matter from the initial distribution
    policy = value_iteration(mdp, scales.mean(axis=0))[1]
    chances[unvisited] = np.eye(m)[policy[unvisited]]
    weights = np.maximum(-np.asarray(found.ineqlin.marginals), 0.0)
    weights = (
        weights / weights.sum() if weights.sum() > 0 else np.full(len(scales), 1 / len(scales))
    )
    return np.asarray(chances / np.where(unvisited[:, None], 1.0, total)), weights


class _Proven(NamedTuple):
    """Bounds on a policy's losses, and the arrays that they were made from."""

    bounds: dict[str, float]
    excess: float
    confidence: float
    weights: Floats  # (n,) of the members in the proof
    over: Floats  # (S, k), the policy's share vectors
    d: Floats  # advantages over them, with their states and actions
    place: NDArray[np.int64]
    action: NDArray[np.int64]
    high: Floats  # (n, advantages), each member's upper bounds
    gained: Floats  # (n, k), each member's best policy minus this one, at the start


def _bounds(
    mdp: OrdinalMDP,
    chances: Floats,
    panel: Panel,
    weights: Floats,
    best_of: Mapping[str, NDArray[np.int64]],
) -> _Proven:
    """Return upper bounds on a policy's loss to each member, and on its excess.

    The loss is bounded as in ``certificates.loss_bound``: by the most that a policy can collect of
    bounds on the advantages.

    The excess is the policy's greatest loss, minus the least greatest loss of any policy. Let w be
    weights of total 1. Any policy's greatest loss is at least the w-mean of its losses. Compared
    with this policy's w-mean, that mean can be smaller only by the most that can be collected of
    the w-mean of the bounds. So the excess is at most this policy's greatest loss, minus the w-mean
    of lower bounds on its losses, plus what can be collected.
    """
    states = np.flatnonzero(~mdp.terminal)
    v = evaluate_policy(mdp, chances)
    over = q_of(np.arange(mdp.n_states), v, model_of(mdp)) - v[:, None]
    place, action = np.nonzero(mdp.admissible[states])
    d = over[states[place], action]
    own = np.einsum("sa,sak->sk", chances[states], np.nan_to_num(over[states]))
    doubt = float(np.abs(np.cumsum(own[:, ::-1], axis=1)).max(initial=0.0))
    gained = np.stack([mdp.initial @ (evaluate_policy(mdp, best) - v) for best in best_of.values()])
    highs, least, lacking = [], [], 0.0
    for member, more in zip(panel.members.values(), gained, strict=True):
        high, confidence = simultaneous_bounds(member, np.concatenate([d, -more[None]]))
        highs.append(high[:-1])
        least.append(max(0.0, -float(high[-1])))
        lacking += 1.0 - confidence
    high = np.stack(highs)

    def most(bounds: Floats) -> float:
        total = _collected(mdp, states[place], action, bounds) + 2 * doubt / (1 - mdp.discount)
        return float(np.clip(mdp.initial @ np.where(mdp.terminal, 0.0, total), 0.0, 1.0))

    bounds = {name: most(one) for name, one in zip(panel.people, high, strict=True)}
    greatest = max(bounds.values())
    at_best = max(0.0, float(weights @ np.array(least)) - most(weights @ high))
    confidence = max(0.0, 1.0 - lacking)
    excess = max(0.0, greatest - at_best)
    return _Proven(bounds, excess, confidence, weights, v, d, states[place], action, high, gained)


def _collected(
    mdp: OrdinalMDP, states: NDArray[np.int64], actions: NDArray[np.int64], high: Floats
) -> Floats:
    """Return the most (S,) that a policy can collect of bounds on advantages, from each state."""
    return greatest_total(mdp, _gain(mdp, states, actions, high))


def _gain(
    mdp: OrdinalMDP, states: NDArray[np.int64], actions: NDArray[np.int64], high: Floats
) -> Floats:
    gain = np.full(mdp.levels.shape, -np.inf)
    gain[states, actions] = high
    return gain


def _telling(mdp: OrdinalMDP, panel: Panel, proven: _Proven) -> list[tuple[str, float, Floats]]:
    """Return members, the most important first, and differences to ask them about.

    The first differences are between this policy and those that collect most of the bounds.
    """
    greatest = max(proven.bounds.values())
    wide = {name: bound >= greatest - proven.excess for name, bound in proven.bounds.items()}
    mixed = _better(mdp, proven, proven.weights @ proven.high)
    found = []
    for i, name in enumerate(panel.people):
        counts = float(proven.weights[i]) + (1.0 if wide[name] else 0.0)
        if counts > 0:
            whole = np.stack([_better(mdp, proven, proven.high[i]), proven.gained[i], mixed])
            order = np.argsort(-np.round(proven.high[i], 9), kind="stable")
            found.append((name, counts, np.concatenate([whole, proven.d[order]])))
    return sorted(found, key=lambda one: -round(one[1], 9))


def _better(mdp: OrdinalMDP, proven: _Proven, high: Floats) -> Floats:
    """Return another policy's vector (k,) minus that of the policy of ``proven``, at the start.

    The other policy is the optimal one if the rewards are ``high``, upper bounds on advantages.
    """
    gain = _gain(mdp, proven.place, proven.action, high)
    total = np.where(mdp.terminal, 0.0, greatest_total(mdp, gain))
    columns = mdp.transitions @ total
    worth = gain + mdp.discount * np.reshape(columns, gain.shape)
    policy = np.argmax(np.round(worth, 9), axis=1)
    return np.asarray(mdp.initial @ (evaluate_policy(mdp, policy) - proven.over))
