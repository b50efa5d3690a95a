"""Stable-Baselines3 trains on the rewards, and its models come back as policies."""

import importlib.util
import runpy
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from elicit import Query, TruthfulTutor
from qlearn import OrdinalReward, Status
from tests.environment_cases import Walk

EXAMPLE = Path(__file__).parents[2] / "examples" / "train_with_sb3.py"


def test_the_example_is_short():
    assert len(EXAMPLE.read_text().splitlines()) < 70


class Resting:
    """In the place of Stable-Baselines3's DQN: a model that never moves, or after the first one,
    races about.
    """

    made = 0

    def __init__(self, policy, env, **settings):
        Resting.made += 1
        self.races = Resting.made > 1

    def learn(self, steps):
        return self

    def predict(self, observation):
        return (2 if observation[1] >= 0 else 0) if self.races else 1


def test_a_person_answers_in_words_of_any_case_and_reads_plain_numbers(monkeypatch, capsys):
    library = ModuleType("stable_baselines3")
    library.DQN = Resting
    Resting.made = 0
    monkeypatch.setitem(sys.modules, "stable_baselines3", library)
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), "--simulated"])
    example = runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert "'resting': 0." in capsys.readouterr().out
    query = Query("here", [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0])
    monkeypatch.setattr("builtins.input", lambda _: "Left")
    assert example["you"](query).verdict == 1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_dqn_trains_by_questions():
    pytest.importorskip("stable_baselines3", reason="the extra sb3 (0.9 GB) is not installed")
    from stable_baselines3.common.env_checker import check_env

    check_env(OrdinalReward(Walk(), [0.0, 1.0, 2.0, 3.0], after=0, discount=0.9))
    spec = importlib.util.spec_from_file_location("train_with_sb3", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    result = example.main(
        TruthfulTutor([0, 2, 3, 10]), steps=400, episodes=2, tolerance=0.2, max_trainings=2
    )
    assert isinstance(result.status, Status)
    assert 1 <= result.trained <= 2
    assert result.shares.sum() == pytest.approx(1)
    assert np.isnan(result.loss_bound)  # nobody vouches for DQN
