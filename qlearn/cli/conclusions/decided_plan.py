"""The plan that a person's answers decide: it changes only what is better for certain."""

from __future__ import annotations

from collections import OrderedDict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit.decision.verdicts import decide
from elicit.model.comparator_parts import simultaneous_bounds
from elicit.model.query import Verdict
from elicit.model.scale import Floats
from qlearn.certificates.advantages import ROUNDING
from qlearn.certificates.drawn_losses import most_of
from qlearn.certificates.loss_bound import Guarantee, drawn_set, loss_bound
from qlearn.learners.learner import Result
from qlearn.mdp.array_checks import Flags
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions, evaluate_policy, optimal_policy

_HARDLY = 0.1  # share by which a quick bound may exceed the least one
_KEPT = 4  # plans: those after each answer to a question, and one before


class DecidedPlan(NamedTuple):
    """A plan made of the learned policy and of the policy for equal steps between the levels.

    In every state where the two agree, or where the learned action is better for certain, it takes
    the learned action. In the other states it takes the action with equal steps. So it is at least
    as good as the policy for equal steps, in every state and for every scale still plausible.

    Attributes
    ----------
    equal : (S,)
        The policy for equal steps.
    policy : (S,)
        The plan.
    states : (n,)
        The states, without terminal ones, where the learned action is not that with equal steps.
    learned : (n,)
        The learned action in each of these.
    holds : (n,)
        True where the learned action is better than that with equal steps, if the plan is followed
        afterwards, for every scale still plausible or with the comparator's confidence.
    differences : (n, k)
        The vector value of the learned action less that of equal steps, before the plan.
    guarantee : Guarantee
        The bound on what the plan loses.
    """

    equal: Actions
    policy: Actions
    states: NDArray[np.int64]
    learned: Actions
    holds: Flags
    differences: Floats
    guarantee: Guarantee

    @property
    def certain(self) -> dict[int, bool]:
        """Map each of the states to what ``holds`` says of it."""
        return dict(zip(self.states.tolist(), self.holds.tolist(), strict=True))

    @property
    def leaning(self) -> dict[int, int]:
        """Map each state that is not decided to its learned action."""
        open_still = ~self.holds
        states, actions = self.states[open_still].tolist(), self.learned[open_still].tolist()
        return dict(zip(states, actions, strict=True))


class DecidedPlans:
    """Makes decided plans from the results of a learner, and keeps the last few.

    Bounding the loss of a plan of a large problem takes seconds.

    Parameters
    ----------
    mdp : OrdinalMDP
    tolerance : float
        The share of the value range below which a plan is settled.
    """

    def __init__(self, mdp: OrdinalMDP, tolerance: float) -> None:
        self.mdp, self._tolerance = mdp, tolerance
        # a comparator of the same kind depends on nothing but the answers
        self._kept: OrderedDict[tuple[bytes, ...], DecidedPlan] = OrderedDict()

    def of(self, result: Result) -> DecidedPlan:
        """Return the plan of a result.

        Parameters
        ----------
        result : Result
            All results must come from learners that differ in nothing but their answers.
        """
        said = result.answers
        key = (result.policy.tobytes(), said.d.tobytes(), said.y.tobytes())
        found = self._kept.get(key)
        if found is None:
            found = self._kept[key] = self._made(result)
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        return found

    def _made(self, result: Result) -> DecidedPlan:
        mdp, learned = self.mdp, result.policy
        equal = optimal_policy(mdp, np.linspace(0.0, 1.0, mdp.k), learned)
        states = np.flatnonzero((equal != learned) & ~mdp.terminal)
        value = evaluate_policy(mdp, learned)
        made = DecidedPlan(
            equal,
            learned,
            states,
            learned[states],
            np.ones(len(states), np.bool_),
            self._differences(value, states, learned, equal),
            Guarantee(result.loss_bound, result.confidence),
        )
        made = made._replace(holds=_is_better(result, made.differences))
        if made.holds.all():
            return made
        plan, holds, differences = learned.copy(), made.holds.copy(), made.differences
        while True:
            # what follows is another plan then, so what held before must hold with that one
            plan[states[~holds]] = equal[states[~holds]]
            after = evaluate_policy(mdp, plan)
            differences = self._differences(after, states, learned, equal)
            if (still := holds & _is_better(result, differences)).sum() == holds.sum():
                break
            holds = still
        bound = self._bound(result, plan, value - after)
        return made._replace(policy=plan, holds=holds, differences=differences, guarantee=bound)

    def _bound(self, result: Result, plan: Actions, worse: Floats) -> Guarantee:
        """Return a bound on a plan's loss, whose value is less than the policy's by ``worse``.

        What the policy can lose, and the most by which the plan is worse, are a bound as well. They
        take milliseconds, and are mostly hardly more than the bound of its own, which takes
        seconds.
        """
        drawn = drawn_set(result.comparator)
        if drawn is not None:
            more = float(most_of(worse, drawn[0].gaps, axis=1).max(initial=0.0))
        else:
            more = float(simultaneous_bounds(result.comparator, worse)[0].max(initial=0.0))
        quick = result.loss_bound + max(0.0, more) + ROUNDING
        if quick <= max(self._tolerance, (1.0 + _HARDLY) * result.loss_bound):
            return Guarantee(quick, result.confidence)
        return loss_bound(self.mdp, plan, result.comparator)

    def _differences(
        self,
        value: Floats,
        states: NDArray[np.int64],
        learned: Actions,
        equal: Actions,
    ) -> Floats:
        """Return the vector value (n, k) of the learned action less that of equal steps.

        Afterwards a plan of this ``value`` (S, k) is followed.
        """
        q, rows = q_of(states, value, model_of(self.mdp)), np.arange(len(states))
        differences: Floats = q[rows, learned[states]] - q[rows, equal[states]]
        return differences


def _is_better(result: Result, differences: Floats) -> Flags:
    """Return whether each difference (n, k) is certainly above 0."""
    if not len(differences):
        return np.zeros(0, np.bool_)
    better: Flags = decide(result.comparator, differences).verdicts == Verdict.BETTER
    return better
