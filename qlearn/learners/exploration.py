"""The ways in which Q-learning explores: settings, and the standard ones by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from elicit._support.validation import is_number, is_whole, require
from elicit.model.scale import Floats

Start: TypeAlias = Literal["worst", "zero", "best"]


@dataclass(frozen=True)
class Decay:
    """A probability of exploring that falls in a straight line.

    Parameters
    ----------
    first : float
        The probability at the first step, in 0..1. Default: 1.
    last : float
        The probability at the end of the fall and from then on, in 0..1. Default: 0.05.
    share : float
        The share of the steps over which the probability falls, in 0..1 and above 0. Default: 0.5.

    Raises
    ------
    ValueError
        If a number is out of range.
    """

    first: float = 1.0
    last: float = 0.05
    share: float = 0.5

    def __call__(self, steps: NDArray[np.int64]) -> Floats:
        """Return the probability of exploring in each step.

        Parameters
        ----------
        steps : (n,) int
            The numbers of the steps: 0, 1, ..., n - 1.

        Returns
        -------
        (n,)
            Probabilities.
        """
        over = max(1.0, self.share * len(steps))
        return np.asarray(
            self.first + (self.last - self.first) * np.minimum(1.0, steps / over), dtype=np.float64
        )

    def __post_init__(self) -> None:
        for name in ("first", "last", "share"):
            value = getattr(self, name)
            if not (is_number(value, 0) and value <= 1) or (name == "share" and value == 0):
                raise ValueError(
                    f"{name} of a Decay must lie in 0..1{' above 0' * (name == 'share')}, not "
                    f"{value!r}"
                )


Epsilon: TypeAlias = float | Decay | Callable[[NDArray[np.int64]], Floats]
"""A constant probability, or a function from the numbers (n,) of a run's steps to the probability
in each."""


@dataclass(frozen=True)
class Exploration:
    """The way in which ``InteractiveQLearning`` explores.

    Parameters
    ----------
    epsilon : float, Decay or function
        Probability of an action drawn uniformly. At 1 the agent never follows the actions that it
        has learned, and all comparators see the same transitions. Q-learning still learns the best
        policy.
    start : {"worst", "zero", "best"}
        The first estimate of all vectors. "worst": all mass on the worst level. "best": all on the
        best level, which makes untried actions look good (optimism). "zero": as in the paper's line
        4. Then totals differ for a long time, so that early questions are ill-posed.
    episode_length : int, optional
        Restart from the MDP's initial distribution after this many steps. None: restart in terminal
        states only.
    """

    epsilon: Epsilon
    start: Start = "worst"
    episode_length: int | None = None

    def __post_init__(self) -> None:
        require(self.start in get_args(Start), "start", "'worst', 'zero' or 'best'", self.start)
        length = self.episode_length
        holds = length is None or is_whole(length, 1)
        require(holds, "episode_length", "None or a whole number of at least 1", length)


EXPLORATIONS: Mapping[str, Exploration] = MappingProxyType(
    {
        "constant": Exploration(0.1),
        "decaying": Exploration(Decay()),
        "restarts": Exploration(0.1, episode_length=20),
        "optimistic": Exploration(0.1, start="best"),
        "uniform": Exploration(1.0, start="best"),
    }
)
"""The ways to explore that have a name; ``python -m benchmarks.paper.exploration`` measures their
results."""


def exploration_of(choice: Epsilon | Exploration | str | None) -> Exploration:
    """Return an Exploration, given as itself, by its name, or by a value of epsilon.

    None stands for "optimistic". Raise ValueError if there is no such name.
    """
    choice = "optimistic" if choice is None else choice
    if isinstance(choice, str):
        wanted = (
            "a number in 0..1, a function of steps, an Exploration, or one of the names "
            + ", ".join(EXPLORATIONS)
        )
        require(choice in EXPLORATIONS, "epsilon", wanted, choice)
        return EXPLORATIONS[choice]
    return (
        choice
        if isinstance(choice, Exploration)
        else replace(EXPLORATIONS["constant"], epsilon=choice)
    )


def epsilons(epsilon: Epsilon, steps: int) -> Floats:
    """Return the probability of exploring in each step, (steps,), or (1,) if it is constant.

    Raise ValueError unless all lie in 0..1.
    """
    return schedule(
        epsilon,
        steps,
        "epsilon must be a number in 0..1, or a function from steps (n,) to chances (n,)",
    )


def schedule(choice: object, n: int, wanted: str, *, positive: bool = False) -> Floats:
    """Return a number as (1,), or the values of a function for 0, 1, ... n - 1 as (n,).

    If n is 0 the function is still called for 0. Raise ValueError, which says what is ``wanted``,
    unless all values lie in 0..1, and with ``positive`` above 0.
    """
    if not (callable(choice) or is_number(choice)):
        raise ValueError(f"{wanted}, not {choice!r}")
    times = np.arange(max(1, n))
    numbers = np.asarray(choice(times) if callable(choice) else [choice], dtype=np.float64)
    if callable(choice) and numbers.shape != times.shape:
        raise ValueError(f"{wanted}: for {len(times)} it gives shape {numbers.shape}")
    wrong = ~((numbers > 0 if positive else numbers >= 0) & (numbers <= 1))
    if wrong.any():
        raise ValueError(f"{wanted}, not {float(numbers[wrong][0])!r} (at {int(wrong.argmax())})")
    return numbers
