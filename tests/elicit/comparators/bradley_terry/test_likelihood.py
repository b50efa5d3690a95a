"""The likelihood of eq. (6) and (7), its derivatives, and the batched fit against independent
ones.
"""

import warnings
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import linprog

from benchmarks.fitting.fit_accuracy import fit_cvxpy
from elicit.comparators.bradley_terry import likelihood
from elicit.comparators.bradley_terry.likelihood import (
    bootstrap_weights,
    derivatives,
    fit,
    log_likelihood,
    prior_centres,
    sigmoid,
)
from tests.scale_arithmetic import Floats, tail_sums
from tests.thoroughness import quick_first


def some_answers(
    rng: np.random.Generator,
    k: int,
    n: int,
    precision: float,
    *,
    truthful: bool = False,
    ties: float = 0.0,
) -> tuple[Floats, np.ndarray]:
    """Tail sums and answers of a tutor with random gaps."""
    t = tail_sums(rng.dirichlet(np.ones(k), n) - rng.dirichlet(np.ones(k), n))
    z = t @ rng.dirichlet(np.ones(k - 1))
    y = np.sign(z) if truthful else np.where(rng.random(n) < sigmoid(precision * z), 1, -1)
    return t, np.where(rng.random(n) < ties, 0, y).astype(np.int8)


def test_the_logistic_function_is_stable() -> None:
    z = np.array([-1e308, -800.0, -1.0, 0.0, 1.0, 800.0, 1e308])
    s = sigmoid(z)
    assert s[0] == s[1] == 0.0
    assert s[3] == 0.5
    assert s[5] == s[6] == 1.0
    assert np.allclose(s + s[::-1], 1.0, atol=1e-16)
    extreme = log_likelihood(np.array([[1e6]]), np.array([[1.0], [-1.0]]), np.array([1, 1]))
    assert extreme == pytest.approx([-1e6])


def test_a_tie_is_half_an_answer_each_way() -> None:
    gamma, t = np.array([[1.5, 0.3]]), np.array([[0.4, -0.9]])
    tie, up, down = (log_likelihood(gamma, t, np.array([y])) for y in (0, 1, -1))
    assert tie == pytest.approx((up + down) / 2)
    assert up == pytest.approx(np.log(sigmoid(gamma @ t.T)[0]))


@pytest.mark.parametrize("seed", range(5))
def test_gradient_and_hessian_are_those_of_the_log_likelihood(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k, n, m, h = int(rng.integers(2, 8)), 25, 3, 1e-5
    t, y = some_answers(rng, k, n, 5.0, ties=0.2)
    gamma, weights = rng.exponential(2.0, (m, k - 1)), rng.integers(0, 4, (m, n)).astype(float)
    gradient, hessian = derivatives(gamma, t, y, weights)
    for j in range(k - 1):
        up, down = gamma.copy(), gamma.copy()
        up[:, j] += h
        down[:, j] -= h
        slope = (log_likelihood(up, t, y, weights) - log_likelihood(down, t, y, weights)) / (2 * h)
        bend = (derivatives(up, t, y, weights)[0] - derivatives(down, t, y, weights)[0]) / (2 * h)
        assert np.allclose(slope, gradient[:, j], atol=1e-7)
        assert np.allclose(bend, hessian[:, j], atol=1e-7)


@pytest.mark.parametrize("seed", quick_first(range(200), 40, older=15))
def test_the_fit_is_the_convex_program(seed: int) -> None:
    """Separable answers (every third seed), ties, few answers, weak priors, with and without gaps
    >= 0.
    """
    rng = np.random.default_rng(seed)
    k, n = int(rng.integers(2, 12)), int(rng.integers(1, 150))
    precision, strength = 10.0 ** rng.uniform(0, 2), 10.0 ** rng.uniform(-1, 2.5)
    t, y = some_answers(rng, k, n, precision, truthful=seed % 3 == 0, ties=0.2 * (seed % 4 == 0))
    y = -y if seed % 7 == 0 else y  # a tutor who likes the worst best pushes all gaps to 0
    centre, monotone = rng.dirichlet(np.ones(k - 1)), seed % 2 == 0
    ours = fit(t, y, precision=precision, centre=centre[None], strength=strength, monotone=monotone)
    theirs = fit_cvxpy(
        t, y, precision=precision, centre=centre, strength=strength, monotone=monotone
    )
    assert ours.converged.all()
    if (
        np.abs(ours.gamma[0] - theirs).max() / precision >= 1e-6
    ):  # then it is the cone program that stopped short:
        gain = objective(ours.gamma[0], t, y, precision, strength, centre) - objective(
            theirs, t, y, precision, strength, centre
        )
        assert gain > 0
        assert seed in {177}  # one of two hundred
    if monotone:
        assert (ours.gamma >= 0).all()


def objective(gamma: Any, t: Any, y: Any, precision: float, strength: float, centre: Any) -> float:
    """The log-likelihood, a tie half an answer each way, less the ridge; straight from the
    formula.
    """
    eta = t @ gamma
    up, down = -np.logaddexp(0.0, -eta), -np.logaddexp(0.0, eta)
    told = np.where(y == 0, 0.5 * (up + down), np.where(y > 0, up, down)).sum()
    return float(told - 0.5 * strength * ((gamma / precision - centre) ** 2).sum())


@pytest.mark.parametrize("monotone", [True, False])
def test_without_a_prior_a_finite_maximum_is_found(monotone: bool) -> None:
    rng = np.random.default_rng(3)
    t, y = some_answers(rng, 5, 400, 8.0)
    centre = np.full((1, 4), 0.25)
    ours = fit(t, y, precision=8.0, centre=centre, strength=0.0, monotone=monotone)
    theirs = fit_cvxpy(t, y, precision=8.0, centre=centre[0], strength=0.0, monotone=monotone)
    assert ours.converged.all()
    assert np.abs(ours.gamma[0] - theirs).max() / 8.0 < 1e-6


def test_optimality_conditions_hold_for_every_resample() -> None:
    """The gradient vanishes on positive gaps and does not point up on zero ones."""
    rng = np.random.default_rng(0)
    for k, n in [(3, 5), (5, 30), (10, 30), (10, 300), (20, 60)]:
        t, y = some_answers(rng, k, n, 15.0)
        centre, weights = prior_centres(1, 40, k - 1, (0.1, 2.0)), bootstrap_weights(2, 40, n)
        strength = 0.3 * (k - 1) ** 2
        found = fit(t, y, precision=15.0, centre=centre, strength=strength, weights=weights)
        gradient = derivatives(found.gamma, t, y, weights)[0] * 15.0 - strength * (
            found.gamma / 15.0 - centre
        )
        assert found.converged.all()
        assert np.abs(gradient[found.gamma > 0]).max() < 1e-5
        assert gradient[found.gamma == 0].max(initial=0.0) < 1e-5


def test_batched_fits_equal_single_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    t, y = some_answers(rng, 8, 80, 12.0)
    centre, weights = prior_centres(5, 20, 7), bootstrap_weights(6, 20, 80)
    start = np.full(7, 3.0)
    together = fit(t, y, precision=12.0, centre=centre, strength=10.0, weights=weights, start=start)
    for i in range(20):
        row = slice(i, i + 1)
        alone = fit(t, y, precision=12.0, centre=centre[row], strength=10.0, weights=weights[row])
        assert np.abs(alone.gamma[0] - together.gamma[i]).max() < 1e-6
    monkeypatch.setattr(likelihood, "_BLOCK", 80 * 3)
    blocks = fit(t, y, precision=12.0, centre=centre, strength=10.0, weights=weights, start=start)
    assert np.abs(blocks.gamma - together.gamma).max() < 1e-9
    assert blocks.gamma.shape == (20, 7)
    assert blocks.converged.shape == (20,)


def test_a_weight_is_a_repeated_row() -> None:
    rng = np.random.default_rng(2)
    t, y = some_answers(rng, 5, 20, 10.0)
    times, centre = rng.integers(0, 4, 20), np.full((1, 4), 0.25)
    weighted = fit(
        t, y, precision=10.0, centre=centre, strength=5.0, weights=times[None].astype(float)
    )
    repeated = fit(
        np.repeat(t, times, axis=0),
        np.repeat(y, times),
        precision=10.0,
        centre=centre,
        strength=5.0,
    )
    assert np.abs(weighted.gamma - repeated.gamma).max() < 1e-8


def has_a_maximum(t: Floats, y: np.ndarray, weights: Floats) -> bool:
    """Return whether the likelihood has a maximum, by a linear program.

    It has none if there is a direction, of gaps >= 0, along which no answer gets less likely.
    """
    kept = weights > 0
    signed = y[kept, None] * t[kept]
    best = linprog(-signed.sum(axis=0), A_ub=-signed, b_ub=np.zeros(kept.sum()), bounds=(0, 1))
    return bool(best.fun > -1e-9)


def test_without_a_prior_fits_at_infinity_are_reported() -> None:
    """Resample by resample, as an exact criterion says."""
    rng = np.random.default_rng(4)
    seen = []
    for _ in range(6):
        t, y = some_answers(rng, 4, 15, 15.0)
        weights = bootstrap_weights(int(rng.integers(2**32)), 20, 15)
        found = fit(
            t, y, precision=8.0, centre=np.full((20, 3), 1 / 3), strength=0.0, weights=weights
        )
        exact = [has_a_maximum(t, y, w) for w in weights]
        assert found.converged.tolist() == exact
        assert np.isfinite(found.gamma).all()
        seen += exact
    assert 10 < sum(seen) < 110  # the test has seen both


@pytest.mark.parametrize("monotone", [True, False])
def test_without_a_prior_an_untouched_level_is_reported(monotone: bool) -> None:
    rng = np.random.default_rng(5)
    t, y = some_answers(rng, 5, 500, 8.0)
    t[:, 2] = 0.0  # no answer says anything about the third gap
    found = fit(t, y, precision=8.0, centre=np.full((1, 4), 0.25), strength=0.0, monotone=monotone)
    assert not found.converged.any()
    assert not fit(
        t[:0], y[:0], precision=8.0, centre=np.full((1, 4), 0.25), strength=0.0
    ).converged.any()


@pytest.mark.parametrize("precision", [1e-6, 1e-2, 1e2, 1e4, 1e6])
def test_damping_copes_with_any_precision(precision: float) -> None:
    rng = np.random.default_rng(6)
    t, y = some_answers(rng, 6, 40, 10.0)
    centre, weights = prior_centres(1, 30, 5), bootstrap_weights(1, 30, 40)
    found = fit(t, y, precision=precision, centre=centre, strength=7.5, weights=weights)
    assert found.converged.all()
    assert np.isfinite(found.gamma).all()


@pytest.mark.parametrize("strength", [0.0, 1.0])
@pytest.mark.parametrize("precision", [1e100, 1e200, 1e300])
def test_numbers_beyond_all_bounds_are_reported(precision: float, strength: float) -> None:
    rng = np.random.default_rng(6)
    t, y = some_answers(rng, 6, 40, 10.0)
    centre = prior_centres(1, 3, 5)
    for size in (1.0, 1e300):
        assert not fit(
            size * t, y, precision=precision, centre=centre, strength=strength
        ).converged.any()


def test_resamples_and_centres_are_functions_of_the_key() -> None:
    weights = bootstrap_weights(7, 30, 12)
    assert (weights == bootstrap_weights(7, 30, 12)).all()
    assert (weights.sum(axis=1) == 12).all()
    assert not (weights == bootstrap_weights(8, 30, 12)).all()
    drawn = bootstrap_weights(9, 4000, 12).mean(
        axis=0
    )  # of each answer once on average, to within five sigma
    assert np.abs(drawn - 1.0).max() < 5 * np.sqrt((1 - 1 / 12) / 4000)
    for shape in [(1.0, 1.0), (0.1, 2.0), (1e-4, 1e-4)]:
        centres = prior_centres(7, 30, 5, shape)
        assert (centres == prior_centres(7, 30, 5, shape)).all()
        assert (centres >= 0).all()
        assert np.allclose(centres.sum(axis=1), 1.0)


# ---- about equal
# ------------------------------------------------------------------------------------------------


def rao_kupper(gamma: Floats, t: Floats, y: np.ndarray, tie: float) -> Floats:
    """Log-likelihoods (n,) at gamma (p,) of answers y to rows t, each a difference of two logistic
    functions.
    """
    z, s = t @ gamma, tie * gamma.sum()
    equal = sigmoid(s - np.abs(z)) - sigmoid(
        -s - np.abs(z)
    )  # 1 - better - worse, where neither rounds to 1
    return np.asarray(np.log(np.where(y == 0, equal, sigmoid(y * z - s))))


def conic_fit(
    t: Floats,
    y: np.ndarray,
    weights: Floats,
    tie: float,
    precision: float,
    strength: float,
    centre: Floats,
    least: float,
) -> Floats:
    """Gaps u >= least by a cone program, with log(1 - exp(-2 s)) as a variable held below it."""
    u, apart = cp.Variable(len(centre)), cp.Variable()
    z, s, tied = precision * t @ u, precision * tie * cp.sum(u), y == 0
    lost = cp.multiply(weights, cp.logistic(s - cp.multiply(np.where(tied, 0, y), z)))[~tied]
    both = cp.multiply(weights, cp.logistic(z - s) + cp.logistic(-z - s))[tied]
    told = weights[tied].sum() * apart - cp.sum(lost) - cp.sum(both)
    below = [cp.log_sum_exp(cp.hstack([apart, -2 * s])) <= 0, u >= least]
    problem = cp.Problem(cp.Maximize(told - strength / 2 * cp.sum_squares(u - centre)), below)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Solution may be inaccurate")
        problem.solve(solver=cp.CLARABEL)
    return np.asarray(u.value)


@pytest.mark.parametrize("seed", quick_first(range(20), 8))
@pytest.mark.parametrize("monotone", [True, False])
def test_the_fit_with_ties_is_the_maximum_of_rao_and_kupper(seed: int, monotone: bool) -> None:
    """Held to a cone program, in every second case on a resample, and to the model as written."""
    rng = np.random.default_rng([seed, 3])
    k, n, tie = int(rng.integers(2, 8)), int(rng.integers(2, 120)), float(rng.choice([0.01, 0.1]))
    precision, strength = 10.0 ** rng.uniform(0.5, 2), 10.0 ** rng.uniform(-1, 2)
    t, y = some_answers(rng, k, n, precision, ties=float(rng.choice([0.1, 0.5])))
    y[0] = 0
    weights = np.ones(n) if seed % 2 else rng.integers(0, 4, n).astype(float)
    centre = rng.dirichlet(np.ones(k - 1))

    def loss(u: Floats) -> float:
        if u.sum() <= 0:
            return np.inf
        return float(
            strength / 2 * ((u - centre) ** 2).sum()
            - weights @ rao_kupper(precision * u, t, y, tie)
        )

    ours = fit(
        t, y, precision=precision, centre=centre[None], strength=strength, weights=weights[None],
        monotone=monotone,
        tie=tie,
    )  # fmt: skip
    assert ours.converged.all()
    u = ours.gamma[0] / precision
    theirs = conic_fit(t, y, weights, tie, precision, strength, centre, 0.0 if monotone else -1e3)
    assert np.abs(u - theirs).max() < 1e-5 or loss(u) < loss(
        np.maximum(theirs, 0.0) if monotone else theirs
    )
    assert np.abs(u - theirs).max() < 1e-3
    # no way leads down from it
    for j in range(k - 1):
        for h in (1e-4, -1e-4):
            near = u.copy()
            near[j] = max(near[j] + h, 0.0) if monotone else near[j] + h
            assert loss(near) >= loss(u) - 1e-10
    other = centre + 0.1
    for share in (0.25, 0.5, 0.75):  # the loss is convex along every line
        assert (
            loss(share * u + (1 - share) * other)
            <= share * loss(u) + (1 - share) * loss(other) + 1e-9
        )


def test_without_ties_among_the_answers_the_width_means_nothing() -> None:
    rng = np.random.default_rng(0)
    t, y = some_answers(rng, 6, 50, 10.0)
    settings = {"precision": 10.0, "centre": np.full((3, 5), 0.2), "strength": 5.0}
    assert (fit(t, y, tie=0.01, **settings).gamma == fit(t, y, **settings).gamma).all()
    y[7] = 0
    one, other = fit(t, y, tie=0.01, **settings).gamma, fit(t, y, **settings).gamma
    assert np.abs(one - other).max() > 1e-3
    # one answer in a resample where the tie was not drawn still knows that others may be equal
    weights = np.ones((3, 50))
    weights[1, 7] = 0.0
    found = fit(t, y, tie=0.01, weights=weights, **settings)
    assert found.converged.all()
    assert np.abs(found.gamma[0] - found.gamma[2]).max() < 1e-9
    assert np.abs(found.gamma[0] - found.gamma[1]).max() > 1e-3


@pytest.mark.parametrize("monotone", [True, False])
def test_all_answers_equal_have_a_fit(monotone: bool) -> None:
    t, _ = some_answers(np.random.default_rng(1), 5, 80, 10.0)
    found = fit(
        t,
        np.zeros(80),
        precision=10.0,
        centre=np.full((1, 4), 0.25),
        strength=1.0,
        monotone=monotone,
        tie=0.01,
    )
    assert found.converged.all()
    assert found.gamma.sum() > 0
