"""The comparator ablation: comparators x learners x tutors x problems x seeds.

All cells use the same random numbers. A seed fixes the MDP, the hidden values, the learner's
exploration and transitions, the tutor's errors and the resamples of the comparator. So runs of the
same seed differ only by what is compared. Any run can be made again by hand with that ``seed``.

``ablate`` plans the runs. ``run_all`` makes each of them, by ``run_named`` and ``run``, and puts it
beside the oracle's. The paper's figures (``qlearn.paper``) are made of the same runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from functools import lru_cache, partial
from itertools import product
from operator import methodcaller
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias, Unpack

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from elicit._support.keywords import check_keywords
from elicit.model.comparator import TIE, Comparator
from elicit.model.comparator_parts import wrong_of
from elicit.model.scale import Floats
from elicit.model.tutor import CountsErrors
from elicit.tutors.person import PersonTutor
from elicit.tutors.simulated import BradleyTerryTutor, FlippingTutor, TruthfulTutor
from qlearn.experiments import compile_ahead
from qlearn.experiments.catalogue import ALWAYS, COMPARATORS, LEARNERS, PROBLEMS, Size
from qlearn.experiments.code_identity import sources
from qlearn.experiments.metrics import (
    CELL,
    Watch,
    audits,
    counts,
    estimated_values,
    greatest_reward,
    paper_loss,
    reference_differences,
    summarise,
)
from qlearn.experiments.own_parts import Own, comparator_of, learner_of, problem_of, tutor_of
from qlearn.experiments.parallel import Cell, Interrupted, SweepOptions, sweep
from qlearn.experiments.settings import NAMED_TUTORS, ORDER, AblationSettings, Settings
from qlearn.learners.driving import drive
from qlearn.learners.learner import Learner
from qlearn.mdp.equal_gaps import equal_gaps_policy
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import policy_loss, value_iteration

__all__ = ["AblationSettings", "Interrupted", "Run", "ablate", "plan_of", "run", "summarise"]

KEYS = (*CELL, "seed")
AUDITED = tuple(
    name for name, entry in COMPARATORS.items() if entry.trusts
)  # a model expects some wrong answers
_MUCH = 1_000_000  # steps in all, that are worth compiling for before they begin
_BESIDE = ("paper_loss_percent", "paper_abs_percent", "excess_loss", "excess_loss_initial")
SimulatedTutor: TypeAlias = TruthfulTutor | FlippingTutor | BradleyTerryTutor | PersonTutor
Owned: TypeAlias = Mapping[str, Own]
"""The user's own parts of a run, by the column of the table that has their names ("comparator",
...)."""


class Run(NamedTuple):
    """A finished run: its row of the table, and numbers for a comparison with the oracle's run.

    Attributes
    ----------
    row : dict
        The run's row, from column to value.
    v : (S,)
        The estimated values of the paper's figure 4.
    best : float
        The greatest reward of an action, in the unit of the hidden values.
    seconds : float
        The time that the run took.
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
"""Factories of tutors who err at a rate above 0, from the hidden values (k,) and the seed of the
errors."""


def ablate(
    settings: AblationSettings | None = None,
    *,
    jobs: int | None = None,
    journal: Path | None = None,
    fresh: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **changes: Any,
) -> pd.DataFrame:
    """Run every cell and return a row for each run, in the order of ``KEYS``.

    ``catalogue`` says what the names of problems, learners and comparators stand for.
    "posterior-close" is for "q-learning" alone. "policy-iteration" runs only with comparators that
    can prove a loss bound (not "always", not "box"), and has no audited runs and no oracle.
    ``audit`` > 0 adds a second, audited run to each cell of the polytope, which notices errors only
    in this way. "always" with a truthful tutor is always run: it is the oracle that the others are
    paired with. Audited runs are not, because they are shorter (their paired columns are nan).

    Parameters
    ----------
    settings : AblationSettings, optional
        What is run. Default: ``AblationSettings()``.
    jobs : int, optional
        Number of processes. -1: one for each core. None: as an outer ``joblib.parallel_config``
        says, such as for a Dask cluster, else one for each core.
    journal : Path, optional
        The file in which finished runs are kept and looked up. None: no journal.
    fresh : bool
        Empty the journal first. Default: False.
    progress : function, optional
        Called with (runs finished, runs in all).
    **changes
        Fields of ``AblationSettings`` by name, in place of those of ``settings``.

    Returns
    -------
    pandas.DataFrame
        A row for each run. The last column, ``seconds``, is the time that the run took. All other
        columns depend neither on ``jobs`` nor on whether a run is read from the journal.

    Raises
    ------
    ValueError
        For an impossible setting, and, before the first run, for a factory that fails or returns
        something else.
    TypeError
        For an unknown setting.
    ImportError
        Without the package of a problem.
    Interrupted
        On Ctrl-C, with the rows that have finished.

    Notes
    -----
    Your own parts are given as a mapping from their names, which ``runs.csv`` and pictures show, to
    their factories. The mapping may also hold our parts, under their own names:
    ``comparators={"mine": lambda k, seed: Mine(k), "polytope": "polytope"}``. A factory is a
    function, or the text "package.module:factory". Such a text may also be given in place of a
    name, and is then the name. A factory is called for every run, in the process that computes it.
    Lambdas and closures are allowed.

    comparators   factory(k, seed) -> Comparator of k levels; never audited
    problems      factory(seed) -> (mdp, values), an OrdinalMDP and its hidden scale (k,)
    tutors        factory(values, seed) -> Tutor, or factory(values, seed, reference) with the
                  differences (n, k) of an optimal policy's choices, by which noise can be set; or
                  "person", an ``elicit.PersonTutor``, a different one for each seed. They come in
                  addition to the tutors of ``error_rates``, with their names in the column
                  ``error_rate``. If a tutor does not count its errors they are counted here. Our
                  comparators assume that the tutor may call equal what lies within .01 (``tie``);
                  for our own tutors the true width is known
    learners      factory(mdp, comparator, seed) -> Learner, with its own settings, including the
                  budget. They have no audited runs and no oracle: their excess loss is that beyond
                  the best policy

    A run is taken from the journal if its settings, the sources of both packages and the versions
    of the libraries that compute are the same. For your own parts these must be the same too: the
    factory's code, its defaults, its closure, and the functions, classes and constants that it
    names, directly or indirectly (``code_identity``). So changed code is computed again under the
    same name, and so is the same code under another name. Files that it reads, and changes in
    packages that you install, are not seen: take ``fresh`` then.
    """
    check_keywords(ablate, changes, {one.name for one in fields(AblationSettings)})
    settings = replace(settings or AblationSettings(), **changes)
    size = settings.named("states", "actions", "levels", "discount")
    shown = methodcaller("drop", columns="paper_abs_percent")
    how: SweepOptions = {"jobs": jobs, "journal": journal, "fresh": fresh, "progress": progress}
    return run_all(run_named, plan_of(settings), size, settings, shown, **how)


def plan_of(settings: AblationSettings) -> list[Cell]:
    """Return the cells, one dict of ``KEYS`` for each run, in the order of the table.

    Parameters
    ----------
    settings : AblationSettings
        What is run.

    Returns
    -------
    list of dict
        A cell for each run: its "problem", "learner", "comparator", "error_rate", "audit" and
        "seed".

    Raises
    ------
    ValueError
        If none of the learners runs with any of the comparators.
    """
    own = settings.own()
    arms: set[tuple[str, float | str, float]] = {(ALWAYS, 0.0, 0.0)}
    tutors: tuple[float | str, ...] = (*settings.error_rates, *settings.names("tutors"))
    for comparator, tutor in product(settings.names("comparators"), tutors):
        audited = (
            settings.audit > 0 and comparator in AUDITED and comparator not in own["comparator"]
        )
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


def in_order(
    cells: Iterable[Cell], keys: Sequence[str], own: Mapping[str, Iterable[str]] | None = None
) -> list[Cell]:
    """Return cells in the order of their table, by these keys.

    The user's own names come after ours in each column, and the user's tutors after the error
    rates.
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


def run_all(
    function: Callable[..., Run],
    plan: Sequence[Cell],
    size: Mapping[str, Any],
    settings: Settings,
    shown: Callable[[pd.DataFrame], pd.DataFrame],
    **how: Unpack[SweepOptions],
) -> pd.DataFrame:
    """Return a row for each cell, in order, with columns that compare it with the oracle's run.

    The oracle's run has the same problem and seed, and always asks a truthful tutor.

    A cell is a dict as in ``run``, with the name of its "problem". ``size`` has "states",
    "actions", "levels" and "discount" of the random MDPs, unless the cells say their own.
    ``function`` computes a row: ``run_named``, or a function that adds to its row. ``shown`` turns
    the rows into the table that is returned. ``how`` are ``SweepOptions``.

    The last columns are nan without an oracle, and for audited runs, which are shorter than the
    oracle's:

    - ``paper_loss_percent``: the paper's formula for figure 4, signed as printed. It ignores which
      action the learner chose (``metrics.paper_loss``).
    - ``paper_abs_percent``: the same with |v(s) - V(s)|, which cannot cancel out.
    - ``excess_loss`` and ``excess_loss_initial``: the true policy loss beyond the oracle's, a share
      of the value range. For a user's own learner it is beyond the best policy's, which is 0.
    - ``seconds``: the time of the run.

    Raises ImportError without the package of a problem, ValueError if a user's factory returns
    something wrong, Interrupted on Ctrl-C, and the errors of ``sweep``.
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
    """Raise the errors that making the parts of a run would raise."""
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
    """Run a cell in a worker that makes the problem itself (once).

    A task is a few hundred bytes, while a table of ICU-Sepsis would be 40 MB. Raises RuntimeError
    if this process's ``sources`` are not those of ``built``.
    """
    if built != sources():
        raise RuntimeError(
            "this worker has other sources or libraries than the process that started the sweep"
        )
    return run(cell, *_problem_of(cell, _size(cell, size), own or {}), Settings(**settings), own)


def run(
    cell: Cell, mdp: OrdinalMDP, values: Floats, settings: Settings, own: Owned | None = None
) -> Run:
    """Make the run of a cell, on one thread.

    Parameters
    ----------
    cell : mapping
        The names of its "learner" and "comparator", "error_rate" of the tutor (or the name of a
        tutor in ``own``), "audit" (share of the decided pairs) and "seed". Audited runs are
        shorter, because contradictions show early. "always" has no budget. With an error rate of 0
        the tutor is truthful. In place of an error rate, "c" is the precision of the paper's eq.
        (6) in the paper's units, discounted counts times the hidden values as they are.
    mdp : OrdinalMDP
        The problem.
    values : (k,)
        The hidden scale, worst level first.
    settings : Settings
        The settings of the run. ``AblationSettings`` are such settings.
    own : mapping, optional
        Factories in place of those in ``COMPARATORS``, ``LEARNERS`` and ``TUTORS``, by
        "comparator", "learner" and "error_rate": see ``ablation.ablate``. A user's own learner has
        its own settings, including the budget.

    Returns
    -------
    Run
        The row of the table, and the numbers for a comparison with the oracle's run.

    Raises
    ------
    ValueError
        If a user's factory fails or returns something else.
    InconsistentAnswers
        If the tutor contradicts itself in a run without audits, and the comparator takes answers as
        facts.
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
    """Return a tutor who errs by the paper's eq. (6), with precision c per discounted return.

    The hidden values (k,) are not brought to 0..1 first. So c is multiplied by their range over 1 -
    discount, because ``BradleyTerryTutor`` counts its precision per value range of shares.
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
    """Return the settings of a single cell."""
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
    """Return the MDP and hidden values (k,) of one of ``PROBLEMS``. Raises its maker's errors."""
    return PROBLEMS[problem].instance(seed, size)


def _problem_of(cell: Cell, size: Size, own: Owned) -> tuple[OrdinalMDP, Floats]:
    """Return the MDP and the hidden values (k,) of a cell.

    A user's own problem is made again each time, because files that it reads may have changed.
    """
    given = own.get("problem")
    return (
        problem_of(given, cell["seed"]) if given else instance(cell["problem"], cell["seed"], size)
    )


def _size(cell: Cell, size: Mapping[str, Any]) -> Size:
    whole = {**size, **cell}
    return whole["states"], whole["actions"], whole["levels"], whole["discount"]


def _cost(cell: Cell) -> float:
    """Return a number by which runs are ordered: those with the largest begin first.

    Oracles come first: all other runs are paired with them, so that an interrupted sweep has its
    pairs. Then come the runs that take the longest.
    """
    if is_oracle(cell):
        return math.inf
    size = cell.get("levels", 1) * (1 + cell.get("states", 0) / 500)
    entry = COMPARATORS.get(cell["comparator"])
    slow = (entry.cost if entry else 1.0) * (2.0 if cell["error_rate"] else 1.0)
    return float(size * slow / (10.0 if cell["audit"] else 1.0))


def _beside_oracles(results: Iterable[Any], best_policy: Container[str]) -> pd.DataFrame:
    """Return the table of the runs that have finished, with columns against the oracle's runs.

    Learners in ``best_policy`` do not run with a comparator that never learns, and so have no
    oracle. Their losses are taken against the best policy.
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
