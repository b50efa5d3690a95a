"""A comparator of one's own, with the five members of the protocol and no more, in every learner."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest

import qlearn
from elicit import Answers, Bags, TruthfulTutor, choose, compare_held_out
from elicit.model import comparator as protocols
from elicit.testing import check_comparator, sample_differences
from qlearn import Status


class Exact:
    """Knows the scale from the start."""

    def __init__(self, values: Any) -> None:
        self.values = (np.asarray(values, float) - values[0]) / (values[-1] - values[0])
        self.k = len(self.values)

    def bounds(self, d: Any) -> tuple[Any, Any]:
        x = self._tails(d) @ np.diff(self.values)
        return x, x.copy()

    def compare(self, d: Any) -> Any:
        t = self._tails(d)
        dominates = (t >= 0).all(axis=1) * 1 - (t <= 0).all(axis=1)
        return np.where(dominates != 0, dominates, np.sign(t @ np.diff(self.values))).astype(np.int8)

    def update(self, answers: Answers) -> "Exact":
        if answers.k != self.k:
            raise ValueError(f"answers about {answers.k} levels")
        return self

    def _tails(self, d: Any) -> Any:
        rows = np.atleast_2d(np.asarray(d, float))
        if rows.ndim != 2 or rows.shape[1] != self.k or not np.isfinite(rows).all():
            raise ValueError(f"differences must be finite and (n, {self.k})")
        return np.ascontiguousarray(np.cumsum(rows[:, :0:-1], axis=1)[:, ::-1])


MDP, VALUES = qlearn.random_mdp(10, 3, 5, discount=0.9, seed=4)
OPTIONAL = [name for name in dir(protocols) if name.startswith(("BoundsAllAtOnce", "Foretells", "HasDraws", "Allows"))]
LEARNERS = [
    (qlearn.InteractivePolicyIteration, Status.BOUNDED),
    (partial(qlearn.InteractivePolicyIteration, bags=Bags(days=4)), Status.BOUNDED),
    (qlearn.InteractiveValueIteration, Status.CONVERGED),
    (qlearn.LateValueIteration, Status.CONVERGED),
    (partial(qlearn.InteractiveValueIteration, max_loss=0.2), Status.CERTIFIED),
    (partial(qlearn.InteractiveQLearning, steps=2000), Status.DONE),
    (partial(qlearn.LateQLearning, steps=2000), Status.DONE),
]


def nobody(query: Any) -> Any:
    raise AssertionError("there is nothing to ask")


def test_it_conforms() -> None:
    assert len(OPTIONAL) == 5
    for name in OPTIONAL:
        assert not isinstance(Exact(VALUES), getattr(protocols, name))
    check_comparator(Exact(VALUES))
    check_comparator(Exact([0, 1]))


@pytest.mark.parametrize(("learner", "status"), LEARNERS)
def test_every_learner_finishes_with_it_and_asks_nothing(learner: Any, status: Status) -> None:
    result = qlearn.drive(learner(MDP, Exact(VALUES)), nobody)
    assert (result.asked, result.status) == (0, status)
    assert math.isnan(result.confidence), "its bounds are not said to hold for all rows at once"
    loss = qlearn.policy_loss(MDP, result.policy, VALUES).max()
    assert loss <= result.loss_bound + 1e-9
    assert result.loss_bound <= (0.05 if status is Status.DONE else 0.2 if status is Status.CERTIFIED else 0.001)


def test_it_chooses_and_is_scored() -> None:
    options = np.random.default_rng(0).dirichlet(np.ones(5), size=6)
    chosen = choose(options, Exact(VALUES)).result()
    assert (chosen.asked, chosen.best) == (0, int(np.argmax(options @ VALUES)))
    d = sample_differences(5)[:20]
    answers = Answers(d, TruthfulTutor(VALUES).signs(d))
    assert compare_held_out({"mine": Exact(VALUES)}, answers, 3)["mine"].accuracy.value == 1
