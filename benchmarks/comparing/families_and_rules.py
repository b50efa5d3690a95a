"""The default beside the other strategies on the families, on problems that no rule was chosen on.

    python -m benchmarks.comparing.families_and_rules --out benchmarks/RESULTS-families.md
        # 20 minutes
    python -m benchmarks.comparing.families_and_rules --problems 2
        # rough figures

Policy iteration with the polytope and a truthful tutor, to a loss of 1%. ``--journal FILE`` keeps
finished runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.reporting import machine, main_by_seeds, markdown, with_interval
from elicit import PolytopeComparator, TruthfulTutor
from qlearn import (
    InteractivePolicyIteration,
    drive,
    equal_gaps_policy,
    hidden_scales,
    policy_loss,
    strategies,
    unasked_loss,
)
from qlearn.experiments.parallel import Cell, sweep
from qlearn.problems.families.catalogue import FAMILIES

FIRST = 400  # seeds below were used to choose rules
KINDS = ("even", "skewed")
TOLERANCE = 0.01
MOST = 200
DEFAULT = "telling_violation"
RULES = (DEFAULT, "mutual_information", "most_even_cut", "max_regret", "widest_bound", "first_come")
HEAD = ("problem", "asked nothing", "default", *(name.replace("_", " ") for name in RULES[1:]))


def run(cell: Cell) -> dict[str, Any]:
    """Solve one problem by each rule: the numbers of questions, and bounds that were violated."""
    mdp = FAMILIES[cell["problem"]](cell["seed"])
    values = hidden_scales(cell["kind"], mdp.k, cell["seed"])
    found: dict[str, Any] = {
        "unasked": unasked_loss(mdp, values, equal_gaps_policy(mdp)).worst,
        "violated": 0,
        "spent": 0,
    }
    for name in RULES:
        learner = InteractivePolicyIteration(
            mdp,
            PolytopeComparator(mdp.k),
            tolerance=TOLERANCE,
            strategy=getattr(strategies, name),
            max_queries=MOST,
        )
        result = drive(learner, TruthfulTutor(values))
        loss = policy_loss(mdp, result.policy, values).max()
        found[name] = result.asked
        found["violated"] += bool(loss > result.loss_bound + 1e-12)
        found["spent"] += result.asked >= MOST
    return found


def more(runs: Sequence[Mapping[str, Any]], name: str) -> tuple[float, float]:
    """Return how many questions a rule asks beyond the default: mean, half a 95% t-interval."""
    difference = np.array([one[name] - one[DEFAULT] for one in runs], dtype=float)
    half = stats.t.ppf(0.975, len(difference) - 1) * stats.sem(difference)
    return float(difference.mean()), float(half)


def row(name: str, runs: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the cells of one family: the default's questions, and the others' beyond them."""
    cells = [
        name,
        with_interval([100 * one["unasked"] for one in runs], 1),
        with_interval([one[DEFAULT] for one in runs], 1),
    ]
    return cells + ["{:+.1f} ± {:.1f}".format(*more(runs, rule)) for rule in RULES[1:]]


def verdict(found: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return a sentence on where a rule asks significantly fewer or more than the default."""
    fewer, greater = [], 0
    for name, runs in found.items():
        for rule in RULES[1:]:
            mean, half = more(runs, rule)
            greater += mean > half
            if mean < -half:
                fewer.append(f"{rule.replace('_', ' ')} on {name}")
    every = [one for runs in found.values() for one in runs]
    total = len(found) * (len(RULES) - 1)
    return (
        f"Of {total} comparisons with the default (95%; chance alone would give "
        f"{0.025 * total:.1f} each way) a rule asks significantly fewer questions in "
        f"{len(fewer)} ({'; '.join(fewer) or 'none'}), and significantly more in {greater}. "
        f"{sum(one['violated'] for one in every)} of {len(every) * len(RULES)} bounds were "
        f"violated, and {sum(one['spent'] for one in every)} runs reached the limit of {MOST} "
        "questions."
    )


def report(problems: int, **how: Any) -> Iterator[list[str]]:
    """The parts of the page."""
    yield [
        "# Which question next, on the families",
        "",
        machine(),
        "",
        "Questions until policy iteration has proven a loss of at most 1%, with the polytope and a "
        "truthful tutor: the default, and by how many more questions (paired) each other strategy "
        "of `qlearn.strategies` takes. Means with 95% t-intervals over "
        f"{problems} problems (seeds from {FIRST} on) for each of two kinds of hidden scale, "
        f"{' and '.join(KINDS)}. *Asked nothing*: the loss at the worst state of the policy that "
        "is best for equal gaps, in percent. All strategies may ask cuts, as is the default.",
    ]
    cells = [
        {"problem": name, "kind": kind, "seed": seed}
        for name in FAMILIES
        for kind in KINDS
        for seed in range(FIRST, FIRST + problems)
    ]
    runs = iter(sweep(run, cells, **how))
    found = {name: [next(runs) for _ in range(len(KINDS) * problems)] for name in FAMILIES}
    every = [one for part in found.values() for one in part]
    rows = [row(name, part) for name, part in found.items()]
    yield [verdict(found), "", *markdown(HEAD, [*rows, row("all", every)], 1)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    program = "benchmarks.comparing.families_and_rules"
    main_by_seeds(program, report, FIRST, ("problems", 12, "a family and kind"), arguments)


if __name__ == "__main__":
    main()
