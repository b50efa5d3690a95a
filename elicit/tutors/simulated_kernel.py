"""A simulated tutor as plain arrays, which answers pairs in compiled code.

It also serves as the baseline that asks the tutor about everything: millions of answers, none of
which is kept.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import mix, unit
from elicit._support.jit import compiled
from elicit.lp.rounding import rounding_of
from elicit.model.difference_kernel import LEFT_OPEN, pair_code, way_round
from elicit.model.scale import Floats

NOBODY, TRUTHFUL, FLIPPING, LOGISTIC = range(4)
GIVEN, WRONG, PAIRS = (
    0,
    1,
    2,
)  # the entries of a tally: answers, wrong ones, different pairs asked about


class Respondent(NamedTuple):
    """A simulated tutor: its hidden scale, the law of its errors, and counts of pairs asked."""

    kind: int
    gaps: Floats  # (p,)
    rate: float  # FLIPPING: share of errors; LOGISTIC: precision, logits per unit of d.e
    tie: float  # the largest |d.e| that is called equal; LOGISTIC: Rao and Kupper's width
    key: Any  # np.uint64, the key of the errors
    pairs: NDArray[np.uint64]  # (c,) hash table of the pairs' hashes, 0 where it is free
    times: NDArray[np.int64]  # (c,)
    tally: NDArray[np.int64]  # (3,)


def nobody() -> Respondent:
    """Return a Respondent to be passed to loops that never ask it."""
    pairs, times = np.empty(0, np.uint64), np.empty(0, np.int64)
    return Respondent(
        NOBODY, np.empty(0), 0.0, 0.0, np.uint64(0), pairs, times, np.zeros(3, np.int64)
    )


@compiled
def truth(t: Any, g: Any) -> tuple[int, float]:
    """Return the sign and the size of t.g, for tail sums t (p,) and gaps g (p,).

    The sign is LEFT_OPEN if floats cannot tell it, because the sum is too near to 0 or too large.
    """
    at, size = 0.0, 0.0
    for j in range(len(t)):
        part = t[j] * g[j]
        at += part
        size += abs(part)
    doubt = rounding_of(len(t), size)
    if at > doubt:
        return 1, at
    if at < -doubt:
        return -1, -at
    return LEFT_OPEN, 0.0


@compiled
def place_of(code: Any, pairs: Any) -> int:
    """Return the place of a pair's hash in the hash table, or the free place for it."""
    last = len(pairs) - 1  # the length is a power of two
    i = np.int64(code & np.uint64(last))
    while pairs[i] != code and pairs[i] != np.uint64(0):
        i = (i + 1) & last
    return int(i)


@compiled
def rehash(pairs: Any, times: Any, into: Any, count: Any) -> None:
    """Copy the entries of a hash table (c,) into a larger one."""
    for i in range(len(pairs)):
        if pairs[i] != np.uint64(0):
            place = place_of(pairs[i], into)
            into[place], count[place] = pairs[i], times[i]


@compiled
def chance(size: float, precision: float) -> float:
    """Return the probability of an error on a pair with |d.e| = ``size``.

    It is 1 / (1 + exp(precision * size)). If the tutor has ties, the caller has added their width
    to ``size``.
    """
    return 1.0 / (1.0 + math.exp(max(min(precision * size, 700.0), -700.0)))


@compiled
def answer(t: Any, sign: int, size: float, tutor: Respondent) -> int:
    """Return the tutor's answer on a pair with tail sums t (p,), and count it.

    ``sign`` and ``size`` are those of d.e. The table must have room for another pair.
    """
    tutor.tally[GIVEN] += 1
    if tutor.kind == TRUTHFUL:
        return sign if size > tutor.tie else 0
    code = pair_code(tutor.key, t)
    i = place_of(code, tutor.pairs)
    if tutor.pairs[i] == np.uint64(0):
        tutor.pairs[i] = code
        tutor.tally[PAIRS] += 1
    u = unit(mix(code, tutor.times[i]))
    tutor.times[i] += 1
    if (
        sign == 0
    ):  # no answer is wrong; the logistic law tosses a coin unless the two vectors are identical
        if tutor.kind == FLIPPING:
            return 0
        either = chance(tutor.tie, tutor.rate)
        return way_round(t) * (1 if u < either else -1 if u < 2.0 * either else 0)
    if tutor.kind == FLIPPING and size <= tutor.tie:
        return 0
    if u < (tutor.rate if tutor.kind == FLIPPING else chance(size + tutor.tie, tutor.rate)):
        tutor.tally[WRONG] += 1
        return -sign
    if tutor.kind == LOGISTIC and tutor.tie > 0.0 and u < chance(size - tutor.tie, tutor.rate):
        return 0
    return sign


@compiled
def respond(t: Any, tutor: Respondent) -> int:
    """Return the tutor's answer on a pair with tail sums t (p,), or LEFT_OPEN.

    It is LEFT_OPEN, and nothing is counted, if the truth needs exact arithmetic or the table is
    full.
    """
    sign, size = truth(t, tutor.gaps)
    if sign == LEFT_OPEN or 2 * tutor.tally[PAIRS] > len(tutor.pairs):
        return LEFT_OPEN
    if tutor.kind == TRUTHFUL:  # quicker than handing the whole tutor on
        tutor.tally[GIVEN] += 1
        return sign if size > tutor.tie else 0
    return answer(t, sign, size, tutor)


@compiled
def respond_all(t: Any, first: int, answers: Any, tutor: Respondent) -> int:
    """Write the tutor's answers (n,) on pairs with tail sums t (n, p), beginning at row ``first``.

    It stops at the first row that ``respond`` leaves LEFT_OPEN. Return that row, or n.
    """
    for i in range(first, len(t)):
        said = respond(t[i], tutor)
        if said == LEFT_OPEN:
            return i
        answers[i] = said
    return len(t)
