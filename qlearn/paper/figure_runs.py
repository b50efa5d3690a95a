"""The paper's figures 2, 3 and 4: its two series of random MDPs, over seeds that all comparators share.

The paper's comparator (the box, with its footnote 3 and without) and the posterior are put to a tutor who errs as in
eq. (6), the polytope to one who never does, for it takes every answer as a fact. Beside them runs the oracle, which
always asks a truthful tutor. All of one seed meet the same transitions (uniform exploration), so that they differ by
verdicts alone.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from qlearn.experiments.parallel import Cell
from qlearn.experiments.run import Run, in_order, run_all, run_named
from qlearn.experiments.settings import FiguresSettings

KEYS = ("states", "levels", "comparator", "error_rate", "seed")
_NOT_SHOWN = ["problem", "learner", "audit", "excess_loss_initial"]  # of a run: the same in all, or of no use here


def figures(
    settings: FiguresSettings | None = None,
    *,
    jobs: int | None = None,
    journal: Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **changes: Any,
) -> pd.DataFrame:
    """Run both series and return one row a run, in the order of ``KEYS``, with the seconds it took in the last column.

    ``changes`` are fields of ``FiguresSettings`` by name, in place of those of ``settings`` (default: the defaults).

    A problem in both series is run once. The comparisons by which a tutor's precision is set are those of
    ``metrics.reference_differences``; an ``error_rate`` of 0 is a truthful tutor. The oracle always runs.

    Beside the columns of a run (see ``run_all``): ``warnings`` (how often a comparator warned that it is not to be
    relied on: particles that are worth too few draws, a fit that found no maximum) and ``asked_percent_fresh``
    (questions in percent of the pairs left open that had not been asked before).

    Rows depend neither on ``jobs`` nor on what came from the ``journal``; these, ``fresh``, ``progress`` and
    what is raised are as with ``ablation.ablate``.
    """
    settings = replace(settings or FiguresSettings(), **changes)
    size = settings.named("actions", "discount")
    how: dict[str, Any] = {"jobs": jobs, "journal": journal, "fresh": fresh, "progress": progress}
    return run_all(run_one, plan_of(settings), size, settings, _shown, **how)


def plan_of(settings: FiguresSettings) -> list[Cell]:
    """One dict a run, in the order of the table: what ``run`` calls a cell, with the numbers of states and levels."""
    sizes = {(settings.at_states, k) for k in settings.levels} | {(n, settings.at_levels) for n in settings.states}
    arms = {("always", 0.0)}
    for name in settings.comparators:
        if name == "polytope" or settings.both_tutors:
            arms.add((name, 0.0))
        if name != "polytope":
            arms.add((name, settings.error_rate))
    seeds = range(settings.seed, settings.seed + settings.seeds)
    same = {"problem": "random", "learner": "q-learning", "audit": 0.0}
    plan = [same | dict(zip(KEYS, (*size, *arm, seed), strict=True)) for size, arm, seed in product(sizes, arms, seeds)]
    return in_order(plan, KEYS)


def run_one(cell: Cell, **shared: Any) -> Run:
    """``run_named``, with the number of its warnings in the row."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        done = run_named(cell, **shared)
    return done._replace(row=done.row | {"warnings": len(caught)})


def _shown(frame: pd.DataFrame) -> pd.DataFrame:
    """The columns of the figures."""
    fresh = frame.compared - frame.equal - frame.dominance - frame.known
    place = list(frame.columns).index("paper_loss_percent")
    frame.insert(place, "asked_percent_fresh", 100 * frame.asked / fresh.where(fresh > 0))
    frame = frame.drop(columns=_NOT_SHOWN)
    return frame[[*KEYS, *(name for name in frame.columns if name not in KEYS)]]
