"""Certify first on large models: questions, seconds, memory, the bound, beside a scalar solver that
knows the values.

    python -m benchmarks.asking.certify_at_scale [--states 1000 10000 100000] [--seeds 5] [--grids
    0.99 0.999]
        [--huge] [--out FILE]

Each run has a process and one thread of its own. Seconds are CPU seconds of ours from the making of
the learner to its result, so that a busy machine leaves them comparable; those of "values known"
are of solvers of the problem with the true scale, k times smaller, once, to the same tolerance
(``benchmarks.learning.scalar_solvers``): our own modified policy iteration, QuantEcon's and
pymdptoolbox's value iteration, where they are installed. "Ratio" is to the fastest of them in the
same run. ``--huge`` adds a million states, one run.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.learning.scalar_solvers import SOLVERS
from benchmarks.own_process import Failed, apart, memory
from benchmarks.reporting import machine, markdown, publish, with_interval
from elicit import PolytopeComparator, TruthfulTutor
from elicit.model.scale import Floats
from qlearn import (
    InteractivePolicyIteration,
    OrdinalMDP,
    draw_values,
    drive,
    policy_loss,
    random_mdp,
)

TOLERANCE, ACTIONS, LEVELS, SIDE, HUGE = 5e-4, 5, 10, 100, 1_000_000
KNOWING = (
    "qlearn, modified policy iteration",
    "QuantEcon, modified policy iteration",
    "pymdptoolbox, value iteration",
)
HEAD = (
    "states",
    "discount",
    "runs",
    "seconds",
    *(f"values known: {name}" for name in KNOWING),
    "ratio",
)
HEAD += ("questions", "solutions")
HEAD += ("loss bound", "true loss", "valid", "peak memory, GiB")
Run = dict[str, Any]


def grid(side: int, discount: float, seed: int) -> tuple[OrdinalMDP, Floats]:
    """A grid of side * side cells, each of a random level: stay, or step to a neighbour, which goes
    off to one side or the other once in ten each; and hidden values (k,)."""
    cells, rng = np.arange(side * side), np.random.default_rng(seed)
    row, column = np.divmod(cells, side)
    ways = ((0, 0), (-1, 0), (0, 1), (1, 0), (0, -1))
    here, *round_about = (
        np.clip(row + i, 0, side - 1) * side + np.clip(column + j, 0, side - 1) for i, j in ways
    )
    stay = np.stack([here, here, here], axis=1)
    steps = [
        np.stack([round_about[(way + turn) % 4] for turn in (0, 1, 3)], axis=1) for way in range(4)
    ]
    successors = np.stack([stay, *steps], axis=1)
    probabilities = np.broadcast_to([0.8, 0.1, 0.1], successors.shape)
    levels = np.repeat(rng.integers(LEVELS, size=(len(cells), 1)), 5, axis=1)
    names = tuple(f"level {i + 1}" for i in range(LEVELS))
    return OrdinalMDP(successors, probabilities, levels, discount, names), draw_values(LEVELS, seed)


def run(kind: str, states: int, discount: float, seed: int) -> Run:
    """One problem, in this process."""
    small, small_values = random_mdp(300, ACTIONS, LEVELS, seed=seed)
    certified(small, small_values, False)  # compiles what is to be compiled
    if kind == "grid":
        mdp, values = grid(round(states**0.5), discount, seed)
    else:
        mdp, values = random_mdp(states, ACTIONS, LEVELS, discount, seed=seed)
    mdp.fingerprint, mdp.transitions  # noqa: B018 (made once, whoever needs them)
    found = certified(mdp, values, None)
    found |= {"peak": memory("VmHWM") / 2**30, "known": {}}
    for name in KNOWING:
        if not (solver := SOLVERS[name]).missing:
            solver.solve(small, small_values, TOLERANCE)  # compiles what is to be compiled
            found["known"][name] = solver.solve(mdp, values, TOLERANCE).cpu
    found["loss"] = float(policy_loss(mdp, found.pop("policy"), values, 1e-8).max())
    return found


def certified(mdp: OrdinalMDP, values: Floats, exact: bool | None) -> Run:
    """What certify first takes with a truthful tutor."""
    start = process_time()
    comparator = PolytopeComparator(mdp.k)
    learner = InteractivePolicyIteration(mdp, comparator, tolerance=TOLERANCE, exact=exact)
    result = drive(learner, TruthfulTutor(values))
    found = {"seconds": process_time() - start, "asked": result.asked, "solutions": result.rounds}
    return found | {
        "policy": result.policy,
        "bound": result.loss_bound,
        "status": result.status.name,
    }


def row(kind: str, states: int, discount: float, seeds: int, limit: float) -> list[str]:
    """One line of the table: means over seeds 1, 2, ..., with 95% intervals, and the worst of what
    must hold.
    """
    runs, failures = [], []
    for seed in range(1, seeds + 1):
        try:
            runs.append(apart(run, kind, states, discount, seed, limit=limit))
        except Failed as failure:
            failures.append(str(failure))
    name = f"{states:,}" + (f" ({SIDE} x {SIDE} grid)" if kind == "grid" else "")
    head = [name, f"{discount:g}", str(len(runs))]
    if not runs:
        return [*head, *failures[:1], *[""] * (len(HEAD) - 4)]
    fields = [field for field in runs[0] if field not in ("status", "known")]
    each = {field: np.array([found[field] for found in runs]) for field in fields}
    least = np.array([min(found["known"].values()) for found in runs])
    known = [[found["known"][name] for found in runs if name in found["known"]] for name in KNOWING]
    valid = (each["loss"] <= each["bound"] + 1e-8) & (each["bound"] <= TOLERANCE)
    return [
        *head,
        with_interval(each["seconds"], 1),
        *(with_interval(seconds, 3) if seconds else "not installed" for seconds in known),
        f"{np.median(each['seconds'] / least):.0f}",
        f"{with_interval(each['asked'], 1)}, at most {each['asked'].max()}",
        with_interval(each["solutions"], 1),
        f"{each['bound'].max():.1e}",
        f"{each['loss'].max():.1e}",
        f"{valid.sum()} of {len(runs)}" + "".join(f"; {failure}" for failure in failures),
        f"{each['peak'].max():.2f}",
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the report; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.asking.certify_at_scale", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--states", type=int, nargs="*", default=[1000, 10_000, 100_000])
    parser.add_argument("--grids", type=float, nargs="*", default=[0.99, 0.999], help="discounts")
    parser.add_argument("--seeds", type=int, default=5, help="runs of each")
    parser.add_argument("--huge", action="store_true", help="a million states too, once")
    parser.add_argument("--limit", type=float, default=3600.0, help="seconds a run may take")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    problems = [("random", n, 0.95, given.seeds) for n in given.states]
    problems += [("random", HUGE, 0.95, 1)] * given.huge
    problems += [("grid", SIDE * SIDE, discount, given.seeds) for discount in given.grids]
    rows = [row(*problem, given.limit) for problem in problems]
    intro = (
        f"{ACTIONS} actions, {LEVELS} levels, tolerance {TOLERANCE:g} of the value range at every "
        "state, a truthful "
        "tutor, the polytope. Means of runs with seeds 1, 2, ..., and 95% intervals; of the bound "
        "and the true loss "
        'the greatest. "Valid": the true loss is within the bound, and the bound within the '
        'tolerance. "Ratio": the '
        "median of seconds over those of the fastest that is told the values, which wins by so "
        "much. The other "
        "learners, and growth with levels and answers: [how it grows](RESULTS-growth.md)."
    )
    head = [
        "# Certify first as models grow",
        "",
        machine("one thread a run, CPU seconds"),
        "",
        intro,
    ]
    publish([head, markdown(HEAD, rows, 1)], given.out, f"1-{given.seeds}")


if __name__ == "__main__":
    main()
