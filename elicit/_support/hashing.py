"""Random numbers without a stream: each is a hash of a 64-bit key and of counters.

``fold(key, a, b, ...)`` is the finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014) applied
once per counter. Numbers drawn this way do not depend on the order of drawing. So two runs with the
same key explore alike and see the same transitions (common random numbers). ``mix`` and ``unit`` do
the same as ``fold`` and ``uniform``, one number at a time, for compiled code.
"""

import hashlib
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.jit import compiled

Seed: TypeAlias = int | np.integer[Any] | np.random.SeedSequence | np.random.Generator

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_ONE = np.uint64(1)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)


def key_of(seed: Seed) -> int:
    """Return the 64-bit key of a seed: an int, a SeedSequence, or a Generator (drawn from once)."""
    if isinstance(seed, np.random.Generator):
        return int(seed.integers(0, 2**64, dtype=np.uint64))
    if isinstance(seed, np.random.SeedSequence):
        return int(seed.generate_state(1, np.uint64)[0])
    if isinstance(seed, (int, np.integer)) and not isinstance(seed, bool) and seed >= 0:
        return int(np.random.SeedSequence(int(seed)).generate_state(1, np.uint64)[0])
    raise TypeError(
        f"a seed must be a non-negative int, a numpy SeedSequence or a Generator, not {seed!r}"
    )


def name_code(name: str) -> int:
    """Return a 64-bit number for a name, so that a purpose ("transitions") can be a counter."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little")


def _round(h: Any, counter: Any) -> Any:
    z = h + (np.uint64(counter) + _ONE) * _GOLDEN
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    return z ^ (z >> _S31)


def uniform(h: Any) -> Any:
    """Return hashes as numbers in [0, 1) with 53 random bits."""
    return (h >> _S11) * 2.0**-53


mix = compiled(_round)
"""A single round of ``fold``: the hash of (h, counter), both unsigned 64-bit numbers."""
unit = compiled(uniform)
"""``uniform`` of one hash."""


def fold(key: Any, *counters: ArrayLike) -> NDArray[np.uint64]:
    """Return a 64-bit hash of the key and counters, which are integers or arrays that broadcast."""
    h = np.asarray(key, dtype=np.uint64)
    with np.errstate(over="ignore"):
        for counter in counters:
            h = np.asarray(_round(h, np.asarray(counter).astype(np.uint64)))
    return h
