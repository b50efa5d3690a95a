"""Two known tasks, FrozenLake and deep-sea-treasure, with levels in place of rewards.

The dynamics are those of their packages.
"""

from __future__ import annotations

import os
import warnings
from typing import Any

import numpy as np

from qlearn.mdp.ordinal_mdp import OrdinalMDP

_ACTIONS = 4
_SEA = 0.0  # on the map of deep-sea-treasure: open water; rocks are below it, treasures above


def frozen_lake(discount: float = 0.99) -> OrdinalMDP:
    """Return Gymnasium's FrozenLake-v1, 8 x 8 and slippery.

    It has 64 states and 4 actions, each of which slips aside two times in three. State numbers are
    8 * row + column. Transitions and the initial distribution are those of ``env.unwrapped.P``. The
    holes and the goal are terminal.

    Parameters
    ----------
    discount : float
        In [0, 1). Default: 0.99.

    Returns
    -------
    OrdinalMDP
        Its levels, worst first, are those of the cell: hole < ice < goal.

    Raises
    ------
    ImportError
        Without the package.
    ValueError
        If the discount is out of range.

    Notes
    -----
    The package rewards only the goal, with 1, so that a hole costs as much as going round in
    circles. Here a hole is worse than ice, for ever after. How much worse, relative to the goal, is
    for the tutor to say.
    """
    env = _make("gymnasium", "FrozenLake-v1", map_name="8x8", is_slippery=True)
    table, cells = env.P, env.desc.ravel()
    n = len(cells)
    transitions = np.zeros((n, _ACTIONS, n))
    for s in range(n):
        for a in range(_ACTIONS):
            for probability, following, _, _ in table[s][a]:
                transitions[s, a, following] += probability
    level = np.select([cells == b"H", cells == b"G"], [0, 2], 1)
    return OrdinalMDP.from_dense(
        transitions,
        np.repeat(level[:, None], _ACTIONS, axis=1),
        discount,
        ("hole", "ice", "goal"),
        initial=env.initial_state_distrib,
        terminal=level != 1,
    )


def deep_sea_treasure(discount: float = 0.95) -> OrdinalMDP:
    """Return MO-Gymnasium's deep-sea-treasure-v0 (the convex map).

    A submarine has 4 actions; farther treasures are better. States are the cells that can be
    reached, in the order of the map's rows; the start is the first. The successor of each action is
    found by stepping the environment from every cell. The ten treasures are terminal.

    Parameters
    ----------
    discount : float
        In [0, 1). Default: 0.95.

    Returns
    -------
    OrdinalMDP
        Its levels, worst first, are: at sea < the treasures by their value.

    Raises
    ------
    ImportError
        Without the package.
    RuntimeError
        If the environment does not move as described.
    ValueError
        If the discount is out of range.

    Notes
    -----
    The package gives two rewards, -1 for each step and the treasure's value. The levels keep the
    order of both. A reached treasure counts for ever, so that another step means a greater share at
    sea and a smaller share at the treasure. Two numeric rewards need weights that say how many
    steps a better treasure is worth. With levels the tutor says it.

    References
    ----------
    Vamplew, Dazeley, Berry, Issabekov and Dekker, "Empirical evaluation methods for multiobjective
    reinforcement learning algorithms", Machine Learning 84 (2011); the map of Yang, Sun and
    Narasimhan (2019).
    """
    env = _make("mo_gymnasium", "deep-sea-treasure-v0")
    moves = _moves(env)
    cells = sorted(moves)
    number = {cell: i for i, cell in enumerate(cells)}
    value = np.array([float(env.sea_map[cell]) for cell in cells])
    treasures = np.unique(value[value != _SEA])
    level = np.searchsorted(treasures, value, side="right")
    successors = np.array([[[number[to]] for to in moves[cell]] for cell in cells])
    start = np.zeros(len(cells))
    start[number[_cell(env.reset(seed=0)[0])]] = 1.0
    return OrdinalMDP(
        successors,
        np.ones(successors.shape),
        np.repeat(level[:, None], _ACTIONS, axis=1),
        discount,
        ("at sea", *(f"treasure {treasure:g}" for treasure in treasures)),
        initial=start,
        terminal=value != _SEA,
    )


def _moves(env: Any) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Return each action's next cell, for every cell that can be reached."""
    moves: dict[tuple[int, int], list[tuple[int, int]]] = {}
    waiting = [_cell(env.reset(seed=0)[0])]
    while waiting:
        cell = waiting.pop()
        if cell in moves:
            continue
        moves[cell] = [cell] * _ACTIONS
        if env.sea_map[cell] != _SEA:
            continue
        for a in range(_ACTIONS):
            env.current_state = np.array(cell, dtype=np.int32)
            observed, reward, ended, cut, _ = env.step(a)
            to = moves[cell][a] = _cell(observed)
            if ended != (env.sea_map[to] != _SEA) or cut or reward[1] != -1:
                raise RuntimeError(
                    f"action {a} in cell {cell} of deep-sea-treasure gives {reward} and ended = "
                    f"{ended}, which is not "
                    "what mo-gymnasium 1.3 does: install that version"
                )
            waiting.append(to)
    return moves


def _cell(observed: Any) -> tuple[int, int]:
    return int(observed[0]), int(observed[1])


def _make(package: str, name: str, **settings: Any) -> Any:
    """Return the environment without its wrappers."""
    os.environ.setdefault(
        "PYGAME_HIDE_SUPPORT_PROMPT", "1"
    )  # or its import prints an advertisement
    try:
        module: Any = __import__(package)
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in (package, "gymnasium", "pygame"):
            raise
        raise ImportError(
            f"{error.name} is not installed: pip install 'elicit-qlearn[gym]'"
        ) from None
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # about the precision of observation spaces, which nothing here reads
        return module.make(name, **settings).unwrapped
