"""Randomness that can be indexed: one 64-bit key, and a stateless hash of (key, counters).

``fold(key, a, b, ...)`` is the finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014)
applied once per counter. Numbers drawn this way do not depend on the order of drawing, so two
runs that share a key share their exploration and their transitions (common random numbers).
"""

from __future__ import annotations

import hashlib
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Seed: TypeAlias = int | np.integer[Any] | np.random.SeedSequence | np.random.Generator

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_U27, _U30, _U31, _U11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)
_UNIT = 2.0**-53


def key_of(seed: Seed) -> int:
    """The 64-bit key of a seed: an int, a numpy SeedSequence, or a Generator (one draw of it)."""
    if isinstance(seed, np.random.Generator):
        return int(seed.integers(0, 2**64, dtype=np.uint64))
    if isinstance(seed, np.random.SeedSequence):
        return int(seed.generate_state(1, np.uint64)[0])
    if isinstance(seed, (int, np.integer)) and not isinstance(seed, bool) and seed >= 0:
        return int(np.random.SeedSequence(int(seed)).generate_state(1, np.uint64)[0])
    raise TypeError(f"a seed must be a non-negative int, a numpy SeedSequence or a Generator, not {seed!r}")


def fold(key: Any, *counters: ArrayLike) -> NDArray[np.uint64]:
    """Hash (key, counters) to 64 bits; counters are integers or arrays that broadcast."""
    h = np.asarray(key, dtype=np.uint64)
    with np.errstate(over="ignore"):
        for counter in counters:
            c = np.asarray(counter).astype(np.uint64)
            z = h + (c + np.uint64(1)) * GOLDEN
            z = (z ^ (z >> _U30)) * _MIX1
            z = (z ^ (z >> _U27)) * _MIX2
            h = z ^ (z >> _U31)
    return h


def uniform(h: NDArray[np.uint64]) -> NDArray[np.float64]:
    """The hash as a number in [0, 1) with 53 random bits."""
    return (h >> _U11).astype(np.float64) * _UNIT


def name_code(name: str) -> int:
    """A 64-bit number for a name, so that a purpose ("transitions") can be a counter."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little")


def unordered_pairs(key: Any, t: NDArray[np.float64]) -> tuple[NDArray[np.int8], NDArray[np.uint64]]:
    """For pairs given by their tail sums t (n, p): which way round each is (n,), +1 or -1 (0 where t = 0),
    and a hash (n,) of (key, the unordered pair): t and -t get the same."""
    first = (t != 0).argmax(axis=1)
    orientation = np.sign(t[np.arange(len(t)), first]).astype(np.int8)
    # adding 0.0 turns -0.0 into 0.0, whose bits differ
    canonical = np.ascontiguousarray(t * orientation[:, None] + 0.0).view(np.uint64)
    entries = fold(fold(key, np.arange(t.shape[1])), canonical)
    return orientation, fold(key, np.add.reduce(entries, axis=1))
