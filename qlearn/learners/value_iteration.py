"""Interactive value iteration (Weng and Zanuttini 2013) with any comparator, as ask and tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from elicit._support.seeds import seed_of, takes_rng
from elicit._support.validation import is_whole, require
from elicit.asking.elicitation import Elicitation
from elicit.asking.options import AskingOptions, check_options, filled
from elicit.asking.question import AnsweredQuery
from elicit.decision.comparator_rule import PROVEN, rule_of
from elicit.model.comparator import Comparator, Tier
from elicit.model.needs import check_needs
from elicit.model.outcomes import Status
from elicit.model.query import Query, Verdict
from elicit.model.scale import Floats
from qlearn.certificates.loss_bound import loss_bound
from qlearn.learners.learner import (
    Learner,
    Result,
    check_max_loss,
    check_problem,
    check_tolerance,
    pair_of,
    state_of,
)
from qlearn.learners.query_strategies import (
    Candidates,
    Strategy,
    best,
    strategy_of,
    telling_violation,
)
from qlearn.learners.state_sweep import StateSweep
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.warm_planning import nearly_valued

_EVALUATED = (
    0.1  # precision of the value of the present actions, as a share of the span that sweeps stop at
)


class InteractiveValueIteration(Learner):
    """Value iteration on share vectors, which asks the tutor about what it cannot decide.

    Each sweep backs up Q(s, a) = (1 - discount) r(s, a) + discount P V and compares every state's
    actions, starting from the last sweep's best. States are taken in order, and a pair is asked
    about as soon as it cannot be decided. With ``batch`` > 1 up to that many are asked at once.

    Parameters
    ----------
    mdp : OrdinalMDP
    comparator : Comparator
        What is known of the scale so far. Its number of levels must be the MDP's.
    tolerance : float
        Largest loss of the policy, a share of the value range below 1, if answers and verdicts are
        right.
    max_sweeps : int, optional
        Stop after this many sweeps. Default: twice what value iteration with known values can need.
        A tutor who errs anew each time can keep V moving for ever.
    partial_sweeps : bool
        From the second sweep on, and in the first half of ``max_sweeps``, let V go on between two
        sweeps to the value of the present actions, without comparing any. This is modified policy
        iteration (Puterman and Shin 1978): the same guarantee after fewer sweeps and mostly fewer
        questions. False: each sweep starts from the last one's V, as in the paper.
    jobs : int
        Threads that share a sweep. The result does not depend on their number. The default is 1, so
        that several runs side by side do not crowd each other. 1 is also used while somebody
        watches or answers by ``consult``.
    max_loss : float, optional
        Stop after a sweep whose policy loses no more than this under any plausible scale
        (``Result.loss_bound``, computed whenever policy or answers have changed).
    **asking
        The options of ``elicit.AskingOptions``. The seed only picks the audits. The default of
        ``indifference`` is tolerance (1 - discount) / 2.

    Raises
    ------
    TypeError
        If a keyword is unknown.
    ValueError
        If a setting is out of range.

    Notes
    -----
    It stops when a sweep's changes of V differ from state to state by less than tolerance (1 -
    discount) / (2 discount) under every ordered scale. A change that is the same in all states
    affects no comparison.

    A pair that the tutor cannot tell counts as equal. Then the tolerance is no guarantee, and the
    status is UNSURE in place of CONVERGED. A pair that the tutor calls equal counts as equal too,
    but may be farther apart (the comparator's ``tie``). Then the status is CALLED_EQUAL, unless the
    loss is still bounded within the tolerance. With a comparator that proves no verdict (because it
    allows for errors), or with a larger ``indifference`` than the default, the bound on the loss
    may exceed the tolerance. Then the status is DONE. It is BOUNDED in place of CONVERGED if the
    confidence of the bound is not known.

    A run needs memory for two copies of V (S, k), and for the last certificate of each (s, a): k -
    1 numbers in half precision. Partial sweeps need two more copies of V and a row of transitions
    for each state. ``Result.q`` is computed when it is first read. At the end of a run it is
    computed from the policy's value. Pairs that only the comparator itself can decide are put to it
    many at a time. For a comparator without a rule (``elicit.decision.comparator_rule``) these are
    all pairs.
    """

    @takes_rng
    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        tolerance: float = 0.001,
        max_sweeps: int | None = None,
        partial_sweeps: bool = True,
        jobs: int = 1,
        max_loss: float | None = None,
        **asking: Unpack[AskingOptions],
    ) -> None:
        check_options(self, asking)
        check_problem(mdp, comparator)
        check_needs(comparator, type(self))
        self.seed = asking["seed"] = seed_of(asking.get("seed", 0))
        check_tolerance(tolerance)
        holds = max_sweeps is None or is_whole(max_sweeps, 1)
        require(holds, "max_sweeps", "None or a whole number of at least 1", max_sweeps)
        require(isinstance(partial_sweeps, bool), "partial_sweeps", "True or False", partial_sweeps)
        require(
            is_whole(jobs, 1), "jobs, the number of threads,", "a whole number of at least 1", jobs
        )
        gamma = mdp.discount
        self._mdp, self._tolerance = mdp, float(tolerance)
        self._max_sweeps = max_sweeps or 2 * sweeps_needed(gamma, tolerance)
        self._partial_sweeps = partial_sweeps
        self._small_span = tolerance * (1 - gamma) / (2 * gamma) if gamma > 0 else np.inf
        self._max_loss = check_max_loss(max_loss)
        indifference = _indifference(mdp, tolerance)
        self._elicitation = Elicitation(
            comparator,
            f"{mdp.fingerprint}/value-iteration/{tolerance!r}",
            **filled(asking, {"indifference": indifference, "labels": mdp.labels}),
        )
        self._states = StateSweep(mdp, self._elicitation, int(jobs))
        self._candidates = (
            self._elicitation.batch
        )  # pairs to gather before some of them are asked about
        self._sweeps = 0
        self._patience_from = 0  # the sweep from which on the limit counts
        self._guessed = 0  # comparisons that went by the best guess, but need not count
        self._end: Status | None = None
        self._answered: dict[int, Verdict] = {}  # by state, for the pair at its cursor

    def result(self) -> Result:
        """Return the policy and the counts so far."""
        mdp, policy, v = self._mdp, self._states.best.copy(), self._states.v.copy()
        if self._end is None:
            shares = partial(
                q_of, np.arange(mdp.n_states), v, self._states.model
            )  # computed when first read
        else:  # when sweeps end, values may still have far to go, all by the same amount
            shares = partial(_followed_from, v, policy, mdp, _EVALUATED * self._small_span)
        return self._result(mdp, policy, shares, self._end, self._sweeps, tolerance=self._tolerance)

    def _go_on(self) -> tuple[Query, ...]:
        self._act_on_answers()
        while self._end is None:
            waiting = self._states.proceed(self._candidates)
            if len(waiting):
                return self._open(waiting)
            self._finish_sweep()
        return ()

    def _take(self, told: Sequence[AnsweredQuery]) -> None:
        for (_, pair, _), verdict in told:
            self._answered[state_of(pair)] = verdict

    def _act_on_answers(self) -> None:
        while self._answered:
            self._states.enter_verdict(*self._answered.popitem())

    def _open(self, heads: NDArray[np.int64]) -> tuple[Query, ...]:
        """Ask about the pairs at the cursors of some of these states, the first in order."""
        left, right, challengers, incumbents = self._states.pairs(heads)
        d = left - right
        order = self._in_order(d, heads, challengers)
        chosen = [order[i] for i in self._elicitation.next_batch(d[order])]
        audits = [i for i in chosen if self._states.waiting_tiers[int(heads[i])] != Tier.TUTOR]
        beyond = set(audits[self._elicitation.audits_left :])
        chosen = [i for i in chosen if i not in beyond]
        pairs = []
        for i in chosen:
            s, a, b = int(heads[i]), int(challengers[i]), int(incumbents[i])
            pairs.append(
                pair_of(self._mdp, left[i], right[i], s, a, b, self._states.waiting_tiers[s])
            )
        return self._elicitation.open(pairs)

    def _in_order(
        self, d: Floats, states: NDArray[np.int64], actions: NDArray[np.int32]
    ) -> list[int]:
        """Return the rows of d (n, k) in the order in which to ask about them."""
        return list(range(len(d)))

    def _finish_sweep(self) -> None:
        """End a sweep, and begin the next one or end the run."""
        self._sweeps += 1
        if self._certified(self._mdp, self._states.best, self._max_loss):
            self._end = Status.CERTIFIED
        elif self._mdp.discount == 0 or self._states.span < self._small_span:
            self._end = self._final_status()
        elif (used := self._sweeps - self._patience_from) >= self._max_sweeps:
            self._end = Status.SWEEP_LIMIT
        else:
            self._states.next_sweep()
            # the first sweep looks one step ahead, so that the long-run value of its actions is not
            # worth questions; and in the end only plain sweeps are certain to contract
            if self._partial_sweeps and self._sweeps > 1 and used <= self._max_sweeps // 2:
                self._states.follow(_EVALUATED * self._small_span)

    def _final_status(self) -> Status | None:
        """Return the final status once V hardly changes, or None before."""
        if self._elicitation.counts[Tier.GUESS] > self._guessed:
            return Status.GUESSED
        if self._elicitation.unsure:
            return Status.UNSURE
        tied = self._elicitation.called_equal
        near = self._elicitation.indifference <= _indifference(self._mdp, self._tolerance)
        if near and not tied and rule_of(self.comparator).kind == PROVEN:
            return Status.CONVERGED  # each verdict is proven, and so is the policy
        found = loss_bound(self._mdp, self._states.best, self.comparator)
        if not found.loss_bound <= self._tolerance:
            return Status.CALLED_EQUAL if tied else Status.DONE
        if math.isnan(found.confidence):
            return Status.CALLED_EQUAL if tied else Status.BOUNDED
        return Status.CONVERGED


def _indifference(mdp: OrdinalMDP, tolerance: float) -> float:
    """Return the indifference at which the policy's loss stays within the tolerance."""
    return tolerance * (1 - mdp.discount) / 2


class LateValueIteration(InteractiveValueIteration):
    """Value iteration on share vectors that delays its questions.

    It delays and orders questions as Gilbert, Spanjaard, Viappiani and Weng (2015) do. Undecided
    pairs are decided by the comparator's central scale until V hardly changes. Only then it asks
    about one of these pairs, and sweeps go on. It stops after a sweep without such a guess, and so
    has the guarantee of InteractiveValueIteration.

    Parameters
    ----------
    mdp : OrdinalMDP
        The problem.
    comparator : Comparator
        What is known of the scale so far. Its number of levels must be the MDP's.
    strategy : function or str
        Chooses the pair to ask about: a strategy, or the name of one of ``qlearn.strategies``.
        Default: ``telling_violation``.
    **settings
        The other keywords of InteractiveValueIteration. The default limit of sweeps applies to each
        question.

    Raises
    ------
    TypeError
        If a keyword is unknown, or the comparator lacks a part that the strategy needs.
    ValueError
        If a setting is out of range, or no strategy has the name.

    Notes
    -----
    If every pair is asked about (AlwaysAsk with a simulated tutor), questions are not delayed.
    """

    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        strategy: Strategy | str = telling_violation,
        **settings: Any,
    ) -> None:
        super().__init__(mdp, comparator, **settings)
        self._strategy, self._patient = strategy_of(strategy), settings.get("max_sweeps") is None
        check_needs(comparator, self._strategy)
        self._candidates = mdp.n_states
        self._elicitation.puts_off = True

    def _act_on_answers(self) -> None:
        if self._answered:
            self._patience_from = self._sweeps if self._patient else 0
            self._put_off(True)
            self._answered.clear()  # the comparator knows, or the elicitation does

    def _in_order(
        self, d: Floats, states: NDArray[np.int64], actions: NDArray[np.int32]
    ) -> list[int]:
        limit, comparator = self._elicitation.indifference, self._elicitation.comparator
        return best(
            self._strategy,
            Candidates(d, states, actions.astype(np.int64), limit, comparator),
            len(d),
        )

    def _finish_sweep(self) -> None:
        super()._finish_sweep()
        self._guessed = int(
            self._elicitation.counts[Tier.GUESS]
        )  # only guesses in the last sweep count

    def _final_status(self) -> Status | None:
        status = super()._final_status()
        if status is not Status.GUESSED or self._elicitation.spent:
            return status
        self._put_off(False)
        return None

    def _put_off(self, questions: bool) -> None:
        """Begin the sweep again. Its questions are delayed, or asked if ``questions`` is False."""
        self._elicitation.puts_off = questions
        self._states.begin()


def _followed_from(v: Floats, policy: NDArray[np.int64], mdp: OrdinalMDP, within: float) -> Floats:
    """Return Q (S, A, k) of following a policy (S,) from the next state on.

    It is accurate to about ``within``. v (S, k) is near the policy's value.
    """
    return q_of(np.arange(mdp.n_states), nearly_valued(mdp, policy, v, within), model_of(mdp))


def sweeps_needed(discount: float, tolerance: float) -> int:
    """Return the number of sweeps after which value iteration with known values has stopped.

    Its first change is at most 1 - discount, and each later one at most discount times the last.
    """
    if discount == 0:
        return 1
    return max(
        1, math.ceil(math.log(min(1.0, tolerance / (4 * discount))) / math.log(discount)) + 2
    )
