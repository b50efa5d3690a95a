"""OrdinalMDPs from tables, state-action pairs and environments are the problems they were made
from.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from elicit import PolytopeComparator, TruthfulTutor
from qlearn import (
    InteractiveValueIteration,
    OrdinalMDP,
    drive,
    policy_loss,
    random_mdp,
    value_iteration,
)
from tests.mdp_cases import messy_mdp
from tests.scale_arithmetic import Floats

ABC = ("a", "b", "c")


@pytest.mark.parametrize(
    "form", ["dense", "csr", "csc", "coo", "by action", "pairs", "dense pairs"]
)
def test_every_table_is_the_problem_it_was_made_from(form: str) -> None:
    for mdp in (random_mdp(9, 3, 4, rng=0)[0], *(messy_mdp(seed)[0] for seed in range(3))):
        p, (n, m) = mdp.transitions, mdp.levels.shape
        rest: dict[str, Any] = {"initial": mdp.initial, "terminal": mdp.terminal}
        named = (mdp.discount, mdp.labels)
        if form == "dense":
            table = p.toarray().reshape(n, m, n)
            again = OrdinalMDP.from_dense(
                table, mdp.levels, *named, **rest, admissible=mdp.admissible
            )
        elif "pairs" in form:
            s, a = np.random.default_rng(1).permutation(np.argwhere(mdp.admissible)).T
            q = p[s * m + a] if form == "pairs" else p[s * m + a].toarray()
            again = OrdinalMDP.from_pairs(mdp.levels[s, a], q, s, a, *named, **rest)
        else:
            given = (
                [p[np.arange(n) * m + a] for a in range(m)]
                if form == "by action"
                else p.asformat(form)
            )
            again = OrdinalMDP.from_sparse(
                given, mdp.levels, *named, **rest, admissible=mdp.admissible
            )
        np.testing.assert_array_equal(again.transitions.toarray(), p.toarray())
        for name in ("initial", "terminal", "admissible"):
            np.testing.assert_array_equal(getattr(again, name), getattr(mdp, name))
        np.testing.assert_array_equal(again.levels[mdp.admissible], mdp.levels[mdp.admissible])
        assert (again.discount, again.labels) == named
        assert again.successors.shape[2] == np.diff(p.indptr).max()


def test_from_dense_ignores_rows_never_read_and_refuses_other_shapes() -> None:
    table = np.full((2, 1, 2), np.nan)
    table[0, 0] = [0, 1]
    mdp = OrdinalMDP.from_dense(table, [[0], [1]], 0.9, ("a", "b"), terminal=[False, True])
    np.testing.assert_array_equal(mdp.transitions.toarray(), [[0, 1], [0, 1]])
    assert mdp.successors.shape == (2, 1, 1)
    for shape in ((2, 2), (2, 1, 3), (0, 1, 0)):
        with pytest.raises(ValueError, match=r"\(S, A, S\)"):
            OrdinalMDP.from_dense(np.ones(shape), [[0]], 0.9, ("a", "b"))
    with pytest.raises(ValueError, match=r"of \(A, S, S\) give transitions.transpose\(1, 0, 2\)"):
        OrdinalMDP.from_dense(np.ones((3, 2, 2)), [[0]], 0.9, ("a", "b"))


def test_from_sparse_leaves_its_argument_alone_and_drops_zeros() -> None:
    table = sparse.csr_matrix(([0.5, 0.0, 0.5, 1.0], [1, 0, 1, 0], [0, 3, 4]), shape=(2, 2))
    before = table.data.copy(), table.indices.copy()
    mdp = OrdinalMDP.from_sparse(table, [[0], [1]], 0.9, ("a", "b"))
    np.testing.assert_array_equal(mdp.transitions.toarray(), [[0, 1], [1, 0]])
    assert mdp.successors.shape == (2, 1, 1)
    np.testing.assert_array_equal(table.data, before[0])
    np.testing.assert_array_equal(table.indices, before[1])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (sparse.csr_array((5, 2)), r"must have shape \(S\*A, S\), not \(5, 2\)"),
        (sparse.csr_array(np.eye(2) / 2), r"probabilities\[0, 0\] sums to 0.5"),
        (
            [sparse.csr_array(np.eye(2)), sparse.csr_array(np.eye(3))],
            r"transitions\[1\] is \(3, 3\)",
        ),
        ([], "not empty"),
        ([np.eye(2)], r"transitions\[0\] must be a SciPy sparse matrix, not ndarray"),
    ],
)
def test_from_sparse_refuses(given: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        OrdinalMDP.from_sparse(given, [[0], [1]], 0.9, ("a", "b"))


def pairs(**changed: Any) -> dict[str, Any]:
    """Two states; one action in the first, two in the second."""
    given: dict[str, Any] = {
        "levels": [0, 1, 2], "transitions": sparse.csr_array([[0, 1], [1, 0], [0.5, 0.5]]),
        "s_indices": [0, 1, 1], "a_indices": [0, 0, 1], "discount": 0.9, "labels": ABC,
    }  # fmt: skip
    return given | changed


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"a_indices": [0, 1, 1]}, r"pair 2 is \(state 1, action 1\), which came before"),
        ({"s_indices": [0, 0, 0], "a_indices": [0, 1, 2]}, "state 1 has no admissible action"),
        ({"s_indices": [0, 1, 2]}, r"s_indices\[2\] is 2, but must be in 0..1"),
        ({"a_indices": [0, -1, 1]}, r"a_indices\[1\] is -1"),
        ({"levels": [0, 1, 3]}, r"levels\[2\] is 3, but must be in 0..2"),
        ({"levels": [0, 1]}, r"levels must have shape \(3,\)"),
        ({"transitions": np.eye(3)}, "state 2 has no admissible action"),
        ({"transitions": np.ones(3)}, r"must have shape \(L, S\)"),
        ({"transitions": sparse.csr_array((0, 2))}, "each at least 1"),
        (
            {"transitions": sparse.csr_array([[0, 1], [1, 0], [0.5, 0]])},
            r"probabilities\[1, 1\] sums to 0.5",
        ),
    ],
)
def test_from_pairs_refuses(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        OrdinalMDP.from_pairs(**pairs(**changed))


def optimal(table: Any, discount: float) -> Floats:
    """v* (n,) of an environment as reinforcement learning has it: rewards as numbers, nothing after
    the end.
    """
    v = np.zeros(len(table))

    def worth(outcomes: Any) -> float:
        return float(sum(p * (r + discount * v[t] * (not over)) for p, t, r, over in outcomes))

    for _ in range(400):
        v = np.array([max(map(worth, table[s].values())) for s in range(len(table))])
    return v


def fork(rewards: tuple[float, float, float] = (0.0, 1.0, -1.0)) -> Any:
    """State 0 chooses between walking on (to 1, sometimes back) and stopping; state 1 ends either
    way.
    """
    walk, win, lose = rewards
    return {
        0: {0: [(0.75, 1, walk, False), (0.25, 0, walk, False)], 1: [(1.0, 0, lose, True)]},
        1: {0: [(1.0, 0, win, True)], 1: [(1.0, 1, lose, True)]},
    }


def slippery() -> Any:
    """Return ``fork``, with a reward for walking that depends on where it leads."""
    table = fork()
    table[0][0] = [(0.75, 1, 0.0, False), (0.25, 0, -1.0, False), (0.0, 1, 99.0, True)]
    table[1][0] = [(0.5, 0, 1.0, True), (0.5, 1, -1.0, False)]
    return table


def wrapped(table: Any, **beside: Any) -> Any:
    """An environment behind a wrapper."""
    return SimpleNamespace(unwrapped=SimpleNamespace(P=table, **beside))


def assert_means_the_same(env: Any, discount: float, numbers: list[float]) -> OrdinalMDP:
    """The environment's v* and that of its MDP are one, up to the scale; ``numbers``: its distinct
    rewards.
    """
    table = env.unwrapped.P
    mdp, n = OrdinalMDP.from_environment(env, discount), len(table)
    assert mdp.labels == tuple(f"reward {x:g}" for x in numbers)
    low, high = numbers[0], numbers[-1]
    expected = ((1 - discount) * optimal(table, discount) - low) / (high - low)
    v, policy = value_iteration(mdp, numbers)
    if any(len({r for p, _, r, _ in table[s][a] if p > 0}) > 1 for s in table for a in table[s]):
        e = (np.array(numbers) - low) / (high - low)
        expected = (1 - discount) * e[
            mdp.levels[:n, 0]
        ] + discount * expected  # counted on arrival, a step later
    np.testing.assert_allclose(v[:n], expected, atol=1e-9)
    assert all(int(policy[s]) in table[s] for s in range(n))
    return mdp


def test_an_environment_by_hand() -> None:
    mdp = assert_means_the_same(
        wrapped(fork(), initial_state_distrib=[1.0, 0.0]), 0.9, [-1.0, 0.0, 1.0]
    )
    assert mdp.n_states == 3
    assert mdp.terminal.tolist() == [False, False, True]
    assert mdp.final_level[2] == 1  # after the end: reward 0
    np.testing.assert_array_equal(mdp.initial, [1, 0, 0])
    assert mdp.levels[0].tolist() == [1, 0]


def test_rewards_that_depend_on_the_next_state_are_counted_on_arrival() -> None:
    for discount in (0.5, 0.9):
        mdp = assert_means_the_same(wrapped(slippery()), discount, [-1.0, 0.0, 1.0])
        np.testing.assert_allclose(mdp.initial[:2], 0.5)
        # 0 and 1 after -1, 1 after 0, the end after -1 and after 1, the end
        assert mdp.levels[:, 0].tolist() == [0, 0, 1, 0, 2, 1]


def test_an_environment_without_end_has_no_terminal_state() -> None:
    table = {0: {0: [(1.0, 0, 5.0, False)], 1: [(1.0, 0, 7.0, False)]}}
    mdp = OrdinalMDP.from_environment(SimpleNamespace(P=table), 0.9)
    assert (mdp.n_states, mdp.labels, mdp.terminal.any()) == (1, ("reward 5", "reward 7"), False)
    left = {
        0: {0: [(1.0, 1, 7.0, False)]},
        1: {0: [(1.0, 1, 5.0, False)]},
    }  # nothing leads to the first state
    assert OrdinalMDP.from_environment(SimpleNamespace(P=left), 0.9).levels.tolist() == [[1], [0]]


def test_the_caller_orders_the_rewards() -> None:
    env = wrapped(fork((-5.0, 3.0, 2.0)))
    order = [3.0, -5.0, 0.0, 2.0]
    mdp = OrdinalMDP.from_environment(env, 0.9, levels=order, labels=("w", "x", "y", "z"))
    assert mdp.labels == ("w", "x", "y", "z")
    assert mdp.levels[:2].tolist() == [[1, 3], [0, 3]]
    named = {2.0: "bad", -5.0: "bad", 0.0: "good", 3.0: "good"}
    merged = OrdinalMDP.from_environment(env, 0.9, levels=named)
    assert merged.labels == ("bad", "good")
    assert merged.levels[:2].tolist() == [[0, 0], [1, 0]]
    assert OrdinalMDP.from_environment(env, 0.9, levels=named, labels=("good", "bad")).levels[
        0
    ].tolist() == [1, 1]
    after = OrdinalMDP.from_environment(env, 0.9, after=-5.0)
    assert (after.k, after.final_level[2]) == (3, 0)


@pytest.mark.parametrize(
    ("env", "keywords", "error", "message"),
    [
        (SimpleNamespace(), {}, TypeError, "SimpleNamespace carries no tables"),
        (wrapped(fork()), {"levels": [0.0, 1.0]}, ValueError, r"no level for the rewards \[-1.0\]"),
        (wrapped(fork()), {"levels": [-1.0, 1.0]}, ValueError, r"no level for the rewards \[0.0\]"),
        (wrapped(fork()), {"levels": [0.0, 1.0, -1.0, 1.0]}, ValueError, "each reward once"),
        (wrapped(fork()), {"labels": ("a", "b")}, ValueError, "labels must name 3 levels"),
        (
            wrapped(fork()),
            {"labels": "abc"},
            TypeError,
            "labels must be a sequence of strings, .* not 'abc'",
        ),
        (
            wrapped(fork()),
            {"levels": {0.0: "x", 1.0: "y", -1.0: "z"}, "labels": ("x", "y")},
            ValueError,
            "'z'",
        ),
        (wrapped(fork()), {"initial": [1.0]}, ValueError, r"initial must have shape \(2,\)"),
        (wrapped({0: {0: [(1.0, 4, 0.0, False)]}}), {}, ValueError, "leads to state 4"),
        (wrapped({0: {0: [(0.0, 0, 0.0, False)]}}), {}, ValueError, "no next state"),
        (wrapped({0: {}}), {}, ValueError, "no action"),
        (wrapped({0: {0: [(1.0, 0, 1.0, False)]}}), {}, ValueError, "at least 2 levels"),
    ],
)
def test_from_environment_refuses(
    env: Any, keywords: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        OrdinalMDP.from_environment(env, 0.9, **keywords)


@pytest.mark.parametrize(
    ("name", "numbers"), [("FrozenLake-v1", [0.0, 1.0]), ("CliffWalking-v1", [-100.0, -1.0, 0.0])]
)
def test_gymnasium_toy_texts(name: str, numbers: list[float]) -> None:
    gymnasium = pytest.importorskip("gymnasium")
    env = gymnasium.make(name)
    mdp = assert_means_the_same(env, 0.9, numbers)
    np.testing.assert_allclose(
        mdp.initial[: len(env.unwrapped.P)], env.unwrapped.initial_state_distrib
    )
    learner = InteractiveValueIteration(mdp, PolytopeComparator(mdp.k), tolerance=0.001)
    result = drive(learner, TruthfulTutor(numbers))
    assert policy_loss(mdp, result.policy, numbers).max() <= 0.001
