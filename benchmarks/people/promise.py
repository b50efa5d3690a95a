"""Share of bounds that hold with tutors who err as people do: policy iteration, the posterior.

    python -m benchmarks.people.promise --journal results/promise.jsonl \
        --out benchmarks/RESULTS-promise.md

The journal keeps finished runs: the same command goes on where it was stopped. ``--runs`` says how
many runs a row has, and the runs of all rows go side by side.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.reporting import machine, markdown, publish, with_interval
from benchmarks.stamps import sources
from elicit import PersonTutor, PosteriorComparator, Tutor
from elicit.model.scale import Floats
from qlearn import InteractivePolicyIteration, OrdinalMDP, drive, policy_loss, random_mdp
from qlearn.experiments.ablation import TUTORS as BY_RATE
from qlearn.experiments.parallel import Cell, sweep

LEVELS = (5, 10, 20)
STATES, ACTIONS = (15, 60), 3
TOLERANCE, BUDGET, ERROR = 0.01, 150, 0.1
FIRST = 1000  # seeds from here on: none of those on which anything was tried out
ROUND = 10  # seeds between two looks at the journal
MAKES: Mapping[str, Callable[[OrdinalMDP, Floats, int], Tutor]] = {
    "PersonTutor": lambda mdp, values, seed: PersonTutor(values, seed=seed),
    "eq. (6), 10%": lambda mdp, values, seed: BY_RATE["logistic"](mdp, values, ERROR, seed),
}
Row = dict[str, Any]
ABOUT = f"""\
Random MDPs of {" or ".join(map(str, STATES))} states and {ACTIONS} actions, each with a hidden
scale of its own. Policy iteration with the posterior as it comes, a tolerance of
{100 * TOLERANCE:g}% of the value range, {BUDGET} questions at most, sides at random. A run is one
problem and one tutor: a person drawn by `PersonTutor`, or eq. (6) with the precision that errs in
{100 * ERROR:g}% of the comparisons of an optimal policy.

*Held*: runs whose true loss at the worst state is within the bound that was stated, with the exact
binomial 95% interval. The bound is one of 95%, so 95 of 100 may be expected to hold. *Within*: runs
that ended with a bound within the tolerance. *Spent*: runs that used up the {BUDGET} questions.
*All asked*: runs that ended before, because each pair that could change the policy had been asked
about; no pair is asked about twice, and few states have few pairs. *Wrong*: answers that said the
opposite of the truth."""


def promised(cell: Cell) -> Row:
    """One run."""
    seed, k = cell["seed"], cell["k"]
    mdp, values = random_mdp(cell["states"], ACTIONS, k, seed=seed)
    tutor = MAKES[cell["tutor"]](mdp, values, seed)
    learner = InteractivePolicyIteration(
        mdp, PosteriorComparator(k, seed=seed), tolerance=TOLERANCE, max_queries=BUDGET
    )
    result = drive(learner, tutor, seed=seed)
    loss = float(policy_loss(mdp, result.policy, values).max())
    said = result.answers.y
    truth = result.answers.d @ (np.asarray(values) - values[0])
    return {
        "asked": result.asked,
        "status": result.status.name,
        "bound": float(result.loss_bound),
        "loss": loss,
        "held": bool(loss <= result.loss_bound + 1e-12),
        "equal": int((said == 0).sum()),
        "wrong": int((said * np.sign(truth) < 0).sum()),
    }


def cells(runs: int) -> list[Cell]:
    """The runs, seed by seed."""
    return [
        {"states": states, "k": k, "tutor": tutor, "seed": FIRST + i}
        for i in range(runs)
        for states in STATES
        for tutor in MAKES
        for k in LEVELS
    ]


def held(rows: Sequence[Row]) -> str:
    """The share of runs whose bound held, with its interval."""
    if not rows:
        return ""
    test = binomtest(sum(row["held"] for row in rows), len(rows))
    low, high = test.proportion_ci(method="exact")
    return f"{100 * test.statistic:.1f}% [{100 * low:.1f}, {100 * high:.1f}]"


def line(states: int, tutor: str, k: int, rows: Sequence[Row]) -> list[str]:
    """A row of the first table."""
    asked = [row["asked"] for row in rows]
    given = max(1, sum(asked))
    statuses = [row["status"] for row in rows]
    return [
        f"{states}",
        tutor,
        f"{k}",
        f"{len(rows)}",
        with_interval(asked, 1),
        f"{sum(row['bound'] <= TOLERANCE for row in rows)}",
        f"{statuses.count('GUESSED')}",
        f"{statuses.count('EXHAUSTED') + statuses.count('CALLED_EQUAL')}",
        f"{100 * np.median([row['bound'] for row in rows]):.2f}%",
        f"{100 * sum(row['wrong'] for row in rows) / given:.1f}%",
        f"{100 * sum(row['equal'] for row in rows) / given:.1f}%",
        held(rows),
    ]


def report(runs: int, **how: Any) -> Iterator[list[str]]:
    """The page."""
    from benchmarks.people import promise  # by the name that workers and the journal know

    plan = cells(runs)
    rows: list[Row] = []
    step = ROUND * len(STATES) * len(MAKES) * len(LEVELS)
    for first in range(0, len(plan), step):
        rows += sweep(promise.promised, plan[first : first + step], **how)
    done = list(zip(plan, rows, strict=True))
    yield ["# How often the bound holds with people", "", machine(), "", *ABOUT.splitlines(), ""]
    table = [
        line(
            states,
            tutor,
            k,
            [
                row
                for cell, row in done
                if (cell["states"], cell["tutor"], cell["k"]) == (states, tutor, k)
            ],
        )
        for states in STATES
        for tutor in MAKES
        for k in LEVELS
    ]
    head = ("states", "tutor", "levels", "runs", "questions", "within", "spent", "all asked",
            "bound, median", "wrong", "equal", "held")  # fmt: skip
    yield markdown(head, table, 2)
    yield ["", "## By what ended the run", ""]
    table = []
    for tutor in MAKES:
        own = [row for cell, row in done if cell["tutor"] == tutor]
        for status in sorted({row["status"] for row in own}):
            some = [row for row in own if row["status"] == status]
            worst = max(row["loss"] - row["bound"] for row in some)
            table.append(
                [tutor, status, f"{len(some)}", f"{100 * max(0.0, worst):.2f}%", held(some)]
            )
    yield markdown(("tutor", "status", "runs", "beyond the bound, at most", "held"), table, 2)
    yield ["", "## By how often the person said equal", ""]
    own = [row for cell, row in done if cell["tutor"] == "PersonTutor"]
    limits = (0.0, 1e-9, 0.1, 0.3, 1.01)
    table = []
    for low, high in pairwise(limits):
        some = [row for row in own if low <= row["equal"] / max(1, row["asked"]) < high]
        name = (
            "never"
            if high <= 1e-9
            else f"{'up to' if low < 0.1 else 'more, up to'} {min(high, 1):.0%}"
        )
        table.append([name, f"{len(some)}", held(some)])
    yield markdown(("said equal", "runs", "held"), table, 1)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.people.promise", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--runs", type=int, default=300, help="runs a row (default: 300)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument("--out", type=Path, help="the page to write")
    given = parser.parse_args(arguments)
    made_of = sources("benchmarks.people.promise")  # a row of other code is none of these
    how = {"journal": given.journal, "jobs": given.jobs, "own": lambda cell: (made_of, {})}
    seeds = f"{FIRST}-{FIRST + given.runs - 1}"
    publish(report(given.runs, **how), given.out, seeds)


if __name__ == "__main__":
    main()
