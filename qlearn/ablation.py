"""The comparator ablation: comparators x learners x tutors x problems x seeds, every cell with the same random numbers.

A seed fixes the MDP, the hidden values, the learner's exploration and transitions, the tutor's errors and the
resamples of the comparator, so that runs of one seed differ by what is compared and nothing else. Any run can be
rebuilt by hand with that seed as ``rng`` and ``seed``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from time import perf_counter
from typing import Any, Literal, NamedTuple

import joblib
import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from elicit.bradley_terry import BradleyTerryComparator
from elicit.comparator import AlwaysAsk, Comparator
from elicit.polytope import PolytopeComparator
from elicit.posterior import PosteriorComparator
from elicit.relaxed import RelaxedPolytopeComparator
from elicit.scale import Floats
from elicit.tutor import BradleyTerryTutor, FlippingTutor, TruthfulTutor
from qlearn.environments import draw_values, icu_sepsis, random_mdp
from qlearn.ivi import InteractiveValueIteration
from qlearn.learner import drive
from qlearn.mdp import OrdinalMDP
from qlearn.metrics import CELL, Watch, audits, counts, estimated_values, paper_loss, reference_differences, summarise
from qlearn.planning import policy_loss
from qlearn.q_learning import InteractiveQLearning

__all__ = ["Interrupted", "Run", "ablate", "cells", "run", "summarise"]

Cell = dict[str, Any]
KEYS = (*CELL, "seed")
ORDER: dict[str, tuple[str, ...]] = {
    "problem": ("random", "icu"),
    "learner": ("q-learning", "ivi"),
    "comparator": ("always", "polytope", "relaxed", "posterior", "posterior-close", "ensemble", "box"),
}

AUDITED = ("polytope", "relaxed")  # to a statistical model a surprising answer is no contradiction


class Run(NamedTuple):
    """One finished run: its row of the table, and v (S,) of figure 4 for the comparison with the oracle's."""

    row: Cell
    v: Floats


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during an ablation; ``frame`` holds the runs that had finished."""

    def __init__(self, frame: pd.DataFrame) -> None:
        super().__init__(f"interrupted after {len(frame)} runs")
        self.frame = frame


def ablate(
    *,
    problems: Sequence[str] = ORDER["problem"],
    learners: Sequence[str] = ORDER["learner"],
    comparators: Sequence[str] = ORDER["comparator"],
    error_rates: Sequence[float] = (0.0, 0.05, 0.15),
    audit: float = 0.05,
    seeds: int = 3,
    seed: int = 0,
    states: int = 100,
    actions: int = 5,
    levels: int = 10,
    discount: float = 0.95,
    jobs: int = -1,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> pd.DataFrame:
    """Run every cell and return one row a run, sorted, with the seconds it took in the last column.

    ``problems`` "random" (``random_mdp`` of ``states``, ``actions``, ``levels``, ``discount``) and "icu"
    (``icu_sepsis``, hidden values from ``draw_values``); ``learners`` "q-learning" and "ivi"; ``comparators``
    "always" (asks about everything), "polytope", "relaxed" (the polytope with slack), "posterior", "posterior-close"
    (Q-learning alone: with an indifference of ``close``), "ensemble" and "box" (Bradley-Terry). An ``error_rate`` of 0
    is a truthful tutor. ``audit`` > 0 adds a second, audited run to each cell of the polytope, which only so notices an
    error; "relaxed", which differs from it only where answers contradict each other, then has no other.
    ``seeds`` consecutive seeds from ``seed``. ``settings`` are the keywords of ``run``. "always" with a
    truthful tutor is always run: it is the oracle that the others are paired with, all but the audited ones,
    which are shorter (their paired columns are nan).

    The rows do not depend on ``jobs`` (processes; -1: one a core), only the seconds do. ``progress`` is called
    with (runs finished, runs in all). Raises ValueError for unknown names, ImportError without the tables of
    ICU-Sepsis, and Interrupted on Ctrl-C.
    """
    plan = cells(problems, learners, comparators, error_rates, audit, range(seed, seed + seeds))
    icu = icu_sepsis() if "icu" in problems else None
    instances: dict[tuple[str, int], tuple[OrdinalMDP, Floats]] = {}
    for s in range(seed, seed + seeds):
        if "random" in problems:
            instances["random", s] = random_mdp(states, actions, levels, discount, rng=s)
        if icu is not None:
            instances["icu", s] = icu, draw_values(icu.k, rng=s)
    finished: list[Run] = []
    try:
        tasks = (joblib.delayed(run)(cell, *instances[cell["problem"], cell["seed"]], **settings) for cell in plan)
        for done in _results(tasks, jobs):
            finished.append(done)
            if progress is not None:
                progress(len(finished), len(plan))
    except KeyboardInterrupt:
        raise Interrupted(_paired(finished, instances)) from None
    return _paired(finished, instances)


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


def run(
    cell: Cell,
    mdp: OrdinalMDP,
    values: Floats,
    *,
    steps: int = 20_000,
    epsilon: float = 1.0,
    indifference: float = 0.0,
    close: float = 0.005,
    tolerance: float = 0.005,
    max_sweeps: int = 200,
    max_queries: int = 2000,
    audit_length: float = 0.1,
    precision: float = 300.0,
    n_boot: int = 50,
    level: float = 0.95,
    refit_growth: float = 0.05,
    lapse: float = 0.1,
    particles: int = 500,
    slack: float = 0.0,
    noise: Literal["flip", "logistic"] = "flip",
) -> Run:
    """One run of one cell, on one thread.

    steps, epsilon  of Q-learning. An epsilon of 1 explores uniformly: then all comparators see the same transitions,
                    and losses differ by verdicts alone
    indifference    of Q-learning, share of the value range; value iteration derives its own from the tolerance
    close           indifference of Q-learning with "posterior-close"
    tolerance       of value iteration: policy loss with right verdicts, share of the value range
    max_sweeps      of value iteration; a tutor who errs anew each time would keep it going for ever
    max_queries     question budget; "always" has none
    audit_length    of an audited run, as a share of steps and max_sweeps: contradictions show early
    precision       of the Bradley-Terry comparators' prior, logits per unit of d.e. 300: a difference of 1% of the
                    value range is answered rightly 95 times in 100
    n_boot, level, refit_growth   of the Bradley-Terry comparators: resamples, confidence (the posterior's too), and
                    how much the answers grow between two refits
    lapse, particles   of the posterior: share of answers given at random, and number of particles
    slack           of the relaxed polytope
    noise           of a tutor who errs: "flip" (any answer, however clear) or "logistic" (near ties mostly; the
                    precision is set so that the error rate holds on average over ``reference_differences``)
    """
    seed, rate, ivi = cell["seed"], cell["error_rate"], cell["learner"] == "ivi"
    name, k = cell["comparator"], mdp.k
    comparator: Comparator
    if name == "always":
        comparator = AlwaysAsk(k)
    elif name == "polytope":
        comparator = PolytopeComparator(k)
    elif name == "relaxed":
        comparator = RelaxedPolytopeComparator(k, slack=slack)
    elif name.startswith("posterior"):
        comparator = PosteriorComparator(k, lapse=lapse, level=level, particles=particles, seed=seed)
    else:
        comparator = BradleyTerryComparator(
            k, precision=precision, n_boot=n_boot, level=level, region=name, refit_growth=refit_growth, seed=seed
        )
    if name == "posterior-close":
        indifference = close
    indifference = tolerance * (1 - mdp.discount) / 2 if ivi else indifference
    if cell["audit"]:
        steps, max_sweeps = math.ceil(steps * audit_length), math.ceil(max_sweeps * audit_length)
    common = {"rng": seed, "max_queries": max_queries, "indifference": indifference, "audit": cell["audit"]}
    # one thread: how a sum is split among threads would show in its last digits
    with threadpool_limits(1):
        tutor = _tutor(noise, rate, mdp, values, seed)
        learner: InteractiveValueIteration | InteractiveQLearning = (
            InteractiveValueIteration(mdp, comparator, tolerance=tolerance, max_sweeps=max_sweeps, **common)
            if ivi
            else InteractiveQLearning(mdp, comparator, steps=steps, epsilon=epsilon, **common)
        )
        watch = Watch(values, indifference, erred=lambda: tutor.realised_error_rate > 0)
        learner.watch(watch)
        start = perf_counter()
        result = drive(learner, tutor, on_conflict="drop" if cell["audit"] else "raise")
        seconds = perf_counter() - start
        loss = policy_loss(mdp, result.policy, values)
        return Run(
            {
                **cell,
                **counts(result),
                "realised_error_rate": tutor.realised_error_rate,
                **watch.counts._asdict(),
                **audits(result, values),
                "loss": float(np.mean(loss)),
                "loss_initial": float(mdp.initial @ loss),
                "seconds": seconds,
            },
            estimated_values(mdp, result.q, values),
        )


def _results(tasks: Iterable[Any], jobs: int) -> Iterator[Run]:
    """Results as they come, in any order."""
    if jobs == 1:
        return (function(*args, **kwargs) for function, args, kwargs in tasks)
    with joblib.parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
        results: Iterator[Run] = joblib.Parallel(return_as="generator_unordered")(tasks)
    return results


def _tutor(
    noise: str, rate: float, mdp: OrdinalMDP, values: Floats, seed: int
) -> TruthfulTutor | FlippingTutor | BradleyTerryTutor:
    if noise not in ("flip", "logistic"):
        raise ValueError(f"noise must be 'flip' or 'logistic', not {noise!r}")
    if rate == 0:
        return TruthfulTutor(values)
    if noise == "flip":
        return FlippingTutor(values, rate, seed)
    return BradleyTerryTutor.from_error_rate(values, rate, reference_differences(mdp, values), seed)


def _paired(runs: Sequence[Run], instances: dict[tuple[str, int], tuple[OrdinalMDP, Floats]]) -> pd.DataFrame:
    """The table, each run beside the oracle of its problem, learner and seed."""
    oracles = {_group(run.row): run for run in runs if _is_oracle(run.row)}
    rows = []
    for row, v in sorted(runs, key=lambda run: _place(run.row)):
        oracle = None if row["audit"] else oracles.get(_group(row))  # audited runs are shorter than the oracle
        mdp, values = instances[row["problem"], row["seed"]]
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
    frame = pd.DataFrame(rows)
    return frame[[*(c for c in frame.columns if c != "seconds"), "seconds"]] if rows else frame


def _is_oracle(cell: Cell) -> bool:
    return bool(cell["comparator"] == "always" and cell["error_rate"] == 0)


def _group(cell: Cell) -> tuple[Any, ...]:
    return cell["problem"], cell["learner"], cell["seed"]


def _place(cell: Cell) -> tuple[Any, ...]:
    """Where a run stands in the table."""
    return tuple(ORDER[key].index(cell[key]) if key in ORDER else cell[key] for key in KEYS)
