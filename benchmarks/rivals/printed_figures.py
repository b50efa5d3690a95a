"""Compare rewritten rivals of the contest with figures and theorems that others print.

    python -m benchmarks.rivals.printed_figures --out benchmarks/RESULTS-printed-figures.md

It takes some minutes.

Minimax regret: Alizadeh, Osmani and Traversi ("Deterministic Solutions Based on Maximum Regrets in
MDPs with Imprecise Rewards", EGC 2019) solve the problem of Regan and Boutilier (2009) by their
method, constraint generation with integer programs. Their repository has the least greatest regret
of nine diamond MDPs of Benavent and Zanuttini (2018), whose transitions and rewards are given.
They also prove what it is on a "trident". Both are built here from that description.

Policy comparisons: Shao et al. (2023) promise a number of questions that is quasilinear in the
number of objectives. Their theorem is of the order of k ln(k / epsilon).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any
from unittest import mock

import numpy as np

import elicit
from benchmarks.contest import problems
from benchmarks.contest.harness import play
from benchmarks.contest.methods import policy_comparisons
from benchmarks.contest.methods.minimax_regret import MinimaxRegret
from benchmarks.reporting import machine, main_by_seeds, markdown, with_interval
from elicit.model.scale import Floats
from qlearn.experiments.parallel import Cell, sweep
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.problems.random_mdp import random_mdp

TRUTHFUL = problems.TUTORS["truthful"]
DIAMONDS: Mapping[float, float] = {
    0.05: 5013.53947658,
    0.10: 4445.80197961,
    0.15: 3868.16414044,
    0.20: 3373.30043979,
    0.25: 2966.56200126,
    0.30: 2640.23805156,
    0.35: 2401.50961005,
    0.40: 2247.13726172,
    0.45: 2126.70503039,
}
"""Least greatest regret by the chance p of moving left: the sixth column of
github.com/pegahani/Optimization/blob/c7b8287/DATA/results/diamond.txt, its first nine lines."""
STOP = 0.001
"""Their program ends where no rewards show more regret than this part beyond what it prints."""
DISCOUNT = 0.95
REWARDS = ((-600.0, 600.0),) * 4 + ((600.0, 1000.0),)
"""What a reward may be in each of the four middle states, and at the bottom."""
OBJECTIVES = (3, 5, 8, 12)
PRECISIONS = (0.1, 0.01, 0.001)
FIRST = 50


def diamond(p: float) -> OrdinalMDP:
    """Return the diamond MDP: one level for each reward that is not known, level 0 for no reward.

    Action 0 goes to either child with chance 1/2. Action 1 goes left with chance p, action 2 right
    with chance 1 - p, and otherwise each goes back. State 9 is the bottom, state 10 the end.
    """
    q = 1.0 - p
    moves: dict[tuple[int, int], dict[int, float]] = {}
    for s, left, right in ((0, 1, 2), (1, 3, 4), (2, 5, 6)):
        moves[s, 0] = {left: 0.5, right: 0.5}
        moves[s, 1], moves[s, 2] = {left: p, 0: q}, {right: q, 0: p}
    for s, back, left, right in ((3, 1, 8, 7), (4, 1, 7, 8), (5, 2, 7, 8), (6, 2, 8, 7)):
        moves[s, 0] = {7: 0.5, 8: 0.5}
        moves[s, 1], moves[s, 2] = {left: p, back: q}, {right: q, back: p}
    for s, first, second in ((7, 3, 4), (8, 5, 6)):
        moves[s, 0] = {9: 1.0}
        moves[s, 1], moves[s, 2] = {9: p, first: q}, {9: q, second: p}
    moves |= {(s, a): {10: 1.0} for s in (9, 10) for a in range(3)}
    levels = np.zeros((11, 3), dtype=np.int64)
    levels[[3, 4, 5, 6, 9]] = np.arange(1, 16).reshape(5, 3)
    return _model(moves, levels)


def trident(lean: float) -> OrdinalMDP:
    """Return the trident: actions 0 and 1 lead to a state each, action 2 to the second of them with
    chance ``lean``, else to the first. Levels 1 and 2 are the rewards of these states.
    """
    moves = {(0, 0): {1: 1.0}, (0, 1): {2: 1.0}, (0, 2): {1: 1 - lean, 2: lean}}
    moves |= {(s, a): {3: 1.0} for s in (1, 2, 3) for a in range(3)}
    levels = np.zeros((4, 3), dtype=np.int64)
    levels[1], levels[2] = 1, 2
    return _model(moves, levels)


def _model(moves: Mapping[tuple[int, int], Mapping[int, float]], levels: np.ndarray) -> OrdinalMDP:
    """Return the MDP of these moves that begins in state 0 and ends in the last state."""
    n = len(levels)
    successors = np.zeros((n, 3, 2), dtype=np.int64)
    chances = np.zeros((n, 3, 2))
    for (s, a), to in moves.items():
        successors[s, a, : len(to)], chances[s, a, : len(to)] = list(to), list(to.values())
    return OrdinalMDP(
        successors,
        chances,
        levels,
        DISCOUNT,
        [str(level) for level in range(levels.max() + 1)],
        initial=np.eye(n)[0],
        terminal=np.arange(n) == n - 1,
    )


def solved(mdp: OrdinalMDP, rewards: Floats) -> MinimaxRegret:
    """Return the contest's method after it has solved for these vertices (m, k) of rewards.

    Here rewards are in no order and in boxes. The method knows them by the gaps between levels,
    which may be negative; the first level is no reward.
    """
    method = MinimaxRegret("current solution")
    method.start(mdp, TRUTHFUL, 0)
    method._scales.vertices = np.diff(rewards, axis=1)
    method._solve()
    return method


def least_regret(p: float) -> float:
    """Return the least greatest regret on a diamond, in units of its rewards.

    The box of 15 rewards has 2^15 vertices. Of the three rewards of a state only that of the
    adversary's action can be at its upper bound where the regret is greatest: so 4^5 are enough.
    """
    at_most_one_high = (np.zeros(3), *np.eye(3))
    boxes = [[low + (high - low) * up for up in at_most_one_high] for low, high in REWARDS]
    rewards = np.array([np.concatenate([[0.0], *each]) for each in product(*boxes)])
    unit = 1000.0  # so that the method's tolerances are small beside the rewards
    return unit * solved(diamond(p), rewards / unit).regret / (1 - DISCOUNT)


def on_trident(a: float, b: float, lean: float = 0.7) -> tuple[Floats, float]:
    """Return the shares of time at the two rewards, of which the first is within a of 0 and the
    second within a of b, and the regret; both undiscounted.
    """
    rewards = np.array([[0.0, x, b + y] for x in (-a, a) for y in (-a, a)])
    method = solved(trident(lean), rewards)
    size = DISCOUNT * (1 - DISCOUNT)  # of a reward one step after the start
    return method._incumbent[1:] / size, method.regret / size


def proven_on_trident(a: float, b: float) -> tuple[Floats, float]:
    """Return the same by the formula that Alizadeh, Osmani and Traversi prove."""
    shares = np.array([2 * a - b, 2 * a + b]) / (4 * a)
    return shares, a + b + a * shares[0] - (a + b) * shares[1]


def compared(objectives: int, precision: float, seed: int) -> tuple[int, float]:
    """Return how many questions policy comparisons ask until they are done, and the loss then."""
    mdp = random_mdp(20, 4, objectives + 1, seed=seed)[0]
    values = problems.scale(mdp.k, seed)
    tutor = elicit.TruthfulTutor(values)
    with mock.patch.object(policy_comparisons, "PRECISION", precision):
        method = policy_comparisons.PolicyComparisons()
        row = play(method, mdp, values, tutor, TRUTHFUL, 1000, seed)
    return int(row["done"]), float(row["initial"][-1])


def run(cell: Cell) -> Any:
    """Return the regret on a diamond, or what ``compared`` returns."""
    return least_regret(cell["p"]) if "p" in cell else compared(**cell)


def report(seeds: int, **how: Any) -> Iterator[list[str]]:
    """The parts of the page."""
    yield [
        "# Rewritten rivals beside printed figures",
        "",
        machine(),
        "",
        "Two of the contest's rivals of which no public code of their authors was found, beside "
        "what is printed of them. The third, polyhedral questions, has no line here: no figure of "
        "theirs could be read.",
    ]
    settings = list(product(OBJECTIVES, PRECISIONS))
    cells: list[Cell] = [{"p": p} for p in DIAMONDS]
    cells += [
        {"objectives": objectives, "precision": precision, "seed": FIRST + i}
        for objectives, precision in settings
        for i in range(seeds)
    ]
    found = iter(sweep(run, cells, **how))
    regrets = [(p, printed, float(next(found))) for p, printed in DIAMONDS.items()]
    yield [
        "## Minimax regret: nine diamonds",
        "",
        "Least greatest regret from the start, without any question, on the diamond MDPs of "
        "Benavent and Zanuttini (2018): 10 states, 3 actions, a discount of 0.95, and 15 rewards "
        "of which only bounds are known. *Printed*: by Alizadeh, Osmani and Traversi with Regan "
        "and Boutilier's constraint generation (github.com/pegahani/Optimization, "
        f"DATA/results/diamond.txt). It is a lower bound, and ends where at most {100 * STOP:g}% "
        "is missing. *Ours*: the contest's method, linear programs over vertices. So ours should "
        f"be beyond theirs by 0 to {100 * STOP:g}%.",
        "",
        *markdown(
            ("p", "printed", "ours", "beyond"),
            [
                [f"{p:.2f}", f"{printed:.3f}", f"{ours:.3f}", f"{100 * (ours / printed - 1):.4f}%"]
                for p, printed, ours in regrets
            ],
            0,
        ),
    ]
    rows = []
    for b in (0.1, 0.5, 1.0):
        ours, proven = on_trident(1.0, b), proven_on_trident(1.0, b)
        rows.append([f"{b:g}", f"{proven[0][1]:.6f}", f"{ours[0][1]:.6f}"])
        rows[-1] += [f"{proven[1]:.6f}", f"{ours[1]:.6f}"]
    yield [
        "## Minimax regret: the trident",
        "",
        "Two rewards, one in [-1, 1], one in [-1 + B, 1 + B]. The same authors prove that the "
        "policy of least greatest regret gets the second one (2 + B) / 4 of the time.",
        "",
        *markdown(("B", "proven share", "ours", "proven regret", "ours"), rows, 0),
    ]
    rows = []
    for objectives, precision in settings:
        runs = [next(found) for _ in range(seeds)]
        asked, losses = (np.array(column, dtype=np.float64) for column in zip(*runs, strict=True))
        order = objectives * np.log(objectives / precision)
        rows.append([str(objectives), f"{precision:g}", with_interval(asked, 1)])
        rows[-1] += [f"{asked.mean() / order:.2f}", with_interval(100 * losses, 4)]
    yield [
        "## Policy comparisons: the number of questions",
        "",
        "Shao et al. (2023) promise near-optimal policies for a number of questions that is "
        "quasilinear in the number k of objectives. Their theorem is of the order of "
        "k ln(k / epsilon), without a constant; we have it from a public program that tries it, "
        f"not from the paper. Random MDPs with 20 states and 4 actions, {seeds} seeds from "
        f"{FIRST} on, a truthful tutor. Each basis ratio is searched to half an interval of "
        "epsilon. *Ratio*: questions over k ln(k / epsilon), which should not grow. *Loss*: from "
        "the start at the end, in percent of the value range, which should vanish with epsilon.",
        "",
        *markdown(("k", "epsilon", "questions", "ratio", "loss, %"), rows, 0),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    program = "benchmarks.rivals.printed_figures"
    main_by_seeds(program, report, FIRST, ("seeds", 10, "problems a row"), arguments)


if __name__ == "__main__":
    main()
