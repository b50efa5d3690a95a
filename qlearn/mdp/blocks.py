"""Sweeps over the states of an MDP in blocks, on as many threads as there are cores.

A state's result depends only on the values of the last sweep. So blocks may be swept in any order,
and by any number of threads, with the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from scipy import sparse

from elicit._support.threads import cores

T = TypeVar("T")

# products of numbers that make a thread of its own worth while: some milliseconds of work
_WORTH_A_THREAD = 4_000_000


def in_blocks(sweep: Callable[[int, int], T], states: int, products: int) -> list[T]:
    """Sweep all states, in as many blocks as there are cores if there is enough to do.

    SciPy's products and NumPy's arithmetic let other threads run meanwhile.

    Parameters
    ----------
    sweep : function (first, last)
        Sweeps the states from ``first`` up to ``last``, which is excluded.
    states : int
    products : int
        Number of products that all states need, over all blocks.

    Returns
    -------
    list
        The result of each block, in order.
    """
    jobs = max(1, min(cores(), products // _WORTH_A_THREAD, states))
    edges = [states * i // jobs for i in range(jobs + 1)]
    if jobs == 1:
        return [sweep(0, states)]
    with ThreadPoolExecutor(jobs) as pool:  # waits for all, even if interrupted
        return list(pool.map(sweep, edges[:-1], edges[1:]))


def some_rows(matrix: Any, first: int, last: int) -> sparse.csr_array:
    """Return rows ``first`` up to ``last`` of a sparse matrix (CSR), without copying entries."""
    if last - first == matrix.shape[0]:
        return matrix
    start, end = matrix.indptr[first], matrix.indptr[last]
    return sparse.csr_array(
        (
            matrix.data[start:end],
            matrix.indices[start:end],
            matrix.indptr[first : last + 1] - start,
        ),
        shape=(last - first, matrix.shape[1]),
    )
