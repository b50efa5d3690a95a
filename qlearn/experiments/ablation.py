"""The comparator ablation: comparators x learners x tutors x problems x seeds, every cell with the same random numbers.

A seed fixes the MDP, the hidden values, the learner's exploration and transitions, the tutor's errors and the
resamples of the comparator, so that runs of one seed differ by what is compared and nothing else. Any run can be
rebuilt by hand with that ``seed``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from operator import methodcaller
from pathlib import Path
from typing import Any

import pandas as pd

from qlearn.experiments.metrics import CELL, summarise
from qlearn.experiments.parallel import Cell, Interrupted
from qlearn.experiments.run import Run, in_order, run, run_all, run_named
from qlearn.experiments.settings import AblationSettings

__all__ = ["AblationSettings", "Interrupted", "Run", "ablate", "plan_of", "run", "summarise"]

KEYS = (*CELL, "seed")
AUDITED = ("polytope", "relaxed")  # to a statistical model a surprising answer is no contradiction


def ablate(
    settings: AblationSettings | None = None,
    *,
    jobs: int | None = None,
    journal: Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **changes: Any,
) -> pd.DataFrame:
    """Run every cell and return one row a run, in the order of ``KEYS``, with the seconds it took in the last column.

    ``changes`` are fields of ``AblationSettings`` by name, in place of those of ``settings`` (default: the defaults).

    What the names of problems, learners and comparators stand for is said by ``run.PROBLEMS``, ``run.LEARNERS`` and
    ``run.COMPARATORS``; "posterior-close" is for Q-learning alone. ``audit`` > 0 adds a second, audited run to each
    cell of the polytope, which only so notices an error; "relaxed", which differs from it only where answers contradict
    each other, then has no other. "always" with a truthful tutor is always run: it is the oracle that the others are
    paired with, all but the audited ones, which are shorter (their paired columns are nan).

    The rows do not depend on ``jobs`` (processes; None: as an outer ``joblib.parallel_config`` says, a Dask cluster
    say, else one a core), nor on whether a run is read from ``journal``, the file in which finished runs are kept and
    looked up; only the seconds do. There a run counts as the same while its settings, the sources of both packages and
    the versions of the libraries that compute are the same; ``fresh`` empties the journal. ``progress`` is
    called with (runs finished, runs in all). Raises ValueError for a setting that cannot be, TypeError for one that
    there is not, and as ``run_all`` does.
    """
    settings = replace(settings or AblationSettings(), **changes)
    size = settings.named("states", "actions", "levels", "discount")
    shown = methodcaller("drop", columns="paper_abs_percent")
    how: dict[str, Any] = {"jobs": jobs, "journal": journal, "fresh": fresh, "progress": progress}
    return run_all(run_named, plan_of(settings), size, settings, shown, **how)


def plan_of(settings: AblationSettings) -> list[Cell]:
    """The cells, one dict of ``KEYS`` a run, in the order of the table."""
    tutors = {("always", 0.0, 0.0)}
    for comparator, rate in product(settings.comparators, settings.error_rates):
        if not (settings.audit and comparator == "relaxed"):
            tutors.add((comparator, rate, 0.0))
        if settings.audit and comparator in AUDITED:
            tutors.add((comparator, rate, settings.audit))
    seeds = range(settings.seed, settings.seed + settings.seeds)
    plan = [
        dict(zip(KEYS, (problem, learner, *tutor, seed), strict=True))
        for problem, learner, tutor, seed in product({*settings.problems}, {*settings.learners}, tutors, seeds)
        if not (learner == "ivi" and tutor[0] == "posterior-close")  # it has its indifference from the tolerance
    ]
    return in_order(plan, KEYS)
