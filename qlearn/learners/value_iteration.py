"""Interactive value iteration (Weng and Zanuttini 2013) with any comparator, as ask and tell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed
from elicit._support.validation import is_number, is_whole
from elicit.asking.elicitation import Elicitation
from elicit.model.comparator import Comparator, Tier
from elicit.model.query import Query, Verdict
from elicit.model.scale import Floats
from qlearn.learners.learner import Elicits, Result, Status, check_max_loss, check_problem, pair_of, result_of
from qlearn.learners.loss_bound import loses_at_most, loss_bound
from qlearn.learners.query_strategies import Candidates, Strategy, best, check_strategy, telling_violation
from qlearn.learners.state_sweep import StateSweep
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP


class InteractiveValueIteration(Elicits):
    """Value iteration on share vectors: each sweep backs up Q(s, a) = (1 - discount) r(s, a) + discount P V
    and compares every state's actions, starting from the last sweep's best.

    ``tolerance``: with right answers and verdicts the policy loses at most this share of the value range.
    ``indifference`` (default tolerance (1 - discount) / 2): an undecided pair whose bounds lie within it
    counts as equal; so does a pair that the tutor cannot tell, but then the tolerance is no promise, and the status is
    UNSURE in place of CONVERGED. Stops when V changes by less than tolerance (1 - discount) / (4 discount) under every
    ordered scale, or after ``max_sweeps`` (default: twice what value iteration with known values can need;
    a tutor who errs anew each time can keep V moving for ever). ``max_loss`` stops after a sweep whose policy no
    plausible scale lets lose more (``Result.loss_bound``, computed whenever policy or answers have changed). Other
    keywords as for InteractiveQLearning; ``rng`` only picks the audits. Questions come in order of states, each asked
    as soon as what is known cannot settle it; with ``batch`` > 1 up to that many at once.

    ``jobs`` threads share a sweep: the same result whatever their number. One is the default, so that
    several runs side by side do not crowd each other; there is one, too, where somebody watches or answers by
    ``consult``. Beside the MDP only V is kept, twice (S, k), and what settled each (s, a) last, k - 1 numbers of half
    size; ``Result.q`` is computed when first read. Where only the comparator itself can tell, it is asked about many
    pairs at a time; for one without a rule (``elicit.decision.comparator_rule``) that is all the time.
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
        max_loss: float | None = None,
    ) -> None:
        settings = (tolerance, max_sweeps, rng, max_queries, indifference, audit, batch, jobs, max_loss)
        self._run = _Run(mdp, comparator, *settings)
        self._elicitation = self._run.elicitation

    def _go_on(self) -> tuple[Query, ...]:
        run = self._run
        while run.answered:
            run.states.settle(*run.answered.popitem())
        while run.end is None:
            waiting = run.states.proceed(self._elicitation.batch)
            if len(waiting):
                return run.open(waiting)
            run.finish_sweep()
        return ()

    def _take(self, verdicts: Mapping[str, Verdict]) -> None:
        self._run.take(verdicts)

    def result(self) -> Result:
        """The policy and the counts so far."""
        guessed = self._run.end is Status.CONVERGED and self._elicitation.counts[Tier.GUESS]
        return self._run.result(Status.GUESSED if guessed else self._run.end)


class LateValueIteration(Elicits):
    """Value iteration on share vectors that puts its questions off (Gilbert, Spanjaard, Viappiani and Weng 2015, who
    delay and order them).

    Undecided pairs go by the comparator's central scale until V has settled; only then one of those that it met is
    asked about, the best by ``strategy`` (``qlearn.strategies``), and sweeps go on. It stops after a sweep in which
    nothing had to be guessed, so that the same guarantee holds as for InteractiveValueIteration. Other keywords as
    there; the default limit of sweeps is for each question. One that asks about everything (AlwaysAsk with a simulated
    tutor) asks at once all the same.
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
        strategy: Strategy = telling_violation,
        max_loss: float | None = None,
    ) -> None:
        settings = (tolerance, max_sweeps, rng, max_queries, indifference, audit, batch, jobs, max_loss)
        self._run = _Run(mdp, comparator, *settings)
        self._elicitation = self._run.elicitation
        self._elicitation.puts_off = True
        self._strategy, self._patient = check_strategy(strategy), max_sweeps is None
        self._guessed = 0  # comparisons that went by the best guess, when this sweep began

    def _go_on(self) -> tuple[Query, ...]:
        run = self._run
        if run.answered:
            run.answered.clear()  # the comparator knows, or the elicitation does
            run.patience_from = run.sweeps if self._patient else 0
            self._put_off(True)
        while run.end is None:
            waiting = run.states.proceed(run.mdp.n_states)
            if len(waiting):
                return run.open(waiting, self._strategy)
            self._finish_sweep()
        return ()

    def _take(self, verdicts: Mapping[str, Verdict]) -> None:
        self._run.take(verdicts)

    def result(self) -> Result:
        """The policy and the counts so far."""
        return self._run.result(self._run.end)

    def _finish_sweep(self) -> None:
        """Go on to the next; but where V has settled by guesses ask about them, in the same sweep again."""
        before, self._guessed = self._guessed, int(self._elicitation.counts[Tier.GUESS])
        self._run.finish_sweep()
        if self._run.end is Status.CONVERGED and self._guessed > before:
            if self._elicitation.spent:
                self._run.end = Status.GUESSED
            else:
                self._run.end = None
                self._put_off(False)

    def _put_off(self, questions: bool) -> None:
        """Begin the sweep anew, with questions put off or asked."""
        self._elicitation.puts_off = questions
        self._run.states.begin()


class _Run:
    """The sweeps, the elicitation, and what links them, whenever the questions are asked."""

    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        tolerance: float,
        max_sweeps: int | None,
        rng: Seed,
        max_queries: int | None,
        indifference: float | None,
        audit: float,
        batch: int,
        jobs: int,
        max_loss: float | None,
    ) -> None:
        check_problem(mdp, comparator)
        if not (is_number(tolerance) and tolerance > 0):
            raise ValueError(f"tolerance must be a positive share of the value range, not {tolerance!r}")
        if max_sweeps is not None and not is_whole(max_sweeps, 1):
            raise ValueError(f"max_sweeps must be None or a whole number of at least 1, not {max_sweeps!r}")
        if not is_whole(jobs, 1):
            raise ValueError(f"jobs, the number of threads, must be a whole number of at least 1, not {jobs!r}")
        gamma = mdp.discount
        self.mdp = mdp
        self._max_sweeps = max_sweeps or 2 * sweeps_needed(gamma, tolerance)
        self._small_change = tolerance * (1 - gamma) / (4 * gamma) if gamma > 0 else np.inf
        self._max_loss = check_max_loss(max_loss)
        self.elicitation = Elicitation(
            comparator,
            f"{mdp.fingerprint}/value-iteration/{tolerance!r}",
            indifference=tolerance * (1 - gamma) / 2 if indifference is None else indifference,
            max_queries=max_queries,
            audit=audit,
            batch=batch,
            seed=rng,
        )
        self.states = StateSweep(mdp, self.elicitation, int(jobs))
        self.sweeps = 0
        self.patience_from = 0  # the sweep from which on the limit counts
        self.end: Status | None = None
        self.answered: dict[int, Verdict] = {}  # by state, for the pair at its cursor
        self._asking: dict[str, int] = {}  # query id to state
        self._bounded: tuple[Comparator, NDArray[np.int64]] | None = None  # what the loss was last bounded for

    def open(self, heads: NDArray[np.int64], strategy: Strategy | None = None) -> tuple[Query, ...]:
        """Ask about the pairs of the first of these states; by a strategy, of the best."""
        left, right, challengers, incumbents = self.states.pairs(heads)
        d = left - right
        order = list(range(len(heads)))
        if strategy is not None:
            known = self.elicitation.comparator
            pool = Candidates(d, heads, challengers.astype(np.int64), self.elicitation.indifference, known)
            order = best(strategy, pool, len(heads))
        chosen = [order[i] for i in self.elicitation.next_batch(d[order])]
        pairs = []
        for i in chosen:
            s, a, b = int(heads[i]), int(challengers[i]), int(incumbents[i])
            pairs.append(pair_of(left[i], right[i], s, a, b, *self.states.judged[s]))
        queries = self.elicitation.open(pairs)
        self._asking = {query.id: int(heads[i]) for query, i in zip(queries, chosen, strict=True)}
        return queries

    def take(self, verdicts: Mapping[str, Verdict]) -> None:
        """The tutor has answered."""
        for name, verdict in verdicts.items():
            self.answered[self._asking.pop(name)] = verdict

    def finish_sweep(self) -> None:
        """A sweep is done: on to the next one, or to the end."""
        self.sweeps += 1
        if self._certified():
            self.end = Status.CERTIFIED
        elif self.states.change < self._small_change or self.mdp.discount == 0:
            self.end = Status.CONVERGED
        elif self.sweeps - self.patience_from >= self._max_sweeps:
            self.end = Status.SWEEP_LIMIT
        else:
            self.states.next_sweep()

    def result(self, status: Status | None) -> Result:
        """The policy and the counts so far."""
        self.states.lent = True
        if status is Status.CONVERGED and self.elicitation.unsure:
            status = Status.UNSURE
        policy = self.states.best.copy()
        return result_of(
            self.elicitation,
            policy=policy,
            shares=partial(_q, self.states.v, self.mdp),  # computed when first read
            status=status or Status.WAITING,
            tiers=self.elicitation.counts,
            rounds=self.sweeps,
            guarantee=partial(loss_bound, self.mdp, policy.copy(), self.elicitation.comparator),
        )

    def _certified(self) -> bool:
        """Whether no plausible scale lets the policy lose more than ``max_loss``."""
        if self._max_loss is None:
            return False
        comparator, policy = self.elicitation.comparator, self.states.best
        if self._bounded is not None and self._bounded[0] is comparator and (self._bounded[1] == policy).all():
            return False
        self._bounded = comparator, policy.copy()
        return loses_at_most(self.mdp, policy, comparator, self._max_loss)


def _q(v: Floats, mdp: OrdinalMDP) -> Floats:
    """Q (S, A, k) after V (S, k)."""
    return q_of(np.arange(mdp.n_states), v, model_of(mdp))


def sweeps_needed(discount: float, tolerance: float) -> int:
    """Sweeps after which scalar value iteration has stopped: its first change is at most 1 - discount, and
    each later one at most discount times the last."""
    if discount == 0:
        return 1
    return max(1, math.ceil(math.log(min(1.0, tolerance / (4 * discount))) / math.log(discount)) + 2)
