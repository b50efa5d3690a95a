"""The methods of ``benchmarks.fitting.fit_cost``: what each solves, and how long it takes on a data
set.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.fitting import logistic_libraries as tools
from benchmarks.fitting.logistic_libraries import RIDGE, Make, NoFit
from benchmarks.fitting.tutor_data import Data
from elicit import BradleyTerryComparator, Comparator, PosteriorComparator
from elicit.comparators.bradley_terry.bootstrap_comparator import refit_point
from elicit.comparators.bradley_terry.likelihood import fit
from elicit.model.comparator import Verdicts
from elicit.model.scale import Floats

LEVEL = 0.95
PARTICLES = 500


class Problem(NamedTuple):
    """Minimise minus eq. (7) plus ridge / 2 times the squares of the gaps; ``ordered``: with gaps
    >= 0.
    """

    ridge: float
    ordered: bool

    def __str__(self) -> str:
        return ("ridge" if self.ridge else "no ridge") + (", gaps >= 0" if self.ordered else "")


RIDGED, ORDERED, FREE = Problem(RIDGE, False), Problem(RIDGE, True), Problem(0.0, False)


class Run(NamedTuple):
    """CPU seconds an answer, and either the fits to the first resamples (r, p), nan where there is
    none, or the verdicts on the fresh pairs, seconds an answer over the last tenth of the run, and
    a remark."""

    seconds: float
    gamma: Floats = np.empty((0, 0))
    verdicts: Verdicts = np.empty(0, dtype=np.int8)
    late: float = 0.0
    remark: str = ""


class Entry(NamedTuple):
    """A method: what it solves, how it is run on a data set, and how many fits to run of each
    (None: all).
    """

    name: str
    solves: Problem | str
    run: Callable[[Data, int], Run]
    fits: int | None = None


def in_a_loop(make: Make, data: Data, fits: int) -> Run:
    """The fit to the answers and to the first ``fits`` - 1 resamples, at least one; the time that
    all would take.
    """
    begin = process_time()
    refit, gamma = make(data.t, data.answers.y), np.full((fits, data.t.shape[1]), np.nan)
    ends = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tools' doubts show in their status
        for i in range(fits):
            with suppress(NoFit):
                gamma[i] = refit(data.counts[i], np.nan_to_num(gamma[0]))
            ends.append(process_time())
    each = (ends[-1] - ends[0]) / (
        fits - 1
    )  # the first, to all answers and from zero, is no resample
    return Run(ends[0] - begin + each * (len(data.counts) - 1), gamma)


def scipy_at_once(data: Data, fits: int) -> Run:
    """The answers as they are first, and from there all resamples in one program."""
    begin, y, gamma = (
        process_time(),
        data.answers.y,
        np.full((len(data.counts), data.t.shape[1]), np.nan),
    )
    with suppress(NoFit):
        gamma[0] = tools.scipy_minimize(data.t, y, ordered=False)(
            data.counts[0], np.zeros(data.t.shape[1])
        )
        gamma[1:] = tools.scipy_all_at_once(data.t, y, data.counts[1:], gamma[0])
    return Run(process_time() - begin, gamma)


def together(problem: Problem, data: Data, fits: int) -> Run:
    """The project's damped Newton steps on all resamples at once, from the fit to the answers as
    they are.
    """
    begin = process_time()
    gamma = newton(problem, data)
    return Run(process_time() - begin, gamma)


def newton(problem: Problem, data: Data) -> Floats:
    """(m + 1, p) gaps, nan where no maximum was found."""
    every = partial(
        fit, data.t, data.answers.y, precision=1.0, strength=problem.ridge, monotone=problem.ordered
    )
    zero = np.zeros((len(data.counts), data.t.shape[1]))
    point = every(centre=zero[:1])
    rest = every(centre=zero[1:], weights=data.counts[1:], start=point.gamma[0])
    gamma = np.concatenate([point.gamma, rest.gamma])
    gamma[~np.concatenate([point.converged, rest.converged])] = np.nan
    return gamma


def one_by_one(make: Callable[[Data], Comparator], data: Data, fits: int) -> Run:
    """A comparator that takes in each answer and then decides one fresh pair; the mean over all
    answers.
    """
    comparator, n = make(data), len(data.answers)
    singles = [data.answers[i : i + 1] for i in range(n)]
    late = n - math.ceil(n / 10)
    begin = between = process_time()
    for i, answer in enumerate(singles):
        between = process_time() if i == late else between
        comparator = comparator.update(answer)
        comparator.compare(data.fresh[i % len(data.fresh)])
    end = process_time()
    remark = ""
    if isinstance(comparator, BradleyTerryComparator):
        known = range(comparator.min_answers, n + 1)
        remark = f", {len({refit_point(i, comparator.refit_growth) for i in known})} refits"
    said = comparator.compare(data.fresh)
    return Run((end - begin) / n, verdicts=said, late=(end - between) / (n - late), remark=remark)


def ensemble(data: Data) -> Comparator:
    """Return an ensemble of all resamples; the tutor's own precision serves its prior."""
    return BradleyTerryComparator(
        data.answers.k,
        precision=data.top,
        n_boot=len(data.counts) - 1,
        level=LEVEL,
        region="ensemble",
    )


def posterior(lapse: float, data: Data) -> Comparator:
    """It learns the precision."""
    return PosteriorComparator(data.answers.k, lapse=lapse, level=LEVEL, particles=PARTICLES)


def _loop(name: str, make: Make, fits: int | None, solves: Problem = RIDGED) -> Entry:
    return Entry(name, solves, partial(in_a_loop, make), fits)


TIGHT: dict[str, Any] = {"tol": 1e-10, "max_iter": 10_000, "warm_start": True}
CHOLESKY = TIGHT | {"solver": "newton-cholesky"}
LIBLINEAR: dict[str, Any] = {"solver": "liblinear", "tol": 1e-6, "max_iter": 1000}
POSTERIOR = Entry(
    "PosteriorComparator, lapse 0", "posterior", partial(one_by_one, partial(posterior, 0.0))
)
ENTRIES = (
    _loop(
        "scikit-learn, lbfgs, default tol 1e-4", partial(tools.scikit_learn, unchecked=False), None
    ),
    _loop("scikit-learn, lbfgs, tol 1e-10, unchecked", partial(tools.scikit_learn, **TIGHT), 50),
    _loop(
        "scikit-learn, newton-cholesky, tol 1e-10, unchecked",
        partial(tools.scikit_learn, **CHOLESKY),
        50,
    ),
    _loop(
        "scikit-learn, liblinear, tol 1e-6, unchecked", partial(tools.scikit_learn, **LIBLINEAR), 50
    ),
    _loop("SciPy L-BFGS-B, gradient, ftol 1e-13", partial(tools.scipy_minimize, ordered=False), 50),
    _loop("SciPy trust-exact, gradient and Hessian", tools.scipy_trust_region, 50),
    Entry("SciPy L-BFGS-B, all resamples in one program", RIDGED, scipy_at_once),
    _loop(
        "SciPy L-BFGS-B, the same with bounds",
        partial(tools.scipy_minimize, ordered=True),
        50,
        ORDERED,
    ),
    _loop("statsmodels GLM.fit_regularized", tools.statsmodels_ridge, 10),
    _loop("statsmodels GLM with its L2 penalty, Newton", tools.statsmodels_newton, 20),
    _loop("statsmodels Logit.fit", tools.statsmodels_logit, 20, FREE),
    _loop("cvxpy + Clarabel, rebuilt each time", partial(tools.cone_rebuilt, ordered=False), 2),
    _loop("cvxpy + Clarabel, counts as a Parameter", tools.cone_parameter, 2),
    _loop(
        "cvxpy + Clarabel, rebuilt each time, gaps >= 0",
        partial(tools.cone_rebuilt, ordered=True),
        2,
        ORDERED,
    ),
    Entry(
        "elicit.comparators.bradley_terry.likelihood.fit, monotone=False",
        RIDGED,
        partial(together, RIDGED),
    ),
    Entry(
        "elicit.comparators.bradley_terry.likelihood.fit, monotone=True",
        ORDERED,
        partial(together, ORDERED),
    ),
    Entry("BradleyTerryComparator", "own prior, gaps >= 0", partial(one_by_one, ensemble)),
    POSTERIOR,
    Entry(
        "PosteriorComparator, lapse 0.1", "posterior", partial(one_by_one, partial(posterior, 0.1))
    ),
)
