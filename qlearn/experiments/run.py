"""One run of the ablation: a learner, a comparator, a tutor and a problem, from the few words that name them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from inspect import signature
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np

from elicit.comparators.baselines import AlwaysAsk
from elicit.comparators.bradley_terry.bootstrap_comparator import BradleyTerryComparator
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.comparators.polytope.relaxed_comparator import RelaxedPolytopeComparator
from elicit.model.comparator import Comparator
from elicit.model.scale import Floats
from elicit.tutors.simulated import BradleyTerryTutor, FlippingTutor, TruthfulTutor
from qlearn.experiments import compile_ahead
from qlearn.experiments.metrics import Watch, audits, counts, estimated_values, reference_differences
from qlearn.experiments.parallel import Unfinished, sweep
from qlearn.experiments.threads import one_thread
from qlearn.learners.learner import drive
from qlearn.learners.q_learning import InteractiveQLearning
from qlearn.learners.value_iteration import InteractiveValueIteration
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import policy_loss, value_iteration
from qlearn.problems.gymnasium import deep_sea_treasure, frozen_lake
from qlearn.problems.random_mdp import draw_values, icu_sepsis, random_mdp

__all__ = ["Cell", "Run", "Size", "instance", "run", "run_all", "run_named", "sources"]

T = TypeVar("T")
Cell: TypeAlias = dict[str, Any]
Size: TypeAlias = tuple[int, int, int, float]
"""Of the random MDPs: states, actions, levels, discount."""

REAL: Mapping[str, Callable[[], OrdinalMDP]] = MappingProxyType(
    {"icu": icu_sepsis, "frozen-lake": frozen_lake, "deep-sea-treasure": deep_sea_treasure}
)
_NO_RUNS = (
    "cli",
    "paper",
    "experiments/ablation.py",
    "experiments/ablation_plot.py",
    "experiments/compile_ahead.py",
    "experiments/label_placement.py",
)  # sources of qlearn that no run depends on


class Run(NamedTuple):
    """One finished run: its row of the table, and v (S,) of figure 4 for the comparison with the oracle's."""

    row: Cell
    v: Floats


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during many runs; ``frame``, a pandas DataFrame, holds those that had finished."""

    def __init__(self, frame: Any) -> None:
        super().__init__(f"interrupted after {len(frame)} runs")
        self.frame = frame


def run(
    cell: Cell,
    mdp: OrdinalMDP,
    values: Floats,
    *,
    steps: int = 100_000,
    epsilon: float = 1.0,
    exploration: str | None = None,
    indifference: float = 0.0,
    close: float = 0.005,
    tolerance: float = 0.005,
    max_sweeps: int = 200,
    max_queries: int | None = 2000,
    audit_steps: int = 2000,
    audit_sweeps: int = 20,
    precision: float = 300.0,
    n_boot: int = 50,
    level: float = 0.95,
    refit_growth: float = 0.05,
    lapse: float = 0.1,
    particles: int = 1000,
    slack: float = 0.0,
    noise: Literal["flip", "logistic"] = "flip",
) -> Run:
    """One run of one cell, on one thread.

    steps, epsilon  of Q-learning. An epsilon of 1 explores uniformly: then all comparators see the same transitions,
                    and losses differ by verdicts alone
    exploration     of Q-learning, by name (``exploration.EXPLORATIONS``), in place of epsilon
    indifference    of Q-learning, share of the value range; value iteration derives its own from the tolerance
    close           indifference of Q-learning with "posterior-close"
    tolerance       of value iteration: policy loss with right verdicts, share of the value range
    max_sweeps      of value iteration; a tutor who errs anew each time would keep it going for ever
    max_queries     question budget, None for none; "always" has none
    audit_steps, audit_sweeps   no more of an audited run: contradictions show early
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
        region: Any = "box" if name == "box-rescaled" else name
        rescale = name == "box-rescaled"
        common_fit: dict[str, Any] = {"n_boot": n_boot, "level": level, "refit_growth": refit_growth, "seed": seed}
        comparator = BradleyTerryComparator(k, precision=precision, region=region, rescale=rescale, **common_fit)
    if name == "posterior-close":
        indifference = close
    indifference = tolerance * (1 - mdp.discount) / 2 if ivi else indifference
    if cell["audit"]:
        steps, max_sweeps = min(steps, audit_steps), min(max_sweeps, audit_sweeps)
    common = {"rng": seed, "max_queries": max_queries, "indifference": indifference, "audit": cell["audit"]}
    with one_thread():
        tutor = _tutor(noise, rate, mdp, values, seed)
        learner: InteractiveValueIteration | InteractiveQLearning = (
            InteractiveValueIteration(mdp, comparator, tolerance=tolerance, max_sweeps=max_sweeps, **common)
            if ivi
            else InteractiveQLearning(
                mdp,
                comparator,
                steps=steps,
                exploration=exploration,
                epsilon=epsilon if exploration is None else None,
                **common,
            )
        )
        watch = Watch(values, indifference, erred=lambda: tutor.realised_error_rate > 0)
        learner.watch(watch)
        start = perf_counter()
        result = drive(learner, tutor, on_conflict="drop" if cell["audit"] else "raise")
        seconds = perf_counter() - start
        loss = policy_loss(mdp, result.policy, values, optimum=_optimum(mdp, tuple(values)))
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


def run_named(cell: Cell, size: Size, built: str, settings: dict[str, Any]) -> Run:
    """``run``, by a worker that makes the problem itself (once): a task is a few hundred bytes, a table of ICU-Sepsis
    40 MB. Raises RuntimeError if this process's ``sources`` are not those ``built`` names."""
    if built != sources():
        raise RuntimeError("this worker has other sources or libraries than the process that started the sweep")
    return run(cell, *instance(cell["problem"], cell["seed"], tuple(size)), **settings)


def run_all(
    function: Callable[..., Run],
    plan: Sequence[Cell],
    paired: Callable[[Iterable[Any]], T],
    *,
    shared: dict[str, Any],
    settings: dict[str, Any],
    **how: Any,
) -> T:
    """What ``paired`` makes of the rows of all cells, ``how`` as ``sweep`` has it. The function gets ``shared``, the
    ``settings`` of ``run``, defaults included, and what it was ``built`` of. Raises Interrupted on Ctrl-C, with what
    ``paired`` makes of those that had finished."""
    arguments = signature(run).bind(None, None, None, **settings)
    arguments.apply_defaults()  # named or not, a default is the same setting
    given = {name: value for name, value in arguments.arguments.items() if name not in ("cell", "mdp", "values")}
    shared = shared | {"built": sources(), "settings": given}
    try:
        rows = sweep(function, plan, shared=shared, ahead=compile_ahead.parts, **how)
    except Unfinished as stopped:
        raise Interrupted(paired(stopped.rows)) from None
    return paired(rows)


@lru_cache(maxsize=32)
def instance(problem: str, seed: int, size: Size) -> tuple[OrdinalMDP, Floats]:
    """The MDP and the hidden values (k,) of a problem: "random" (``size`` says which), or one of ``REAL``, whose values
    come from ``draw_values``. Raises as their makers do."""
    if problem in REAL:
        mdp = _real(problem)
        return mdp, draw_values(mdp.k, rng=seed)
    return random_mdp(*size, rng=seed)


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


@cache
def _real(problem: str) -> OrdinalMDP:
    return REAL[problem]()  # takes seconds


@lru_cache(maxsize=32)
def _optimum(mdp: OrdinalMDP, values: tuple[float, ...]) -> Floats:
    return value_iteration(mdp, values)[0]


@lru_cache(maxsize=32)
def _reference(mdp: OrdinalMDP, values: tuple[float, ...]) -> Floats:
    return reference_differences(mdp, values)


def _tutor(
    noise: str, rate: float, mdp: OrdinalMDP, values: Floats, seed: int
) -> TruthfulTutor | FlippingTutor | BradleyTerryTutor:
    if noise not in ("flip", "logistic"):
        raise ValueError(f"noise must be 'flip' or 'logistic', not {noise!r}")
    if rate == 0:
        return TruthfulTutor(values)
    if noise == "flip":
        return FlippingTutor(values, rate, seed)
    return BradleyTerryTutor.from_error_rate(values, rate, _reference(mdp, tuple(values)), seed)
