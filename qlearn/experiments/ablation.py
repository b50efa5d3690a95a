"""The comparator ablation: comparators x learners x tutors x problems x seeds, every cell with the same random numbers.

A seed fixes the MDP, the hidden values, the learner's exploration and transitions, the tutor's errors and the
resamples of the comparator, so that runs of one seed differ by what is compared and nothing else. Any run can be
rebuilt by hand with that seed as ``rng`` and ``seed``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from qlearn.experiments.metrics import CELL, paper_loss, summarise
from qlearn.experiments.run import Cell, Interrupted, Run, Size, instance, run, run_all, run_named

__all__ = ["Interrupted", "Run", "ablate", "cells", "run", "summarise"]

KEYS = (*CELL, "seed")
ORDER: dict[str, tuple[str, ...]] = {
    "problem": ("random", "icu", "frozen-lake", "deep-sea-treasure"),
    "learner": ("q-learning", "ivi"),
    "comparator": ("always", "polytope", "relaxed", "posterior", "posterior-close", "ensemble", "box"),
}

AUDITED = ("polytope", "relaxed")  # to a statistical model a surprising answer is no contradiction
_SLOW = {"box": 5.0, "ensemble": 4.0, "always": 3.0, "posterior": 2.0, "posterior-close": 2.0}  # roughly; others 1


def ablate(
    *,
    problems: Sequence[str] = ("random", "icu"),
    learners: Sequence[str] = ORDER["learner"],
    comparators: Sequence[str] = ORDER["comparator"],
    error_rates: Sequence[float] = (0.0, 0.05, 0.15),
    audit: float = 0.05,
    seeds: int = 4,
    seed: int = 0,
    states: int = 100,
    actions: int = 5,
    levels: int = 10,
    discount: float = 0.95,
    jobs: int | None = None,
    journal: Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> pd.DataFrame:
    """Run every cell and return one row a run, sorted, with the seconds it took in the last column.

    ``problems`` "random" (``random_mdp`` of ``states``, ``actions``, ``levels``, ``discount``), "icu"
    (``icu_sepsis``), "frozen-lake" and "deep-sea-treasure" (``qlearn.gym_environments``), the last three with hidden
    values from ``draw_values``; ``learners`` "q-learning" and "ivi"; ``comparators``
    "always" (asks about everything), "polytope", "relaxed" (the polytope with slack), "posterior", "posterior-close"
    (Q-learning alone: with an indifference of ``close``), "ensemble" and "box" (Bradley-Terry). An ``error_rate`` of 0
    is a truthful tutor. ``audit`` > 0 adds a second, audited run to each cell of the polytope, which only so notices an
    error; "relaxed", which differs from it only where answers contradict each other, then has no other.
    ``seeds`` consecutive seeds from ``seed``. ``settings`` are the keywords of ``run``. "always" with a
    truthful tutor is always run: it is the oracle that the others are paired with, all but the audited ones,
    which are shorter (their paired columns are nan).

    The rows do not depend on ``jobs`` (processes; None: as an outer ``joblib.parallel_config`` says, a Dask cluster
    say, else one a core), nor on whether a run is read from ``journal``, the file in which finished runs are kept and
    looked up; only the seconds do. There a run counts as the same while its settings, the sources of both packages and
    the versions of the libraries that compute are the same; ``fresh`` empties the journal. ``progress`` is
    called with (runs finished, runs in all). Raises ValueError for unknown names, ImportError without the package of
    a problem, Interrupted on Ctrl-C, and as ``sweep`` does.
    """
    plan = cells(problems, learners, comparators, error_rates, audit, range(seed, seed + seeds))
    size = (states, actions, levels, discount)
    for problem in {cell["problem"] for cell in plan}:
        instance(problem, seed, size)  # what is wrong with a problem is said before the runs
    return run_all(
        run_named,
        plan,
        lambda rows: _paired(rows, size),
        shared={"size": size},
        settings=settings,
        journal=journal,
        fresh=fresh,
        jobs=jobs,
        cost=_cost,
        progress=progress,
    )


def cells(
    problems: Iterable[str],
    learners: Iterable[str],
    comparators: Iterable[str],
    error_rates: Sequence[float],
    audit: float,
    seeds: Sequence[int],
) -> list[Cell]:
    """The sweep, one dict of ``KEYS`` a run: the oracles first, then the rest in the order of the table."""
    chosen = {"problem": set(problems), "learner": set(learners), "comparator": set(comparators)}
    for name, given in chosen.items():
        unknown = given - set(ORDER[name])
        if unknown:
            raise ValueError(f"there is no {name} {sorted(unknown)[0]!r}; choose among {', '.join(ORDER[name])}")
    bad = [rate for rate in error_rates if not 0 <= rate < 0.5]
    if bad:
        raise ValueError(f"an error rate must be at least 0 and below 1/2, not {bad[0]!r}")
    tutors = {("always", 0.0, 0.0)}
    for comparator in chosen["comparator"]:
        for rate in error_rates:
            if not (audit and comparator == "relaxed"):
                tutors.add((comparator, float(rate), 0.0))
            if audit and comparator in AUDITED:
                tutors.add((comparator, float(rate), float(audit)))
    plan = [
        dict(zip(KEYS, (problem, learner, *tutor, seed), strict=True))
        for problem in chosen["problem"]
        for learner in chosen["learner"]
        for tutor in tutors
        for seed in seeds
        if not (learner == "ivi" and tutor[0] == "posterior-close")  # it has its indifference from the tolerance
    ]
    return sorted(plan, key=lambda cell: (not _is_oracle(cell), _place(cell)))


def _cost(cell: Cell) -> float:
    """The oracles first, which the others are paired with, should the sweep be interrupted; then what takes long."""
    if _is_oracle(cell):
        return math.inf
    return _SLOW.get(cell["comparator"], 1.0) * (2.0 if cell["error_rate"] else 1.0) / (10.0 if cell["audit"] else 1.0)


def _paired(results: Iterable[Any], size: Size) -> pd.DataFrame:
    """The table of the runs that have finished, each beside the oracle of its problem, learner and seed."""
    runs = [Run(row, np.array(v)) for row, v in filter(None, results)]
    oracles = {_group(run.row): run for run in runs if _is_oracle(run.row)}
    rows: list[Cell] = []
    for row, v in sorted(runs, key=lambda run: _group(run.row)):  # each problem is made once
        oracle = None if row["audit"] else oracles.get(_group(row))  # audited runs are shorter than the oracle
        mdp, values = instance(row["problem"], row["seed"], size)
        nothing = float("nan")
        rows.append(
            row
            | {
                "paper_loss_percent": paper_loss(mdp, v, oracle.v, values) if oracle else nothing,
                "excess_loss": row["loss"] - oracle.row["loss"] if oracle else nothing,
                "excess_loss_initial": row["loss_initial"] - oracle.row["loss_initial"] if oracle else nothing,
                "seconds": row["seconds"],
            }
        )
    rows.sort(key=_place)
    frame = pd.DataFrame(rows)
    return frame[[*(c for c in frame.columns if c != "seconds"), "seconds"]] if rows else frame


def _is_oracle(cell: Cell) -> bool:
    return bool(cell["comparator"] == "always" and cell["error_rate"] == 0)


def _group(cell: Cell) -> tuple[Any, ...]:
    return cell["problem"], cell["seed"], cell["learner"]


def _place(cell: Cell) -> tuple[Any, ...]:
    """Where a run stands in the table."""
    return tuple(ORDER[key].index(cell[key]) if key in ORDER else cell[key] for key in KEYS)
