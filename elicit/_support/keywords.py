"""Checks of keywords that a function takes as ``**options`` from a common set."""

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from functools import wraps
from inspect import signature
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def check_keywords(taker: Any, given: Mapping[str, Any], common: Iterable[str]) -> None:
    """Raise TypeError for an unknown keyword, and suggest the nearest known one.

    Parameters
    ----------
    taker : function or class
        The callable that was given ``given`` as ``**options``. Its own keywords, and those of its
        base classes, are suggested too.
    given : mapping
        The options by name.
    common : names
        The keywords that ``**options`` may hold.
    """
    unknown = [name for name in given if name not in common]
    if not unknown:
        return
    takers = taker.__mro__[:-1] if isinstance(taker, type) else (taker,)
    own = {
        name
        for one in takers
        for name, parameter in signature(one).parameters.items()
        if parameter.kind is not parameter.VAR_KEYWORD
    }
    names = sorted(own | set(common))
    nearest = get_close_matches(unknown[0], names, n=1, cutoff=0.0)[0]
    raise TypeError(
        f"{taker.__name__} has no keyword {unknown[0]!r}. The nearest is {nearest!r}; it takes "
        f"{', '.join(names)}"
    )


def naming_nearest(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function: its error for an unknown keyword then suggests the nearest known one."""
    known = [*signature(function).parameters]

    @wraps(function)
    def checked(*args: P.args, **keywords: P.kwargs) -> R:
        check_keywords(function, keywords, known)
        return function(*args, **keywords)

    return checked
