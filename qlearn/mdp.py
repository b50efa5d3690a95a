"""Ordinal reward MDPs (section 2.2): transitions are numbers, rewards are named levels."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from elicit.scale import Floats, normalise

Indices = NDArray[np.int32]
Flags = NDArray[np.bool_]

_DEFAULT: Any = None  # the fields below are never None once constructed, whatever was passed
_SUM_TOLERANCE = 1e-9  # farther from 1 than this, a row is no distribution
_ROUNDING = 1e-12  # nearer to 1 than this, a row is kept bit for bit, so that copies are identical


@dataclass(frozen=True, eq=False, repr=False)
class OrdinalMDP:
    """An MDP whose reward is one of k named levels, worst first; what a level is worth is unknown.

    ``successors`` (S, A, b) state indices and ``probabilities`` (S, A, b): the next state after
    action a in state s is ``successors[s, a, j]`` with probability ``probabilities[s, a, j]``.
    A successor may appear twice in a row; its probabilities add. Shorter rows are padded with
    probability 0. ``levels`` (S, A) int in 0..k-1, ``discount`` in [0, 1), ``labels`` the k names.
    ``initial`` (S,) is where episodes start (default: uniform over the states that are not
    terminal), ``terminal`` (S,) bool where they end (default: nowhere), and ``admissible`` (S, A)
    bool which actions there are (default: all). Array-likes are accepted and copied; the stored
    arrays are read-only.

    A terminal state's value is its level for ever, so its levels must agree over its admissible
    actions. What is never read needs no valid entries and is overwritten: the rows of a terminal
    state by a self-loop, those of an inadmissible action by probability 0 throughout, and the
    successors of padding by the row's last real one, where a sampler that runs off the end by
    rounding then lands. Rows (and ``initial``) that sum to 1 within 1e-9 but not within 1e-12 are
    divided by their sum.

    Raises ValueError (or TypeError for what is no array of numbers), naming the index and the value.
    """

    successors: NDArray[np.integer[Any]]  # int32 once stored
    probabilities: Floats
    levels: NDArray[np.integer[Any]]  # int32 once stored
    discount: float
    labels: tuple[str, ...]
    initial: Floats = _DEFAULT
    terminal: Flags = _DEFAULT
    admissible: Flags = _DEFAULT

    def __post_init__(self) -> None:
        probabilities = _numbers("probabilities", self.probabilities)
        if probabilities.ndim != 3 or 0 in probabilities.shape:
            raise ValueError(
                f"probabilities must have shape (S, A, b), each at least 1, not {probabilities.shape}; "
                "OrdinalMDP.from_dense takes a table (S, A, S)"
            )
        n, m, b = probabilities.shape
        targets = _numbers("successors", self.successors, (n, m, b))
        levels = _integers("levels", _numbers("levels", self.levels, (n, m)))
        labels = _names(self.labels)
        discount = float(self.discount)
        if not 0 <= discount < 1:
            raise ValueError(f"discount must be in [0, 1), not {discount}")
        terminal = _flags("terminal", self.terminal, (n,), default=False)
        admissible = _flags("admissible", self.admissible, (n, m), default=True)
        if terminal.all():
            raise ValueError(f"all {n} states are terminal: there is nothing to decide; clear at least one")
        if not admissible.any(axis=1).all():
            s = int(np.argmin(admissible.any(axis=1)))
            raise ValueError(f"state {s} has no admissible action; set at least one of admissible[{s}]")
        _reject("levels", levels, (levels < 0) | (levels >= len(labels)), f"must be in 0..{len(labels) - 1}")
        _check_terminal_levels(levels, terminal, admissible)

        own = np.arange(n, dtype=np.float64)[:, None, None]
        unread = (~admissible | terminal[:, None])[:, :, None]
        targets = np.where(unread, own, targets)
        probabilities = np.where(unread, 0.0, probabilities)
        probabilities[terminal, :, 0] = admissible[terminal]
        padding = probabilities == 0
        last = b - 1 - np.argmin(padding[:, :, ::-1], axis=2, keepdims=True)
        targets = np.where(padding, np.take_along_axis(targets, last, axis=2), targets)
        successors = _integers("successors", targets)
        _reject("successors", successors, (successors < 0) | (successors >= n), f"must be a state in 0..{n - 1}")
        probabilities = _distributions("probabilities", probabilities, needed=admissible)

        if self.initial is None:
            initial = ~terminal / np.count_nonzero(~terminal)
        else:
            initial = _distributions("initial", _numbers("initial", self.initial, (n,)))
            _reject(
                "initial", initial, terminal & (initial != 0), "must be 0: an episode cannot start in a terminal state"
            )

        stored = (successors, probabilities, levels, discount, labels, initial, terminal, admissible)
        for field, value in zip(fields(self), stored, strict=True):
            object.__setattr__(self, field.name, value)
        self._freeze()

    def _freeze(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._freeze()  # unpickled arrays are writeable

    @classmethod
    def from_dense(
        cls,
        transitions: ArrayLike,
        levels: ArrayLike,
        discount: float,
        labels: Sequence[str],
        *,
        initial: ArrayLike | None = None,
        terminal: ArrayLike | None = None,
        admissible: ArrayLike | None = None,
    ) -> OrdinalMDP:
        """The same from a dense table ``transitions`` (S, A, S) of p(s, a, s')."""
        table = _numbers("transitions", transitions)
        if table.ndim != 3 or table.shape[0] != table.shape[2] or 0 in table.shape:
            raise ValueError(f"transitions must have shape (S, A, S), not {table.shape}")
        n, m, _ = table.shape
        ends = _flags("terminal", terminal, (n,), default=False)
        offered = _flags("admissible", admissible, (n, m), default=True)
        used = (table != 0) & (offered & ~ends[:, None])[:, :, None]
        counts = np.count_nonzero(used, axis=2)
        state, action, successor = np.nonzero(used)
        slot = np.arange(state.size) - np.repeat(np.cumsum(counts) - counts.ravel(), counts.ravel())
        shape = (n, m, max(1, int(counts.max())))
        successors = np.zeros(shape, dtype=np.int32)
        probabilities = np.zeros(shape)
        successors[state, action, slot] = successor
        probabilities[state, action, slot] = table[state, action, successor]
        given: dict[str, Any] = {"initial": initial, "terminal": ends, "admissible": offered}
        return cls(successors, probabilities, np.asarray(levels), discount, tuple(labels), **given)

    @property
    def n_states(self) -> int:
        """S."""
        return int(self.levels.shape[0])

    @property
    def n_actions(self) -> int:
        """A."""
        return int(self.levels.shape[1])

    @property
    def k(self) -> int:
        """The number of levels."""
        return len(self.labels)

    @cached_property
    def final_level(self) -> Indices:
        """(S,) a terminal state's level; -1 where the state is not terminal."""
        first = np.argmax(self.admissible, axis=1)
        level: Indices = np.where(self.terminal, self.levels[np.arange(self.n_states), first], -1).astype(np.int32)
        level.flags.writeable = False
        return level

    @cached_property
    def transitions(self) -> sparse.csr_array:
        """p as CSR (S*A, S); row s*A + a belongs to (s, a). An admissible action of a terminal
        state loops; the row of an inadmissible action is empty. Do not write to it."""
        p = self.probabilities.reshape(self.n_states * self.n_actions, -1)
        row, slot = np.nonzero(p)
        column = self.successors.reshape(p.shape)[row, slot]
        matrix = sparse.csr_array((p[row, slot], (row, column)), shape=(p.shape[0], self.n_states))
        matrix.sum_duplicates()
        matrix.data.flags.writeable = False
        return matrix

    def normalise(self, values: ArrayLike) -> Floats:
        """values (k,), one a level and increasing, as a scale from 0 to 1. Raises ValueError."""
        scale = normalise(values)
        if scale.size != self.k:
            raise ValueError(f"values must be {self.k} numbers, one a level, not {scale.size}")
        return scale

    def rewards(self, values: ArrayLike) -> Floats:
        """Numeric rewards r(s, a) (S, A) if level i were worth values[i], in the unit of ``values``.

        values (k,) must increase; they are used as they are. Any solver for standard MDPs takes the
        result, together with ``transitions`` and ``discount``. Raises ValueError.
        """
        self.normalise(values)
        r: Floats = np.asarray(values, dtype=np.float64)[self.levels]
        return r

    def vector_rewards(self) -> Floats:
        """(S, A, k) one-hot: component i is 1 where the level of (s, a) is i (section 2.2)."""
        one_hot: Floats = np.eye(self.k)[self.levels]
        return one_hot

    @cached_property
    def fingerprint(self) -> str:
        """Hash (32 hex digits) of everything stored, the same on every machine and in every process."""
        digest = hashlib.blake2b(repr((self.discount, self.labels)).encode(), digest_size=16)
        arrays = ("successors", "probabilities", "levels", "initial", "terminal", "admissible")
        for name, kind in zip(arrays, ("<i4", "<f8", "<i4", "<f8", "?", "?"), strict=True):
            array = np.ascontiguousarray(getattr(self, name), dtype=kind)
            digest.update(f"{name}{array.shape}".encode() + array.tobytes())
        return digest.hexdigest()

    def __repr__(self) -> str:
        scale = " < ".join(self.labels if self.k <= 7 else (*self.labels[:3], "...", self.labels[-1]))
        parts = [
            f"{self.n_states} states, {self.n_actions} actions, {self.k} levels: {scale}, discount {self.discount:g}"
        ]
        if self.terminal.any():
            parts.append(f"{np.count_nonzero(self.terminal)} terminal")
        if not self.admissible.all():
            parts.append(f"{self.admissible.sum(axis=1).mean():.1f} admissible actions a state")
        return f"OrdinalMDP({', '.join(parts)})"


def _reject(name: str, array: NDArray[Any], bad: Flags, rule: str) -> None:
    if bad.any():
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ValueError(f"{name}[{', '.join(map(str, index))}] is {array[index]}, but {rule}")


def _numbers(name: str, given: ArrayLike, shape: tuple[int, ...] | None = None) -> Floats:
    try:
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be an array of numbers: {error}") from None
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, not {array.shape}")
    return array


def _integers(name: str, array: Floats) -> Indices:
    _reject(name, array, ~(array == np.floor(array)) | (np.abs(array) > 2**31 - 1), "must be a 32-bit whole number")
    return array.astype(np.int32)


def _flags(name: str, given: ArrayLike | None, shape: tuple[int, ...], default: bool) -> Flags:
    if given is None:
        return np.full(shape, default)
    array = _numbers(name, given, shape)
    _reject(name, array, (array != 0) & (array != 1), "must be True or False; a list of indices is not taken")
    return array.astype(np.bool_)


def _names(given: Sequence[str]) -> tuple[str, ...]:
    if isinstance(given, str) or not all(isinstance(label, str) for label in given):
        raise TypeError(f"labels must be a sequence of strings, worst level first, not {given!r}")
    labels = tuple(str(label) for label in given)  # plain strings, also of a numpy array
    if len(labels) < 2:
        raise ValueError(f"labels must name at least 2 levels, not {labels}: with one, all policies are equal")
    twice = next((label for i, label in enumerate(labels) if label in labels[:i]), None)
    if twice is not None:
        raise ValueError(f"labels must differ, but {twice!r} appears twice in {labels}")
    return labels


def _check_terminal_levels(levels: Indices, terminal: Flags, admissible: Flags) -> None:
    lowest = np.where(admissible, levels, np.iinfo(np.int32).max).min(axis=1)
    highest = np.where(admissible, levels, -1).max(axis=1)
    bad = terminal & (lowest != highest)
    if bad.any():
        s = int(np.argmax(bad))
        raise ValueError(
            f"terminal state {s} has levels {levels[s][admissible[s]].tolist()} over its admissible actions, but its "
            "value is one level for ever: give them all the same level"
        )


def _distributions(name: str, p: Floats, needed: Flags | None = None) -> Floats:
    """p (..., b) with every row a distribution, except the rows of zeros that are not ``needed``."""
    _reject(name, p, ~np.isfinite(p), "must be finite")
    _reject(name, p, p < 0, "must not be negative")
    total = p.sum(axis=-1)
    off = np.abs(total - 1) if needed is None else np.where(needed, np.abs(total - 1), 0.0)
    if (off > _SUM_TOLERANCE).any():
        index = tuple(int(i) for i in np.argwhere(off > _SUM_TOLERANCE)[0])
        row = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise ValueError(f"{row} sums to {float(total[index])!r}, not 1: divide it by its sum if this is only rounding")
    divisor = np.where(off > _ROUNDING, total, 1.0)
    scaled: Floats = p / divisor[..., None]
    return scaled
