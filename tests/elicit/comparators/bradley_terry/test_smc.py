"""The particles' parts, each against another way to the same number, and the moves against laws
they must keep.
"""

import math
from itertools import pairwise, permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import expit, gammaln, logit, logsumexp
from scipy.stats import ks_2samp, kstest

from elicit._support.hashing import fold
from elicit.comparators.bradley_terry import density as D
from elicit.comparators.bradley_terry import density_float32 as R
from elicit.comparators.bradley_terry import mcmc as M
from elicit.comparators.bradley_terry import smc as P
from elicit.comparators.bradley_terry.first_particles import LAPSE
from tests.interpreter import run
from tests.noisy_cases import (
    MEAN,
    SD,
    Floats,
    Rng,
    learned,
    log_gaps,
    log_terms,
    prior_of,
    widths_of,
)
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import examples, on_any_processor, scaled


def prior_draws(
    rng: Rng, p: int, m: int, shape: tuple[float, float] | None = None, laws: Any = ()
) -> Floats:
    """x (m, p) straight from the stated prior, and a column for each of ``laws``, of logits of Beta
    variates.
    """
    x = log_gaps(rng, p + 1, m, shape) + rng.normal(MEAN, SD, (m, 1))
    return np.ascontiguousarray(np.column_stack([x, *(logit(rng.beta(*law, m)) for law in laws)]))


def learning(
    prior: D.ParticlePrior, lapse: bool, tie: float
) -> tuple[D.ParticlePrior, list[tuple[float, float]]]:
    """The prior of one who learns the lapse, the width, or both; and the laws of the columns beyond
    the gaps.
    """
    laws = [LAPSE] * lapse + [(1.0, 1.0)] * (tie > 0)
    return prior._replace(lapse=-1.0 if lapse else prior.lapse, tie=tie), laws


def lapses_and_widths(x: Floats, p: int, prior: D.ParticlePrior) -> tuple[Floats, Floats]:
    """Return lapses and widths (in logits) of particles x (m, >= p), by the formula."""
    lapse, width = np.full(len(x), prior.lapse), np.zeros(len(x))
    if prior.lapse < 0:
        lapse = D.LEAST_LAPSE + (1 - D.LEAST_LAPSE) * expit(x[:, p])
    if prior.tie:
        width = np.maximum(
            np.exp(logsumexp(x[:, :p], axis=1)) * widths_of(prior.tie, expit(x[:, -1])),
            D.LEAST_WIDTH,
        )
    return lapse, width


def direct_log_prior(x: Floats, shape: tuple[float, float]) -> float:
    """The log density of x by adaptive quadrature over the shape: a Dirichlet density of g, a
    normal one of log c, and the Jacobian of (log c, g) to x, which is prod g."""
    p, log_c = len(x), float(logsumexp(x))
    log_g = x - log_c

    def density(u: float) -> float:
        a = math.exp(u)
        return float(gammaln(p * a) - p * gammaln(a) + (a - 1.0) * log_g.sum())

    low, high = math.log(shape[0]), math.log(shape[1])
    grid = np.linspace(low, high, 2001)
    top = max(density(u) for u in grid)
    peak = grid[int(np.argmax([density(u) for u in grid]))]
    ends = [low, *(p for p in (peak - 0.1, peak, peak + 0.1) if low < p < high), high]
    parts = [
        quad(lambda u: math.exp(density(u) - top), a, b, epsabs=0, epsrel=1e-12)[0]
        for a, b in pairwise(ends)
    ]
    normal = -0.5 * ((log_c - MEAN) / SD) ** 2 - math.log(SD * math.sqrt(2 * math.pi))
    return top + math.log(sum(parts) / (high - low)) + float(log_g.sum()) + normal


def rows_of(
    rng: Rng, k: int, n: int, logit_sd: float = 2.0, ties: bool = True
) -> tuple[Floats, Floats]:
    """Rows (p, n) as ``update`` makes them, of a tutor with equal gaps, and which are ties."""
    d = rng.dirichlet(np.ones(k), n) - rng.dirichlet(np.ones(k), n)
    logit = d @ np.linspace(0, 1, k)
    logit *= logit_sd / max(1e-300, float(np.std(logit)))
    y = np.where(rng.random(n) < expit(logit), 1, -1)
    y[:: 7 if ties else n + 1] = 0
    t = tail_sums(d) * np.where(y == 0, 1, y)[:, None]
    return np.ascontiguousarray(t.T), y == 0


def test_small_exp_is_exp() -> None:
    u = np.concatenate([np.linspace(0.0, 64.0, 4001), 10.0 ** np.linspace(-300, 0, 301)])
    found = np.array([D.small_exp(float(x)) for x in u])
    off = np.abs(found / np.exp(-u) - 1.0)
    assert off[np.exp(-u) > 1e-6].max() < 1e-13
    assert off.max() < 1e-6
    assert D.small_exp(0.0) == 1.0
    assert (np.diff(found[:4001]) < 0).all()
    assert ((found > 0) & (found <= 1)).all()


def test_the_hash_is_that_of_the_seeds() -> None:
    key = np.uint64(2**63 + 12345)
    with np.errstate(over="ignore"):
        for counter in (0, 1, 499, 10**12):
            assert P.mix(key, counter) == fold(key, counter)
            assert 0.0 < M.unit(np.uint64(P.mix(key, counter))) < 1.0
        assert M.unit(np.uint64(2**64 - 1)) <= 1.0
        u = np.array([M.unit(np.uint64(P.mix(key, i))) for i in range(5000)])
    assert kstest(u, "uniform").pvalue > 1e-3


@examples(60)
@given(
    seed=st.integers(0, 2**32),
    k=st.integers(2, 12),
    n=st.integers(1, 150),
    lapse=st.sampled_from([0.0, 1e-30, 0.05, 0.5, 0.99]),
    size=st.floats(-6, 8),
    wide=st.sampled_from([0.0, 0.0, 1e-6, 0.01, 0.5]),
)
def test_the_likelihood_is_the_formula_and_gives_up_only_below_the_least(
    seed: int, k: int, n: int, lapse: float, size: float, wide: float
) -> None:
    rng = np.random.default_rng(seed)
    rows, tied = rows_of(rng, k, n)
    theta, work = 10.0**size * rng.dirichlet(np.ones(k - 1)), np.empty((2, D.BLOCK))
    width = max(D.LEAST_WIDTH, wide * theta.sum()) if wide else 0.0
    first, end = sorted(int(i) for i in rng.integers(0, n + 1, 2))
    with np.errstate(divide="ignore"):  # where an answer cannot be
        wanted = float(
            log_terms(theta[None], rows[:, first:end].T, tied[first:end], lapse, width).sum()
        )
    found = D.log_likelihood(theta, rows, tied, first, end, lapse, width, -math.inf, work)
    one_by_one = [
        D.log_term(float(theta @ rows[:, i]), bool(tied[i]), lapse, width)
        for i in range(first, end)
    ]
    assert found == pytest.approx(sum(one_by_one), rel=1e-9, abs=1e-9)
    if wanted < -1e4 and wide and not lapse:  # the formula's own numbers vanish
        return
    # beyond 60 logits the logistic function counts as 1e-26, which only a tiny lapse can tell from
    # 0
    clipped = 0.0 < lapse < 1e-20 and np.abs(rows.T @ theta).max() + width > D.FARTHEST
    if clipped:
        assert wanted - 1e-9 * abs(wanted) <= found <= 0.0
    else:
        assert found == pytest.approx(wanted, rel=1e-11, abs=1e-11 * (end - first + 1))
    assert found <= 1e-12
    for least in (found * (1 + 1e-9) - 1e-9, found * 2 - 1.0):
        assert D.log_likelihood(theta, rows, tied, first, end, lapse, width, least, work) == found
    if end > first and found < -1e-6:
        more = found * (1 - 1e-9)
        assert (
            D.log_likelihood(theta, rows, tied, first, end, lapse, width, more, work) == -math.inf
        )


@on_any_processor
@pytest.mark.parametrize("k", [2, 3, 5, 10, 20])
@pytest.mark.parametrize("shape", [(0.1, 2.0), (1.0, 1.0), (0.5, 0.6)])
def test_the_prior_is_the_stated_one(k: int, shape: tuple[float, float]) -> None:
    prior = prior_of(k, shape=shape)
    rng, theta, constants = np.random.default_rng(k), np.empty(k - 1), []
    for x in prior_draws(rng, k - 1, 12, shape):
        found = D.log_prior(x, prior, theta, np.empty((2, D.BLOCK)))
        constants.append(
            found - (direct_log_prior(x, shape) if shape[0] < shape[1] else _uniform_log_prior(x))
        )
        assert theta == pytest.approx(np.exp(np.maximum(x, x.max() - D.FARTHEST)), rel=1e-7)
    assert np.ptp(constants) < 1e-4  # 16 nodes


def _uniform_log_prior(x: Floats) -> float:
    log_c = float(logsumexp(x))
    return float((x - log_c).sum()) - 0.5 * ((log_c - MEAN) / SD) ** 2


def test_a_given_precision_scales_theta_and_inequalities_bound_it() -> None:
    rng, theta = np.random.default_rng(0), np.empty(3)
    fixed = prior_of(4, precision=7.0)
    bounded = prior_of(4, prior="e2 >= 0.5")
    for x in prior_draws(rng, 3, 50):
        D.log_prior(x, fixed, theta, np.empty((2, D.BLOCK)))
        assert theta.sum() == pytest.approx(7.0)
        g = np.exp(x - logsumexp(x))
        assert theta == pytest.approx(7.0 * g, rel=1e-6)
        if abs(g[0] - 0.5) > 1e-9:
            assert (D.log_prior(x, bounded, theta, np.empty((2, D.BLOCK))) > -math.inf) == (
                g[0] > 0.5
            )


def test_the_effective_size_counts_weights() -> None:
    logs = np.random.default_rng(0).normal(size=100) * 2.0
    w = np.exp(logs)
    assert P.effective_size(logs) == pytest.approx(w.sum() ** 2 / (w**2).sum())
    assert P.effective_size(logs - 1e4) == pytest.approx(P.effective_size(logs), rel=1e-9)
    assert P.effective_size(np.zeros(50)) == 50.0
    assert P.effective_size(np.array([0.0, -np.inf, -np.inf])) == 1.0


def test_resampling_is_unbiased_and_even() -> None:
    rng = np.random.default_rng(0)
    weights = rng.gamma(0.3, size=40)
    weights[7] = 0.0
    wanted = 40 * weights / weights.sum()
    total, out, turns = np.zeros(40), np.empty(40, dtype=np.int64), 2000
    for u in (np.arange(turns) + 0.5) / turns:
        P.resample(weights, u, out)
        counts = np.bincount(out, minlength=40)
        assert (np.abs(counts - wanted) < 1.0 + 1e-9).all()  # systematic: never off by one or more
        assert (np.diff(out) >= 0).all()
        total += counts
    assert total / turns == pytest.approx(wanted, abs=2.0 / turns)
    assert total[7] == 0


def test_tempering_takes_as_much_of_a_surprise_as_the_weights_can_bear() -> None:
    rng = np.random.default_rng(0)
    logs, found = np.zeros(200), -50.0 * rng.random(200)
    power = P.tempered(logs, found, 1.0)
    assert 0 < power < 1
    assert P.effective_size(power * found) >= P.FAIR * 200
    assert P.effective_size(1.01 * power * found) < P.FAIR * 200
    assert P.tempered(logs, 0.01 * found, 1.0) == 1.0
    assert P.tempered(logs, 0.01 * found, 0.25) == 0.25


def moved(
    x: Floats,
    rows: Floats,
    tied: Floats,
    prior: D.ParticlePrior,
    sweeps: int,
    key: int,
    last: float = 1.0,
) -> Floats:
    x = x.copy()
    accepted = M.move(x, rows, tied, rows.shape[1], last, prior, np.uint64(key), sweeps)
    assert accepted > 0.05 * sweeps * len(x)
    return x


def in_double(
    x: Floats, rows: Floats, tied: Floats, last: float, prior: D.ParticlePrior, key: Any, turns: int
) -> int:
    """``move`` as it would be without single precision."""
    (p, n), accepted = rows.shape, 0
    theta, work, proposal = np.empty(p), np.empty((2, D.BLOCK)), np.empty(x.shape[1])

    def likelihood(at: Floats, least: float) -> float:
        lapse, width = D.slips(at, theta, prior)
        return float(D.powered(theta, rows, tied, n, last, lapse, width, least, work))

    logs = [D.log_prior(at, prior, theta, work) + likelihood(at, -math.inf) for at in x]
    for turn in range(turns):
        for i in range(len(x)):
            h = fold(key, 1 + turn, i)[()]
            swaps = p > 1 and M.unit(fold(h, 0)[()]) < M.SWAPS
            away = (M.swap if swaps else M.step)(x, i, p, proposal, h)
            density = D.log_prior(proposal, prior, theta, work)
            least = logs[i] + math.log(M.unit(fold(h, 1)[()])) - density
            if density == -math.inf or least > 0.0:
                continue
            found = likelihood(proposal, least)
            if found >= least:
                x[i], logs[i], accepted = proposal, density + found, accepted + away
    return accepted


@pytest.mark.parametrize("lapse", [0.0, 1e-9, 1e-4, 0.1, None])
@pytest.mark.parametrize("tie", [0.0, 0.05])
@pytest.mark.parametrize(
    ("n", "last", "size"), [(1, 1.0, 1.0), (70, 1.0, 0.2), (200, 0.3, 0.2), (400, 1.0, 30.0)]
)
def test_single_precision_changes_no_decision(
    lapse: float | None, tie: float, n: int, last: float, size: float
) -> None:
    p, rng = 6, np.random.default_rng(n)
    prior, laws = learning(prior_of(p + 1, lapse=lapse), lapse is None, tie)
    rows, tied = size * rng.normal(size=(p, n)), rng.random(n) < 0.1
    start = prior_draws(rng, p, 40, laws=laws)
    start[10:20] = start[9]  # copies
    one, other = start.copy(), start.copy()
    with np.errstate(all="ignore"):
        accepted = M.move(one, rows, tied, n, last, prior, np.uint64(5), 12)
        assert in_double(other, rows, tied, last, prior, np.uint64(5), 12) == accepted > 0
    assert (one == other).all()
    assert (one != start).any()


@pytest.mark.parametrize(
    ("lapse", "c", "far"),
    [(0.0, 20.0, 20.65), (1e-10, 20.0, 18.0), (0.0, 1e39, 5.0), (0.1, 1e39, 5.0)],
)
def test_single_precision_changes_no_decision_where_it_ends(
    lapse: float, c: float, far: float
) -> None:
    p, n, rng = 3, 640, np.random.default_rng(1)
    prior = prior_of(p + 1, lapse=lapse, precision=c)
    rows = rng.normal(size=(p, n)) * min(far, 6.0) / c
    rows[:, ::2] = -far / c if far > 6.0 else rows[:, ::2]
    start = prior_draws(rng, p, 40)
    one, other = start.copy(), start.copy()
    with np.errstate(all="ignore"):
        accepted = M.move(one, rows, np.zeros(n, bool), n, 1.0, prior, np.uint64(5), 30)
        assert (
            in_double(other, rows, np.zeros(n, bool), 1.0, prior, np.uint64(5), 30) == accepted > 0
        )
    assert (one == other).all()


@given(st.integers(0, 10**6))
def test_rough_likelihoods_keep_within_their_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, n = int(rng.integers(1, 20)), int(rng.integers(1, 300))
    rows = rng.normal(size=(p, n)) * 10.0 ** rng.uniform(-4, 2)
    tied, lapse = (
        rng.random(n) < rng.choice([0.0, 0.1]),
        float(rng.choice([0.0, 1e-6, 1e-4, 0.05, 0.9])),
    )
    theta = np.exp(rng.normal(size=p) * 2.0)
    width = float(rng.choice([0.0, 1e-6, 10.0 ** rng.uniform(-3, 3)]))
    small, work = np.empty((2, D.BLOCK), np.float32), np.empty((2, D.BLOCK))
    rough = R.roughened(rows, tied, rng.permutation(n))
    exact = D.log_likelihood(theta, rows, tied, 0, n, lapse, width, -math.inf, work)
    found = R.rough_likelihood(theta, rough, lapse, width, -math.inf, small)
    slack = R.error(theta, rough, width)
    assert found >= exact - slack
    assert lapse < D.LEAST_LAPSE or found <= exact + slack
    assert R.rough_likelihood(theta, rough, lapse, width, found - 1e-9, small) == pytest.approx(
        found, abs=1e-9
    )
    assert R.rough_likelihood(theta, rough, lapse, width, found + 1e-6, small) == -math.inf
    assert slack < 1e-3 * n + 1e-5 * ((np.abs(rows).T @ theta).sum() + (n + D.BLOCK) * width)


@pytest.mark.parametrize("n", [0, 1, 200])
def test_rows_that_particles_find_hard_to_explain_come_first(n: int) -> None:
    p, rng = 6, np.random.default_rng(n)
    rows, tied = rng.normal(size=(p, 200)), rng.random(200) < 0.1
    x = np.log(4.0 * rng.dirichlet(np.ones(p), 30))
    order = R.hardest_first(x, rows, tied, n, prior_of(p + 1))
    assert sorted(order) == list(range(n))
    first = tied[order].sum()
    assert tied[order[:first]].all()
    assert (np.diff((np.exp(x).mean(axis=0) @ rows)[order[first:]]) > -R.WIDTH - 1e-9).all()


def statistics(x: Floats) -> dict[str, Floats]:
    log_c = logsumexp(x, axis=1)
    log_g = x - log_c[:, None]
    return {
        "log c": log_c,
        "first log gap": log_g[:, 0],
        "last log gap": log_g[:, -1],
        "greatest gap": np.exp(log_g.max(axis=1)),
        "sum of log gaps": log_g.sum(axis=1),
        "middle level": np.exp(log_g[:, : max(1, x.shape[1] // 2)]).sum(axis=1),
    }


def assert_same_law(x: Floats, y: Floats) -> None:
    for (name, one), other in zip(statistics(x).items(), statistics(y).values(), strict=True):
        if np.ptp(one) > 1e-9:
            assert ks_2samp(one, other).pvalue > 1e-4, name


@pytest.mark.parametrize("k", [3, 5, 12])
def test_moves_leave_the_prior_as_it_is(k: int) -> None:
    rng, prior = np.random.default_rng(k), prior_of(k)
    nothing, untied = np.zeros((k - 1, 1)), np.zeros(1, dtype=np.bool_)
    start = prior_draws(rng, k - 1, 1500)
    after = moved(start, nothing, untied, prior, 40, k)
    assert (np.abs(after - start) > 0.01).any(axis=1).mean() > 0.9
    assert_same_law(after, prior_draws(rng, k - 1, 20_000))


def test_moves_reach_the_prior_from_elsewhere() -> None:
    """From half of it only: the particles are drawn where log c is above its mean."""
    rng, prior = np.random.default_rng(3), prior_of(4)
    nothing, untied = np.zeros((3, 1)), np.zeros(1, dtype=np.bool_)
    start = prior_draws(rng, 3, 3000)
    start = start[logsumexp(start, axis=1) > MEAN]
    assert ks_2samp(logsumexp(start, axis=1), rng.normal(MEAN, SD, 9999)).pvalue < 1e-9
    assert_same_law(moved(start, nothing, untied, prior, 250, 5), prior_draws(rng, 3, 20_000))


@on_any_processor
@pytest.mark.parametrize(
    ("lapse", "tie", "last"),
    [
        (0.2, 0.0, 0.3),
        (None, 0.3, 0.3),
        pytest.param(0.05, 0.0, 1.0, marks=pytest.mark.slow),
        pytest.param(0.0, 0.0, 1.0, marks=pytest.mark.slow),
        pytest.param(None, 0.0, 1.0, marks=pytest.mark.slow),
        pytest.param(0.05, 0.3, 1.0, marks=pytest.mark.slow),
    ],
)
def test_moves_leave_a_posterior_as_it_is(lapse: float | None, tie: float, last: float) -> None:
    """Started from draws of the prior that are weighted by the formula, the last answer's to a
    power.
    """
    rng = np.random.default_rng(7)
    prior, laws = learning(prior_of(4, lapse=lapse), lapse is None, tie)
    n = scaled(8, 12)
    rows, tied = rows_of(rng, 4, n)
    draws = scaled(250_000, 2_000_000) if tie else 150_000
    x = prior_draws(rng, 3, draws, laws=laws)
    powers = np.r_[np.ones(n - 1), last]
    logs = log_terms(np.exp(x[:, :3]), rows.T, tied, *lapses_and_widths(x, 3, prior)) @ powers
    w = np.exp(logs - logs.max())
    assert w.sum() ** 2 / (w**2).sum() > 3000
    wanted = x[rng.choice(len(x), 6000, p=w / w.sum())]
    found = moved(wanted[:1500], rows, tied, prior, 40, 11, last)
    assert_same_law(found[:, :3], wanted[1500:, :3])
    for j in range(3, x.shape[1]):
        assert ks_2samp(found[:, j], wanted[1500:, j]).pvalue > 1e-4


@pytest.mark.parametrize(("lapse", "tie"), [(True, 0.0), (False, 0.02), (True, 0.02)])
def test_moves_keep_the_priors_of_the_lapse_and_the_width(lapse: bool, tie: float) -> None:
    """And reach them from a half of either."""
    rng = np.random.default_rng(3)
    prior, laws = learning(prior_of(4), lapse, tie)
    nothing, untied = np.zeros((3, 1)), np.zeros(1, dtype=np.bool_)
    if tie:  # its chance would depend on the width
        nothing[:] = 1e9
    start = prior_draws(rng, 3, 1200, laws=laws)
    assert ks_2samp(start[:, 3], start[start[:, 3] > np.median(start[:, 3]), 3]).pvalue < 1e-9
    start = start[start[:, 3] > np.median(start[:, 3])]
    after = moved(start, nothing, untied, prior, 300, 5)
    for j, law in enumerate(laws):
        assert kstest(expit(after[:, 3 + j]), "beta", args=law).pvalue > 1e-4
    found, width = lapses_and_widths(after, 3, prior)
    for i in range(20):
        theta = np.exp(after[i, :3])
        assert D.slips(after[i], theta, prior) == pytest.approx((found[i], width[i]), rel=1e-9)


def test_particles_leave_a_subspace_that_all_of_them_lie_in() -> None:
    prior = prior_of(4)
    nothing, untied = np.zeros((3, 1)), np.zeros(1, dtype=np.bool_)
    start = np.log(30.0 / 3) + np.random.default_rng(0).normal(size=(300, 1)) * np.ones((1, 3))
    x = moved(start, nothing, untied, prior, 400, 2)
    assert np.std(x[:, 0] - x[:, 1]) > 0.1


def test_answers_reweight_and_moves_follow_where_few_carry_the_weight() -> None:
    rng, prior = np.random.default_rng(0), prior_of(5)
    rows, tied = rows_of(rng, 5, 60)
    x, logs, noise = prior_draws(rng, 4, 400), np.zeros(400), np.full(1, 1 / 400)
    moves = 0
    for n in range(1, 61):
        before, noise_before = x.copy(), noise[0]
        P.thetas(x, prior, theta := np.empty(x.T.shape), slip := np.empty((2, 400)))
        state = P.ParticleArrays(x, theta, slip, logs, noise, rows, tied)
        proposed, accepted = P.learn(state, n, prior, np.uint64(n))
        assert P.effective_size(logs) >= P.FAIR * 400
        if not proposed:
            assert (x == before).all()
            assert noise[0] == noise_before
            assert P.effective_size(logs) >= P.ENOUGH * 400
        else:
            assert 0 < accepted <= proposed
            assert (logs == 0).all()
            moves += 1
        assert len(np.unique(x, axis=0)) > 350
        assert 1 / 400 <= noise[0] < 1 / 30
    assert 3 <= moves <= 30


def test_swaps_are_as_likely_there_as_back() -> None:
    """From every order of four gaps, the share of proposals that lead to every other."""
    orders = [list(o) for o in permutations([0.0, 1.0, 2.0, 3.0])]
    shares, x, proposal = np.zeros((24, 24)), np.empty((1, 4)), np.empty(4)
    with np.errstate(over="ignore"):
        for i, order in enumerate(orders):
            x[0] = order
            for q in range(1500):
                M.swap(x, 0, 4, proposal, fold(np.uint64(i), q)[()])
                shares[i, orders.index(proposal.tolist())] += 1
    assert (np.diag(shares) == 0).all()
    both = shares + shares.T
    off = np.abs(shares - shares.T)[both > 0] / np.sqrt(both[both > 0])
    assert off.max() < 4.5
    # every two places, but not those of the two smallest gaps where a greater one lies on either
    # side between them
    assert (both > 0).sum() == 24 * 6 - 8


def test_what_moves_leave_is_the_greatest_squared_correlation() -> None:
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(3, 200)), rng.normal(size=(3, 200))
    other[1] += one[1]
    wanted = max(np.corrcoef(a, b)[0, 1] ** 2 for a, b in zip(one, other, strict=True))
    assert P.remembered(one, other) == pytest.approx(wanted)
    assert P.remembered(one, one) == pytest.approx(1.0)
    assert P.remembered(np.ones((3, 200)), np.ones((3, 200))) == 0.0
    x = prior_draws(rng, 4, 50)
    log_c = logsumexp(x, axis=1)
    levels = np.cumsum(np.exp(x - log_c[:, None]), axis=1).T[:-1]
    assert P.features(x, 4, 0.0) == pytest.approx(np.vstack([levels, log_c]))
    assert P.features(x, 4, 5.0) == pytest.approx(np.vstack([levels, levels[0]]))


@on_any_processor
def test_compiled_and_plain_code_agree_to_the_last_bit_and_warn_of_nothing() -> None:
    sizes = scaled((20, 9), (30, 14))
    ours = learned(*sizes)
    assert len("".join(ours)) > scaled(3000, 5000)
    code = f"from tests.noisy_cases import learned; print(*learned{sizes}, sep='\\n')"
    assert run(code, NUMBA_DISABLE_JIT="1") == ours
