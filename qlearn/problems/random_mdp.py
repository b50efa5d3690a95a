"""Random MDPs and hidden values as in section 5 of the paper."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed, key_of
from elicit._support.seeds import seed_of, takes_rng
from elicit._support.validation import is_number, require
from elicit.model.scale import Floats
from qlearn.mdp.array_checks import BLOCK
from qlearn.mdp.ordinal_mdp import OrdinalMDP

_VALUES = 100  # hidden values are integers 0..99 (section 5)


@takes_rng
def draw_values(k: int, seed: Seed | None) -> Floats:
    """Draw hidden values (k,) of a scale: distinct integers from 0..99, uniform, increasing.

    The paper's section 5 draws integers from 0..99. Drawn without replacement, the k levels have k
    different values, at least 1/99 of the range apart.

    Parameters
    ----------
    k : int
        Number of levels, from 2 to 100.
    seed : int, SeedSequence, Generator or None
        Draws the values. None: a new draw each time. The keyword ``rng`` is the same.

    Returns
    -------
    (k,)
        The values, worst level first, as floats.

    Raises
    ------
    ValueError
        If k is out of range.
    TypeError
        If the seed is something else, or both ``seed`` and ``rng`` are given.
    """
    _check("the number of levels", k, 2, _VALUES)
    return _values(k, np.random.default_rng(key_of(seed_of(seed))))


@takes_rng
def random_mdp(
    n_states: int,
    n_actions: int,
    n_levels: int,
    discount: float = 0.95,
    *,
    seed: Seed | None,
    weights: Literal["dirichlet", "gaussian"] = "dirichlet",
) -> tuple[OrdinalMDP, Floats]:
    """Return a random MDP as in the paper's section 5, and hidden values (k,) for its scale.

    Parameters
    ----------
    n_states, n_actions : int
        Number of states, and of actions in each state, from 1 on.
    n_levels : int
        Number of levels k, from 2 to 100.
    discount : float
        In [0, 1). Default: 0.95.
    seed : int, SeedSequence, Generator or None
        Draws the MDP and the values, as for ``draw_values``.
    weights : {"dirichlet", "gaussian"}
        How the transition probabilities are drawn. "dirichlet": from Dirichlet(1). "gaussian":
        absolute values of standard normals, scaled to total 1, as in later papers on interactive
        value iteration.

    Returns
    -------
    mdp : OrdinalMDP
        Its levels are called "level 1" (the worst), "level 2" and so on.
    values : (k,)
        The hidden values, as ``draw_values`` draws them.

    Raises
    ------
    ValueError
        If a number is out of range, or ``weights`` is another text.
    TypeError
        If the seed is something else, or both ``seed`` and ``rng`` are given.

    Notes
    -----
    Each (s, a) has ceil(log2 |S|) distinct successors (at least 1), a uniform sample of the states.
    The paper leaves the rest open. Here the level of each (s, a) is uniform over the scale. Only
    the levels and values depend on ``n_levels``, so a series over it with the same seed keeps its
    transitions.
    """
    _check("n_states", n_states, 1, 2**31 - 1)
    _check("n_actions", n_actions, 1, 2**31 - 1)
    _check("n_levels", n_levels, 2, _VALUES)
    require(weights in ("dirichlet", "gaussian"), "weights", '"dirichlet" or "gaussian"', weights)
    generator = np.random.default_rng(key_of(seed_of(seed)))
    b = max(1, (n_states - 1).bit_length())
    successors = _samples(n_states, b, (n_states, n_actions), generator)
    draw = generator.standard_exponential if weights == "dirichlet" else generator.standard_normal
    probabilities = draw(successors.shape)
    for part in np.array_split(
        probabilities, max(1, probabilities.size // BLOCK)
    ):  # in place: it may be a gigabyte
        np.abs(part, out=part)
        part /= part.sum(axis=2, keepdims=True)
    levels = generator.integers(n_levels, size=(n_states, n_actions))
    successors.flags.writeable = probabilities.flags.writeable = False  # handed over, not copied
    labels = tuple(f"level {i + 1}" for i in range(n_levels))
    mdp = OrdinalMDP(successors, probabilities, levels, discount, labels)
    return mdp, _values(n_levels, generator)


def _check(name: str, value: int, least: int, most: int) -> None:
    whole = isinstance(value, (int, np.integer)) and is_number(value, least, most)
    require(whole, name, f"a whole number from {least} to {most}", value)


def _values(k: int, generator: np.random.Generator) -> Floats:
    return np.sort(generator.choice(_VALUES, size=k, replace=False)).astype(np.float64)


def _samples(
    n: int, b: int, shape: tuple[int, ...], generator: np.random.Generator
) -> NDArray[np.int32]:
    """Return an array (*shape, b): in each row b distinct states of n, ascending.

    Every set of states is equally likely. The method is Floyd's algorithm (Bentley and Floyd, CACM
    1987), for all rows at once.
    """
    samples = np.empty((*shape, b), dtype=np.int32)
    rows = samples.reshape(-1, b)
    for j in range(b):
        top = n - b + j
        pick = generator.integers(top + 1, size=len(rows), dtype=np.int32)
        taken = (rows[:, :j] == pick[:, None]).any(axis=1)
        rows[:, j] = np.where(taken, top, pick)
    rows.sort(axis=1)
    return samples
