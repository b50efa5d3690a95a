"""The runs behind notebook 08: Stable-Baselines3's DQN on the terrain, by a guess, by the true
values, and by questions.

    python -m benchmarks.training.dqn_on_terrain --seeds 5 --out notebooks/data/dqn_terrain.csv

A seed takes two to three minutes, and the extra sb3 is needed. The terrain and the hidden values
are the same for all seeds: a seed is that of the network and its exploration.

One row a policy: the seed, how the policy came about, the values (five) that it was trained on, its
shares at the five outcomes, measured in walks of its own, what it is worth under the hidden values,
and how many questions came before. The command prints means over the seeds with 95% t-intervals.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.reporting import with_interval
from benchmarks.stamps import sign
from benchmarks.training.terrain import DISCOUNT, OUTCOMES, Terrain
from elicit import PolytopeComparator, TruthfulTutor
from elicit.model.scale import Floats, normalise
from qlearn import InteractiveTraining, OrdinalReward, draw_values, rollout_shares

TERRAIN = 5
"""The seed of the terrain and of the hidden values."""
ON_THE_WAY = "on the way"
"""The name of the policies that are trained between questions."""
Training = Callable[[Floats, int, int], tuple[Any, Any]]
"""A function from values, steps and a seed to a model and its environment."""


def trained(values: Floats, steps: int, seed: int) -> tuple[Any, Any]:
    """Return a model trained from nothing on these values, and its environment."""
    import torch
    from stable_baselines3 import DQN

    torch.set_num_threads(1)
    env = OrdinalReward(Terrain(TERRAIN), values, discount=DISCOUNT)
    settings: dict[str, Any] = {
        "learning_rate": 1e-3,
        "buffer_size": steps,
        "exploration_fraction": 0.5,
    }
    return DQN(
        "MlpPolicy", env, gamma=DISCOUNT, seed=seed, target_update_interval=500, **settings
    ).learn(steps), env


def rows(steps: int, seed: int, train: Training, episodes: int = 200) -> list[dict[str, Any]]:
    """Return all policies of one seed.

    Those by questions are in the order of their trainings, the chosen one last.
    """
    hidden = draw_values(5, seed=TERRAIN)
    e, found = normalise(hidden), []

    def row(name: str, values: Floats, shares: Floats, asked: int) -> dict[str, Any]:
        spent = {
            f"share of {outcome}": share for outcome, share in zip(OUTCOMES, shares, strict=True)
        }
        scale = {
            f"value of {outcome}": value for outcome, value in zip(OUTCOMES, values, strict=True)
        }
        about = {"seed": seed, "policy": name, "asked": asked}
        return {**about, **scale, **spent, "worth": float(shares @ e)}

    def measured(model: Any, env: Any, walks: int) -> Any:
        return rollout_shares(env, model, episodes=episodes, seed=walks)

    for name, values in (("equal gaps", np.linspace(0, 1, 5)), ("true values", e)):
        found.append(row(name, values, measured(*train(values, steps, seed), walks=1).shares, 0))
    training = InteractiveTraining(PolytopeComparator(5), discount=DISCOUNT, labels=OUTCOMES)
    tutor = TruthfulTutor(hidden)
    while not training.finished:
        if (scale := training.to_train()) is not None:
            model, env = train(scale, steps, seed)
            training.add((model, env, scale), measured(model, env, walks=0))
            found.append(
                row(
                    ON_THE_WAY,
                    scale,
                    training.result().policies[-1].shares,
                    training.result().asked,
                )
            )
        training.tell([tutor(query) for query in training.ask()])
    result = training.result()
    model, env, scale = result.policy
    found.append(row("by questions", scale, measured(model, env, walks=1).shares, result.asked))
    return found


def table(
    steps: int, seeds: Iterable[int], train: Training = trained, episodes: int = 200
) -> pd.DataFrame:
    """Return the policies of all seeds."""
    found = [row for seed in seeds for row in rows(steps, seed, train, episodes)]
    return pd.DataFrame(found).round(4)


def means(frame: pd.DataFrame) -> pd.DataFrame:
    """Return means over the seeds with 95% t-intervals, which a single seed does not have.

    The rows are the final policies: shares and worth in percent, questions and trainings.
    """
    ways = frame[frame["policy"] == ON_THE_WAY].groupby("seed").size()
    digits, found = int(frame["seed"].nunique() > 1), {}
    for name, part in frame[frame["policy"] != ON_THE_WAY].groupby("policy", sort=False):
        shares = part.filter(like="share of ").rename(columns=lambda x: x.removeprefix("share of "))
        cells = {outcome: with_interval(100 * x, 1) for outcome, x in shares.items()}
        cells["worth (%)"] = with_interval(100 * part["worth"], 1)
        cells["questions"] = with_interval(part["asked"], digits)
        asks = part["asked"].any()
        cells["trainings"] = with_interval(ways[part["seed"]], digits) if asks else "1"
        found[name] = cells
    return pd.DataFrame(found).T.rename_axis("policy")


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.training.dqn_on_terrain", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument(
        "--steps", type=int, default=20_000, help="of each training (default: 20000)"
    )
    parser.add_argument("--seeds", type=int, default=1, help="of the network (default: 1)")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    if given.seeds < 1:
        parser.error("--seeds must be at least 1")
    found = table(given.steps, range(given.seeds))
    found.to_csv(given.out, index=False)
    sign(given.out, f"{TERRAIN} of the terrain, 0 to {given.seeds - 1} of the network")
    print(means(found).to_string())


if __name__ == "__main__":
    main()
