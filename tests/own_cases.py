"""Parts that a user brings to an ablation, in a module that command and workers can import."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit import Answer, Answers, Comparator, Query, as_differences
from elicit.model.comparator import check_answers
from qlearn import InteractivePolicyIteration, Learner, OrdinalMDP, random_mdp
from tests.scale_arithmetic import Floats, normalise, tail_sums


class Exact:
    """A comparator with the five members of the protocol, which knows the scale from the start."""

    def __init__(self, values: ArrayLike) -> None:
        self.values = normalise(values)
        self.k = len(self.values)

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        worth = tail_sums(as_differences(d, self.k)) @ np.diff(self.values)
        return worth, worth.copy()

    def compare(self, d: ArrayLike) -> NDArray[np.int8]:
        return np.sign(self.bounds(d)[0]).astype(np.int8)

    def update(self, answers: Answers) -> Exact:
        check_answers(answers, self.k)
        return self


def exact(k: int, seed: int) -> Exact:
    """Knows the scale of ``tiny``, and of a random MDP of as many states, actions and levels."""
    return Exact(tiny(seed)[1])


def tiny(seed: int) -> tuple[OrdinalMDP, Floats]:
    return random_mdp(8, 3, 4, rng=seed)


def careless(values: Floats, seed: int) -> object:
    """A plain function for a tutor: she answers as if the levels were the other way round."""

    def answer(query: Query) -> Answer:
        return Answer(query, -int(np.sign(query.d @ values)))

    return answer


def certified(mdp: OrdinalMDP, comparator: Comparator, seed: int) -> Learner:
    return InteractivePolicyIteration(mdp, comparator, rng=seed, max_queries=40)


def two(k: int, seed: int) -> Exact:
    return Exact([0, 1])


def three(*_: int) -> int:
    return 3


def broken(k: int) -> None:
    raise ZeroDivisionError


NUMBER = 5
