"""The best of a plain list of vectors, or their order, with few questions: ask and tell, without an MDP.

    choice = choose(vectors, comparator)
    while queries := choice.ask():
        choice.tell([tutor(query) for query in queries])
    choice.result().best

It chooses as if the comparator's best guess at the scale were right, collects the comparisons that
rest on the guess alone, and asks about the one whose answer is most open; when none is left, the
choice holds whatever the scale.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.validation import is_whole
from elicit.decision.decide import decide
from elicit.model.comparator import Comparator, Tier, check_comparator_made
from elicit.model.query import Answer, Answers, Query, Verdict, match
from elicit.model.scale import Floats, as_vectors, dot, tail_sums

_CONTENDERS = 8  # best of: a question is about two of so many; more saves none and costs bounds of more pairs
_Indices = NDArray[np.intp]
_Plan = tuple[list[int], int, _Indices]  # ranking, how many comparisons are guesses, pairs (n, 2) to ask about


class ChoiceStatus(Enum):
    """How far a choice has come."""

    FINISHED = "Finished: every comparison that the choice rests on is settled."
    UNSURE = "Finished, but the tutor could not tell some pairs apart; of these the one that was ahead stayed ahead."
    GUESSED = (
        "Finished, but the question budget was spent: the rest went by the best guess at the scale, as "
        "decided['guess'] counts. Raise max_queries for a settled choice."
    )
    WAITING = (
        "Waiting for an answer: this is the choice by the best guess at the scale so far. "
        "Call ask, then tell, until ask returns nothing."
    )


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen.

    best: index of the best vector, the first in the list of equals. order: all indices, best first, or
    None if only the best was wanted. label: the name of the best. asked: questions told, among them
    ``cannot_tell`` without a verdict. decided: how many pairs each tier settled ("equal", "dominance",
    "lp", "tutor", "guess", ...). answers: what the comparator learned from.
    """

    best: int
    order: tuple[int, ...] | None
    label: str
    status: ChoiceStatus
    asked: int
    cannot_tell: int
    decided: dict[str, int]
    comparator: Comparator
    answers: Answers


def choose(
    vectors: ArrayLike,
    comparator: Comparator,
    order: bool = False,
    labels: Sequence[str] | None = None,
    max_queries: int | None = None,
    check_totals: bool = True,
) -> Choosing:
    """Find the best of vectors (n, k), or with ``order=True`` their order, asking what the comparator cannot tell.

    labels: n names, for people, shown in the queries. max_queries: beyond so many questions the best
    guess at the scale settles the rest. The vectors must have equal totals, as shares do: otherwise
    the choice depends on what the worst level is worth, and an order of levels does not say that;
    ``check_totals=False`` takes the worst level as worth nothing. Raises ValueError on vectors that
    are not finite, not (n, k), or of unequal totals; TypeError for anything but a comparator.
    """
    check_comparator_made(comparator)
    rows = as_vectors(vectors, comparator.k, name="vectors").copy()
    n = len(rows)
    if n == 0:
        raise ValueError("there is nothing to choose from: vectors has no rows")
    if labels is not None and len(labels) != n:
        raise ValueError(f"labels must name each of the {n} vectors, but there are {len(labels)}")
    if max_queries is not None and not is_whole(max_queries, 0):
        raise ValueError(f"max_queries must be a whole number of at least 0, or None for no limit, not {max_queries!r}")
    if check_totals:
        _check_totals(rows)
    return Choosing(
        rows, comparator, bool(order), [str(x) for x in (range(n) if labels is None else labels)], max_queries
    )


@dataclass
class _State:
    """All that an answer can change. ``tell`` works on a copy, and keeps it only if all went well."""

    comparator: Comparator
    answers: Answers
    settled: NDArray[np.int8]  # (n, n) final verdicts: the comparator's, except on pairs answered "equal"
    silent: NDArray[np.bool_]  # (n, n) pairs on which this comparator has just said UNKNOWN
    told: NDArray[np.int8]  # (n, n) answers: they stand until the comparator can tell, "equal" for good
    standing: list[int]  # best of: those not beaten so far, in the order of the list
    known: dict[bytes, Verdict] = field(default_factory=dict)  # answers by difference, both ways round
    decided: Counter[str] = field(default_factory=Counter)
    learns: bool = True  # False for a comparator that answers teach nothing
    asked: int = 0
    cannot_tell: int = 0
    ranking: list[int] = field(default_factory=list)
    query: Query | None = None
    pair: tuple[int, int] = (0, 0)  # the rows that the query is about; the first is ahead by the best guess

    def copy(self) -> _State:
        copied = replace(self, settled=self.settled.copy(), silent=self.silent.copy(), told=self.told.copy())
        copied.known, copied.decided = dict(self.known), Counter(self.decided)
        return copied

    def settle(self, i: int, j: int, verdict: Verdict) -> None:
        self.settled[i, j], self.settled[j, i] = verdict, verdict.flipped

    def hear(self, i: int, j: int, verdict: Verdict) -> None:
        self.told[i, j], self.told[j, i] = verdict, verdict.flipped


class Choosing:
    """A choice under way, as ``choose`` returns it. Holds no tutor, file or clock."""

    def __init__(
        self, vectors: Floats, comparator: Comparator, order: bool, labels: list[str], max_queries: int | None
    ) -> None:
        n = len(vectors)
        self._vectors = vectors
        self._wants_order = order
        self._labels = labels
        self._budget = max_queries
        self._fingerprint = hashlib.blake2b(vectors.tobytes() + bytes([order]), digest_size=8).hexdigest()
        unknown = np.full((n, n), Verdict.UNKNOWN, dtype=np.int8)
        state = _State(
            comparator,
            Answers.none(comparator.k),
            unknown,
            np.zeros((n, n), dtype=bool),
            unknown.copy(),
            list(range(n)),
        )
        self._advance(state)
        self._state = state

    def ask(self) -> tuple[Query, ...]:
        """The pending query, the same one until it is told; () when finished."""
        return () if self._state.query is None else (self._state.query,)

    def tell(self, answers: Sequence[Answer]) -> None:
        """Take the answer to the pending query; with the verdict None the vector that is ahead stays ahead.

        Raises StaleAnswer where no such query is pending (see ``query.match``), and lets the comparator's
        InconsistentAnswers through; then nothing has changed.
        """
        answers = match(answers, self.ask())
        for answer in answers:
            state = self._state.copy()
            self._learn(state, answer.verdict)
            self._advance(state)
            self._state = state

    def result(self) -> Choice:
        """The choice; before the end, the one by the best guess at the scale so far."""
        state = self._state
        if state.query is not None:
            status = ChoiceStatus.WAITING
        elif state.decided["guess"]:
            status = ChoiceStatus.GUESSED
        else:
            status = ChoiceStatus.UNSURE if state.cannot_tell else ChoiceStatus.FINISHED
        return Choice(
            best=state.ranking[0],
            order=tuple(state.ranking) if self._wants_order else None,
            label=self._labels[state.ranking[0]],
            status=status,
            asked=state.asked,
            cannot_tell=state.cannot_tell,
            decided={name: count for name, count in state.decided.items() if count},
            comparator=state.comparator,
            answers=state.answers,
        )

    def _learn(self, state: _State, verdict: Verdict | None) -> None:
        assert state.query is not None
        d, (ahead, other) = state.query.d, state.pair
        if verdict is None:
            state.cannot_tell += 1
        else:
            row = Answers(d, [int(verdict)], [state.query.id])
            learned = state.comparator.update(row)
            state.learns = learned is not state.comparator
            if state.learns:
                state.comparator = learned
                state.silent[:] = False
            state.answers = state.answers + row
            state.decided["tutor"] += 1
        verdict = Verdict.BETTER if verdict is None else verdict
        state.asked += 1
        state.known[_bits(d)], state.known[_bits(-d)] = verdict, verdict.flipped
        state.hear(ahead, other, verdict)

    def _advance(self, state: _State) -> None:
        """Choose by what is known and, where that is silent, by the best guess; find the next question."""
        scores = dot(tail_sums(self._vectors), np.diff(state.comparator.values))
        by_guess = np.argsort(-scores, kind="stable")
        plan = self._plan_order if self._wants_order else self._plan_best
        while True:
            state.ranking, guessed, candidates = plan(state, by_guess)
            if not guessed or state.asked == self._budget:
                state.decided["guess"], state.query = guessed, None
                return
            # what no answer teaches is best asked in the order of the search, whose steps halve the rest
            ahead, other = self._most_open(state, candidates) if state.learns else candidates[0].tolist()
            left, right = self._vectors[ahead], self._vectors[other]
            repeated = state.known.get(_bits(left - right))
            if repeated is None:
                break
            state.decided[Tier.KNOWN.name.lower()] += 1  # another pair, the same difference
            state.hear(ahead, other, repeated)
        about = f"{self._labels[ahead]} or {self._labels[other]}"
        state.pair = ahead, other
        state.query = Query.make(self._fingerprint, state.asked, left, right, about)

    def _plan_best(self, state: _State, by_guess: _Indices) -> _Plan:
        """The vectors not beaten so far, the best guess first; how many of them the guess alone puts
        behind it; and the pairs worth a question, each with the better guess first."""
        left: list[int] = []
        for i in state.standing:
            codes = self._judge(state, left, i)
            if not ((codes == Verdict.BETTER) | (codes == Verdict.EQUAL)).any():
                left = [j for j, code in zip(left, codes, strict=True) if code != Verdict.WORSE]
                left.append(i)
        state.standing = left
        standing = by_guess[np.isin(by_guess, left)]
        first, second = np.triu_indices(min(len(standing), _CONTENDERS), 1)
        return standing.tolist(), len(standing) - 1, np.stack([standing[first], standing[second]], axis=1)

    def _plan_order(self, state: _State, by_guess: _Indices) -> _Plan:
        """As above, for the whole order: each vector is inserted from the end of those whose guess is
        better, by a search that doubles its steps, so a good guess costs one comparison each."""
        self._judge(state, by_guess[:-1], by_guess[1:])
        groups: list[list[int]] = []
        guessed: list[tuple[int, int]] = []
        for i in by_guess.tolist():
            low, high, step = 0, len(groups), 1
            while low < high:
                middle = max(low, high - step) if step else (low + high) // 2
                j = groups[middle][0]
                code = self._judge(state, [j], i)[0]
                if code == Verdict.UNKNOWN:
                    guessed.append((j, i))
                    code = Verdict.BETTER
                if code == Verdict.EQUAL:
                    groups[middle].append(i)
                    break
                if code == Verdict.BETTER:
                    low, step = middle + 1, 0
                else:
                    high, step = middle, 2 * step
            else:
                groups.insert(low, [i])
        return [i for group in groups for i in sorted(group)], len(guessed), np.array(guessed, dtype=np.intp)

    def _most_open(self, state: _State, pairs: _Indices) -> tuple[int, int]:
        """The pair whose d.e reaches about as far above 0 as below it: either answer then teaches much."""
        low, high = state.comparator.bounds(self._vectors[pairs[:, 0]] - self._vectors[pairs[:, 1]])
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.minimum(high, -low) / (high - low)
        ahead, other = pairs[int(np.argmax(np.nan_to_num(share, nan=0.5)))].tolist()
        return ahead, other

    def _judge(self, state: _State, ahead: ArrayLike, other: ArrayLike) -> NDArray[np.int8]:
        """Verdicts (n,) on rows ``ahead`` (n,) against rows ``other`` (n,) or one row: what is settled, else the
        comparator's, which are final, else the tutor's."""
        a, b = np.broadcast_arrays(np.asarray(ahead, dtype=np.intp), np.asarray(other, dtype=np.intp))
        unsettled = (state.settled[a, b] == Verdict.UNKNOWN) & ~state.silent[a, b]
        a_open, b_open = a[unsettled], b[unsettled]
        if len(a_open):
            d = self._vectors[a_open] - self._vectors[b_open]
            found = decide(state.comparator, d)
            state.silent[a_open, b_open] = state.silent[b_open, a_open] = True
            for m in np.flatnonzero(found.verdicts != Verdict.UNKNOWN):
                verdict, tier = Verdict(found.verdicts[m]), Tier(found.tiers[m])
                if state.known.get(_bits(d[m])) is Verdict.EQUAL:
                    verdict, tier = Verdict.EQUAL, Tier.KNOWN
                i, j = int(a_open[m]), int(b_open[m])
                if state.told[i, j] == Verdict.UNKNOWN:
                    state.decided[tier.name.lower()] += 1
                state.settle(i, j, verdict)
        final = state.settled[a, b]
        verdicts: NDArray[np.int8] = np.where(final == Verdict.UNKNOWN, state.told[a, b], final)
        return verdicts


def _bits(d: Floats) -> bytes:
    return (d + 0.0).tobytes()  # adding 0.0 turns -0.0 into 0.0


def _check_totals(vectors: Floats) -> None:
    totals = vectors.sum(axis=1)
    off = np.abs(totals - totals[0])
    if off.max() > 1e-9 * np.abs(vectors).sum(axis=1).max():
        i = int(np.argmax(off))
        raise ValueError(
            f"vectors must have equal totals, but vector 0 has total {totals[0]:g} and vector {i} has {totals[i]:g}: "
            "which is better would depend on what the worst level is worth. Divide each by its total, or "
            "fill up with the worst level, or say check_totals=False to take the worst level as worth nothing"
        )
