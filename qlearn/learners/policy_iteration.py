"""Certify first: solve for one central scale, then ask only about what could still change the policy."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed
from elicit._support.seeds import seed_of, takes_rng
from elicit._support.threads import one_thread
from elicit._support.validation import is_number, require
from elicit.asking.bags import Bags
from elicit.asking.elicitation import MAX_AUDITS, Elicitation, Known
from elicit.decision.verdicts import decide
from elicit.model.comparator import Comparator, Tier, Tiers, best_guess, simultaneous_bounds
from elicit.model.query import Query, Verdict
from elicit.model.scale import Floats, tail_sums
from qlearn.learners.learner import Learner, Result, Status, check_problem, pair_of, place
from qlearn.learners.loss_bound import Advantages, Guarantee, advantages, drawn_set, guarantee
from qlearn.learners.query_strategies import (
    Candidates,
    Strategy,
    best,
    draws_of,
    simple_pair,
    strategy_of,
    telling_violation,
    worth_asking,
)
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import optimal_policy

_TIE = 1e-13
_ABOUT = 12  # advantages, the best to ask about, whose signs a simple question should tell
_MATTERS = 0.5
"""Of the tolerance: what an advantage must exceed to count for a strategy. In one state, taken once, it costs as much;
with the least advantage that could ever matter, tolerance (1 - discount), a fifth more questions were asked."""


class InteractivePolicyIteration(Learner):
    """Solves the MDP for the comparator's central scale, bounds what the policy can lose under every plausible scale
    (``loss_bound``), and stops once that is within ``tolerance``, a share of the value range at every state: for
    every scale in K_t with a polytope, with the comparator's confidence otherwise. Until then it asks about an
    advantage Q(s, a) - V(s) that could still change the policy, takes in the answer, and solves again.

    ``strategy`` picks the question (a function of ``qlearn.strategies``, or its name); the default weighs what an
    answer tells by how likely it is to matter. ``bags``: ask about simple bags instead, "of 10 days ...", as far as
    they tell enough of the signs of the advantages in question (``elicit.Bags``), one at a time. ``indifference``
    (default tolerance (1 - discount)): an advantage that no plausible scale puts above it is not asked about; above the
    default, the tolerance may be out of reach. ``max_loss``: stop there even if the tolerance is smaller.
    ``max_queries``: beyond it the policy for the central scale stands, with what can be said of its loss. ``audit``:
    share of the pairs decided by answers, among those that the finished policy rests on, that is put to the tutor all
    the same; ``seed`` picks them. ``batch``: the best so many questions at once.

    Every round solves linear systems in all states: made for models of up to some thousands of states.
    """

    @takes_rng
    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        tolerance: float = 0.001,
        max_loss: float | None = None,
        strategy: Strategy | str = telling_violation,
        bags: Bags | None = None,
        seed: Seed | None = 0,
        max_queries: int | None = None,
        indifference: float | None = None,
        audit: float = 0.0,
        max_audits: int = MAX_AUDITS,
        batch: int = 1,
        known: Known = (),
    ) -> None:
        check_problem(mdp, comparator)
        self.seed = seed_of(seed)
        for name, value in (("tolerance", tolerance), ("max_loss", tolerance if max_loss is None else max_loss)):
            require(is_number(value) and value > 0, name, "a positive share of the value range", value)
        self._mdp = mdp
        self._enough = max(tolerance, max_loss or 0.0)
        require(bags is None or isinstance(bags, Bags), "bags", "None or an elicit.Bags, such as Bags(days=10)", bags)
        self._strategy, self._bags = strategy_of(strategy), bags
        self._elicitation = Elicitation(
            comparator,
            f"{mdp.fingerprint}/policy-iteration/{tolerance!r}",
            indifference=self._enough * (1 - mdp.discount) if indifference is None else indifference,
            max_queries=max_queries,
            audit=audit,
            max_audits=max_audits,
            batch=batch,
            known=known,
            seed=self.seed,
            labels=mdp.labels,
        )
        self._rounds = 0
        self._end: Status | None = None
        self._found: tuple[Comparator, Advantages, Guarantee] | None = None

    def _go_on(self) -> tuple[Query, ...]:
        if self._end is not None:
            return ()
        over, found = self._round()
        if found.loss_bound <= self._enough:
            return self._audit(over, found)
        if self._elicitation.spent:
            self._end = Status.GUESSED
            return ()
        rows = self._open_pairs(over)
        if not len(rows):
            self._end = Status.CALLED_EQUAL if self._elicitation.called_equal else Status.EXHAUSTED
            return ()
        candidates = Candidates(
            over.d[rows], over.states[rows], over.actions[rows], _MATTERS * self._enough, self._elicitation.comparator
        )
        order = rows[best(self._strategy, candidates, len(rows))]
        if self._bags is not None:
            about = over.d[order[:_ABOUT]]
            if simple := simple_pair(self._elicitation, self._bags, candidates, about, self._mdp.labels):
                return self._elicitation.open([simple])
        return self._open(over, order[self._elicitation.next_batch(over.d[order])])

    @one_thread
    def result(self) -> Result:
        """The policy for the central scale, what it can lose, and the counts so far. ``decided`` counts the present
        policy's alternatives by what settled them, and the questions."""
        over, found = self._round()
        high = simultaneous_bounds(self._elicitation.comparator, over.d)[0]
        settled = np.bincount(self._settled_by(over, high), minlength=len(Tier))
        in_full = partial(_in_full, found, self._mdp, over, self._elicitation.comparator)
        policy = over.policy.copy()
        return self._result(self._mdp, policy, over.q, self._end, self._rounds, more=settled, guarantee=in_full)

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]]) -> None:
        """Has no effect: each question is asked and logged, also by a comparator that never learns."""

    def _round(self) -> tuple[Advantages, Guarantee]:
        """The policy for the central scale, and the bound on its loss, which is only right about being enough."""
        comparator = self._elicitation.comparator
        if self._found is None or self._found[0] is not comparator:
            over = self._solved_for(best_guess(comparator))
            found = guarantee(self._mdp, over, comparator, self._enough)
            self._found = comparator, over, found
            self._rounds += 1
        return self._found[1:]

    def _solved_for(self, values: Floats) -> Advantages:
        """The advantages over an optimal policy for a scale (k,): the last one's, if that is optimal still."""
        over = self._found[1] if self._found is not None else None
        if over is None or (over.d @ values > _TIE).any():
            start = np.argmax(self._mdp.admissible, axis=1) if over is None else over.policy
            over = advantages(self._mdp, optimal_policy(self._mdp, values, start))
        return over

    def _open_pairs(self, over: Advantages) -> NDArray[np.int64]:
        """Rows of the advantages that could still change the policy and may be asked about: those that some plausible
        scale puts above the limit; of drawn scales, where no draw is left out, if there are none else."""
        comparator, places = self._elicitation.comparator, partial(self._place, over)
        limit = self._elicitation.indifference
        rows = worth_asking(self._elicitation, over.d, places, limit)
        if (
            self._elicitation.called_equal
        ):  # guarantees allow for wider ties than verdicts, which must not be asked about
            rows = rows[decide(comparator, over.d[rows]).verdicts == Verdict.UNKNOWN]
        if not len(rows) and drawn_set(comparator) is not None:
            least = limit if self._elicitation.gave_up else 0.0
            rows = np.flatnonzero((tail_sums(over.d) @ draws_of(comparator).gaps > least).any(axis=1))
            rows = rows[self._elicitation.may_ask(over.d[rows], lambda i: places(rows[i]))]
        return rows

    def _settled_by(self, over: Advantages, high: Floats) -> NDArray[np.int8]:
        """The tiers (n,) by which the policy's alternatives are no better; those still open are left out, but for a
        budget that is spent."""
        verdicts, tiers = decide(self._elicitation.comparator, over.d)
        tiers = np.where(
            verdicts != Verdict.UNKNOWN,
            tiers,
            np.where(high <= self._elicitation.indifference, Tier.INDIFFERENT, Tier.GUESS),
        )
        return np.asarray(tiers[(tiers != Tier.GUESS) | (self._end is Status.GUESSED)], dtype=np.int8)

    def _audit(self, over: Advantages, found: Guarantee) -> tuple[Query, ...]:
        """The certificate stands: audit some of what it rests on."""
        judged = self._elicitation.judge(over.d, partial(self._place, over))
        rows = np.flatnonzero((judged.verdicts == Verdict.UNKNOWN) & (judged.tiers != Tier.TUTOR))
        if len(rows):
            some = self._elicitation.next_batch(over.d[rows])[: self._elicitation.audits_left]
            return self._open(over, rows[some], judged.tiers)
        self._end = Status.BOUNDED if np.isnan(found.confidence) else Status.CONVERGED
        return ()

    def _open(self, over: Advantages, rows: NDArray[np.int64], tiers: Tiers | None = None) -> tuple[Query, ...]:
        """Ask about these rows; of an audit with the tiers (n,) that settled all rows."""
        pairs = []
        for row in rows:
            s, a = int(over.states[row]), int(over.actions[row])
            tier = int(Tier.TUTOR if tiers is None else tiers[row])
            pairs.append(pair_of(self._mdp, over.q[s, a], over.v[s], s, a, int(over.policy[s]), tier))
        return self._elicitation.open(pairs)

    def _place(self, over: Advantages, row: int) -> tuple[int, int, int]:
        state = over.states[row]
        return place(state, over.actions[row], over.policy[state])


def _in_full(found: Guarantee, mdp: OrdinalMDP, over: Advantages, comparator: Comparator) -> Guarantee:
    """A guarantee whose bound was needed only as far as "too much"."""
    return found if np.isfinite(found.loss_bound) else guarantee(mdp, over, comparator)
