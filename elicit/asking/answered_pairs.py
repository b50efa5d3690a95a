"""What the tutor has said of which pairs: a pair is known by its difference, wherever and whichever way round it was
compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import pair_code, pair_codes
from elicit.model.comparator import Tier
from elicit.model.scale import Floats, tail_sums

Codes = NDArray[np.uint64]


class AnsweredPairs:
    """Answers by pair. Hashes find them, for compiled loops too; where one is to be given again, the pair itself
    confirms it."""

    def __init__(self, key: np.uint64) -> None:
        self.codes: Codes = np.empty(0, np.uint64)  # sorted: all pairs that were answered
        self.binding: Codes = np.empty(0, np.uint64)  # sorted: those whose answer no model may overrule
        self._key = key
        self._said: dict[bytes, int] = {}  # in the pair's canonical direction
        self._bound: set[bytes] = set()  # of these pairs, the binding ones

    def add(self, d: Floats, verdict: int, *, binding: bool) -> None:
        """Keep what was said of a difference d (k,)."""
        t = tail_sums(d)
        name, sign = _name(t)
        self._said[name] = sign * verdict
        with np.errstate(over="ignore"):  # the hash wraps around
            code = pair_code(self._key, t, np.empty(len(t)))
        self.codes = _with(self.codes, code)
        if binding:
            self._bound.add(name)
            self.binding = _with(self.binding, code)

    def settle(
        self,
        d: Floats,
        verdicts: NDArray[np.int8],
        tiers: NDArray[np.int8],
        rows: NDArray[np.intp],
        *,
        binding: bool = False,
    ) -> NDArray[np.intp]:
        """Enter in verdicts (n,) and tiers (n,) what was said of those ``rows`` of d (n, k) whose very pair was
        answered before (or only what binds); returns the others."""
        t, names = tail_sums(d[rows]), self._bound if binding else self._said
        left = np.ones(len(rows), dtype=np.bool_)
        for i in np.flatnonzero(self._among(t, self.binding if binding else self.codes)):
            name, sign = _name(t[i])
            if name in names:
                verdicts[rows[i]], tiers[rows[i]] = sign * self._said[name], Tier.KNOWN
                left[i] = False
        return rows[left]

    def has(self, d: Floats) -> NDArray[np.bool_]:
        """Which of the differences d (n, k) were answered before, going by their hashes."""
        return self._among(tail_sums(d), self.codes)

    def _among(self, t: Floats, codes: Codes) -> NDArray[np.bool_]:
        """Whether the hashes of tail sums t (n, p) are among sorted ``codes``."""
        if not len(codes):
            return np.zeros(len(t), dtype=np.bool_)
        wanted = pair_codes(self._key, t)
        found: NDArray[np.bool_] = codes[np.searchsorted(codes[:-1], wanted)] == wanted
        return found


def first_of_each_pair(d: Floats, most: int) -> list[int]:
    """The first rows of d (n, k) that are about different pairs, at most so many."""
    chosen: dict[bytes, int] = {}
    for row, t in enumerate(tail_sums(d)):
        if len(chosen) == most:
            break
        chosen.setdefault(_name(t)[0], row)
    return list(chosen.values())


def _name(t: Floats) -> tuple[bytes, int]:
    """A pair's bytes in its canonical direction (first non-zero tail sum positive), and whether it was turned."""
    lead = t[np.flatnonzero(t)[0]] if t.any() else 1.0
    sign = 1 if lead > 0 else -1
    return (sign * t + 0.0).tobytes(), sign


def _with(codes: Codes, code: np.uint64) -> Codes:
    """Sorted codes, with one more."""
    at = int(np.searchsorted(codes, code))
    return np.concatenate([codes[:at], np.array([code], np.uint64), codes[at:]])
