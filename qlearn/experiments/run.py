"""One run of the ablation: a learner, a comparator, a tutor and a problem, from the few words that name them; and many,
each beside the oracle's."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache, lru_cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from elicit.comparators.baselines import AlwaysAsk
from elicit.comparators.bradley_terry.bootstrap_comparator import BradleyTerryComparator
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.comparators.polytope.relaxed_comparator import RelaxedPolytopeComparator
from elicit.model.comparator import Comparator
from elicit.model.scale import Floats
from elicit.tutors.simulated import BradleyTerryTutor, FlippingTutor, TruthfulTutor
from qlearn.experiments import compile_ahead
from qlearn.experiments.metrics import (
    Watch,
    audits,
    counts,
    estimated_values,
    greatest_reward,
    paper_loss,
    reference_differences,
)
from qlearn.experiments.parallel import Cell, Interrupted, sweep
from qlearn.experiments.settings import ORDER, Settings
from qlearn.learners.learner import Learner, drive
from qlearn.learners.q_learning import InteractiveQLearning
from qlearn.learners.value_iteration import InteractiveValueIteration
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import policy_loss, value_iteration
from qlearn.problems.gymnasium import deep_sea_treasure, frozen_lake
from qlearn.problems.icu_sepsis import icu_sepsis
from qlearn.problems.random_mdp import draw_values, random_mdp

Size: TypeAlias = tuple[int, int, int, float]
"""Of the random MDPs: states, actions, levels, discount."""
SimulatedTutor: TypeAlias = TruthfulTutor | FlippingTutor | BradleyTerryTutor

_NO_RUNS = (
    "cli",
    "paper",
    "experiments/ablation.py",
    "experiments/ablation_plot.py",
    "experiments/compile_ahead.py",
    "experiments/palette.py",
    "warm_up.py",
)  # sources of qlearn that no run depends on


class Run(NamedTuple):
    """One finished run: its row of the table, v (S,) of figure 4 and the greatest reward that can be had, for the
    comparison with the oracle, and the seconds it took."""

    row: dict[str, Any]
    v: Floats
    best: float
    seconds: float


def _posterior(k: int, seed: int, settings: Settings) -> Comparator:
    return PosteriorComparator(k, seed=seed, **settings.named("lapse", "level", "particles"))


def _bradley_terry(k: int, seed: int, settings: Settings, **region: Any) -> Comparator:
    own = settings.named("precision", "n_boot", "level", "refit_growth")
    return BradleyTerryComparator(k, seed=seed, **region, **own)


COMPARATORS: Mapping[str, Callable[[int, int, Settings], Comparator]] = {
    "always": lambda k, seed, settings: AlwaysAsk(k),
    "polytope": lambda k, seed, settings: PolytopeComparator(k),
    "relaxed": lambda k, seed, settings: RelaxedPolytopeComparator(k, slack=settings.slack),
    "posterior": _posterior,
    "posterior-close": _posterior,
    "ensemble": partial(_bradley_terry, region="ensemble"),
    "box-rescaled": partial(_bradley_terry, region="box", rescale=True),
    "box": partial(_bradley_terry, region="box"),
}
"""A comparator of k levels, from the seed of its resamples and the settings."""
CLOSE = frozenset({"posterior-close"})  # those with which Q-learning has the indifference ``settings.close``


LEARNERS: Mapping[str, tuple[Callable[..., Learner], Callable[[Settings], dict[str, Any]]]] = {
    "q-learning": (InteractiveQLearning, lambda s: {"steps": s.steps, "epsilon": s.exploration or s.epsilon}),
    "ivi": (InteractiveValueIteration, lambda s: s.named("tolerance", "max_sweeps")),
}
"""A learner, and the keywords that it has from the settings beside those that all learners have in common."""


_reference = lru_cache(maxsize=32)(reference_differences)
_solved = lru_cache(maxsize=32)(value_iteration)

TUTORS: Mapping[str, Callable[[OrdinalMDP, Floats, float, int], SimulatedTutor]] = {
    "flip": lambda mdp, values, rate, seed: FlippingTutor(values, rate, seed),
    "logistic": lambda mdp, values, rate, seed: BradleyTerryTutor.from_error_rate(
        values, rate, _reference(mdp, tuple(values)), seed
    ),
}
"""A tutor who errs at a rate above 0, from the hidden values (k,) and the seed of his errors."""


def _one(make: Callable[[], OrdinalMDP]) -> Callable[[int, Size], tuple[OrdinalMDP, Floats]]:
    """A problem whose MDP is the same whatever the seed; it is made once, which takes seconds."""
    made = cache(make)
    return lambda seed, size: (made(), draw_values(made().k, rng=seed))


PROBLEMS: Mapping[str, Callable[[int, Size], tuple[OrdinalMDP, Floats]]] = {
    "random": lambda seed, size: random_mdp(*size, rng=seed),
    "icu": _one(icu_sepsis),
    "frozen-lake": _one(frozen_lake),
    "deep-sea-treasure": _one(deep_sea_treasure),
}
"""An MDP and its hidden values (k,)."""


def run(cell: Cell, mdp: OrdinalMDP, values: Floats, settings: Settings) -> Run:
    """One run of one cell, on one thread.

    cell    the names of its "learner" and "comparator", "error_rate" of the tutor, "audit" (share of the decided pairs)
            and "seed". Audited runs are shorter, for contradictions show early. "always" has no budget. With an error
            rate of 0 the tutor is truthful
    values  (k,) the hidden scale
    """
    settings = _of_cell(settings, cell, mdp)
    with threadpool_limits(1):
        seed, rate = cell["seed"], cell["error_rate"]
        comparator = COMPARATORS[cell["comparator"]](mdp.k, seed, settings)
        tutor = TUTORS[settings.noise](mdp, values, rate, seed) if rate else TruthfulTutor(values)
        make, own = LEARNERS[cell["learner"]]
        common = settings.named("max_queries", "indifference")
        learner = make(mdp, comparator, rng=seed, audit=cell["audit"], **common, **own(settings))
        watch = Watch(values, settings.indifference, erred=lambda: tutor.realised_error_rate > 0)
        learner.watch(watch)
        start = perf_counter()
        result = drive(learner, tutor, on_conflict="drop" if cell["audit"] else "raise")
        seconds = perf_counter() - start
        loss = policy_loss(mdp, result.policy, values, optimum=_solved(mdp, tuple(values))[0])
        row = {
            **cell,
            **counts(result),
            "realised_error_rate": tutor.realised_error_rate,
            **watch.counts._asdict(),
            **audits(result, values),
            "loss": float(np.mean(loss)),
            "loss_initial": float(mdp.initial @ loss),
        }
        return Run(row, estimated_values(mdp, result.q, values), greatest_reward(mdp, values), seconds)


def _of_cell(settings: Settings, cell: Cell, mdp: OrdinalMDP) -> Settings:
    """The settings as they are in a cell."""
    if cell["audit"]:
        steps, sweeps = min(settings.steps, settings.audit_steps), min(settings.max_sweeps, settings.audit_sweeps)
        settings = replace(settings, steps=steps, max_sweeps=sweeps)
    if cell["learner"] == "ivi":
        return replace(settings, indifference=settings.tolerance * (1 - mdp.discount) / 2)
    return replace(settings, indifference=settings.close) if cell["comparator"] in CLOSE else settings


@lru_cache(maxsize=32)
def instance(problem: str, seed: int, size: Size) -> tuple[OrdinalMDP, Floats]:
    """The MDP and the hidden values (k,) of one of ``PROBLEMS``. Raises as their makers do."""
    return PROBLEMS[problem](seed, size)


def run_all(
    function: Callable[..., Run],
    plan: Sequence[Cell],
    size: Mapping[str, Any],
    settings: Settings,
    shown: Callable[[pd.DataFrame], pd.DataFrame],
    **how: Any,
) -> pd.DataFrame:
    """One row a cell, in their order, beside the oracle's of the same problem and seed: always asking a truthful tutor.

    A cell is as ``run`` has it, with the name of its "problem"; ``size`` has "states", "actions", "levels" and
    "discount" of the random MDPs, where the cells do not name their own. ``function`` is ``run_named``, or adds to its
    row; ``shown`` makes the table that is returned; ``how`` are keywords of ``sweep``. The last columns, nan without
    an oracle and for audited runs, which are shorter than it: ``paper_loss_percent`` (figure 4's formula, signed as
    printed), ``paper_abs_percent`` (the same with |v(s) - V(s)|, which cannot cancel out), ``excess_loss`` and
    ``excess_loss_initial`` (true policy loss beyond the oracle's, share of the value range); and the ``seconds`` of
    the run.

    Raises ImportError without the package of a problem, Interrupted on Ctrl-C, and as ``sweep`` does.
    """
    for cell in {cell["problem"]: cell for cell in plan}.values():
        instance(cell["problem"], cell["seed"], _size(cell, size))  # what is wrong with it is said before the runs
    shared = {"size": size, "built": sources(), "settings": asdict(settings.of_a_run())}
    try:
        rows = sweep(function, plan, shared=shared, ahead=compile_ahead.parts, cost=_cost, **how)
    except Interrupted as stopped:
        frame = _beside_oracles(stopped.rows)
        stopped.frame = frame if frame.empty else shown(frame)
        raise
    return shown(_beside_oracles(rows))


def run_named(cell: Cell, size: Mapping[str, Any], built: str, settings: Mapping[str, Any]) -> Run:
    """``run``, by a worker that makes the problem itself (once): a task is a few hundred bytes, a table of ICU-Sepsis
    40 MB. Raises RuntimeError if this process's ``sources`` are not those ``built`` names."""
    if built != sources():
        raise RuntimeError("this worker has other sources or libraries than the process that started the sweep")
    return run(cell, *instance(cell["problem"], cell["seed"], _size(cell, size)), Settings(**settings))


def in_order(cells: Iterable[Cell], keys: Sequence[str]) -> list[Cell]:
    """Cells in the order of their table, which goes by these keys."""

    def place(cell: Cell) -> tuple[Any, ...]:
        return tuple(ORDER[key].index(cell[key]) if key in ORDER else cell[key] for key in keys)

    return sorted(cells, key=place)


def is_oracle(cell: Cell) -> bool:
    """Whether a run always asks a truthful tutor."""
    return bool(cell["comparator"] == "always" and cell["error_rate"] == 0)


@cache
def sources() -> str:
    """A hash of what a run depends on beside its settings: the sources, and the libraries that compute."""
    digest = hashlib.blake2b(digest_size=16)
    here = Path(__file__).parents[1]
    for package in (here.parent / "elicit", here):
        for path in sorted(package.rglob("*.py")):
            name = path.relative_to(package).as_posix()
            if package != here or not name.startswith(_NO_RUNS):
                digest.update(name.encode() + path.read_bytes())
    for library in ("numpy", "scipy", "clarabel", "numba", "icu-sepsis", "gymnasium", "mo-gymnasium"):
        try:
            digest.update(f"{library} {version(library)}".encode())
        except PackageNotFoundError:
            digest.update(f"no {library}".encode())
    return digest.hexdigest()


def _size(cell: Cell, size: Mapping[str, Any]) -> Size:
    whole = {**size, **cell}
    return whole["states"], whole["actions"], whole["levels"], whole["discount"]


_BESIDE = ("paper_loss_percent", "paper_abs_percent", "excess_loss", "excess_loss_initial")
_SLOW = {"box": 8.0, "box-rescaled": 4.0, "ensemble": 4.0, "posterior": 3.0, "posterior-close": 3.0}  # others 1


def _cost(cell: Cell) -> float:
    """The oracles first, which the others are paired with, should the sweep be interrupted; then what takes long."""
    if is_oracle(cell):
        return math.inf
    size = cell.get("levels", 1) * (1 + cell.get("states", 0) / 500)
    slow = _SLOW.get(cell["comparator"], 1.0) * (2.0 if cell["error_rate"] else 1.0)
    return float(size * slow / (10.0 if cell["audit"] else 1.0))


def _beside_oracles(results: Iterable[Any]) -> pd.DataFrame:
    """The table of the runs that have finished."""
    runs = [Run(row, np.array(v), best, seconds) for row, v, best, seconds in filter(None, results)]
    oracles = {_problem(run.row): run for run in runs if is_oracle(run.row)}
    table = []
    for row, v, best, seconds in runs:
        oracle = oracles.get(_problem(row))
        beside = dict.fromkeys(_BESIDE, math.nan)
        if oracle is not None and not row["audit"]:
            distance = paper_loss(np.abs(v - oracle.v), 0.0, best)
            excess = (row[name] - oracle.row[name] for name in ("loss", "loss_initial"))
            beside = dict(zip(_BESIDE, (paper_loss(v, oracle.v, best), distance, *excess), strict=True))
        table.append(row | beside | {"seconds": seconds})
    return pd.DataFrame(table)


def _problem(cell: Cell) -> tuple[Any, ...]:
    return tuple(cell.get(key) for key in ("problem", "states", "levels", "learner", "seed"))
