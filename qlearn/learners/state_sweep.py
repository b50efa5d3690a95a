"""A sweep of value iteration over all states: compiled, except for the hard comparisons."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from elicit.asking.elicitation import Elicitation
from elicit.asking.question import Place
from elicit.decision.comparator_rule import ALWAYS_ASK, NO_ARRAYS, PROVEN, Rule, rule_of, silent
from elicit.model.comparator import Decisions, Tier
from elicit.model.difference_kernel import LEFT_OPEN, UNKNOWN
from elicit.model.query import Verdict
from elicit.model.scale import Floats
from qlearn.learners.learner import place
from qlearn.learners.loops.action_pair_kernel import PairDecider
from qlearn.learners.loops.state_sweep_kernel import ANSWERED, Outcome, Work, no_outcome, sweep
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.warm_planning import nearly_valued

BLOCK = 2048  # states that one thread takes at a time
# at once: each has its own copy of the proofs, so that results do not depend on the number of
# threads
BLOCKS = 8

States = NDArray[np.int64]


class StateSweep:
    """A sweep under way: V of the last sweep, each state's best action, and its progress.

    Each state has a cursor: the action that is compared next with the best so far.
    """

    def __init__(self, mdp: OrdinalMDP, elicitation: Elicitation, jobs: int) -> None:
        n, m = mdp.levels.shape
        self._mdp, self._elicitation, self._jobs = mdp, elicitation, jobs
        self.model = model_of(mdp)
        self.v = np.eye(mdp.k)[np.where(mdp.terminal, mdp.final_level, 0)]
        self._following = np.empty_like(self.v)
        self.best = np.argmax(mdp.admissible, axis=1)
        self.cursor = np.empty(n, dtype=np.int32)  # each state's next challenger
        self.waiting_tiers: dict[
            int, int
        ] = {}  # by waiting state: its pair's tier, as ``Elicitation.decide`` has it
        self._pairs = PairDecider(elicitation, n * m, np.float32, room=m)
        self._decided_by = (
            elicitation.comparator
        )  # the comparator that certificates and copies belong to
        self._copies: list[Rule] = []
        self.begin()

    _waiting: States  # whose pair at the cursor is undecided, in order

    def proceed(self, batch: int) -> States:
        """Compare the actions of states, in order, until ``batch`` of them need the tutor.

        Return these states. There may be fewer near the end of the sweep, and there are none once
        it is complete.
        """
        self._look_again(batch)
        while len(self._waiting) < batch and self._reached < self._mdp.n_states:
            states = np.arange(
                self._reached, min(self._mdp.n_states, self._reached + BLOCK * BLOCKS)
            )
            waiting = self._compare(states)
            self._waiting = np.concatenate([self._waiting, waiting])
            self._verified += len(waiting)
            self._reached += len(states)
        return self._waiting[: min(batch, self._verified)]

    def enter_verdict(self, state: int, verdict: Verdict) -> None:
        """Enter the verdict on the pair at the cursor of a waiting state.

        Other waiting states may be decided by the answer too: they are looked at again.
        """
        self._pass_decided(np.array([state]), np.array([verdict], dtype=np.int8))
        self._verified = 0

    def pairs(self, states: States) -> tuple[Floats, Floats, NDArray[np.int32], States]:
        """Return the pairs at the cursors of n states.

        They are the left and right vectors (n, k), and the actions (n,) of the challengers and of
        the best so far.
        """
        rows, challengers, incumbents = (
            np.arange(len(states)),
            self.cursor[states],
            self.best[states],
        )
        q = q_of(states, self.v, self.model)
        return q[rows, challengers], q[rows, incumbents], challengers, incumbents

    @property
    def span(self) -> float:
        """Upper bound on how much the change of V differs between states, under any ordered scale.

        It is known at the end of a sweep.
        """
        return float((self._change[1] - self._change[0]).max())

    def follow(self, within: float) -> None:
        """Replace V by the value of the present actions, accurate to about ``within``.

        No actions are compared.
        """
        self.v = nearly_valued(self._mdp, self.best, self.v, within)

    def next_sweep(self) -> None:
        """Begin the next sweep, from the new V."""
        self.v, self._following = self._following, self.v
        self.begin()

    def begin(self) -> None:
        """Begin this sweep from V, or begin it again."""
        self.cursor[:] = 0
        self.waiting_tiers.clear()
        self._reached = 0  # states from here on have not been looked at in this sweep
        self._change = no_outcome(
            0, self._mdp.k
        ).change  # the least and the greatest change so far of each tail sum of V
        self._waiting = np.empty(0, dtype=np.int64)
        self._verified = (
            0  # number of the first waiting states that wait even with the latest answers
        )

    def _look_again(self, batch: int) -> None:
        """Decide waiting states again, in order, until ``batch`` of them need the tutor.

        Each call takes twice as many states as the last one. So there are few calls, and few
        verdicts that the next answer outdates.
        """
        size = batch
        while self._verified < min(batch, len(self._waiting)):
            part, rest = np.split(self._waiting[self._verified :], [size])
            waiting = self._compare(part)
            self._waiting = np.concatenate([self._waiting[: self._verified], waiting, rest])
            self._verified += len(waiting)
            size *= 2

    def _compare(self, states: States) -> States:
        """Compare the actions of these states until each is done or needs the tutor.

        Return the states that need the tutor, in order.
        """
        waiting: list[States] = []
        while len(states):
            going_on: list[States] = []
            for part, out in self._swept(states):
                self._enter(part, out)
                code = out.code[: len(part)]
                by_python = code == LEFT_OPEN
                if self._elicitation.signs is not None:
                    by_python |= code == UNKNOWN
                asks = part[(code == UNKNOWN) & ~by_python]
                self.waiting_tiers.update(dict.fromkeys(asks.tolist(), int(Tier.TUTOR)))
                needs = self._decide(part[by_python])
                waiting += [asks, needs]
                going_on += [part[code == ANSWERED], np.setdiff1d(part[by_python], needs)]
            states = np.sort(np.concatenate(going_on))
        return np.sort(np.concatenate(waiting)) if waiting else states

    def _swept(self, states: States) -> Iterator[tuple[States, Outcome]]:
        """Yield parts of the states, each with the outcome of the compiled sweep over it.

        Blocks of states are swept in parallel, unless there is a watcher or ``consult`` answers.
        """
        blocks = [states[i : i + BLOCK] for i in range(0, len(states), BLOCK)]
        rules = self._rules(len(blocks))
        alone = self._elicitation.watch is not None or self._elicitation.signs is not None
        if self._jobs > 1 and len(blocks) > 1 and not alone:
            with ThreadPoolExecutor(self._jobs) as pool:  # waits for all, even if interrupted
                yield from list(pool.map(self._sweep, blocks, rules))
            return
        for block, rule in zip(blocks, rules, strict=True):
            while len(block):
                part, out = self._sweep(block, rule)
                yield part, out
                block = block[len(part) :]

    def _sweep(self, states: States, rule: Rule) -> tuple[States, Outcome]:
        """Sweep the states; return those that were reached, and their outcome."""
        work, out = (
            Work(self.v, self._following, self.best, self.cursor),
            no_outcome(len(states), self._mdp.k),
        )
        with np.errstate(all="ignore"):  # hashes wrap around
            reached = sweep(states, work, self.model, self._pairs.arrays(rule), out)
        return states[:reached], out

    def _enter(self, states: States, out: Outcome) -> None:
        """Enter the outcome for these states."""
        n = len(states)
        self.best[states], self.cursor[states] = out.best[:n], out.cursor[:n]
        self._change[0] = np.minimum(self._change[0], out.change[0])
        self._change[1] = np.maximum(self._change[1], out.change[1])
        self._pairs.enter(out.tiers)

    def _decide(self, states: States) -> States:
        """Have the elicitation decide the pairs at the cursors of states, all at once.

        Return the states that need the tutor.
        """
        if not len(states):
            return states
        left, right, challengers, incumbents = self.pairs(states)
        d = left - right

        def where(row: int) -> Place:
            return place(self._mdp, int(states[row]), int(challengers[row]), int(incumbents[row]))

        verdicts, tiers = self._elicitation.decide(d, where)
        needs = verdicts == Verdict.UNKNOWN
        self.waiting_tiers.update(zip(states[needs].tolist(), tiers[needs].tolist(), strict=True))
        self._elicitation.commit(d[~needs], Decisions(verdicts[~needs], tiers[~needs]))
        self._pass_decided(states[~needs], verdicts[~needs])
        needed: States = states[needs]
        return needed

    def _pass_decided(self, states: States, verdicts: NDArray[np.int8]) -> None:
        """Move on from decided comparisons: advance the cursors of these states."""
        won = states[verdicts == Verdict.BETTER]
        self.best[won] = self.cursor[won]
        self.cursor[states] += 1

    def _rules(self, n: int) -> Sequence[Rule]:
        """Return a copy of the comparator's rule for each of n blocks of states.

        What is proven in a block is stored in its copy. After an answer, certificates are deleted,
        except proven ones.
        """
        if self._elicitation.comparator is not self._decided_by:
            self._decided_by = self._elicitation.comparator
            self._pairs.take_answers()
            self._copies.clear()
        rule = rule_of(self._decided_by)
        if self._elicitation.puts_off and rule.kind not in (NO_ARRAYS, ALWAYS_ASK):
            rule = (
                silent()
            )  # the best guess is one of the plausible scales, and is cheaper to look up
        if n == 1 or rule.kind != PROVEN:  # proofs write to the arrays of a rule
            return [rule] * n
        self._copies.extend(_copy(rule) for _ in range(n - len(self._copies)))
        return self._copies[:n]


def _copy(rule: Rule) -> Rule:
    """Return a copy of a rule whose arrays may be changed by proofs."""
    written = ("points", "inverses", "active", "kind", "age", "counts")
    return rule._replace(
        known=rule.known._replace(**{name: getattr(rule.known, name).copy() for name in written})
    )
