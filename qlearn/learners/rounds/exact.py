"""Rounds of policy iteration that look at every state of the MDP."""

from __future__ import annotations

import numpy as np

from elicit._support.fixed_order import product
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import best_guess
from elicit.model.scale import Floats
from qlearn.certificates.advantages import Advantages, advantages_over
from qlearn.certificates.loss_bound import Guarantee, guarantee
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import optimal_policy

_TIE = 1e-13  # gains up to this are rounding


class ExactRounds:
    """Rounds for an MDP of up to some thousands of states.

    A round solves for a policy that is optimal for the central scale, computes all advantages over
    it, and bounds its loss.
    """

    def __init__(self, mdp: OrdinalMDP, enough: float) -> None:
        self._mdp = mdp
        self._enough = enough
        self._advantages: Advantages | None = None
        self.rounds = 0  # policies solved for so far
        self.left_out = 0  # alternatives that ``everything`` leaves out

    def round(self, comparator: Comparator) -> tuple[Advantages, Guarantee]:
        """Return the advantages that questions may be about, and the policy's loss bound.

        The bound is inf if it exceeds ``enough``, the loss at which the learner stops.
        """
        values, advantages = best_guess(comparator), self._advantages
        if advantages is None or self._changes(advantages, values):
            start = (
                np.argmax(self._mdp.admissible, axis=1) if advantages is None else advantages.policy
            )
            advantages = advantages_over(self._mdp, optimal_policy(self._mdp, values, start))
        self._advantages, self.rounds = advantages, self.rounds + 1
        return advantages, guarantee(self._mdp, advantages, comparator, self._enough)

    @staticmethod
    def _changes(advantages: Advantages, values: Floats) -> bool:
        """Return whether ``optimal_policy`` would find another policy for this scale.

        It does if an action is better than the policy's, or as good and earlier in order.
        """
        gain = product(advantages.d, values)
        return bool(
            (
                (gain > _TIE)
                | ((gain >= -_TIE) & (advantages.actions < advantages.policy[advantages.states]))
            ).any()
        )

    def look_further(self, comparator: Comparator) -> tuple[Advantages, Guarantee]:
        """Return the last round's result: it has already looked at everything."""
        advantages = self.everything()
        return advantages, guarantee(self._mdp, advantages, comparator, self._enough)

    def everything(self) -> Advantages:
        """Return all advantages over the current policy."""
        assert self._advantages is not None, "no round yet"
        return self._advantages

    def some_of(self, advantages: Advantages) -> Advantages:
        """Return the advantages from which audits are drawn: all of them."""
        return advantages
