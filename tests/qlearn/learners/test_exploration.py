"""Exploration by name, and as a schedule."""

from typing import Any

import numpy as np
import pytest

from elicit import AlwaysAsk, TruthfulTutor
from qlearn import InteractiveQLearning, Result, drive, random_mdp
from qlearn.learners.exploration import EXPLORATIONS, Decay, Exploration, epsilons


def learned(**settings: Any) -> Result:
    mdp, values = random_mdp(8, 3, 4, rng=2)
    learner = InteractiveQLearning(mdp, AlwaysAsk(4), **{"steps": 500, "rng": 5, **settings})
    return drive(learner, TruthfulTutor(values))


def same(one: Result, other: Result) -> bool:
    return one.q.tobytes() == other.q.tobytes() and one.policy.tolist() == other.policy.tolist()


def test_a_decay_falls_in_a_line_and_stays() -> None:
    chances = epsilons(Decay(first=0.8, last=0.2, share=0.5), 12)
    assert chances == pytest.approx([0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2])
    assert epsilons(Decay(), 0) == pytest.approx([1.0])
    assert epsilons(0.25, 12).tolist() == [0.25]


@pytest.mark.parametrize(
    "wrong",
    [{"first": 1.5}, {"last": -0.5}, {"share": 0.0}, {"share": float("nan")}, {"last": "a"}],
)
def test_a_decay_that_is_none_is_refused(wrong: dict[str, float]) -> None:
    (name,) = wrong
    with pytest.raises(ValueError, match=f"{name} of a Decay must lie in 0"):
        Decay(**wrong)


@pytest.mark.parametrize(
    "wrong", [{"start": "good"}, {"episode_length": 0}, {"episode_length": "x"}]
)
def test_an_exploration_that_is_none_is_refused(wrong: dict[str, Any]) -> None:
    ((name, value),) = wrong.items()
    with pytest.raises(ValueError, match=f"{name} must .*, not {value!r}"):
        Exploration(0.1, **wrong)


def test_a_name_stands_for_its_settings_and_settings_replace_them() -> None:
    runs = [learned(epsilon=name) for name in EXPLORATIONS]
    assert not any(same(one, other) for i, one in enumerate(runs) for other in runs[:i])
    for run, choice in zip(runs, EXPLORATIONS.values(), strict=True):
        assert same(run, learned(epsilon=choice))
    assert same(learned(), learned(epsilon="optimistic"))
    assert same(learned(epsilon=0.3), learned(epsilon=Exploration(0.3)))


def test_a_constant_schedule_is_the_constant() -> None:
    assert same(learned(epsilon=0.3), learned(epsilon=lambda steps: np.full(len(steps), 0.3)))
    assert same(learned(epsilon=0.3), learned(epsilon=Decay(0.3, 0.3)))


def test_a_schedule_explores_when_it_says_so() -> None:
    # greedy from the start, the agent keeps its first actions until others are found better;
    # explorations before step 250 move nothing in a run that begins to explore there
    late = learned(epsilon=lambda steps: (steps >= 250).astype(float))
    never = learned(epsilon=0.0)
    half = learned(epsilon=0.0, steps=250)
    short = learned(epsilon=lambda steps: (steps >= 250).astype(float), steps=250)
    assert same(half, short)
    assert not same(late, never)
