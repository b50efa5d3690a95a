"""Checks of an MDP's arrays, a block of states at a time, because they may fill the memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.validation import check_printable
from elicit.model.scale import Floats

Indices = NDArray[np.int32]
Flags = NDArray[np.bool_]

BLOCK = 1 << 20  # numbers checked at once
_SUM_TOLERANCE = 1e-9  # a row farther from 1 than this is no distribution
_ROUNDING = 1e-12  # a row nearer to 1 than this is kept bit for bit, so that copies are identical


Place: TypeAlias = Callable[[int, int], str]
"""Returns words for a state and an action, given their numbers."""


def clean(
    targets: NDArray[Any], probabilities: Floats, terminal: Flags, admissible: Flags, place: Place
) -> tuple[NDArray[np.integer[Any]], Floats]:
    """Return successors (S, A, b) int32 and probabilities (S, A, b) for ``OrdinalMDP``.

    Entries that are never read are overwritten. A row is divided by its sum if the sum differs from
    1 by more than rounding errors. An array that needs no change is returned as it is. One that
    does is changed in place, or copied first if it is read-only. Raise ValueError for a successor
    that is no state, and for a row that is no distribution.
    """
    n, _, b = probabilities.shape
    step = max(1, BLOCK // max(1, probabilities[0].size))
    for start in range(0, n, step):
        part = slice(start, min(n, start + step))
        t, p = before = targets[part], probabilities[part]
        unread = (~admissible[part] | terminal[part, None])[:, :, None]
        if unread.any():
            t = np.where(unread, np.arange(part.start, part.stop)[:, None, None], t)
            p = np.where(unread, 0.0, p)
            p[terminal[part], :, 0] = admissible[part][terminal[part]]
        padding = p == 0
        if padding.any():
            last = b - 1 - np.argmin(padding[:, :, ::-1], axis=2, keepdims=True)
            t = np.where(padding, np.take_along_axis(t, last, axis=2), t)
        whole = _int32("successors", t, start)
        rule = f"must be a state in 0..{n - 1}"
        reject("successors", whole, (whole < 0) | (whole >= n), rule, start, _words(place, start))
        words = _words(place, start, whole)
        p = distributions("probabilities", p, needed=admissible[part], start=start, words=words)
        if p is not before[1] and not np.array_equal(p, before[1]):
            probabilities = probabilities if probabilities.flags.writeable else probabilities.copy()
            probabilities[part] = p
        if whole is not before[0] and not np.array_equal(whole, before[0]):
            targets = targets if targets.flags.writeable else targets.copy()
            targets[part] = whole
    return targets.astype(np.int32, copy=False), probabilities


def reject(
    name: str,
    array: NDArray[Any],
    bad: Flags,
    rule: str,
    start: int = 0,
    words: Callable[[tuple[int, ...]], str] | None = None,
) -> None:
    """Raise ValueError that names the first bad entry of an array.

    ``start`` is the index of the array's first row, and ``words`` say what an index stands for.
    """
    if bad.any():
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        named = (index[0] + start, *index[1:])
        where = words(index) if words else ""
        raise ValueError(
            f"{name}[{', '.join(map(str, named))}] is {array[index]}, but {rule}{where}"
        )


def _words(
    place: Place, start: int, targets: Indices | None = None
) -> Callable[[tuple[int, ...]], str]:
    """Return a function that turns an index into words: which state and action it is about.

    The words also name the next state of an entry whose successor is in ``targets`` (S, A, b),
    because the last index of a stored row is not the number of a state.
    """

    def words(index: tuple[int, ...]) -> str:
        said = place(index[0] + start, index[1])
        if targets is not None and len(index) == 3:
            said += f", next state {targets[index]}"
        return f" ({said})"

    return words


def numbers(
    name: str, given: ArrayLike, shape: tuple[int, ...] | None = None, whole: bool = False
) -> NDArray[Any]:
    """Return a copy of ``given`` as floats, or with ``whole`` as integers, int32 if they fit.

    An array of just that type that is read-only and owns its memory is not copied. Raise TypeError
    or ValueError.
    """
    kind: Any = np.float64
    if whole and isinstance(given, np.ndarray) and given.dtype.kind in "iu":
        fits = not given.size or (given.min() >= -(2**31) and given.max() < 2**31)
        kind = np.int32 if fits else np.float64
    if isinstance(given, np.ndarray) and given.dtype == kind and given.base is None:
        array: NDArray[Any] = given if _frozen(given) else given.copy(order="C")
    else:
        try:
            array = np.array(given, dtype=kind, order="C")
        except (TypeError, ValueError) as error:
            raise TypeError(
                f"{name} must be an array of numbers, in lists of the same length: {error}"
            ) from None
    if shape is not None and array.shape != shape:
        each = ", one entry for each state" if len(shape) == 1 else ""
        raise ValueError(
            f"{name} must have shape {shape}{each}, not {array.shape}"
            + (
                ": if it is the same for every action, give "
                f"np.repeat(np.c_[{name}], {shape[1]}, axis=1)"
                if len(shape) == 2 and array.shape == shape[:1]
                else ""
            )
        )
    return array


def _frozen(array: NDArray[Any]) -> bool:
    return bool(
        type(array) is np.ndarray and array.flags.c_contiguous and not array.flags.writeable
    )


def indices(name: str, given: ArrayLike, shape: tuple[int, ...], count: int) -> Indices:
    """Return a copy of ``given`` as int32, each in 0..count - 1. Raise TypeError or ValueError."""
    array = _int32(name, numbers(name, given, shape, whole=True))
    reject(name, array, (array < 0) | (array >= count), f"must be in 0..{count - 1}")
    return array


def levels(given: ArrayLike, shape: tuple[int, int], k: int, place: Place) -> Indices:
    """Return a copy of the levels of an MDP as int32. Raise TypeError or ValueError."""
    dimensions = np.ndim(given) if isinstance(given, np.ndarray) else len(shape)
    if dimensions == len(shape) + 1:
        raise ValueError(
            f"levels must have shape {shape}, a level for each state and action, not "
            f"{np.shape(given)}: where the level depends on the next state, add a state for each "
            "outcome, and give that state the level"
        )
    try:
        array = numbers("levels", given, shape, whole=True)
    except TypeError as error:
        raise TypeError(
            f"{error}; a level is given by its number, 0 for the worst: labels.index(name) is the "
            "number of a level's name"
        ) from None
    wanted = (
        f"must be in 0..{k - 1}, because {k} levels have labels: a level is given by its number, "
        "from the worst on (rewards become levels by "
        "rewards, levels = np.unique(rewards, return_inverse=True))"
    )
    found = _int32("levels", array)
    reject("levels", found, (found < 0) | (found >= k), wanted, words=_words(place, 0))
    return found


def _int32(name: str, array: NDArray[Any], start: int = 0) -> Indices:
    """Return the array as int32. ``start`` is as for ``reject``."""
    if array.dtype == np.int32:
        return array
    bad = ~(array == np.floor(array)) | (np.abs(array) > 2**31 - 1)
    reject(name, array, bad, "must be a whole number of at most 2147483647", start)
    return array.astype(np.int32)


def flags(name: str, given: ArrayLike | None, shape: tuple[int, ...], default: bool) -> Flags:
    """Return a copy of ``given`` as bools, or ``default`` everywhere if it is None.

    Raise TypeError or ValueError.
    """
    if given is None:
        return np.full(shape, default)
    if isinstance(given, np.ndarray) and given.dtype == np.bool_ and given.shape == shape:
        return given if _frozen(given) and given.base is None else given.copy(order="C")
    if len(shape) == 1 and np.shape(given) != shape:
        raise ValueError(
            f"{name} must have shape {shape}, True or False for each state, not "
            f"{np.shape(given)}; a list of the numbers of states is not taken"
        )
    array = numbers(name, given, shape)
    reject(
        name,
        array,
        (array != 0) & (array != 1),
        "must be True or False; a list of indices is not taken",
    )
    return array.astype(np.bool_)


def labels(given: Sequence[str]) -> tuple[str, ...]:
    """Return the levels' names as plain strings. Raise TypeError or ValueError."""
    found = _strings("labels", given, "a sequence of strings, worst level first")
    if len(found) < 2:
        raise ValueError(
            f"labels must name at least 2 levels, not {found}: with one, all policies are equal"
        )
    return found


def names(name: str, given: Sequence[str] | None, count: int) -> tuple[str, ...] | None:
    """Return the names of states or actions as plain strings; None if they have numbers only.

    Raise TypeError or ValueError.
    """
    if given is None:
        return None
    found = _strings(name, given, "None or a sequence of strings")
    if len(found) != count:
        raise ValueError(f"{name} must be {count} names, one each, but there are {len(found)}")
    return found


def _strings(name: str, given: Sequence[str], wanted: str) -> tuple[str, ...]:
    """Return names as a tuple of plain strings. Raise an error unless all are different."""
    sized = isinstance(given, Iterable) and not isinstance(given, str)
    found = tuple(given) if sized else ()
    if not sized or not all(isinstance(one, str) for one in found):
        raise TypeError(f"{name} must be {wanted}, not {given!r}")
    seen: set[str] = set()
    for one in found:
        if one in seen:
            raise ValueError(f"{name} must differ, but {str(one)!r} appears twice")
        seen.add(one)
    check_printable(name, map(str, found))
    return tuple(map(str, found))


def called(kind: str, number: int, names: Sequence[str] | None) -> str:
    """Return the number of a state or an action, with its name if it has one, as text."""
    return f"{kind} {number}" if names is None else f"{kind} {number}, {names[number]!r}"


def check_terminal_levels(
    levels: Indices, terminal: Flags, admissible: Flags, states: Sequence[str] | None
) -> None:
    """Raise ValueError if a terminal state has two levels. ``states`` are names for the message."""
    ends = np.flatnonzero(terminal)
    levels, admissible = levels[ends], admissible[ends]
    lowest = np.where(admissible, levels, np.iinfo(np.int32).max).min(axis=1)
    highest = np.where(admissible, levels, -1).max(axis=1)
    bad = lowest != highest
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"terminal {called('state', int(ends[i]), states)} has levels "
            f"{levels[i][admissible[i]].tolist()} over its admissible actions, "
            "but its value is one level for ever: give them all the same level"
        )


def distributions(
    name: str,
    p: Floats,
    needed: Flags | None = None,
    start: int = 0,
    words: Callable[[tuple[int, ...]], str] | None = None,
) -> Floats:
    """Return p (..., b) with every needed row a distribution.

    If no change is needed it is p itself. ``start`` and ``words`` are as for ``reject``. Raise
    ValueError.
    """
    reject(name, p, ~np.isfinite(p), "must be finite", start, words)
    reject(name, p, p < 0, "must not be negative", start, words)
    total = p.sum(axis=-1)
    off = np.abs(total - 1) if needed is None else np.where(needed, np.abs(total - 1), 0.0)
    if (off > _SUM_TOLERANCE).any():
        index = tuple(int(i) for i in np.argwhere(off > _SUM_TOLERANCE)[0])
        named = (index[0] + start, *index[1:]) if index else index
        row = f"{name}[{', '.join(map(str, named))}]" if index else name
        raise ValueError(
            f"{row} sums to {float(total[index])!r}, not 1: "
            "correct the wrong entry, or divide by the sum if this is only rounding, by 100 if "
            "these are percent"
            f"{words(index) if words else ''}"
        )
    if not (off > _ROUNDING).any():
        return p
    scaled: Floats = p / np.where(off > _ROUNDING, total, 1.0)[..., None]
    return scaled
