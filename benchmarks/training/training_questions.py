"""Number of questions and trainings that a policy from any trainer costs, and whether bounds hold.

    python -m benchmarks.training.training_questions --out benchmarks/RESULTS-training.md
        # a quarter of an hour
    python -m benchmarks.training.training_questions --problems 2
        # a minute; rough figures

Random MDPs (|S| = 50, |A| = 5, discount .95) and ICU-Sepsis as black boxes that are solved exactly,
or badly on purpose; a terrain in two dimensions with a tile-coded learner; deep-sea-treasure with
hidden weights; and what wrappers cost.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from benchmarks.reporting import machine, markdown, publish, with_interval
from benchmarks.training import black_boxes, terrain
from benchmarks.training.treasure import treasure
from elicit import (
    Comparator,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
    Tutor,
    objectives,
)
from elicit.model.scale import Floats, normalise
from qlearn import (
    InteractiveTraining,
    LevelVector,
    OrdinalMDP,
    OrdinalReward,
    Status,
    draw_values,
    random_mdp,
)
from qlearn.problems.families.catalogue import FAMILIES
from qlearn.problems.icu_sepsis import icu_sepsis

COSTLY = ("rover", "surgery", "career")  # families in which a wrong guess costs most

ERROR = 0.1
Problem = Callable[[int], tuple[OrdinalMDP, Floats]]


class Run(NamedTuple):
    """The result of one problem.

    ``equal`` is the loss of training on equal gaps. ``short`` is the most by which a training ended
    below its optimum, if that is known.
    """

    asked: int
    trained: int
    loss: float
    bound: float
    status: Status
    gap: float
    equal: float
    short: float = np.nan


def black_box(
    problem: Problem, seed: int, truthful: bool = True, poor: bool = False, gap: float | None = 0.0
) -> Run:
    """A tabular problem, its loss from where episodes start."""
    mdp, values = problem(seed)
    comparator: Comparator = (
        PolytopeComparator(mdp.k) if truthful else PosteriorComparator(mdp.k, seed=seed)
    )
    tutor: Tutor = TruthfulTutor(values) if truthful else FlippingTutor(values, ERROR, seed=seed)
    train = black_boxes.poor(mdp, seed) if poor else black_boxes.exact(mdp)
    training = InteractiveTraining(
        comparator, discount=mdp.discount, tolerance=0.01, optimality_gap=gap
    )
    result = black_boxes.run(training, mdp, train, tutor)
    loss = black_boxes.loss_of(mdp, result, values)
    even = black_boxes.exact(mdp)(np.linspace(0, 1, mdp.k))
    best = float(result.shares @ normalise(values)) + loss
    equal = best - float(black_boxes.shares_of(mdp, even) @ normalise(values))
    scales = [(policy.trained_on, policy.shares) for policy in result.policies]
    short = max(
        float((black_boxes.shares_of(mdp, black_boxes.exact(mdp)(w)) - x) @ w) for w, x in scales
    )
    bound, seen = result.loss_bound, result.observed_gap
    return Run(result.asked, result.trained, loss, bound, result.status, seen, equal, short)


def on_terrain(seed: int) -> Run:
    """The terrain, its loss against the same learner trained on the true values, by 20,000
    walks.
    """
    place = terrain.Terrain(seed)
    learner, values = terrain.TileCoded(place, seed), draw_values(5, seed=seed)
    training = InteractiveTraining(PolytopeComparator(5), discount=terrain.DISCOUNT, tolerance=0.01)
    tutor = TruthfulTutor(values)
    while not training.finished:
        if (scale := training.to_train()) is not None:
            policy = learner.train(scale)
            training.add(policy, place.shares(policy))
        training.tell([tutor(query) for query in training.ask()])
    result, e = training.result(), normalise(values)
    true, found, even = (
        float(place.shares(policy, 20_000, 1) @ e)
        for policy in (learner.train(e), result.policy, learner.train(np.linspace(0, 1, 5)))
    )
    bound, gap = result.loss_bound, result.observed_gap
    return Run(result.asked, result.trained, true - found, bound, result.status, gap, true - even)


def for_treasure(seed: int) -> Run:
    """Deep-sea-treasure with weights drawn uniformly."""
    problem, weights = treasure(), np.random.default_rng(seed).dirichlet([1.0, 1.0])
    box, tutor = (np.zeros(2), np.ones(2)), TruthfulTutor(objectives.values(weights))
    training = InteractiveTraining(
        PolytopeComparator(3), discount=0.95, optimality_gap=0.0, objectives=box
    )
    while not training.finished:
        if (values := training.to_train()) is not None:
            policy = problem.train(objectives.weights(values))
            training.add(policy, objectives.as_levels(problem.objectives(policy)))
        training.tell([tutor(query) for query in training.ask()])
    result = training.result()
    best, found, even = (
        float(problem.objectives(policy) @ weights)
        for policy in (problem.train(weights), result.policy, problem.train(np.array([0.5, 0.5])))
    )
    bound, gap = result.loss_bound, result.observed_gap
    return Run(result.asked, result.trained, best - found, bound, result.status, gap, best - even)


def line(name: str, runs: Sequence[Run]) -> list[str]:
    """One row of the table: counts with intervals, losses in percent."""
    loss, bound = np.array([run.loss for run in runs]), np.array([run.bound for run in runs])
    known, equal = np.isfinite(bound), 100 * np.array([run.equal for run in runs])
    kept = (
        f"{100 * np.mean(loss[known] <= bound[known] + 1e-9):.1f}% of {known.sum()}"
        if known.any()
        else "none given"
    )
    ends = {run.status.name for run in runs}
    cells = [
        name,
        str(len(runs)),
        with_interval([run.asked for run in runs], 1),
        str(max(run.asked for run in runs)),
    ]
    cells += [
        with_interval([run.trained for run in runs], 1),
        with_interval(100 * loss, 2),
        f"{100 * loss.max():.2f}",
    ]
    return [
        *cells,
        kept,
        f"{equal.mean():.1f}, {equal.max():.1f}",
        ", ".join(sorted(ends)).lower().replace("_", " "),
    ]


def kinds(problems: int) -> dict[str, Callable[[], list[Run]]]:
    """Return the measurements of each row of the first table, by the row's name."""
    icu = icu_sepsis()

    def clinic(seed: int) -> tuple[OrdinalMDP, Floats]:
        return icu, draw_values(icu.k, seed=seed)

    return {
        "random MDP, k = 5, truthful": lambda: [black_box(paper(5), s) for s in range(problems)],
        "random MDP, k = 5, 10% flips": lambda: [
            black_box(paper(5), s, truthful=False) for s in range(3 * problems)
        ],
        "random MDP, k = 10, truthful": lambda: [black_box(paper(10), s) for s in range(problems)],
        **{f"{name}, truthful": partial(_on_family, name, problems) for name in COSTLY},
        "ICU-Sepsis, truthful": lambda: [black_box(clinic, s) for s in range(min(problems, 5))],
        "terrain, tile-coded, truthful": lambda: [on_terrain(s) for s in range(min(problems, 12))],
        "deep-sea-treasure, hidden weights": lambda: [for_treasure(s) for s in range(problems)],
    }


def _on_family(name: str, problems: int) -> list[Run]:
    def drawn(seed: int) -> tuple[OrdinalMDP, Floats]:
        mdp = FAMILIES[name](seed)
        return mdp, draw_values(mdp.k, seed=seed)

    return [black_box(drawn, seed) for seed in range(problems)]


def paper(k: int) -> Problem:
    """The paper's random MDPs, of half its states."""
    return lambda seed: random_mdp(50, 5, k, seed=seed)


STATED = (None, 0.0, 0.3, 0.4)


def broken(gap: float | None, runs: Sequence[Run]) -> list[str]:
    """One row of the table of the poor trainer."""
    seen, true = [run.gap for run in runs], [run.short for run in runs]
    finite = [run for run in runs if np.isfinite(run.bound)]
    cells = ["none" if gap is None else f"{gap:g}", _ends(runs)]
    cells += [f"{np.mean(each):.3f}, {max(each):.3f}" for each in (seen, true)]
    for kept in (True, False):
        some = [run.short <= (gap or 0.0) for run in finite if (run.loss <= run.bound) == kept]
        cells.append(f"{sum(some)} ({len(some) - sum(some)})")
    return [*cells[:4], str(len(finite)), *cells[4:]]


HEAD = (
    "problem",
    "runs",
    "questions",
    "most",
    "trainings",
    "loss %",
    "worst",
    "bound kept",
    "asked nothing",
    "ends",
)


def costs(repeats: int = 9, steps: int = 20_000) -> Iterator[list[str]]:
    """Steps a second of environments, alone and wrapped, in turns: the median of the ratios."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in ("CartPole-v1", "MountainCar-v0"):
            ratios = [_ratio(name, steps) for _ in range(repeats)]
            scale, vector = np.median(ratios, axis=0)
            yield [name, f"{100 * scale:.0f}%", f"{100 * vector:.0f}%"]


def _ratio(name: str, steps: int) -> tuple[float, float]:
    wrapped: tuple[Callable[[Any], Any], ...] = (
        lambda env: env,
        lambda env: OrdinalReward(env, [0.0, 1.0, 2.0], _side, 0, discount=0.99),
        lambda env: LevelVector(env, 3, _side, 0, discount=0.99),
    )
    raw, scale, vector = (_seconds(wrap(gym.make(name)), steps) for wrap in wrapped)
    return raw / scale, raw / vector


def _side(observation: Any, reward: Any, info: Any) -> int:
    return 1 if observation[0] > 0 else 0


def _seconds(env: Any, steps: int) -> float:
    env.reset(seed=0)
    start = perf_counter()
    for i in range(steps):
        if any(env.step(i % 2)[2:4]):
            env.reset()
    return perf_counter() - start


def report(problems: int) -> Iterator[list[str]]:
    """The parts of the report, as they come."""
    yield ["# Training by few questions", "", machine()]
    yield [
        "Tolerance 1% of the value range. Means with 95% t-intervals, and the greatest. *Loss*: in "
        "percent of the "
        "value range, from where episodes start; of the terrain against the same learner trained "
        "on the true "
        "values (below 0: better than that, by chance). *Bound kept*: of the runs with a finite "
        "bound, those that "
        "lose no more. *Asked nothing*: what training on the guess of equal gaps (objectives: "
        "equal weights) "
        "loses, on average and at most. *Ends*: the statuses. Exact trainings state a gap of 0; "
        "the tile-coded "
        "learner states none, so that there is no bound."
    ]
    yield markdown(HEAD, [line(name, runs()) for name, runs in kinds(problems).items()], 1)
    yield [
        "## A trainer made poor on purpose",
        "",
        "It solves the random MDP and then forgets half of its states, others each time.",
    ]
    rows = [
        broken(gap, [black_box(paper(5), s, poor=True, gap=gap) for s in range(problems)])
        for gap in STATED
    ]
    yield [
        *markdown(
            ("gap stated", "ends", "gap seen", "true gap", "finite bounds", "kept", "not kept"),
            rows,
            1,
        ),
        "",
        "Gaps: mean, and the greatest. *Kept* and *not kept*: of the runs with a finite bound in "
        "which the stated gap "
        "held, and (in brackets) of those in which it did not hold and no later policy showed it.",
    ]
    yield [
        "## What wrappers cost",
        "",
        "Steps a second in share of the raw environment's (`gymnasium.make`), the level from a "
        "function; measured in "
        "turns, the median of nine.",
    ]
    yield markdown(("environment", "OrdinalReward", "LevelVector"), list(costs()), 1)


def _ends(runs: Sequence[Run]) -> str:
    names = [run.status.name.lower().replace("_", " ") for run in runs]
    return ", ".join(f"{names.count(name)} {name}" for name in sorted(set(names)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the report; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.training.training_questions", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--problems", type=int, default=20, help="of each kind (default: 20)")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    publish(
        report(given.problems),
        given.out,
        f"0-{given.problems - 1}, 0-{3 * given.problems - 1} where the tutor errs",
    )


if __name__ == "__main__":
    main()
