"""A simulated tutor as plain arrays, answering one pair at a time, in code that numba can compile.

For the oracle that is asked about everything: millions of answers, none of which is kept.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing_kernel import mix, pair_code, unit
from elicit._support.jit import compiled
from elicit.lp.sign import UNSETTLED
from elicit.model.scale import Floats

NOBODY, TRUTHFUL, FLIPPING, LOGISTIC = range(4)
GIVEN, WRONG, PAIRS = 0, 1, 2  # what a tally counts: answers, wrong ones, different pairs asked about


class Respondent(NamedTuple):
    """A hidden scale, the law of the errors, and how often each pair was asked about."""

    kind: int
    gaps: Floats  # (p,)
    slack: float  # times sum |t_j g_j|: nearer to 0, the sign needs exact arithmetic
    rate: float  # FLIPPING: of errors; LOGISTIC: precision, logits per unit of d.e
    key: Any  # np.uint64, of the errors
    pairs: NDArray[np.uint64]  # (c,) hash table of the pairs' hashes, 0 where it is free
    times: NDArray[np.int64]  # (c,)
    tally: NDArray[np.int64]  # (3,)


def nobody() -> Respondent:
    """One who is not asked."""
    pairs, times = np.empty(0, np.uint64), np.empty(0, np.int64)
    return Respondent(NOBODY, np.empty(0), 0.0, 0.0, np.uint64(0), pairs, times, np.zeros(3, np.int64))


@compiled
def place_of(code: Any, pairs: Any) -> int:
    """Where a pair's hash is in the table, or the free place where it belongs."""
    last = len(pairs) - 1  # the length is a power of two
    i = np.int64(code & np.uint64(last))
    while pairs[i] != code and pairs[i] != np.uint64(0):
        i = (i + 1) & last
    return int(i)


@compiled
def asked_before(code: Any, pairs: Any, times: Any, tally: Any) -> int:
    """How often a pair was asked about before, counting this time."""
    i = place_of(code, pairs)
    if pairs[i] == np.uint64(0):
        pairs[i] = code
        tally[PAIRS] += 1
    times[i] += 1
    return int(times[i]) - 1


@compiled
def all_asked_before(codes: Any, pairs: Any, times: Any, tally: Any, before: Any) -> None:
    """``asked_before`` of codes (n,) in order, into the last argument (n,)."""
    for i in range(len(codes)):
        before[i] = asked_before(codes[i], pairs, times, tally)


@compiled
def rehash(pairs: Any, times: Any, into: Any, count: Any) -> None:
    """Enter a table (c,) in another with more room."""
    for i in range(len(pairs)):
        if pairs[i] != np.uint64(0):
            place = place_of(pairs[i], into)
            into[place], count[place] = pairs[i], times[i]


@compiled
def chance(size: float, precision: float) -> float:
    """Of a logistic error: 1 / (1 + exp(precision |d.e|))."""
    return 1.0 / (1.0 + math.exp(min(precision * size, 700.0)))


@compiled
def respond(t: Any, work: Any, tutor: Respondent) -> int:
    """The answer to a pair with tail sums t (p,), which are not all 0; UNSETTLED, and nothing counted, where the
    truth needs exact arithmetic or the table room. ``work`` (p,) is written in."""
    at, size = 0.0, 0.0
    for j in range(len(t)):
        part = t[j] * tutor.gaps[j]
        at += part
        size += abs(part)
    doubt = tutor.slack * size + 2.0**-1000
    if not (at > doubt or at < -doubt) or 2 * tutor.tally[PAIRS] > len(tutor.pairs):
        return UNSETTLED
    answer = 1 if at > 0.0 else -1
    tutor.tally[GIVEN] += 1
    if tutor.kind == TRUTHFUL:
        return answer
    code = pair_code(tutor.key, t, work)
    before = asked_before(code, tutor.pairs, tutor.times, tutor.tally)
    if unit(mix(code, before)) < (tutor.rate if tutor.kind == FLIPPING else chance(abs(at), tutor.rate)):
        tutor.tally[WRONG] += 1
        return -answer
    return answer
