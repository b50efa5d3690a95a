"""An OrdinalMDP's arrays from an environment that has tables, such as Gymnasium's toy texts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from elicit.model.scale import Floats
from qlearn.mdp import array_checks as checks

Node: TypeAlias = tuple[int, int]
"""A state of the new MDP: a state of the environment, and the level that is counted there."""

_END = -1  # in place of a state: an episode has ended
_BY_ACTION = -1  # in place of a level: each action that is taken there has its own


def read(
    env: Any,
    discount: float,
    levels: Mapping[float, str] | Sequence[float] | None,
    labels: Sequence[str] | None,
    initial: ArrayLike | None,
    after: float,
) -> dict[str, Any]:
    """Return the arguments of ``OrdinalMDP``, as ``OrdinalMDP.from_environment`` describes them."""
    inner = getattr(env, "unwrapped", env)
    table = _table(inner)
    ends = any(step[3] for actions in table for outcomes in actions for step in outcomes)
    rewards = {step[2] for actions in table for outcomes in actions for step in outcomes}
    level_of, names = _scale(levels, labels, rewards | ({float(after)} if ends else set()))
    if initial is None:
        initial = getattr(inner, "initial_state_distrib", None)
    single = all(
        len({level_of[step[2]] for step in outcomes}) == 1
        for actions in table
        for outcomes in actions
    )
    arrival = dict.fromkeys(level_of, _BY_ACTION) if single else level_of
    last = level_of.get(float(after), 0)
    nodes = _nodes(table, arrival, _BY_ACTION if single else last)
    arrays = _arrays(table, nodes, level_of, arrival, last)
    return arrays | {
        "initial": _start(len(table), len(nodes), initial),
        "discount": discount,
        "labels": names,
    }


Table: TypeAlias = list[list[list[tuple[float, int, float, bool]]]]


def _table(inner: Any) -> Table:
    """Return the environment's table P[s][a] as lists, after a check."""
    given = getattr(inner, "P", None)
    if given is None:
        raise TypeError(
            f"{type(inner).__name__} carries no tables: env.unwrapped.P[s][a] must list "
            "(probability, next state, "
            "reward, terminated); for another environment build an OrdinalMDP from arrays"
        )
    table = []
    for s in range(len(given)):
        actions = []
        for a in range(len(given[s])):
            outcomes = [
                (float(p), int(t), float(r), bool(ended))
                for p, t, r, ended in given[s][a]
                if p != 0
            ]
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
    levels: Mapping[float, str] | Sequence[float] | None,
    labels: Sequence[str] | None,
    rewards: set[float],
) -> tuple[dict[float, int], tuple[str, ...]]:
    """Return the level of each reward, and the levels' names, worst first."""
    if isinstance(levels, Mapping):
        names = (
            checks.labels(labels) if labels is not None else tuple(dict.fromkeys(levels.values()))
        )
        stray = next((name for name in levels.values() if name not in names), None)
        if stray is not None:
            raise ValueError(f"levels maps to {stray!r}, which is not among the labels {names}")
        level_of = {float(reward): names.index(name) for reward, name in levels.items()}
    else:
        order = sorted(rewards) if levels is None else [float(reward) for reward in levels]
        names = (
            tuple(f"reward {reward:g}" for reward in order)
            if labels is None
            else checks.labels(labels)
        )
        if len(names) != len(order):
            raise ValueError(
                f"labels must name {len(order)} levels, one for each of the rewards {order}, not "
                f"{names}"
            )
        level_of = {reward: level for level, reward in enumerate(order)}
        if len(level_of) != len(order):
            raise ValueError(f"levels must list each reward once, worst first, not {order}")
    missing = sorted(rewards - set(level_of))
    if missing:
        raise ValueError(
            f"no level for the rewards {missing}: levels must name every reward, that of the time "
            "after the end "
            "(after=) included"
        )
    return level_of, names


def _nodes(table: Table, arrival: dict[float, int], after: int) -> list[Node]:
    """Return the MDP's states: pairs of an environment's state and the level on entering it.

    First comes each state with the lowest level on which it can be entered, then each state with
    each of its further levels. The end of an episode follows, with each level on which it can be
    entered. The last pair is the end with the level ``after``, that of all later time.
    """
    entered: dict[int, set[int]] = {s: set() for s in range(len(table))}
    ended: set[int] = set()
    for actions in table:
        for outcomes in actions:
            for _, t, reward, over in outcomes:
                (ended if over else entered[t]).add(arrival[reward])
    first: list[Node] = [(s, min(entered[s], default=after)) for s in range(len(table))]
    more = [(s, level) for s in range(len(table)) for level in sorted(entered[s])[1:]]
    return (
        first
        + more
        + [(_END, level) for level in sorted(ended - {after})]
        + ([(_END, after)] if ended else [])
    )


def _arrays(
    table: Table,
    nodes: list[Node],
    level_of: dict[float, int],
    arrival: dict[float, int],
    after: int,
) -> dict[str, Any]:
    """Return the arrays of an MDP whose states are ``nodes``: pairs of a state and a level.

    ``after`` is the level of the time after the end of an episode.
    """
    number = {node: i for i, node in enumerate(nodes)}
    end = len(nodes) - 1 if nodes[-1][0] == _END else None
    n, m = len(nodes), max(len(actions) for actions in table)
    b = max(len(outcomes) for actions in table for outcomes in actions)
    successors, probabilities = np.zeros((n, m, b), dtype=np.int32), np.zeros((n, m, b))
    levels, admissible = np.zeros((n, m), dtype=np.int32), np.zeros((n, m), dtype=np.bool_)
    for i, (s, level) in enumerate(nodes):
        if s == _END:
            admissible[i] = True
            levels[i] = after if i == end else level
            successors[i], probabilities[i, :, 0] = n - 1, 1.0
            continue
        for a, outcomes in enumerate(table[s]):
            admissible[i, a] = True
            levels[i, a] = level_of[outcomes[0][2]] if level == _BY_ACTION else level
            for j, (p, t, reward, over) in enumerate(outcomes):
                successors[i, a, j] = number[(_END if over else t, arrival[reward])]
                probabilities[i, a, j] = p
    return {
        "successors": successors,
        "probabilities": probabilities,
        "levels": levels,
        "terminal": None if end is None else np.arange(n) == end,
        "admissible": admissible,
    }


def _start(states: int, n: int, initial: ArrayLike | None) -> Floats:
    """Return the initial distribution (n,) over the MDP's n states.

    The first ``states`` of them are the environment's. ``initial`` is the distribution over these.
    Its default is uniform.
    """
    given = (
        np.full(states, 1 / states) if initial is None else np.asarray(initial, dtype=np.float64)
    )
    if given.shape != (states,):
        raise ValueError(
            f"initial must have shape ({states},), one entry a state, not {given.shape}"
        )
    return np.concatenate([given, np.zeros(n - states)])
