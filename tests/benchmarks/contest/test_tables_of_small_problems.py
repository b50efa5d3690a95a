"""Dense arrays, vertices and draws give what the library's own ways give."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import elicit
import qlearn
from benchmarks.contest import problems
from benchmarks.contest.harness import Told
from benchmarks.contest.samplers import Posterior
from benchmarks.contest.small_mdp import SmallMDP, tails_of, values_of
from benchmarks.contest.vertices import ScaleSet

few = settings(deadline=None, max_examples=20)


@pytest.mark.parametrize("name", problems.PROBLEMS)
def test_best_policies_and_losses_are_those_of_the_library(name):
    mdp, values = problems.problem(name, 3), problems.scale(problems.problem(name, 3).k, 3)
    small = SmallMDP(mdp)
    policy = small.best(np.diff(values))[0]
    assert qlearn.policy_loss(mdp, policy, values).max() < 1e-7
    guess = small.best(np.ones(mdp.k - 1))[0]
    assert small.shares(guess) == pytest.approx(qlearn.evaluate_policy(mdp, guess))
    optimum = small.shares(policy) @ values
    lost = qlearn.policy_loss(mdp, guess, values)
    expected = (lost.max(), mdp.initial @ lost)
    assert small.losses(guess, values, optimum) == pytest.approx(expected, abs=1e-8)
    assert 20 <= mdp.n_states <= 60


def test_values_and_tails_multiply_alike():
    shares, gaps = np.array([0.2, 0.1, 0.4, 0.3]), np.array([0.5, 0.2, 0.3])
    assert tails_of(shares) @ gaps == pytest.approx(shares @ values_of(gaps))


def test_a_lottery_over_policies_has_the_mean_of_their_shares():
    small = SmallMDP(problems.problem("rover", 1))
    rng = np.random.default_rng(1)
    policies = np.array([small.random_policy(rng) for _ in range(3)])
    chances = np.array([0.5, 0.2, 0.3])
    mean = chances @ np.array([small.from_start(policy) for policy in policies])
    assert small.from_start(small.mixed(policies, chances)) == pytest.approx(mean)


@few
@given(st.integers(3, 6), st.integers(0, 9), st.integers(0, 2**32 - 1))
def test_vertices_bound_what_the_polytope_bounds(k, n, seed):
    rng = np.random.default_rng(seed)
    gaps = rng.dirichlet(np.ones(k - 1))
    scales, rows, signs = ScaleSet(k), [], []
    for _ in range(n):
        d = rng.dirichlet(np.ones(k)) - rng.dirichlet(np.ones(k))
        sign = 1 if tails_of(d) @ gaps > 0 else -1
        assert scales.cut(sign * tails_of(d))
        rows.append(d)
        signs.append(sign)
    known = elicit.PolytopeComparator(k, margin=1e-9)
    if rows:
        known = known.update(elicit.Answers(np.array(rows), np.array(signs)))
    probes = rng.dirichlet(np.ones(k), size=4) - rng.dirichlet(np.ones(k), size=4)
    low, high = known.bounds(probes)
    reached = tails_of(probes) @ scales.vertices.T
    assert reached.min(axis=1) == pytest.approx(low, abs=1e-6)
    assert reached.max(axis=1) == pytest.approx(high, abs=1e-6)
    least, most = scales.ranges()
    assert (least <= values_of(gaps) + 1e-9).all()
    assert (values_of(gaps) <= most + 1e-9).all()


def test_a_cut_that_leaves_nothing_changes_nothing():
    scales = ScaleSet(4)
    before = scales.vertices.copy()
    assert not scales.cut(-np.ones(3))
    assert (scales.vertices == before).all()


def test_draws_have_the_mean_of_the_posterior():
    rng = np.random.default_rng(5)
    told = Told("eq. (6)", 10.0, 0.1)
    posterior = Posterior(4, told, rng, draws=2000)
    rows = rng.normal(size=(6, 3))
    for row in rows:
        posterior.tell(row, 1)
    prior = rng.dirichlet(np.ones(3), size=200_000)
    chance = 0.05 + 0.9 / (1 + np.exp(-10 * prior @ rows.T))
    weights = chance.prod(axis=1)
    assert posterior.mean == pytest.approx(weights @ prior / weights.sum(), abs=0.03)
