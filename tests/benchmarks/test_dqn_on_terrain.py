"""The runs of a network on the terrain, with a small learner in place of the network."""

import pandas as pd
import pytest

from benchmarks.training import dqn_on_terrain
from benchmarks.training.terrain import DISCOUNT, Terrain, TileCoded
from qlearn import OrdinalReward


@pytest.fixture(scope="module")
def runs():
    terrain = Terrain(dqn_on_terrain.TERRAIN)

    def trained(values, steps, seed):
        learner = TileCoded(terrain, seed=seed, samples=steps)
        return learner.train(values), OrdinalReward(terrain, values, discount=DISCOUNT)

    return dqn_on_terrain.table(300, range(3), trained, episodes=2)


def test_each_seed_has_every_policy_and_the_chosen_one_is_its_last(runs):
    assert [*runs["seed"].unique()] == [0, 1, 2]
    for _, run in runs.groupby("seed"):
        assert [*run["policy"].iloc[:3]] == ["equal gaps", "true values", "on the way"]
        assert [*run["policy"]].count("by questions") == 1
        assert run["policy"].iloc[-1] == "by questions"
        assert run["asked"].is_monotonic_increasing
    assert runs.groupby("seed")["worth"].first().nunique() > 1


def test_means_have_intervals_from_two_seeds_on(runs):
    means = dqn_on_terrain.means(runs)
    assert [*means.index] == ["equal gaps", "true values", "by questions"]
    last = runs[runs["policy"] == "by questions"]
    assert means["questions"]["by questions"].startswith(f"{last['asked'].mean():.1f} ± ")
    assert means["worth (%)"]["by questions"].startswith(f"{100 * last['worth'].mean():.1f} ± ")
    ways = (runs["policy"] == "on the way").sum() / 3
    assert means["trainings"]["by questions"].startswith(f"{ways:.1f}")
    one = dqn_on_terrain.means(runs[runs["seed"] == 0])
    assert not one.map(lambda cell: "±" in cell).to_numpy().any()


def test_the_command_counts_its_seeds(tmp_path, monkeypatch, capsys):
    found = pd.DataFrame({"seed": [0], "policy": ["equal gaps"], "asked": [0], "worth": [0.5]})
    asked = []

    def table(steps, seeds):
        asked.append((steps, [*seeds]))
        return found

    monkeypatch.setattr(dqn_on_terrain, "table", table)
    out = tmp_path / "dqn.csv"
    dqn_on_terrain.main(["--steps", "10", "--seeds", "3", "--out", str(out)])
    assert asked == [(10, [0, 1, 2])]
    assert pd.read_csv(out).equals(found)
    assert "50.0" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        dqn_on_terrain.main(["--seeds", "0", "--out", str(out)])
    assert "--seeds must be at least 1" in capsys.readouterr().err
