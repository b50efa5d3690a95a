"""An OrdinalMDP's arrays from tables of other shapes: dense, sparse, or a list of state-action pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from elicit.model.scale import Floats
from qlearn.mdp import array_checks as rows

Matrix: TypeAlias = sparse.sparray | sparse.spmatrix
Fields: TypeAlias = dict[str, Any]
"""The arguments of ``OrdinalMDP``."""


def dense(
    transitions: ArrayLike,
    levels: ArrayLike,
    discount: float,
    labels: Sequence[str],
    initial: ArrayLike | None,
    terminal: ArrayLike | None,
    admissible: ArrayLike | None,
) -> Fields:
    """From a table (S, A, S) of p(s, a, s')."""
    table = rows.numbers("transitions", transitions)
    if table.ndim != 3 or table.shape[0] != table.shape[2] or 0 in table.shape:
        raise ValueError(f"transitions must have shape (S, A, S), not {table.shape}")
    n, m, _ = table.shape
    ends = rows.flags("terminal", terminal, (n,), default=False)
    offered = rows.flags("admissible", admissible, (n, m), default=True)
    used = (table != 0) & (offered & ~ends[:, None])[:, :, None]
    counts = np.count_nonzero(used, axis=2).ravel()
    _, _, successor = np.nonzero(used)
    padded = _padded(counts, successor, table[used], (n, m))
    return padded | {
        "levels": np.asarray(levels),
        "discount": discount,
        "labels": labels,
        "initial": initial,
        "terminal": ends,
        "admissible": offered,
    }


def sparse_rows(
    transitions: Matrix | Sequence[Matrix],
    levels: ArrayLike,
    discount: float,
    labels: Sequence[str],
    initial: ArrayLike | None,
    terminal: ArrayLike | None,
    admissible: ArrayLike | None,
) -> Fields:
    """From one matrix (S*A, S), or A of them (S, S)."""
    if sparse.issparse(transitions):
        matrix = _csr("transitions", transitions)
        n = matrix.shape[1]
        m = matrix.shape[0] // max(n, 1)
        if 0 in matrix.shape or matrix.shape[0] != n * m:
            raise ValueError(f"transitions must have shape (S*A, S), not {matrix.shape}")
    else:
        each = [_csr(f"transitions[{a}]", part) for a, part in enumerate(transitions)]
        m, n = len(each), each[0].shape[0] if each else 0
        wrong = next((a for a, part in enumerate(each) if part.shape != (n, n)), None)
        if n == 0 or wrong is not None:
            raise ValueError(
                "transitions must be a sparse matrix (S*A, S), or a sequence of A square ones (S, S), "
                + ("not empty" if wrong is None else f"but transitions[{wrong}] is {each[wrong].shape}")
            )
        by_action = sparse.vstack(each, format="csr")
        matrix = by_action[np.arange(n * m).reshape(m, n).T.ravel()]
    ends = rows.flags("terminal", terminal, (n,), default=False)
    offered = rows.flags("admissible", admissible, (n, m), default=True)
    read = (offered & ~ends[:, None]).ravel()
    counts, successor, p = _entries(matrix, read)
    return _padded(counts, successor, p, (n, m)) | {
        "levels": np.asarray(levels),
        "discount": discount,
        "labels": labels,
        "initial": initial,
        "terminal": ends,
        "admissible": offered,
    }


def pairs(
    levels: ArrayLike,
    transitions: Matrix | ArrayLike,
    s_indices: ArrayLike,
    a_indices: ArrayLike,
    discount: float,
    labels: Sequence[str],
    initial: ArrayLike | None,
    terminal: ArrayLike | None,
) -> Fields:
    """From L state-action pairs."""
    if sparse.issparse(transitions):
        matrix = _csr("transitions", transitions)
    else:
        table = rows.numbers("transitions", transitions)
        if table.ndim != 2:
            raise ValueError(f"transitions must have shape (L, S), one row a pair, not {table.shape}")
        matrix = sparse.csr_array(table)
    count, n = matrix.shape
    if 0 in matrix.shape:
        raise ValueError(f"transitions must have shape (L, S), each at least 1, not {matrix.shape}")
    state = _index("s_indices", s_indices, count, n)
    action = _index("a_indices", a_indices, count, 2**31 - 1)
    level = rows.integers("levels", rows.numbers("levels", levels, (count,), whole=True))
    rows.reject("levels", level, (level < 0) | (level >= len(labels)), f"must be in 0..{len(labels) - 1}")
    m = int(action.max()) + 1
    place = state.astype(np.int64) * m + action
    order = np.argsort(place, kind="stable")
    twice = np.flatnonzero(np.diff(place[order]) == 0)
    if len(twice):
        row = int(order[twice[0] + 1])
        raise ValueError(f"pair {row} is (state {state[row]}, action {action[row]}), which came before: list it once")
    offered, table_of_levels = np.zeros(n * m, dtype=np.bool_), np.zeros(n * m, dtype=np.int32)
    offered[place], table_of_levels[place] = True, level
    ends = rows.flags("terminal", terminal, (n,), default=False)
    counts_of_pairs, successor, p = _entries(matrix[order], ~ends[state[order]])
    counts = np.zeros(n * m, dtype=np.int64)
    counts[place[order]] = counts_of_pairs
    return _padded(counts, successor, p, (n, m)) | {
        "levels": table_of_levels.reshape(n, m),
        "discount": discount,
        "labels": labels,
        "initial": initial,
        "terminal": ends,
        "admissible": offered.reshape(n, m),
    }


def _csr(name: str, matrix: Matrix) -> sparse.csr_array:
    """A sparse matrix as canonical CSR without zeros, itself unchanged."""
    if not sparse.issparse(matrix) or matrix.ndim != 2:
        raise ValueError(f"{name} must be a SciPy sparse matrix, not {type(matrix).__name__}")
    csr = sparse.csr_array(matrix, dtype=np.float64)
    if not csr.has_canonical_format:
        csr = csr.copy()
        csr.sum_duplicates()
    return csr


def _entries(matrix: sparse.csr_array, read: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[Any], Floats]:
    """How many entries that are not zero each row has, and these: their columns and values; none of a row that is
    not ``read``."""
    counts = np.diff(matrix.indptr)
    used = (matrix.data != 0) & np.repeat(read, counts)
    if used.all():
        return counts.astype(np.int64), matrix.indices, matrix.data
    owner = np.repeat(np.arange(len(counts)), counts)[used]
    return np.bincount(owner, minlength=len(counts)), matrix.indices[used], matrix.data[used]


def _padded(counts: NDArray[Any], successor: NDArray[Any], p: Floats, shape: tuple[int, int]) -> Fields:
    """Rows of these lengths, laid end to end, as arrays (S, A, b)."""
    b = max(1, int(counts.max()))
    full = (*shape, b)
    successors, probabilities = np.zeros(full, dtype=np.int32), np.zeros(full)
    if len(p) == probabilities.size:
        successors.reshape(-1)[:], probabilities.reshape(-1)[:] = successor, p
    else:
        slot = np.arange(len(p)) - np.repeat(np.cumsum(counts) - counts, counts)
        at = np.repeat(np.arange(len(counts)) * b, counts) + slot
        successors.reshape(-1)[at], probabilities.reshape(-1)[at] = successor, p
    successors.flags.writeable = probabilities.flags.writeable = False  # handed over, not copied
    return {"successors": successors, "probabilities": probabilities}


def _index(name: str, given: ArrayLike, count: int, most: int) -> NDArray[np.int32]:
    index = rows.integers(name, rows.numbers(name, given, (count,), whole=True))
    rows.reject(name, index, (index < 0) | (index >= most), f"must be in 0..{most - 1}")
    return index
