"""A round keeps its policy only while it is the one that a search from nothing finds."""

import numpy as np
import pytest

from qlearn import OrdinalMDP
from qlearn.learners.rounds.exact import ExactRounds
from qlearn.mdp.planning import optimal_policy
from tests.own_cases import Exact

SURE, LOTTERY = [2, 2], [1, 3]  # the end at the middle level; the end at the worst or at the best
MIDDLES = [0.4, 0.5, 0.6, 0.5, 0.4]  # at .5 both are as good, and the first action is to be taken


@pytest.mark.parametrize("actions", [(SURE, LOTTERY), (LOTTERY, SURE)])
def test_rounds_of_changing_scales_have_the_policies_of_searches_from_nothing(
    actions: tuple[list[int], list[int]],
) -> None:
    successors = np.array([actions] + [[[s, s]] * 2 for s in (1, 2, 3)])
    levels = [[0, 0], [0, 0], [1, 1], [2, 2]]
    terminal = [False, True, True, True]
    halves = np.full((4, 2, 2), 0.5)
    mdp = OrdinalMDP(
        successors, halves, levels, 0.5, ("bad", "middling", "good"), terminal=terminal
    )
    rounds = ExactRounds(mdp, 0.0)
    for middle in MIDDLES:
        scale = Exact([0.0, middle, 1.0])
        policy = rounds.round(scale)[0].policy
        expected = optimal_policy(mdp, scale.values, np.zeros(4, dtype=np.int64))
        np.testing.assert_array_equal(policy, expected)
        if middle == 0.5:
            assert policy[0] == 0
