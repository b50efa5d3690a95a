"""Policy loss of Q-learning by each way to explore; the tutor is always asked and never errs.

python -m benchmarks.paper.exploration --out docs/exploration.md       about five minutes on one
core
python -m benchmarks.paper.exploration --quick                         seconds; rough figures
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.reporting import save, with_interval
from elicit import AlwaysAsk, PolytopeComparator, TruthfulTutor
from elicit.model.scale import Floats
from qlearn import InteractiveQLearning, OrdinalMDP, drive, policy_loss, random_mdp
from qlearn.experiments.ablation import instance
from qlearn.learners.exploration import EXPLORATIONS, Decay, Exploration

Problem: TypeAlias = Callable[[int], tuple[OrdinalMDP, Floats]]

CHOICES: Mapping[str, Exploration] = MappingProxyType(
    {
        **EXPLORATIONS,
        "constant, zero start": Exploration(0.1, start="zero"),
        "optimistic, decaying": Exploration(Decay(), start="best"),
        "uniform, worst start": replace(EXPLORATIONS["uniform"], start="worst"),
        "uniform, restarts": replace(EXPLORATIONS["uniform"], episode_length=20),
    }
)
HEAD = """\
# Exploration

This page is for readers who choose how Q-learning explores. It has the loss of Q-learning after {steps:,} steps for each way of
exploring. The tutor is always asked and never errs, so that only exploration and learning are measured. The learning rate is the default.
There are {seeds} seeds, each with its own MDP, hidden values and random numbers. Written by `python -m benchmarks.paper.exploration`.

The default of `InteractiveQLearning` is "optimistic". It was chosen from the six tables of the full setting. Of the five ways that
`epsilon=` takes by name ("constant", "decaying", "restarts", "optimistic", "uniform") it is the best, or within the intervals of the
best, in five tables. The sixth is deep-sea-treasure, where episodes may end many steps apart: there uniform exploration loses less.

- **loss**: true policy loss, mean over the states, in percent of the value range; ± half the width of the 95%
  t-interval over the seeds. **at the start**: the same at the initial distribution.
- **questions**: the number of questions that the polytope comparator asks in the same runs. It ended with the same policy as
  always asking in every run, as it must. (The start at zero is an exception: its early questions are ill-posed.) The column is empty
  where the runs take long. In deep-sea-treasure many pairs are nearly equal and learned slowly, so that ever finer questions are asked:
  use an `indifference` there.
"""  # noqa: E501


def measure(
    problem: Problem, choice: Exploration, steps: int, seed: int, ask: bool
) -> tuple[float, float, float]:
    """Loss over the states, loss at the start (both in percent of the value range), and the
    polytope's questions, nan unless ``ask``.

    Raises RuntimeError should the polytope's policy differ from that of always asking.
    """
    mdp, values = problem(seed)
    tutor = TruthfulTutor(values)
    always, *others = (
        drive(InteractiveQLearning(mdp, comparator, epsilon=choice, steps=steps, seed=seed), tutor)
        for comparator in (AlwaysAsk(mdp.k), PolytopeComparator(mdp.k))[: 1 + ask]
    )
    loss = policy_loss(mdp, always.policy, values)
    losses = 100 * float(loss.mean()), 100 * float(mdp.initial @ loss)
    if not others:
        return *losses, float("nan")
    (polytope,) = others
    if choice.start != "zero" and not np.array_equal(always.policy, polytope.policy):
        raise RuntimeError(f"the polytope's policy is not the oracle's: {choice}, seed {seed}")
    return *losses, float(polytope.asked)


def section(title: str, problem: Problem, steps: int, seeds: int, ask: bool) -> list[str]:
    """A table of one problem, a line a choice, in the order of their losses."""
    found = {name: _over(problem, choice, steps, seeds, ask) for name, choice in CHOICES.items()}
    lines = [
        f"## {title}",
        "",
        "| exploration | loss | at the start | questions |",
        "|---|---|---|---|",
    ]
    for name in sorted(found, key=lambda name: found[name][:, 0].mean()):
        loss, start, asked = found[name].T
        lines.append(f"| {name} | {_shown(loss, 2)} | {_shown(start, 2)} | {_shown(asked, 0)} |")
    return [*lines, ""]


def _over(problem: Problem, choice: Exploration, steps: int, seeds: int, ask: bool) -> Floats:
    return np.array([measure(problem, choice, steps, seed, ask) for seed in range(seeds)])


def _shown(x: Floats, digits: int) -> str:
    return "" if np.isnan(x).any() else with_interval(x, digits)


def _random(states: int, k: int) -> tuple[str, Problem]:
    return f"Random MDP, {states} states, 5 actions, {k} levels", lambda seed: random_mdp(
        states, 5, k, seed=seed
    )


def _named(title: str, problem: str) -> tuple[str, Problem]:
    return title, lambda seed: instance(problem, seed, (0, 0, 0, 0.0))


FULL = (
    (*_random(100, 10), True),
    (*_random(100, 20), False),
    (*_random(500, 20), False),
    (*_named("ICU-Sepsis", "icu-sepsis"), False),
    (*_named("FrozenLake 8x8", "frozen-lake"), True),
    (*_named("Deep-sea-treasure", "deep-sea-treasure"), False),
)
QUICK = ((*_random(20, 4), True),)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.paper.exploration", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="a tiny setting (seconds)")
    parser.add_argument("--out", type=Path, help="also write the report to this file")
    chosen = parser.parse_args(arguments)
    steps, seeds = (2_000, 3) if chosen.quick else (100_000, 20)
    lines = [*HEAD.format(steps=steps, seeds=seeds).splitlines(), ""]
    with threadpool_limits(1):
        print("\n".join(lines))
        for title, problem, ask in QUICK if chosen.quick else FULL:
            part = section(title, problem, steps, seeds, ask)
            print("\n".join(part), flush=True)
            lines += part
    save("\n".join(lines), chosen.out, f"0-{seeds - 1}")


if __name__ == "__main__":
    main()
