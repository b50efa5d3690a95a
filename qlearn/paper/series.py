"""The paper's figures 2, 3 and 4: its two series of random MDPs, over seeds that all comparators share.

The paper's comparator (the box, with its footnote 3 and without) and the posterior are put to a tutor who errs as in
eq. (6), the polytope to one who never does, for it takes every answer as a fact. Beside them runs the oracle, which
always asks a truthful tutor. All of one seed meet the same transitions (uniform exploration), so that they differ by
verdicts alone.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from qlearn.experiments.metrics import paper_loss
from qlearn.experiments.run import Cell, Interrupted, Run, Size, instance, run_all, run_named

__all__ = ["COMPARATORS", "KEYS", "ORDER", "SETTINGS", "Interrupted", "cells", "figures", "run_one"]

KEYS = ("states", "levels", "comparator", "error_rate", "seed")
COMPARATORS = ("polytope", "posterior", "box-rescaled", "box")
SETTINGS: dict[str, Any] = {"noise": "logistic", "max_queries": None, "n_boot": 50, "refit_growth": 0.2}
"""Where a run differs from those of the ablation: a tutor as in eq. (6); no budget, or it would be what figures 2 and
3 show; 50 resamples, fitted anew whenever the answers have grown by a fifth."""

ORDER = ("always", *COMPARATORS)
_SLOW = {"box": 8.0, "box-rescaled": 3.0, "posterior": 3.0}  # roughly; others 1


def figures(
    *,
    levels: Sequence[int] = (5, 10, 15, 20, 25),
    at_states: int = 100,
    states: Sequence[int] = (100, 200, 300, 400, 500),
    at_levels: int = 20,
    actions: int = 5,
    discount: float = 0.95,
    comparators: Sequence[str] = COMPARATORS,
    error_rate: float = 0.1,
    both_tutors: bool = False,
    seeds: int = 20,
    seed: int = 0,
    jobs: int | None = None,
    journal: Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> pd.DataFrame:
    """Run both series and return one row a run, in order, with the seconds it took in the last column.

    The first series has ``levels`` k with ``at_states`` states, the second ``states`` with ``at_levels`` levels; a
    problem in both is run once. ``comparators`` among ``COMPARATORS``. ``error_rate`` is that of the
    tutor of all but the polytope: his precision is set so that he errs in that share of the comparisons of an
    optimal policy's actions with the others that dominance leaves open (``metrics.reference_differences``); 0 is a
    truthful tutor. ``both_tutors`` puts them to a truthful tutor too. ``settings`` are keywords of ``runs.run``,
    where not given those of ``SETTINGS``. The oracle always runs.

    Beside the columns of a run: ``warnings`` (how often a comparator warned that it is not to be relied on: particles
    that are worth too few draws, a fit that found no maximum), ``asked_percent_fresh`` (questions in percent of the
    pairs left open that had not been asked before), ``paper_loss_percent`` (figure 4's formula, signed as printed,
    against the oracle), ``paper_abs_percent`` (the same with |v(s) - V(s)|, which cannot cancel out) and
    ``excess_loss`` (true policy loss beyond the oracle's, mean over the states, share of the value range).

    Rows depend neither on ``jobs`` nor on what came from the ``journal``; these, ``fresh``, ``progress`` and
    what is raised are as with ``ablation.ablate``.
    """
    series = {(at_states, k) for k in levels} | {(n, at_levels) for n in states}
    plan = cells(series, comparators, error_rate, both_tutors, range(seed, seed + seeds))
    return run_all(
        run_one,
        plan,
        lambda rows: _paired(rows, actions, discount),
        shared={"actions": actions, "discount": discount},
        settings=SETTINGS | settings,
        journal=journal,
        fresh=fresh,
        jobs=jobs,
        cost=_cost,
        progress=progress,
    )


def cells(
    sizes: Iterable[tuple[int, int]],
    comparators: Sequence[str],
    error_rate: float,
    both_tutors: bool,
    seeds: Sequence[int],
) -> list[Cell]:
    """One dict a run: what ``runs.run`` calls a cell, with the numbers of ``states`` and ``levels``. Oracles first."""
    unknown = sorted(set(comparators) - set(COMPARATORS))
    if unknown:
        raise ValueError(f"there is no comparator {unknown[0]!r} in the figures; choose among {', '.join(COMPARATORS)}")
    if not 0 <= error_rate < 0.5:
        raise ValueError(f"the error rate must be at least 0 and below 1/2, not {error_rate!r}")
    arms = {("always", 0.0)}
    for name in comparators:
        if name == "polytope" or both_tutors:
            arms.add((name, 0.0))
        if name != "polytope":
            arms.add((name, float(error_rate)))
    plan = [
        {
            "problem": "random",
            "learner": "q-learning",
            "audit": 0.0,
            **dict(zip(KEYS, (n, k, comparator, rate, seed), strict=True)),
        }
        for n, k in sorted(set(sizes))
        for comparator, rate in arms
        for seed in seeds
    ]
    return sorted(plan, key=lambda cell: (cell["comparator"] != "always", _place(cell)))


def run_one(cell: Cell, actions: int, discount: float, built: str, settings: dict[str, Any]) -> Run:
    """One run, by a worker that makes the problem itself; its warnings are counted in the row. Raises as
    ``runs.run_named``."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        row, v = run_named(cell, (cell["states"], actions, cell["levels"], discount), built, settings)
    return Run(row | {"warnings": len(caught)}, v)


def _cost(cell: Cell) -> float:
    if cell["comparator"] == "always":
        return math.inf
    return float(_SLOW.get(cell["comparator"], 1.0) * cell["levels"] * (1 + cell["states"] / 500))


def _paired(results: Iterable[Any], actions: int, discount: float) -> pd.DataFrame:
    """The table of the runs that have finished, each beside the oracle of its problem."""
    runs = [Run(row, np.array(v)) for row, v in filter(None, results)]
    oracles = {_problem(run.row): run for run in runs if run.row["comparator"] == "always"}
    rows: list[Cell] = []
    for row, v in sorted(runs, key=lambda run: _problem(run.row)):  # each problem is made once
        size: Size = (row["states"], actions, row["levels"], discount)
        mdp, values = instance("random", row["seed"], size)
        fresh = row["compared"] - row["equal"] - row["dominance"] - row["known"]
        oracle = oracles.get(_problem(row))
        best = float(values[mdp.levels[mdp.admissible]].max())
        far = float(100 * np.mean(np.abs(v - oracle.v)) / best) if oracle else math.nan
        rows.append(
            {name: value for name, value in row.items() if name not in ("problem", "learner", "audit", "seconds")}
            | {
                "asked_percent_fresh": 100 * row["asked"] / fresh if fresh else math.nan,
                "paper_loss_percent": paper_loss(mdp, v, oracle.v, values) if oracle else math.nan,
                "paper_abs_percent": far,
                "excess_loss": row["loss"] - oracle.row["loss"] if oracle else math.nan,
                "seconds": row["seconds"],
            }
        )
    rows.sort(key=_place)
    frame = pd.DataFrame(rows)
    return frame[[*KEYS, *(name for name in frame.columns if name not in KEYS)]] if rows else frame


def _problem(cell: Cell) -> tuple[int, int, int]:
    return cell["states"], cell["levels"], cell["seed"]


def _place(cell: Cell) -> tuple[Any, ...]:
    """Where a run stands in the table."""
    return cell["states"], cell["levels"], ORDER.index(cell["comparator"]), cell["error_rate"], cell["seed"]
