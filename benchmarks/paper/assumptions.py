"""What the paper does not state, one choice at a time: how much each moves the questions and losses of its comparator.

python -m benchmarks.paper.assumptions --out docs/assumptions.md      twenty minutes on one quiet core
python -m benchmarks.paper.assumptions --quick                        seconds; rough figures
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.reporting import save, with_interval
from elicit import AlwaysAsk, BradleyTerryComparator, BradleyTerryTutor, TruthfulTutor
from elicit.model.scale import Floats
from qlearn import InteractiveQLearning, drive, policy_loss, random_mdp
from qlearn.experiments.metrics import (
    counts,
    estimated_values,
    greatest_reward,
    paper_loss,
    reference_differences,
)
from qlearn.learners.exploration import Exploration, Start
from qlearn.learners.q_learning import LearningRate, polynomial_rate

MEASURES = ("asked_percent_all", "asked_percent_open", "paper_loss", "excess_loss", "oracle_loss")
HEAD = """\
# What the paper leaves open, and what it does

The paper's comparator (Bradley-Terry, box) in interactive Q-learning on random MDPs with {states} states, 5 actions and
{levels} levels, {steps:,} steps, {seeds} seeds. The first line is the default of `qlearn figures`; every other line
changes one choice and gives the **difference** from it, paired by seed, with its 95% t-interval.
Written by `python -m benchmarks.paper.assumptions --steps {steps} --seeds {seeds}`.

- **% of all**, **% of open**: questions in percent of all comparisons, and of those that dominance leaves open.
- **formula**: figure 4's percentage, signed as printed, against always asking a truthful tutor with the same settings.
- **excess loss**: true policy loss beyond that oracle's; **oracle's loss**: its own; in percent of the value range.
"""


@dataclass(frozen=True)
class Choice:
    """The settings of a run."""

    learning_rate: LearningRate | None = None
    epsilon: float = 1.0
    start: Start = "worst"
    error_rate: float = 0.1
    weights: Literal["dirichlet", "gaussian"] = "dirichlet"
    box: Mapping[str, Any] = field(default_factory=dict)


def choices(base: Choice = Choice()) -> dict[str, Choice]:
    """The default, and every other choice by name."""

    def boxed(**settings: Any) -> Choice:
        return replace(base, box={**base.box, **settings})

    return {
        "default": base,
        "learning rate .1": replace(base, learning_rate=0.1),
        "learning rate 1 / (1 + visits)^.7": replace(base, learning_rate=polynomial_rate),
        "epsilon .1": replace(base, epsilon=0.1),
        "epsilon .5": replace(base, epsilon=0.5),
        "start at zero (line 4)": replace(base, start="zero"),
        "start at the best level": replace(base, start="best"),
        "tutor never errs": replace(base, error_rate=0.0),
        "tutor errs in 2%": replace(base, error_rate=0.02),
        "tutor errs in 30%": replace(base, error_rate=0.3),
        "m = 20": boxed(n_boot=20),
        "m = 100": boxed(n_boot=100),
        "level .8": boxed(level=0.8),
        "level .99": boxed(level=0.99),
        "footnote 3 (rescale)": boxed(rescale=True),
        "literal fit (not monotone)": boxed(monotone=False),
        "weaker prior (.03)": boxed(prior_strength=0.03),
        "fits at 5% more answers": boxed(refit_growth=0.05),
        "transition weights gaussian": replace(base, weights="gaussian"),
    }


def measure(choice: Choice, states: int, levels: int, steps: int, seed: int) -> Floats:
    """One run and its oracle's: ``MEASURES``."""
    mdp, values = random_mdp(states, 5, levels, rng=seed, weights=choice.weights)
    truth = TruthfulTutor(values)
    noisy = BradleyTerryTutor.from_error_rate
    reference = reference_differences(mdp, values)
    tutor = noisy(values, choice.error_rate, reference, seed) if choice.error_rate else truth
    settings = {"n_boot": 50, "refit_growth": 0.2, "precision": 300.0} | dict(choice.box)
    box = BradleyTerryComparator(levels, region="box", seed=seed, **settings)
    exploration = Exploration(choice.epsilon, start=choice.start)
    common: Any = {"steps": steps, "rng": seed, "learning_rate": choice.learning_rate, "epsilon": exploration}
    oracle = drive(InteractiveQLearning(mdp, AlwaysAsk(levels), **common), truth)
    found = drive(InteractiveQLearning(mdp, box, **common), tutor)
    told = counts(found)
    v, best = (estimated_values(mdp, result.q, values) for result in (found, oracle))
    loss, least = (float(policy_loss(mdp, result.policy, values).mean()) for result in (found, oracle))
    shares = [told["asked_percent_all"], told["asked_percent_open"]]
    formula = paper_loss(v, best, greatest_reward(mdp, values))
    return np.array([*shares, formula, 100 * (loss - least), 100 * least])


def report(states: int, levels: int, steps: int, seeds: int, say: Callable[[str], None]) -> list[str]:
    """The lines of the table, each also said as it is there."""
    lines = [
        "| choice | % of all | % of open | formula | excess loss | oracle's loss |",
        "|---|---|---|---|---|---|",
    ]
    say("\n" + "\n".join(lines))
    default: Floats | None = None
    for name, choice in choices().items():
        found = np.array([measure(choice, states, levels, steps, seed) for seed in range(seeds)])
        shown = found if default is None else found - default
        digits = (1, 1, 2, 2, 2)
        cells = [with_interval(column, n, default is not None) for column, n in zip(shown.T, digits, strict=True)]
        default = found if default is None else default
        lines.append(f"| {name} | {' | '.join(cells)} |")
        say(lines[-1])
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.paper.assumptions", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="a tiny setting (seconds)")
    parser.add_argument("--out", type=Path, help="also write the report to this file")
    parser.add_argument("--steps", type=int, default=100_000, help="steps of Q-learning (default: the paper's 1e5)")
    parser.add_argument("--seeds", type=int, default=4, help="number of seeds (default: 4)")
    chosen = parser.parse_args(arguments)
    size = (12, 4, 300, 2) if chosen.quick else (100, 10, chosen.steps, chosen.seeds)
    head = HEAD.format(**dict(zip(("states", "levels", "steps", "seeds"), size, strict=True))).splitlines()
    with threadpool_limits(1):
        print("\n".join(head))
        lines = [*head, "", *report(*size, say=lambda line: print(line, flush=True)), ""]
    save("\n".join(lines), chosen.out, f"0-{size[-1] - 1}")


if __name__ == "__main__":
    main()
