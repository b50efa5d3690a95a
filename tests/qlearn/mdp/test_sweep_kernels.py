"""Sweeps of large models give SciPy's numbers to the last bit, compiled or not."""

import numpy as np
import pytest

from elicit._support import jit
from qlearn import random_mdp
from qlearn.mdp import sweep_kernels, warm_planning
from qlearn.mdp.backup import back_up_together, model_of, q_of
from tests.mdp_cases import messy_mdp

MODELS = {
    "random": random_mdp(200, 4, 4, rng=1)[0],
    "one successor": random_mdp(2, 3, 4, rng=1)[0],
    "messy": messy_mdp(3, n=40)[0],
}


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("name", MODELS)
def test_means_of_successors_are_those_of_a_matrix(name, compiled):
    mdp, rng = MODELS[name], np.random.default_rng(0)
    v, first, last = rng.random(mdp.n_states), 1, mdp.n_states
    needed = rng.random((last - first, mdp.n_actions)) < 0.5
    expected = (mdp.transitions @ v).reshape(-1, mdp.n_actions)[first:last]
    found = np.full(needed.shape, np.nan)
    means = sweep_kernels.products if compiled else sweep_kernels.products_together
    with jit.compiling():
        means(first, *sweep_kernels.arrays_of(mdp), v, needed, found)
    np.testing.assert_array_equal(found, np.where(needed, expected, 0.0))


@pytest.mark.parametrize("columns", [1, 3])
@pytest.mark.parametrize("coarse", [True, False])
@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("name", MODELS)
def test_a_sweep_is_a_product_of_matrices(name, compiled, coarse, columns):
    mdp, rng = MODELS[name], np.random.default_rng(0)
    kind = np.float32 if coarse else np.float64
    gain, v = rng.random((2, mdp.n_states, columns)).astype(kind)
    chain = warm_planning._Chain(mdp, np.argmax(mdp.admissible, axis=1))
    expected = chain.matrix.astype(kind) @ v
    expected *= mdp.discount
    expected += gain
    rows = chain.in_place()
    found = np.full((mdp.n_states - 1, columns), np.nan, dtype=kind)
    swept = sweep_kernels.sweep_rows if compiled else sweep_kernels.sweep_together
    with jit.compiling():
        swept(1, *rows, gain, kind(mdp.discount), v, found)
    np.testing.assert_array_equal(found, expected[1:])


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("name", MODELS)
def test_changes_of_active_states_are_passed_on_and_others_are_not(name, compiled):
    mdp, rng = MODELS[name], np.random.default_rng(0)
    change = rng.random((mdp.n_states, 3)).astype(np.float32)
    active = rng.random(mdp.n_states) < 0.5
    chain = warm_planning._Chain(mdp, np.argmax(mdp.admissible, axis=1))
    expected = chain.matrix.astype(np.float32) @ np.where(active[:, None], change, 0.0)
    expected *= np.float32(mdp.discount)
    found = np.full((mdp.n_states - 1, 3), np.nan, dtype=np.float32)
    passed_on = sweep_kernels.pass_on if compiled else sweep_kernels.pass_on_together
    with jit.compiling():
        passed_on(1, *chain.in_place(), np.float32(mdp.discount), change, active, found)
    np.testing.assert_array_equal(found, expected[1:])


def test_changes_are_taken_in_alike_compiled_or_not():
    rng, found = np.random.default_rng(0), []
    given = rng.random((50, 3)).astype(np.float32)
    total, middle, common = rng.random((50, 3)), np.float32([0.5, 0.4, 0.6]), rng.random(3)
    for take_in in (sweep_kernels.take_in, sweep_kernels.take_in_together):
        change, sums, active, left = given.copy(), total.copy(), np.empty(50, bool), np.ones(3)
        with jit.compiling():
            take_in(change, middle, common, np.float32(0.3), sums, active, left)
        found.append((change, sums, active, left))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
    change, sums, active, left = found[0]
    np.testing.assert_array_equal(sums, total + (given + common))
    np.testing.assert_array_equal(active, (np.abs(given - middle) > np.float32(0.3)).any(axis=1))
    np.testing.assert_allclose(left, change[~active].sum(axis=0, dtype=np.float64), rtol=1e-12)
    assert 0 < active.sum() < 50


@pytest.mark.parametrize("remember", [True, False])
@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("name", MODELS)
def test_a_sweep_that_improves_is_the_same_compiled_or_not(name, known, kept, remember):
    mdp, rng, found = MODELS[name], np.random.default_rng(0), []
    n, m = mdp.levels.shape
    v, gain, final = rng.random(n), 0.1 * rng.random((n, m)), rng.random(n)
    means = rng.random((n if known or remember else 0, m)).astype(np.float32)
    last = np.argmax(mdp.admissible, axis=1) if kept else np.empty(0, dtype=np.int64)
    for improve in (sweep_kernels.improve, sweep_kernels.improve_together):
        best, greedy, seen = np.empty(n - 1), np.empty(n - 1, dtype=np.int64), means.copy()
        rewards = sweep_kernels.Rewards(gain, final, mdp.terminal, mdp.admissible, mdp.discount)
        model = sweep_kernels.arrays_of(mdp), v, rewards
        choosing = sweep_kernels.GreedyRule(seen, remember, 0.2, last, 0.01)
        with jit.compiling():
            improve(1, *model, choosing, best, greedy)
        found.append((best, greedy, seen))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one[-(n - 1) :], other[-(n - 1) :])
    assert mdp.admissible[np.arange(1, n), found[0][1]].all()


def test_rows_that_are_fetched_ahead_are_backed_up_as_others_are():
    mdp = random_mdp(30_000, 2, 10, seed=0)[0]
    v = np.random.default_rng(0).dirichlet(np.ones(10), size=mdp.n_states)
    states = np.array([5, 29_999, 0, 17])
    q, model = np.empty((4, 2, 10)), model_of(mdp)
    back_up_together(states, v, model, q)
    with jit.compiling():
        np.testing.assert_array_equal(q_of(states, v, model), q)
