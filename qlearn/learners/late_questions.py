"""When Q-learning that asks late stops to ask, and what about.

Between checkpoints undecided pairs go by the comparator's central scale. Checkpoints come at doubling numbers of
steps, and at each at most ``2 (k - 1)`` questions are asked, so that questions grow with the logarithm of the steps.
There a pair is asked about only if some plausible scale puts an alternative above the greedy action by more than the
indifference, and by more than the difference is likely to move still. At the end nothing moves any more, and what could
matter to the policy by more than the indifference is asked about, within the same number.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elicit.asking.elicitation import Elicitation, Pair
from elicit.model.comparator import simultaneous_bounds
from elicit.model.scale import Floats, tail_sums
from qlearn.learners.learner import pair_of, place
from qlearn.learners.query_strategies import Candidates, Strategy, best
from qlearn.mdp.ordinal_mdp import OrdinalMDP

FIRST = 2  # checkpoint, in visits for each pair of state and action
MOVED = 0.25  # of the way that a difference has come since the last checkpoint: it may come as far again


class Checkpoints:
    """The checkpoints of one run, and the questions at each."""

    def __init__(self, mdp: OrdinalMDP, steps: int, strategy: Strategy) -> None:
        self._live = mdp.admissible & ~mdp.terminal[:, None]
        self._steps, self._strategy, self._most = steps, strategy, 2 * (mdp.k - 1)
        self.next = min(steps, int(FIRST * self._live.sum()))
        self._before: Floats | None = None  # Q (S, A, k) at the last checkpoint
        self._asked = 0  # at this one
        self.refused = False  # whether a question was worth asking, but the budget was spent

    def best_by(self, values: Floats, q: Floats, policy: NDArray[np.int64]) -> None:
        """Make ``policy`` (S,) greedy in q (S, A, k) for a scale (k,), its own actions kept where they are as good."""
        worth = np.where(self._live, tail_sums(q) @ np.diff(values), -np.inf)
        rows = np.flatnonzero(self._live.any(axis=1))
        better = worth[rows].max(axis=1) > worth[rows, policy[rows]]
        policy[rows[better]] = worth[rows[better]].argmax(axis=1)

    def question(
        self, q: Floats, policy: NDArray[np.int64], visits: NDArray[np.int64], elicitation: Elicitation
    ) -> Pair | None:
        """The next pair to ask about. None where nothing at this checkpoint is worth a question."""
        if self._asked >= self._most:
            return None
        wanted = self._live & (visits > 0)
        wanted[np.arange(len(policy)), policy] = False
        states, actions = np.nonzero(wanted)
        own = policy[states]
        d = q[states, actions] - q[states, own]
        unsettled = elicitation.indifference + self._moved(q, elicitation.comparator.values, states, actions, own)
        rows = np.flatnonzero(simultaneous_bounds(elicitation.comparator, d)[0] > unsettled)
        rows = rows[elicitation.may_ask(d[rows], lambda i: place(states[rows[i]], actions[rows[i]], own[rows[i]]))]
        self.refused |= bool(len(rows)) and elicitation.spent
        if not len(rows) or elicitation.spent:
            return None
        pool = Candidates(d[rows], states[rows], actions[rows], elicitation.indifference, elicitation.comparator)
        row = rows[best(self._strategy, pool)[0]]
        self._asked += 1
        s, a, b = int(states[row]), int(actions[row]), int(own[row])
        return pair_of(q[s, a].copy(), q[s, b].copy(), s, a, b)

    def pass_on(self, q: Floats) -> None:
        """This checkpoint is done with: to the next."""
        self._before, self._asked = q.copy(), 0
        self.next = min(self._steps, 2 * self.next)

    def _moved(
        self,
        q: Floats,
        values: Floats,
        states: NDArray[np.int64],
        actions: NDArray[np.int64],
        own: NDArray[np.int64],
    ) -> Floats:
        """(n,) how far each difference is likely to move still, under the central scale: a share of how far it has
        come since the last checkpoint; 0 at the end."""
        if self.next >= self._steps:
            return np.zeros(len(states))
        before = np.zeros_like(q) if self._before is None else self._before
        way = q - before
        return np.asarray(MOVED * np.abs(tail_sums(way[states, actions] - way[states, own]) @ np.diff(values)))
