"""Environments for tests: a walk whose steps have levels, and a terrain in two dimensions."""

from typing import Any

import gymnasium as gym
import numpy as np


class Gamble(gym.Env[Any, Any]):
    """One step to one of three levels: action 0 leads to the middle one; action 1 to the best, or
    with ``chance`` to the worst."""

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, chance: float = 0.02) -> None:
        self.chance = chance
        self.observation_space = gym.spaces.Box(0.0, 1.0, (1,), np.float32)
        self.action_space = gym.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        level = 1 if action == 0 else 0 if self.np_random.random() < self.chance else 2
        return np.zeros(1, np.float32), 0.0, True, False, {"level": level}


class Walk(gym.Env[Any, Any]):
    """A random walk over the levels 0 to k - 1, its reward 10 times the level; it ends, by chance,
    with ``chance``.
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, k: int = 4, chance: float = 0.1) -> None:
        self.k, self.chance = k, chance
        self.observation_space = gym.spaces.Box(0.0, float(k - 1), (1,), np.float32)
        self.action_space = gym.spaces.Discrete(3)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.at = int(self.np_random.integers(self.k))
        return self._seen(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.at = int(np.clip(self.at + int(action) - 1, 0, self.k - 1))
        return (
            self._seen(),
            10.0 * self.at,
            bool(self.np_random.random() < self.chance),
            False,
            {"level": self.at},
        )

    def _seen(self) -> Any:
        return np.array([self.at], np.float32)
