"""Seeds as callers give them: one word for them, and a fresh one where none is given."""

import secrets
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from elicit._support.hashing import Seed

_P = ParamSpec("_P")
_R = TypeVar("_R")


def seed_of(seed: Seed | None) -> Seed:
    """The seed itself; where it is None, an int from the operating system's randomness. Whoever
    takes a seed keeps this one, so that what was drawn can be drawn again."""
    return secrets.randbits(63) if seed is None else seed


def takes_rng(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Take ``rng=`` for ``seed=``, the older word for the same. Raises TypeError where both are
    given.
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
