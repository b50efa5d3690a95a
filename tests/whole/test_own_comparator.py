"""A comparator of one's own, with the five members of the protocol and no more: it serves every
learner, and what it must return is checked where it enters, once, with a sentence."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest

import qlearn
from elicit import Answers, Bags, TruthfulTutor, choose, compare_held_out, decide
from elicit.model import comparator_parts as protocols
from elicit.model.comparator import bounds_of
from elicit.model.comparator_parts import best_guess
from elicit.testing import check_comparator, sample_differences
from qlearn import InteractivePolicyIteration, InteractiveValueIteration, Status
from tests.own_cases import Exact

MDP, VALUES = qlearn.random_mdp(10, 3, 5, discount=0.9, seed=4)
OPTIONAL = [
    name
    for name in dir(protocols)
    if name.startswith(("BoundsAllAtOnce", "PredictsAnswers", "HasDraws", "Allows"))
]
LEARNERS = [
    (qlearn.InteractivePolicyIteration, Status.BOUNDED),
    (partial(qlearn.InteractivePolicyIteration, bags=Bags(days=4)), Status.BOUNDED),
    (qlearn.InteractiveValueIteration, Status.BOUNDED),
    (qlearn.LateValueIteration, Status.BOUNDED),
    (partial(qlearn.InteractiveValueIteration, max_loss=0.2), Status.CERTIFIED),
    (partial(qlearn.InteractiveQLearning, steps=2000), Status.DONE),
    (partial(qlearn.LateQLearning, steps=2000), Status.DONE),
]


def nobody(query: Any) -> Any:
    raise AssertionError("there is nothing to ask")


def test_it_conforms() -> None:
    assert len(OPTIONAL) == 6
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
    assert result.loss_bound <= (
        0.05 if status is Status.DONE else 0.2 if status is Status.CERTIFIED else 0.001
    )


def test_it_chooses_and_is_scored() -> None:
    options = np.random.default_rng(0).dirichlet(np.ones(5), size=6)
    chosen = choose(options, Exact(VALUES)).result()
    assert (chosen.asked, chosen.best) == (0, int(np.argmax(options @ VALUES)))
    d = sample_differences(5)[:20]
    answers = Answers(d, TruthfulTutor(VALUES).signs(d))
    assert compare_held_out({"mine": Exact(VALUES)}, answers, 3)["mine"].accuracy.value == 1


class Wrong(Exact):
    def __init__(self, name: str, returns: Any) -> None:
        super().__init__(VALUES)
        self.bad, self.returns = name, returns

    def compare(self, d: Any) -> Any:
        return self.returns(len(d)) if self.bad == "compare" else super().compare(d)

    def bounds(self, d: Any) -> Any:
        return self.returns(len(d)) if self.bad == "bounds" else super().bounds(d)


@pytest.mark.parametrize(
    "returns",
    [
        lambda n: np.zeros(n),
        lambda n: np.zeros(n, np.int64),
        lambda n: np.zeros(n, bool),
        lambda n: np.zeros((n, 1), np.int8),
        lambda n: np.zeros(n + 1, np.int8),
        lambda n: np.full(n, 3, np.int8),
        lambda n: [0] * n,
        lambda n: None,
    ],
)
def test_verdicts_of_another_shape_type_or_code_are_refused(returns):
    wrong = Wrong("compare", returns)
    with pytest.raises(TypeError, match=r"Wrong.compare\(d\) must return an int8 array \(n,\)"):
        decide(wrong, np.eye(5))
    with pytest.raises(TypeError, match="check_comparator"):
        InteractiveValueIteration(MDP, wrong).ask()


@pytest.mark.parametrize(
    "returns",
    [
        lambda n: np.zeros(n),
        lambda n: (np.zeros(n), np.zeros(n + 1)),
        lambda n: (np.ones(n), np.zeros(n)),
        lambda n: (np.full(n, np.nan), np.zeros(n)),
        lambda n: (None, None),
    ],
)
def test_bounds_that_are_none_are_refused(returns):
    wrong = Wrong("bounds", returns)
    with pytest.raises(TypeError, match=r"Wrong.bounds\(d\) must return two arrays"):
        bounds_of(wrong, np.eye(5) - np.full((5, 5), 0.2))
    with pytest.raises(TypeError, match="check_comparator"):
        InteractivePolicyIteration(MDP, wrong).ask()


@pytest.mark.parametrize(
    "values", [np.linspace(0, 2, 5), np.linspace(0, 1, 4), np.array([0, 0.5, 0.2, 0.6, 1.0])]
)
def test_a_best_guess_that_is_no_scale_is_refused(values):
    wrong = Exact(VALUES)
    wrong.values = values
    with pytest.raises(
        TypeError, match=r"Exact.values must be an array \(5,\) that rises from 0 to 1"
    ):
        best_guess(wrong)
    with pytest.raises(TypeError, match="must be an array"):
        InteractivePolicyIteration(MDP, wrong).ask()
