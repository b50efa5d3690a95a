"""Linear algebra whose sums have a fixed order, so that results are the same on every processor.

A BLAS library chooses its code by the processor, and with it the order of each sum. So the last
bits of its results differ from machine to machine. If a question is chosen by such a number,
another machine may ask another question, and then every later question differs. Numbers that choose
questions are therefore computed here, element by element and without fused multiply-adds.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.jit import compiled_beside, expect

Floats = NDArray[np.float64]


def product(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the matrix product of a (n, p) or (p,) and b (p, m) or (p,).

    The sum over p goes from the first to the last for a matrix b. For a vector b it is NumPy's
    pairwise sum.
    """
    left, right = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if right.ndim == 1:
        return np.asarray((left * right).sum(axis=-1))
    rows = np.ascontiguousarray(np.atleast_2d(left))
    out = np.zeros((len(rows), right.shape[1]))
    expect(_product_into, 1e-7 * out.size * len(right))
    _product_into(rows, np.ascontiguousarray(right), out)
    return out if left.ndim == 2 else out[0]


def _product_of_arrays(a: Floats, b: Floats, out: Floats) -> None:
    """Add ``a @ b`` to ``out``, one row of b at a time.

    NumPy does the work here until ``_product_into`` is compiled.
    """
    for j in range(len(b)):
        out += a[:, j, None] * b[j]


@compiled_beside(_product_of_arrays)
def _product_into(a: Any, b: Any, out: Any) -> None:
    """Add ``a @ b`` to ``out`` (n, m), in the order of the rows of b."""
    n, p = a.shape
    m = b.shape[1]
    whole = p - p % 4
    for i in range(n):
        row = out[i]
        for j in range(0, whole, 4):  # four at a time, each sum in order
            a0, a1, a2, a3 = a[i, j], a[i, j + 1], a[i, j + 2], a[i, j + 3]
            b0, b1, b2, b3 = b[j], b[j + 1], b[j + 2], b[j + 3]
            for q in range(m):
                row[q] = row[q] + a0 * b0[q] + a1 * b1[q] + a2 * b2[q] + a3 * b3[q]
        for j in range(whole, p):
            by, other = a[i, j], b[j]
            for q in range(m):
                row[q] += by * other[q]


def sums_to_zero(p: int) -> Floats:
    """Return an orthonormal basis (p, p - 1) of the vectors that sum to 0 (Helmert's basis)."""
    basis = np.zeros((p, p - 1))
    for j in range(1, p):
        size = np.sqrt(j * (j + 1.0))
        basis[:j, j - 1] = 1.0 / size
        basis[j, j - 1] = -j / size
    return basis


def null_basis(rows: Floats, tolerance: float = 1e-12) -> Floats:
    """Return an orthonormal basis (p, q) of the vectors orthogonal to all rows (m, p).

    A row counts as a combination of earlier rows if its part orthogonal to them is no longer than
    ``tolerance`` times the largest row.
    """
    p = rows.shape[1]
    size = np.sqrt((rows * rows).sum(axis=1).max(initial=0.0))
    span: list[Floats] = []
    for row in rows:
        rest = _orthogonal_to(span, row)
        length = float(np.sqrt((rest * rest).sum()))
        if length > tolerance * size:
            span.append(rest / length)
    basis: list[Floats] = []
    units = np.eye(p)
    while len(span) + len(basis) < p:
        both = span + basis
        left = [_orthogonal_to(both, unit) for unit in units]
        sizes = np.array([(rest * rest).sum() for rest in left])
        rest = left[int(np.argmax(sizes))]
        rest = _orthogonal_to(both, rest)
        basis.append(rest / np.sqrt((rest * rest).sum()))
    return np.array(basis).reshape(-1, p).T


def _orthogonal_to(span: list[Floats], x: Floats) -> Floats:
    """Return the part of x (p,) that is orthogonal to the orthonormal vectors ``span``.

    The method is Gram and Schmidt's, applied twice for accuracy.
    """
    for _ in range(2):
        for unit in span:
            x = x - (x * unit).sum() * unit
    return x


class LeastSquares:
    """The factors of a matrix (m, q), m >= q, for least squares.

    The factorisation is Householder's QR, with columns and rows sorted by size. No diagonal entry
    of the triangle is below ``least`` times the largest: smaller ones are raised to that.
    """

    def __init__(self, matrix: Floats, least: float = 1e-13) -> None:
        m, q = matrix.shape
        # rows of very different sizes are factored stably where the largest come first (Powell and
        # Reid 1969)
        self._rows = np.argsort(-np.abs(matrix).max(axis=1), kind="stable")
        work = matrix[self._rows]
        self._columns = np.arange(q)
        self._reflections: list[tuple[Floats, float]] = []
        for j in range(min(q, m)):
            sizes = (work[j:, j:] * work[j:, j:]).sum(axis=0)
            best = j + int(np.argmax(sizes))
            if best != j:
                work[:, [j, best]] = work[:, [best, j]]
                self._columns[[j, best]] = self._columns[[best, j]]
            normal = work[j:, j].copy()
            length = float(np.sqrt((normal * normal).sum()))
            if length == 0.0:
                break
            normal[0] += length if normal[0] >= 0 else -length
            scale = 2.0 / float((normal * normal).sum())
            work[j:, j:] -= scale * normal[:, None] * (normal[:, None] * work[j:, j:]).sum(axis=0)
            self._reflections.append((normal, scale))
        upper = np.zeros((q, q))
        upper[: min(m, q)] = np.triu(work[:q])
        floor = least * float(np.abs(np.diag(upper)).max(initial=0.0))
        for j in range(q):
            if abs(upper[j, j]) <= floor:
                upper[j, j] = floor or 1.0
        self._upper = upper

    def solve(self, target: Floats) -> Floats:
        """Return the x (q,) for which matrix @ x is nearest to ``target`` (m,)."""
        b = target[self._rows].astype(np.float64)
        for j, (normal, scale) in enumerate(self._reflections):
            b[j:] -= scale * float((normal * b[j:]).sum()) * normal
        q = len(self._upper)
        wanted = np.zeros(q)
        wanted[: min(q, len(b))] = b[:q]
        x = np.empty(q)
        x[self._columns] = self._back(wanted[:, None])[:, 0]
        return x

    @property
    def shape(self) -> Floats:
        """The inverse (q, q) of the triangular factor, rows in the order of the matrix columns.

        Its product with its own transpose is the inverse of ``matrix.T @ matrix``.
        """
        out = np.empty_like(self._upper)
        out[self._columns] = self._back(np.eye(len(self._upper)))
        return out

    def _back(self, b: Floats) -> Floats:
        """Solve the triangular system for each column of b (q, c)."""
        x = b.copy()
        for j in reversed(range(len(x))):
            x[j] /= self._upper[j, j]
            x[:j] -= self._upper[:j, j, None] * x[j]
        return x


def principal_axes(matrix: Floats) -> Floats:
    """Return orthonormal eigenvectors of a symmetric matrix (p, p), as columns.

    The method is Jacobi's rotations.
    """
    a, p = matrix.copy(), len(matrix)
    axes = np.eye(p)
    for _ in range(30):
        off = np.abs(np.triu(a, 1))
        if off.max(initial=0.0) <= 1e-12 * np.abs(np.diag(a)).max(initial=0.0):
            break
        for i in range(p - 1):
            for j in range(i + 1, p):
                if a[i, j] == 0.0:
                    continue
                ratio = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
                tangent = (1.0 if ratio >= 0 else -1.0) / (
                    abs(ratio) + np.sqrt(ratio * ratio + 1.0)
                )
                cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
                sine = tangent * cosine
                for x in (a, axes):
                    first, second = x[:, i].copy(), x[:, j].copy()
                    x[:, i], x[:, j] = (
                        cosine * first - sine * second,
                        sine * first + cosine * second,
                    )
                first, second = a[i].copy(), a[j].copy()
                a[i], a[j] = cosine * first - sine * second, sine * first + cosine * second
    return axes
