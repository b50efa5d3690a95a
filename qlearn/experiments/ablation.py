"""The comparator ablation: comparators x learners x tutors x problems x seeds.

Every cell has the same random numbers.

A seed fixes the MDP, the hidden values, the learner's exploration and transitions, the tutor's
errors and the resamples of the comparator, so that runs of one seed differ by what is compared and
nothing else. Any run can be rebuilt by hand with that ``seed``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from operator import methodcaller
from pathlib import Path
from typing import Any

import pandas as pd

from qlearn.experiments.catalogue import ALWAYS, COMPARATORS, LEARNERS
from qlearn.experiments.metrics import CELL, summarise
from qlearn.experiments.parallel import Cell, Interrupted, SweepOptions
from qlearn.experiments.run import Run, in_order, run, run_all, run_named
from qlearn.experiments.settings import AblationSettings

__all__ = ["AblationSettings", "Interrupted", "Run", "ablate", "plan_of", "run", "summarise"]

KEYS = (*CELL, "seed")
AUDITED = tuple(
    name for name, entry in COMPARATORS.items() if entry.trusts
)  # a model expects some wrong answers


def ablate(
    settings: AblationSettings | None = None,
    *,
    jobs: int | None = None,
    journal: Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **changes: Any,
) -> pd.DataFrame:
    """Run every cell and return one row a run, in the order of ``KEYS``.

    The last column has the seconds that the run took.

    ``changes`` are fields of ``AblationSettings`` by name, in place of those of ``settings``
    (default: the defaults).

    ``catalogue`` says what the names of problems, learners and comparators stand for.
    "posterior-close" is for "q-learning" alone. "policy-iteration" runs only with comparators that
    can prove a loss bound (not "always", not "box"), and has no audited runs and no oracle.
    ``audit`` > 0 adds a second, audited run to each cell of the polytope, which only so notices an
    error; "relaxed", which differs from it only where answers contradict each other, then has no
    other. "always" with a truthful tutor is always run: it is the oracle that the others are paired
    with, all but the audited ones, which are shorter (their paired columns are nan).

    Your own go in by a mapping of the names that they shall have, in ``runs.csv`` and pictures too,
    to their factories, beside ours, which stand for themselves: ``comparators={"mine": lambda k,
    seed: Mine(k), "polytope": "polytope"}``. A factory is a function, or the text
    "package.module:factory"; such a text also stands where names do, and is then the name. It is
    called anew for every run, in whatever process computes it, and lambdas and closures will do:

    comparators   factory(k, seed) -> Comparator of k levels; never audited
    problems      factory(seed) -> (mdp, values), an OrdinalMDP and its hidden scale (k,)
    tutors        factory(values, seed) -> Tutor, or factory(values, seed, reference) with the
                  differences (n, k) of an optimal policy's choices, to set noise by; or "person",
                  an ``elicit.PersonTutor``, another one for each seed. They come
                  beside the tutors of ``error_rates``, with their names in the column
                  ``error_rate``. Where a tutor does not count its errors they are counted here. Our
                  comparators assume that the tutor may call equal what lies within .01 (``tie``);
                  of ours they know better
    learners      factory(mdp, comparator, seed) -> Learner, with settings of its own, the budget
                  included. They have no audited runs and no oracle: their excess loss is that
                  beyond the best policy

    The rows do not depend on ``jobs`` (processes; None: as an outer ``joblib.parallel_config``
    says, a Dask cluster say, else one a core), nor on whether a run is read from ``journal``, the
    file in which finished runs are kept and looked up; only the seconds do. There a run counts as
    the same while its settings, the sources of both packages and the versions of the libraries that
    compute are the same; and, of your own, the factory's code, its defaults, what it closes over,
    and the functions, classes and constants that it names, and that those name (``code_identity``):
    under the same name another code is computed anew, the same code under another name too. Files
    that it reads, and changes in packages that you install, are not seen: ``fresh`` empties the
    journal. ``progress`` is called with (runs finished, runs in all). Raises ValueError for a
    setting that cannot be, and where a factory fails or returns something else, before the first
    run; TypeError for a setting that there is not; and as ``run_all`` does.
    """
    settings = replace(settings or AblationSettings(), **changes)
    size = settings.named("states", "actions", "levels", "discount")
    shown = methodcaller("drop", columns="paper_abs_percent")
    how: SweepOptions = {"jobs": jobs, "journal": journal, "fresh": fresh, "progress": progress}
    return run_all(run_named, plan_of(settings), size, settings, shown, **how)


def plan_of(settings: AblationSettings) -> list[Cell]:
    """Return the cells, one dict of ``KEYS`` for each run, in the order of the table."""
    own = settings.own()
    arms: set[tuple[str, float | str, float]] = {(ALWAYS, 0.0, 0.0)}
    tutors: tuple[float | str, ...] = (*settings.error_rates, *settings.names("tutors"))
    for comparator, tutor in product(settings.names("comparators"), tutors):
        audited = (
            settings.audit > 0 and comparator in AUDITED and comparator not in own["comparator"]
        )
        if not (audited and comparator == "relaxed"):
            arms.add((comparator, tutor, 0.0))
        if audited:
            arms.add((comparator, tutor, settings.audit))
    seeds = range(settings.seed, settings.seed + settings.seeds)
    problems, learners = ({*settings.names(name)} for name in ("problems", "learners"))

    def is_wanted(learner: str, comparator: str, tutor: Any, audit: float) -> bool:
        if learner in own["learner"]:
            listed = ALWAYS in settings.comparators and 0.0 in settings.error_rates
            return not audit and (listed or (comparator, tutor) != (ALWAYS, 0.0))
        entry = LEARNERS[learner]
        if (
            audit and entry.needs_proof
        ):  # audits follow the last question, so such a run cannot be shorter
            return False
        return comparator in own["comparator"] or entry.pairs_with(COMPARATORS[comparator])

    plan = [
        dict(zip(KEYS, (problem, learner, *arm, seed), strict=True))
        for problem, learner, arm, seed in product(problems, learners, arms, seeds)
        if is_wanted(learner, *arm)
    ]
    if not plan:
        raise ValueError(
            f"learners {', '.join(learners)} do not run with comparators "
            f"{', '.join(settings.names('comparators'))}: "
            "policy-iteration has no audited runs, and needs a comparator that can prove a loss "
            "bound, such as polytope"
        )
    return in_order(plan, KEYS, own)
