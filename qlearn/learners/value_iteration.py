"""Interactive value iteration (Weng and Zanuttini 2013) with any comparator, as ask and tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed
from elicit._support.validation import is_number, is_whole
from elicit.asking.elicitation import Elicitation, OnConflict, Watch
from elicit.model.comparator import Comparator, Tier
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats
from qlearn.learners.learner import (
    Asking,
    Result,
    Status,
    check_asking,
    check_max_loss,
    check_problem,
    pair_of,
    result_of,
)
from qlearn.learners.loss_bound import advantages, guarantee, loss_bound
from qlearn.learners.query_strategies import Candidates, Strategy, best, check_strategy, telling_violation
from qlearn.learners.state_sweep import Competition
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP


class InteractiveValueIteration:
    """Value iteration on share vectors: each sweep backs up Q(s, a) = (1 - discount) r(s, a) + discount P V
    and lets every state's actions compete, starting from the last sweep's winner.

    ``tolerance``: with right answers and verdicts the policy loses at most this share of the value range.
    ``indifference`` (default tolerance (1 - discount) / 2): an undecided pair whose bounds lie within it
    counts as equal; so does a pair that the tutor cannot tell, but then the tolerance is no promise, and the status is
    UNSURE in place of CONVERGED. Stops when V changes by less than tolerance (1 - discount) / (4 discount) under every
    ordered scale, or after ``max_sweeps`` (default: twice what value iteration with known values can need;
    a tutor who errs anew each time can keep V moving for ever). Other keywords as for
    InteractiveQLearning; ``rng`` only picks the audits. Questions come in order of states, each asked as
    soon as what is known cannot settle it; with ``batch`` > 1 up to that many at once.

    ``asking="late"`` puts questions off (Gilbert, Spanjaard, Viappiani and Weng 2015, who delay and order them):
    undecided pairs go by the comparator's central scale until V has settled; only then one of those that it met is
    asked about, the best by ``strategy`` (``qlearn.strategies``), and sweeps go on. It stops after a sweep in which
    nothing had to be guessed, so that the same guarantee holds. ``max_loss`` stops after a sweep whose policy no
    plausible scale lets lose more (``Result.loss_bound``, computed whenever policy or answers have changed).

    ``jobs`` threads share a sweep: the same result whatever their number. One is the default, so that
    several runs side by side do not crowd each other. Beside the MDP only V is kept, twice (S, k), and what
    settled each (s, a) last, k - 1 numbers of half size; ``Result.q`` is computed when first read. Without
    numba, with a watcher or an oracle, and for a comparator without a rule (``elicit.decision.rule``), sweeps go by
    NumPy: the same verdicts, slower, on one thread.
    """

    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        tolerance: float = 0.001,
        max_sweeps: int | None = None,
        rng: Seed = 0,
        max_queries: int | None = None,
        indifference: float | None = None,
        audit: float = 0.0,
        batch: int = 1,
        jobs: int = 1,
        asking: Asking = "at once",
        strategy: Strategy = telling_violation,
        max_loss: float | None = None,
    ) -> None:
        check_problem(mdp, comparator)
        if not (is_number(tolerance) and tolerance > 0):
            raise ValueError(f"tolerance must be a positive share of the value range, not {tolerance!r}")
        if max_sweeps is not None and not is_whole(max_sweeps, 1):
            raise ValueError(f"max_sweeps must be None or a whole number of at least 1, not {max_sweeps!r}")
        if not is_whole(jobs, 1):
            raise ValueError(f"jobs, the number of threads, must be a whole number of at least 1, not {jobs!r}")
        gamma = mdp.discount
        self._mdp = mdp
        self._max_sweeps = max_sweeps or 2 * _sweeps_needed(gamma, tolerance)
        self._small_change = tolerance * (1 - gamma) / (4 * gamma) if gamma > 0 else np.inf
        self._elicitation = Elicitation(
            comparator,
            f"{mdp.fingerprint}/value-iteration/{tolerance!r}",
            indifference=tolerance * (1 - gamma) / 2 if indifference is None else indifference,
            max_queries=max_queries,
            audit=audit,
            batch=batch,
            seed=rng,
        )
        self._states = Competition(mdp, self._elicitation, int(jobs))
        self._elicitation.puts_off = self._late = check_asking(asking)
        self._since, self._patient = 0, max_sweeps is None  # by default the limit is for each question put off
        self._strategy, self._max_loss = check_strategy(strategy), check_max_loss(max_loss)
        self._bounded: tuple[Comparator, NDArray[np.int64]] | None = None  # what the loss was last bounded for
        self._guessed = 0  # comparisons that went by the best guess, when this sweep began
        self._sweeps = 0
        self._end: Status | None = None
        self._answered: dict[int, Verdict] = {}  # by state, for the pair at its cursor
        self._asking: dict[str, int] = {}  # query id to state

    def ask(self) -> tuple[Query, ...]:
        """The pending queries, or () when finished. Sweeps as far as it needs no tutor."""
        if self._elicitation.pending:
            return self._elicitation.ask()
        if self._late and self._answered:
            self._answered.clear()  # the comparator knows, or the elicitation does
            self._since = self._sweeps if self._patient else 0
            self._put_off(True)
        while self._answered:
            self._states.settle(*self._answered.popitem())
        while self._end is None:
            waiting = self._states.proceed(self._mdp.n_states if self._late else None)
            if len(waiting):
                return self._open(waiting)
            self._finish_sweep()
        return ()

    def tell(self, answers: Sequence[Answer], on_conflict: OnConflict = "raise") -> tuple[Answer, ...]:
        """Take answers to pending queries. Raises StaleAnswer, or InconsistentAnswers unless
        ``on_conflict="drop"`` (then such an answer settles its own pair only, and is returned)."""
        verdicts, dropped = self._elicitation.tell(answers, on_conflict)
        for name, verdict in verdicts.items():
            self._answered[self._asking.pop(name)] = verdict
        return dropped

    def result(self) -> Result:
        """The policy and the counts so far."""
        status = self._end or Status.WAITING
        self._states.lent = True
        if status is Status.CONVERGED and self._elicitation.counts[Tier.GUESS] and not self._late:
            status = Status.GUESSED
        elif status is Status.CONVERGED and self._elicitation.unsure:
            status = Status.UNSURE
        return result_of(
            self._elicitation,
            policy=self._states.best.copy(),
            q=cast(Floats, partial(_q, self._states.v, self._mdp)),  # computed when first read
            status=status,
            tiers=self._elicitation.counts.copy(),
            rounds=self._sweeps,
            guarantee=partial(loss_bound, self._mdp, self._states.best.copy(), self._elicitation.comparator),
        )

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]]) -> None:
        """Let ``signs`` answer from now on: counted, not logged."""
        self._elicitation.signs = signs

    def watch(self, watcher: Watch) -> None:
        """Call ``watcher(d, decisions)`` with every batch of comparisons acted on."""
        self._elicitation.watch = watcher

    @property
    def comparator(self) -> Comparator:
        """What is known of the scale."""
        return self._elicitation.comparator

    def _open(self, heads: NDArray[np.int64]) -> tuple[Query, ...]:
        states, rows = self._states, np.arange(len(heads))
        q, challengers, incumbents = q_of(heads, states.v, states.model), states.cursor[heads], states.best[heads]
        d = q[rows, challengers] - q[rows, incumbents]
        order = list(range(len(heads)))
        if self._late:
            pool = Candidates(
                d, heads, challengers.astype(np.int64), self._elicitation.indifference, self._elicitation.comparator
            )
            order = best(self._strategy, pool, len(heads))
        chosen = [order[i] for i in self._elicitation.next_batch(d[order])]
        pairs = []
        for i in chosen:
            s, a, b = int(heads[i]), int(challengers[i]), int(incumbents[i])
            pairs.append(pair_of(q[i, a], q[i, b], s, a, b, *states.judged[s]))
        queries = self._elicitation.open(pairs)
        self._asking = {query.id: int(heads[i]) for query, i in zip(queries, chosen, strict=True)}
        return queries

    def _finish_sweep(self) -> None:
        self._sweeps += 1
        guesses, self._guessed = (
            int(self._elicitation.counts[Tier.GUESS]) - self._guessed,
            int(self._elicitation.counts[Tier.GUESS]),
        )
        if self._certified():
            self._end = Status.CERTIFIED
        elif self._states.change < self._small_change or self._mdp.discount == 0:
            if self._late and guesses and not self._elicitation.spent:
                self._put_off(False)
            else:
                self._end = Status.GUESSED if self._late and guesses else Status.CONVERGED
        elif self._sweeps - self._since >= self._max_sweeps:
            self._end = Status.SWEEP_LIMIT
        else:
            self._states.next_sweep()

    def _put_off(self, questions: bool) -> None:
        """Begin the sweep anew, with questions put off or asked."""
        self._elicitation.puts_off = questions
        self._states.again()

    def _certified(self) -> bool:
        """Whether no plausible scale lets the policy lose more than ``max_loss``."""
        if self._max_loss is None:
            return False
        comparator, policy = self._elicitation.comparator, self._states.best
        if self._bounded is not None and self._bounded[0] is comparator and (self._bounded[1] == policy).all():
            return False
        self._bounded = comparator, policy.copy()
        return (
            guarantee(self._mdp, advantages(self._mdp, policy), comparator, self._max_loss).loss_bound <= self._max_loss
        )


def _q(v: Floats, mdp: OrdinalMDP) -> Floats:
    """Q (S, A, k) after V (S, k)."""
    return q_of(np.arange(mdp.n_states), v, model_of(mdp))


def _sweeps_needed(discount: float, tolerance: float) -> int:
    """Sweeps after which scalar value iteration has stopped: its first change is at most 1 - discount, and
    each later one at most discount times the last."""
    if discount == 0:
        return 1
    return max(1, math.ceil(math.log(min(1.0, tolerance / (4 * discount))) / math.log(discount)) + 2)
