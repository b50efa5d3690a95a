"""Distance of the fits of ``fit_methods`` from the optima, and decisions by the paper's rule."""

from __future__ import annotations

import math
import warnings
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fitting.fit_methods import FREE, LEVEL, ORDERED, RIDGED, Problem, newton
from benchmarks.fitting.tutor_data import Data
from elicit.comparators.bradley_terry.likelihood import derivatives
from elicit.model.comparator import Verdicts
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats

References = dict[
    Problem, Floats
]  # for each problem the fits (m + 1, p), nan where there is no maximum


def references(data: Data) -> References:
    """The project's fits, polished."""
    return {
        problem: polished(problem, data, newton(problem, data))
        for problem in (RIDGED, ORDERED, FREE)
    }


def polished(problem: Problem, data: Data, gamma: Floats) -> Floats:
    """The fits gamma (m + 1, p) after three more Newton steps, undamped, of the gaps that are not
    held at 0.
    """
    found, eye = np.isfinite(gamma).all(axis=1), np.eye(data.t.shape[1])
    u = gamma[found]
    for _ in range(3 if len(u) else 0):
        up, curvature = derivatives(u, data.t, data.answers.y, data.counts[found])
        held = (u == 0) if problem.ordered else np.zeros(u.shape, dtype=np.bool_)
        slope = np.where(held, 0.0, problem.ridge * u - up)
        hessian = np.where(
            held[:, :, None] | held[:, None, :], eye, problem.ridge * eye - curvature
        )
        u = u - np.linalg.solve(hessian, slope[:, :, None])[:, :, 0]
    polished = gamma.copy()
    polished[found] = np.maximum(u, 0.0) if problem.ordered else u
    return polished


def doubt(problem: Problem, data: Data, gamma: Floats) -> float:
    """Bound the distance of admissible gamma (r, p) from the optima of the first r resamples.

    It is in units of theta / theta_k. With a ridge no optimum is farther away than the length of
    the gradient over the ridge (strong convexity).
    """
    slope = (
        problem.ridge * gamma
        - derivatives(gamma, data.t, data.answers.y, data.counts[: len(gamma)])[0]
    )
    if problem.ordered:
        slope[(gamma == 0) & (slope > 0)] = 0.0  # as it should be at a gap of 0
    off = np.linalg.norm(slope, axis=1).max() / problem.ridge
    return float(np.sqrt(gamma.shape[1]) * off / data.top)


def disagreement(problem: Problem, data: Data, gamma: Floats) -> float:
    """Return the distance of gamma (r, p) from cvxpy's fits to the first r resamples.

    These are solved tightly. The distance is in units of theta / theta_k, and nan if Clarabel
    breaks down on all of them.
    """
    off = [math.nan]
    for ours, counts in zip(gamma, data.counts, strict=False):
        drawn = np.repeat(np.arange(len(data.t)), counts.astype(int))
        settings: dict[str, Any] = {
            "precision": 1.0,
            "centre": np.zeros(data.t.shape[1]),
            "strength": problem.ridge,
        }
        with suppress(RuntimeError):
            theirs = fit_cvxpy(
                data.t[drawn], data.answers.y[drawn], monotone=problem.ordered, **settings
            )
            off.append(float(np.abs(np.cumsum(ours - theirs)).max()) / data.top)
    return float(np.nanmax(off)) if len(off) > 1 else math.nan


def fit_cvxpy(
    t: Floats,
    y: NDArray[np.integer],
    *,
    precision: float,
    centre: Floats,
    strength: float,
    monotone: bool = True,
) -> Floats:
    """gamma (p,) of one problem of ``likelihood.fit``, stated as it reads and solved with Clarabel:
    slow, for checking. Raises RuntimeError where the solver does not end with an optimum."""
    import cvxpy

    cp: Any = cvxpy  # its stubs lack half of what it offers
    u = cp.Variable(t.shape[1])
    z = precision * t @ u
    log_likelihood = cp.sum(cp.multiply((1.0 + y) / 2.0, z) - cp.logistic(z))
    constraints = [u >= 0] if monotone else []
    problem = cp.Problem(
        cp.Maximize(log_likelihood - strength / 2.0 * cp.sum_squares(u - centre)), constraints
    )
    for tight in (
        1e-11,
        1e-9,
        1e-7,
    ):  # as near as Clarabel gets: it may stop short of the first, or break down there
        wanted = {f"tol_{name}": tight for name in ("gap_abs", "gap_rel", "feas")}
        enough = {f"reduced_tol_{name}": 1e-6 for name in ("gap_abs", "gap_rel", "feas")}
        with warnings.catch_warnings(), suppress(cp.SolverError):
            warnings.filterwarnings("ignore", "Solution may be inaccurate")
            problem.solve(solver=cp.CLARABEL, **wanted, **enough)
            break
    if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
        raise RuntimeError(f"Clarabel ended with {problem.status}")
    gamma: Floats = precision * np.asarray(u.value)
    return gamma


def distances(gamma: Floats, exact: Floats, top: float) -> Floats:
    """(r,) how far each fit's theta is from the reference at most, as a share of theta_k; nan where
    the fit is missing, inf where it should be."""
    off: Floats = np.abs(np.cumsum(gamma - exact[: len(gamma)], axis=1)).max(axis=1) / top
    off[np.isfinite(gamma).all(axis=1) & np.isnan(off)] = np.inf
    return off


def completed(gamma: Floats, exact: Floats) -> Floats:
    """(m + 1, p) the fits that were run, and the references of the others."""
    return np.concatenate([gamma, exact[len(gamma) :]])


def rule(gamma: Floats, d: Floats) -> Verdicts:
    """The sign of d.theta (n,) where the percentiles over the resamples and the fit to the answers
    agree on it, else 0; gamma (m + 1, p), the first the fit to the answers. A missing fit may lie
    anywhere, and counts at either end."""
    point, rest = gamma[0], gamma[1:][np.isfinite(gamma[1:]).all(axis=1)]
    m = len(gamma) - 1
    cut = math.floor((1.0 - LEVEL) / 2.0 * m + 1e-9) - (m - len(rest))
    if cut < 0 or not point.sum() > 0:
        return np.zeros(len(d), dtype=np.int8)
    scores = np.sort(tail_sums(d) @ rest.T, axis=1)
    middle = tail_sums(d) @ point
    low, high = (
        np.minimum(scores[:, cut], middle),
        np.maximum(scores[:, len(rest) - 1 - cut], middle),
    )
    said: Verdicts = (low > 0).astype(np.int8) - (high < 0)
    return said
