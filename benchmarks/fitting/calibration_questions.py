"""Cost in questions if the posterior is not given how often its tutor answers at random.

    python -m benchmarks.fitting.calibration_questions [--quick] [--out FILE.md] [--jobs N]
    [--levels 10 20]
        [--flips 0 0.1 ...]

Q-learning with uniform exploration and an indifference, no budget, for tutors who flip a share of
their answers: the questions asked with the lapse learned and with the right one told, and the loss
beyond that of always asking.
"""

from __future__ import annotations

import os

from benchmarks.own_process import ONE_THREAD

os.environ |= ONE_THREAD  # read when the libraries load, hence set before they do

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from benchmarks.reporting import machine, markdown, publish, with_interval
from elicit import AlwaysAsk, FlippingTutor, PosteriorComparator, TruthfulTutor
from elicit.model.comparator_parts import lapse_of
from qlearn import InteractiveQLearning, drive, policy_loss, random_mdp

INDIFFERENCE = 0.005


class Size(NamedTuple):
    """Numbers of seeds, steps, states and actions."""

    seeds: int
    steps: int
    states: int
    actions: int


FULL = Size(20, 100_000, 100, 5)
QUICK = Size(2, 2_000, 10, 3)


class Run(NamedTuple):
    """Questions and excess loss, with the lapse learned and told; and the lapse that was
    learned.
    """

    asked: int
    asked_told: int
    loss: float
    loss_told: float
    lapse: float


def run(flips: float, k: int, seed: int, size: Size) -> Run:
    """One problem and tutor, both ways."""
    mdp, values = random_mdp(size.states, size.actions, k, seed=seed)
    asking = InteractiveQLearning(mdp, AlwaysAsk(k), epsilon="uniform", steps=size.steps, seed=seed)
    least = policy_loss(mdp, drive(asking, TruthfulTutor(values)).policy, values).mean()
    asked, losses, learned = [], [], 0.0
    for lapse in (None, 2.0 * flips):
        comparator = PosteriorComparator(k, lapse=lapse, seed=seed)
        learner = InteractiveQLearning(
            mdp,
            comparator,
            epsilon="uniform",
            steps=size.steps,
            seed=seed,
            indifference=INDIFFERENCE,
        )
        result = drive(learner, FlippingTutor(values, flips, seed=seed))
        asked.append(result.asked)
        losses.append(float(policy_loss(mdp, result.policy, values).mean() - least))
        if lapse is None:
            learned = lapse_of(result.comparator)
    return Run(*asked, *losses, learned)


def report(
    size: Size, levels: Sequence[int], flips: Sequence[float], jobs: int
) -> Iterator[list[str]]:
    """The report, part by part."""
    yield [
        "# What an unknown lapse costs in questions",
        "",
        machine("one thread"),
        "",
        f"Q-learning, {size.steps:,} steps, {size.states} states, {size.actions} actions, uniform "
        "exploration, "
        f"indifference {INDIFFERENCE}, {size.seeds} seeds; mean ± half a 95% interval. Ratio: of "
        "the means. Excess "
        "loss: beyond always asking a truthful tutor, mean over states, in thousandths of the "
        "value range.",
    ]
    head = [
        "k",
        "flips",
        "lapse learned",
        "questions, learned",
        "told",
        "ratio",
        "excess loss, learned",
        "told",
    ]
    rows = []
    for k in levels:
        for share in flips:
            runs = Parallel(n_jobs=jobs)(
                delayed(run)(share, k, seed, size) for seed in range(size.seeds)
            )
            asked, told, loss, loss_told, lapse = np.array(runs).T
            rows.append([
                str(k), f"{share:.0%}", with_interval(lapse, 2), with_interval(asked, 0),
                with_interval(told, 0),
                f"{asked.mean() / told.mean():.2f}", with_interval(1e3 * loss, 2),
                with_interval(1e3 * loss_told, 2),
            ])  # fmt: skip
    yield markdown(head, rows, 0)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a tiny setting (seconds)")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md", help="write the report there as well"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes, one thread each")
    parser.add_argument(
        "--levels", type=int, nargs="+", default=[10, 20], help="numbers of levels k"
    )
    parser.add_argument(
        "--flips", type=float, nargs="+", default=[0, 0.05, 0.1, 0.2, 0.3], help="shares of answers"
    )
    chosen = parser.parse_args(arguments)
    size = QUICK if chosen.quick else FULL
    publish(
        report(size, chosen.levels, chosen.flips, chosen.jobs), chosen.out, f"0-{size.seeds - 1}"
    )


if __name__ == "__main__":
    main()
