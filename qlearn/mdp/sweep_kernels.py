"""Sweeps over the states of large MDPs, in code that numba can compile.

Each sum has SciPy's order, so results are the same to the last bit, compiled or not. What is gained
is time: the values of successors are fetched ahead. Successors and their places are unsigned
numbers, because signed ones are checked for being negative.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from elicit._support.jit import compiled_beside
from elicit._support.prefetch import prefetch

# successors between the one whose value is fetched and the one that is added; with 32 a sweep of
# single values at a million states takes a fifth longer, without fetching more than twice as long
_AHEAD = 64

# Rows between the one whose transitions are fetched and the one that is swept. A policy's rows lie
# apart in memory, where a processor does not foresee them. With 4 or 16 in place of 8, a sweep of
# single values takes as long; without fetching, 1.8 times as long (300,000 states).
_ROWS_AHEAD = 8
_A_LINE = np.uint64(8)  # probabilities in a cache line


def sweep_together(
    first: int,
    rows: Any,
    ends: Any,
    successors: Any,
    probabilities: Any,
    gain: Any,
    discount: Any,
    v: Any,
    new: Any,
) -> None:
    """Write the result of ``sweep_rows``, with a product of sparse matrices."""
    some = slice(first, first + len(new))
    chain = _matrix(ends, successors, probabilities, len(v))[rows[some]]
    new[:] = chain.astype(v.dtype, copy=False) @ v
    new *= discount
    new += gain[some]


@compiled_beside(sweep_together, unlocked=True)
def sweep_rows(
    first: int,
    rows: Any,
    ends: Any,
    successors: Any,
    probabilities: Any,
    gain: Any,
    discount: Any,
    v: Any,
    new: Any,
) -> None:
    """Write gain (S, c) plus discounted v (S, c) of the successors into new (n, c).

    The first of the n states is ``first``. State s has the transitions of row ``rows[s]``. All is
    computed in the precision of v and ``discount``.
    """
    n, c = new.shape
    total = np.empty(c, v.dtype)
    for i in range(n):
        s = first + i
        if i + _ROWS_AHEAD < n:
            far = rows[s + _ROWS_AHEAD]
            for at in range(np.uint64(ends[far]), np.uint64(ends[far + 1]), _A_LINE):
                prefetch(successors, at)
                prefetch(probabilities, at)
        start, end = np.uint64(ends[rows[s]]), np.uint64(ends[rows[s] + 1])
        # the successors of the next state are fetched while this one's are added
        ahead, last = end, end
        if i + 1 < n:
            ahead, last = np.uint64(ends[rows[s + 1]]), np.uint64(ends[rows[s + 1] + 1])
        for j in range(c):
            total[j] = 0.0
        for at in range(start, end):
            if ahead < last:
                prefetch(v, successors[ahead])
                ahead += np.uint64(1)
            t, p = successors[at], v.dtype.type(probabilities[at])
            for j in range(c):
                total[j] += p * v[t, j]
        for j in range(c):
            new[i, j] = total[j] * discount + gain[s, j]


def products_together(
    first: int, ends: Any, successors: Any, probabilities: Any, v: Any, needed: Any, found: Any
) -> None:
    """Write the result of ``products``, with a product of sparse matrices."""
    m = found.shape[1]
    matrix = _matrix(ends, successors, probabilities, len(v))
    found[:] = 0.0
    found[needed] = matrix[np.flatnonzero(needed.reshape(-1)) + first * m] @ v


@compiled_beside(products_together, unlocked=True)
def products(
    first: int, ends: Any, successors: Any, probabilities: Any, v: Any, needed: Any, found: Any
) -> None:
    """Write the mean v (S,) of the successors of needed (n, A) actions into found (n, A).

    The first of the n states is ``first``. The mean is 0 where it is not needed.
    """
    n, m = found.shape
    ahead = np.uint64(min(_AHEAD, len(successors)))
    last = np.uint64(len(successors)) - ahead
    for i in range(n):
        for a in range(m):
            total = 0.0
            if needed[i, a]:
                row = (first + i) * m + a
                for at in range(np.uint64(ends[row]), np.uint64(ends[row + 1])):
                    if at < last:
                        prefetch(v, successors[at + ahead])
                    total += probabilities[at] * v[successors[at]]
            found[i, a] = total


def _matrix(ends: Any, successors: Any, probabilities: Any, states: int) -> sparse.csr_array:
    columns = successors.view(f"i{successors.itemsize}")
    return sparse.csr_array((probabilities, columns, ends), shape=(len(ends) - 1, states))
