"""FrozenLake and deep-sea-treasure, held to their packages by stepping them."""

from __future__ import annotations

import builtins
import os
import warnings
from collections import Counter
from typing import Any

import numpy as np
import pytest

from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.tutors.simulated import TruthfulTutor
from qlearn.learners.learner import drive
from qlearn.learners.value_iteration import InteractiveValueIteration
from qlearn.mdp.planning import policy_loss, value_iteration
from qlearn.problems.gymnasium import deep_sea_treasure, frozen_lake

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")


def made(package: str, name: str, **settings: Any) -> Any:
    module = pytest.importorskip(package)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return module.make(name, **settings)


def test_the_lake_is_what_gymnasium_does_when_it_is_stepped() -> None:
    env = made("gymnasium", "FrozenLake-v1", map_name="8x8", is_slippery=True)
    mdp = frozen_lake()
    assert (mdp.n_states, mdp.n_actions, mdp.labels) == (64, 4, ("hole", "ice", "goal"))
    seen: dict[tuple[int, int], Counter[int]] = {}
    state, _ = env.reset(seed=7)
    rng = np.random.default_rng(7)
    for _ in range(20_000):
        assert not mdp.terminal[state]
        a = int(rng.integers(4))
        following, reward, ended, cut, _ = env.step(a)
        seen.setdefault((state, a), Counter())[int(following)] += 1
        assert ended == mdp.terminal[following]
        assert (reward == 1) == (mdp.levels[following, 0] == 2)
        assert env.unwrapped.desc.ravel()[following] in {0: b"H", 1: b"SF", 2: b"G"}[int(mdp.levels[following, 0])]
        state = env.reset()[0] if ended or cut else int(following)
        assert mdp.initial[state] == 1 or not (ended or cut)
    dense = mdp.transitions.toarray().reshape(64, 4, 64)
    for (s, a), counts in seen.items():
        assert set(counts) <= set(np.flatnonzero(dense[s, a]))
        n = sum(counts.values())
        if n >= 100:
            for t in np.flatnonzero(dense[s, a]):
                spread = np.sqrt(dense[s, a, t] * (1 - dense[s, a, t]) / n)
                assert abs(counts[int(t)] / n - dense[s, a, t]) < 5 * spread + 1e-9
    assert len(seen) > 100


def test_the_lake_has_its_known_chance_of_success() -> None:
    """The chance of a good policy to be at the goal by step 200: by the tables, and by stepping."""
    env = made("gymnasium", "FrozenLake-v1", map_name="8x8", is_slippery=True, max_episode_steps=200)
    mdp = frozen_lake(discount=0.999)
    _, policy = value_iteration(mdp, [0, 0.0001, 1])
    chances = mdp.initial.copy()
    dense = mdp.transitions.toarray().reshape(64, 4, 64)[np.arange(64), policy]
    dense[mdp.terminal] = np.eye(64)[mdp.terminal]
    for _ in range(200):
        chances = chances @ dense
    goal = float(chances[63])
    wins, runs = 0, 400
    for seed in range(runs):
        state, _ = env.reset(seed=seed)
        over = False
        while not over:
            state, reward, ended, cut, _ = env.step(int(policy[state]))
            over = ended or cut
            wins += reward == 1
    assert abs(wins / runs - goal) < 4 * np.sqrt(goal * (1 - goal) / runs) + 1e-9
    assert 0.85 < goal < 1


def test_the_submarine_goes_where_mo_gymnasium_takes_it() -> None:
    """Every state and action, each reached through the environment's own reset and steps."""
    env = made("mo_gymnasium", "deep-sea-treasure-v0")
    mdp = deep_sea_treasure()
    start = int(np.flatnonzero(mdp.initial)[0])
    treasures = sorted(float(x) for x in np.unique(env.unwrapped.sea_map) if x > 0)
    assert mdp.labels == ("at sea", *(f"treasure {x:g}" for x in treasures))
    assert (mdp.k, len(treasures)) == (11, 10)
    paths: dict[int, list[int]] = {start: []}
    cells: dict[int, tuple[int, ...]] = {}
    waiting = [start]
    while waiting:
        s = waiting.pop(0)
        for a in range(4):
            observed = env.reset(seed=0)[0]
            for step in paths[s]:
                observed, reward, ended, _, _ = env.step(step)
                assert not ended
            assert cells.setdefault(s, tuple(observed.tolist())) == tuple(observed.tolist())
            observed, reward, ended, cut, _ = env.step(a)
            assert not cut
            t = int(mdp.successors[s, a, 0])
            assert cells.setdefault(t, tuple(observed.tolist())) == tuple(observed.tolist())
            assert bool(mdp.terminal[t]) == ended
            expected = 0 if not ended else 1 + treasures.index(pytest.approx(float(reward[0])))
            assert (mdp.levels[t] == expected).all()
            if not ended and t not in paths:
                paths[t] = [*paths[s], a]
                waiting.append(t)
    assert len(set(cells.values())) == len(cells) == mdp.n_states
    assert (mdp.probabilities == 1).all()


def test_its_best_policies_are_the_packages_front() -> None:
    """Which treasure is best, and after how many steps, over many scales: all on MO-Gymnasium's Pareto front."""
    env = made("mo_gymnasium", "deep-sea-treasure-v0")
    front = {(round(float(value), 4), int(-steps)) for value, steps in env.unwrapped.pareto_front(gamma=1.0)}
    mdp = deep_sea_treasure()
    rng = np.random.default_rng(0)
    found = set()
    for _ in range(40):
        values = np.concatenate([[0.0], np.cumsum(rng.dirichlet(np.full(10, 0.5)))])
        _, policy = value_iteration(mdp, values)
        s, steps = int(np.flatnonzero(mdp.initial)[0]), 0
        while not mdp.terminal[s]:
            s, steps = int(mdp.successors[s, policy[s], 0]), steps + 1
            assert steps < 100
        found.add((float(mdp.labels[mdp.levels[s, 0]].split()[1]), steps))
    assert found <= front
    assert len(found) > 3


@pytest.mark.parametrize("make", [frozen_lake, deep_sea_treasure])
def test_they_can_be_learned_by_asking(make: Any) -> None:
    mdp = make()
    values = np.arange(mdp.k) ** 2.0
    result = drive(InteractiveValueIteration(mdp, PolytopeComparator(mdp.k), tolerance=0.002), TruthfulTutor(values))
    assert policy_loss(mdp, result.policy, values).max() <= 0.002
    assert 0 < result.asked < 200


@pytest.mark.parametrize(
    ("make", "package"),
    [(frozen_lake, "gymnasium"), (deep_sea_treasure, "mo_gymnasium"), (deep_sea_treasure, "pygame")],
)
def test_a_missing_package_is_named(make: Any, package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name in ("gymnasium", "mo_gymnasium"):
            raise ModuleNotFoundError(f"No module named {package!r}", name=package)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=rf"{package} is not installed: pip install 'elicit-qlearn\[gym\]'"):
        make()
