"""Planning is ground truth, so each function is held to at least one independent method."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

import qlearn.mdp.planning
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import (
    absorption_probability,
    best_absorption_probability,
    evaluate_policy,
    policy_loss,
    value_iteration,
)
from qlearn.problems.random_mdp import draw_values, random_mdp


def messy_mdp(seed: int, n: int = 12, m: int = 3, k: int = 4, discount: float = 0.9) -> tuple[OrdinalMDP, Floats]:
    """A random MDP with two terminal states, inadmissible actions and duplicated successors."""
    rng = np.random.default_rng(seed)
    levels = rng.integers(k, size=(n, m))
    levels[-2:] = levels[-2:, :1]
    admissible = rng.random((n, m)) < 0.7
    admissible[np.arange(n), rng.integers(m, size=n)] = True
    labels = tuple(f"l{i}" for i in range(k))
    successors, probabilities = rng.integers(n, size=(n, m, 3)), rng.dirichlet(np.ones(3), size=(n, m))
    mdp = OrdinalMDP(
        successors, probabilities, levels, discount, labels,
        terminal=np.arange(n) >= n - 2, admissible=admissible,
    )  # fmt: skip
    return mdp, draw_values(k, seed)


def random_policy(mdp: OrdinalMDP, seed: int) -> Floats:
    weights = np.random.default_rng(seed).random(mdp.levels.shape) * mdp.admissible
    policy: Floats = weights / weights.sum(axis=1, keepdims=True)
    return policy


def naive_value(mdp: OrdinalMDP, values: Floats, sweeps: int = 600) -> list[float]:
    """Scalar value iteration (eq. 2) in loops over Python floats, in shares."""
    low, high = float(values[0]), float(values[-1])
    v = [0.0] * mdp.n_states
    for _ in range(sweeps):
        new = []
        for s in range(mdp.n_states):
            options = []
            for a in range(mdp.n_actions):
                if not mdp.admissible[s, a]:
                    continue
                e = (float(values[mdp.levels[s, a]]) - low) / (high - low)
                ahead = sum(float(p) * v[t] for p, t in zip(mdp.probabilities[s, a], mdp.successors[s, a], strict=True))
                options.append(e if mdp.terminal[s] else (1 - mdp.discount) * e + mdp.discount * ahead)
            new.append(max(options))
        v = new
    return v


def dense_shares(mdp: OrdinalMDP, policy: Floats) -> Floats:
    """Eq. (3) as one dense linear system in which terminal states loop."""
    n, m = mdp.levels.shape
    chain = np.einsum("sa,sat->st", policy, mdp.transitions.toarray().reshape(n, m, n))
    rewards = np.einsum("sa,sak->sk", policy, mdp.vector_rewards())
    shares: Floats = (1 - mdp.discount) * np.linalg.inv(np.eye(n) - mdp.discount * chain) @ rewards
    return shares


def test_sweeps_stand_in_for_factors_that_would_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    mdp, values = messy_mdp(1, n=60)
    expected = value_iteration(mdp, values)[0], evaluate_policy(mdp, random_policy(mdp, 0))
    stuck = lambda matrix, rtol, maxiter: lambda residual: (0.0 * residual, maxiter)  # noqa: E731
    monkeypatch.setattr(qlearn.mdp.planning, "partial", lambda step, matrix, **settings: stuck(matrix, **settings))
    monkeypatch.setattr(qlearn.mdp.planning, "splu", None)
    monkeypatch.setattr(qlearn.mdp.planning, "_DENSE", 0)
    monkeypatch.setattr(qlearn.mdp.planning, "_SPARSE", 0)
    np.testing.assert_allclose(value_iteration(mdp, values)[0], expected[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(evaluate_policy(mdp, random_policy(mdp, 0)), expected[1], rtol=0, atol=1e-12)


def test_policy_loss_is_the_loss_of_the_vector_value() -> None:
    for seed in range(3):
        mdp, values = messy_mdp(seed)
        policy = random_policy(mdp, seed)
        v, e = value_iteration(mdp, values)[0], mdp.normalise(values)
        by_vector = np.maximum(v - evaluate_policy(mdp, policy) @ e, 0)
        np.testing.assert_allclose(policy_loss(mdp, policy, values), by_vector, rtol=0, atol=1e-12)
        assert by_vector.max() > 0.01


# --- value iteration -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_value_iteration_against_plain_loops(seed: int) -> None:
    mdp, values = messy_mdp(seed)
    v, policy = value_iteration(mdp, values)
    np.testing.assert_allclose(v, naive_value(mdp, values), rtol=0, atol=1e-10)
    assert mdp.admissible[np.arange(mdp.n_states), policy].all()
    e = mdp.normalise(values)
    assert (v[mdp.terminal] == e[mdp.final_level[mdp.terminal]]).all()  # exactly


@pytest.mark.parametrize("seed", range(4))
def test_value_iteration_against_the_linear_program(seed: int) -> None:
    """Minimise sum v subject to v(s) >= Q(s, a) for all admissible a (Puterman 1994, section 6.9)."""
    mdp, values = messy_mdp(seed, n=20, m=4, k=6, discount=0.95)
    e, n, m = mdp.normalise(values), mdp.n_states, mdp.n_actions
    rows = (np.eye(n)[:, None] - mdp.discount * mdp.transitions.toarray().reshape(n, m, n))[mdp.admissible]
    floor = (1 - mdp.discount) * e[mdp.levels][mdp.admissible]
    solved = linprog(np.ones(n), A_ub=-rows, b_ub=-floor, bounds=(None, None), method="highs")
    assert solved.status == 0
    np.testing.assert_allclose(value_iteration(mdp, values)[0], solved.x, rtol=0, atol=1e-8)


@settings(deadline=None, max_examples=40)
@given(n=st.integers(1, 25), m=st.integers(1, 4), k=st.integers(2, 8), seed=st.integers(0, 10**6), g=st.floats(0, 0.99))
@example(n=4, m=2, k=2, seed=14627, g=0.9375)  # two states reach the best level only: v rounds to above 1
def test_value_iteration_satisfies_bellman(n: int, m: int, k: int, seed: int, g: float) -> None:
    mdp, values = random_mdp(n, m, k, g, rng=seed)
    e = mdp.normalise(values)
    v, policy = value_iteration(mdp, values)
    q = (1 - g) * e[mdp.levels] + g * (mdp.transitions @ v).reshape(n, m)
    np.testing.assert_allclose(v, q.max(axis=1), rtol=0, atol=1e-10)
    assert (v >= 0).all()
    assert (v <= 1).all()
    np.testing.assert_allclose(evaluate_policy(mdp, policy) @ e, v, rtol=0, atol=1e-9)
    assert policy_loss(mdp, policy, values).max() < 1e-9


def test_values_count_only_up_to_an_increasing_affine_map() -> None:
    mdp, values = random_mdp(30, 3, 5, rng=2)
    v, policy = value_iteration(mdp, values)
    w, other = value_iteration(mdp, 3 * values - 100)
    np.testing.assert_allclose(v, w, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(policy, other)


def test_v_is_the_scalar_value_in_shares() -> None:
    """(1 - discount) times the raw discounted sum of rewards, less the worst value, over the range."""
    mdp, values = random_mdp(15, 3, 5, rng=4)
    r, table = mdp.rewards(values), mdp.transitions.toarray().reshape(15, 3, 15)
    raw = np.zeros(15)
    for _ in range(1000):
        raw = (r + mdp.discount * table @ raw).max(axis=1)
    shares = ((1 - mdp.discount) * raw - values[0]) / (values[-1] - values[0])
    np.testing.assert_allclose(value_iteration(mdp, values)[0], shares, rtol=0, atol=1e-10)


def test_ties_take_the_lowest_action_even_when_sums_round_apart() -> None:
    rng, levels = np.random.default_rng(0), np.array([[1, 1], *[[i % 3, i % 3] for i in range(6)]])
    for _ in range(50):
        p, share = rng.dirichlet(np.ones(6)), rng.random(6)
        once = np.concatenate([p, np.zeros(6)])
        split = np.concatenate([share * p, (1 - share) * p])  # the same distribution, written differently
        states = np.tile(np.arange(1, 7), 2)
        chances = np.concatenate([[[once, split]], np.repeat(np.eye(12)[:6, None], 2, axis=1)])
        mdp = OrdinalMDP(np.broadcast_to(states, (7, 2, 12)), chances, levels, 0.9, ("a", "b", "c"))
        assert value_iteration(mdp, [0, 0.3, 1])[1][0] == 0


@pytest.mark.parametrize("discount", [0.3, 0.7, 0.95, 0.99, 0.999])
def test_a_terminal_state_is_worth_its_level_exactly(discount: float) -> None:
    k = 30
    table = np.zeros((k + 1, 1, k + 1))
    table[0, 0, 1:] = 1 / k
    levels, labels = np.array([0, *range(k)])[:, None], [f"l{i}" for i in range(k)]
    mdp = OrdinalMDP.from_dense(table, levels, discount, labels, terminal=np.arange(k + 1) > 0)
    values = draw_values(k, 3)
    np.testing.assert_array_equal(value_iteration(mdp, values)[0][1:], mdp.normalise(values))
    np.testing.assert_array_equal(evaluate_policy(mdp, np.zeros(k + 1, int))[1:], np.eye(k))


def test_discount_zero_is_greedy() -> None:
    mdp, values = random_mdp(10, 3, 5, 0.0, rng=1)
    v, policy = value_iteration(mdp, values)
    e = mdp.normalise(values)[mdp.levels]
    np.testing.assert_array_equal(v, e.max(axis=1))
    np.testing.assert_array_equal(policy, e.argmax(axis=1))


def test_large_problems_take_the_iterative_path_and_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    mdp, values = random_mdp(700, 3, 6, 0.99, rng=9)
    iterative, policy = value_iteration(mdp, values)
    shares = evaluate_policy(mdp, policy)
    monkeypatch.setattr(qlearn.mdp.planning, "_DENSE", 10_000)
    dense, same = value_iteration(mdp, values)
    np.testing.assert_allclose(iterative, dense, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(policy, same)
    np.testing.assert_allclose(shares, evaluate_policy(mdp, policy), rtol=0, atol=1e-11)


@pytest.mark.parametrize("discount", [0.9, 0.999])
def test_a_chain_that_never_mixes(discount: float) -> None:
    """A ring, on which Krylov methods fail: the value is a geometric series."""
    n = 900
    levels = np.zeros((n, 1), dtype=np.int32)
    levels[0] = 1
    ring = OrdinalMDP(((np.arange(n) + 1) % n)[:, None, None], np.ones((n, 1, 1)), levels, discount, ("off", "on"))
    ahead = (n - np.arange(n)) % n
    expected = (1 - discount) * np.float64(discount) ** ahead / (1 - discount**n)
    np.testing.assert_allclose(value_iteration(ring, [0, 1])[0], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(evaluate_policy(ring, np.zeros(n, int))[:, 1], expected, rtol=0, atol=1e-12)


def test_the_same_input_gives_the_same_bits() -> None:
    mdp, values = random_mdp(450, 3, 6, rng=9)
    (v, policy), (w, other) = value_iteration(mdp, values), value_iteration(mdp, values)
    np.testing.assert_array_equal(v, w)
    np.testing.assert_array_equal(policy, other)


@pytest.mark.parametrize("tolerance", [0, -1e-3, np.nan, np.inf, "a", None])
def test_bad_tolerance(tolerance: float) -> None:
    mdp, values = random_mdp(5, 2, 3, rng=0)
    with pytest.raises(ValueError, match="tolerance must be a positive number"):
        value_iteration(mdp, values, tolerance)


def test_a_tolerance_below_rounding_is_refused() -> None:
    mdp, values = random_mdp(50, 2, 5, 0.9999999, rng=0)
    with pytest.raises(ValueError, match="finer than floats can certify"):
        value_iteration(mdp, values, 1e-300)
    value_iteration(mdp, values, 1e-6)


# --- evaluating a policy ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_evaluate_policy_against_a_dense_solve(seed: int) -> None:
    mdp, _ = messy_mdp(seed)
    policy = random_policy(mdp, seed)
    shares = evaluate_policy(mdp, policy)
    np.testing.assert_allclose(shares, dense_shares(mdp, policy), rtol=0, atol=1e-12)
    np.testing.assert_allclose(shares.sum(axis=1), 1, rtol=0, atol=1e-14)
    assert (shares >= 0).all()
    np.testing.assert_array_equal(shares[mdp.terminal], np.eye(mdp.k)[mdp.final_level[mdp.terminal]])


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10**6), g=st.floats(0, 0.995))
def test_proposition_1(seed: int, g: float) -> None:
    """The scalar value of a policy, eq. (1), is its vector value times the scale."""
    mdp, values = messy_mdp(seed, discount=g)
    policy = random_policy(mdp, seed)
    e, n, m = mdp.normalise(values), mdp.n_states, mdp.n_actions
    chain = np.einsum("sa,sat->st", policy, mdp.transitions.toarray().reshape(n, m, n))
    scalar = np.linalg.solve(np.eye(n) - g * chain, (1 - g) * (policy * e[mdp.levels]).sum(axis=1))
    np.testing.assert_allclose(evaluate_policy(mdp, policy) @ e, scalar, rtol=0, atol=1e-11)


def test_a_hand_computed_case() -> None:
    """0 -> 1 -> goal, levels pit < step < goal: shares .1, then .09, then the rest."""
    table = np.zeros((3, 1, 3))
    table[0, 0, 1] = table[1, 0, 2] = 1
    mdp = OrdinalMDP.from_dense(table, [[1], [1], [2]], 0.9, ("pit", "step", "goal"), terminal=[0, 0, 1])
    by_hand = np.array([[0, 0.19, 0.81], [0, 0.1, 0.9], [0, 0, 1]])
    np.testing.assert_allclose(evaluate_policy(mdp, [0, 0, 0]), by_hand, atol=1e-15)
    np.testing.assert_allclose(value_iteration(mdp, [0, 1, 2])[0], [0.905, 0.95, 1], atol=1e-15)


def test_actions_and_their_one_hot_rows_are_the_same_policy() -> None:
    mdp, values = messy_mdp(3)
    _, policy = value_iteration(mdp, values)
    np.testing.assert_array_equal(evaluate_policy(mdp, policy), evaluate_policy(mdp, np.eye(mdp.n_actions)[policy]))


def test_entries_at_terminal_states_are_not_read() -> None:
    mdp, values = messy_mdp(3)
    _, policy = value_iteration(mdp, values)
    expected, stochastic = evaluate_policy(mdp, policy), np.eye(mdp.n_actions)[policy]
    policy[mdp.terminal], stochastic[mdp.terminal] = 99, np.nan
    np.testing.assert_array_equal(evaluate_policy(mdp, policy), expected)
    np.testing.assert_array_equal(evaluate_policy(mdp, stochastic), expected)


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        ([0, 1], r"must be \(3,\) integers.*not \(2,\)"),
        ([0.0, 1.0, 0.0], "float64"),
        ([0, 2, 0], r"policy\[1\] is 2, but must be an action in 0..1"),
        ([-1, 0, 0], r"policy\[0\] is -1"),
        ([0, 1, 0], r"policy\[1\] is 1, but must take admissible actions only, which are \[0\]"),
        ([[0.5, 0.5], [0.5, 0.5], [1, 0]], r"policy\[1\] is \[0.5 0.5\], but must take admissible"),
        ([[0.5, 0.6], [1, 0], [1, 0]], r"policy\[0\] is \[0.5 0.6\].*sum to 1"),
        ([[1.5, -0.5], [1, 0], [1, 0]], r"policy\[0\].*probabilities"),
        ([[np.nan, 1], [1, 0], [1, 0]], r"policy\[0\].*probabilities"),
        ([["a", "b"]] * 3, "policy must be"),
    ],
)
def test_bad_policies(policy: Any, message: str) -> None:
    table = np.full((3, 2, 3), 1 / 3)
    mdp = OrdinalMDP.from_dense(
        table, np.zeros((3, 2)), 0.9, ("a", "b"), terminal=[0, 0, 1], admissible=[[1, 1], [1, 0], [1, 1]]
    )
    with pytest.raises(ValueError, match=message):
        evaluate_policy(mdp, policy)
    with pytest.raises(ValueError, match=message):
        policy_loss(mdp, policy, [0, 1])
    with pytest.raises(ValueError, match=message):
        absorption_probability(mdp, policy, 2)


def test_policy_loss_is_the_gap_to_the_optimum() -> None:
    mdp, values = messy_mdp(1)
    best, optimal = value_iteration(mdp, values)
    policy = random_policy(mdp, 5)
    loss = policy_loss(mdp, policy, values)
    np.testing.assert_allclose(loss, best - dense_shares(mdp, policy) @ mdp.normalise(values), rtol=0, atol=1e-9)
    assert loss.max() > 0.01
    assert (loss[mdp.terminal] == 0).all()
    assert policy_loss(mdp, optimal, values).max() < 1e-10
    assert (policy_loss(mdp, optimal, values) >= 0).all()


# --- where a run ends ------------------------------------------------------------------------------------------------


def gambler(p: float, n: int = 10, bold: bool = False) -> OrdinalMDP:
    """Fortunes 0..n, the ends terminal; stake 1, or (bold) also as much as helps, or wait for ever."""
    table = np.zeros((n + 1, 3, n + 1))
    for s in range(1, n):
        most = min(s, n - s)
        table[s, 0, s + 1], table[s, 0, s - 1] = p, 1 - p
        table[s, 1, s + most], table[s, 1, s - most] = p, 1 - p
        table[s, 2, s] = 1
    ends = np.isin(np.arange(n + 1), (0, n))
    levels = np.repeat(np.where(np.arange(n + 1) == n, 2, np.where(ends, 0, 1))[:, None], 3, axis=1)
    offered = np.repeat([[True, bold, bold]], n + 1, axis=0)
    return OrdinalMDP.from_dense(table, levels, 0.5, ("ruin", "play", "win"), terminal=ends, admissible=offered)


@pytest.mark.parametrize("p", [0.3, 0.5, 0.6])
def test_gamblers_ruin(p: float) -> None:
    i, n = np.arange(11), 10
    expected = i / n if p == 0.5 else (1 - ((1 - p) / p) ** i) / (1 - ((1 - p) / p) ** n)
    game = gambler(p)
    np.testing.assert_allclose(absorption_probability(game, np.zeros(11, int), 10), expected, atol=1e-12)
    np.testing.assert_allclose(absorption_probability(game, np.zeros(11, int), 0), 1 - expected, atol=1e-12)
    np.testing.assert_allclose(best_absorption_probability(game, 10)[0], expected, atol=1e-12)


@pytest.mark.parametrize("p", [0.3, 0.6])
def test_best_absorption_against_undiscounted_value_iteration(p: float) -> None:
    """Timid play is best in a favourable game, bold play in an unfair one; waiting for ever never."""
    game = gambler(p, bold=True)
    table, v = game.transitions.toarray().reshape(11, 3, 11), np.eye(11)[10]
    for _ in range(5000):
        v = np.where(game.terminal, v, (table @ v).max(axis=1))
    best, policy = best_absorption_probability(game, 10)
    np.testing.assert_allclose(best, v, atol=1e-10)
    np.testing.assert_allclose(absorption_probability(game, policy, 10), best, atol=1e-12)
    assert 2 not in policy[1:-1]


def test_a_run_that_goes_on_for_ever_ends_nowhere() -> None:
    waiting = np.full(11, 2)
    np.testing.assert_array_equal(absorption_probability(gambler(0.5, bold=True), waiting, 10), np.eye(11)[10])


def test_absorption_wants_a_terminal_state() -> None:
    game = gambler(0.5)
    for state in (5, 11, -1):
        with pytest.raises(ValueError, match=rf"state {state} is not terminal; terminal states: \[0, 10\]"):
            absorption_probability(game, np.zeros(11, int), state)
        with pytest.raises(ValueError, match="not terminal"):
            best_absorption_probability(game, state)
