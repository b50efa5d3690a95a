"""The runs of the paper's figures 2, 3 and 4.

They are its two series of random MDPs, with the same seeds for all comparators.

The paper does not say how precise its tutor was. So the paper's comparator (the box, as it is
and with each resample rescaled) and the posterior meet tutors of several precisions, who err as in
the paper's eq. (6). The polytope meets a tutor who never errs, because it takes every answer as a
fact. The oracle, which always asks a truthful tutor, runs beside them. All runs of a seed see the
same transitions (uniform exploration), so that they differ by verdicts alone.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import fields, replace
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from elicit._support.keywords import check_keywords
from qlearn.experiments.ablation import Run, in_order, instance, of_precision, run_all, run_named
from qlearn.experiments.metrics import reference_differences
from qlearn.experiments.parallel import Cell, SweepOptions
from qlearn.experiments.settings import TRUTHFUL, FiguresSettings

KEYS = ("states", "levels", "comparator", "errs", "seed")
_NOT_SHOWN = [
    "problem",
    "learner",
    "audit",
    "c",
    "loss_unasked",
    "excess_loss_initial",
]  # of a run: the same in all, or of no use here


def figures(
    settings: FiguresSettings | None = None,
    *,
    jobs: int | None = None,
    journal: Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **changes: Any,
) -> pd.DataFrame:
    """Run both series and return a row for each run, in the order of ``KEYS``.

    A problem in both series is run once. The oracle always runs. To save time, precisions between
    the first and the last are run at every other size only. Their slopes are nearly as accurate.

    Parameters
    ----------
    settings : FiguresSettings, optional
        What is run. Default: ``FiguresSettings()``.
    jobs : int, optional
        Number of processes, as in ``ablation.ablate``.
    journal : Path, optional
        The file in which finished runs are kept and looked up. None: no journal.
    fresh : bool
        Empty the journal first. Default: False.
    progress : function, optional
        Called with (runs finished, runs in all).
    **changes
        Fields of ``FiguresSettings`` by name, in place of those of ``settings``.

    Returns
    -------
    pandas.DataFrame
        A row for each run. The last column, ``seconds``, is the time that the run took. All other
        columns depend neither on ``jobs`` nor on what came from the journal.

    Raises
    ------
    ValueError
        For an impossible setting.
    TypeError
        For an unknown setting.
    Interrupted
        On Ctrl-C, with the rows that have finished.

    Notes
    -----
    ``errs`` names the tutor (see ``settings.tutors``). ``error_rate`` is the expected share of
    wrong answers to ``metrics.reference_differences``, by which a tutor's precision is set; it is
    given too if the setting was a precision. ``realised_error_rate`` is the share among the answers
    that were given.

    Two columns are added to those of a run (see ``run_all``). ``warnings`` is how often a
    comparator warned that it is unreliable: particles that are worth too few draws, or a fit
    without a maximum. ``asked_percent_fresh`` is the number of questions in percent of the open
    pairs that had not been asked before.
    """
    check_keywords(figures, changes, {one.name for one in fields(FiguresSettings)})
    settings = replace(settings or FiguresSettings(), **changes)
    size = settings.named("actions", "discount")
    how: SweepOptions = {"jobs": jobs, "journal": journal, "fresh": fresh, "progress": progress}
    return run_all(run_one, plan_of(settings), size, settings, _shown, **how)


def plan_of(settings: FiguresSettings) -> list[Cell]:
    """Return the runs in the order of the table: for each a cell as in ``ablation.run``.

    It also has the numbers of states and levels.
    """
    same = {"problem": "random", "learner": "q-learning", "audit": 0.0}
    seeds = range(settings.seed, settings.seed + settings.seeds)
    names, erring = (
        tuple(dict.fromkeys(named)) for named in (settings.comparators, settings.tutors)
    )
    levels, states = (tuple(dict.fromkeys(sizes)) for sizes in (settings.levels, settings.states))
    plan = []
    for name in ("always", *names):
        thin = name in settings.thinned
        tutors = (TRUTHFUL,) if name in ("always", "polytope") else erring[:: 2 if thin else 1]
        for tutor in tutors:
            ends = name == "always" or tutor in (TRUTHFUL, *erring[:: len(erring) - 1 or 1])
            step = 1 if ends and not thin else 2
            both = {(settings.at_states, k) for k in levels[::step]}
            both |= {(n, settings.at_levels) for n in states[::step]}
            for (n, k), seed in product(both, seeds):
                one = {"states": n, "levels": k, "comparator": name, "errs": tutor, "seed": seed}
                plan.append(same | one | _law(tutor))
    return in_order(plan, KEYS)


def _law(tutor: str) -> dict[str, float | None]:
    """Return the law of a tutor's errors, as a cell of ``ablation.run`` has it."""
    if tutor.startswith("c="):
        return {"error_rate": None, "c": float(tutor[2:])}
    return {"error_rate": 0.0 if tutor == TRUTHFUL else float(tutor.rstrip("%")) / 100.0, "c": None}


def run_one(cell: Cell, **shared: Any) -> Run:
    """Run a cell as ``run_named`` does, and add to its row.

    The number of warnings is added. If the tutor's precision is given, the tutor's error rate on
    the reference differences is added too.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        done = run_named(cell, **shared)
    more: dict[str, Any] = {"warnings": len(caught)}
    if cell.get("c"):
        size = shared["size"]
        mdp, values = instance(
            cell["problem"],
            cell["seed"],
            (cell["states"], size["actions"], cell["levels"], size["discount"]),
        )
        tutor = of_precision(cell["c"], mdp, values, cell["seed"])
        more["error_rate"] = tutor.expected_error_rate(reference_differences(mdp, values))
    return done._replace(row=done.row | more)


def _shown(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that the figures show."""
    fresh = frame.compared - frame.equal - frame.dominance - frame.known
    place = list(frame.columns).index("paper_loss_percent")
    frame.insert(place, "asked_percent_fresh", 100 * frame.asked / fresh.where(fresh > 0))
    frame = frame.drop(columns=_NOT_SHOWN)
    return frame[[*KEYS, *(name for name in frame.columns if name not in KEYS)]]
