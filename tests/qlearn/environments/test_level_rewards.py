"""Rewards by levels: the discounted return is the share vector times the values, whatever comes
after the end.
"""

import copy
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pandas as pd
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit, TransformReward

from elicit import Answers, PolytopeComparator
from qlearn import LevelVector, OrdinalReward
from tests.environment_cases import Walk
from tests.interpreter import run

VALUES = np.array([-3.0, 0.0, 1.5, 7.0])
DISCOUNT = 0.9
LEVELS = [
    "level",
    {0.0: 0, 10.0: 1, 20.0: 2, 30.0: 3},
    lambda observation, reward, info: int(observation[0]),
]


def episode(env, seed, most=10_000):
    """The rewards and the levels of an episode of random actions."""
    env.reset(seed=seed)
    env.action_space.seed(seed)
    rewards, levels, over = [], [], False
    while not over and len(rewards) < most:
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        rewards.append(reward)
        levels.append(info["level"])
        over = terminated or truncated
    return rewards, levels


def up_for_long(many):
    many.reset(seed=0)
    for _ in range(50):
        many.step(np.full(many.num_envs, 2))


def discounted(rewards):
    return sum(DISCOUNT**t * reward for t, reward in enumerate(rewards))


@pytest.mark.parametrize("level", LEVELS, ids=["info", "mapping", "function"])
@pytest.mark.parametrize("after", [0, 1, 3, "last"])
def test_the_return_is_the_share_vector_times_the_values_whatever_comes_after(level, after):
    env = OrdinalReward(Walk(), VALUES, level, after, discount=DISCOUNT)
    for seed in range(20):
        rewards, levels = episode(env, seed)
        shares = np.zeros(4)
        for t, at in enumerate(levels):
            shares[at] += (1 - DISCOUNT) * DISCOUNT**t
        shares[levels[-1] if after == "last" else after] += DISCOUNT ** len(levels)
        assert shares.sum() == pytest.approx(1, abs=1e-12)
        assert discounted(rewards) == pytest.approx(shares @ VALUES, abs=1e-9)


def test_an_episode_that_is_cut_off_is_not_ended():
    env = OrdinalReward(TimeLimit(Walk(chance=0.0), 7), VALUES, discount=DISCOUNT)
    rewards, levels = episode(env, 1)
    assert rewards == pytest.approx((1 - DISCOUNT) * VALUES[levels])
    assert len(rewards) == 7


def test_a_linear_reward_over_level_vectors_is_the_ordinal_reward():
    from mo_gymnasium.wrappers import LinearReward

    for after in (2, "last"):
        vectors = LevelVector(Walk(), 4, after=after, discount=DISCOUNT)
        linear = LinearReward(vectors, VALUES)
        ordinal = OrdinalReward(Walk(), VALUES, after=after, discount=DISCOUNT)
        assert episode(linear, 3)[0] == pytest.approx(episode(ordinal, 3)[0], abs=1e-12)
        assert vectors.unwrapped.reward_space.shape == (4,)
        assert discounted(episode(vectors, 5)[0]).sum() == pytest.approx(1)


def test_plain_level_vectors_are_one_hot_and_nobody_elses():
    env = LevelVector(Walk(), 4)
    rewards, levels = episode(env, 2)
    assert (np.array(rewards) == np.eye(4)[levels]).all()
    rewards[0][:] = 9.0
    assert np.max(episode(env, 2)[0]) == 1.0


@pytest.mark.parametrize("wrapped", [OrdinalReward(Walk(), VALUES, after=0, discount=DISCOUNT)])
def test_gymnasium_has_nothing_to_say_against_it(wrapped):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version.*")
        warnings.filterwarnings(
            "ignore", message=".*not within the observation space.*", category=DeprecationWarning
        )
        warnings.filterwarnings("ignore", message=".*not created with `gymnasium.make`.*")
        warnings.filterwarnings("ignore", message=".*spec=None.*")
        check_env(wrapped, skip_render_check=True)


def test_values_come_from_a_comparator_and_may_change_while_it_runs():
    comparator = PolytopeComparator(4)
    env = OrdinalReward(Walk(), comparator, after="last", discount=DISCOUNT)
    assert env.values == pytest.approx(comparator.values)
    knows = comparator.update(Answers([[0.0, 1.0, -1.0, 0.0]], [-1])).update(
        Answers([[-0.5, 1.0, 0.0, -0.5]], [1])
    )
    env.values = knows
    assert env.values == pytest.approx(knows.values)
    rewards, levels = episode(env, 4)
    assert rewards[0] == pytest.approx((1 - DISCOUNT) * knows.values[levels[0]])


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("after", [1, "last"])
def test_several_environments_at_once_have_the_rewards_that_each_has_alone(mode, after):
    many = SyncVectorEnv([Walk, Walk, Walk], autoreset_mode=mode)
    env = OrdinalReward(many, VALUES, after=after, discount=DISCOUNT)
    vectors = LevelVector(
        SyncVectorEnv([Walk] * 3, autoreset_mode=mode), 4, after=after, discount=DISCOUNT
    )
    rng = np.random.default_rng(0)
    env.reset(seed=7)
    vectors.reset(seed=7)
    left, ended, returns, restarts = np.ones(3), np.zeros(3, bool), [], 0
    total, shares = np.zeros(3), np.zeros((3, 4))
    for _ in range(300):
        actions = rng.integers(3, size=3)
        _, rewards, terminated, _, infos = env.step(actions)
        _, rows, *_ = vectors.step(actions)
        assert rewards == pytest.approx(rows @ VALUES, abs=1e-12)
        resetting = ended & (mode == AutoresetMode.NEXT_STEP)
        restarts += resetting.sum()
        assert (rewards[resetting] == 0).all()
        total += left * rewards
        shares += left[:, None] * (1 - DISCOUNT) * np.eye(4)[infos["level"]] * ~resetting[:, None]
        left *= np.where(resetting, 1.0, DISCOUNT)
        for i in np.flatnonzero(terminated):
            shares[i, infos["level"][i] if after == "last" else after] += left[i]
            returns.append((total[i], shares[i] @ VALUES, shares[i].sum()))
        total[terminated], shares[terminated], left[terminated] = 0.0, 0.0, 1.0
        ended = terminated
        if mode == AutoresetMode.DISABLED and terminated.any():
            env.reset(options={"reset_mask": terminated})
            vectors.reset(options={"reset_mask": terminated})
    assert len(returns) > 20
    assert (restarts > 20) == (mode == AutoresetMode.NEXT_STEP)
    found, wanted, whole = np.array(returns).T
    assert found == pytest.approx(wanted, abs=1e-9)
    assert whole == pytest.approx(1.0)


def test_vectorised_environments_read_levels_from_rewards_and_functions_too():
    each = [
        {0.0: 0, 10.0: 1, 20.0: 2, 30.0: 3},
        lambda observations, rewards, infos: observations[:, 0].astype(int),
    ]
    for level in each:
        env = OrdinalReward(SyncVectorEnv([Walk, Walk]), VALUES, level, "last", discount=DISCOUNT)
        env.reset(seed=1)
        observations, rewards, *_ = env.step(np.array([0, 2]))
        assert rewards == pytest.approx(VALUES[observations[:, 0].astype(int)] * (1 - DISCOUNT))
    same = SyncVectorEnv([Walk], autoreset_mode=AutoresetMode.SAME_STEP)
    with pytest.raises(ValueError, match="wrap each of them instead"):
        OrdinalReward(same, VALUES, each[1], "last", discount=DISCOUNT)


def test_levels_come_from_rewards_also_where_an_episode_starts_anew_in_the_step_that_ends_one():
    mapping = {0.0: 0, 10.0: 1, 20.0: 2, 30.0: 3}
    both = [
        OrdinalReward(
            SyncVectorEnv([Walk, Walk], autoreset_mode=AutoresetMode.SAME_STEP),
            VALUES,
            level,
            1,
            discount=DISCOUNT,
        )
        for level in ("level", mapping)
    ]
    for env in both:
        env.reset(seed=3)
    actions = np.random.default_rng(0).integers(3, size=(60, 2))
    rewards = [[env.step(action)[1] for action in actions] for env in both]
    assert np.array_equal(*rewards)


@pytest.mark.parametrize("reproduce", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_as_the_original_does(reproduce):
    ordinal = OrdinalReward(Walk(), VALUES, after=0, discount=DISCOUNT)
    for env in (ordinal, LevelVector(Walk(), 4, after=0, discount=DISCOUNT)):
        env.reset(seed=1)
        again = reproduce(env)
        for _ in range(5):
            assert again.step(2)[1] == pytest.approx(env.step(2)[1])


def test_values_that_are_no_comparator_are_numbers_and_a_comparator_has_as_many_levels():
    env = OrdinalReward(Walk(), pd.Series(VALUES), after=0, discount=DISCOUNT)
    assert env.values == pytest.approx(VALUES)
    many = OrdinalReward(SyncVectorEnv([Walk]), VALUES, after=0, discount=DISCOUNT)
    for each in (env, many):
        with pytest.raises(ValueError, match=r"values must be 4 numbers, .* not shape \(5,\)"):
            each.values = PolytopeComparator(5)
    with pytest.raises(TypeError, match="a comparator is wanted, such as"):
        OrdinalReward(Walk(), PolytopeComparator, after=0, discount=DISCOUNT)


def test_an_error_in_a_function_of_levels_is_its_own():
    env = OrdinalReward(
        Walk(), VALUES, lambda observation, reward, info: {}["mine"], discount=DISCOUNT
    )
    with pytest.raises(KeyError, match="mine"):
        episode(env, 0)
    many = OrdinalReward(
        SyncVectorEnv([Walk, Walk]), VALUES, lambda *_: [0, 0, 0], discount=DISCOUNT
    )
    with pytest.raises(ValueError, match="one level for each of 2 environments"):
        up_for_long(many)


def test_a_reward_without_a_level_is_told_to_its_last_digit():
    env = OrdinalReward(
        TransformReward(Walk(), lambda r: float(np.float32(0.1))),
        VALUES,
        {0.1: 0},
        discount=DISCOUNT,
    )
    with pytest.raises(ValueError, match=r"no level is given for the reward 0\.10000000149"):
        episode(env, 0)


def test_what_is_wrong_is_said():
    with pytest.raises(ValueError, match="must not fall"):
        OrdinalReward(Walk(), [0, 2, 1, 3], discount=DISCOUNT)
    with pytest.raises(ValueError, match="after must be a level, 0 to 3, or 'last'"):
        OrdinalReward(Walk(), VALUES, after=4, discount=DISCOUNT)
    with pytest.raises(ValueError, match="discount must be"):
        OrdinalReward(Walk(), VALUES, after=1, discount=1.0)
    with pytest.raises(ValueError, match="discount must be"):
        OrdinalReward(Walk(), VALUES, after=1, discount=None)
    with pytest.raises(TypeError, match="level must be a key of info"):
        OrdinalReward(Walk(), VALUES, level=3, discount=DISCOUNT)
    cases = [
        ("cells", 4, "info has no 'cells', only \\['level'\\]"),
        ({0.0: 0}, 4, "no level is given for the reward"),
        (lambda *_: 1.5, 4, "whole number from 0 to 3 .*, not 1.5"),
        ("level", 2, "whole number from 0 to 1 .*, not [23]"),
    ]
    for level, k, message in cases:
        env = OrdinalReward(Walk(chance=0.0), np.arange(k), level, discount=DISCOUNT)
        with pytest.raises(ValueError, match=message):
            episode(env, 0, 50)
        many = OrdinalReward(
            SyncVectorEnv([lambda: Walk(chance=0.0)] * 2), np.arange(k), level, discount=DISCOUNT
        )
        with pytest.raises(ValueError, match=r"level|info"):
            up_for_long(many)
    env = OrdinalReward(Walk(chance=1.0), VALUES, discount=DISCOUNT)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="not said at which level: give after="):
        env.step(1)


def test_without_gymnasium_it_says_what_installs_it():
    code = (
        "import sys, qlearn; sys.modules['gymnasium'] = None\n"
        "try:\n    qlearn.OrdinalReward\nexcept ModuleNotFoundError as error:\n    print(error)\n"
    )
    assert run(code) == ["gymnasium is not installed: pip install 'elicit-qlearn[gym]'"]


def test_it_is_found_in_the_stack_of_wrappers():
    env = gym.wrappers.RecordEpisodeStatistics(
        OrdinalReward(Walk(), VALUES, after=0, discount=DISCOUNT)
    )
    env.reset(seed=0)
    assert env.get_wrapper_attr("values") == pytest.approx(VALUES)
