"""FrozenLake and deep-sea-treasure, held to their packages by stepping them."""

import builtins
import os
import warnings
from collections import Counter
from typing import Any

import numpy as np
import pytest

from elicit import PolytopeComparator, TruthfulTutor
from qlearn import InteractiveValueIteration, drive, policy_loss
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
        assert (
            env.unwrapped.desc.ravel()[following]
            in {0: b"H", 1: b"SF", 2: b"G"}[int(mdp.levels[following, 0])]
        )
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


@pytest.mark.parametrize("make", [frozen_lake, deep_sea_treasure])
def test_they_can_be_learned_by_asking(make: Any) -> None:
    mdp = make()
    values = np.arange(mdp.k) ** 2.0
    result = drive(
        InteractiveValueIteration(mdp, PolytopeComparator(mdp.k), tolerance=0.002),
        TruthfulTutor(values),
    )
    assert policy_loss(mdp, result.policy, values).max() <= 0.002
    assert 0 < result.asked < 200


@pytest.mark.parametrize(
    ("make", "package"),
    [
        (frozen_lake, "gymnasium"),
        (deep_sea_treasure, "mo_gymnasium"),
        (deep_sea_treasure, "pygame"),
    ],
)
def test_a_missing_package_is_named(
    make: Any, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name in ("gymnasium", "mo_gymnasium"):
            raise ModuleNotFoundError(f"No module named {package!r}", name=package)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(
        ImportError, match=rf"{package} is not installed: pip install 'elicit-qlearn\[gym\]'"
    ):
        make()
