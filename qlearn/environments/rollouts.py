"""Measurement of a policy's share vector by running it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv

from elicit._support.validation import is_whole, require
from elicit.model.scale import Floats
from qlearn.environments.level_rewards import levels_of
from qlearn.environments.levels import After, Level, Levels
from qlearn.environments.rollout_shares import RolloutShares, error_of_unseen


def rollout_shares(
    env: Any,
    policy: Any,
    discount: float | None = None,
    episodes: int = 100,
    *,
    k: int | None = None,
    level: Level = "level",
    after: After = None,
    max_steps: int | None = None,
    seed: int | None = 0,
) -> RolloutShares:
    """Run a policy for some episodes, and measure its share vector.

    Parameters
    ----------
    env : gymnasium.Env
        If it has an ``OrdinalReward`` or a ``LevelVector`` around it, the level of a step, the
        level after the end, and the discount are known from that. For another environment give
        ``discount``, ``k``, ``level`` and ``after``, as these wrappers take them.
    policy : callable or model
        A function from an observation to an action, or anything with ``predict``, such as a model
        of Stable-Baselines3 (which then takes its best action, not one to explore).
    discount : float, optional
    episodes : int
    k : int, optional
        Number of levels.
    level : str, mapping or callable
    after : int or "last", optional
        Needed for a ``LevelVector`` that has no lasting level.
    max_steps : int, optional
        Episodes are cut off after this many steps, and where the environment truncates them.
        Default: once less than 1e-4 of the time is left.
    seed : int, optional
        Goes to the first ``reset``.

    Returns
    -------
    RolloutShares

    Raises
    ------
    ValueError, TypeError
        If an argument is out of range or missing.

    Notes
    -----
    A rare outcome may show in no episode: an outcome of probability 2% is missing from 20 episodes
    two times out of three. Its probability can still be up to 1 - 0.0027^(1 / episodes) (at 99.7%,
    as three standard errors are): 26% after 20 episodes, 5.7% after 100, 0.6% after 1,000. So no
    error is below a third of that. Run enough episodes to see rare outcomes. If policy and
    environment are not random, one episode tells all: give ``InteractiveTraining.add`` the
    ``shares`` alone, which it then takes to be exact.
    """
    if isinstance(env, VectorEnv):
        raise TypeError(
            f"episodes are run one after the other: give one environment, not the {env.num_envs} "
            f"of {env}"
        )
    levels = levels_of(env)
    if levels is None:
        require(
            k is not None,
            "k",
            "given for an environment that is not in an OrdinalReward or a LevelVector",
            k,
        )
        levels = Levels(k or 0, level, after, discount)
    require(k in (None, levels.k), "k", f"left out, or that of the rewards, {levels.k}", k)
    lasts = after if levels.after is None else levels.after
    require(after in (None, lasts), "after", f"left out, or that of the rewards, {lasts!r}", after)
    given = levels.discount if discount is None else discount
    require(given is not None, "discount", "a number of at least 0 and below 1", given)
    require(
        levels.discount in (None, given),
        "discount",
        f"that of the rewards, {levels.discount!r}",
        discount,
    )
    levels = Levels(levels.k, "level" if levels_of(env) is not None else levels.level, lasts, given)
    assert levels.discount is not None
    require(
        is_whole(episodes, 2),
        "episodes",
        "a whole number of at least 2 (for standard errors)",
        episodes,
    )
    known = max_steps is None or is_whole(max_steps, 1)
    require(known, "max_steps", "None or a whole number of at least 1", max_steps)
    most = int(max_steps or max(1.0, np.ceil(np.log(1e-4) / np.log(max(levels.discount, 1e-4)))))
    found = np.empty((int(episodes), levels.k))
    for i in range(len(found)):
        found[i] = _one(env, levels, _acting(policy), most, seed if i == 0 else None)
    shares = found.mean(axis=0)
    errors = np.maximum(
        found.std(axis=0, ddof=1) / np.sqrt(len(found)), error_of_unseen(len(found))
    )
    return RolloutShares(shares, errors, max(0.0, 1.0 - float(shares.sum())))


def _one(
    env: Any, levels: Levels, act: Callable[[Any], Any], most: int, seed: int | None
) -> Floats:
    """Return the shares (k,) of an episode. If it was cut off, their total is below 1."""
    during, ending, left = levels.during, levels.ending, 1.0
    shares: Floats = np.zeros(levels.k)
    observation, _ = env.reset(seed=seed)
    for _ in range(most):
        observation, reward, terminated, truncated, info = env.step(act(observation))
        at = levels.of_step(observation, reward, info)
        if terminated:
            if ending is None:
                raise levels.never_ends()
            shares += left * ending[at]
            break
        shares += left * during[at]
        left *= levels.discount or 0.0
        if truncated:
            break
    return shares


def _acting(policy: Any) -> Callable[[Any], Any]:
    """Return a policy, at the start of an episode, as a function from observations to actions.

    Raises TypeError if it is no policy.
    """
    predict = getattr(policy, "predict", None)
    if predict is None:
        if not callable(policy):
            raise TypeError(
                "a policy is a function from an observation to an action, or has predict, not "
                f"{policy!r}"
            )
        return policy  # type: ignore[no-any-return]
    takes = inspect.signature(predict).parameters
    if not {"state", "episode_start"} <= set(takes):
        fixed = {"deterministic": True} if "deterministic" in takes else {}
        return lambda observation: _action(predict(observation, **fixed))
    state: Any = None
    first = True

    def act(observation: Any) -> Any:
        nonlocal state, first
        action, state = predict(
            observation, state=state, episode_start=np.array([first]), deterministic=True
        )
        first = False
        return action

    return act


def _action(predicted: Any) -> Any:
    """Return the action, which some models return together with a hidden state."""
    return predicted[0] if isinstance(predicted, tuple) else predicted
