"""An OrdinalMDP's arrays from an environment that carries its tables, in the form of Gymnasium's toy texts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

Node: TypeAlias = tuple[int, int]
"""A state of the new MDP: the environment's state (or _END), and the level counted there (_ANY: the action's)."""

_END, _ANY = -1, -1


def read(
    env: Any,
    discount: float,
    levels: Mapping[float, str] | Sequence[float] | None,
    labels: Sequence[str] | None,
    initial: ArrayLike | None,
    after: float,
) -> dict[str, Any]:
    """The arguments of ``OrdinalMDP``; ``OrdinalMDP.from_environment`` says which."""
    inner = getattr(env, "unwrapped", env)
    table = _table(inner)
    ends = any(step[3] for actions in table for outcomes in actions for step in outcomes)
    rewards = {step[2] for actions in table for outcomes in actions for step in outcomes}
    level_of, names = _scale(levels, labels, rewards | ({float(after)} if ends else set()))
    if initial is None:
        initial = getattr(inner, "initial_state_distrib", None)
    single = all(len({level_of[step[2]] for step in outcomes}) == 1 for actions in table for outcomes in actions)
    nodes = _by_action(table, ends) if single else _by_arrival(table, level_of, level_of.get(float(after), _ANY))
    return _arrays(table, nodes, level_of, float(after), single, initial) | {"discount": discount, "labels": names}


Table: TypeAlias = list[list[list[tuple[float, int, float, bool]]]]


def _table(inner: Any) -> Table:
    """P[s][a] as lists, checked."""
    given = getattr(inner, "P", None)
    if given is None:
        raise TypeError(
            f"{type(inner).__name__} carries no tables: env.unwrapped.P[s][a] must list (probability, next state, "
            "reward, terminated); for another environment build an OrdinalMDP from arrays"
        )
    table = []
    for s in range(len(given)):
        actions = []
        for a in range(len(given[s])):
            outcomes = [(float(p), int(t), float(r), bool(ended)) for p, t, r, ended in given[s][a] if p != 0]
            if not outcomes:
                raise ValueError(f"P[{s}][{a}] lists no next state of positive probability")
            wrong = next((t for _, t, _, _ in outcomes if not 0 <= t < len(given)), None)
            if wrong is not None:
                raise ValueError(f"P[{s}][{a}] leads to state {wrong}, but there are {len(given)}")
            actions.append(outcomes)
        if not actions:
            raise ValueError(f"P[{s}] has no action")
        table.append(actions)
    return table


def _scale(
    levels: Mapping[float, str] | Sequence[float] | None, labels: Sequence[str] | None, rewards: set[float]
) -> tuple[dict[float, int], tuple[str, ...]]:
    """The level of each reward, and the levels' names, worst first."""
    if isinstance(levels, Mapping):
        names = tuple(labels) if labels is not None else tuple(dict.fromkeys(levels.values()))
        stray = next((name for name in levels.values() if name not in names), None)
        if stray is not None:
            raise ValueError(f"levels maps to {stray!r}, which is not among the labels {names}")
        level_of = {float(reward): names.index(name) for reward, name in levels.items()}
    else:
        order = sorted(rewards) if levels is None else [float(reward) for reward in levels]
        names = tuple(f"reward {reward:g}" for reward in order) if labels is None else tuple(labels)
        if len(names) != len(order):
            raise ValueError(f"labels must name {len(order)} levels, one for each of the rewards {order}, not {names}")
        level_of = {reward: level for level, reward in enumerate(order)}
        if len(level_of) != len(order):
            raise ValueError(f"levels must list each reward once, worst first, not {order}")
    missing = sorted(rewards - set(level_of))
    if missing:
        raise ValueError(
            f"no level for the rewards {missing}: levels must name every reward, that of the time after the end "
            "(after=) included"
        )
    return level_of, names


def _by_action(table: Table, ends: bool) -> list[Node]:
    """The environment's states, then the end if there is one: levels are those of the actions."""
    return [(s, _ANY) for s in range(len(table))] + ([(_END, _ANY)] if ends else [])


def _by_arrival(table: Table, level_of: dict[float, int], after: int) -> list[Node]:
    """The environment's states with the lowest level they are entered with, then with each further level; then
    the end, entered with each level."""
    entered: dict[int, set[int]] = {s: set() for s in range(len(table))}
    ended: set[int] = set()
    for actions in table:
        for outcomes in actions:
            for _, t, reward, over in outcomes:
                (ended if over else entered[t]).add(level_of[reward])
    first: list[Node] = [(s, min(entered[s], default=max(after, 0))) for s in range(len(table))]
    more = [(s, level) for s in range(len(table)) for level in sorted(entered[s])[1:]]
    return first + more + [(_END, level) for level in sorted(ended - {after})] + ([(_END, after)] if ended else [])


def _arrays(
    table: Table, nodes: list[Node], level_of: dict[float, int], after: float, single: bool, initial: ArrayLike | None
) -> dict[str, Any]:
    """The arrays of the MDP over these nodes."""
    number = {node: i for i, node in enumerate(nodes)}
    end = len(nodes) - 1 if nodes[-1][0] == _END else None
    n, m = len(nodes), max(len(actions) for actions in table)
    b = max(len(outcomes) for actions in table for outcomes in actions)
    successors, probabilities = np.zeros((n, m, b), dtype=np.int32), np.zeros((n, m, b))
    levels, admissible = np.zeros((n, m), dtype=np.int32), np.zeros((n, m), dtype=np.bool_)
    for i, (s, level) in enumerate(nodes):
        if s == _END:
            admissible[i] = True
            levels[i] = level_of[after] if i == end else level
            successors[i], probabilities[i, :, 0] = n - 1, 1.0
            continue
        for a, outcomes in enumerate(table[s]):
            admissible[i, a] = True
            levels[i, a] = level_of[outcomes[0][2]] if single else level
            for j, (p, t, reward, over) in enumerate(outcomes):
                arrival = _ANY if single else level_of[reward]
                successors[i, a, j] = number[(_END if over else t, arrival)]
                probabilities[i, a, j] = p
    start = None
    if initial is not None or n > len(table):
        given = np.full(len(table), 1 / len(table)) if initial is None else np.asarray(initial, dtype=np.float64)
        if given.shape != (len(table),):
            raise ValueError(f"initial must have shape ({len(table)},), one entry a state, not {given.shape}")
        start = np.concatenate([given, np.zeros(n - len(table))])
    return {
        "successors": successors,
        "probabilities": probabilities,
        "levels": levels,
        "initial": start,
        "terminal": None if end is None else np.arange(n) == end,
        "admissible": admissible,
    }
