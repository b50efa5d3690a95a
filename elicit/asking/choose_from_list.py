"""Choosing the best of a plain list of vectors, or sorting the list, with few questions.

It works by ask and tell, without an MDP. The vectors are ranked as if the comparator's best guess
at the scale were right. Comparisons that the answers do not prove are collected, and the one whose
answer is most uncertain is asked. When none is left, the choice holds under every scale.
"""

import hashlib
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.keywords import naming_nearest
from elicit._support.validation import is_list, require
from elicit.asking.elicitation import Elicitation, OnConflict
from elicit.asking.options import EarlierAnswers
from elicit.asking.question import Pair
from elicit.model.comparator import Comparator, Decisions, Tier, bounds_of, check_comparator_made
from elicit.model.comparator_parts import best_guess, simultaneous_bounds
from elicit.model.difference import as_vectors, tail_sums
from elicit.model.outcomes import Status
from elicit.model.query import Answer, Answers, Query, Verdict
from elicit.model.scale import Floats, dot

_CONTENDERS = 8  # a question is about two of the best ones, this many; more save none and cost time
_Indices = NDArray[np.intp]
_Plan = tuple[
    list[int], int, _Indices
]  # ranking, how many comparisons are guesses, pairs (n, 2) to ask about


@dataclass(frozen=True, eq=False, repr=False)
class Choice:
    """The result of a choice.

    Attributes
    ----------
    best : int
        Index of the best vector, the first if several are equal.
    order : tuple of int or None
        All indices, best first. None if only the best was wanted.
    name : str
        The name of the best.
    status : Status
    asked : int
        Number of questions answered.
    cannot_tell : int
        Number of these that got no verdict.
    decided : dict of str to int
        Number of pairs that each tier decided ("equal", "dominance", "lp", "tutor", "guess", ...).
    comparator : Comparator
    answers : Answers
        The answers that the comparator learned.
    guarantee : function
        Computes ``loss_bound`` and ``confidence``.
    """

    best: int
    order: tuple[int, ...] | None
    name: str
    status: Status
    asked: int
    cannot_tell: int
    decided: dict[str, int]
    comparator: Comparator
    answers: Answers
    guarantee: Callable[[], tuple[float, float]] = field(repr=False)

    @cached_property
    def _guaranteed(self) -> tuple[float, float]:
        return self.guarantee()

    @property
    def loss_bound(self) -> float:
        """Upper bound on how much better another vector can be than the one called best.

        The unit is the value of the best level minus that of the worst, e_k - e_1. If the vectors
        are share vectors, the bound is a share of the value range.
        """
        return self._guaranteed[0]

    @property
    def confidence(self) -> float:
        """The probability with which ``loss_bound`` holds.

        It is 1 if the bound is proven for every scale that the answers allow. For a posterior it is
        the posterior's level. It is nan if no probability can be stated.
        """
        return self._guaranteed[1]

    def __repr__(self) -> str:
        order = "" if self.order is None else f", order={self.order}"
        return (
            f"Choice(best={self.best}{order}, name={self.name!r}, status={self.status.name}, "
            f"asked={self.asked})"
        )


@naming_nearest
def choose(
    vectors: ArrayLike,
    comparator: Comparator,
    order: bool = False,
    names: Sequence[str] | None = None,
    max_queries: int | None = None,
    check_totals: bool = True,
    known: EarlierAnswers = (),
    labels: Sequence[str] | None = None,
) -> "Choosing":
    """Find the best of a list of vectors, or their order, with few questions.

    Parameters
    ----------
    vectors
        The alternatives, (n, k): the amount of each level, worst level first. They must have equal
        totals, as shares do.
    comparator
        Decides comparisons from the answers so far.
    order
        If True, find the whole order. By default only the best is found.
    names
        The n alternatives' names, for people. Questions and the result show them.
    max_queries
        Largest number of questions. Comparisons that are open after it follow the best guess at the
        scale.
    check_totals
        ``False`` accepts vectors of unequal totals, and takes the worst level as worth nothing.
    known
        Earlier answers: ``Answers``, an ``AnswerLog``, or a list of ``Answer``. They are learned,
        and not asked again.
    labels
        The k levels' names, worst first, for people. Questions show them.

    Returns
    -------
    Choosing
        The choice under way: ``ask``, ``tell`` and ``result``.

    Raises
    ------
    ValueError
        If vectors are not finite, not (n, k), or of unequal totals. If there are not n ``names`` or
        not k ``labels``.
    TypeError
        If ``comparator`` is not a comparator.

    Notes
    -----
    With unequal totals the choice would depend on the value of the worst level, which the order of
    the levels does not give.
    """
    check_comparator_made(comparator)
    rows = as_vectors(vectors, comparator.k, name="vectors").copy()
    n = len(rows)
    if n == 0:
        raise ValueError("there is nothing to choose from: vectors has no rows")
    require(
        names is None or is_list(names, n),
        "names",
        f"None or {n} names, one for each of the vectors",
        names,
    )
    _check_labels(labels, n, comparator.k)
    if check_totals:
        totals = rows.sum(axis=1)
        off = np.abs(totals - totals[0])
        i = int(np.argmax(off))
        found = f"vector 0 has total {totals[0]:g} and vector {i} has {totals[i]:g}"
        if off[i] > 1e-9 * np.abs(rows).sum(axis=1).max():
            raise ValueError(
                f"vectors must have equal totals, but {found}: which is better would depend on "
                "what the worst level is "
                "worth. Divide each by its total, or fill up with the worst level, or say "
                "check_totals=False to take "
                "the worst level as worth nothing"
            )
    fingerprint = hashlib.blake2b(rows.tobytes() + bytes([bool(order)]), digest_size=8).hexdigest()
    # the alternative ahead by the best guess is always the left one: it stays ahead if the tutor
    # cannot tell
    elicitation = Elicitation(
        comparator,
        fingerprint,
        max_queries=max_queries,
        known=known,
        undecided=Verdict.BETTER,
        labels=None if labels is None else [str(x) for x in labels],
    )
    return Choosing(
        rows, elicitation, bool(order), [str(x) for x in (range(n) if names is None else names)]
    )


def _check_labels(labels: Sequence[str] | None, n: int, k: int) -> None:
    """Raise ValueError unless ``labels`` is None or k names.

    If there are n of them, the error says that the alternatives' names go into ``names``.
    """
    if n != k and is_list(labels, n):
        raise ValueError(
            f"labels must be {k} names, one a level, worst first, but there are {n}, one for each "
            "of the vectors: pass "
            "the names of alternatives as names="
        )
    require(
        labels is None or is_list(labels, k),
        "labels",
        f"None or {k} names, one a level, worst first",
        labels,
    )


class Choosing:
    """A choice under way, as ``choose`` returns it. Holds no tutor, file or clock."""

    def __init__(
        self, vectors: Floats, elicitation: Elicitation, order: bool, names: list[str]
    ) -> None:
        n = len(vectors)
        self._vectors = vectors
        self._wants_order = order
        self._names = names
        self._elicitation = elicitation
        self._verdicts = np.full((n, n), Verdict.UNKNOWN, dtype=np.int8)  # so far
        self._finality = np.zeros(
            (n, n), dtype=np.int8
        )  # 0: not with all that is known now; 1: so; 2: for good
        self._standing = list(
            range(n)
        )  # best of: those not beaten so far, in the order of the list
        self._learns = True  # False for a comparator that answers teach nothing
        self._guessed = 0  # comparisons that depend on the best guess, once the budget is spent
        self._ranking: list[int] = []
        self._pair = (
            0,
            0,
        )  # the rows that the query is about; the first is ahead by the best guess
        self._advance()

    def ask(self) -> tuple[Query, ...]:
        """Return the pending query, the same one until it is answered; () when finished."""
        return self._elicitation.ask()

    @property
    def comparator(self) -> Comparator:
        """The comparator with all answers learned so far."""
        return self._elicitation.comparator

    def tell(
        self, answers: Sequence[Answer], on_conflict: OnConflict = "raise"
    ) -> tuple[Answer, ...]:
        """Take the answer to the pending query, and return dropped answers.

        If the tutor cannot tell, the vector with the higher estimate stays ahead.

        Raises StaleAnswer if no such query is pending (see ``query.match``), and
        InconsistentAnswers if the answer contradicts earlier ones. Then nothing has changed. With
        ``on_conflict="drop"`` a contradicting answer decides its own pair only, and is returned.
        """
        before = self._elicitation
        never_change = (self._vectors, before.comparator, before.answers)
        after = deepcopy(self, {id(value): value for value in never_change})
        told, dropped = after._elicitation.tell(answers, on_conflict)
        for verdict in told.values():
            if after._elicitation.cannot_tell == before.cannot_tell and not dropped:
                after._learns = after._elicitation.comparator is not before.comparator
            if after._learns:
                after._finality[after._finality == 1] = 0
            i, j = np.array([after._pair]).T
            after._enter(i, j, np.array([verdict], np.int8), np.zeros(1, np.int8))
            after._advance()
            vars(self).update(vars(after))  # only now: all went well
        return dropped

    def result(self) -> Choice:
        """Return the choice; before the end, the choice by the best guess at the scale so far."""
        asked = self._elicitation
        tied = Status.CALLED_EQUAL if asked.called_equal else Status.DONE
        status = Status.UNSURE if asked.unsure or asked.cannot_tell else tied
        if asked.pending or self._guessed:
            status = Status.WAITING if asked.pending else Status.GUESSED
        counts = dict(zip((tier.name.lower() for tier in Tier), asked.counts.tolist(), strict=True))
        counts["tutor"] -= asked.cannot_tell
        counts["guess"] = self._guessed
        return Choice(
            best=self._ranking[0],
            order=tuple(self._ranking) if self._wants_order else None,
            name=self._names[self._ranking[0]],
            status=status,
            asked=asked.asked,
            cannot_tell=asked.cannot_tell,
            decided={name: count for name, count in counts.items() if count},
            comparator=asked.comparator,
            answers=asked.answers,
            guarantee=partial(_loses_at_most, self._vectors, self._ranking[0], asked.comparator),
        )

    def _advance(self) -> None:
        """Rank the vectors, and open the next question.

        Comparisons that the answers do not decide follow the best guess. If there are none, or the
        question budget is spent, no question is opened.
        """
        scores = dot(tail_sums(self._vectors), np.diff(best_guess(self._elicitation.comparator)))
        by_guess = np.argsort(-scores, kind="stable")
        plan = self._plan_order if self._wants_order else self._plan_best
        while True:
            self._ranking, guessed, candidates = plan(by_guess)
            if not guessed or self._elicitation.spent:
                self._guessed = guessed
                return
            # if no answer teaches anything, the order of the search is best: each of its steps
            # halves the rest
            ahead, other = self._most_open(candidates) if self._learns else candidates[0].tolist()
            self._finality[ahead, other] = (
                0  # another pair of the same difference may have been answered
            )
            if self._decide([ahead], other)[0] == Verdict.UNKNOWN:
                break
        self._pair = ahead, other
        about = f"{self._names[ahead]} or {self._names[other]}"
        self._elicitation.open([Pair(self._vectors[ahead], self._vectors[other], about)])

    def _plan_best(self, by_guess: _Indices) -> _Plan:
        """Return the best candidates first, the number of comparisons left, and pairs to ask about.

        A candidate is a vector to which no other is better by the answers so far. Candidates are
        sorted by estimated value. All but one of them must still lose a comparison. The pairs (n,
        2) are among the first few candidates, the better estimate first.
        """
        left: list[int] = []
        for i in self._standing:
            codes = self._decide(left, i)
            if not ((codes == Verdict.BETTER) | (codes == Verdict.EQUAL)).any():
                left = [j for j, code in zip(left, codes, strict=True) if code != Verdict.WORSE]
                left.append(i)
        self._standing = left
        standing = by_guess[np.isin(by_guess, left)]
        first, second = np.triu_indices(min(len(standing), _CONTENDERS), 1)
        return (
            standing.tolist(),
            len(standing) - 1,
            np.stack([standing[first], standing[second]], axis=1),
        )

    def _plan_order(self, by_guess: _Indices) -> _Plan:
        """Return the order of the vectors, and the number and the pairs of the comparisons guessed.

        Each vector is inserted into a sorted list. The search for its place starts at the end of
        the list where its estimate puts it, and doubles its steps. So a good estimate costs one
        comparison for each vector.
        """
        self._decide(by_guess[:-1], by_guess[1:])
        groups: list[list[int]] = []
        guessed: list[tuple[int, int]] = []
        for i in by_guess.tolist():
            low, high, step = 0, len(groups), 1
            while low < high:
                middle = max(low, high - step) if step else (low + high) // 2
                j = groups[middle][0]
                code = self._decide([j], i)[0]
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
        return (
            [i for group in groups for i in sorted(group)],
            len(guessed),
            np.array(guessed, dtype=np.intp),
        )

    def _most_open(self, pairs: _Indices) -> tuple[int, int]:
        """Return the pair for which the bounds on d.e reach about as far above 0 as below it.

        Either answer then teaches much.
        """
        low, high = bounds_of(
            self._elicitation.comparator, self._vectors[pairs[:, 0]] - self._vectors[pairs[:, 1]]
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.minimum(high, -low) / (high - low)
        ahead, other = pairs[int(np.argmax(np.nan_to_num(share, nan=0.5)))].tolist()
        return ahead, other

    def _enter(
        self, i: _Indices, j: _Indices, verdicts: NDArray[np.int8], finality: NDArray[np.int8]
    ) -> None:
        """Store verdicts (n,) on rows i (n,) against rows j (n,), and the opposite on j and i."""
        self._verdicts[i, j], self._finality[i, j], self._finality[j, i] = (
            verdicts,
            finality,
            finality,
        )
        self._verdicts[j, i] = np.where(verdicts == Verdict.UNKNOWN, verdicts, -verdicts)

    def _decide(self, ahead: ArrayLike, other: ArrayLike) -> NDArray[np.int8]:
        """Return verdicts (n,) on rows ``ahead`` (n,) against rows ``other`` (n,) or one row.

        A verdict of the comparator is final, and so is a tie. Any other answer of the tutor counts
        until the comparator decides the pair.
        """
        a, b = np.broadcast_arrays(
            np.asarray(ahead, dtype=np.intp), np.asarray(other, dtype=np.intp)
        )
        stale = self._finality[a, b] == 0
        if stale.any():
            i, j = a[stale], b[stale]
            d = self._vectors[i] - self._vectors[j]
            verdicts, tiers = self._elicitation.decide(d)
            verdicts[tiers == Tier.GUESS] = (
                Verdict.UNKNOWN
            )  # all guesses together go by one order, without circles
            has_verdict = verdicts != Verdict.UNKNOWN
            first = has_verdict & (self._verdicts[i, j] == Verdict.UNKNOWN)
            self._elicitation.commit(d[first], Decisions(verdicts[first], tiers[first]))
            final = has_verdict & ((tiers != Tier.KNOWN) | (verdicts == Verdict.EQUAL))
            self._enter(i, j, verdicts, np.where(final, 2, 1).astype(np.int8))
        found: NDArray[np.int8] = self._verdicts[a, b]
        return found


def _loses_at_most(vectors: Floats, best: int, comparator: Comparator) -> tuple[float, float]:
    """Return a bound on how much better another of the vectors (n, k) is, and its confidence."""
    high, confidence = simultaneous_bounds(
        comparator, np.delete(vectors, best, axis=0) - vectors[best]
    )
    return max(0.0, float(high.max(initial=0.0))), float(confidence)
