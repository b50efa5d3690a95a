"""A sweep in which every state's actions compete: compiled where that may be, else by the elicitation, all at once."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit.asking.elicitation import Elicitation
from elicit.decision.rule import NOTHING, PROOFS, Rule, outlasts_answers, rule_of, silent
from elicit.model.comparator import Decisions, Tier
from elicit.model.query import Verdict
from elicit.model.scale import Floats, tail_sums
from qlearn.learners.learner import place
from qlearn.learners.state_sweep_kernel import DONE, Found, Work, compete, found
from qlearn.mdp.backup import is_compiled, model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP

BLOCK = 2048  # states one thread takes at a time
BLOCKS = 8  # at once: each has its own copy of the proofs, so that results do not depend on the number of threads


class Competition:
    """V of the last sweep, each state's best action, and how far this sweep has come."""

    def __init__(self, mdp: OrdinalMDP, elicitation: Elicitation, jobs: int) -> None:
        n, m = mdp.levels.shape
        self._mdp, self._elicitation, self._jobs = mdp, elicitation, jobs
        self.model = model_of(mdp)
        self.v = np.zeros((n, mdp.k))
        self.v[:, 0] = 1.0
        ends = np.flatnonzero(mdp.terminal)
        self.v[ends] = np.eye(mdp.k)[mdp.final_level[ends]]
        self._following = np.empty_like(self.v)
        self.best = np.argmax(mdp.admissible, axis=1)
        self.cursor = np.empty(n, dtype=np.int32)  # each state's next challenger
        self.judged: dict[int, tuple[int, bool]] = {}  # of waiting states: their pair's tier, and whether an audit
        self.lent = False  # whether somebody may still read V
        self._floors = np.empty((n * m, mdp.k - 1), dtype=np.float32)
        self._sides = np.zeros(n * m, dtype=np.int8)
        self._judged_by = elicitation.comparator  # whom floors and copies are of
        self._copies: list[Rule] = []
        self._begin()

    def proceed(self, batch: int | None = None) -> NDArray[np.int64]:
        """Let all states' actions compete, up to where a batch of states needs the tutor (by default that of the
        elicitation); returns these states in order, and none at the end of the sweep."""
        batch = batch or self._elicitation.batch
        self._look_again(batch)
        while len(self._waiting) < batch and self._reached < self._mdp.n_states:
            self._go_on()
            self._look_again(batch)
        return self._waiting[: min(batch, self._verified)]

    def settle(self, state: int, verdict: Verdict) -> None:
        """The verdict on the pair at a waiting state's cursor. What waits behind it may be settled by now."""
        self._settle(np.array([state]), self.cursor[[state]], np.array([verdict], dtype=np.int8))
        self._verified = 0

    def next_sweep(self) -> None:
        """Go on from the new V."""
        spare = np.empty_like(self.v) if self.lent else self.v
        self.v, self._following, self.lent = self._following, spare, False
        self._begin()

    def _begin(self) -> None:
        self.cursor[:] = 0
        self.judged.clear()
        self._reached = 0  # states from here on have not been looked at in this sweep
        self.change = 0.0  # the greatest of a tail sum of V: the most that any ordered scale can see
        self._waiting = np.empty(0, dtype=np.int64)  # states whose pair at the cursor is undecided, in order
        self._verified = 0  # how many of the first of them are so with all that is known

    def _go_on(self) -> None:
        """Let the next states' actions compete."""
        states = np.arange(self._reached, min(self._mdp.n_states, self._reached + BLOCK * BLOCKS))
        if self._is_plain():
            blocks = [states[i : i + BLOCK] for i in range(0, len(states), BLOCK)]
            sizes, rules = [len(block) for block in blocks], self._rules(len(blocks))
            if self._jobs > 1 and len(blocks) > 1:
                with ThreadPoolExecutor(self._jobs) as pool:  # waits for all, even if interrupted
                    done = list(pool.map(self._compete, blocks, sizes, rules))
            else:
                done = list(map(self._compete, blocks, sizes, rules))
            waiting = np.concatenate([self._take(*each) for each in done])
        else:
            waiting = self._by_elicitation(states)
            self._verified += len(waiting)
        self._waiting = np.concatenate([self._waiting, waiting])
        self._reached += len(states)

    def again(self) -> None:
        """Begin this sweep anew, from the same V."""
        self._begin()

    def _look_again(self, batch: int) -> None:
        """Judge waiting states anew, in order, until a batch of them is known to need the tutor."""
        size = batch
        while self._verified < min(batch, len(self._waiting)):
            part = self._waiting[self._verified :]
            if self._is_plain():
                seen, out = self._compete(part, batch - self._verified, self._rule())
                looked_at, waiting = len(seen), self._take(seen, out)
                asks = out.code[:looked_at][out.code[:looked_at] != DONE] == Verdict.UNKNOWN
                self.judged.update(dict.fromkeys(waiting[asks].tolist(), (int(Tier.TUTOR), False)))
                if not asks.all():
                    waiting = np.union1d(waiting[asks], self._by_elicitation(waiting[~asks]))
            else:  # twice as many each time: few calls, and few judgements that the next answer outdates
                looked_at = min(size, len(part))
                size, waiting = 2 * size, self._by_elicitation(part[:size])
            rest = self._waiting[self._verified + looked_at :]
            self._waiting = np.concatenate([self._waiting[: self._verified], waiting, rest])
            self._verified += len(waiting)

    def _is_plain(self) -> bool:
        """Whether compiled code may judge: nobody looks on, and the comparator has a rule."""
        special = self._elicitation.signs is not None or self._elicitation.watch is not None
        return not special and is_compiled() and rule_of(self._elicitation.comparator).kind != NOTHING

    def _compete(self, states: NDArray[np.int64], enough: int, rule: Rule) -> tuple[NDArray[np.int64], Found]:
        out = found(len(states))
        work = Work(self.v, self._following, self.best, self.cursor, self._floors, self._sides)
        with np.errstate(all="ignore"):  # hashes wrap around
            reached = compete(states, enough, work, self.model, rule, self._elicitation.rule(), _opened(rule), out)
        return states[:reached], out

    def _take(self, states: NDArray[np.int64], out: Found) -> NDArray[np.int64]:
        """Act on what compiled code found out about states; returns those that have to wait."""
        n = len(states)
        self.best[states], self.cursor[states] = out.best[:n], out.cursor[:n]
        self._elicitation.counts += out.tiers
        self.change = max(self.change, float(out.change[0]))
        waiting: NDArray[np.int64] = states[out.code[:n] != DONE]
        return waiting

    def _rule(self) -> Rule:
        """What the comparator knows, as arrays. After an answer floors may not hold, except a polytope's."""
        comparator = self._elicitation.comparator
        rule = rule_of(comparator)
        if comparator is not self._judged_by:
            if not outlasts_answers(rule):
                self._sides[:] = 0
            self._copies.clear()
            self._judged_by = comparator
        if self._elicitation.puts_off and rule.kind != NOTHING:
            return silent()  # the best guess lies among the plausible scales, and is cheaper to look up
        return rule

    def _rules(self, n: int) -> Sequence[Rule]:
        """The rule for each of n blocks: what they find out on the way goes into copies."""
        rule = self._rule()
        if n == 1 or rule.kind not in PROOFS:
            return [rule] * n
        self._copies.extend(_copy(rule) for _ in range(n - len(self._copies)))
        return self._copies[:n]

    def _by_elicitation(self, states: NDArray[np.int64]) -> NDArray[np.int64]:
        """Let the actions of states compete, all at once, each pair judged by the elicitation, until each state is done
        or needs the tutor; returns those that do."""
        q = q_of(states, self.v, self.model)
        blocked = np.zeros(len(states), dtype=np.bool_)
        active = np.flatnonzero(~self._mdp.terminal[states])
        while len(active):
            active = self._round(states, q, active, blocked)
        done = states[~blocked]
        v = q[np.flatnonzero(~blocked), self.best[done]]
        self._following[done] = v
        change = np.abs(tail_sums(v - self.v[done])).max(initial=0.0)
        self.change = max(self.change, float(change))
        return states[blocked]

    def _round(
        self, states: NDArray[np.int64], q: Floats, active: NDArray[np.int64], blocked: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        """Judge the remaining challengers of the active rows against their present best, act on the judgements
        up to the first that changes the best or is unknown, and return the rows that must go on."""
        actions, here = np.arange(self._mdp.n_actions), states[active]
        wanted = self._mdp.admissible[here] & (actions >= self.cursor[here, None]) & (actions != self.best[here, None])
        if self._elicitation.signs is not None:  # an oracle counts its questions: none beyond the next challenger
            wanted &= np.cumsum(wanted, axis=1) == 1
        at, challenger = np.nonzero(wanted)
        owner, owners = active[at], here[at]
        incumbents = self.best[owners]
        d = q[owner, challenger] - q[owner, incumbents]
        decisions = self._elicitation.judge(d, lambda row: place(owners[row], challenger[row], incumbents[row]))
        stops = (decisions.verdicts == Verdict.BETTER) | (decisions.verdicts == Verdict.UNKNOWN)
        earlier = np.cumsum(stops) - stops
        first_of_owner = np.searchsorted(owner, owner)  # rows are sorted by owner
        acted = earlier == earlier[first_of_owner] if len(owner) else stops
        unknown = acted & (decisions.verdicts == Verdict.UNKNOWN)
        better = acted & (decisions.verdicts == Verdict.BETTER)
        used = acted & ~unknown
        self._elicitation.commit(d[used], Decisions(decisions.verdicts[used], decisions.tiers[used]))
        self._settle(owners[used], challenger[used], decisions.verdicts[used])
        self.cursor[owners[unknown]] = challenger[unknown]
        blocked[owner[unknown]] = True
        how = zip(decisions.tiers[unknown].tolist(), decisions.audited[unknown].tolist(), strict=True)
        self.judged.update(zip(owners[unknown].tolist(), how, strict=True))
        if self._elicitation.signs is not None:
            return np.unique(owner[used])
        going: NDArray[np.int64] = owner[better]
        return going

    def _settle(
        self, states: NDArray[np.int64], challengers: NDArray[np.signedinteger[Any]], verdicts: NDArray[np.int8]
    ) -> None:
        """Move cursors past decided challengers (rows in order of states and actions)."""
        self.cursor[states] = challengers + 1
        won = verdicts == Verdict.BETTER
        self.best[states[won]] = challengers[won]


def _opened(rule: Rule) -> Floats:
    """(p,) 0 where a gap of the scale is known to be 0, else 1; (0,) where none is."""
    return rule.known.open if rule.kind in PROOFS and not rule.known.open.all() else np.empty(0)


def _copy(rule: Rule) -> Rule:
    """The same proofs, in arrays of their own where walks write."""
    known = rule.known
    return rule._replace(
        known=known._replace(
            points=known.points.copy(),
            inverses=known.inverses.copy(),
            active=known.active.copy(),
            kind=known.kind.copy(),
            age=known.age.copy(),
            counts=known.counts.copy(),
        )
    )
