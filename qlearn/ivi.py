"""Interactive value iteration (Weng and Zanuttini 2013) with any comparator, as ask and tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from elicit.comparator import Comparator, Decisions, Tier
from elicit.query import Answer, Query, Verdict
from elicit.scale import Floats, tail_sums
from elicit.seeds import Seed
from qlearn.desk import AUDIT, Desk, Watch, place
from qlearn.learner import OnConflict, Result, Status
from qlearn.mdp import OrdinalMDP
from qlearn.q_learning import check_levels_agree


class InteractiveValueIteration:
    """Value iteration on share vectors: each sweep backs up Q(s, a) = (1 - discount) r(s, a) + discount P V
    and lets every state's actions compete, starting from the last sweep's winner.

    ``tolerance``: with right answers and verdicts the policy loses at most this share of the value range.
    ``indifference`` (default tolerance (1 - discount) / 2): an undecided pair whose bounds lie within it
    counts as equal. Stops when V changes by less than tolerance (1 - discount) / (4 discount) under every
    ordered scale, or after ``max_sweeps`` (default: twice what value iteration with known values can need;
    a tutor who errs anew each time can keep V moving for ever). Other keywords as for
    InteractiveQLearning; ``rng`` only picks the audits. Questions come in order of states, each asked as
    soon as what is known cannot settle it; with ``batch`` > 1 up to that many at once.
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
    ) -> None:
        check_levels_agree(mdp, comparator)
        if not (np.isfinite(tolerance) and tolerance > 0):
            raise ValueError(f"tolerance must be a positive share of the value range, not {tolerance!r}")
        if max_sweeps is not None and (max_sweeps < 1 or int(max_sweeps) != max_sweeps):
            raise ValueError(f"max_sweeps must be None or a whole number of at least 1, not {max_sweeps!r}")
        gamma = mdp.discount
        self._mdp = mdp
        self._max_sweeps = max_sweeps or 2 * _sweeps_needed(gamma, tolerance)
        self._small_change = tolerance * (1 - gamma) / (4 * gamma) if gamma > 0 else np.inf
        self._desk = Desk(
            comparator,
            f"{mdp.fingerprint}/value-iteration/{tolerance!r}",
            indifference=tolerance * (1 - gamma) / 2 if indifference is None else indifference,
            max_queries=max_queries,
            audit=audit,
            batch=batch,
            seed=rng,
        )
        n = mdp.n_states
        self._states = np.flatnonzero(~mdp.terminal)
        self._admissible = mdp.admissible
        self._rewards = (1 - gamma) * mdp.vector_rewards().reshape(n * mdp.n_actions, mdp.k)
        self._v = np.zeros((n, mdp.k))
        self._v[:, 0] = 1.0
        self._best = np.argmax(mdp.admissible, axis=1)
        for s in np.flatnonzero(mdp.terminal):
            self._v[s] = np.eye(mdp.k)[mdp.levels[s, self._best[s]]]
        self._sweeps = 0
        self._end: Status | None = None
        self._answered: dict[int, Verdict] = {}  # by state, for the pair at its cursor
        self._asking: dict[str, int] = {}  # query id to state
        self._blocked: dict[int, int] = {}  # state to the tier its pair was judged with
        self._begin_sweep()

    def ask(self) -> tuple[Query, ...]:
        """The pending queries, or () when finished. Sweeps as far as it needs no tutor."""
        if self._desk.pending:
            return self._desk.ask()
        while self._end is None:
            self._compete()
            if self._blocked:
                return self._open()
            self._finish_sweep()
        return ()

    def tell(self, answers: Sequence[Answer], on_conflict: OnConflict = "raise") -> tuple[Answer, ...]:
        """Take answers to pending queries. Raises StaleAnswer, or InconsistentAnswers unless
        ``on_conflict="drop"`` (then such an answer settles its own pair only, and is returned)."""
        verdicts, dropped = self._desk.tell(answers, on_conflict)
        for name, verdict in verdicts.items():
            self._answered[self._asking.pop(name)] = verdict
        return dropped

    def result(self) -> Result:
        """The policy and the counts so far."""
        status = self._end or Status.WAITING
        if status is Status.CONVERGED and self._desk.counts[Tier.GUESS]:
            status = Status.GUESSED
        return self._desk.result(
            policy=self._best.copy(),
            q=self._q.copy(),
            status=status,
            tiers=self._desk.counts.copy(),
            rounds=self._sweeps,
        )

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]]) -> None:
        """Let ``signs`` answer from now on: counted, not logged."""
        self._desk.signs = signs

    def watch(self, watcher: Watch) -> None:
        """Call ``watcher(d, decisions)`` with every batch of comparisons acted on."""
        self._desk.watch = watcher

    @property
    def comparator(self) -> Comparator:
        """What is known of the scale."""
        return self._desk.comparator

    def _begin_sweep(self) -> None:
        mdp = self._mdp
        following = mdp.transitions @ self._v
        q = self._rewards + mdp.discount * following
        self._q: Floats = q.reshape(mdp.n_states, mdp.n_actions, mdp.k)
        self._q[~mdp.admissible] = np.eye(mdp.k)[0]
        self._q[mdp.terminal] = self._v[mdp.terminal][:, None, :]
        self._next = np.zeros(mdp.n_states, dtype=np.int64)  # each state's cursor: its next challenger
        self._active = self._states

    def _compete(self) -> None:
        """Let the actions of all active states compete until each state is done or needs the tutor.

        A state that waits with an audit is judged anew only when its turn to ask has come: what was
        learned meanwhile can answer a question, but hardly a pair that the answers had settled."""
        stale = {s for s, tier in self._blocked.items() if tier >= AUDIT and s not in self._answered}
        for s, verdict in self._answered.items():
            self._settle(np.array([s]), self._next[[s]], np.array([verdict]))
        self._answered.clear()
        self._blocked = {s: self._blocked[s] for s in stale}
        due = [int(s) for s in self._active if s not in stale]
        while due:
            active = np.array(due, dtype=np.int64)
            while len(active):
                active = self._round(active)
            due = [s for s in sorted(self._blocked)[: self._desk.batch] if s in stale]
            stale.difference_update(due)
            for s in due:
                del self._blocked[s]
        self._active = np.array(sorted(self._blocked), dtype=np.int64)

    def _round(self, active: NDArray[np.int64]) -> NDArray[np.int64]:
        """Judge each active state's remaining challengers against its present best, act on the judgements
        up to the first that changes the best or is unknown, and return the states that must go on."""
        n_actions = self._mdp.n_actions
        actions = np.arange(n_actions)
        wanted = (
            self._admissible[active] & (actions >= self._next[active, None]) & (actions != self._best[active, None])
        )
        if self._desk.signs is not None:  # an oracle counts its questions: none beyond the next challenger
            wanted &= np.cumsum(wanted, axis=1) == 1
        owner, challenger = np.nonzero(wanted)
        states = active[owner]
        d = self._q[states, challenger] - self._q[states, self._best[states]]
        incumbents = self._best[states]
        decisions = self._desk.judge(d, lambda row: place(states[row], challenger[row], incumbents[row]))
        stops = (decisions.verdicts == Verdict.BETTER) | (decisions.verdicts == Verdict.UNKNOWN)
        earlier = np.cumsum(stops) - stops
        first_of_owner = np.searchsorted(owner, owner)  # rows are sorted by owner
        acted = earlier == earlier[first_of_owner] if len(owner) else stops
        unknown = acted & (decisions.verdicts == Verdict.UNKNOWN)
        better = acted & (decisions.verdicts == Verdict.BETTER)
        used = acted & ~unknown
        self._desk.commit(d[used], Decisions(decisions.verdicts[used], decisions.tiers[used]))
        self._settle(states[used], challenger[used], decisions.verdicts[used])
        for s, a, tier in zip(states[unknown], challenger[unknown], decisions.tiers[unknown], strict=True):
            self._next[s] = a
            self._blocked[int(s)] = int(tier)
        if self._desk.signs is not None:
            return np.unique(states[used])
        going: NDArray[np.int64] = states[better]
        return going

    def _settle(self, states: NDArray[np.int64], challengers: NDArray[np.int64], verdicts: NDArray[np.int8]) -> None:
        """Move cursors past decided challengers (rows in order of states and actions)."""
        self._next[states] = challengers + 1
        won = verdicts == Verdict.BETTER
        self._best[states[won]] = challengers[won]

    def _open(self) -> tuple[Query, ...]:
        waiting = self._active[: self._desk.batch]  # further on, audits may not have been judged anew
        chosen = waiting[
            self._desk.next_batch(self._q[waiting, self._next[waiting]] - self._q[waiting, self._best[waiting]])
        ]
        pairs = []
        for s in chosen:
            challenger, incumbent = self._next[s], self._best[s]
            pairs.append((self._q[s, challenger], self._q[s, incumbent], int(s), int(challenger), int(incumbent)))
        tiers = np.array([self._blocked[int(s)] for s in chosen], dtype=np.int8)
        queries = self._desk.open(pairs, Decisions(np.full(len(chosen), Verdict.UNKNOWN, np.int8), tiers))
        self._asking = {query.id: int(s) for query, s in zip(queries, chosen, strict=True)}
        return queries

    def _finish_sweep(self) -> None:
        v = self._q[np.arange(self._mdp.n_states), self._best]
        change = float(np.abs(tail_sums(v - self._v)).max(initial=0.0))  # the most any ordered scale can see
        self._sweeps += 1
        self._v = v
        if change < self._small_change or self._mdp.discount == 0:
            self._end = Status.CONVERGED
        elif self._sweeps >= self._max_sweeps:
            self._end = Status.SWEEP_LIMIT
        else:
            self._begin_sweep()


def _sweeps_needed(discount: float, tolerance: float) -> int:
    """Sweeps after which scalar value iteration has stopped: its first change is at most 1 - discount, and
    each later one at most discount times the last."""
    if discount == 0:
        return 1
    return max(1, math.ceil(math.log(min(1.0, tolerance / (4 * discount))) / math.log(discount)) + 2)
