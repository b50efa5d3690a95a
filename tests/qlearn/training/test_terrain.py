"""A continuous task from end to end: a learner without a table, trained by questions as if the
values were known.
"""

import numpy as np
import pytest

from benchmarks.training.terrain import DISCOUNT, OUTCOMES, Terrain, TileCoded
from elicit import PolytopeComparator, TruthfulTutor
from qlearn import InteractiveTraining, LevelVector, Status, draw_values, rollout_shares
from tests.scale_arithmetic import normalise


def test_walks_have_the_shares_that_rollouts_find():
    terrain = Terrain(0)
    policy = TileCoded(terrain, 0, samples=4000).train(np.linspace(0, 1, 5))
    many = terrain.shares(policy, walks=1000)
    found = rollout_shares(LevelVector(terrain, 5, discount=DISCOUNT), policy, episodes=60)
    assert many.sum() == pytest.approx(1 - DISCOUNT**60)
    assert found.undecided == pytest.approx(DISCOUNT**60)
    assert (np.abs(found.shares - many) <= 4 * found.errors + 0.02).all()


@pytest.mark.slow
def test_questions_train_it_as_well_as_knowing_the_values():
    terrain, values = Terrain(5), draw_values(5, rng=5)
    learner, tutor, e = (
        TileCoded(terrain, 5, samples=20_000),
        TruthfulTutor(values),
        normalise(values),
    )
    training = InteractiveTraining(PolytopeComparator(5), discount=DISCOUNT, labels=OUTCOMES)
    while not training.finished:
        if (scale := training.to_train()) is not None:
            policy = learner.train(scale)
            training.add(policy, terrain.shares(policy))
        training.tell([tutor(query) for query in training.ask()])
    result = training.result()
    assert result.status is Status.UNPROVEN
    known, guessed = (
        terrain.shares(learner.train(e)) @ e,
        terrain.shares(learner.train(np.linspace(0, 1, 5))) @ e,
    )
    assert known - result.shares @ e <= 0.01
    assert known - guessed >= 0.03
    assert result.asked <= 20
