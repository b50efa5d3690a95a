"""Gymnasium wrappers that replace an environment's reward by one made of the step's level.

The reward is a number, by the values of an ordinal scale, or a vector with an entry for each level.
"""

from __future__ import annotations

from typing import Any, Generic, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import ArrayLike, NDArray

from elicit._support.validation import require
from elicit.model.comparator import Comparator, check_comparator_made
from elicit.model.comparator_parts import best_guess
from elicit.model.scale import Floats
from qlearn.environments.levels import After, Level, Levels

R = TypeVar("R")
Env = gym.Env[Any, Any]


class LevelRewarded(gym.Wrapper[Any, Any, Any, Any], Generic[R]):
    """Base class of wrappers of an environment whose reward depends on the step's level.

    ``info["level"]`` then holds the level.
    """

    def __init__(self, env: Env, levels: Levels) -> None:
        super().__init__(env)
        self.levels = levels
        self._during: list[R] = []  # the reward of a step at each level
        self._ending: list[R] | None = None  # the reward of a step that terminates the episode

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment, and return the reward that belongs to the step's level."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        level = info["level"] = self.levels.of_step(observation, reward, info)
        if not terminated:
            return observation, self._during[level], terminated, truncated, info
        if self._ending is None:
            raise self.levels.never_ends()
        return observation, self._ending[level], terminated, truncated, info


class LevelRewardedVector(VectorWrapper[Any, Any, NDArray[Any]]):
    """Base class like ``LevelRewarded``, of wrappers of a vector of environments.

    If an environment starts a new episode in a separate step, that step has reward 0.
    """

    def __init__(self, env: VectorEnv[Any, Any, NDArray[Any]], levels: Levels) -> None:
        super().__init__(env)
        self.levels = levels
        self._mode = env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        if self._mode == AutoresetMode.SAME_STEP and callable(levels.level):
            raise ValueError(
                "environments that start anew in the step that ends an episode need level= to be a "
                "key of info "
                "or a mapping from rewards; wrap each of them instead: gymnasium.make_vec(..., "
                "wrappers=[...])"
            )
        self._ended = np.zeros(env.num_envs, dtype=np.bool_)
        self._during: Floats = np.empty(0)
        self._ending: Floats | None = None

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset all environments, or only some if ``options`` say so."""
        some = (options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_))
        self._ended = self._ended & ~np.asarray(some)
        return self.env.reset(seed=seed, options=options)

    def step(self, actions: Any) -> tuple[Any, Any, NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Step each environment, and return the rewards (n,) or (n, k) of the steps' levels."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        stepped, told = ~self._ended, infos
        ended = np.asarray(terminated) | np.asarray(truncated)
        key = self.levels.level
        if self._mode == AutoresetMode.SAME_STEP and isinstance(key, str) and ended.any():
            told = _of_these_steps(key, infos, ended)
        levels = infos["level"] = self.levels.of_steps(observations, rewards, told, stepped)
        infos["_level"] = stepped
        given = self._during[levels]
        if np.asarray(terminated).any():
            if self._ending is None:
                raise self.levels.never_ends()
            given[terminated] = self._ending[levels[terminated]]
        given[~stepped] = 0.0
        self._ended = ended if self._mode == AutoresetMode.NEXT_STEP else np.zeros_like(ended)
        return observations, given, terminated, truncated, infos


class ByValues:
    """The base class of wrappers whose rewards are the levels' values on a scale."""

    levels: Levels

    def __init__(
        self,
        env: Any,
        values: Comparator | ArrayLike,
        level: Level = "level",
        after: After = None,
        *,
        discount: float,
    ) -> None:
        given = numbers_of(values)
        require(discount is not None, "discount", "a number of at least 0 and below 1", discount)
        super().__init__(env, Levels(len(given), level, after, discount))  # type: ignore[call-arg]
        self.values = given

    @property
    def values(self) -> Floats:
        """The present value (k,) of each level. Set it to k numbers, or to a comparator."""
        return self._values

    @values.setter
    def values(self, values: Comparator | ArrayLike) -> None:
        self._values = numbers_of(values, self.levels.k)
        ending = self.levels.ending
        self._pay(
            self.levels.during @ self._values, None if ending is None else ending @ self._values
        )

    def _pay(self, during: Floats, ending: Floats | None) -> None:
        """Set the rewards (k,) of a step at each level, and of a step that ends an episode."""
        raise NotImplementedError


class OrdinalReward(ByValues, LevelRewarded[float]):
    """An environment whose reward is the value of each step's level. Any library can train on it.

    The discounted sum of an episode's rewards is its share vector times ``values``, exactly.
    ``info["level"]`` has the level. The ``values`` may be changed at any time.

    Parameters
    ----------
    env : gymnasium.Env or VectorEnv
        With a ``VectorEnv`` the wrapper is a ``VectorEnv`` too.
    values : Comparator or (k,)
        A comparator, whose best guess at the scale is taken, or k numbers, worst level first, that
        do not fall.
    level : str, mapping or callable
        The key of ``info`` with the step's level, 0 to k - 1; or a mapping from rewards to levels;
        or a function of (observation, reward, info).
    after : int or "last"
        The level that lasts once an episode has terminated, or ``"last"`` for that of its last
        step.
    discount : float

    Raises
    ------
    ValueError
        If a number is out of range, and in ``step`` for a level that does not exist.

    Notes
    -----
    With discount c a step at level l has the reward (1 - c) values[l]. A step that terminates the
    episode after T steps also brings the remaining time, c^T, all at the level ``after``. Its
    reward is (1 - c) values[l] + c values[after]: the discount c^(T-1) of that step turns the
    second part into c^T values[after]. With ``after="last"`` the reward is values[l]. So totals are
    1 whenever an episode ends, and it does not matter which level has the value 0.

    A truncated episode is cut off, not ended. Nothing is added, and the trainer estimates what
    would have come, as always in Gymnasium.
    """

    def __new__(
        cls, env: Any = None, *given: Any, **settings: Any
    ) -> Any:  # copying calls it without arguments
        """Return the wrapper for ``env``, which may be a vector of environments."""
        if isinstance(env, VectorEnv):
            return OrdinalRewardVector(env, *given, **settings)
        return super().__new__(cls)

    def _pay(self, during: Floats, ending: Floats | None) -> None:
        self._during, self._ending = during.tolist(), None if ending is None else ending.tolist()


class OrdinalRewardVector(ByValues, LevelRewardedVector):
    """``OrdinalReward`` for a vector of environments."""

    def _pay(self, during: Floats, ending: Floats | None) -> None:
        self._during, self._ending = during, ending


class LevelVector(LevelRewarded[Floats]):
    """An environment whose reward is a vector (k,), 1 at the step's level, as in MO-Gymnasium.

    With a ``discount`` the discounted sum of the vectors is the episode's share vector, which
    totals 1 when it ends. MO-Gymnasium's ``LinearReward``, with the levels' values as weights, then
    gives the rewards of ``OrdinalReward``. The unwrapped environment gets the attribute
    ``reward_space``, where MO-Gymnasium looks for it.

    Parameters
    ----------
    env : gymnasium.Env or VectorEnv
        With a ``VectorEnv`` the rewards are (n, k).
    k : int
        Number of levels.
    level, after, discount
        As in ``OrdinalReward``. Without a discount each step counts in full.

    Raises
    ------
    ValueError
        If a setting is out of range.
    """

    def __new__(
        cls, env: Any = None, *given: Any, **settings: Any
    ) -> Any:  # copying calls it without arguments
        """Return the wrapper for ``env``, which may be a vector of environments."""
        if isinstance(env, VectorEnv):
            return LevelVectorVector(env, *given, **settings)
        return super().__new__(cls)

    def __init__(
        self,
        env: Env,
        k: int,
        level: Level = "level",
        after: After = None,
        *,
        discount: float | None = None,
    ) -> None:
        super().__init__(env, Levels(k, level, after, discount))
        self._during = list(self.levels.during)
        self._ending = None if self.levels.ending is None else list(self.levels.ending)
        env.unwrapped.reward_space = reward_space(k)  # type: ignore[attr-defined]

    def step(self, action: Any) -> tuple[Any, Floats, bool, bool, dict[str, Any]]:
        """Step the environment, and return a new reward vector.

        Parameters
        ----------
        action
            An action of the environment.

        Returns
        -------
        observation
            As the environment gives it.
        reward : (k,)
            Without a discount 1 at the step's level, and 0 elsewhere. With one, the discounted sum
            of these vectors over an episode is its share vector.
        terminated, truncated : bool
            As the environment gives them.
        info : dict
            As the environment gives it, with the step's ``level`` in addition.

        Raises
        ------
        ValueError
            If the step has no level, or none of 0 to k - 1. Also if an episode terminates, but with
            the discount no ``after`` was given.
        """
        observation, reward, *rest = super().step(action)
        return observation, reward.copy(), *rest


class LevelVectorVector(LevelRewardedVector):
    """``LevelVector`` for a vector of environments: rewards (n, k)."""

    def __init__(
        self,
        env: VectorEnv[Any, Any, NDArray[Any]],
        k: int,
        level: Level = "level",
        after: After = None,
        *,
        discount: float | None = None,
    ) -> None:
        super().__init__(env, Levels(k, level, after, discount))
        self._during, self._ending = self.levels.during, self.levels.ending
        self.reward_space = reward_space(k)


def _of_these_steps(key: str, infos: dict[str, Any], ended: NDArray[np.bool_]) -> dict[str, Any]:
    """Return infos with the levels of the steps just done.

    If an episode has ended, ``infos`` is about the start of the new one, and ``final_info`` about
    the step.
    """
    last: dict[str, Any] = infos.get("final_info", {})
    now = infos.get(key, np.zeros(len(ended)))
    has_last, has_now = last.get(f"_{key}", ~ended), infos.get(f"_{key}", ended)
    if not np.where(ended, has_last, has_now).all():
        return last
    return {key: np.where(ended, last[key], now)}


def reward_space(k: int) -> gym.spaces.Box:
    """Return the Gymnasium space of a reward vector (k,)."""
    return gym.spaces.Box(0.0, 1.0, (k,), np.float64)


def numbers_of(values: Comparator | ArrayLike, k: int | None = None) -> Floats:
    """Return the values of the levels, from a comparator or from numbers, as a copy.

    Parameters
    ----------
    values : Comparator or (k,)
    k : int, optional
        Number of levels.

    Returns
    -------
    (k,)

    Raises
    ------
    ValueError
        If they are not finite, or fall from one level to the next.
    """
    if hasattr(values, "bounds"):
        check_comparator_made(values)  # type: ignore[arg-type]
        values = best_guess(values)  # type: ignore[arg-type]
    found = np.array(values, dtype=np.float64)
    if found.ndim != 1 or len(found) < 2 or (k is not None and len(found) != k):
        raise ValueError(
            f"values must be {k or 'k >= 2'} numbers, one a level, worst first, not shape "
            f"{found.shape}"
        )
    if not (np.isfinite(found).all() and (np.diff(found) >= 0).all()):
        raise ValueError(
            f"values must be finite and must not fall from the worst level to the best, not {found}"
        )
    return found


def levels_of(env: Any) -> Levels | None:
    """Return the Levels of a wrapper of this module around an environment, or None."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, LevelRewarded):
            return env.levels
        env = env.env
    return None
