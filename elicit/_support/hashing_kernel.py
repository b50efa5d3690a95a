"""The rounds of ``elicit._support.hashing.fold`` one number at a time, in code that numba can compile."""

from __future__ import annotations

from typing import Any

import numpy as np

from elicit._support.jit import compiled

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_ONE = np.uint64(1)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)


@compiled
def mix(h: Any, counter: Any) -> Any:
    """One round of ``fold`` on unsigned 64-bit numbers."""
    z = h + (np.uint64(counter) + _ONE) * _GOLDEN
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    return z ^ (z >> _S31)


@compiled
def unit(h: Any) -> float:
    """A hash as a number in [0, 1)."""
    return float(h >> _S11) * 2.0**-53


@compiled
def pair_code(key: Any, t: Any, work: Any) -> Any:
    """The hash of ``seeds.unordered_pairs`` for one pair, by its tail sums t (p,): t and -t get the same.
    ``work`` (p,) is written in."""
    sign = 0.0
    for j in range(len(t)):
        if t[j] != 0.0 and sign == 0.0:
            sign = 1.0 if t[j] > 0.0 else -1.0
        work[j] = t[j] * sign + 0.0  # adding 0.0 turns -0.0 into 0.0
    bits = work.view(np.uint64)
    total = np.uint64(0)
    for j in range(len(t)):
        total += mix(mix(key, np.uint64(j)), bits[j])
    return mix(key, total)
