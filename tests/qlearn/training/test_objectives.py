"""Training for objectives without an order: deep-sea-treasure with hidden weights."""

import numpy as np
import pytest

from benchmarks.training.treasure import treasure
from elicit import PolytopeComparator, TruthfulTutor, objectives
from qlearn import InteractiveTraining, Status
from tests.thoroughness import scaled


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_best_policy_of_deep_sea_treasure_is_found_and_proven_with_few_questions():
    problem = treasure()
    asked = []
    for seed in range(scaled(3, 8)):
        weights = np.random.default_rng(seed).dirichlet([1.0, 1.0])
        tutor = TruthfulTutor(objectives.values(weights))
        box = (np.zeros(2), np.ones(2))
        training = InteractiveTraining(
            PolytopeComparator(3), discount=0.95, optimality_gap=0.0, objectives=box
        )
        while not training.finished:
            if (values := training.to_train()) is not None:
                policy = problem.train(objectives.weights(values))
                training.add(policy, objectives.as_levels(problem.objectives(policy)))
            training.tell([tutor(query) for query in training.ask()])
        result = training.result()
        loss = (
            problem.objectives(problem.train(weights)) - problem.objectives(result.policy)
        ) @ weights
        assert result.status is Status.CONVERGED
        assert -1e-9 <= loss <= result.loss_bound <= 0.01 + 1e-8
        asked.append(result.asked)
    assert np.mean(asked) <= 6


def test_objectives_out_of_their_range_are_refused():
    training = InteractiveTraining(
        PolytopeComparator(3), discount=0.95, objectives=(np.zeros(2), np.ones(2))
    )
    with pytest.raises(ValueError, match="objectives within their range"):
        training.add("policy", objectives.as_levels([0.5, 1.2]))
    training.add("policy", objectives.as_levels([0.5, 0.7]), errors=[0.01, 0.02])
    assert training.result().policies[0].error == pytest.approx(0.06)
