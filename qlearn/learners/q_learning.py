"""Interactive Q-learning (Algorithm 1) with any comparator, as ask and tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed, fold, key_of, uniform
from elicit._support.validation import is_number, is_whole
from elicit.asking.elicitation import Elicitation, Judgements, OnConflict, Pair, Place, Watch
from elicit.decision.rule import outlasts_answers, rule_of
from elicit.model.comparator import AlwaysAsk, Comparator, Decisions, Tier
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats
from elicit.tutors.simulated_kernel import NOBODY, nobody
from qlearn.learners import q_learning_kernel as kernel
from qlearn.learners.exploration import Epsilon, Exploration, Start, check_start, epsilons, exploration_of
from qlearn.learners.late_questions import Checkpoints
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
from qlearn.learners.query_strategies import Strategy, check_strategy, telling_violation
from qlearn.mdp.ordinal_mdp import OrdinalMDP

KEPT_AT_ONCE = 4096  # comparisons handed to a watcher at once
LearningRate: TypeAlias = float | Callable[[NDArray[np.int64]], Floats]


def rescaled_linear_rate(discount: float) -> Callable[[NDArray[np.int64]], Floats]:
    """The default learning rate (H + 1) / (H + 1 + visits), visits counted before, for the effective horizon
    H = 1 / (1 - discount) (Jin, Allen-Zhu, Bubeck and Jordan 2018): slow enough to forget the start."""
    horizon = 1.0 / (1.0 - discount)
    return lambda visits: np.asarray((horizon + 1.0) / (horizon + 1.0 + visits), dtype=np.float64)


def polynomial_rate(visits: NDArray[np.int64]) -> Floats:
    """The learning rate 1 / (1 + visits)^0.7, visits counted before (Even-Dar and Mansour 2003)."""
    return np.asarray((1.0 + visits) ** -0.7, dtype=np.float64)


class InteractiveQLearning:
    """Algorithm 1: epsilon-greedy Q-learning on share vectors that asks where the comparator cannot tell.

    ``exploration``: how it comes to see enough, one of ``EXPLORATIONS`` by name, or an ``Exploration``; by default
    "optimistic", chosen by measurement (docs/exploration.md). By hand: ``epsilon``, ``start`` and ``episode_length``
    replace what the named one says or, where none is named, what "constant" does: the chance of a uniformly drawn
    action (a constant, a ``Decay``, or a function from steps to chances); where all vectors begin ("worst" or "best":
    all mass on that level, so that totals stay 1 and every question is well-posed; "zero": the paper's line 4); after
    how many steps to restart from the initial distribution (terminal states always do).
    ``learning_rate``: a constant in (0, 1], or a function from the number of earlier visits of (s, a) to rates; by
    default ``rescaled_linear_rate(mdp.discount)``. ``indifference``: an undecided pair whose bounds lie within
    it counts as equal. ``max_queries``: beyond it undecided pairs go by the sign at ``comparator.values``. ``audit``:
    share of the pairs decided by answers that is put to the tutor all the same. ``batch`` has no effect here: one
    run of Q-learning has one pair in question at a time.

    ``asking="late"``: undecided pairs go by the comparator's central scale, and questions wait for checkpoints at
    doubling numbers of steps; there a pair is asked about only if it can change the greedy policy by more than the
    ``indifference`` and by more than its estimates still move, the best by ``strategy`` first (``late_questions``).
    What it guesses decides what it sees: explore well, as by default, or it ends elsewhere than where it asks at once.
    ``max_loss``: stop at a checkpoint where no plausible scale lets the greedy policy lose more. Only for that, and
    for ``Result.loss_bound``, are the MDP's transition probabilities read: learning itself samples them.
    """

    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        steps: int = 100_000,
        exploration: str | Exploration | None = None,
        epsilon: Epsilon | None = None,
        learning_rate: LearningRate | None = None,
        start: Start | None = None,
        episode_length: int | None = None,
        rng: Seed = 0,
        max_queries: int | None = None,
        indifference: float = 0.0,
        audit: float = 0.0,
        batch: int = 1,
        asking: Asking = "at once",
        strategy: Strategy = telling_violation,
        max_loss: float | None = None,
    ) -> None:
        check_problem(mdp, comparator)
        if not is_whole(steps, 0):
            raise ValueError(f"steps must be a whole number of at least 0, not {steps!r}")
        if exploration is None:
            by_hand = any(setting is not None for setting in (epsilon, start, episode_length))
            exploration = "constant" if by_hand else "optimistic"
        chosen = exploration_of(exploration)
        start = chosen.start if start is None else start
        check_start(start)
        episode_length = chosen.episode_length if episode_length is None else episode_length
        if episode_length is not None and not is_whole(episode_length, 1):
            raise ValueError(f"episode_length must be None or a whole number of at least 1, not {episode_length!r}")
        key = key_of(rng)
        self._mdp = mdp
        self._elicitation = Elicitation(
            comparator,
            f"{mdp.fingerprint}/q-learning/{key}",
            indifference=indifference,
            max_queries=max_queries,
            audit=audit,
            batch=batch,
            seed=int(fold(key, kernel.AUDITS)),
        )
        self._model = _model(
            mdp,
            comparator,
            steps,
            epsilons(chosen.epsilon if epsilon is None else epsilon, steps),
            _rates(rescaled_linear_rate(mdp.discount) if learning_rate is None else learning_rate, steps),
            episode_length,
            key,
        )
        self._state = _first_state(mdp, self._model, start)
        self._max_loss, self._enough = check_max_loss(max_loss), False
        self._late, self._over = check_asking(asking), False
        self._stops = Checkpoints(mdp, int(steps), check_strategy(strategy))
        self._verdict = int(Verdict.UNKNOWN)
        self._kept = _kept(mdp.k, KEPT_AT_ONCE)
        self._oracle: Any = None

    def ask(self) -> tuple[Query, ...]:
        """The pending query, or () when all steps are done. Runs the loop as far as it needs no tutor."""
        if self._elicitation.pending:
            return self._elicitation.ask()
        if not self._late and self._max_loss is None:
            return self._run(self._model)
        while not self._enough:
            queries = self._run(self._model._replace(steps=self._stops.next), self._late)
            queries = queries or (self._ask_late() if self._late else ())
            if queries:
                return queries
            self._enough = self._certified()
            if self._stops.next >= self._model.steps:
                self._over = True
                break
            self._stops.pass_on(self._state.q)
        return ()

    def _ask_late(self) -> tuple[Query, ...]:
        """At a checkpoint: go by what is known now, and ask about what could still matter."""
        if self._elicitation.signs is not None:
            return ()
        q, policy = self._state.q, self._state.best
        self._stops.best_by(self._elicitation.comparator.values, q, policy)
        pair = self._stops.question(q, policy, self._state.visits, self._elicitation)
        return () if pair is None else self._elicitation.open([pair])

    def _certified(self) -> bool:
        """Whether no plausible scale lets the greedy policy lose more than ``max_loss``."""
        if self._max_loss is None:
            return False
        over = advantages(self._mdp, self._state.best)
        return guarantee(self._mdp, over, self._elicitation.comparator, self._max_loss).loss_bound <= self._max_loss

    def _run(self, model: kernel.Model, puts_off: bool = False) -> tuple[Query, ...]:
        """Run the loop to the model's last step, or to a pair that only the tutor can settle: then the query."""
        self._elicitation.puts_off = puts_off
        rule, asking, oracle = rule_of(self._elicitation.comparator), self._elicitation.rule(), nobody()
        if isinstance(self._elicitation.comparator, AlwaysAsk) and self._oracle is not None:
            oracle = self._oracle.respondent
        kept = self._kept if self._elicitation.watch is not None else _kept(self._mdp.k, 0)
        code = kernel.FULL
        while code != kernel.DONE:
            with np.errstate(all="ignore"):  # the hash wraps around
                code = kernel.advance(self._state, model, self._verdict, rule, asking, oracle, kept)
            self._verdict = int(Verdict.UNKNOWN)  # used up, should what follows be interrupted
            self._show(kept)
            if oracle.kind != NOBODY:
                self._elicitation.asked = int(self._elicitation.counts[Tier.TUTOR] + self._state.decided[Tier.TUTOR])
            if code == kernel.ASK and self._elicitation.signs is None:
                return self._elicitation.open([self._pair()])
            if code in (kernel.ASK, kernel.DEFER):
                pair = self._pair()
                d = (pair.left - pair.right)[None, :]
                if self._elicitation.signs is not None and not self._model.dominance:  # AlwaysAsk has no say
                    self._verdict = int(self._elicitation.ask_oracle(d)[0])
                    if self._oracle is not None:
                        oracle = self._oracle.respondent
                    continue
                verdicts, tiers, audited = self._judge(d, pair.place)
                if verdicts[0] == Verdict.UNKNOWN:
                    return self._elicitation.open([pair._replace(tier=int(tiers[0]), audited=bool(audited[0]))])
                self._verdict = int(verdicts[0])
                self._elicitation.commit(d, Decisions(verdicts, tiers))
        return ()

    def tell(self, answers: Sequence[Answer], on_conflict: OnConflict = "raise") -> tuple[Answer, ...]:
        """Take the answer to the pending query. Raises StaleAnswer, or InconsistentAnswers unless
        ``on_conflict="drop"`` (then the answer settles its own pair only, and is returned)."""
        verdicts, dropped = self._elicitation.tell(answers, on_conflict)
        if self._state.cursor[kernel.POSITION] != kernel.IDLE:  # else it was asked between two steps
            for verdict in verdicts.values():
                self._verdict = int(verdict)
        if not outlasts_answers(rule_of(self._elicitation.comparator)):
            self._state.sides[:] = 0
        return dropped

    def result(self) -> Result:
        """The greedy policy and the counts so far."""
        done = self._state.cursor[kernel.STEP] >= self._model.steps and not self._elicitation.pending
        tiers = self._elicitation.counts + self._state.decided
        finished = Status.GUESSED if (self._stops.refused if self._late else tiers[Tier.GUESS]) else Status.DONE
        if self._enough:
            done, finished = True, Status.CERTIFIED
        elif self._late:
            done = self._over
        return result_of(
            self._elicitation,
            policy=self._state.best.copy(),
            q=self._state.q.copy(),
            status=finished if done else Status.WAITING,
            tiers=tiers,
            rounds=int(self._state.cursor[kernel.STEP]),
            guarantee=partial(loss_bound, self._mdp, self._state.best.copy(), self._elicitation.comparator),
        )

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]]) -> None:
        """Let ``signs`` answer from now on: counted, not logged."""
        self._elicitation.signs = signs
        tutor = getattr(signs, "__self__", None)
        self._oracle = tutor if hasattr(tutor, "respondent") else None

    def watch(self, watcher: Watch) -> None:
        """Call ``watcher(d, decisions)`` for every comparison that neither equality nor dominance settled."""
        self._elicitation.watch = watcher

    @property
    def comparator(self) -> Comparator:
        """What is known of the scale."""
        return self._elicitation.comparator

    def _judge(self, d: Floats, where: Place | None) -> Judgements:
        return self._elicitation.judge(d, lambda row: where)

    def _show(self, kept: kernel.Kept) -> None:
        """Hand what the loop kept to the watcher."""
        n, self._state.cursor[kernel.KEPT] = int(self._state.cursor[kernel.KEPT]), 0
        if n and self._elicitation.watch is not None:
            self._elicitation.watch(kept.d[:n].copy(), Decisions(kept.verdicts[:n].copy(), kept.tiers[:n].copy()))

    def _pair(self) -> Pair:
        """The two actions at the cursor."""
        s, position = self._state.cursor[[kernel.STATE, kernel.POSITION]]
        challenger, incumbent = self._model.actions[s, position], self._state.best[s]
        q = self._state.q[s]
        return pair_of(q[challenger].copy(), q[incumbent].copy(), int(s), int(challenger), int(incumbent))


def _rates(learning_rate: LearningRate, steps: int) -> Floats:
    if not (callable(learning_rate) or is_number(learning_rate)):
        raise ValueError(
            "learning_rate must be a number in (0, 1], or a function from visits (n,) to such rates (n,), not "
            f"{learning_rate!r}"
        )
    visits = np.arange(max(1, steps))
    rates = np.asarray(learning_rate(visits) if callable(learning_rate) else np.full(len(visits), learning_rate))
    if rates.shape != visits.shape or not ((rates > 0) & (rates <= 1)).all():
        wrong = (
            f"shape {rates.shape}" if rates.shape != visits.shape else f"{rates[~((rates > 0) & (rates <= 1))][0]!r}"
        )
        raise ValueError(
            "learning_rate must be a number in (0, 1], or a function from visits (n,) to such rates (n,): "
            f"for {len(visits)} steps it gives {wrong}"
        )
    return rates.astype(np.float64)


def _model(
    mdp: OrdinalMDP,
    comparator: Comparator,
    steps: int,
    chances: Floats,
    rates: Floats,
    episode_length: int | None,
    key: int,
) -> kernel.Model:
    return kernel.Model(
        successors=mdp.successors.astype(np.int64),
        cumulative=np.cumsum(mdp.probabilities, axis=2),
        levels=mdp.levels.astype(np.int64),
        actions=np.argsort(~mdp.admissible, axis=1, kind="stable"),
        n_actions=mdp.admissible.sum(axis=1),
        terminal=mdp.terminal,
        initial=np.cumsum(mdp.initial),
        rates=rates,
        discount=mdp.discount,
        epsilons=chances,
        steps=int(steps),
        episode_length=int(episode_length or 0),
        dominance=not isinstance(comparator, AlwaysAsk),
        key=np.uint64(key),
    )


def _first_state(mdp: OrdinalMDP, model: kernel.Model, start: Start) -> kernel.State:
    n, m, k = mdp.n_states, mdp.n_actions, mdp.k
    q = np.zeros((n, m, k))
    if start != "zero":
        q[:, :, 0 if start == "worst" else k - 1] = 1.0  # Alg. 1, l. 4
    for s in np.flatnonzero(mdp.terminal):  # a terminal state's value is its level, for ever
        q[s] = np.eye(k)[model.levels[s, model.actions[s, 0]]]
    pick = (uniform(fold(model.key, kernel.FIRST_BEST, np.arange(n))) * model.n_actions).astype(np.int64)
    best = model.actions[np.arange(n), pick]  # Alg. 1, l. 5
    cursor = np.zeros(8, dtype=np.int64)
    cursor[kernel.POSITION] = kernel.IDLE
    cursor[kernel.STATE] = kernel.draw(model.initial, float(uniform(fold(model.key, kernel.RESTART, 0))))
    return kernel.State(
        q=q,
        best=best,
        visits=np.zeros((n, m), np.int64),
        cursor=cursor,
        decided=np.zeros(len(Tier), np.int64),
        floors=np.zeros((n, m, k - 1)),
        sides=np.zeros((n, m), np.int8),
    )


def _kept(k: int, room: int) -> kernel.Kept:
    return kernel.Kept(np.empty((room, k)), np.empty(room, np.int8), np.empty(room, np.int8))
