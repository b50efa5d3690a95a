"""Problems and learners take their randomness as everybody does: ``seed``, also under its older
name ``rng``.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

import qlearn
from elicit import PolytopeComparator, TruthfulTutor
from tests.thoroughness import on_any_processor, quick_first, scaled

Make = Callable[..., Any]
MDP, VALUES = qlearn.random_mdp(8, 3, 4, discount=0.9, seed=0)
LEARNERS = [
    partial(qlearn.InteractiveQLearning, steps=scaled(60, 300)),
    partial(qlearn.LateQLearning, steps=scaled(60, 300)),
    qlearn.InteractiveValueIteration,
    qlearn.LateValueIteration,
    qlearn.InteractivePolicyIteration,
]


def q_of(make: Make, **seed: Any) -> Any:
    learner = make(MDP, PolytopeComparator(4), audit=0.3, **seed)
    result = qlearn.drive(learner, TruthfulTutor(VALUES))
    return result.q, [audit.query.id for audit in result.audits]


def test_problems() -> None:
    assert qlearn.random_mdp(8, 3, 4, discount=0.9, rng=0)[0].fingerprint == MDP.fingerprint
    assert (qlearn.draw_values(5, rng=3) == qlearn.draw_values(5, seed=3)).all()
    assert (qlearn.draw_values(5, 3) == qlearn.draw_values(5, seed=3)).all()
    assert (
        qlearn.random_mdp(8, 3, 4, seed=None)[0].fingerprint
        != qlearn.random_mdp(8, 3, 4, seed=None)[0].fingerprint
    )
    assert len({tuple(qlearn.draw_values(20, None)) for _ in range(5)}) == 5
    for call in (partial(qlearn.random_mdp, 8, 3, 4), partial(qlearn.draw_values, 5)):
        with pytest.raises(TypeError, match="two words for the same"):
            call(seed=0, rng=0)
        with pytest.raises(TypeError, match=r"missing 1 required .*argument: 'seed'"):
            call()


@pytest.mark.parametrize("make", quick_first(LEARNERS, len(LEARNERS), older=2))
def test_learners(make: Make) -> None:
    (first, audits), (second, same) = q_of(make, seed=5), q_of(make, rng=5)
    assert np.array_equal(first, second)
    assert audits == same
    with pytest.raises(TypeError, match="two words for the same"):
        make(MDP, PolytopeComparator(4), seed=5, rng=5)


@on_any_processor
@pytest.mark.parametrize("make", quick_first(LEARNERS, 2))
def test_a_learner_without_a_seed_can_be_had_again(make: Make) -> None:
    learner, other = (make(MDP, PolytopeComparator(4), audit=0.3, seed=None) for _ in range(2))
    assert type(learner.seed) is int
    assert learner.seed != other.seed
    result = qlearn.drive(learner, TruthfulTutor(VALUES))
    again, audits = q_of(make, seed=learner.seed)
    assert np.array_equal(result.q, again)
    assert [audit.query.id for audit in result.audits] == audits
