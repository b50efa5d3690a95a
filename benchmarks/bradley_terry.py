"""What it costs, per answer, to keep a model of an unreliable tutor up to date: the usual tools and this project's.

    python -m benchmarks.bradley_terry [--answers 30 300 3000] [--levels 5 10 20] [--quick] [--out FILE.md]

Section 3.2 refits a logistic regression and all its bootstrap resamples after every answer. Each tool does that here
as its users would write it, on the same resamples; the project's two comparators learn the same answers one by one.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

# read when the libraries load, hence set before they do
os.environ |= {f"{pool}_NUM_THREADS": "1" for pool in ("OPENBLAS", "OMP", "MKL", "NUMBA")}
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import argparse
import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from importlib.metadata import version
from time import process_time
from typing import Any, NamedTuple

import cvxpy
import numpy as np
import statsmodels.api as sm
from scipy.optimize import minimize
from scipy.special import expit
from sklearn.linear_model import LogisticRegression

from benchmarks.lp import machine
from elicit import Answers, BradleyTerryComparator, BradleyTerryTutor, Comparator, PosteriorComparator, Verdict
from elicit.bradley_terry import refit_point
from elicit.comparator import Verdicts
from elicit.likelihood import Signs, bootstrap_weights, derivatives, fit, fit_cvxpy
from elicit.scale import Floats, dominance, dot, tail_sums, values_of

cp: Any = cvxpy  # its stubs lack half of what it offers
RIDGE = 0.1
SPREAD = 2.0  # standard deviation of the tutor's logits over the pairs
LEVEL = 0.95
FRESH = 2000  # pairs to decide, for each data set
PARTICLES = 500


class Problem(NamedTuple):
    """Minimise minus eq. (7) plus ridge / 2 times the squares of the gaps; ``ordered``: with gaps >= 0."""

    ridge: float
    ordered: bool

    def __str__(self) -> str:
        return ("ridge" if self.ridge else "no ridge") + (", gaps >= 0" if self.ordered else "")


RIDGED, ORDERED, FREE = Problem(RIDGE, False), Problem(RIDGE, True), Problem(0.0, False)
References = dict[Problem, Floats]  # for each problem the fits (m + 1, p), nan where there is no maximum


class Data(NamedTuple):
    """A tutor's answers, their resamples, and pairs to decide."""

    answers: Answers
    t: Floats  # (n, p) tail sums of the answers
    counts: Floats  # (m + 1, n) how often each resample holds each answer; the first holds each once
    fresh: Floats  # (FRESH, k)
    truth: Verdicts  # (FRESH,)
    top: float  # the tutor's precision, which is the true theta_k
    errors: float  # the share of wrong answers


class Run(NamedTuple):
    """CPU seconds an answer, and either the fits to the first resamples (r, p), nan where there is none, or the
    verdicts on the fresh pairs, seconds an answer over the last tenth of the run, and a remark."""

    seconds: float
    gamma: Floats = np.empty((0, 0))
    verdicts: Verdicts = np.empty(0, dtype=np.int8)
    late: float = 0.0
    remark: str = ""


class Line(NamedTuple):
    """A line of the table: milliseconds an answer; error None where the method solves no ``Problem``."""

    name: str
    solves: str
    milliseconds: float
    error: float | None
    decided: float
    wrong: float
    remark: str


class Failed(Exception):
    """A tool gave no fit, or said that its fit is none."""


Refit = Callable[[Floats, Floats], Floats]  # counts (n,) and a start (p,) to gaps (p,); raises Failed
Make = Callable[[Floats, Signs], Refit]  # from the rows (n, p) and answers (n,)


class Entry(NamedTuple):
    """A method: what it solves, how it is run on a data set, and how many fits to run of each (None: all)."""

    name: str
    solves: Problem | str
    run: Callable[[Data, int], Run]
    fits: int | None = None


def scikit_learn(t: Floats, y: Signs, **settings: Any) -> Refit:
    """Each fit from the one before it where ``warm_start`` is set."""
    model = LogisticRegression(C=1.0 / RIDGE, fit_intercept=False, **settings)

    def refit(counts: Floats, start: Floats) -> Floats:
        kept = counts > 0
        _demand(y[kept].min() < y[kept].max())  # it refuses answers of one kind
        model.fit(t[kept], y[kept], sample_weight=counts[kept])
        _demand(model.n_iter_[0] < model.max_iter)
        return np.array(model.coef_[0])

    return refit


def scipy_minimize(t: Floats, y: Signs, ordered: bool) -> Refit:
    bounds = [(0.0, None)] * t.shape[1] if ordered else None
    options = {"ftol": 1e-13, "gtol": 1e-6, "maxiter": 10_000}  # with less, line searches fail
    x = t * y[:, None]

    def refit(counts: Floats, start: Floats) -> Floats:
        kept = counts > 0
        rows, c = x[kept], counts[kept]

        def loss(gamma: Floats) -> tuple[float, Floats]:
            z = rows @ gamma
            slope = RIDGE * gamma - (c * expit(-z)) @ rows
            return float(c @ np.logaddexp(0.0, -z) + RIDGE / 2.0 * (gamma @ gamma)), slope

        found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        _demand(found.success)
        return np.asarray(found.x)

    return refit


def statsmodels_ridge(t: Floats, y: Signs) -> Refit:
    def refit(counts: Floats, start: Floats) -> Floats:
        kept = counts > 0
        with warnings.catch_warnings():
            warnings.simplefilter("error", sm.tools.sm_exceptions.ConvergenceWarning)
            model = sm.GLM((y[kept] + 1) / 2, t[kept], family=sm.families.Binomial(), freq_weights=counts[kept])
            try:  # its objective is the mean over the rows, whatever their weights
                found = model.fit_regularized(alpha=RIDGE / kept.sum(), L1_wt=0.0, start_params=start)
            except sm.tools.sm_exceptions.ConvergenceWarning as error:
                raise Failed from error
        return np.asarray(found.params)

    return refit


def statsmodels_logit(t: Floats, y: Signs) -> Refit:
    def refit(counts: Floats, start: Floats) -> Floats:
        drawn = np.repeat(np.arange(len(t)), counts.astype(int))
        try:
            found = sm.Logit((y[drawn] + 1) / 2, t[drawn]).fit(disp=0, start_params=start)
        except np.linalg.LinAlgError as error:
            raise Failed from error
        _demand(found.mle_retvals["converged"])
        return np.asarray(found.params)

    return refit


def cone_rebuilt(t: Floats, y: Signs, ordered: bool) -> Refit:
    def refit(counts: Floats, start: Floats) -> Floats:
        kept = counts > 0
        return _solve(*_cone_program(t[kept] * y[kept, None], counts[kept], ordered))

    return refit


def cone_parameter(t: Floats, y: Signs) -> Refit:
    counts = cp.Parameter(len(t), nonneg=True, value=np.ones(len(t)))
    problem, gamma = _cone_program(t * y[:, None], counts, False)
    problem.get_problem_data(cp.CLARABEL, solver_opts={})  # compiles once what all solves share

    def refit(new: Floats, start: Floats) -> Floats:
        counts.value = new
        return _solve(problem, gamma)

    return refit


def _cone_program(x: Floats, counts: Any, ordered: bool) -> tuple[Any, Any]:
    gamma = cp.Variable(x.shape[1])
    loss = counts @ cp.logistic(-x @ gamma) + RIDGE / 2.0 * cp.sum_squares(gamma)
    return cp.Problem(cp.Minimize(loss), [gamma >= 0] if ordered else []), gamma


def _solve(problem: Any, gamma: Any) -> Floats:
    try:
        problem.solve(solver=cp.CLARABEL)
    except cp.SolverError as error:
        raise Failed from error
    _demand(problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE))  # how inaccurate, the table says
    return np.array(gamma.value)


def _demand(success: bool) -> None:
    if not success:
        raise Failed


def in_a_loop(make: Make, data: Data, fits: int) -> Run:
    """The fit to the answers and to the first ``fits`` - 1 resamples, at least one; the time that all would take."""
    begin = process_time()
    refit, gamma = make(data.t, data.answers.y), np.full((fits, data.t.shape[1]), np.nan)
    ends = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tools' doubts show in their status
        for i in range(fits):
            with suppress(Failed):
                gamma[i] = refit(data.counts[i], np.nan_to_num(gamma[0]))
            ends.append(process_time())
    each = (ends[-1] - ends[0]) / (fits - 1)  # the first, to all answers and from zero, is no resample
    return Run(ends[0] - begin + each * (len(data.counts) - 1), gamma)


def together(problem: Problem, data: Data, fits: int) -> Run:
    """The project's damped Newton steps on all resamples at once, from the fit to the answers as they are."""
    begin = process_time()
    gamma = newton(problem, data)
    return Run(process_time() - begin, gamma)


def newton(problem: Problem, data: Data) -> Floats:
    """(m + 1, p) gaps, nan where no maximum was found."""
    every = partial(fit, data.t, data.answers.y, precision=1.0, strength=problem.ridge, monotone=problem.ordered)
    zero = np.zeros((len(data.counts), data.t.shape[1]))
    point = every(centre=zero[:1])
    rest = every(centre=zero[1:], weights=data.counts[1:], start=point.gamma[0])
    gamma = np.concatenate([point.gamma, rest.gamma])
    gamma[~np.concatenate([point.converged, rest.converged])] = np.nan
    return gamma


def one_by_one(make: Callable[[Data], Comparator], data: Data, fits: int) -> Run:
    """A comparator that takes in each answer and then decides one fresh pair; the mean over all answers."""
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
    """With the tutor's own precision, which serves its prior, and the resamples' number."""
    return BradleyTerryComparator(data.answers.k, precision=data.top, n_boot=len(data.counts) - 1, level=LEVEL)


def posterior(lapse: float, data: Data) -> Comparator:
    """It learns the precision."""
    return PosteriorComparator(data.answers.k, lapse=lapse, level=LEVEL, particles=PARTICLES)


def _loop(name: str, make: Make, fits: int | None, solves: Problem = RIDGED) -> Entry:
    return Entry(name, solves, partial(in_a_loop, make), fits)


TIGHT: dict[str, Any] = {"tol": 1e-10, "max_iter": 10_000, "warm_start": True}
POSTERIOR = Entry("PosteriorComparator, lapse 0", "posterior", partial(one_by_one, partial(posterior, 0.0)))
ENTRIES = (
    _loop("scikit-learn, lbfgs, default tol 1e-4", scikit_learn, None),
    _loop("scikit-learn, lbfgs, tol 1e-10", partial(scikit_learn, **TIGHT), 50),
    _loop("scikit-learn, newton-cholesky, tol 1e-10", partial(scikit_learn, solver="newton-cholesky", **TIGHT), 50),
    _loop("SciPy L-BFGS-B, gradient, ftol 1e-13", partial(scipy_minimize, ordered=False), 50),
    _loop("SciPy L-BFGS-B, the same with bounds", partial(scipy_minimize, ordered=True), 50, ORDERED),
    _loop("statsmodels GLM.fit_regularized", statsmodels_ridge, 10),
    _loop("statsmodels Logit.fit", statsmodels_logit, 20, FREE),
    _loop("cvxpy + Clarabel, rebuilt each time", partial(cone_rebuilt, ordered=False), 2),
    _loop("cvxpy + Clarabel, counts as a Parameter", cone_parameter, 2),
    _loop("cvxpy + Clarabel, rebuilt each time, gaps >= 0", partial(cone_rebuilt, ordered=True), 2, ORDERED),
    Entry("elicit.likelihood.fit, monotone=False", RIDGED, partial(together, RIDGED)),
    Entry("elicit.likelihood.fit, monotone=True", ORDERED, partial(together, ORDERED)),
    Entry("BradleyTerryComparator", "own prior, gaps >= 0", partial(one_by_one, ensemble)),
    POSTERIOR,
    Entry("PosteriorComparator, lapse 0.1", "posterior", partial(one_by_one, partial(posterior, 0.1))),
)


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark; print its tables and, with --out, write them to a file."""
    options = _options(arguments)
    lines: list[str] = []
    for part in report(options.levels, options.answers, options.sets, options.resamples, options.seed):
        print("\n".join(part), end="\n\n", flush=True)
        lines += [*part, ""]
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text("\n".join(lines), encoding="utf-8")


def report(levels: list[int], answers: list[int], sets: int, m: int, seed: int) -> Iterator[list[str]]:
    """The parts of the report, as lines of Markdown."""
    also = ", ".join(f"{name} {version(name)}" for name in ("scikit-learn", "statsmodels"))
    yield ["# The cost of an answer of an unreliable tutor", "", *machine(), f"Also {also}.", "", *notes(sets, m)]
    small = draw(3, 8, 2, seed)
    costs([small], [references(small)])  # loads and compiles what is to be loaded and compiled
    for k in levels:
        for n in answers:
            cell = [draw(k, n, m, seed + i) for i in range(sets)]
            tight = [references(data) for data in cell]
            yield [f"## k = {k}, {n} answers", "", about(cell, tight), "", *table(costs(cell, tight))]


def draw(k: int, n: int, m: int, seed: int) -> Data:
    """A tutor with gaps uniform on their simplex, n answers, m resamples; all about pairs open to dominance."""
    rng = np.random.default_rng([seed, k, n])
    gaps = rng.dirichlet(np.ones(k - 1))
    d = open_pairs(k, FRESH + n, rng)
    scores = dot(tail_sums(d), gaps)
    top = float(SPREAD / scores[:FRESH].std())
    tutor = BradleyTerryTutor(values_of(gaps), top, seed)
    answers = Answers(d[FRESH:], tutor.signs(d[FRESH:]))
    counts = np.concatenate([np.ones((1, n)), bootstrap_weights(seed, m, n)])
    truth = np.sign(scores[:FRESH]).astype(np.int8)
    return Data(answers, tail_sums(answers.d), counts, d[:FRESH], truth, top, tutor.realised_error_rate)


def open_pairs(k: int, n: int, rng: np.random.Generator) -> Floats:
    """(n, k) differences of vectors uniform on their simplex, without those that the order of the levels settles."""
    found = np.empty((0, k))
    while len(found) < n:
        left, right = rng.dirichlet(np.ones(k), (2, n))
        d = left - right
        found = np.concatenate([found, d[dominance(tail_sums(d)) == Verdict.UNKNOWN]])
    return found[:n]


def costs(cell: list[Data], tight: list[References]) -> list[Line]:
    """What each method costs on these data sets, and what becomes of its rule."""
    return [cost(entry, cell, tight) for entry in ENTRIES]


def cost(entry: Entry, cell: list[Data], tight: list[References]) -> Line:
    """One method, on all data sets."""
    every = len(cell[0].counts)
    fits = every if entry.fits is None else min(entry.fits, every)
    runs = [entry.run(data, fits) for data in cell]
    remarks, error = [], None
    if isinstance(entry.solves, Problem):
        known = [(run.gamma, exact[entry.solves], data) for run, exact, data in zip(runs, tight, cell, strict=True)]
        off = np.concatenate([distances(gamma, exact, data.top) for gamma, exact, data in known])
        error = float(off[np.isfinite(off)].max(initial=0.0)) if np.isfinite(off).any() else None
        said = [rule(completed(gamma, exact), data.fresh) for gamma, exact, data in known]
        remarks += [f"{len(off)} of {every * len(cell)} fits run"] * (fits < every)
        remarks += [f"{np.isnan(off).sum()} of {len(off)} failed"] * bool(np.isnan(off).any())
        remarks += [f"{np.isinf(off).sum()} of {len(off)} where no maximum exists"] * bool(np.isinf(off).any())
    else:
        said = [run.verdicts for run in runs]
        late = 1e3 * sum(run.late for run in runs) / len(runs)
        remarks.append(f"{late:.2f} ms in the last tenth of the run{runs[0].remark}")
    verdicts, truth = np.concatenate(said), np.concatenate([data.truth for data in cell])
    decided = np.isin(verdicts, (Verdict.WORSE, Verdict.BETTER))
    return Line(
        entry.name,
        str(entry.solves),
        1e3 * sum(run.seconds for run in runs) / len(runs),
        error,
        float(decided.mean()),
        float((verdicts != truth)[decided].mean()) if decided.any() else 0.0,
        "; ".join(remarks),
    )


def distances(gamma: Floats, exact: Floats, top: float) -> Floats:
    """(r,) how far each fit's theta is from the reference at most, as a share of theta_k; nan where the fit is missing,
    inf where it should be."""
    off: Floats = np.abs(np.cumsum(gamma - exact[: len(gamma)], axis=1)).max(axis=1) / top
    off[np.isfinite(gamma).all(axis=1) & np.isnan(off)] = np.inf
    return off


def completed(gamma: Floats, exact: Floats) -> Floats:
    """(m + 1, p) the fits that were run, and the references of the others."""
    return np.concatenate([gamma, exact[len(gamma) :]])


def references(data: Data) -> References:
    """The project's fits, polished."""
    return {problem: polished(problem, data, newton(problem, data)) for problem in (RIDGED, ORDERED, FREE)}


def polished(problem: Problem, data: Data, gamma: Floats) -> Floats:
    """The fits gamma (m + 1, p) after three more Newton steps, undamped, of the gaps that are not held at 0."""
    found, eye = np.isfinite(gamma).all(axis=1), np.eye(data.t.shape[1])
    u = gamma[found]
    for _ in range(3 if len(u) else 0):
        up, curvature = derivatives(u, data.t, data.answers.y, data.counts[found])
        held = (u == 0) if problem.ordered else np.zeros(u.shape, dtype=np.bool_)
        slope = np.where(held, 0.0, problem.ridge * u - up)
        hessian = np.where(held[:, :, None] | held[:, None, :], eye, problem.ridge * eye - curvature)
        u = u - np.linalg.solve(hessian, slope[:, :, None])[:, :, 0]
    polished = gamma.copy()
    polished[found] = np.maximum(u, 0.0) if problem.ordered else u
    return polished


def doubt(problem: Problem, data: Data, gamma: Floats) -> float:
    """How far admissible gamma (r, p), to the first r resamples, may be from the optima, in theta / theta_k: with a
    ridge no optimum is farther away than the length of the gradient over the ridge (strong convexity)."""
    slope = problem.ridge * gamma - derivatives(gamma, data.t, data.answers.y, data.counts[: len(gamma)])[0]
    if problem.ordered:
        slope[(gamma == 0) & (slope > 0)] = 0.0  # as it should be at a gap of 0
    off = np.linalg.norm(slope, axis=1).max() / problem.ridge
    return float(np.sqrt(gamma.shape[1]) * off / data.top)


def disagreement(problem: Problem, data: Data, gamma: Floats) -> float:
    """How far gamma (r, p) is from cvxpy's fits to the first r resamples, tightly solved, in theta / theta_k."""
    worst = 0.0
    for ours, counts in zip(gamma, data.counts, strict=False):
        drawn = np.repeat(np.arange(len(data.t)), counts.astype(int))
        theirs = fit_cvxpy(
            data.t[drawn],
            data.answers.y[drawn],
            precision=1.0,
            centre=np.zeros(data.t.shape[1]),
            strength=problem.ridge,
            monotone=problem.ordered,
        )
        worst = max(worst, float(np.abs(np.cumsum(ours - theirs)).max()) / data.top)
    return worst


def rule(gamma: Floats, d: Floats) -> Verdicts:
    """The sign of d.theta (n,) where the percentiles over the resamples and the fit to the answers agree on it, else
    0; gamma (m + 1, p), the first the fit to the answers. A missing fit may lie anywhere, and counts at either end."""
    point, rest = gamma[0], gamma[1:][np.isfinite(gamma[1:]).all(axis=1)]
    m = len(gamma) - 1
    cut = math.floor((1.0 - LEVEL) / 2.0 * m + 1e-9) - (m - len(rest))
    if cut < 0 or not point.sum() > 0:
        return np.zeros(len(d), dtype=np.int8)
    scores = np.sort(tail_sums(d) @ rest.T, axis=1)
    middle = tail_sums(d) @ point
    low, high = np.minimum(scores[:, cut], middle), np.maximum(scores[:, len(rest) - 1 - cut], middle)
    said: Verdicts = (low > 0).astype(np.int8) - (high < 0)
    return said


def about(cell: list[Data], tight: list[References]) -> str:
    """How often the tutors erred, and how good the references with a ridge are."""
    errors = np.mean([data.errors for data in cell])
    off = max(
        doubt(problem, data, each[problem])
        for data, each in zip(cell, tight, strict=True)
        for problem in (RIDGED, ORDERED)
    )
    theirs = max(disagreement(problem, cell[0], tight[0][problem][:2]) for problem in (RIDGED, ORDERED))
    return (
        f"{errors:.0%} of the answers are wrong. The references are within {off:.0e} of the optima, by their "
        f"gradients, and within {theirs:.0e} of cvxpy's fits at tight tolerances, on a sample."
    )


def table(found: list[Line]) -> list[str]:
    """A Markdown table; ratios are to the posterior without lapses."""
    least = next(line.milliseconds for line in found if line.name == POSTERIOR.name)
    lines = [
        "| method | solves | ms an answer | ratio | error | decided | wrong | remark |",
        "|---|---|---:|---:|---:|---:|---:|---|",
    ]
    for name, solves, milliseconds, error, decided, wrong, remark in found:
        off = "" if error is None else f"{error:.0e}"
        lines.append(
            f"| {name} | {solves} | {milliseconds:,.2f} | {milliseconds / least:,.1f} | {off} "
            f"| {decided:.1%} | {f'{wrong:.2%}' if decided else ''} | {remark} |"
        )
    return lines


def notes(sets: int, m: int) -> list[str]:
    """What was measured, and how to read it."""
    return [
        f"Milliseconds of processor time an answer, mean over {sets} data set(s) for each table: a tutor whose gaps "
        "are uniform on their simplex and who answers by eq. (6), with the precision that gives logits a standard "
        f"deviation of {SPREAD:g}. The pairs are uniform, without those that the order of the levels settles.",
        "",
        f"The fits: all {m} bootstrap resamples and the answers themselves, once more after the last answer, as the "
        "paper does after each; the time to draw resamples and to decide is left out. All tools get the same rows "
        f"(tail sums), no intercept, and the ridge {RIDGE:g} / 2 times the squares of the gaps, in logits "
        f"(scikit-learn: C = {1 / RIDGE:g}). statsmodels' Logit has no ridge; resamples without a finite maximum fail. "
        "The tools skip the rows that a resample does not hold, and start from the fit to the answers or from the last "
        "resample where they can. Of slow tools few fits are run, and the time for all is extrapolated; cvxpy's "
        "Parameter program includes being compiled once, as the next answer changes its size. The comparators take in "
        "one answer, decide one pair, and so on: these three rows are means over the whole run. "
        "BradleyTerryComparator, told the tutor's precision (only its prior uses it), refits on its schedule; "
        f"PosteriorComparator, with {PARTICLES} particles, learns the precision.",
        "",
        "Ratio: to PosteriorComparator without lapses. Error: the largest difference from the reference, over levels "
        "and resamples, as a share of the tutor's theta_k; the references are the project's fits after further Newton "
        f"steps. Decided: the share of {FRESH} fresh pairs for each data set, open "
        f"to dominance, that the rule settles at {LEVEL:.0%}: the percentiles over the resamples and the fit to the "
        "answers agree on the sign, or the posterior is sure. Wrong: the share of wrong verdicts among these. Where a "
        "tool ran on some resamples only, the references stand in for the others. A stronger ridge decides more, and "
        "errs more.",
    ]


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="What an answer of an unreliable tutor costs, by method.")
    parser.add_argument("--answers", type=int, nargs="+", help="numbers of answers (default: 30 300 3000; quick: 30)")
    parser.add_argument("--levels", type=int, nargs="+", help="numbers of levels k (default: 5 10 20; quick: 5)")
    parser.add_argument("--sets", type=int, help="data sets for each table (default: 4; quick: 1)")
    parser.add_argument("--resamples", type=int, help="bootstrap resamples m (default: 200; quick: 40)")
    parser.add_argument("--seed", type=int, default=0, help="of the first data set; the others follow")
    parser.add_argument("--quick", action="store_true", help="seconds, rough figures")
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="write the report there as well")
    options = parser.parse_args(arguments)
    options.levels = options.levels or ([5] if options.quick else [5, 10, 20])
    options.answers = options.answers or ([30] if options.quick else [30, 300, 3000])
    options.sets = options.sets or (1 if options.quick else 4)
    options.resamples = options.resamples or (40 if options.quick else 200)
    if min(options.levels) < 3:
        parser.error("--levels must be at least 3: the order of two settles every pair")
    for name in ("answers", "sets", "resamples"):
        if np.min(getattr(options, name)) < 1:
            parser.error(f"--{name} must be at least 1")
    return options


if __name__ == "__main__":
    main()
