"""A walk over a terrain in two dimensions with five outcomes, and a small learner for it that codes
places by tiles.

terrain = Terrain(seed=0)
learner = TileCoded(terrain, seed=0)       # tries random steps from random places, once
policy = learner.train(values)             # from an observation to an action
terrain.shares(policy)                     # (5,)
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from elicit.model.scale import Floats

OUTCOMES = ("swamp", "thicket", "heath", "meadow", "lake shore")  # worst first
DISCOUNT = 0.9
STEPS = 60  # of a walk; what comes after is .2% of the discounted time
_STEP, _NOISE = 0.08, 0.02
_WAYS = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]]) * _STEP
_PATCHES = 24
_RARITY = np.array([0.3, 0.25, 0.2, 0.15, 0.1])  # of the outcomes among the patches


class Terrain(gym.Env[Floats, np.int64]):
    """The unit square, in patches: each place has the outcome of the nearest of 24 points. A step
    goes north, east, south or west, about .08 far, and counts at the outcome of where it leads;
    ``info["level"]`` says which. Walks start anywhere and are cut off after 60 steps."""

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.points = rng.random((_PATCHES, 2))
        kinds = np.repeat(
            np.arange(5), np.diff(np.round(np.cumsum([0, *_RARITY]) * _PATCHES).astype(int))
        )
        self.outcomes = rng.permutation(kinds)
        self.observation_space = gym.spaces.Box(0.0, 1.0, (2,), np.float64)
        self.action_space = gym.spaces.Discrete(len(_WAYS))

    def level(self, places: Floats) -> NDArray[np.int64]:
        """The outcomes (n,) of places (n, 2)."""
        far = ((places[:, None, :] - self.points) ** 2).sum(axis=2)
        return np.asarray(self.outcomes[far.argmin(axis=1)])

    def moved(self, places: Floats, actions: NDArray[Any], rng: np.random.Generator) -> Floats:
        """Return the places (n, 2) that steps from ``places`` lead to."""
        return np.asarray(
            np.clip(places + _WAYS[actions] + _NOISE * rng.standard_normal(places.shape), 0.0, 1.0)
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Start anywhere."""
        super().reset(seed=seed)
        self._place, self._left = self.np_random.random((1, 2)), STEPS
        return self._place[0], {}

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """One step; its reward is 0, for what outcomes are worth nobody has said."""
        self._place = self.moved(self._place, np.array([action]), self.np_random)
        self._left -= 1
        return (
            self._place[0],
            0.0,
            False,
            self._left == 0,
            {"level": int(self.level(self._place)[0])},
        )

    def shares(self, policy: TiledPolicy, walks: int = 2000, seed: int = 0) -> Floats:
        """Return shares (5,) as ``qlearn.rollout_shares`` measures them, over many walks at once.

        Every policy meets the same random numbers. Steps after the cut are left out.
        """
        rng = np.random.default_rng(seed)
        places, shares, left = rng.random((walks, 2)), np.zeros(5), 1.0
        for _ in range(STEPS):
            places = self.moved(places, policy.actions(places), rng)
            shares += left * (1 - DISCOUNT) * np.bincount(self.level(places), minlength=5) / walks
            left *= DISCOUNT
        return np.asarray(shares)


class TiledPolicy:
    """Takes the action with the greatest mean over tilings of the values ``q`` (tilings, tiles,
    actions).
    """

    def __init__(self, tiles: Tiles, q: Floats) -> None:
        self.tiles, self.q = tiles, q

    def actions(self, places: Floats) -> NDArray[np.int64]:
        """(n,) at places (n, 2)."""
        return np.asarray(self.tiles.mean(self.q, self.tiles.of(places)).argmax(axis=1))

    def __call__(self, observation: Floats) -> int:
        """The action at one observation."""
        return int(self.actions(observation[None, :])[0])


class Tiles:
    """Some tilings of the unit square, each shifted against the others (Sutton and Barto 2018,
    9.5.4).
    """

    def __init__(self, tilings: int, across: int) -> None:
        self.tilings, self.across = tilings, across

    @property
    def count(self) -> int:
        """Tiles of one tiling."""
        return (self.across + 1) ** 2

    def of(self, places: Floats) -> NDArray[np.int64]:
        """The tile (tilings, n) of each place (n, 2) in each tiling."""
        shift = np.arange(self.tilings)[:, None, None] / self.tilings
        cell = np.floor(places * self.across + shift).astype(np.int64)
        return np.asarray(cell[..., 0] * (self.across + 1) + cell[..., 1])

    def mean(self, q: Floats, tiles: NDArray[np.int64]) -> Floats:
        """The mean (n, actions) over tilings of q (tilings, tiles, actions) at tiles (tilings,
        n).
        """
        return np.asarray(q[np.arange(self.tilings)[:, None], tiles].mean(axis=0))


class TileCoded:
    """Learns from one batch of random steps, without a model, whatever outcomes are worth: fitted Q
    iteration (Ernst, Geurts and Wehenkel 2005) with the means over tiles, which cannot diverge
    (Gordon 1995)."""

    def __init__(
        self, terrain: Terrain, seed: int, samples: int = 60_000, tilings: int = 4, across: int = 14
    ) -> None:
        rng = np.random.default_rng(seed)
        places, self._actions = rng.random((samples, 2)), rng.integers(len(_WAYS), size=samples)
        reached = terrain.moved(places, self._actions, rng)
        self.tiles, self._levels = Tiles(tilings, across), terrain.level(reached)
        self._from, self._to = self.tiles.of(places), self.tiles.of(reached)
        shape = (self.tiles.count, len(_WAYS))
        self._cells = [np.ravel_multi_index((row, self._actions), shape) for row in self._from]
        self._seen = [
            np.maximum(np.bincount(cell, minlength=np.prod(shape)), 1) for cell in self._cells
        ]

    def train(self, values: Floats, sweeps: int = 60) -> TiledPolicy:
        """A good policy where outcomes are worth these values (5,)."""
        tiles, ways = self.tiles, len(_WAYS)
        gain, q = (
            (1 - DISCOUNT) * values[self._levels],
            np.zeros((self.tiles.tilings, self.tiles.count, ways)),
        )
        for _ in range(sweeps):
            target = gain + DISCOUNT * tiles.mean(q, self._to).max(axis=1)
            for i, (cell, seen) in enumerate(zip(self._cells, self._seen, strict=True)):
                q[i] = (np.bincount(cell, target, minlength=tiles.count * ways) / seen).reshape(
                    -1, ways
                )
        return TiledPolicy(tiles, q)
