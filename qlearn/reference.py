"""Algorithms 1 and 2 of the paper, line by line, for reading and for testing the real learners.

The code is slow. A comment "Alg. 1, l. 9" stands on the line that does what line 9 of Algorithm 1
says. Where the paper leaves something open, the choice is the same as in the whole package:

- Vectors are shares: counting vectors times 1 - discount. Line 4 starts from all mass on the worst
  level (``start="best"``: on the best; "zero" is the paper's). A reward is 1 - discount at the
  level obtained.
- The model M is a comparator. BETTER, WORSE and EQUAL are its confident forecasts, and UNKNOWN is
  an interval [g - c, g + c] that contains 1/2. An empty B needs no case of its own.
- If neither vector is better, the best action so far stays.
- No pair is asked twice. A pair that the tutor called equal stays equal, whatever M learns later.
  (Only AlwaysAsk, the oracle, asks again.)
- Random numbers are a hash of the key, a purpose and counters, as in ``elicit._support.hashing``.
- A terminal state's value is its level for ever, and the next episode starts from ``mdp.initial``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import fold, uniform
from elicit.comparators.baselines import AlwaysAsk
from elicit.model.comparator import Comparator
from elicit.model.difference import dominance, tail_sums
from elicit.model.pairs import same_pairs
from elicit.model.query import Answer, Answers, Query, Verdict
from elicit.model.scale import Floats
from elicit.model.tutor import Tutor
from qlearn.learners.loops.q_learning_kernel import ACTION, EXPLORE, FIRST_BEST, RESTART, TRANSITION
from qlearn.mdp.ordinal_mdp import OrdinalMDP


class Learned(NamedTuple):
    """The result of a run: values, best actions, and comparisons.

    ``values`` is Q-bar (S, A, k), or Q (S, A) if the scale is known. ``best`` is B(s), the best
    action of each state. A comparison of two different actions is (state, challenger, best so far,
    best now).
    """

    q: Floats
    best: list[int]
    comparisons: list[tuple[int, int, int, int]]


@dataclass
class Answered:
    """The set B of the paper: the answers so far, looked up by pair.

    A pair is recognised by its tail sums.
    """

    answers: list[Answer] = field(default_factory=list)
    pairs: list[tuple[Floats, Verdict]] = field(default_factory=list)

    def add(self, answer: Answer) -> None:
        """Add an answer.

        "Cannot tell" leaves the best action as it is, which is what EQUAL does.
        """
        self.answers.append(answer)
        self.pairs.append((tail_sums(answer.query.d), answer.verdict or Verdict.EQUAL))

    def about(self, d: Floats) -> Verdict | None:
        """Return the verdict on this pair, in either order; None if it was not asked."""
        t = tail_sums(d)
        for sums, verdict in reversed(self.pairs):
            if way := int(same_pairs(t, sums[None])[0]):
                return verdict if way > 0 else verdict.flipped
        return None


def get_best(
    beta: Floats,
    a: int,
    beta_prime: Floats,
    a_prime: int,
    model: Comparator,
    told: Answered,
    tutor: Tutor,
    indifference: float = 0.0,
) -> tuple[int, Comparator, Answered]:
    """Return the action with the better vector by Algorithm 2, and M and B afterwards.

    ``beta`` is the vector of action a, and ``beta_prime`` that of action a'.
    """
    verdict = forecast(beta - beta_prime, model, told, indifference)  # Alg. 2, l. 1 to 4
    if verdict is not Verdict.UNKNOWN:  # Alg. 2, l. 5
        if verdict is Verdict.BETTER:  # Alg. 2, l. 6
            return a, model, told  # Alg. 2, l. 7
        return a_prime, model, told  # Alg. 2, l. 9
    answer = tutor(Query.make("reference", len(told.answers), beta, beta_prime))  # Alg. 2, l. 11
    told.add(answer)  # Alg. 2, l. 13 and 17
    model = model.update(Answers.of([answer], model.k))  # Alg. 2, l. 14 and 18
    if answer.verdict is Verdict.BETTER:  # Alg. 2, l. 12
        return a, model, told  # Alg. 2, l. 15
    return a_prime, model, told  # Alg. 2, l. 19


def forecast(d: Floats, model: Comparator, told: Answered, indifference: float) -> Verdict:
    """Return the verdict that the paper's model M gives without the tutor, or UNKNOWN.

    It is the part of Algorithm 2 before the question.
    """
    verdict = Verdict(int(model.compare(d)[0]))
    if isinstance(model, AlwaysAsk):
        return verdict
    before = told.about(d)
    if before is Verdict.EQUAL and dominance(tail_sums(d)) == Verdict.UNKNOWN:
        return before
    if verdict is not Verdict.UNKNOWN:
        return verdict
    if before is None and indifference > 0:
        low, high = model.bounds(d)
        return (
            Verdict.EQUAL
            if low[0] >= -indifference and high[0] <= indifference
            else Verdict.UNKNOWN
        )
    return Verdict.UNKNOWN if before is None else before


def interactive_q_learning(
    mdp: OrdinalMDP,
    comparator: Comparator,
    tutor: Tutor,
    *,
    steps: int,
    epsilon: float | Floats,
    rates: Sequence[float] | Floats,
    key: int,
    start: str = "worst",
    episode_length: int | None = None,
) -> tuple[Learned, Comparator, Answered]:
    """Run Algorithm 1, interactive Q-learning; return Q-bar and B(s), then M and B.

    ``rates[n]`` is the learning rate at the n-th visit of (s, a), counted from 0. ``epsilon`` is a
    number for all steps or a number for each. ``key`` is ``hashing.key_of`` of a seed.
    """
    one, discount = np.eye(mdp.k), mdp.discount
    model, told = comparator, Answered()  # Alg. 1, l. 3
    q = np.zeros((mdp.n_states, mdp.n_actions, mdp.k))  # Alg. 1, l. 4
    q[:, :, 0] += start == "worst"
    q[:, :, -1] += start == "best"
    q[mdp.terminal] = one[mdp.final_level[mdp.terminal], None]
    best = [pick(actions(mdp, s), key, FIRST_BEST, s) for s in range(mdp.n_states)]  # Alg. 1, l. 5
    comparisons = []
    walk = Walk(mdp, key, epsilon, episode_length)
    for t in range(steps):  # Alg. 1, l. 1, 6, 16 and 17
        s = walk.state
        a = walk.choose(best[s], t)  # Alg. 1, l. 7
        following, visit = walk.simulate(a)  # Alg. 1, l. 8
        reward = (1 - discount) * one[mdp.levels[s, a]]  # Alg. 1, l. 2
        delta = reward + (discount * q[following, best[following]] - q[s, a])  # Alg. 1, l. 9
        q[s, a] += rates[visit] * delta  # Alg. 1, l. 10
        challengers = [a] if a != best[s] else actions(mdp, s)  # Alg. 1, l. 11, 13 and 14
        for other in challengers:
            incumbent = best[s]
            if other != incumbent:  # an action is as good as itself
                best[s], model, told = get_best(  # Alg. 1, l. 12 and 15
                    q[s, other], other, q[s, incumbent], incumbent, model, told, tutor
                )
                comparisons.append((s, other, incumbent, best[s]))
    return Learned(q, best, comparisons), model, told  # Alg. 1, l. 18


def interactive_value_iteration(
    mdp: OrdinalMDP,
    comparator: Comparator,
    tutor: Tutor,
    *,
    tolerance: float,
    indifference: float | None = None,
) -> tuple[Learned, Comparator, Answered]:
    """Run value iteration on vectors, with getBest for the maximum of the paper's eq. (2).

    It makes one comparison at a time (Weng and Zanuttini 2013). Returns the last sweep's Q-bar and
    best actions, then M and B.
    """
    if indifference is None:
        indifference = tolerance * (1 - mdp.discount) / 2
    model, told = comparator, Answered()
    v = np.eye(mdp.k)[np.where(mdp.terminal, mdp.final_level, 0)]
    best = [actions(mdp, s)[0] for s in range(mdp.n_states)]
    comparisons = []
    while True:
        expected = (mdp.transitions @ v).reshape(mdp.n_states, mdp.n_actions, mdp.k)
        q = (1 - mdp.discount) * mdp.vector_rewards() + mdp.discount * expected  # eq. (3)
        q[mdp.terminal] = v[mdp.terminal, None]
        for s in np.flatnonzero(~mdp.terminal).tolist():
            for a in actions(mdp, s):
                incumbent = best[s]
                if a != incumbent:
                    best[s], model, told = get_best(
                        q[s, a], a, q[s, incumbent], incumbent, model, told, tutor, indifference
                    )
                    comparisons.append((s, a, incumbent, best[s]))
        before, v = v, q[np.arange(mdp.n_states), best]
        change = tail_sums(v - before)
        span = np.ptp(
            change, axis=0
        ).max()  # the most by which changes can differ under an ordered scale
        if mdp.discount * span < tolerance * (1 - mdp.discount) / 2:
            return Learned(q, best, comparisons), model, told


class Walk:
    """The agent's present state, and the simulator of line 8 of Algorithm 1."""

    def __init__(
        self, mdp: OrdinalMDP, key: int, epsilon: float | Floats, episode_length: int | None
    ) -> None:
        self._mdp, self._key, self._episode_length = mdp, key, episode_length
        self._epsilons = np.atleast_1d(epsilon)
        self._visits = np.zeros((mdp.n_states, mdp.n_actions), dtype=int)
        self._episode = self._age = 0
        self.state = draw(mdp.initial, key, RESTART, 0)

    def choose(self, best: int, t: int) -> int:
        """Return the epsilon-greedy action in step t."""
        explore = (
            uniform(fold(self._key, EXPLORE, t)) < self._epsilons[min(t, len(self._epsilons) - 1)]
        )
        return pick(actions(self._mdp, self.state), self._key, ACTION, t) if explore else best

    def simulate(self, a: int) -> tuple[int, int]:
        """Take action a. Return the next state, and how often a was taken here before.

        The walk moves on to the next state, or starts a new episode.
        """
        s, visit = self.state, int(self._visits[self.state, a])
        self._visits[s, a] += 1
        following = int(
            self._mdp.successors[
                s, a, draw(self._mdp.probabilities[s, a], self._key, TRANSITION, s, a, visit)
            ]
        )
        self.state, self._age = following, self._age + 1
        if self._mdp.terminal[following] or self._age == self._episode_length:
            self._episode, self._age = self._episode + 1, 0
            self.state = draw(self._mdp.initial, self._key, RESTART, self._episode)
        return following, visit


def actions(mdp: OrdinalMDP, s: int) -> list[int]:
    """Return the admissible actions in state s."""
    return [a for a in range(mdp.n_actions) if mdp.admissible[s, a]]


def pick(options: list[int], key: int, *counters: int) -> int:
    """Return one of the options, drawn uniformly by the key."""
    return options[int(float(uniform(fold(key, *counters))) * len(options))]


def draw(probabilities: NDArray[np.float64], key: int, *counters: int) -> int:
    """Return an index drawn with these probabilities, by the key.

    It is the first at which the running sum exceeds a random number.
    """
    u, total = float(uniform(fold(key, *counters))), 0.0
    for i, p in enumerate(probabilities):
        total += p
        if total > u:
            return i
    return int(np.flatnonzero(probabilities)[-1])  # rounding: they sum to a little less than 1
