"""Seeds as callers give them: one keyword for all of them, and a fresh seed for None."""

import secrets
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from elicit._support.hashing import Seed

_P = ParamSpec("_P")
_R = TypeVar("_R")


def seed_of(seed: Seed | None) -> Seed:
    """Return the seed itself, or for None a random int from the operating system.

    A caller keeps the result, so that a run can be repeated.
    """
    return secrets.randbits(63) if seed is None else seed


def takes_rng(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a function that takes ``seed=`` so that it takes the older keyword ``rng=`` as well.

    Raises TypeError if both are given.
    """

    @wraps(function)
    def either(*args: _P.args, **settings: _P.kwargs) -> _R:
        if "rng" in settings:
            if "seed" in settings:
                raise TypeError(
                    "seed= and rng= are two words for the same: give one of them, seed="
                )
            settings["seed"] = settings.pop("rng")
        return function(*args, **settings)

    return either
