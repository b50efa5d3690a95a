"""An elicitation: what settles comparisons of vectors, and whom and what to ask, for whoever needs verdicts.

It is given differences, and gives back verdicts or the word that the tutor must be asked; it is told on which verdicts
its user acted. Here lives everything that is the same whoever asks: what the comparator knows, indifference, the
question budget, audits, "cannot tell", never asking a pair twice, and the counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed, key_of, pair_codes, uniform
from elicit._support.validation import is_number, is_whole
from elicit.asking.answered_pairs import AnsweredPairs, first_of_each_pair
from elicit.asking.elicitation_kernel import AskingRule
from elicit.decision.decide import decide
from elicit.model.comparator import BY_ANSWERS, Comparator, Decisions, Tier
from elicit.model.query import Answer, Answers, InconsistentAnswers, Query, Verdict, match
from elicit.model.scale import Floats, dot, tail_sums

Watch = Callable[[Floats, Decisions], None]
OnConflict: TypeAlias = Literal["raise", "drop"]

Place: TypeAlias = tuple[int, int, int]
"""Where a pair is compared: the state, and its two actions in order of their numbers."""


@dataclass(frozen=True)
class Audit:
    """A comparison that the answers had settled, put to the tutor all the same."""

    query: Query
    expected: Verdict
    answer: Verdict | None

    @property
    def contradicts(self) -> bool:
        """Whether the tutor said the opposite of what the answers imply."""
        return self.answer is not None and self.expected * self.answer == -1


class Pending(NamedTuple):
    """A query, the verdict that the answers imply where it is an audit (else None), the tier it counts for, and its
    place."""

    query: Query
    expected: Verdict | None
    tier: int
    place: Place


class Elicitation:
    """Settles differences for one learner, and keeps the answers and the counts."""

    def __init__(
        self,
        comparator: Comparator,
        fingerprint: str,
        *,
        indifference: float,
        max_queries: int | None,
        audit: float,
        batch: int,
        seed: Seed,
    ) -> None:
        if not is_number(indifference, 0):
            raise ValueError(f"indifference must be a number of at least 0, not {indifference!r}")
        if max_queries is not None and not is_whole(max_queries, 0):
            raise ValueError(f"max_queries must be None or a whole number of at least 0, not {max_queries!r}")
        if not (is_number(audit, 0) and audit <= 1):
            raise ValueError(f"audit, the share of settled pairs to ask about, must lie in 0..1, not {audit!r}")
        if not is_whole(batch, 1):
            raise ValueError(f"batch must be a whole number of at least 1, not {batch!r}")
        self.comparator = comparator
        self.batch = int(batch)
        self.answers = Answers.none(comparator.k)
        self.asked = 0
        self.cannot_tell = 0
        self.audits: list[Audit] = []
        self.counts = np.zeros(len(Tier), dtype=np.int64)
        self.watch: Watch | None = None
        self.signs: Callable[[Floats], NDArray[np.int8]] | None = None
        self.pending: tuple[Pending, ...] = ()
        self.puts_off = False  # whether undecided pairs go by the best guess for now, to be asked about later
        self._fingerprint = fingerprint
        self.indifference = float(indifference)
        self._max_queries = max_queries
        self._audit = float(audit)
        self._key = np.uint64(key_of(seed))
        self._number = 0
        self._told = AnsweredPairs(self._key)
        self._unclear: set[Place] = set()  # where the tutor could not tell
        self._guess: tuple[Comparator, Floats] | None = None

    def judge(self, d: Floats, places: Callable[[int], Place] | None = None) -> Decisions:
        """Verdicts (n,) and tiers (n,) for differences d (n, k). UNKNOWN means: ask the tutor. Counts nothing.

        ``places`` gives the place of a row: where the tutor could not tell, its estimates keep changing a
        little, and a person must not be asked about each new version of the same pair."""
        verdicts, tiers = decide(self.comparator, d)
        if len(self._told.binding):
            self._told.settle(d, verdicts, tiers, np.flatnonzero(tiers > Tier.DOMINANCE), binding=True)
        if self._audit > 0:
            self._pick_audits(d, verdicts, tiers)
        rows = np.flatnonzero((verdicts == Verdict.UNKNOWN) & (tiers < AUDIT))
        if not len(rows):
            return Decisions(verdicts, tiers)
        tiers[rows] = Tier.TUTOR
        if self.signs is not None:
            verdicts[rows] = self.signs(d[rows])
            return Decisions(verdicts, tiers)
        if len(self._told.codes):
            rows = self._told.settle(d, verdicts, tiers, rows)
        if self._unclear and places is not None:
            unclear = np.array([places(int(row)) in self._unclear for row in rows], dtype=bool)
            verdicts[rows[unclear]], tiers[rows[unclear]] = Verdict.EQUAL, Tier.KNOWN
            rows = rows[~unclear]
        if self.indifference > 0 and len(rows):
            low, high = self.comparator.bounds(d[rows])
            close = (low >= -self.indifference) & (high <= self.indifference)
            verdicts[rows[close]], tiers[rows[close]] = Verdict.EQUAL, Tier.INDIFFERENT
            rows = rows[~close]
        if self.guesses and len(rows):
            verdicts[rows], tiers[rows] = np.sign(dot(tail_sums(d[rows]), self._gaps())), Tier.GUESS
        return Decisions(verdicts, tiers)

    def rule(self) -> AskingRule:
        """The same for compiled loops, which come back with what only ``judge`` can tell."""
        asks = self.signs is None
        guesses = asks and self.guesses
        return AskingRule(
            indifference=self.indifference if asks else 0.0,
            audit=self._audit,
            key=self._key,
            binding=self._told.binding,
            said=self._told.codes,
            plain=self._audit == 0 and not len(self._told.binding),
            unclear=bool(self._unclear),
            guess=self._gaps() if guesses else np.empty(0),
        )

    def commit(self, d: Floats, decisions: Decisions) -> None:
        """Count judgements that the learner acted on."""
        if not len(d):
            return
        self.counts += np.bincount(decisions.tiers, minlength=len(Tier))
        if self.signs is not None:
            self.asked = int(self.counts[Tier.TUTOR])
        if self.watch is not None:
            self.watch(d, decisions)

    def consult(self, d: Floats) -> NDArray[np.int8]:
        """An oracle's verdicts (n,), counted: the short way where it answers everything."""
        assert self.signs is not None
        verdicts = self.signs(d)
        self.counts[Tier.TUTOR] += len(d)
        self.asked += len(d)
        if self.watch is not None:
            self.watch(d, Decisions(verdicts, np.full(len(d), Tier.TUTOR, np.int8)))
        return verdicts

    def open(
        self, pairs: Sequence[tuple[Floats, Floats, int, int, int]], decisions: Decisions, about: str | None = None
    ) -> tuple[Query, ...]:
        """Make the pending queries of (left, right, state, left action, right action), judged UNKNOWN. ``about`` says
        what they are about, where that is no state and actions."""
        pending = []
        for (left, right, state, a, b), tier in zip(pairs, decisions.tiers, strict=True):
            said = about or f"state {state}: action {a} (left) or action {b} (right)?"
            query = Query.make(self._fingerprint, self._number, left, right, said)
            self._number += 1
            expected = Verdict(int(decide(self.comparator, query.d).verdicts[0])) if tier >= AUDIT else None
            pending.append(Pending(query, expected, int(tier) % AUDIT, place(state, a, b)))
        self.pending = tuple(pending)
        return self.ask()

    def ask(self) -> tuple[Query, ...]:
        """The pending queries."""
        return tuple(p.query for p in self.pending)

    def tell(self, answers: Sequence[Answer], on_conflict: OnConflict) -> tuple[dict[str, Verdict], tuple[Answer, ...]]:
        """Take answers to pending queries: the verdict by query id ("cannot tell" is EQUAL: the incumbent
        stays; of an audit it is what the answers imply), and the answers dropped as contradictory. Where it
        raises, nothing has changed."""
        if on_conflict not in ("raise", "drop"):
            raise ValueError(f"on_conflict must be 'raise' or 'drop', not {on_conflict!r}")
        answers = match(answers, self.ask())
        waiting = {p.query.id: p for p in self.pending}
        comparator, used, dropped = self._learn(answers, on_conflict)
        settled = [(answer, waiting[answer.query.id], any(answer is other for other in dropped)) for answer in answers]
        verdicts = [_settle(answer, asked, unused, comparator) for answer, asked, unused in settled]
        # from here on nothing can fail but the watcher, which comes last
        self.comparator, self.answers = comparator, self.answers + used
        seen = []
        for (answer, (query, expected, tier, where), unused), verdict in zip(settled, verdicts, strict=True):
            del waiting[query.id]
            self.cannot_tell += answer.verdict is None
            if expected is None:
                self.asked += 1
                if answer.verdict is None:
                    self._unclear.add(where)
            else:
                self.audits.append(Audit(query, expected, answer.verdict))
            said = verdict if answer.verdict is None else answer.verdict
            self._told.add(query.d, said, binding=unused or said == Verdict.EQUAL)
            if expected is not None and verdict != expected:
                tier = int(Tier.KNOWN)  # by the audit's answer, not by what the answers before it implied
            self.counts[tier] += 1
            seen.append((query.d, Decisions(np.array([verdict], np.int8), np.array([tier], np.int8))))
        self.pending = tuple(waiting.values())
        if self.watch is not None:
            for d, decisions in seen:
                self.watch(d[None, :], decisions)
        return {answer.query.id: verdict for answer, verdict in zip(answers, verdicts, strict=True)}, dropped

    @property
    def spent(self) -> bool:
        """Whether the question budget is used up."""
        return self._max_queries is not None and self.asked >= self._max_queries

    @property
    def unsure(self) -> bool:
        """Whether pairs count as ties because the tutor could not tell them (an audit's stand as the answers say)."""
        return bool(self._unclear)

    @property
    def guesses(self) -> bool:
        """Whether pairs that would need the tutor go by the comparator's best scale."""
        return self.puts_off or self.spent

    @property
    def audits_any(self) -> bool:
        """Whether settled pairs may be put to the tutor."""
        return self._audit > 0

    def may_ask(self, d: Floats, places: Callable[[int], Place]) -> NDArray[np.bool_]:
        """Which of the differences d (n, k) were not answered before, nor compared at a place where the tutor could
        not tell."""
        new: NDArray[np.bool_] = ~self._told.has(d)
        if self._unclear:
            new &= np.array([places(i) not in self._unclear for i in range(len(d))], dtype=np.bool_)
        return new

    def next_batch(self, d: Floats) -> list[int]:
        """Which of the differences d (n, k), judged UNKNOWN, to ask about now: the first ones, as many as batch
        and budget allow, and of several rows about one pair only the first."""
        room = self.batch if self._max_queries is None else max(1, min(self.batch, self._max_queries - self.asked))
        return first_of_each_pair(d, room)

    def _learn(
        self, answers: Sequence[Answer], on_conflict: OnConflict
    ) -> tuple[Comparator, Answers, tuple[Answer, ...]]:
        k = self.comparator.k
        try:
            together = Answers.of(answers, k)
            return self.comparator.update(together), together, ()
        except InconsistentAnswers:
            if on_conflict == "raise":
                raise
            if len(answers) == 1:
                return self.comparator, Answers.none(k), tuple(answers)
        comparator, used, dropped = self.comparator, Answers.none(k), []
        for answer in answers:
            row = Answers.of([answer], k)
            try:
                comparator = comparator.update(row)
                used = used + row
            except InconsistentAnswers:
                dropped.append(answer)
        return comparator, used, tuple(dropped)

    def _pick_audits(self, d: Floats, verdicts: NDArray[np.int8], tiers: NDArray[np.int8]) -> None:
        """Turn a share of the pairs that answers decided into questions: a function of the key and the pair."""
        rows = np.flatnonzero(np.isin(tiers, BY_ANSWERS) & (np.abs(verdicts) == 1))
        if not len(rows):
            return
        codes = pair_codes(self._key, tail_sums(d[rows]))
        rows = rows[uniform(codes) < self._audit]
        rows = rows[~self._told.has(d[rows])]
        verdicts[rows], tiers[rows] = Verdict.UNKNOWN, tiers[rows] + AUDIT

    def _gaps(self) -> Floats:
        if self._guess is None or self._guess[0] is not self.comparator:
            self._guess = (self.comparator, np.diff(self.comparator.values))
        return self._guess[1]


AUDIT = 16  # added to a tier: settled by answers, but the tutor is to confirm it


def _settle(answer: Answer, asked: Pending, unused: bool, comparator: Comparator) -> Verdict:
    """The verdict to act on. The tutor's, or what holds where she cannot tell; but of an audit's answer that the
    others allow, what the comparator makes of it."""
    if answer.verdict is None:
        return Verdict.EQUAL if asked.expected is None else asked.expected
    if asked.expected is None or unused or answer.verdict is Verdict.EQUAL:
        return answer.verdict
    now = Verdict(int(decide(comparator, asked.query.d).verdicts[0]))
    return answer.verdict if now is Verdict.UNKNOWN else now


def place(state: int, a: int, b: int) -> Place:
    """The place of a pair of actions, whichever is left."""
    return int(state), int(min(a, b)), int(max(a, b))
