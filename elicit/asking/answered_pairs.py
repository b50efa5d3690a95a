"""What the tutor has said of which pairs: a pair is known by its difference, wherever and whichever way round it was
compared."""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import pair_codes
from elicit.model.comparator import Verdicts
from elicit.model.query import Verdict
from elicit.model.scale import Floats, pair_name, pair_names, tail_sums

Codes = NDArray[np.uint64]


class AnsweredPairs:
    """Answers by pair. Hashes find them, for compiled loops too; where one is to be given again, the pair itself
    confirms it."""

    def __init__(self, key: np.uint64) -> None:
        self.codes: Codes = np.empty(0, np.uint64)  # sorted: all pairs that were answered
        self.binding: Codes = np.empty(0, np.uint64)  # sorted: those whose answer no model may overrule
        self._key = key
        self._said: dict[bytes, int] = {}  # in the pair's canonical direction

    def copy(self) -> "AnsweredPairs":
        """Return a copy, which more can be added to while this one stays as it is."""
        other = copy(self)
        other._said = dict(self._said)
        return other

    def add(self, d: Floats, verdict: int, *, binding: bool) -> None:
        """Keep what was said of a difference d (k,)."""
        t = tail_sums(d)
        name, sign = pair_name(t)
        self._said[name] = sign * verdict
        code = pair_codes(self._key, t[None, :])[0]
        self.codes = np.insert(self.codes, np.searchsorted(self.codes, code), code)
        if binding:
            self.binding = np.insert(self.binding, np.searchsorted(self.binding, code), code)

    def add_many(self, d: Floats, verdicts: Verdicts) -> None:
        """Keep what was said (n,) of differences d (n, k); what was called equal is binding."""
        t = tail_sums(d)
        signs, names = pair_names(t)
        self._said.update(zip(names, (signs * verdicts).tolist(), strict=True))
        codes = pair_codes(self._key, t)
        self.codes = np.sort(np.concatenate([self.codes, codes]))
        self.binding = np.sort(np.concatenate([self.binding, codes[verdicts == Verdict.EQUAL]]))

    def said(self, t: Floats) -> Verdicts:
        """What was said (n,) of the very pairs with tail sums t (n, p), whichever way round; UNKNOWN: nothing."""
        out = np.full(len(t), Verdict.UNKNOWN, np.int8)
        if len(self.codes):
            wanted = pair_codes(self._key, t)
            for i in np.flatnonzero(self.codes[np.searchsorted(self.codes[:-1], wanted)] == wanted):
                name, sign = pair_name(t[i])
                out[i] = sign * self._said[name] if name in self._said else Verdict.UNKNOWN
        return out


def first_of_each_pair(d: Floats, most: int) -> list[int]:
    """The first rows of d (n, k) that are about different pairs, at most so many."""
    chosen: dict[bytes, int] = {}
    for row, t in enumerate(tail_sums(d)):
        if len(chosen) == most:
            break
        chosen.setdefault(pair_name(t)[0], row)
    return list(chosen.values())
