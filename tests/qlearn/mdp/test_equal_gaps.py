"""The policy of equal gaps is held to a linear program, and its loss to plain linear systems."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from qlearn import (
    OrdinalMDP,
    draw_values,
    equal_gaps_policy,
    evaluate_policy,
    policy_loss,
    unasked_loss,
)
from qlearn.problems import FAMILIES
from tests.mdp_cases import messy_mdp
from tests.scale_arithmetic import Floats
from tests.thoroughness import quick_first

CASES = [messy_mdp(seed)[0] for seed in range(4)] + [make(1) for make in FAMILIES.values()]
cases = pytest.mark.parametrize("mdp", quick_first(CASES, 9))


def table_of(mdp: OrdinalMDP) -> Floats:
    """Transitions (S, A, S), in which terminal states loop."""
    return np.asarray(mdp.transitions.toarray()).reshape(mdp.n_states, mdp.n_actions, mdp.n_states)


def optimum(mdp: OrdinalMDP, values: Floats) -> Floats:
    """The optimal value (S,) in shares, as the least v that no action improves: by HiGHS."""
    rows, n = mdp.admissible.ravel(), mdp.n_states
    own = np.repeat(np.eye(n), mdp.n_actions, axis=0)[rows]
    moves = table_of(mdp).reshape(-1, n)[rows]
    gain = (1 - mdp.discount) * values[mdp.levels].ravel()[rows]
    found = linprog(
        np.ones(n), A_ub=mdp.discount * moves - own, b_ub=-gain, bounds=(None, None), method="highs"
    )
    return np.asarray(found.x)


def value_of(mdp: OrdinalMDP, policy: Any, values: Floats) -> Floats:
    """The value (S,) of a policy, by one dense linear system."""
    s = np.arange(mdp.n_states)
    chosen = np.where(
        mdp.admissible[s, policy], policy, mdp.admissible.argmax(axis=1)
    )  # at the end
    gain = (1 - mdp.discount) * values[mdp.levels[s, chosen]]
    return np.asarray(
        np.linalg.solve(np.eye(len(s)) - mdp.discount * table_of(mdp)[s, chosen], gain)
    )


@cases
def test_it_is_best_if_gaps_are_equal_by_a_linear_program(mdp: OrdinalMDP) -> None:
    values = np.linspace(0, 1, mdp.k)
    policy = equal_gaps_policy(mdp)
    assert mdp.admissible[np.arange(mdp.n_states), policy].all()
    np.testing.assert_allclose(
        value_of(mdp, policy, values), optimum(mdp, values), rtol=0, atol=2e-7
    )
    np.testing.assert_array_equal(policy, equal_gaps_policy(mdp))


@cases
def test_its_loss_is_the_difference_of_two_second_opinions(mdp: OrdinalMDP) -> None:
    hidden = draw_values(mdp.k, seed=3)
    scale = (hidden - hidden[0]) / (hidden[-1] - hidden[0])
    policy = equal_gaps_policy(mdp)
    lost = optimum(mdp, scale) - value_of(mdp, policy, scale)
    loss = unasked_loss(mdp, hidden)
    assert loss.worst == pytest.approx(lost.max(), abs=2e-7)
    assert loss.initial == pytest.approx(mdp.initial @ lost, abs=2e-7)
    assert loss == unasked_loss(mdp, hidden, policy)
    assert loss.worst == policy_loss(mdp, policy, hidden).max()


def two_ways(better: float) -> OrdinalMDP:
    """Two actions; the second leads to the best level with so much more probability."""
    moves = [[[0, 0.5, 0.5], [0, 0.5 - better, 0.5 + better]], [[0, 1, 0]] * 2, [[0, 0, 1]] * 2]
    levels = [[1, 1], [0, 0], [2, 2]]
    return OrdinalMDP.from_dense(
        moves, levels, 0.9, ["low", "middle", "high"], terminal=[False, True, True]
    )


@pytest.mark.parametrize(
    ("better", "action"), [(0.0, 0), (1e-12, 0), (1e-10, 0), (1e-6, 1), (-1e-6, 0)]
)
def test_what_is_as_good_goes_by_its_index(better: float, action: int) -> None:
    assert equal_gaps_policy(two_ways(better))[0] == action


def test_a_coarser_tie_is_allowed_and_nonsense_is_not() -> None:
    assert equal_gaps_policy(two_ways(1e-6), tie=1e-4)[0] == 0
    for tie in (0, -1, 2, np.nan, "1"):
        with pytest.raises(
            ValueError, match="tie must be a share of the value range from 1e-12 to 1"
        ):
            equal_gaps_policy(two_ways(0), tie=tie)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="3 numbers"):
        unasked_loss(two_ways(0), [0, 1])


def test_equal_gaps_lose_nothing_and_a_bad_guess_loses_what_it_says() -> None:
    mdp = two_ways(0.1)
    assert unasked_loss(mdp, [3, 4, 5]) == (0.0, 0.0)
    wrong = np.array([0, 0, 0])  # loses a tenth of the best level, after one step
    loss = unasked_loss(mdp, [0, 1, 2], wrong)
    assert loss.worst == pytest.approx(0.9 * 0.1)
    assert loss.initial == pytest.approx(0.9 * 0.1)
    assert evaluate_policy(mdp, wrong)[0, 2] == pytest.approx(0.45)
