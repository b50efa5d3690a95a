"""Ways to decide a comparison over K_t, each as its users would write it with the tool it is named
after.

Every method learns answers with ``learn`` and gives verdicts with ``compare``. All but the
comparator of this project see both sides of the paper's two programs (section 3.1) in floats: an
optimum within ``tolerance`` of zero, for a difference whose largest tail sum is 1, counts as zero.
All run in one thread.
"""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

import clarabel
import cvxpy
import highspy
import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from benchmarks.comparing.recorded_streams import cuts, unit
from elicit import Answers, PolytopeComparator, Verdict
from elicit.model.comparator import Verdicts
from elicit.model.difference import dominance, tail_sums
from elicit.model.scale import Floats


class Method(Protocol):
    """Learns answers and judges differences."""

    def learn(self, answers: Answers) -> None:
        """Cut K_t by further answers."""

    def compare(self, d: Floats) -> Verdicts:
        """Verdicts (n,) on differences d (n, k)."""


class Ours:
    """PolytopeComparator.compare on all rows at once."""

    def __init__(self, k: int, margin: float) -> None:
        self.comparator = PolytopeComparator(k, margin)

    def learn(self, answers: Answers) -> None:
        self.comparator = self.comparator.update(answers)

    def compare(self, d: Floats) -> Verdicts:
        return self.comparator.compare(d)


class OursRowByRow(Ours):
    """PolytopeComparator.compare on one row at a time."""

    def compare(self, d: Floats) -> Verdicts:
        return np.array([self.comparator.compare(row)[0] for row in d], dtype=np.int8)


class TwoPrograms:
    """The least and the greatest d.e over K_t for every difference, whether dominance settles it or
    not.
    """

    tolerance: ClassVar[float] = 1e-9

    def __init__(self, k: int, margin: float) -> None:
        self.k, self.p, self.margin = k, k - 1, margin
        self.rows, self.limits = np.empty((0, k - 1)), np.empty(0)

    def learn(self, answers: Answers) -> None:
        rows, limits = cuts(answers)
        self.rows, self.limits = (
            np.concatenate([self.rows, rows]),
            np.concatenate([self.limits, limits]),
        )
        self.cut(rows, limits)

    def compare(self, d: Floats) -> Verdicts:
        t = unit(tail_sums(d))
        return np.array([verdict(self.sign(row), -self.sign(-row)) for row in t], dtype=np.int8)

    def sign(self, t: Floats) -> float:
        """The sign of the least t.g; nan where the solver found none."""
        value = self.least(t)
        return 0.0 if abs(value) <= self.tolerance else float(np.sign(value))

    def cut(self, rows: Floats, limits: Floats) -> None:
        """Take the new constraints rows.g >= limits."""

    def least(self, t: Floats) -> float:
        """The least t.g over {g >= margin, sum g = 1, self.rows g >= self.limits}."""
        raise NotImplementedError


class CvxpyRebuilt(TwoPrograms):
    """The paper's program in cvxpy, stated anew for each comparison."""

    tolerance = 1e-7
    objective: Any

    def least(self, t: Floats) -> float:
        return self.solve(self.state(shares(t)))

    def state(self, d: Any) -> Any:
        e = cvxpy.Variable(self.k)
        constraints = [e[0] == 0, e[self.k - 1] == 1, cvxpy.diff(e) >= self.margin]
        if len(self.rows):
            constraints.append(shares(self.rows) @ e >= self.limits)
        return cvxpy.Problem(cvxpy.Minimize(d @ e), constraints)

    def solve(self, problem: Any) -> float:
        return float(problem.solve(solver=cvxpy.CLARABEL, max_threads=1))


class CvxpyParameter(CvxpyRebuilt):
    """``CvxpyRebuilt`` with the difference as a Parameter, compiled once for each answer."""

    def __init__(self, k: int, margin: float) -> None:
        super().__init__(k, margin)
        self.cut(self.rows, self.limits)

    def cut(self, rows: Floats, limits: Floats) -> None:
        self.d = cvxpy.Parameter(self.k)
        self.d.value = np.zeros(self.k)
        self.problem = self.state(self.d)
        self.problem.get_problem_data(cvxpy.CLARABEL)

    def least(self, t: Floats) -> float:
        self.d.value = shares(t)
        return self.solve(self.problem)


class HotClarabel(TwoPrograms):
    """Clarabel's own interface in gap space: one solver an answer, its objective replaced."""

    tolerance = 1e-7

    def __init__(self, k: int, margin: float) -> None:
        super().__init__(k, margin)
        self.cut(self.rows, self.limits)

    def cut(self, rows: Floats, limits: Floats) -> None:
        p = self.p
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
        a = sparse.csc_matrix(np.concatenate([np.ones((1, p)), -np.eye(p), -self.rows]))
        b = np.concatenate([[1.0], np.full(p, -self.margin), -self.limits])
        cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(len(b) - 1)]
        self.solver = clarabel.DefaultSolver(
            sparse.csc_matrix((p, p)), np.zeros(p), a, b, cones, settings
        )

    def least(self, t: Floats) -> float:
        self.solver.update(q=t)
        solution = self.solver.solve()
        return (
            float(solution.obj_val) if solution.status == clarabel.SolverStatus.Solved else np.nan
        )


class Linprog(TwoPrograms):
    """scipy.optimize.linprog, which calls HiGHS."""

    def least(self, t: Floats) -> float:
        a, b = (-self.rows, -self.limits) if len(self.rows) else (None, None)
        options = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
        found = linprog(
            t,
            a,
            b,
            np.ones((1, self.p)),
            [1.0],
            (self.margin, None),
            method="highs",
            options=options,
        )
        return float(found.fun) if found.success else np.nan


class HotHighs(TwoPrograms):
    """One HiGHS model: a row added an answer, the objective replaced, the last basis kept."""

    def __init__(self, k: int, margin: float) -> None:
        super().__init__(k, margin)
        self.index = np.arange(self.p, dtype=np.int32)
        self.model = highspy.Highs()
        for name, value in _HIGHS.items():
            self.model.setOptionValue(name, value)
        self.model.addVars(self.p, np.full(self.p, margin), np.full(self.p, highspy.kHighsInf))
        self.model.addRow(1.0, 1.0, self.p, self.index, np.ones(self.p))

    def cut(self, rows: Floats, limits: Floats) -> None:
        for row, limit in zip(rows, limits, strict=True):
            self.model.addRow(limit, highspy.kHighsInf, self.p, self.index, row)

    def least(self, t: Floats) -> float:
        self.model.changeColsCost(self.p, self.index, t)
        for _ in range(2):
            self.model.run()
            if self.model.getModelStatus() == highspy.HighsModelStatus.kOptimal:
                return float(self.model.getObjectiveValue())
            self.model.clearSolver()  # a warm basis can lead astray: once more from scratch
        return np.nan


class Careful(HotHighs):
    """Dominance first, on all rows at once; then hot HiGHS on the one side that the last vertex
    leaves open, and on the other only where that does not settle it."""

    point: Floats | None = None

    def cut(self, rows: Floats, limits: Floats) -> None:
        super().cut(rows, limits)
        if self.point is not None and (rows @ self.point < limits).any():
            self.point = None

    def compare(self, d: Floats) -> Verdicts:
        t = tail_sums(d)
        verdicts = dominance(t)
        for i in np.flatnonzero(verdicts == Verdict.UNKNOWN):
            verdicts[i] = self.settle(unit(t[i]))
        return verdicts

    def settle(self, t: Floats) -> int:
        seen = 0.0 if self.point is None else float(t @ self.point)
        side = -1 if seen < 0 else 1
        lower = self.sign(side * t)
        self.point = np.array(self.model.getSolution().col_value)
        settled = lower > 0 or abs(seen) > self.tolerance
        upper = 1.0 if settled else -self.sign(-side * t)
        code = verdict(lower, upper)
        return side * code if abs(code) == Verdict.BETTER else code


_HIGHS = {
    "output_flag": False,
    "threads": 1,
    "presolve": "off",
    # primal: a vertex stays feasible when only the objective changes; the fastest here
    "simplex_strategy": 4,
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
}

FAILED = 3  # beside the codes of Verdict: a solver gave no optimum


def verdict(least: float, greatest: float) -> int:
    """The verdict from the signs of the least and the greatest d.e; FAILED where one of them is
    nan.
    """
    if np.isnan(least + greatest):
        return FAILED
    if least > 0 or (least == 0 and greatest > 0):
        return int(Verdict.BETTER)
    if greatest < 0 or (greatest == 0 and least < 0):
        return int(Verdict.WORSE)
    return int(Verdict.EQUAL if least == greatest == 0 else Verdict.UNKNOWN)


def shares(t: Floats) -> Floats:
    """Differences (..., p + 1) whose tail sums are t (..., p)."""
    return -np.diff(t, axis=-1, prepend=0.0, append=0.0)
