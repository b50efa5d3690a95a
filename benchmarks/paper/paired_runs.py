"""One run of the paper's algorithm by its settings, and its differences to another one with the
same seed.

A run is named by a ``Choice``; runs with the same seed have the same MDP, hidden values,
transitions and actions, so that what differs is what the choice does.
"""

from __future__ import annotations

import time
import warnings
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy import stats

from benchmarks import quotes
from benchmarks.reporting import save, with_interval
from benchmarks.stamps import sources
from elicit import (
    AlwaysAsk,
    BradleyTerryComparator,
    BradleyTerryTutor,
    PolytopeComparator,
    TruthfulTutor,
)
from elicit.comparators.bradley_terry.bootstrap_comparator import NotConverged
from elicit.model.scale import Floats
from qlearn import InteractiveQLearning, OrdinalMDP, drive, policy_loss, random_mdp
from qlearn.experiments.metrics import (
    counts,
    estimated_values,
    greatest_reward,
    paper_loss,
    reference_differences,
)
from qlearn.experiments.parallel import sweep
from qlearn.learners.exploration import Exploration, Start
from qlearn.learners.q_learning import LearningRate, polynomial_rate

ACTIONS = 5
Size: TypeAlias = tuple[int, int, int]
"""Numbers of states, levels and steps."""


@dataclass(frozen=True)
class Choice:
    """The settings of a run, all such as JSON can hold; by default those of ``qlearn figures``.

    ``comparator`` "box" is the paper's own (``BradleyTerryComparator`` with ``region="box"``),
    "polytope" that of its section 3.1; ``settings`` are keywords of either. ``first_level`` "free":
    e_1 is a parameter like the others, and vectors start at zero (see ``with_nothing``); then
    ``start`` is not looked at. ``error_rate``: how often the tutor errs in an optimal policy's open
    comparisons; 0: never.
    """

    comparator: Literal["box", "polytope"] = "box"
    settings: Mapping[str, Any] = field(default_factory=dict)
    learning_rate: float | Literal["polynomial"] | None = None
    epsilon: float = 1.0
    start: Start = "worst"
    first_level: Literal["zero", "free"] = "zero"
    error_rate: float = 0.1
    weights: Literal["dirichlet", "gaussian"] = "dirichlet"


DEFAULT = Choice()


class Measured(NamedTuple):
    """The measurements of a run, in the order of its fields.

    - Questions, in percent of all comparisons of two different actions, and of those that dominance
      leaves open.
    - Figure 4's formula, in percent, signed as printed, against always asking a truthful tutor.
    - True policy loss beyond that oracle's, and the oracle's own, in percent of the value range.
    - Answers of the tutor that were wrong, in percent (nan if none was asked).
    - CPU seconds of the run, without the oracle's.
    """

    asked_of_all: float
    asked_of_open: float
    formula: float
    excess_loss: float
    oracle_loss: float
    errors_realised: float
    cpu_seconds: float


def measure(cell: Mapping[str, Any], steps: int) -> Measured:
    """One run and its oracle's; ``cell`` has the fields of a ``Choice`` and ``states``, ``levels``
    and ``seed``.
    """
    choice = Choice(**cell["choice"])
    seed: int = cell["seed"]
    mdp, values = random_mdp(
        cell["states"], ACTIONS, cell["levels"], seed=seed, weights=choice.weights
    )
    learned, worth = with_nothing(mdp, values) if choice.first_level == "free" else (mdp, values)
    truth = TruthfulTutor(worth)
    noisy = BradleyTerryTutor.from_error_rate
    tutor = (
        noisy(worth, choice.error_rate, reference_differences(learned, worth), seed)
        if choice.error_rate
        else truth
    )
    rate: LearningRate | None = (
        polynomial_rate if choice.learning_rate == "polynomial" else choice.learning_rate
    )
    start: Start = "worst" if choice.first_level == "free" else choice.start
    common: Any = {
        "steps": steps,
        "seed": seed,
        "learning_rate": rate,
        "epsilon": Exploration(choice.epsilon, start),
    }
    oracle = drive(InteractiveQLearning(learned, AlwaysAsk(learned.k), **common), truth)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotConverged)  # what becomes of such fits is a setting
        begun = time.process_time()
        learner = InteractiveQLearning(learned, _comparator(choice, learned.k, seed), **common)
        found = drive(learner, tutor, on_conflict="drop")
        seconds = time.process_time() - begun
    told = counts(found)
    v, best = (estimated_values(learned, result.q, worth) for result in (found, oracle))
    loss, least = (
        100 * float(policy_loss(mdp, result.policy, values).mean()) for result in (found, oracle)
    )
    return Measured(
        asked_of_all=told["asked_percent_all"],
        asked_of_open=told["asked_percent_open"],
        formula=paper_loss(v, best, greatest_reward(learned, worth)),
        excess_loss=loss - least,
        oracle_loss=least,
        errors_realised=100 * tutor.realised_error_rate,
        cpu_seconds=seconds,
    )


def with_nothing(mdp: OrdinalMDP, values: Floats) -> tuple[OrdinalMDP, Floats]:
    """Return the same problem and its values over k + 1 levels.

    The worst level, "nothing", is earned by no action and is worth 0. All vectors start on it. So
    the
    shares of the other k are the paper's counting vectors from the zeros of line 4, times 1 -
    discount,
    and gap 1 is e_1 - 0. Three things follow. First, e_1 is one more parameter of the fit, as in
    eq. (7). Second, comparisons are of the values as they are drawn; e_1 = 0 is not assumed. Third,
    eq. (4) counts all rewards too. If e_1 is drawn as 0, nothing is worth a millionth less, because
    values must increase.
    """
    labels = ("nothing", *mdp.labels)
    longer = OrdinalMDP(
        mdp.successors,
        mdp.probabilities,
        mdp.levels + 1,
        mdp.discount,
        labels,
        initial=mdp.initial,
    )
    return longer, np.concatenate([[min(0.0, values[0] - 1e-6)], values])


def _comparator(choice: Choice, k: int, seed: int) -> BradleyTerryComparator | PolytopeComparator:
    if choice.comparator == "polytope":
        return PolytopeComparator(k, **choice.settings)
    settings = {"n_boot": 50, "refit_growth": 0.2, "precision": 300.0} | dict(choice.settings)
    return BradleyTerryComparator(k, region="box", seed=seed, **settings)


def measure_all(
    choices: Sequence[Choice], seeds: Sequence[range], size: Size, journal: Path | None, jobs: int
) -> list[dict[str, Floats]]:
    """Measure each choice over its ``seeds`` (n,). A journal keeps finished runs."""
    states, levels, steps = size
    cells = [
        {"choice": asdict(choice), "states": states, "levels": levels, "seed": seed}
        for choice, its in zip(choices, seeds, strict=True)
        for seed in its
    ]
    made_of = sources(__name__)  # a row of other code is none of these
    own = {"own": lambda cell: (made_of, {})}
    rows = iter(sweep(measure, cells, shared={"steps": steps}, journal=journal, jobs=jobs, **own))
    found = [np.array([next(rows) for _ in its], dtype=np.float64).T for its in seeds]
    return [dict(zip(Measured._fields, columns, strict=True)) for columns in found]


def cells_of(
    found: Mapping[str, Floats],
    base: Mapping[str, Floats] | None,
    measures: Mapping[str, tuple[str, int]],
) -> list[str]:
    """A line's cells: of each of the ``measures``, name to heading and digits, the mean of a choice
    and its 95% t-interval; with a ``base`` that of the differences from it, by seed. Empty where a
    number is missing."""
    texts = []
    for name, (_, digits) in measures.items():
        x = found[name] if base is None else found[name] - base[name][: len(found[name])]
        texts.append("" if np.isnan(x).any() else with_interval(x, digits, base is not None))
    return texts


def answer(differences: Floats, least: float) -> str:
    """Return "more", "less", "as much" or "inconclusive" for paired differences (n,) of a measure.

    It is "more" or "less" if their 95% interval excludes 0, and "as much" if the interval lies
    within ``least`` on both sides.
    """
    mean, half = float(np.mean(differences)), _half_width(differences)
    if abs(mean) > half:
        return "more" if mean > 0 else "less"
    return "as much" if abs(mean) + half <= least else "inconclusive"


def _half_width(x: Floats) -> float:
    return float(stats.t.ppf(0.975, len(x) - 1) * stats.sem(x)) if len(x) > 1 else float("inf")


def parser_of(program: str, does: str) -> ArgumentParser:
    """The command line that the programs on paired runs have in common; each adds its steps and
    seeds.
    """
    parser = ArgumentParser(f"python -m {program}", description=does.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a tiny setting (seconds)")
    parser.add_argument(
        "--out",
        type=Path,
        help="also write the report to this file, and what other pages quote of it",
    )
    parser.add_argument(
        "--journal", type=Path, help="keep finished runs in this file, and go on from there"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    return parser


def save_quoted(lines: Sequence[str], out: Path | None, seeds: int) -> None:
    """Write a report to the file, if one is given, and renew what other pages quote of it."""
    save("\n".join(lines), out, f"0-{seeds - 1}")
    if out is not None:
        quotes.renew_beside(out)
