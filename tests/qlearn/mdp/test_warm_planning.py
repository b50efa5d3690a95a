"""Solving nearly: against exact solutions, with errors that are what they are said to be."""

import numpy as np
import pytest

from qlearn import OrdinalMDP, evaluate_policy, policy_loss, random_mdp, value_iteration
from qlearn.mdp import blocks, sweep_kernels, warm_planning
from qlearn.mdp.planning import rewarded
from qlearn.mdp.warm_planning import Seen, nearly_optimal, nearly_valued
from tests.mdp_cases import messy_mdp


def ring(n=300, discount=0.99):
    """States on a ring, of random levels: step forward, back, or stay; values travel slowly."""
    at, rng = np.arange(n), np.random.default_rng(0)
    successors = np.stack(
        [[(at + step) % n, (at + 2 * step) % n] for step in (1, -1, 0)]
    ).transpose(2, 0, 1)
    probabilities = np.broadcast_to([0.8, 0.2], (n, 3, 2))
    levels = np.repeat(rng.integers(4, size=(n, 1)), 3, axis=1)
    return OrdinalMDP(successors, probabilities, levels, discount, ("a", "b", "c", "d"))


MODELS = {
    "random": random_mdp(200, 4, 4, rng=1)[0],
    "short": random_mdp(50, 3, 4, discount=0.0, rng=2)[0],
    "messy": messy_mdp(3, n=40)[0],
    "ring": ring(),
}
VALUES = np.array([0.0, 0.2, 0.7, 1.0])


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("within", [1e-2, 1e-5, 1e-9])
def test_values_are_as_near_as_they_are_said_to_be(name, within):
    mdp = MODELS[name]
    exact = value_iteration(mdp, VALUES, 1e-11)[0]
    cold = np.full(mdp.n_states, 0.5)
    for start in (cold, exact + 0.3, np.random.default_rng(0).random(mdp.n_states)):
        v, policy, more = nearly_optimal(mdp, *rewarded(mdp, VALUES), start, within)
        assert 0 <= more <= within + 1e-12
        assert (exact <= v + more + 1e-10).all()
        assert (v <= exact + within + 1e-10).all()
        assert policy_loss(mdp, policy, VALUES).max() <= 2 * within + 1e-10


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("rounds", [1, 2, 3])
def test_what_is_said_of_values_is_so_where_rounds_run_out(monkeypatch, name, rounds):
    mdp = MODELS[name]
    exact = value_iteration(mdp, VALUES, 1e-11)[0]
    monkeypatch.setattr(warm_planning, "_ROUNDS", rounds)
    for start in (np.full(mdp.n_states, 0.5), exact + 0.3, exact - 0.3):
        v, _, more = nearly_optimal(mdp, *rewarded(mdp, VALUES), start, 1e-9)
        assert (exact <= v + more + 1e-10).all()


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("within", [1e-4, 1e-8])
def test_a_policys_vector_value_is_nearly_consistent_whatever_it_starts_from(name, within):
    mdp = MODELS[name]
    n, policy = mdp.n_states, value_iteration(mdp, VALUES)[1]
    exact, chain = (
        evaluate_policy(mdp, policy),
        mdp.transitions[np.arange(n) * mdp.n_actions + policy],
    )
    for start in (None, exact, np.random.default_rng(1).dirichlet(np.ones(4), n)):
        v = nearly_valued(mdp, policy, start, within)
        np.testing.assert_allclose(v.sum(axis=1), 1.0)
        assert (v >= 0).all()
        np.testing.assert_array_equal(v[mdp.terminal], exact[mdp.terminal])
        tails, reward = (
            v[:, ::-1].cumsum(axis=1)[:, -2::-1],
            mdp.levels[np.arange(n), policy][:, None] > np.arange(3),
        )
        left = (1 - mdp.discount) * reward + mdp.discount * (chain @ tails) - tails
        left[mdp.terminal] = 0.0
        apart = np.maximum(left.max(axis=0), 0) - np.minimum(left.min(axis=0), 0)
        assert (
            apart.max() <= 6 * within
        )  # of which the most comes from cutting off what is negative
        np.testing.assert_allclose(v, exact, atol=6 * within / (1 - mdp.discount))


@pytest.mark.parametrize("name", MODELS)
def test_blocks_on_several_threads_give_the_same_numbers(monkeypatch, name):
    mdp = MODELS[name]
    start = np.full(mdp.n_states, 0.5)

    def solved():
        v, policy, more = nearly_optimal(mdp, *rewarded(mdp, VALUES), start, 1e-6)
        return v, policy, more, nearly_valued(mdp, policy, None, 1e-6)

    alone = solved()
    monkeypatch.setattr(blocks, "_WORTH_A_THREAD", 1)
    monkeypatch.setattr(blocks, "cores", lambda: 3)
    for one, other in zip(alone, solved(), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", MODELS)
def test_sweeps_that_begin_in_single_precision_come_as_near(monkeypatch, name):
    mdp = MODELS[name]
    policy = value_iteration(mdp, VALUES)[1]
    exact = evaluate_policy(mdp, policy)
    monkeypatch.setattr(warm_planning, "LARGE", 0)
    v = nearly_valued(mdp, policy, None, 1e-8)
    np.testing.assert_allclose(v, exact, atol=1e-8 * 4 / (1 - mdp.discount))
    np.testing.assert_array_equal(v[mdp.terminal], exact[mdp.terminal])


@pytest.mark.parametrize("name", MODELS)
def test_actions_that_cannot_be_the_best_are_left_out_and_no_number_changes(monkeypatch, name):
    mdp, rng, needed = MODELS[name], np.random.default_rng(0), []
    kept = sweep_kernels.products

    def counted(first, ends, successors, probabilities, v, some, found):
        needed.append(some.mean())
        kept(first, ends, successors, probabilities, v, some, found)

    def solved(large):
        monkeypatch.setattr(warm_planning, "LARGE", large)
        seen, start, last, found = Seen(), np.full(mdp.n_states, 0.5), None, []
        for number in range(4):  # from scale to scale, as policy iteration solves
            scale = np.array([0.0, 0.2 + number / 100, 0.7 - number / 50, 1.0])
            some = None if number % 2 else np.arange(0, mdp.n_states, 3)
            start, last, more = nearly_optimal(
                mdp, *rewarded(mdp, scale), start, 1e-5, last, some, seen
            )
            found += [start, last, more]
        return found

    monkeypatch.setattr(warm_planning, "improve", sweep_kernels.improve_together)
    monkeypatch.setattr(sweep_kernels, "products", counted)
    for one, other in zip(solved(10**12), solved(0), strict=True):
        np.testing.assert_array_equal(one, other)
    assert needed
    assert name != "random" or min(needed) < 0.5
    seen = Seen()
    for _ in range(2):  # values from before, whatever they are, decide nothing
        v = rng.random(mdp.n_states)
        gain, ends = rewarded(mdp, VALUES)
        one, other = (nearly_optimal(mdp, gain, ends, v, 1e-5, seen=each) for each in (seen, None))
        for left, right in zip(one, other, strict=True):
            np.testing.assert_array_equal(left, right)
