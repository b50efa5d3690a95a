"""A comparator of one's own: what it must return is checked where it enters, once, with a sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from elicit import Answers, TruthfulTutor, choose
from elicit.decision.verdicts import decide
from elicit.model.comparator import best_guess, bounds_of
from elicit.testing import check_comparator
from qlearn import InteractivePolicyIteration, InteractiveValueIteration, Status, drive, policy_loss, random_mdp

MDP, VALUES = random_mdp(30, 4, 5, rng=2)


class Exact:
    """The five members of the protocol, and the exact scale inside."""

    def __init__(self, values: Any) -> None:
        given = np.asarray(values, dtype=float)
        self.values = (given - given[0]) / (given[-1] - given[0])
        self.k = len(self.values)

    def _at(self, d: Any) -> Any:
        rows = np.atleast_2d(np.asarray(d, dtype=float))
        if rows.ndim != 2 or rows.shape[1] != self.k or not np.isfinite(rows).all():
            raise ValueError(f"d must be finite, of shape (n, {self.k}), not {np.shape(d)}")
        tails = np.cumsum(rows[:, :0:-1], axis=1)[:, ::-1]
        at = np.zeros(len(rows))
        for tail, gap in zip(tails.T, np.diff(self.values), strict=True):
            at = at + tail * gap
        return at

    def bounds(self, d: Any) -> Any:
        return self._at(d), self._at(d)

    def compare(self, d: Any) -> Any:
        return np.sign(self._at(d)).astype(np.int8)

    def update(self, answers: Answers) -> Exact:
        if answers.k != self.k:
            raise ValueError(f"these answers are about {answers.k} levels, not {self.k}")
        return self


def test_five_members_are_enough():
    check_comparator(Exact(VALUES))
    tutor = TruthfulTutor(VALUES)
    result = drive(InteractivePolicyIteration(MDP, Exact(VALUES)), tutor)
    assert result.asked == 0
    assert result.status is Status.BOUNDED
    assert np.isnan(result.confidence)
    assert policy_loss(MDP, result.policy, VALUES).max() <= result.loss_bound <= 1e-3
    assert drive(InteractiveValueIteration(MDP, Exact(VALUES)), tutor).asked == 0
    choice = choose(np.eye(5)[[1, 3, 2]], Exact(VALUES)).result()
    assert (choice.best, choice.loss_bound) == (1, 0.0)


class Wrong(Exact):
    def __init__(self, name: str, returns: Any) -> None:
        super().__init__(VALUES)
        self.wrong, self.returns = name, returns

    def compare(self, d: Any) -> Any:
        return self.returns(len(d)) if self.wrong == "compare" else super().compare(d)

    def bounds(self, d: Any) -> Any:
        return self.returns(len(d)) if self.wrong == "bounds" else super().bounds(d)


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


@pytest.mark.parametrize("values", [np.linspace(0, 2, 5), np.linspace(0, 1, 4), np.array([0, 0.5, 0.2, 0.6, 1.0])])
def test_a_best_guess_that_is_no_scale_is_refused(values):
    wrong = Exact(VALUES)
    wrong.values = values
    with pytest.raises(TypeError, match=r"Exact.values must be an array \(5,\) that rises from 0 to 1"):
        best_guess(wrong)
    with pytest.raises(TypeError, match="must be an array"):
        InteractivePolicyIteration(MDP, wrong).ask()
