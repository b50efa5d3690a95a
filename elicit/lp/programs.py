"""The two linear programs of section 3.1, least and greatest d.e over K_t: Clarabel, and a readable twin.

``Programs`` is what the comparator uses: Clarabel's own interface in gap space, with new objectives
put into the same solver. ``least_cvxpy`` states the paper's program in the paper's letters; tests
hold the one to the other.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from elicit._support.jit import compiled
from elicit.lp.dual_simplex import Region, minimise, minimise_exactly, rounding
from elicit.lp.inequalities import Prior
from elicit.model.query import Answers
from elicit.model.scale import Floats

TIE_BAND = 1e-9
"""An answer "equal" means |d.e| <= TIE_BAND |d|_1."""


class Solved(NamedTuple):
    """A solver's answer to min t.g: the point g (p,) and multipliers y (m,) >= 0 of the rows, both only
    nearly right. None where the solver did not say "Solved"."""

    g: Floats
    y: Floats


class Programs:
    """min t.g over one region for many t, with one Clarabel solver whose objective is replaced."""

    def __init__(self, region: Region) -> None:
        self.region = region
        self.solves = 0
        self._solver: Any = None

    def solve(self, t: Floats) -> Solved | None:
        """Minimise t.g (t of order 1) over the region. Any status but Solved gives None."""
        region, p = self.region, self.region.p
        if self._solver is None:
            settings = clarabel.DefaultSettings()
            settings.verbose = False
            settings.presolve_enable = False  # the objective can only be replaced without it
            settings.max_threads = 1
            settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
            a = np.concatenate([np.ones((1, p)), -np.eye(p), -region.rows])
            b = np.concatenate([[1.0], np.full(p, -region.margin), -region.rhs])
            cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(p + len(region.rows))]
            no_quadratic = sparse.csc_matrix((p, p))
            self._solver = clarabel.DefaultSolver(no_quadratic, t, sparse.csc_matrix(a), b, cones, settings)
        else:
            self._solver.update(q=t)
        self.solves += 1
        solution = self._solver.solve()
        if solution.status != clarabel.SolverStatus.Solved:
            self._solver = None  # a failure must not linger in the next solve's scaling
            return None
        return Solved(np.asarray(solution.x), np.maximum(np.asarray(solution.z)[1 + p :], 0.0))

    def least(self, t: Floats, inside: Floats | None) -> float:
        """A proven lower bound on t.g over the region (t of order 1), tight to 4e-10. ``inside`` is a point
        strictly inside the region, if there is one: it turns nearly right points into right ones, whose
        t.g shows how tight the bound is. Where floats cannot show it, the exact optimum is rounded down."""
        for propose in (self.solve, self._vertex):
            found = propose(t)
            if found is None or inside is None:
                continue
            low = certified_bound(t, found.y, self.region)
            point = pull_inside(found.g, inside, self.region)
            if point is not None and float(t @ point) - low < 4e-10:
                return low
        value = minimise_exactly(t, self.region).value
        low = float(value)
        return low if low <= value else float(np.nextafter(low, -np.inf))

    def _vertex(self, t: Floats) -> Solved:
        """The same from the simplex method in floats, where Clarabel's 1e-10 is not enough."""
        vertex = minimise(t, self.region)
        return Solved(vertex.g, np.maximum(vertex.y, 0.0))


def certified_bound(t: Floats, y: Floats, region: Region) -> float:
    """A lower bound on t.g over the region that holds for ANY y >= 0.

    t.g = (t - rows'y).g + y.(rows g) >= min over K_0 of (t - rows'y).g + y.rhs, less every rounding;
    -inf where floats overflow.
    """
    p, used = region.p, np.flatnonzero(y)
    rows, rhs, weights = region.rows[used], region.rhs[used], y[used]
    with np.errstate(all="ignore"):
        rest = t - weights @ rows
        size = float((np.abs(t) + weights @ np.abs(rows)).max()) + float(weights @ np.abs(rhs))
        base = region.margin * rest.sum() + (1.0 - p * region.margin) * rest.min()
        bound = float(base + weights @ rhs - 5.0 * rounding(p + len(used), size))
    return bound if np.isfinite(bound) else -np.inf


def least_cvxpy(d: Floats, answers: Floats, margin: float, prior: tuple[Floats, Floats] | None = None) -> float:
    """Section 3.1's program as printed: min d.e subject to K_t, for d (k,) and answered differences (n, k).

    For reading and for tests; needs about 3 ms. Raises ValueError where the solver is not certain.
    """
    import cvxpy

    cp: Any = cvxpy  # its stubs lack half of what it offers

    k = len(d)
    e = cp.Variable(k)
    constraints = [e[0] == 0, e[k - 1] == 1, cp.diff(e) >= margin]  # K_0
    if len(answers):
        constraints.append(answers @ e >= 0)  # K_t: one inequality an answer
    if prior is not None:
        constraints.append(prior[0] @ e >= prior[1])
    problem = cp.Problem(cp.Minimize(d @ e), constraints)
    problem.solve(solver=cp.CLARABEL)
    if problem.status != cp.OPTIMAL:
        raise ValueError(f"the linear program ended with status {problem.status!r}, not 'optimal'")
    return float(problem.value)


def strictly_inside(g: Floats, region: Region) -> bool:
    """Whether g, divided by its sum, satisfies every constraint by more than any rounding."""
    if not abs(float(g.sum()) - 1.0) < 1e-12:
        return False
    slack, doubt = _slack(g, region)
    return bool((slack > doubt).all())


def pull_inside(g: Floats, centre: Floats, region: Region) -> Floats | None:
    """The nearest mixture of g (of total about 1) and a strictly interior centre that is itself strictly inside."""
    slack, doubt = _slack(g, region)
    centre_slack, _ = _slack(centre, region)
    short = ~(slack > doubt)
    with np.errstate(all="ignore"):
        lift = (2.0 * doubt - slack)[short] / (centre_slack - slack)[short]
    share = float(lift.max(initial=0.0))
    for more in (1.0, 1.5, 10.0):
        if not share * more < 1:
            return None
        mixed: Floats = (1 - share * more) * g + share * more * centre
        mixed = mixed / mixed.sum()
        if strictly_inside(mixed, region):
            return mixed
    return None


def _slack(g: Floats, region: Region) -> tuple[Floats, Floats]:
    """By how much g exceeds each limit (p + m,), and more than that number's rounding error."""
    with np.errstate(all="ignore"):
        slack = np.concatenate([g - region.margin, region.rows @ g - region.rhs])
        doubt = 4.0 * rounding(region.p, np.abs(region.rows) @ np.abs(g) + np.abs(region.rhs))
        # the further terms: the components of g total 1 only to 1e-12
        order = np.full(region.p, 1e-11 * region.margin + 1e-300)
        return slack, np.concatenate([order, doubt + 1e-11 * np.abs(region.rhs)])


def _unit_rows(d: Floats, name: str) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Tail sums (n, p) with a largest entry in [1/2, 1), d (n, k) at the same scale, and the exponents (n,)
    of two by which they were divided. Raises ValueError where that would lose bits."""
    t, small, exponents = np.empty((len(d), d.shape[1] - 1)), np.empty(d.shape), np.empty(len(d), dtype=np.int64)
    row = scale_rows(d, d.shape[1].bit_length(), t, small, exponents)
    if row >= 0:
        raise ValueError(f"row {row} of {name} holds both huge and tiny numbers, {d[row]}: round the tiny ones to 0")
    return t, small, exponents


@compiled
def scale_rows(d: Any, spare: int, t: Any, small: Any, exponents: Any) -> int:
    """``_unit_rows`` into the last three arguments; the first row that would lose bits, else -1. ``spare`` bits leave
    the sums below 1."""
    k = d.shape[1]
    for i in range(len(d)):
        largest = 0.0
        for j in range(1, k):
            largest = max(largest, abs(d[i, j]))
        first = math.frexp(largest)[1] + spare
        for j in range(k):
            small[i, j] = math.ldexp(d[i, j], -first)
            if j > 0 and math.ldexp(small[i, j], first) != d[i, j]:
                return i
        total, largest = 0.0, 0.0
        for j in range(k - 1, 0, -1):
            total += small[i, j]
            t[i, j - 1] = total
            largest = max(largest, abs(total))
        rest = math.frexp(largest)[1]
        for j in range(k - 1):
            t[i, j] = math.ldexp(t[i, j], -rest) + 0.0
        for j in range(k):
            small[i, j] = math.ldexp(small[i, j], -rest)
        exponents[i] = first + rest
    return -1


def answer_rows(answers: Answers, first: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Rows, right-hand sides and owners of the cuts: y t.g >= 0, and for y = 0 the band on both sides."""
    t, d, _ = _unit_rows(answers.d, "the answers")
    # |t.g| <= 1 at this scale; a little wider, so that rounding cannot exclude what the band allows
    band = -TIE_BAND * (1 + 1e-14) * np.minimum(np.abs(d).sum(axis=1), 1 / TIE_BAND)
    rows, rhs, owner = [], [], []
    for i, y in enumerate(answers.y):
        if not t[i].any():
            continue
        for sign in (1, -1) if y == 0 else (int(y),):
            rows.append(sign * t[i] + 0.0)
            rhs.append(band[i] if y == 0 else 0.0)
            owner.append(first + i)
    p = answers.k - 1
    return np.array(rows).reshape(-1, p), np.array(rhs, dtype=np.float64), np.array(owner, dtype=np.int64)


def prior_rows(prior: Prior | tuple[Floats, Floats] | None, k: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """A e >= b in gap space: e is the cumulative sum of g, so A's tail sums are its rows."""
    if prior is None:
        return np.empty((0, k - 1)), np.empty(0), np.empty(0, dtype=np.int64)
    rows, _, exponent = _unit_rows(prior[0], "the prior's A")
    with np.errstate(over="ignore"):
        rhs = np.clip(np.ldexp(prior[1], -exponent), -2.0, 2.0)  # |row.g| <= 1: beyond, any limit means the same
    if ((np.ldexp(rhs, exponent) != prior[1]) & (np.abs(rhs) < 2)).any():
        raise ValueError(f"the prior's b is too small beside its A: round {prior[1]} to 0 where it is nearly so")
    return rows, rhs, -1 - np.arange(len(rhs))
