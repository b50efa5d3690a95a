"""Tutors: whatever answers a Query. Simulated ones, truthful or erring, and one that replays a log.

A simulated tutor holds a hidden scale. Its errors are a function of its seed, of the unordered pair
and of how often that pair was asked before: not of what else was asked, nor in which order, nor of
which vector came first. So runs that ask different questions still meet the same tutor.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import expit

from elicit._support.hashing import Seed, fold, key_of, name_code, uniform, unordered_pairs
from elicit._support.validation import is_number, require
from elicit.lp.sign import UNSETTLED
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats, as_vectors, dot, gaps, normalise, tail_sums
from elicit.tutors.answer_log import Entry
from elicit.tutors.simulated_kernel import (
    FLIPPING,
    GIVEN,
    LOGISTIC,
    NOBODY,
    PAIRS,
    TRUTHFUL,
    WRONG,
    Respondent,
    all_asked_before,
    chance,
    nobody,
    rehash,
    respond,
)

Signs = NDArray[np.int8]
_PURPOSE = name_code("errors of a simulated tutor")
_BETTER, _WORSE = Verdict.BETTER, Verdict.WORSE


class NotInLog(LookupError):
    """A replayed log holds no answer to this query."""


@runtime_checkable
class Tutor(Protocol):
    """Answers queries. It sees only the query: no comparator, no learner, no problem."""

    def __call__(self, query: Query) -> Answer:
        """The answer to this query; its verdict is None where the tutor cannot tell."""


class _Simulated:
    """The hidden scale, the exact truth about a pair, and the count of errors made."""

    def __init__(self, values: ArrayLike) -> None:
        self._e = normalise(values)
        self._g = gaps(values)
        self._g_down: list[float] = self._g[::-1].tolist()  # best level first, as tail sums run
        self._slack = _slack(len(self._g))
        self._tally = np.zeros(3, dtype=np.int64)

    @property
    def k(self) -> int:
        """Number of levels."""
        return len(self._g) + 1

    @property
    def values(self) -> Floats:
        """(k,) the hidden scale, from 0 to 1."""
        return self._e.copy()

    @property
    def realised_error_rate(self) -> float:
        """Wrong answers as a share of all answers given so far; nan before the first. To call either of
        two exactly equal vectors better is not wrong."""
        return int(self._tally[WRONG]) / int(self._tally[GIVEN]) if self._tally[GIVEN] else float("nan")

    def __call__(self, query: Query) -> Answer:
        """The answer to one query. Raises ValueError if it is not about k levels."""
        tutor = self.respondent
        if tutor.kind != NOBODY and len(query.left) == self.k:
            t = tail_sums(query.d)
            if t.any():
                with np.errstate(all="ignore"):  # the hash wraps around
                    said = respond(t, np.empty(len(t)), tutor)
                if said != UNSETTLED:
                    return Answer(query, Verdict(said))
        return Answer(query, Verdict(int(self.signs(query.d)[0])))

    def signs(self, d: ArrayLike) -> Signs:
        """Answers (n,) int8 in {-1, 0, +1} to differences d (n, k), in order; each row counts as one asking.

        The same as n calls, but faster. Raises ValueError on a wrong shape or numbers that are not finite.
        """
        t = tail_sums(as_vectors(d, self.k))
        truth, size = _exact_signs(t, self._g)
        answers = self._answer(t, truth, size)
        self._tally[GIVEN] += len(t)
        self._tally[WRONG] += int(np.count_nonzero(answers * truth < 0))
        return answers

    @property
    def respondent(self) -> Respondent:
        """The tutor as plain arrays, for compiled loops; what it says there is counted here. Ask for it anew
        whenever it has come back UNSETTLED. Nobody, for a class that has ``signs`` of its own."""
        if type(self).signs is not _Simulated.signs:
            return nobody()
        return nobody()._replace(kind=TRUTHFUL, gaps=self._g, slack=self._slack, tally=self._tally)

    def _answer(self, t: Floats, truth: Signs, size: Floats) -> Signs:
        return truth


class TruthfulTutor(_Simulated):
    """Always right: answers the exact sign of d.e, 0 (EQUAL) on an exact tie.

    values (k,) is the hidden scale, increasing, in any unit. Exact means: for the float numbers
    ``tail_sums(d)`` and ``gaps(values)``, the sign of their product in rational arithmetic.
    Raises ValueError unless the values increase.
    """

    def __call__(self, query: Query) -> Answer:
        """The answer to one query. Raises ValueError if it is not about k levels."""
        d = query.d.tolist()
        if len(d) == len(self._g_down) + 1:
            total = tail = size = 0.0
            for gap in self._g_down:
                tail += d.pop()
                part = tail * gap
                total += part
                size += abs(part)
            slack = self._slack * size + _TINY
            # False also where something overflowed; `signs` copes with that
            if total > slack or -total > slack:
                self._tally[GIVEN] += 1
                return Answer(query, _BETTER if total > 0 else _WORSE)
        return super().__call__(query)


class _Erring(_Simulated):
    """Draws one number in [0, 1) for each asking of a pair: an error where it is below the error probability."""

    def __init__(self, values: ArrayLike, seed: Seed) -> None:
        super().__init__(values)
        self._key = fold(key_of(seed), _PURPOSE)
        self._pairs, self._times = np.zeros(1024, np.uint64), np.zeros(1024, np.int64)

    @property
    def respondent(self) -> Respondent:
        """The tutor as plain arrays, for compiled loops; what it says there is counted here. Ask for it anew
        whenever it has come back UNSETTLED."""
        truthful, (kind, rate) = super().respondent, self._law
        if truthful.kind == NOBODY:
            return truthful
        return truthful._replace(kind=kind, rate=rate, key=np.uint64(self._key), pairs=self._pairs, times=self._times)

    def _answer(self, t: Floats, truth: Signs, size: Floats) -> Signs:
        orientation, pairs = unordered_pairs(self._key, t)
        before = np.empty(len(t), dtype=np.int64)
        self._make_room(len(t))
        all_asked_before(pairs, self._pairs, self._times, self._tally, before)
        u = uniform(fold(pairs, before))
        y: Signs = np.where(u < self._error_probability(size), -truth, truth).astype(np.int8)
        tie = (truth == 0) & self._tosses_ties
        y[tie] = (orientation * np.where(u < 0.5, 1, -1))[tie]
        return y

    def _make_room(self, more: int) -> None:
        """Double the table until it can take so many more pairs and stay half empty."""
        while 2 * (int(self._tally[PAIRS]) + more) > len(self._pairs):
            pairs, times = np.zeros(2 * len(self._pairs), np.uint64), np.zeros(2 * len(self._pairs), np.int64)
            rehash(self._pairs, self._times, pairs, times)
            self._pairs, self._times = pairs, times

    _tosses_ties = False

    @property
    def _law(self) -> tuple[int, float]:
        """The kind of errors, and their parameter."""
        raise NotImplementedError

    def _error_probability(self, size: Floats) -> Floats | float:
        raise NotImplementedError


class FlippingTutor(_Erring):
    """Gives the opposite of the truth with probability ``error_rate``, however clear the case is.

    values (k,) increasing, in any unit; error_rate in [0, 1]; seed an int, SeedSequence or Generator.
    An exact tie has no opposite: it is answered EQUAL. Raises ValueError on values that do not
    increase and on an error rate outside [0, 1].
    """

    def __init__(self, values: ArrayLike, error_rate: float, seed: Seed = 0) -> None:
        super().__init__(values, seed)
        require(is_number(error_rate, 0, 1), "error_rate", "a number between 0 and 1", error_rate)
        self.error_rate = float(error_rate)

    @classmethod
    def from_error_rate(cls, values: ArrayLike, rate: float, reference: ArrayLike, seed: Seed = 0) -> FlippingTutor:
        """A tutor whose expected error rate over the differences ``reference`` (n, k) is ``rate``: its
        error rate is just that, raised only to make up for exact ties among them. Raises ValueError
        unless 0 < rate < 1/2 and the reference allows it."""
        size = _reference_sizes(values, rate, reference)
        return cls(values, rate / float(np.mean(size > 0)), seed)

    @property
    def _law(self) -> tuple[int, float]:
        return FLIPPING, self.error_rate

    def _error_probability(self, size: Floats) -> float:
        return self.error_rate


class BradleyTerryTutor(_Erring):
    """Eq. (6): says left is better with probability 1 / (1 + exp(-precision * d.e)).

    values (k,) increasing, in any unit; ``precision`` >= 0 is the paper's c in logits per unit of
    d.e, with the scale normalised to 0..1; seed an int, SeedSequence or Generator. An exact tie is a
    coin toss, as eq. (6) has it; two identical vectors are EQUAL. Near ties are answered badly and
    clear cases well, so a precision says little about errors until the typical |d.e| is known: see
    ``from_error_rate``. Raises ValueError on values that do not increase and on a negative precision.
    """

    _tosses_ties = True

    def __init__(self, values: ArrayLike, precision: float, seed: Seed = 0) -> None:
        super().__init__(values, seed)
        require(is_number(precision, 0), "precision", "a finite number of at least 0", precision)
        self.precision = float(precision)

    @classmethod
    def from_error_rate(cls, values: ArrayLike, rate: float, reference: ArrayLike, seed: Seed = 0) -> BradleyTerryTutor:
        """The tutor whose expected error rate over the differences ``reference`` (n, k) is ``rate``.

        Exact ties in the reference count as answered rightly. Raises ValueError unless
        0 < rate < 1/2 and the reference allows it.
        """
        size = _reference_sizes(values, rate, reference)

        def excess(precision: float) -> float:
            return float(np.where(size > 0, expit(-precision * size), 0.0).mean()) - rate

        low = high = 1.0 / float(size.max())
        while excess(high) > 0:
            low, high = high, high * 2.0
            if high > 1e300:
                raise ValueError(f"no precision brings the error rate over this reference down to {rate}")
        while excess(low) < 0:
            low, high = low / 2.0, low
        return cls(values, brentq(excess, low, high, xtol=1e-14 * low), seed)

    @property
    def _law(self) -> tuple[int, float]:
        return LOGISTIC, self.precision

    def _error_probability(self, size: Floats) -> Floats:
        return np.array([chance(x, self.precision) for x in size.tolist()])

    def _answer(self, t: Floats, truth: Signs, size: Floats) -> Signs:
        return np.where((t == 0).all(axis=1), np.int8(0), super()._answer(t, truth, size))


class ReplayTutor:
    """Answers from a log: by query id, else by pair (the same difference to the last bit, or its opposite).

    ``log`` is an AnswerLog, or any iterable of its entries or of Answers; what was not used then is
    replayed too, what was retracted is not. A pair answered several times is replayed in the order of the
    log. The same query asked again gets the same answer again.
    """

    def __init__(self, log: Iterable[Entry | Answer]) -> None:
        kept = (entry for entry in log if not (isinstance(entry, Entry) and entry.retracted))
        self._answers = [entry.answer if isinstance(entry, Entry) else entry for entry in kept]
        self._by_id: dict[str, list[int]] = {}
        self._by_pair: dict[bytes, list[int]] = {}
        for i, answer in enumerate(self._answers):
            self._by_id.setdefault(answer.query.id, []).append(i)
            self._by_pair.setdefault(_bits(answer.query.d), []).append(i)
        self._replayed: set[int] = set()
        self._last: dict[str, int] = {}

    def __call__(self, query: Query) -> Answer:
        """The answer that the log holds. Raises NotInLog (a LookupError) where it holds none."""
        d = query.d
        same, opposite = _bits(d), _bits(-d)
        own = self._by_id.get(query.id, [])
        last = self._last.get(query.id, own[-1] if own else None)
        candidates = own
        if last is None:
            candidates = sorted({*self._by_pair.get(same, []), *self._by_pair.get(opposite, [])})
        fresh = next((i for i in candidates if i not in self._replayed), last)
        if fresh is None:
            raise NotInLog(
                f"the log has no answer to query {query.id}"
                + (f": all {len(candidates)} answers to this pair were replayed already" if candidates else "")
                + ". Its problem, seed or settings may differ from those of the recorded run; "
                "replay the run that was recorded, or put this query to a tutor and append the answer to the log"
            )
        found = self._answers[fresh]
        stored = _bits(found.query.d)
        if stored not in (same, opposite):
            raise NotInLog(
                f"the log's query {query.id} is about other vectors: left {found.query.left}, right "
                f"{found.query.right}, not left {query.left}, right {query.right}. The log is of another problem"
            )
        self._replayed.add(fresh)
        self._last[query.id] = fresh
        if stored == same:
            return Answer(query, found.verdict, found.swapped)
        return Answer(query, None if found.verdict is None else found.verdict.flipped, not found.swapped)


_TINY = 2.0**-1000


def _slack(p: int) -> float:
    """Times sum |t_j g_j|, plus _TINY for products that underflow: more than the rounding error of a float
    sum of p products, in any order (Higham 2002, section 3.1)."""
    return (p + 8) * 2.0**-52


def _exact_signs(t: Floats, g: Floats) -> tuple[Signs, Floats]:
    """The exact signs (n,) of t.g, and |t.g| (n,) in floats: 0 at a tie and nowhere else."""
    x = dot(t, g)
    signs = np.sign(x).astype(np.int8)
    size = np.abs(x)
    for i in np.flatnonzero(size <= _slack(len(g)) * dot(np.abs(t), g) + _TINY):
        exact = sum((Fraction(a) * Fraction(b) for a, b in zip(t[i].tolist(), g.tolist(), strict=True)), Fraction())
        signs[i] = (exact > 0) - (exact < 0)
        size[i] = max(abs(float(exact)), 5e-324) if exact else 0.0
    return signs, size


def _reference_sizes(values: ArrayLike, rate: float, reference: ArrayLike) -> Floats:
    """|d.e| (n,) of the reference, once it is clear that a tutor can err at this rate over it."""
    if not (is_number(rate) and 0 < rate < 0.5):
        raise ValueError(f"an error rate must lie strictly between 0 and 1/2, not {rate!r}")
    g = gaps(values)
    _, size = _exact_signs(tail_sums(as_vectors(reference, len(g) + 1, name="reference")), g)
    share = float(np.mean(size > 0)) if len(size) else 0.0
    if rate >= share / 2:
        raise ValueError(
            f"only {share:.0%} of the {len(size)} reference differences are no ties, and half of those can be "
            f"answered wrongly at most: give an error rate below {share / 2:g}, not {rate}, or another reference"
        )
    return size


def _bits(d: Floats) -> bytes:
    return (d + 0.0).tobytes()
