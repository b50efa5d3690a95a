"""Rounds of policy iteration that look at a sample of states while it refutes the tolerance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit._support.hashing import Seed, key_of
from elicit.decision.votes import LEVEL_ROUNDING
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import best_guess
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn.certificates.advantages import Advantages, advantages_over
from qlearn.certificates.box_bounds import bounds_of_many
from qlearn.certificates.drawn_losses import most_of
from qlearn.certificates.loss_bound import Guarantee, collected, drawn_set, draws_of, guarantee
from qlearn.certificates.screening import screened
from qlearn.learners.rounds.tuning import TUNING
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import rewarded
from qlearn.mdp.warm_planning import LARGE, Seen, nearly_optimal, nearly_valued


class SampledRounds:
    """Rounds for a large MDP, with approximate solutions, each improved from the last one."""

    def __init__(self, mdp: OrdinalMDP, enough: float, seed: Seed) -> None:
        self._mdp = mdp
        self._enough = enough
        self._key = key_of(seed)
        self._policy: NDArray[np.int64] | None = None
        self._v: Floats | None = None  # (S, k) the policy's value, approximately
        self._is_rough = False  # True if both are good enough to choose questions only
        self._total = np.zeros(
            mdp.n_states
        )  # greatest total that can be collected, by the last bounds
        self._of_pool: Floats | None = None  # the same of the pool alone, in a large model
        small = mdp.n_states <= TUNING.slow
        self._most = TUNING.questions_a_solution if small else TUNING.questions_a_slow_solution
        self._rough = TUNING.rough if small else TUNING.rough_if_slow
        self._error = TUNING.error * enough
        self.rounds = 0  # policies solved for so far
        self._asked = 0  # rounds with the current policy
        self._seen = Seen()
        self._pool: Advantages | None = None
        self._all: Advantages | None = None
        self.left_out = 0  # alternatives that ``everything`` leaves out, shown to be worse

    def round(self, comparator: Comparator) -> tuple[Advantages, Guarantee]:
        """Solve approximately, and return the advantages of some states and the loss bound.

        The bound is inf if it exceeds ``enough``, the loss at which the learner stops, or was not
        computed.
        """
        self._asked += 1
        if self._pool is not None and self._asked < self._most:
            if self._in_vain(self._pool, comparator):
                return self._pool, Guarantee(np.inf, np.nan)
            if self._of_pool is not None:
                return self.look_further(comparator)  # a sample would show less
        if self._all is not None and self._mdp.transitions.nnz >= LARGE:
            return self.look_further(comparator)  # a sample showed nothing the last time
        self.rounds, self._asked = self.rounds + 1, 0
        sample = self._sample()
        self._solve(best_guess(comparator), sample)
        self._pool, self._of_pool = advantages_over(self._mdp, self._kept(), self._v, sample), None
        if not self._too_much(self._pool, comparator):
            return self.look_further(comparator)
        return self._pool, Guarantee(np.inf, np.nan)

    def _in_vain(self, pool: Advantages, comparator: Comparator) -> bool:
        """Return whether some advantages, ``pool``, already show a loss bound above ``enough``.

        Then the bound over all states need not be computed.
        """
        if self._too_much(pool, comparator):
            return True
        if self._all is None or drawn_set(comparator) is not None:
            return False  # a sample, or drawn scales, cannot show more
        high, _ = bounds_of_many(comparator, pool.d)
        if high.max(initial=0.0) > self._enough:
            return True  # what one action gains, a policy can collect
        start = self._total if self._of_pool is None else self._of_pool
        total = collected(self._mdp, pool, high, start, self._error)
        self._of_pool = total if self._mdp.transitions.nnz >= LARGE else None
        return bool(total.max(initial=0.0) > self._enough)

    def everything(self) -> Advantages:
        """Return all advantages over the current policy, but those that were screened out."""
        if self._all is None:
            self._all, self.left_out = advantages_over(self._mdp, self._kept(), self._v), 0
        return self._all

    def some_of(self, advantages: Advantages) -> Advantages:
        """Return the advantages from which audits are drawn: those of a sample of the states."""
        return advantages_over(self._mdp, self._kept(), self._v, self._sample())

    def _kept(self) -> NDArray[np.int64]:
        """Return a copy of the current policy."""
        assert self._policy is not None, "no round yet"
        return self._policy

    def _solve(self, values: Floats, sample: NDArray[np.int64] | None = None) -> None:
        """Find a policy for the central scale, and its value.

        An action of the last policy stays if it is as good as the new one. If all stay, V stays
        too: otherwise pairs that differ only by rounding would be asked about again. With a sample
        of states (n,), policy and value are only good enough to choose questions about these
        states.
        """
        mdp, last, little = self._mdp, self._policy, self._error
        if sample is not None:
            little *= self._rough
        gain, ends = rewarded(mdp, values)
        start = np.full(mdp.n_states, 0.5) if self._v is None else product(self._v, values)
        _, policy, _ = nearly_optimal(mdp, gain, ends, start, little, last, sample, self._seen)
        del gain, start  # V needs the memory
        changed = last is None or (policy != last)[~mdp.terminal].any()
        if changed or (self._is_rough and sample is None):
            within = little * (1 - mdp.discount)
            self._all = None  # a third of the memory that a new V takes
            before = None if sample is None else last
            self._v = nearly_valued(mdp, policy, self._v, within, states=sample, before=before)
            self._policy, self._is_rough = policy, sample is not None

    def _sample(self) -> NDArray[np.int64]:
        n = self._mdp.n_states
        rng = np.random.default_rng((self._key, self.rounds))
        return np.sort(rng.choice(n, min(n, TUNING.sample), replace=False))

    def _too_much(self, advantages: Advantages, comparator: Comparator) -> bool:
        """Return whether too many draws show a loss above ``enough``.

        A draw shows it if under its scale some alternative action, taken once, gains more than
        that. With too many such draws no bound can be small enough, and these actions are the ones
        to ask about.
        """
        draws, trusted = draws_of(comparator), drawn_set(comparator)
        scores = product(tail_sums(advantages.d), draws.gaps)
        too_much = scores > self._enough
        too_much[scores.min(axis=1) >= 0] = (
            False  # all draws agree on these, so that the next policy takes them
        )
        beyond = product(too_much.any(axis=0), draws.weights)
        return bool(beyond > (0.0 if trusted is None else 1.0 - trusted[1] + LEVEL_ROUNDING))

    def look_further(self, comparator: Comparator) -> tuple[Advantages, Guarantee]:
        """Bound all advantages over a policy for the central scale, and return as ``round`` does.

        Those with the greatest bounds are kept for questions.
        """
        mdp, trusted = self._mdp, drawn_set(comparator)
        if self._asked:
            self.rounds, self._asked = self.rounds + 1, 0
        self._solve(best_guess(comparator))
        rest = self._screen(comparator) if trusted is None else None
        advantages = self.everything()
        if trusted is None:
            high, confidence = bounds_of_many(comparator, advantages.d)
            found = Guarantee(np.inf, np.nan)
            if high.max(initial=0.0) <= self._enough:  # else a policy can collect that much
                self._total = collected(mdp, advantages, high, self._total, self._error, rest)
                found = Guarantee(float(self._total.max(initial=0.0)), confidence)
        else:
            found = guarantee(mdp, advantages, comparator, self._enough)
            high = most_of(advantages.d, trusted[0].gaps, axis=1)
        self._pool, self._of_pool = advantages.only(_greatest(high, TUNING.pool)), None
        return self._pool, found

    def _screen(self, comparator: Comparator) -> NDArray[np.float32] | None:
        """Leave out of ``everything`` what is worse under all plausible scales, in a large model.

        Return upper bounds (S, A) on the advantages left out, or None.
        """
        if self._mdp.transitions.nnz < LARGE or self._v is None:
            return None
        self._all = None  # what was left out before may have been so under other scales
        found = screened(self._mdp, self._kept(), self._v, comparator, self._enough)
        if found is None:
            return None
        self._all, self.left_out = found.advantages, found.left_out
        return found.rest


def _greatest(x: Floats, most: int) -> NDArray[np.int64]:
    """Return the places of the greatest numbers of x (n,), in ascending order.

    Of equal ones the first are taken. To sort millions of numbers would take seconds.
    """
    if len(x) <= most:
        return np.arange(len(x))
    least = np.partition(x, len(x) - most)[len(x) - most]
    above = np.flatnonzero(x > least)
    equal = np.flatnonzero(x == least)[: most - len(above)]
    return np.sort(np.concatenate([above, equal]))
