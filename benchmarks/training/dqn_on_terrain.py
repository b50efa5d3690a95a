"""The run behind notebook 08: Stable-Baselines3's DQN on the terrain, by a guess, by the true
values, and by questions.

    python -m benchmarks.training.dqn_on_terrain --out notebooks/data/dqn_terrain.csv     minutes;
    needs the extra sb3

One row a policy: how it came about, the values (five) that it was trained on, its shares at the
five outcomes, measured in walks of its own, what it is worth under the hidden values, and how many
questions and trainings came before.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.stamps import sign
from benchmarks.training.terrain import DISCOUNT, OUTCOMES, Terrain
from elicit import PolytopeComparator, TruthfulTutor
from elicit.model.scale import Floats, normalise
from qlearn import InteractiveTraining, OrdinalReward, draw_values, rollout_shares

SEED = 5


def trained(values: Floats, steps: int) -> tuple[Any, Any]:
    """A model trained from nothing on these values, and its environment."""
    import torch
    from stable_baselines3 import DQN

    torch.set_num_threads(1)
    env = OrdinalReward(Terrain(SEED), values, discount=DISCOUNT)
    settings: dict[str, Any] = {
        "learning_rate": 1e-3,
        "buffer_size": steps,
        "exploration_fraction": 0.5,
    }
    return DQN(
        "MlpPolicy", env, gamma=DISCOUNT, seed=0, target_update_interval=500, **settings
    ).learn(steps), env


def rows(steps: int) -> list[dict[str, Any]]:
    """All policies, those by questions in the order of their trainings, the chosen one last."""
    hidden = draw_values(5, seed=SEED)
    e, found = normalise(hidden), []

    def row(name: str, values: Floats, shares: Floats, asked: int) -> dict[str, Any]:
        spent = {
            f"share of {outcome}": share for outcome, share in zip(OUTCOMES, shares, strict=True)
        }
        scale = {
            f"value of {outcome}": value for outcome, value in zip(OUTCOMES, values, strict=True)
        }
        return {"policy": name, "asked": asked, **scale, **spent, "worth": float(shares @ e)}

    def measured(model: Any, env: Any, seed: int) -> Any:
        return rollout_shares(env, model, episodes=200, seed=seed)

    for name, values in (("equal gaps", np.linspace(0, 1, 5)), ("true values", e)):
        found.append(row(name, values, measured(*trained(values, steps), seed=1).shares, 0))
    training = InteractiveTraining(PolytopeComparator(5), discount=DISCOUNT, labels=OUTCOMES)
    tutor = TruthfulTutor(hidden)
    while not training.finished:
        if (scale := training.to_train()) is not None:
            model, env = trained(scale, steps)
            training.add((model, env, scale), measured(model, env, seed=0))
            found.append(
                row(
                    "on the way",
                    scale,
                    training.result().policies[-1].shares,
                    training.result().asked,
                )
            )
        training.tell([tutor(query) for query in training.ask()])
    result = training.result()
    model, env, scale = result.policy
    found.append(row("by questions", scale, measured(model, env, seed=1).shares, result.asked))
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.training.dqn_on_terrain", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument(
        "--steps", type=int, default=20_000, help="of each training (default: 20000)"
    )
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    pd.DataFrame(rows(given.steps)).round(4).to_csv(given.out, index=False)
    sign(given.out, str(SEED))


if __name__ == "__main__":
    main()
