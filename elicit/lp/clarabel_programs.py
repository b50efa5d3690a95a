"""The linear programs for the least and greatest d.e over K_t, solved by Clarabel.

They are those of the paper's section 3.1. Every bound is proven from the solver's multipliers, so
none depends on the solver's accuracy.
"""

from typing import Any, NamedTuple

import clarabel
import numpy as np
from scipy import sparse

from elicit._support.fixed_order import product
from elicit.lp.dual_simplex import minimise, minimise_exactly
from elicit.lp.region import Region
from elicit.lp.rounding import certified_bound, pull_inside, rounding
from elicit.model.scale import Floats

TIGHT = 4e-10  # bounds are proven to be as tight as this, for t of order 1


class Solved(NamedTuple):
    """A solver's result for min t.g: the point g (p,) and multipliers y (m,) >= 0 of the rows.

    Both are only approximate. They exist only if the solver's status was "Solved".
    """

    g: Floats
    y: Floats


class Programs:
    """The programs min t.g over the same region, for many t.

    All share one Clarabel solver, in which only the objective is replaced.
    """

    def __init__(self, region: Region) -> None:
        self.region = region
        self.solves = 0
        self._solver: Any = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the solver, which cannot be copied. A copy makes a new one."""
        return {**vars(self), "_solver": None}

    def solve(self, t: Floats) -> Solved | None:
        """Minimise t.g (t of order 1) over the region. Return None unless the status is Solved."""
        region, p = self.region, self.region.p
        if self._solver is None:
            settings = clarabel.DefaultSettings()
            settings.verbose = False
            settings.presolve_enable = False  # the objective can only be replaced without it
            settings.max_threads = 1
            settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
            rows, limits = region.constraints
            a, b = np.concatenate([np.ones((1, p)), -rows]), np.append(1.0, -limits)
            cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(len(limits))]
            no_quadratic = sparse.csc_matrix((p, p))
            self._solver = clarabel.DefaultSolver(
                no_quadratic, t, sparse.csc_matrix(a), b, cones, settings
            )
        else:
            self._solver.update(q=t)
        self.solves += 1
        solution = self._solver.solve()
        if solution.status != clarabel.SolverStatus.Solved:
            self._solver = None  # a failure must not affect the next solve's scaling
            return None
        return Solved(np.asarray(solution.x), np.maximum(np.asarray(solution.z)[1 + p :], 0.0))

    def least(self, t: Floats, inside: Floats | None) -> float:
        """Return a proven lower bound on t.g over the region (t of order 1), tight to ``TIGHT``.

        Parameters
        ----------
        t : (p,)
        inside : (p,), optional
            A point strictly inside the region. Approximate points are moved towards it until they
            are in the region. Their t.g then shows how tight the bound is.

        Returns
        -------
        float
            If floats cannot show that their bound is tight, it is the exact optimum, rounded down.
        """
        for propose in (self.solve, self._vertex):
            low, point = self._proven(t, propose(t), inside)
            if point is not None and float(product(t, point)) - low < TIGHT:
                return low
        value = minimise_exactly(t, self.region).value
        low = float(value)
        return low if low <= value else float(np.nextafter(low, -np.inf))

    def sign_of_least(self, t: Floats, inside: Floats | None) -> tuple[int, Floats | None]:
        """Return the sign of the least t.g over the region, if it can be proven.

        Parameters
        ----------
        t : (p,)
            Of order 1.
        inside : (p,), optional
            As for ``least``.

        Returns
        -------
        sign : int
            1 if Clarabel's multipliers prove t.g > 0 on the whole region, -1 if t.g < 0 somewhere,
            and 0 if it is inconclusive.
        point : (p,) or None
            Shows that the sign is -1.
        """
        low, point = self._proven(t, self.solve(t), inside)
        if low > 0:
            return 1, None
        if point is not None and float(product(t, point)) < -rounding(
            self.region.p, 4.0 * float(product(np.abs(t), point))
        ):
            return -1, point
        return 0, None

    def _proven(
        self, t: Floats, found: Solved | None, inside: Floats | None
    ) -> tuple[float, Floats | None]:
        """Return the lower bound proven by a solution's multipliers, and its point.

        The point is moved strictly inside the region. It is None if that fails.
        """
        if found is None:
            return -np.inf, None
        point = None if inside is None else pull_inside(found.g, inside, self.region)
        return certified_bound(t, found.y, self.region), point

    def _vertex(self, t: Floats) -> Solved:
        """Return the optimum that the simplex method finds in floats.

        It is used where Clarabel's accuracy of 1e-10 is too coarse.
        """
        vertex = minimise(t, self.region)
        return Solved(vertex.g, np.maximum(vertex.y, 0.0))
