"""Other libraries' logistic regressions, as ``fit_cost`` runs them: refitted to one resample at a
time.

Each function takes the rows (n, p) and the answers (n,), sets up what all refits share, and returns
the refit.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import cvxpy
import numpy as np
import statsmodels.api as sm
from scipy.optimize import minimize
from scipy.special import expit
from sklearn import config_context
from sklearn.linear_model import LogisticRegression
from statsmodels.base._penalized import PenalizedMixin
from statsmodels.base._penalties import L2

from elicit.comparators.bradley_terry.likelihood import Signs
from elicit.model.scale import Floats

cp: Any = cvxpy  # its stubs lack half of what it offers
RIDGE = 0.1
Refit = Callable[
    [Floats, Floats], Floats
]  # counts (n,) and a start (p,) to gaps (p,); raises NoFit
Make = Callable[[Floats, Signs], Refit]


class NoFit(Exception):
    """A tool gave no fit, or said that its fit is none."""


def scikit_learn(t: Floats, y: Signs, unchecked: bool = True, **settings: Any) -> Refit:
    """Each fit from the one before it where ``warm_start`` is set; ``unchecked``: without looking
    at its input.
    """
    model = LogisticRegression(C=1.0 / RIDGE, fit_intercept=False, **settings)

    def refit(counts: Floats, start: Floats) -> Floats:
        kept = counts > 0
        _demand(y[kept].min() < y[kept].max())  # it refuses answers of one kind
        with config_context(assume_finite=unchecked, skip_parameter_validation=unchecked):
            model.fit(t[kept], y[kept], sample_weight=counts[kept])
        _demand(np.max(model.n_iter_) < model.max_iter)
        return np.array(model.coef_[0])

    return refit


def scipy_minimize(t: Floats, y: Signs, ordered: bool) -> Refit:
    bounds = [(0.0, None)] * t.shape[1] if ordered else None
    options = {"ftol": 1e-13, "gtol": 1e-6, "maxiter": 10_000}  # with less, line searches fail
    x = t * y[:, None]

    def refit(counts: Floats, start: Floats) -> Floats:
        loss = _loss(x, counts)
        found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        _demand(found.success)
        return np.asarray(found.x)

    return refit


def scipy_trust_region(t: Floats, y: Signs) -> Refit:
    """Refit by SciPy's trust region method, which takes the Hessian too."""
    x = t * y[:, None]

    def refit(counts: Floats, start: Floats) -> Floats:
        kept = counts > 0
        rows, c = x[kept], counts[kept]

        def hessian(gamma: Floats) -> Floats:
            s = expit(rows @ gamma)
            return (rows.T * (c * s * (1.0 - s))) @ rows + RIDGE * np.eye(len(gamma))

        found = minimize(
            _loss(x, counts),
            start,
            jac=True,
            hess=hessian,
            method="trust-exact",
            options={"gtol": 1e-5},
        )
        _demand(found.success)
        return np.asarray(found.x)

    return refit


def _loss(x: Floats, counts: Floats) -> Callable[[Floats], tuple[float, Floats]]:
    """Return a function of gaps (p,): minus eq. (7) plus the ridge, and its gradient.

    The rows of x (n, p) are multiplied by the answers.
    """
    kept = counts > 0
    rows, c = x[kept], counts[kept]

    def loss(gamma: Floats) -> tuple[float, Floats]:
        z = rows @ gamma
        terms = np.log1p(np.exp(-np.abs(z))) - np.minimum(z, 0.0)  # twice as fast as logaddexp
        return float(c @ terms + RIDGE / 2.0 * (gamma @ gamma)), RIDGE * gamma - (
            c * expit(-z)
        ) @ rows

    return loss


def scipy_all_at_once(t: Floats, y: Signs, counts: Floats, start: Floats) -> Floats:
    """The fits (m, p) to all resamples, counts (m, n), from one start (p,): one program in m p
    unknowns, whose loss and gradient are two matrix products. A single call instead of m, but all
    go on until the last is done."""
    x, (m, p) = t * y[:, None], (len(counts), t.shape[1])

    def loss(all_gammas: Floats) -> tuple[float, Floats]:
        gamma = all_gammas.reshape(m, p)
        z = gamma @ x.T
        terms = np.log1p(np.exp(-np.abs(z))) - np.minimum(z, 0.0)
        slope = RIDGE * gamma - (counts * expit(-z)) @ x
        return float(
            (counts * terms).sum() + RIDGE / 2.0 * (all_gammas @ all_gammas)
        ), slope.ravel()

    options = {"ftol": 1e-15, "gtol": 1e-6, "maxiter": 10_000, "maxfun": 100_000, "maxcor": 20}
    found = minimize(loss, np.tile(start, m), jac=True, method="L-BFGS-B", options=options)
    _demand(found.success)
    return np.asarray(found.x).reshape(m, p)


def statsmodels_ridge(t: Floats, y: Signs) -> Refit:
    def refit(counts: Floats, start: Floats) -> Floats:
        kept = counts > 0
        with warnings.catch_warnings():
            warnings.simplefilter("error", sm.tools.sm_exceptions.ConvergenceWarning)
            model = sm.GLM(
                (y[kept] + 1) / 2, t[kept], family=sm.families.Binomial(), freq_weights=counts[kept]
            )
            try:  # its objective is the mean over the rows, whatever their weights
                found = model.fit_regularized(
                    alpha=RIDGE / kept.sum(), L1_wt=0.0, start_params=start
                )
            except sm.tools.sm_exceptions.ConvergenceWarning as error:
                raise NoFit from error
        return np.asarray(found.params)

    return refit


class _PenalizedGLM(PenalizedMixin, sm.GLM):  # type: ignore[misc]
    """A GLM whose ``fit`` takes a penalty, by Newton's method."""


def statsmodels_newton(t: Floats, y: Signs) -> Refit:
    """The ridge by the classes that its own additive models are built on, which its manual does not
    show.
    """

    def refit(counts: Floats, start: Floats) -> Floats:
        kept = counts > 0
        settings = {"family": sm.families.Binomial(), "freq_weights": counts[kept]}
        model = _PenalizedGLM(
            (y[kept] + 1) / 2, t[kept], penal=L2(), pen_weight=RIDGE / 2, **settings
        )
        found = model.fit(method="newton", start_params=start, disp=0, trim=False)
        _demand(found.mle_retvals["converged"])
        return np.asarray(found.params)

    return refit


def statsmodels_logit(t: Floats, y: Signs) -> Refit:
    def refit(counts: Floats, start: Floats) -> Floats:
        drawn = np.repeat(np.arange(len(t)), counts.astype(int))
        try:
            found = sm.Logit((y[drawn] + 1) / 2, t[drawn]).fit(disp=0, start_params=start)
        except np.linalg.LinAlgError as error:
            raise NoFit from error
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
        raise NoFit from error
    _demand(problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE))  # how inaccurate, the table says
    return np.array(gamma.value)


def _demand(success: bool) -> None:
    if not success:
        raise NoFit
