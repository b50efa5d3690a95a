"""The table into which families of problems write transitions and levels; their random numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.seeds import seed_of
from elicit._support.validation import is_whole, require
from qlearn.mdp.ordinal_mdp import OrdinalMDP


class Table:
    """Transitions and levels of an MDP, written one state and action at a time.

    Parameters
    ----------
    states, actions, labels : sequence of str
        The names of states, actions and levels, the worst level first.
    """

    def __init__(
        self, states: Sequence[str], actions: Sequence[str], labels: Sequence[str]
    ) -> None:
        self._states, self._actions, self._labels = states, actions, labels
        self._levels = np.zeros((len(states), len(actions)), dtype=np.int32)
        self._terminal = np.zeros(len(states), dtype=np.bool_)
        self._moves: list[tuple[int, int, float]] = []

    def write(self, state: int, action: int, level: int, *moves: tuple[int, float]) -> None:
        """Write an action's level and moves, (next state, probability). Equal moves add up."""
        self._levels[state, action] = level
        row = state * len(self._actions) + action
        self._moves += [(row, to, probability) for to, probability in moves if probability > 0]

    def write_all(self, state: int, level: int, *moves: tuple[int, float]) -> None:
        """Write the same level and moves for all actions of a state."""
        for action in range(len(self._actions)):
            self.write(state, action, level, *moves)

    def end(self, state: int, level: int) -> None:
        """Make a state terminal: its level counts for ever."""
        self._terminal[state] = True
        self.write_all(state, level, (state, 1.0))

    def mdp(self, discount: float, starts: Sequence[int]) -> OrdinalMDP:
        """Return the MDP; its episodes start in one of ``starts``, each equally likely."""
        n, m = self._levels.shape
        rows, columns, probabilities = zip(*self._moves, strict=True)
        matrix = sparse.coo_array((probabilities, (rows, columns)), shape=(n * m, n)).tocsr()
        initial = np.zeros(n)
        initial[list(starts)] = 1.0 / len(starts)
        return OrdinalMDP.from_sparse(
            matrix,
            self._levels,
            discount,
            self._labels,
            initial=initial,
            terminal=self._terminal,
            state_names=self._states,
            action_names=self._actions,
        )


class RandomNumbers:
    """The random numbers of a family and a seed, the same on every processor.

    Only sums and products follow the raw random bits: logarithms and powers differ in their last
    bits from processor to processor. The name of the family takes part, so that the same seed draws
    other numbers for the hidden values.
    """

    def __init__(self, family: str, seed: Seed | None) -> None:
        key = fold(key_of(seed_of(seed)), name_code(family))
        self._generator = np.random.default_rng(int(key))

    def between(self, low: float, high: float) -> float:
        """Return a number between the two, uniformly, rounded to four decimals."""
        return round(low + (high - low) * float(self._generator.random()), 4)

    def whole(self, most: int) -> int:
        """Return a whole number from 0 to ``most``, uniformly."""
        return int(self._generator.integers(most + 1))

    def happens(self, chance: float) -> bool:
        """Return True with this probability."""
        return bool(self._generator.random() < chance)


def checked_size(size: int, least: int, what: str) -> int:
    """Return the size as an int.

    Raises ValueError if it is not a whole number of at least ``least``.
    """
    require(is_whole(size, least), "size", f"{what}: a whole number of at least {least}", size)
    return int(size)
