"""One run of the ablation, from the few words that name its parts; and many.

The parts are a learner, a comparator, a tutor and a problem. Each of many runs stands beside the
oracle's.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache, lru_cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias, Unpack

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from elicit.model.comparator import TIE, Comparator
from elicit.model.comparator_parts import wrong_of
from elicit.model.scale import Floats
from elicit.model.tutor import CountsErrors
from elicit.tutors.person import PersonTutor
from elicit.tutors.simulated import BradleyTerryTutor, FlippingTutor, TruthfulTutor
from qlearn.experiments import compile_ahead
from qlearn.experiments.catalogue import ALWAYS, COMPARATORS, LEARNERS, PROBLEMS, Size
from qlearn.experiments.factories import Own
from qlearn.experiments.metrics import (
    Watch,
    audits,
    counts,
    estimated_values,
    greatest_reward,
    paper_loss,
    reference_differences,
)
from qlearn.experiments.own_parts import comparator_of, learner_of, problem_of, tutor_of
from qlearn.experiments.parallel import Cell, Interrupted, SweepOptions, sweep
from qlearn.experiments.settings import NAMED_TUTORS, ORDER, Settings
from qlearn.learners.learner import Learner, drive
from qlearn.mdp.equal_gaps import equal_gaps_policy
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import policy_loss, value_iteration

SimulatedTutor: TypeAlias = TruthfulTutor | FlippingTutor | BradleyTerryTutor | PersonTutor
Owned: TypeAlias = Mapping[str, Own]
"""Of one run: the user's own, by the column of the table that has their names ("comparator",
...).
"""

_NO_RUNS = (
    "cli",
    "paper",
    "experiments/ablation.py",
    "experiments/ablation_plot.py",
    "experiments/code_identity.py",
    "experiments/compile_ahead.py",
    "warm_up.py",
)  # sources of qlearn that no run depends on


class Run(NamedTuple):
    """One finished run: its row of the table, and what the oracle is compared by.

    These are v (S,) of figure 4 and the greatest reward that can be had. The seconds it took come
    last.
    """

    row: dict[str, Any]
    v: Floats
    best: float
    seconds: float


_reference = lru_cache(maxsize=32)(reference_differences)
_solved = lru_cache(maxsize=32)(value_iteration)
_unasked = lru_cache(maxsize=32)(equal_gaps_policy)

TUTORS: Mapping[str, Callable[[OrdinalMDP, Floats, float, int], SimulatedTutor]] = {
    "flip": lambda mdp, values, rate, seed: FlippingTutor(values, rate, seed),
    "logistic": lambda mdp, values, rate, seed: BradleyTerryTutor.from_error_rate(
        values, rate, _reference(mdp, tuple(values)), seed
    ),
}
"""A tutor who errs at a rate above 0, from the hidden values (k,) and the seed of the errors."""


def run(
    cell: Cell, mdp: OrdinalMDP, values: Floats, settings: Settings, own: Owned | None = None
) -> Run:
    """One run of one cell, on one thread.

    cell    the names of its "learner" and "comparator", "error_rate" of the tutor (or the name of a
            tutor in ``own``), "audit" (share of the decided pairs) and "seed". Audited runs are
            shorter, for contradictions show early. "always" has no budget. With an error rate of 0
            the tutor is truthful. In place of an error rate, "c" is the precision of eq. (6) in the
            paper's units, discounted counts times the hidden values as they are
    values  (k,) the hidden scale
    own     factories in place of what ``COMPARATORS``, ``LEARNERS`` and ``TUTORS`` have, by
            "comparator", "learner" and "error_rate": see ``ablation.ablate``. A learner of the
            user's has settings of its own, the budget included
    """
    own = own or {}
    settings = _of_cell(settings, cell, mdp, own)
    with threadpool_limits(1):
        comparator, tutor = (
            _comparator(cell, mdp.k, settings, own),
            _tutor(cell, mdp, values, settings, own),
        )
        learner = _learner(cell, mdp, comparator, settings, own)
        watch = Watch(values, settings.indifference, erred=lambda: tutor.realised_error_rate > 0)
        learner.watch(watch)
        start = perf_counter()
        may_conflict = cell["audit"] or wrong_of(
            comparator
        )  # more answers may be wrong than it allows for
        result = drive(learner, tutor, on_conflict="drop" if may_conflict else "raise")
        seconds = perf_counter() - start
        optimum = _solved(mdp, tuple(values))[0]
        loss = policy_loss(mdp, result.policy, values, optimum=optimum)
        unasked = policy_loss(mdp, _unasked(mdp), values, optimum=optimum)
        row = {
            **cell,
            **counts(result),
            "realised_error_rate": tutor.realised_error_rate,
            **watch.counts._asdict(),
            **audits(result, values),
            "loss": float(np.mean(loss)),
            "loss_initial": float(mdp.initial @ loss),
            "loss_unasked": float(np.mean(unasked)),
        }
        return Run(
            row, estimated_values(mdp, result.q, values), greatest_reward(mdp, values), seconds
        )


def _comparator(cell: Cell, k: int, settings: Settings, own: Owned) -> Comparator:
    if "comparator" in own:
        return comparator_of(own["comparator"], k, cell["seed"])
    return COMPARATORS[cell["comparator"]].make(k, cell["seed"], asdict(settings))


def _tutor(
    cell: Cell, mdp: OrdinalMDP, values: Floats, settings: Settings, own: Owned
) -> CountsErrors:
    seed, rate = cell["seed"], cell["error_rate"]
    if "error_rate" in own:
        return tutor_of(own["error_rate"], values, seed, partial(_reference, mdp, tuple(values)))
    if rate in NAMED_TUTORS:
        return PersonTutor(values, seed=seed)
    if cell.get("c"):
        return of_precision(cell["c"], mdp, values, seed)
    return TUTORS[settings.noise](mdp, values, rate, seed) if rate else TruthfulTutor(values)


def of_precision(c: float, mdp: OrdinalMDP, values: Floats, seed: int) -> BradleyTerryTutor:
    """Return the tutor of eq. (6) with this c for discounted counts.

    The hidden values (k,) are taken as they are.
    """
    return BradleyTerryTutor(values, c * (values[-1] - values[0]) / (1.0 - mdp.discount), seed)


def _learner(
    cell: Cell, mdp: OrdinalMDP, comparator: Comparator, settings: Settings, own: Owned
) -> Learner:
    if "learner" in own:
        return learner_of(own["learner"], mdp, comparator, cell["seed"])
    entry = LEARNERS[cell["learner"]]
    common = settings.named("max_queries", "indifference")
    return entry.factory(
        mdp,
        comparator,
        seed=cell["seed"],
        audit=cell["audit"],
        **common,
        **entry.keywords(settings),
    )


def _of_cell(settings: Settings, cell: Cell, mdp: OrdinalMDP, own: Owned) -> Settings:
    """The settings as they are in a cell."""
    if settings.tie is None:
        may_say_equal = "error_rate" in own or cell["error_rate"] in NAMED_TUTORS
        settings = replace(settings, tie=TIE if may_say_equal else 0.0)
    if cell["audit"]:
        steps, sweeps = (
            min(settings.steps, settings.audit_steps),
            min(settings.max_sweeps, settings.audit_sweeps),
        )
        settings = replace(settings, steps=steps, max_sweeps=sweeps)
    derived = None if "learner" in own else LEARNERS[cell["learner"]].indifference
    if derived is not None:
        return replace(settings, indifference=derived(settings, mdp.discount))
    close = "comparator" not in own and COMPARATORS[cell["comparator"]].indifferent
    return replace(settings, indifference=settings.close) if close else settings


@lru_cache(maxsize=32)
def instance(problem: str, seed: int, size: Size) -> tuple[OrdinalMDP, Floats]:
    """The MDP and the hidden values (k,) of one of ``PROBLEMS``. Raises as their makers do."""
    return PROBLEMS[problem].instance(seed, size)


def _problem_of(cell: Cell, size: Size, own: Owned) -> tuple[OrdinalMDP, Floats]:
    """Return the MDP and the hidden values (k,) of a cell.

    The user's own is made anew, because what it reads may have changed.
    """
    given = own.get("problem")
    return (
        problem_of(given, cell["seed"]) if given else instance(cell["problem"], cell["seed"], size)
    )


def run_all(
    function: Callable[..., Run],
    plan: Sequence[Cell],
    size: Mapping[str, Any],
    settings: Settings,
    shown: Callable[[pd.DataFrame], pd.DataFrame],
    **how: Unpack[SweepOptions],
) -> pd.DataFrame:
    """Return one row a cell, in their order, beside the oracle's.

    The oracle has the same problem and seed, and always asks a truthful tutor.

    A cell is as ``run`` has it, with the name of its "problem"; ``size`` has "states", "actions",
    "levels" and "discount" of the random MDPs, where the cells do not name their own. ``function``
    is ``run_named``, or adds to its row; ``shown`` makes the table that is returned; ``how`` are
    ``SweepOptions``. The last columns, nan without an oracle and for audited runs, which are
    shorter than it: ``paper_loss_percent`` (figure 4's formula, signed as printed),
    ``paper_abs_percent`` (the same with |v(s) - V(s)|, which cannot cancel out), ``excess_loss``
    and ``excess_loss_initial`` (true policy loss beyond the oracle's, share of the value range; of
    a learner of the user's beyond the best policy's, which is 0); and the ``seconds`` of the run.

    Raises ImportError without the package of a problem, ValueError where a factory of the user's
    returns what it should not, Interrupted on Ctrl-C, and as ``sweep`` does.
    """
    given = settings.own()

    def given_to(cell: Cell) -> dict[str, Own]:
        return {
            column: ones[cell[column]] for column, ones in given.items() if cell[column] in ones
        }

    def own(cell: Cell) -> tuple[Any, dict[str, Any]]:
        mine = given_to(cell)
        return (
            ({column: one.identity for column, one in mine.items()}, {"own": mine})
            if mine
            else (None, {})
        )

    for mine, cell in {(cell["problem"], *given_to(cell).items()): cell for cell in plan}.items():
        _check_parts(
            cell, _size(cell, size), settings.of_a_run(), dict(mine[1:])
        )  # said before the runs
    shared = {"size": size, "built": sources(), "settings": asdict(settings.of_a_run())}
    best = {
        *given.get("learner", ()),
        *(name for name, entry in LEARNERS.items() if entry.needs_proof),
    }
    try:
        ahead = compile_ahead.parts if len(plan) * settings.steps > _MUCH else None
        rows = sweep(function, plan, shared=shared, ahead=ahead, cost=_cost, own=own, **how)
    except Interrupted as stopped:
        frame = _beside_oracles(stopped.rows, best)
        stopped.frame = frame if frame.empty else shown(frame)
        raise
    return shown(_beside_oracles(rows, best))


def _check_parts(cell: Cell, size: Size, settings: Settings, own: Owned) -> None:
    """Raise what the parts of a run would raise when they are made."""
    mdp, values = _problem_of(cell, size, own)
    if own:
        settings = _of_cell(settings, cell, mdp, own)
        _tutor(cell, mdp, values, settings, own)
        _learner(cell, mdp, _comparator(cell, mdp.k, settings, own), settings, own)


def run_named(
    cell: Cell,
    size: Mapping[str, Any],
    built: str,
    settings: Mapping[str, Any],
    own: Owned | None = None,
) -> Run:
    """Run a cell by a worker that makes the problem itself (once).

    A task is a few hundred bytes, a table of ICU-Sepsis 40 MB. Raises RuntimeError if this
    process's ``sources`` are not those ``built`` names.
    """
    if built != sources():
        raise RuntimeError(
            "this worker has other sources or libraries than the process that started the sweep"
        )
    return run(cell, *_problem_of(cell, _size(cell, size), own or {}), Settings(**settings), own)


def in_order(
    cells: Iterable[Cell], keys: Sequence[str], own: Mapping[str, Iterable[str]] | None = None
) -> list[Cell]:
    """Return cells in the order of their table, which goes by these keys.

    The user's own names, by their columns, come after ours, and tutors of the user's after the
    error rates.
    """
    order = {
        key: (*ORDER.get(key, ()), *(own or {}).get(key, ())) for key in {*ORDER, *(own or {})}
    }

    def place(cell: Cell) -> tuple[Any, ...]:
        named = ((key, key in order and isinstance(cell[key], str)) for key in keys)
        return tuple(
            (is_name, order[key].index(cell[key]) if is_name else cell[key])
            for key, is_name in named
        )

    return sorted(cells, key=place)


def is_oracle(cell: Cell) -> bool:
    """Return whether a run always asks a truthful tutor."""
    return bool(cell["comparator"] == ALWAYS and cell["error_rate"] == 0)


@cache
def sources() -> str:
    """Return a hash of what a run depends on beside its settings.

    It depends on the sources, and on the libraries that compute.
    """
    digest = hashlib.blake2b(digest_size=16)
    here = Path(__file__).parents[1]
    for package in (here.parent / "elicit", here):
        for path in sorted(package.rglob("*.py")):
            name = path.relative_to(package).as_posix()
            if package != here or not name.startswith(_NO_RUNS):
                digest.update(name.encode() + path.read_bytes())
    for library in (
        "numpy",
        "scipy",
        "clarabel",
        "numba",
        "icu-sepsis",
        "gymnasium",
        "mo-gymnasium",
    ):
        try:
            digest.update(f"{library} {version(library)}".encode())
        except PackageNotFoundError:
            digest.update(f"no {library}".encode())
    return digest.hexdigest()


def _size(cell: Cell, size: Mapping[str, Any]) -> Size:
    whole = {**size, **cell}
    return whole["states"], whole["actions"], whole["levels"], whole["discount"]


_MUCH = 1_000_000  # steps in all, that are worth compiling for before they begin
_BESIDE = ("paper_loss_percent", "paper_abs_percent", "excess_loss", "excess_loss_initial")


def _cost(cell: Cell) -> float:
    """Return the cost by which runs are ordered.

    The oracles come first, which the others are paired with, should the sweep be interrupted; then
    what takes long.
    """
    if is_oracle(cell):
        return math.inf
    size = cell.get("levels", 1) * (1 + cell.get("states", 0) / 500)
    entry = COMPARATORS.get(cell["comparator"])
    slow = (entry.cost if entry else 1.0) * (2.0 if cell["error_rate"] else 1.0)
    return float(size * slow / (10.0 if cell["audit"] else 1.0))


def _beside_oracles(results: Iterable[Any], best_policy: Container[str]) -> pd.DataFrame:
    """The table of the runs that have finished.

    Learners in ``best_policy`` are held to it: how they do with a comparator that never learns is
    not known.
    """
    runs = [Run(row, np.array(v), best, seconds) for row, v, best, seconds in filter(None, results)]
    oracles = {_problem(run.row): run for run in runs if is_oracle(run.row)}
    table = []
    for row, v, best, seconds in runs:
        oracle = oracles.get(_problem(row))
        beside = dict.fromkeys(_BESIDE, math.nan)
        if row["learner"] in best_policy:
            beside |= {"excess_loss": row["loss"], "excess_loss_initial": row["loss_initial"]}
        elif oracle is not None and not row["audit"]:
            distance = paper_loss(np.abs(v - oracle.v), 0.0, best)
            excess = (row[name] - oracle.row[name] for name in ("loss", "loss_initial"))
            beside = dict(
                zip(_BESIDE, (paper_loss(v, oracle.v, best), distance, *excess), strict=True)
            )
        table.append(row | beside | {"seconds": seconds})
    return pd.DataFrame(table)


def _problem(cell: Cell) -> tuple[Any, ...]:
    return tuple(cell.get(key) for key in ("problem", "states", "levels", "learner", "seed"))
