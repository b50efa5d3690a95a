"""Measured share vectors are those of the policy, as far as their errors say."""

import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import TimeLimit

from qlearn import LevelVector, OrdinalReward, rollout_shares
from qlearn.environments.rollout_shares import STANDARD_ERRORS
from tests.environment_cases import Gamble, Walk

DISCOUNT = 0.9
VALUES = [0.0, 1.0, 2.0, 5.0]


def up(observation):
    return 2


def exact(after):
    """The shares of always going up in ``Walk``, whose start is uniform."""
    shares = np.zeros(4)
    for start in range(4):
        left = 1.0  # of time, discounted, and of the chance to be still under way
        for t in range(400):
            at = min(start + t + 1, 3)
            shares[at] += left * (1 - DISCOUNT) / 4
            shares[at if after == "last" else after] += left * DISCOUNT * 0.1 / 4
            left *= DISCOUNT * 0.9
    return shares


@pytest.mark.parametrize("after", [0, "last"])
def test_shares_are_the_policys_within_their_errors(after):
    env = OrdinalReward(Walk(), VALUES, after=after, discount=DISCOUNT)
    shares, errors, undecided = rollout_shares(env, up, episodes=800, seed=3)
    assert shares.sum() + undecided == pytest.approx(1)
    assert undecided < 1e-4
    assert (np.abs(shares - exact(after)) <= 4 * errors + 1e-4).all()
    assert errors.max() < 0.02
    plain = rollout_shares(Walk(), up, DISCOUNT, 800, k=4, after=after, seed=3)
    assert plain.shares == pytest.approx(shares, abs=1e-12)


def test_what_a_cut_off_leaves_is_undecided():
    env = LevelVector(TimeLimit(Walk(chance=0.0), 5), 4, discount=DISCOUNT)
    found = rollout_shares(env, up, episodes=3)
    assert found.undecided == pytest.approx(DISCOUNT**5)
    again = rollout_shares(Walk(chance=0.0), up, DISCOUNT, 3, k=4, max_steps=5)
    assert again.undecided == pytest.approx(DISCOUNT**5)
    assert again.shares == pytest.approx(found.shares)


def test_whatever_predicts_is_a_policy():
    class Plain:
        def predict(self, observation):
            return 2

    class Model:
        """A model with a memory, as Stable-Baselines3's are."""

        starts = 0

        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            assert deterministic
            assert (state is None) == bool(episode_start[0])
            self.starts += state is None
            return np.int64(2), (0,)

    class Explores:
        def predict(self, observation, deterministic=False):
            return 2 if deterministic else 0

    env = OrdinalReward(Walk(), VALUES, after=0, discount=DISCOUNT)
    wanted = rollout_shares(env, up, episodes=20).shares
    model = Model()
    assert rollout_shares(env, Plain(), episodes=20).shares == pytest.approx(wanted)
    assert rollout_shares(env, Explores(), episodes=20).shares == pytest.approx(wanted)
    assert rollout_shares(env, model, episodes=20).shares == pytest.approx(wanted)
    assert model.starts == 20


def test_what_is_missing_is_said():
    env = OrdinalReward(Walk(), VALUES, after=0, discount=DISCOUNT)
    with pytest.raises(
        ValueError, match="k must be given for an environment that is not in an OrdinalReward"
    ):
        rollout_shares(Walk(), up, DISCOUNT)
    with pytest.raises(ValueError, match="discount must be"):
        rollout_shares(Walk(), up, k=4)
    with pytest.raises(ValueError, match=r"discount must be that of the rewards, 0\.9, not 0\.5"):
        rollout_shares(env, up, 0.5)
    with pytest.raises(ValueError, match="episodes must be a whole number of at least 2"):
        rollout_shares(env, up, episodes=1)
    with pytest.raises(TypeError, match="a policy is a function"):
        rollout_shares(env, 3)
    with pytest.raises(ValueError, match="give after="):
        rollout_shares(Walk(), up, DISCOUNT, k=4)
    with pytest.raises(ValueError, match="k must be left out, or that of the rewards, 4, not 3"):
        rollout_shares(env, up, k=3)
    with pytest.raises(
        ValueError, match="after must be left out, or that of the rewards, 0, not 'last'"
    ):
        rollout_shares(env, up, after="last")
    with pytest.raises(TypeError, match="give one environment, not the 2 of"):
        rollout_shares(SyncVectorEnv([Walk, Walk]), up, DISCOUNT, k=4)


def test_of_vectors_that_do_not_say_what_comes_after_it_can_be_said_later():
    wanted = rollout_shares(
        OrdinalReward(Walk(), VALUES, after=2, discount=DISCOUNT), up, episodes=20
    )
    found = rollout_shares(LevelVector(Walk(), 4), up, DISCOUNT, episodes=20, after=2)
    assert found.shares == pytest.approx(wanted.shares)


def test_equal_episodes_do_not_make_shares_certain():
    env = LevelVector(Gamble(chance=0.0), 3, discount=DISCOUNT, after="last")
    for episodes, left_open in ((2, 0.948), (20, 0.256), (100, 0.0574), (1000, 0.0059)):
        found = rollout_shares(env, lambda observation: 1, episodes=episodes)
        assert found.shares.tolist() == [0, 0, 1]
        assert found.errors == pytest.approx(left_open / STANDARD_ERRORS, rel=0.01)
        assert (1 - STANDARD_ERRORS * found.errors[0]) ** episodes == pytest.approx(
            0.0027, rel=0.01
        )
