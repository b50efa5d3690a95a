"""Planning is ground truth, so each function is held to at least one independent method."""

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import linprog

from qlearn import (
    OrdinalMDP,
    draw_values,
    evaluate_policy,
    policy_loss,
    random_mdp,
    value_iteration,
)
from qlearn.mdp import linear_systems
from qlearn.mdp.planning import optimal_policy, valued
from tests.mdp_cases import messy_mdp
from tests.scale_arithmetic import Floats
from tests.thoroughness import examples


def random_policy(mdp: OrdinalMDP, seed: int) -> Floats:
    weights = np.random.default_rng(seed).random(mdp.levels.shape) * mdp.admissible
    policy: Floats = weights / weights.sum(axis=1, keepdims=True)
    return policy


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
    stuck = lambda matrix, residual, rtol, maxiter: (0.0 * residual, maxiter)  # noqa: E731
    monkeypatch.setattr(linear_systems, "bicgstab", stuck)
    monkeypatch.setattr(linear_systems, "splu", None)
    monkeypatch.setattr(linear_systems, "_DENSE", 0)
    monkeypatch.setattr(linear_systems, "_SPARSE", 0)
    np.testing.assert_allclose(value_iteration(mdp, values)[0], expected[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        evaluate_policy(mdp, random_policy(mdp, 0)), expected[1], rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("seed", range(4))
def test_v_is_the_scalar_value_in_shares(seed: int) -> None:
    """(1 - discount) times the raw discounted sum of rewards, by plain sweeps, less the worst
    value, over the range.
    """
    for mdp, values in (
        messy_mdp(seed),
        messy_mdp(seed, discount=0.1),
        random_mdp(15, 3, 5, rng=seed),
    ):
        n, m = mdp.levels.shape
        r, table = (
            mdp.rewards(values),
            mdp.transitions.toarray().reshape(n, m, n),
        )  # a terminal state loops
        raw = np.zeros(n)
        for _ in range(1000):
            raw = np.where(mdp.admissible, r + mdp.discount * table @ raw, -np.inf).max(axis=1)
        v, policy = value_iteration(mdp, values)
        np.testing.assert_allclose(
            v, ((1 - mdp.discount) * raw - values[0]) / np.ptp(values), rtol=0, atol=1e-10
        )
        assert mdp.admissible[np.arange(n), policy].all()
        assert (
            v[mdp.terminal] == mdp.normalise(values)[mdp.final_level[mdp.terminal]]
        ).all()  # exactly


@pytest.mark.parametrize("seed", range(4))
def test_value_iteration_against_the_linear_program(seed: int) -> None:
    """Minimise sum v subject to v(s) >= Q(s, a) for all admissible a (Puterman 1994, section
    6.9).
    """
    mdp, values = messy_mdp(seed, n=20, m=4, k=6, discount=0.95)
    e, n, m = mdp.normalise(values), mdp.n_states, mdp.n_actions
    rows = (np.eye(n)[:, None] - mdp.discount * mdp.transitions.toarray().reshape(n, m, n))[
        mdp.admissible
    ]
    floor = (1 - mdp.discount) * e[mdp.levels][mdp.admissible]
    solved = linprog(np.ones(n), A_ub=-rows, b_ub=-floor, bounds=(None, None), method="highs")
    assert solved.status == 0
    np.testing.assert_allclose(value_iteration(mdp, values)[0], solved.x, rtol=0, atol=1e-8)


@examples(40)
@given(
    n=st.integers(1, 25),
    m=st.integers(1, 4),
    k=st.integers(2, 8),
    seed=st.integers(0, 10**6),
    g=st.floats(0, 0.99),
)
@example(n=10, m=3, k=5, seed=1, g=0.0)
@example(
    n=4, m=2, k=2, seed=14627, g=0.9375
)  # two states reach the best level only: v rounds to above 1
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


def test_ties_take_the_lowest_action_even_when_sums_round_apart() -> None:
    rng, levels = np.random.default_rng(0), np.array([[1, 1], *[[i % 3, i % 3] for i in range(6)]])
    for _ in range(50):
        p, share = rng.dirichlet(np.ones(6)), rng.random(6)
        once = np.concatenate([p, np.zeros(6)])
        split = np.concatenate(
            [share * p, (1 - share) * p]
        )  # the same distribution, written differently
        states = np.tile(np.arange(1, 7), 2)
        chances = np.concatenate([[[once, split]], np.repeat(np.eye(12)[:6, None], 2, axis=1)])
        mdp = OrdinalMDP(np.broadcast_to(states, (7, 2, 12)), chances, levels, 0.9, ("a", "b", "c"))
        assert value_iteration(mdp, [0, 0.3, 1])[1][0] == 0


def test_of_equally_good_actions_the_first_is_taken_wherever_the_search_begins() -> None:
    mdp, values = messy_mdp(0, m=2)
    doubled = OrdinalMDP(
        *(np.tile(array, (1, 2, 1)) for array in (mdp.successors, mdp.probabilities)),
        np.tile(mdp.levels, 2), mdp.discount, mdp.labels, terminal=mdp.terminal,
        admissible=np.tile(mdp.admissible, 2),
    )  # fmt: skip
    best = value_iteration(mdp, values)[1]
    for start in (best, best + 2):  # the same actions under other numbers
        np.testing.assert_array_equal(optimal_policy(doubled, mdp.normalise(values), start), best)


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


def test_large_problems_take_the_iterative_path_and_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    mdp, values = random_mdp(700, 3, 6, 0.99, rng=9)
    iterative, policy = value_iteration(mdp, values)
    shares = evaluate_policy(mdp, policy)
    monkeypatch.setattr(linear_systems, "_DENSE", 10_000)
    dense, same = value_iteration(mdp, values)
    np.testing.assert_allclose(iterative, dense, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(policy, same)
    np.testing.assert_array_equal(value_iteration(mdp, values)[0], dense)  # the same bits each time
    np.testing.assert_array_equal(
        shares, evaluate_policy(mdp, policy)
    )  # rounded once, however they were solved for


@pytest.mark.parametrize("discount", [0.9, 0.999])
def test_a_chain_that_never_mixes(discount: float) -> None:
    """A ring, on which Krylov methods fail: the value is a geometric series."""
    n = 900
    levels = np.zeros((n, 1), dtype=np.int32)
    levels[0] = 1
    ring = OrdinalMDP(
        ((np.arange(n) + 1) % n)[:, None, None], np.ones((n, 1, 1)), levels, discount, ("off", "on")
    )
    ahead = (n - np.arange(n)) % n
    expected = (1 - discount) * np.float64(discount) ** ahead / (1 - discount**n)
    np.testing.assert_allclose(value_iteration(ring, [0, 1])[0], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        evaluate_policy(ring, np.zeros(n, int))[:, 1], expected, rtol=0, atol=1e-12
    )


def test_a_line_on_which_krylov_methods_diverge_until_numbers_overflow() -> None:
    n, discount = 500, 0.999
    ends = np.minimum(np.arange(n) + 1, n - 1)
    line = OrdinalMDP(
        ends[:, None, None], np.ones((n, 1, 1)), np.zeros((n, 1), int), discount, ("off", "on")
    )
    gain = np.full((n, 1), 1e-14)
    gain[n // 2] = 1e-3
    found = valued(line, line.transitions, gain, np.zeros((n, 1)))[:, 0]
    ahead = np.maximum(n // 2 - np.arange(n), 0)
    expected = np.where(np.arange(n) <= n // 2, 1e-3 * np.float64(discount) ** ahead, 0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_a_tolerance_that_cannot_be_or_is_below_rounding_is_refused() -> None:
    mdp, values = random_mdp(50, 2, 5, 0.9999999, rng=0)
    bad: Any
    for bad in (0, -1e-3, np.nan, np.inf, "a", None):
        with pytest.raises(ValueError, match="tolerance must be a positive number"):
            value_iteration(mdp, values, bad)
    with pytest.raises(ValueError, match="finer than floats can certify"):
        value_iteration(
            mdp, values, 1e-10
        )  # a sweep changes less, but 1 / (1 - discount) times that may be missing
    value_iteration(mdp, values, 1e-6)


@examples(30)
@given(seed=st.integers(0, 10**6), g=st.floats(0, 0.995))
def test_equation_3_and_proposition_1(seed: int, g: float) -> None:
    """The vector value of a policy is eq. (3), and times the scale its scalar value, eq. (1)."""
    mdp, values = messy_mdp(seed, discount=g)
    policy = random_policy(mdp, seed)
    shares = evaluate_policy(mdp, policy)
    np.testing.assert_allclose(shares, dense_shares(mdp, policy), rtol=0, atol=1e-11)
    np.testing.assert_allclose(shares.sum(axis=1), 1, rtol=0, atol=1e-14)
    assert (shares >= 0).all()
    np.testing.assert_array_equal(
        shares[mdp.terminal], np.eye(mdp.k)[mdp.final_level[mdp.terminal]]
    )
    e, n, m = mdp.normalise(values), mdp.n_states, mdp.n_actions
    chain = np.einsum("sa,sat->st", policy, mdp.transitions.toarray().reshape(n, m, n))
    scalar = np.linalg.solve(np.eye(n) - g * chain, (1 - g) * (policy * e[mdp.levels]).sum(axis=1))
    np.testing.assert_allclose(shares @ e, scalar, rtol=0, atol=1e-11)


def test_a_hand_computed_case() -> None:
    """0 -> 1 -> goal, levels pit < step < goal: shares .1, then .09, then the rest."""
    table = np.zeros((3, 1, 3))
    table[0, 0, 1] = table[1, 0, 2] = 1
    mdp = OrdinalMDP.from_dense(
        table, [[1], [1], [2]], 0.9, ("pit", "step", "goal"), terminal=[0, 0, 1]
    )
    by_hand = np.array([[0, 0.19, 0.81], [0, 0.1, 0.9], [0, 0, 1]])
    np.testing.assert_allclose(evaluate_policy(mdp, [0, 0, 0]), by_hand, atol=1e-15)
    np.testing.assert_allclose(value_iteration(mdp, [0, 1, 2])[0], [0.905, 0.95, 1], atol=1e-15)


def test_actions_and_their_one_hot_rows_are_the_same_policy_and_terminal_entries_are_not_read() -> (
    None
):
    mdp, values = messy_mdp(3)
    _, policy = value_iteration(mdp, values)
    expected, stochastic = evaluate_policy(mdp, policy), np.eye(mdp.n_actions)[policy]
    np.testing.assert_array_equal(evaluate_policy(mdp, stochastic), expected)
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
        table,
        np.zeros((3, 2)),
        0.9,
        ("a", "b"),
        terminal=[0, 0, 1],
        admissible=[[1, 1], [1, 0], [1, 1]],
    )
    with pytest.raises(ValueError, match=message):
        evaluate_policy(mdp, policy)
    with pytest.raises(ValueError, match=message):
        policy_loss(mdp, policy, [0, 1])


@pytest.mark.parametrize("seed", range(3))
def test_policy_loss_is_the_gap_to_the_optimum(seed: int) -> None:
    mdp, values = messy_mdp(seed)
    best, optimal = value_iteration(mdp, values)
    policy = random_policy(mdp, seed)
    loss = policy_loss(mdp, policy, values)
    np.testing.assert_allclose(
        loss, best - dense_shares(mdp, policy) @ mdp.normalise(values), rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(policy_loss(mdp, policy, values, optimum=best), loss)
    assert loss.max() > 0.01
    assert (loss[mdp.terminal] == 0).all()
    assert (
        0
        <= policy_loss(mdp, optimal, values).min()
        <= policy_loss(mdp, optimal, values).max()
        < 1e-10
    )
