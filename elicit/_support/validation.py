"""Checks of settings, which return False for any bad value and never raise by themselves.

Bad values include a text, None, nan and infinity.
"""

import unicodedata
from collections.abc import Iterable, Sized
from math import inf, isfinite
from numbers import Real
from typing import Any


def is_number(value: Any, least: float = -inf, most: float = inf) -> bool:
    """Return whether a value is a finite number from ``least`` to ``most``.

    A text, None, True and False are not numbers.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return isfinite(value) and least <= float(value) <= most
    except OverflowError:  # an int or a fraction that no float can hold
        return False


def is_whole(value: Any, least: int) -> bool:
    """Return whether a value is a whole number of at least ``least``."""
    return is_number(value, least) and bool(int(value) == value)


def is_range(value: Any, least: float = -inf, most: float = inf) -> bool:
    """Return whether a value is two finite numbers with ``least`` <= low <= high <= ``most``."""
    try:
        low, high = value
    except (TypeError, ValueError):
        return False
    return is_number(low, least, most) and is_number(high, low, most)


def is_list(value: Any, n: int) -> bool:
    """Return whether a value is a sequence of n items. A text is not."""
    return isinstance(value, Sized) and not isinstance(value, str | bytes) and len(value) == n


def require(holds: bool, name: str, wanted: str, value: object) -> None:
    """Raise ValueError that the setting ``name`` must be ``wanted``, unless ``holds`` is true."""
    if not holds:
        raise ValueError(f"{name} must be {wanted}, not {value!r}")


def with_visible_controls(text: str) -> str:
    """Return a text with control characters written as Python escapes."""
    if text.isprintable():
        return text
    return "".join(repr(c)[1:-1] if unicodedata.category(c) in _CONTROLS else c for c in text)


def check_printable(name: str, texts: Iterable[str]) -> None:
    """Raise ValueError if a text holds a control character.

    A control character, once printed, could change the other text on a person's screen.
    """
    for one in texts:
        if one.isprintable():  # saves a look at each character
            continue
        found = next((c for c in one if unicodedata.category(c) in _CONTROLS), None)
        if found is not None:
            raise ValueError(
                f"{name} are shown to people, and {one!r} holds the control character {found!r}: "
                "leave it out"
            )


_CONTROLS = ("Cc", "Cs", "Zl", "Zp")  # controls, lone surrogates, and ends of lines and paragraphs
