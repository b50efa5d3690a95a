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
        means(first, *warm_planning._arrays(mdp), v, needed, found)
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
    rows = chain.coarse() if coarse else chain.in_place()
    found = np.full((mdp.n_states - 1, columns), np.nan, dtype=kind)
    swept = sweep_kernels.sweep_rows if compiled else sweep_kernels.sweep_together
    with jit.compiling():
        swept(1, *rows, gain, kind(mdp.discount), v, found)
    np.testing.assert_array_equal(found, expected[1:])


def test_rows_that_are_fetched_ahead_are_backed_up_as_others_are():
    mdp = random_mdp(30_000, 2, 10, seed=0)[0]
    v = np.random.default_rng(0).dirichlet(np.ones(10), size=mdp.n_states)
    states = np.array([5, 29_999, 0, 17])
    q, model = np.empty((4, 2, 10)), model_of(mdp)
    back_up_together(states, v, model, q)
    with jit.compiling():
        np.testing.assert_array_equal(q_of(states, v, model), q)
