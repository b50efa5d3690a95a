"""Simulated tutors, truthful or erring.

A simulated tutor holds a hidden scale. Its errors depend only on its seed, on the pair, and on how
often that pair was asked before. They do not depend on other questions or their order, nor on which
vector came first. So runs that ask different questions still meet the same tutor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import expit

from elicit._support import jit
from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.seeds import seed_of
from elicit._support.validation import is_number, require
from elicit.model.comparator import check_tie
from elicit.model.difference import as_vectors, tail_sums
from elicit.model.difference_kernel import LEFT_OPEN
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats, exact_dot, gaps, normalise
from elicit.tutors import simulated_kernel as kernel
from elicit.tutors.simulated_kernel import Respondent

Signs = NDArray[np.int8]
_PURPOSE = name_code("errors of a simulated tutor")


class _Simulated:
    """Base class of simulated tutors, with a hidden scale, exact truth, errors, and counts.

    For each time that a pair is asked, an erring tutor draws a number in [0, 1). The answer is
    wrong if the number is below the error probability.
    """

    _kind = kernel.TRUTHFUL
    _rate_name = ""  # of the error law's parameter

    def __init__(
        self, values: ArrayLike, seed: Seed | None = 0, rate: float = 0.0, tie: float = 0.0
    ) -> None:
        self._e = normalise(values)
        self._g = gaps(values)
        self.seed = seed_of(seed)  # that makes the same errors again
        self._key = np.uint64(fold(key_of(self.seed), _PURPOSE))
        self._pairs, self._times = np.zeros(1024, np.uint64), np.zeros(1024, np.int64)
        self._tally = np.zeros(3, dtype=np.int64)
        self._rate = rate  # the parameter of the error law
        self.tie = check_tie(tie)

    def __repr__(self) -> str:
        errors = f", {self._rate_name}={self._rate:g}, seed={self.seed}" if self._rate_name else ""
        return (
            f"{type(self).__name__}(k={self.k}{errors}{f', tie={self.tie:g}' if self.tie else ''})"
        )

    @property
    def k(self) -> int:
        """Number of levels."""
        return len(self._g) + 1

    @property
    def values(self) -> Floats:
        """The hidden scale (k,), from 0 to 1."""
        return self._e.copy()

    @property
    def realised_error_rate(self) -> float:
        """Wrong answers as a share of all answers given so far; nan before the first.

        If two vectors are exactly equal, calling one of them better is not wrong.
        """
        given, wrong = int(self._tally[kernel.GIVEN]), int(self._tally[kernel.WRONG])
        return wrong / given if given else float("nan")

    def __call__(self, query: Query) -> Answer:
        """Return the answer to a query. Raises ValueError if it is not about k levels."""
        return Answer(query, Verdict(int(self.signs(query.d)[0])))

    def signs(self, d: ArrayLike) -> Signs:
        """Return answers (n,) int8 in {-1, 0, +1} to questions about d (n, k), in order.

        They are the same as those of n calls, but computed faster. Raises ValueError for a wrong
        shape or numbers that are not finite.
        """
        t = np.ascontiguousarray(tail_sums(as_vectors(d, self.k)))
        answers = np.empty(len(t), dtype=np.int8)
        jit.expect(kernel.respond_all, 1e-5 * t.size)
        with np.errstate(all="ignore"):  # the hash wraps around
            row = kernel.respond_all(t, 0, answers, self._respondent())
            while row < len(t):
                answers[row] = kernel.answer(t[row], *_truth(t[row], self._g), self._respondent())
                row = kernel.respond_all(t, row + 1, answers, self._respondent())
        return answers

    @property
    def respondent(self) -> Respondent:
        """Return the tutor as plain arrays for compiled loops.

        Answers that a loop takes from the arrays are counted by this tutor. If a loop has stopped
        with LEFT_OPEN, get the arrays again for the next one. The result is ``nobody()`` for a
        class that answers in its own way.
        """
        kind = type(self)
        ours = (
            kind.signs is _Simulated.signs
            and kind.__call__ is _Simulated.__call__
            and "signs" not in vars(self)
        )
        return self._respondent() if ours else kernel.nobody()

    def _respondent(self) -> Respondent:
        while 2 * int(self._tally[kernel.PAIRS]) >= len(
            self._pairs
        ):  # the table must stay half empty
            pairs, times = (
                np.zeros(2 * len(self._pairs), np.uint64),
                np.zeros(2 * len(self._pairs), np.int64),
            )
            kernel.rehash(self._pairs, self._times, pairs, times)
            self._pairs, self._times = pairs, times
        return Respondent(
            self._kind,
            self._g,
            self._rate,
            self.tie,
            self._key,
            self._pairs,
            self._times,
            self._tally,
        )


class TruthfulTutor(_Simulated):
    """A tutor that never errs: it answers the exact sign of d.e.

    The sign is that of the product of the floats ``tail_sums(d)`` and ``gaps(values)`` in rational
    arithmetic.

    Parameters
    ----------
    values : (k,)
        The hidden scale, increasing, in any unit.
    tie : float
        Largest |d.e|, a share of the value range, that is answered EQUAL. It is at least 0 and
        below 1. Default: 0, only exact ties.

    Raises
    ------
    ValueError
        If the values do not increase, or ``tie`` is out of range.
    """

    def __init__(self, values: ArrayLike, tie: float = 0.0) -> None:
        super().__init__(values, tie=tie)


class FlippingTutor(_Simulated):
    """A tutor that gives the opposite of the truth at a fixed rate, however clear the case is.

    Parameters
    ----------
    values : (k,)
        The hidden scale, increasing, in any unit.
    error_rate : float
        Probability of the opposite answer, in [0, 1].
    seed : int, SeedSequence, Generator or None
        Draws the errors. None: a new seed.
    tie : float
        Largest |d.e|, a share of the value range, that is answered EQUAL (see ``TruthfulTutor``).
        "Equal" has no opposite, so such answers are always right.

    Raises
    ------
    ValueError
        If the values do not increase, or the error rate is outside [0, 1].
    """

    _kind = kernel.FLIPPING
    _rate_name = "error_rate"

    def __init__(
        self, values: ArrayLike, error_rate: float, seed: Seed | None = 0, tie: float = 0.0
    ) -> None:
        require(is_number(error_rate, 0, 1), "error_rate", "a number between 0 and 1", error_rate)
        self.error_rate = float(error_rate)
        super().__init__(values, seed, self.error_rate, tie)

    @classmethod
    def from_error_rate(
        cls, values: ArrayLike, rate: float, reference: ArrayLike, seed: Seed | None = 0
    ) -> FlippingTutor:
        """Return a tutor with a given expected error rate on reference differences.

        Exact ties among them cannot be answered wrongly, and the rate of errors on others is raised
        to make up for that.

        Parameters
        ----------
        values : (k,)
            The hidden scale, increasing, in any unit.
        rate : float
            The expected share of wrong answers, above 0 and below 1/2.
        reference : (n, k)
            Differences left - right.
        seed : int, SeedSequence, Generator or None
            Draws the errors. None: a new seed.

        Returns
        -------
        FlippingTutor

        Raises
        ------
        ValueError
            Unless 0 < rate < 1/2 and such a rate exists. At most half of the differences that are
            no ties can be answered wrongly.
        """
        size = _reference_sizes(values, rate, reference)
        return cls(values, rate / float(np.mean(size > 0)), seed)


class BradleyTerryTutor(_Simulated):
    """A tutor that errs more often the closer two vectors are, by the paper's eq. (6).

    It says "left is better" with probability 1 / (1 + exp(-precision * d.e)). So answers about near
    ties are often wrong, and those about clear cases rarely. The share of wrong answers also
    depends on how large |d.e| is in the questions. ``from_error_rate`` finds the precision that
    gives a wanted share.

    Parameters
    ----------
    values : (k,)
        The hidden scale, increasing, in any unit.
    precision : float
        The paper's c, at least 0, in logits per unit of d.e, for a scale from 0 to 1.
    seed : int, SeedSequence, Generator or None
        Draws the errors. None: a new seed.
    tie : float
        With a tie w > 0 the tutor follows Rao and Kupper (1967). It says "left" with probability 1
        / (1 + exp(-precision * (d.e - w))), "right" likewise, and EQUAL otherwise. With w = 0 it
        says EQUAL only of identical vectors. Of two others with d.e = 0 it chooses one by a coin
        toss.

    Raises
    ------
    ValueError
        If the values do not increase, or the precision is negative.
    """

    _kind = kernel.LOGISTIC
    _rate_name = "precision"

    def __init__(
        self, values: ArrayLike, precision: float, seed: Seed | None = 0, tie: float = 0.0
    ) -> None:
        require(is_number(precision, 0), "precision", "a finite number of at least 0", precision)
        self.precision = float(precision)
        super().__init__(values, seed, self.precision, tie)

    def expected_error_rate(self, reference: ArrayLike) -> float:
        """Return the expected share of wrong answers on reference differences.

        The tutor is taken to call nothing equal. Answers to exact ties count as right.

        Parameters
        ----------
        reference : (n, k)
            Differences left - right.

        Returns
        -------
        float
            From 0 to 1/2.
        """
        size = _sizes(self._g, reference)
        return float(np.where(size > 0, expit(-self.precision * size), 0.0).mean())

    @classmethod
    def from_error_rate(
        cls, values: ArrayLike, rate: float, reference: ArrayLike, seed: Seed | None = 0
    ) -> BradleyTerryTutor:
        """Return the tutor with a given expected error rate on reference differences.

        Answers to exact ties count as right.

        Parameters
        ----------
        values : (k,)
            The hidden scale, increasing, in any unit.
        rate : float
            The expected share of wrong answers, above 0 and below 1/2.
        reference : (n, k)
            Differences left - right.
        seed : int, SeedSequence, Generator or None
            Draws the errors. None: a new seed.

        Returns
        -------
        BradleyTerryTutor

        Raises
        ------
        ValueError
            Unless 0 < rate < 1/2 and some precision gives that rate.
        """
        size = _reference_sizes(values, rate, reference)

        def excess(precision: float) -> float:
            return float(np.where(size > 0, expit(-precision * size), 0.0).mean()) - rate

        low = high = 1.0 / float(size.max())
        while excess(high) > 0:
            low, high = high, high * 2.0
            if high > 1e300:
                raise ValueError(
                    f"no precision brings the error rate over this reference down to {rate}"
                )
        while excess(low) < 0:
            low, high = low / 2.0, low
        return cls(values, brentq(excess, low, high, xtol=1e-14 * low), seed)


def _truth(t: Floats, g: Floats) -> tuple[int, float]:
    """Return the exact sign of t.g, for tail sums t (p,) and gaps g (p,), and |t.g| in floats.

    The latter is 0 only at an exact tie.
    """
    sign, size = kernel.truth(t, g)
    if sign != LEFT_OPEN:
        return sign, size
    exact = exact_dot(t, g)
    return (exact > 0) - (exact < 0), max(abs(float(exact)), 5e-324) if exact else 0.0


def _reference_sizes(values: ArrayLike, rate: float, reference: ArrayLike) -> Floats:
    """Return |d.e| (n,) of the reference differences, after a check that the rate is possible."""
    if not (is_number(rate) and 0 < rate < 0.5):
        raise ValueError(f"an error rate must lie strictly between 0 and 1/2, not {rate!r}")
    size = _sizes(gaps(values), reference)
    share = float(np.mean(size > 0)) if len(size) else 0.0
    if rate >= share / 2:
        raise ValueError(
            f"only {share:.0%} of the {len(size)} reference differences are no ties, and half of "
            "those can be "
            f"answered wrongly at most: give an error rate below {share / 2:g}, not {rate}, or "
            "another reference"
        )
    return size


def _sizes(g: Floats, reference: ArrayLike) -> Floats:
    """Return |d.e| (n,) of differences (n, k), for a scale with gaps g (p,)."""
    t = np.ascontiguousarray(tail_sums(as_vectors(reference, len(g) + 1, name="reference")))
    return np.array([_truth(row, g)[1] for row in t])
