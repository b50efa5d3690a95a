"""Q-learning that delays its questions until they can matter."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit.model.comparator import Comparator
from elicit.model.difference import tail_sums
from elicit.model.needs import check_needs
from elicit.model.outcomes import Status
from elicit.model.query import Query
from elicit.model.scale import Floats
from qlearn.learners.learner import check_max_loss, pair_of, place
from qlearn.learners.q_learning import InteractiveQLearning
from qlearn.learners.query_strategies import (
    Candidates,
    Strategy,
    best,
    strategy_of,
    telling_violation,
    worth_asking,
)
from qlearn.mdp.ordinal_mdp import OrdinalMDP

FIRST = 2  # the first checkpoint, in visits for each pair of state and action
# share of a difference's way since the last checkpoint by which it may still move
MOVED = 0.25


class LateQLearning(InteractiveQLearning):
    """Q-learning that asks only at checkpoints, about differences that could matter.

    Checkpoints come at doubling numbers of steps, so that the number of questions grows with the
    logarithm of the steps. Between them undecided pairs are decided by the comparator's central
    scale. At each checkpoint at most ``2 (k - 1)`` questions are asked.

    A pair is asked if, under some plausible scale, an alternative beats the greedy action by more
    than the ``indifference``, and by more than further steps are likely to change. After the last
    step the second condition does not apply.

    Parameters
    ----------
    mdp : OrdinalMDP
    comparator : Comparator
        What is known of the scale so far.
    strategy : function of ``qlearn.strategies``, or its name
        Picks the pair that is asked about first.
    max_loss : float, optional
        Stop at a checkpoint once the greedy policy loses at most this share of the value range
        under every plausible scale.
    **settings
        The other keywords of ``InteractiveQLearning``.

    Notes
    -----
    The guesses determine which transitions are seen. So explore well, as by default, or the result
    differs from that of ``InteractiveQLearning``. If every pair is asked about (AlwaysAsk with a
    simulated tutor), questions are not delayed.
    """

    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        strategy: Strategy | str = telling_violation,
        max_loss: float | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(mdp, comparator, **settings)
        self._strategy, self._max_loss = strategy_of(strategy), check_max_loss(max_loss)
        check_needs(comparator, self._strategy)
        self._live = mdp.admissible & ~mdp.terminal[:, None]
        self._checkpoint = min(self.model.steps, int(FIRST * self._live.sum()))
        self._before = np.zeros_like(self.state.q)  # Q (S, A, k) at the last checkpoint
        self._asked = 0  # questions at this checkpoint
        self._refused = False  # True if a question was worth asking, but the budget was spent
        self._end: Status | None = None

    def _go_on(self) -> tuple[Query, ...]:
        while self._end is None:
            queries = self.run_to(self._checkpoint, puts_off=True) or self._question()
            if queries:
                return queries
            if self._certified(self._mdp, self.state.best, self._max_loss):
                self._end = Status.CERTIFIED
            elif self.done:
                tied = Status.CALLED_EQUAL if self._elicitation.gave_up else Status.DONE
                self._end = Status.GUESSED if self._refused else tied
            else:
                self._before, self._asked = self.state.q.copy(), 0
                self._checkpoint = min(self.model.steps, 2 * self._checkpoint)
        return ()

    def _status(self) -> Status:
        return self._end or Status.WAITING

    def _question(self) -> tuple[Query, ...]:
        """Return this checkpoint's next question, if any, for what is known now."""
        elicitation, state = self._elicitation, self.state
        if elicitation.signs is not None:
            return ()
        q, policy = state.q, state.best
        self._go_by(elicitation.comparator.values, q, policy)
        if self._asked >= 2 * (q.shape[2] - 1):
            return ()
        wanted = self._live & (
            state.visits > 0
        )  # a vector that was never updated says nothing about its action
        wanted[np.arange(len(policy)), policy] = False
        states, actions = np.nonzero(wanted)
        own = policy[states]
        d = q[states, actions] - q[states, own]
        unsettled = elicitation.indifference + self._moving(states, actions, own)
        rows = worth_asking(
            elicitation,
            d,
            lambda i: place(self._mdp, int(states[i]), int(actions[i]), int(own[i])),
            unsettled,
        )
        self._refused |= bool(len(rows)) and elicitation.spent
        if not len(rows) or elicitation.spent:
            return ()
        pool = Candidates(
            d[rows], states[rows], actions[rows], elicitation.indifference, elicitation.comparator
        )
        row = rows[best(self._strategy, pool)[0]]
        self._asked += 1
        s, a, b = int(states[row]), int(actions[row]), int(own[row])
        return elicitation.open([pair_of(self._mdp, q[s, a].copy(), q[s, b].copy(), s, a, b)])

    def _go_by(self, values: Floats, q: Floats, policy: NDArray[np.int64]) -> None:
        """Make ``policy`` (S,) greedy in q (S, A, k) under a scale (k,).

        An action of the policy stays if it is as good as the best.
        """
        worth = np.where(self._live, product(tail_sums(q), np.diff(values)), -np.inf)
        rows = np.flatnonzero(self._live.any(axis=1))
        better = worth[rows].max(axis=1) > worth[rows, policy[rows]]
        policy[rows[better]] = worth[rows[better]].argmax(axis=1)

    def _moving(
        self, states: NDArray[np.int64], actions: NDArray[np.int64], own: NDArray[np.int64]
    ) -> Floats:
        """Return how much (n,) each difference is likely to change in further steps.

        The estimate is ``MOVED`` times its change under the central scale since the last
        checkpoint. After the last step it is 0.
        """
        if self.done:
            return np.zeros(len(states))
        way = self.state.q - self._before
        gaps = np.diff(self._elicitation.comparator.values)
        return np.asarray(
            MOVED * np.abs(product(tail_sums(way[states, actions] - way[states, own]), gaps))
        )
