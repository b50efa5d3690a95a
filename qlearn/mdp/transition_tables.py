"""Transition tables of several shapes, converted to the one that ``OrdinalMDP`` stores.

That is CSR (S*A, S), with row s*A + a for (s, a).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from elicit.model.scale import Floats
from qlearn.mdp import array_checks as checks
from qlearn.mdp.array_checks import Flags, Indices

Matrix: TypeAlias = sparse.sparray | sparse.spmatrix


def from_dense(transitions: ArrayLike) -> sparse.csr_array:
    """Return the table for a dense array (S, A, S) of p(s, a, s')."""
    table = checks.numbers("transitions", transitions)
    if table.ndim != 3 or table.shape[0] != table.shape[2] or 0 in table.shape:
        by_action = table.ndim == 3 and table.shape[1] == table.shape[2]
        advice = ": of (A, S, S) give transitions.transpose(1, 0, 2)" if by_action else ""
        raise ValueError(f"transitions must have shape (S, A, S), not {table.shape}{advice}")
    n, m, _ = table.shape
    return sparse.csr_array(table.reshape(n * m, n))


def from_sparse(transitions: Matrix | Sequence[Matrix]) -> sparse.csr_array:
    """Return the table for a single matrix (S*A, S), or for A matrices (S, S)."""
    if sparse.issparse(transitions):
        matrix = _csr("transitions", transitions)
        if 0 in matrix.shape or matrix.shape[0] % matrix.shape[1]:
            raise ValueError(f"transitions must have shape (S*A, S), not {matrix.shape}")
        return matrix
    each = [_csr(f"transitions[{a}]", part) for a, part in enumerate(transitions)]
    m, n = len(each), each[0].shape[0] if each else 0
    wrong = next((a for a, part in enumerate(each) if part.shape != (n, n)), None)
    if n == 0 or wrong is not None:
        raise ValueError(
            "transitions must be a sparse matrix (S*A, S), or a sequence of A square ones (S, S), "
            + ("not empty" if wrong is None else f"but transitions[{wrong}] is {each[wrong].shape}")
        )
    return sparse.vstack(each, format="csr")[np.arange(n * m).reshape(m, n).T.ravel()]


def from_pairs(
    levels: ArrayLike,
    transitions: Matrix | ArrayLike,
    s_indices: ArrayLike,
    a_indices: ArrayLike,
    k: int,
) -> tuple[sparse.csr_array, Indices, Flags]:
    """Return the table of L state-action pairs, the levels (S, A), and flags (S, A) of the pairs.

    There are k levels. A flag says whether the pair is listed.
    """
    if not sparse.issparse(transitions):
        transitions = checks.numbers("transitions", transitions)
        if transitions.ndim != 2:
            raise ValueError(
                f"transitions must have shape (L, S), one row a pair, not {transitions.shape}"
            )
        transitions = sparse.csr_array(transitions)
    matrix = _csr("transitions", transitions)
    count, n = matrix.shape
    if 0 in matrix.shape:
        raise ValueError(f"transitions must have shape (L, S), each at least 1, not {matrix.shape}")
    state = checks.indices("s_indices", s_indices, (count,), n)
    action = checks.indices("a_indices", a_indices, (count,), 2**31 - 1)
    level = checks.indices("levels", levels, (count,), k)
    m = int(action.max()) + 1
    place = state.astype(np.int64) * m + action
    first = np.unique(place, return_index=True)[1]
    if len(first) < count:
        row = int(np.setdiff1d(np.arange(count), first)[0])
        raise ValueError(
            f"pair {row} is (state {state[row]}, action {action[row]}), which came before: list it "
            "once"
        )
    admissible, table_of_levels = np.zeros(n * m, dtype=np.bool_), np.zeros(n * m, dtype=np.int32)
    admissible[place], table_of_levels[place] = True, level
    rows = np.repeat(place, np.diff(matrix.indptr))
    full = sparse.csr_array((matrix.data, (rows, matrix.indices)), shape=(n * m, n))
    return full, table_of_levels.reshape(n, m), admissible.reshape(n, m)


def padded(matrix: sparse.csr_array, read: Flags) -> tuple[Indices, Floats]:
    """Return the non-zero entries of a table as successors and probabilities (S, A, b).

    b is the number of entries of the longest row, and the rest of a row is 0. Rows that are not
    flagged in ``read`` (S, A) are all 0.
    """
    p = np.where(np.repeat(read.ravel(), np.diff(matrix.indptr)), matrix.data, 0.0)
    matrix = sparse.csr_array((p, matrix.indices, matrix.indptr), shape=matrix.shape, copy=True)
    matrix.eliminate_zeros()
    counts = np.diff(matrix.indptr)
    b = max(1, int(counts.max()))
    successors, probabilities = (
        np.zeros((*read.shape, b), dtype=np.int32),
        np.zeros((*read.shape, b)),
    )
    filled = (np.arange(b) < counts[:, None]).reshape(successors.shape)
    successors[filled], probabilities[filled] = matrix.indices, matrix.data
    successors.flags.writeable = probabilities.flags.writeable = False  # handed over, not copied
    return successors, probabilities


def _csr(name: str, matrix: Matrix) -> sparse.csr_array:
    """Return a sparse matrix as canonical CSR. The given matrix is not changed."""
    if not sparse.issparse(matrix) or matrix.ndim != 2:
        raise ValueError(f"{name} must be a SciPy sparse matrix, not {type(matrix).__name__}")
    csr = sparse.csr_array(matrix, dtype=np.float64)
    if not csr.has_canonical_format:
        csr = csr.copy()
        csr.sum_duplicates()
    return csr
