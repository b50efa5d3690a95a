"""The level of each step of an environment, and how much discounted time the step stands for.

With discount c a run's share vector is (1 - c) times the sum over its steps t = 0, 1, ... of c^t
times the unit vector of the step's level. A run that goes on for ever has total 1. A run that
terminates after T steps has total 1 - c^T. The remaining time, c^T, belongs to the level that lasts
after the run. So the last step, t = T - 1, counts

    (1 - c) [its own level] + c [the level that lasts]

because its discount c^(T-1) turns the second part into c^T. If its own level lasts, the step counts
1 at that level.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from elicit._support.validation import is_number, is_whole, require
from elicit.model.comparator import check_levels
from elicit.model.scale import Floats

Level: TypeAlias = str | Mapping[float, int] | Callable[[Any, Any, dict[str, Any]], Any]
"""The source of a step's level, 0 (worst) to k - 1. It is a key of its ``info``, the level of each
value that the reward takes, or a function of (observation, reward, info). In a vectorised
environment the function gets batches."""

After: TypeAlias = int | Literal["last"] | None
"""The level that lasts once an episode has terminated: 0 to k - 1, or "last" for that of the last
step. None: not given, for tasks that never terminate."""


@dataclass(frozen=True)
class Levels:
    """The k levels of an environment's steps: where a step's level is found, and how it counts.

    Without a discount each step counts in full, and nothing comes after the last. Raises ValueError
    and TypeError.
    """

    k: int
    level: Level = "level"
    after: After = None
    discount: float | None = None

    def __post_init__(self) -> None:
        k = check_levels(self.k)
        if not (isinstance(self.level, (str, Mapping)) or callable(self.level)):
            raise TypeError(
                "level must be a key of info, a mapping from rewards to levels, or a function, "
                f"not {self.level!r}"
            )
        if isinstance(self.level, Mapping):
            stray = next((level for level in self.level.values() if not _is_level(level, k)), None)
            require(
                stray is None,
                "level",
                f"a mapping from rewards to levels, 0 to {k - 1}",
                self.level,
            )
        given = (
            self.after is None
            or _is_level(self.after, k)
            or (isinstance(self.after, str) and self.after == "last")
        )
        require(
            given,
            "after",
            f"a level, 0 to {k - 1}, or 'last', or None for tasks without an end",
            self.after,
        )
        known = self.discount is None or (is_number(self.discount, 0) and self.discount < 1)
        require(known, "discount", "a number of at least 0 and below 1", self.discount)

    @property
    def during(self) -> Floats:
        """Return a row (k,) for each level: what a step adds to shares if the episode goes on."""
        return np.eye(self.k) * (1.0 if self.discount is None else 1.0 - self.discount)

    @property
    def ending(self) -> Floats | None:
        """Return a row (k,) for each level: what a step that ends the episode adds to shares.

        The result is None if no lasting level is given.
        """
        if self.discount is None or self.after == "last":
            return np.eye(self.k)
        if self.after is None:
            return None
        lasting: Floats = np.eye(self.k)[self.after]
        return self.during + self.discount * lasting

    def of_step(self, observation: Any, reward: Any, info: dict[str, Any]) -> int:
        """Return the level of a step.

        Raises ValueError if there is none, or if it is not one of 0 to k - 1.
        """
        level = self.level
        if callable(level):
            found = level(observation, reward, info)  # its own errors pass through
        else:
            try:
                found = info[level] if isinstance(level, str) else level[float(reward)]
            except KeyError:
                raise self._missing(reward, info) from None
        if type(found) is int and 0 <= found < self.k:  # the fast path
            return found
        try:
            if 0 <= found < self.k and found == int(found):
                return int(found)
        except (TypeError, ValueError):
            pass
        raise self._bad(found)

    def of_steps(self, observations: Any, rewards: Any, infos: dict[str, Any], stepped: Any) -> Any:
        """Return the levels (n,) of a step of each of n environments, 0 unless ``stepped`` (n,).

        Raises ValueError.
        """
        level = self.level
        if isinstance(level, Mapping):
            found = [
                self.of_step(None, r, {}) if step else 0
                for r, step in zip(rewards, stepped, strict=True)
            ]
        elif isinstance(level, str):
            if stepped.any() and (
                level not in infos or not infos.get(f"_{level}", stepped)[stepped].all()
            ):
                raise self._missing(rewards, infos)
            found = infos.get(level, np.zeros(len(stepped), np.int64))
        else:
            found = level(observations, rewards, infos)
            if np.shape(found) not in ((), stepped.shape):
                raise ValueError(
                    f"level= must find one level for each of {len(stepped)} environments, not "
                    f"{found!r}"
                )
        levels = np.where(stepped, np.asarray(found), 0)
        whole = levels.shape == stepped.shape and levels.dtype.kind in "iuf"
        if not (whole and ((levels >= 0) & (levels < self.k) & (levels == np.floor(levels))).all()):
            raise self._bad(found)
        return levels.astype(np.int64)

    def never_ends(self) -> ValueError:
        """Return the error for an episode that terminates although no lasting level is given."""
        return ValueError(
            "an episode has terminated, and the time after it counts, but it is not said at which "
            "level: give after=, "
            f"a level from 0 to {self.k - 1}, or 'last' for that of the last step"
        )

    def _missing(self, reward: Any, info: dict[str, Any]) -> ValueError:
        if isinstance(self.level, Mapping):
            return ValueError(
                f"no level is given for the reward {float(reward)!r}: level= maps "
                f"{sorted(self.level)}"
            )
        return ValueError(
            f"the step's info has no {self.level!r}, only {sorted(info)}: level= takes the key of "
            "info under which the "
            "level is, a mapping from rewards to levels, or a function of (observation, reward, "
            "info)"
        )

    def _bad(self, found: Any) -> ValueError:
        return ValueError(
            f"a step's level must be a whole number from 0 to {self.k - 1} (worst first), not "
            f"{found!r}"
        )


def _is_level(level: object, k: int) -> bool:
    return is_whole(level, 0) and int(level) < k  # type: ignore[call-overload]
