"""The number of questions with cuts and without, on problems that the rule was not chosen on.

    python -m benchmarks.asking.cuts_and_pairs --out benchmarks/RESULTS-cuts.md    half an hour
    python -m benchmarks.asking.cuts_and_pairs --problems 1                        rough figures

Policy iteration with the polytope and a truthful tutor, on the families of ``qlearn.problems`` and
on random MDPs. Seeds 100 to 105 chose when a cut is asked; the page is of seeds from 200 on.
``--journal FILE`` keeps finished runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.reporting import machine, main_by_seeds, markdown, with_interval
from elicit import PolytopeComparator, TruthfulTutor
from elicit.model.scale import Floats
from qlearn import InteractivePolicyIteration, drive, hidden_scales, policy_loss, random_mdp
from qlearn.experiments.parallel import Cell, sweep
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.problems.families.catalogue import FAMILIES

FIRST = 200
KINDS = ("even", "skewed")
TOLERANCES = (0.01, 0.001, 0.00005)
MOST = 400
RANDOM = {f"random MDP, k = {k}": k for k in (5, 10, 20)}
PROBLEMS = (*FAMILIES, *RANDOM)
HEAD = ("problem", "tolerance", "pairs only", "with cuts", "difference", "most", "violated")


def problem(name: str, seed: int) -> OrdinalMDP:
    """Return the problem of this name and seed."""
    if name in RANDOM:
        return random_mdp(100, 5, RANDOM[name], seed=seed)[0]
    return FAMILIES[name](seed)


def run(cell: Cell) -> dict[str, Any]:
    """Solve one problem twice: with pairs only, and as the default does."""
    mdp = problem(cell["problem"], cell["seed"])
    values = hidden_scales(cell["kind"], mdp.k, cell["seed"])
    found: dict[str, Any] = {}
    for name, cuts in (("pairs", False), ("cuts", None)):
        learner = InteractivePolicyIteration(
            mdp,
            PolytopeComparator(mdp.k),
            tolerance=cell["tolerance"],
            cuts=cuts,
            max_queries=MOST,
        )
        result = drive(learner, TruthfulTutor(values))
        loss = policy_loss(mdp, result.policy, values).max()
        found[name] = result.asked
        found[f"{name} violated"] = bool(loss > result.loss_bound + 1e-12)
    return found


def row(name: str, tolerance: float, runs: Sequence[dict[str, Any]]) -> list[str]:
    """Return the cells of one problem and tolerance."""
    pairs, cuts = (np.array([one[way] for one in runs], dtype=float) for way in ("pairs", "cuts"))
    violated = sum(one[f"{way} violated"] for one in runs for way in ("pairs", "cuts"))
    return [
        name,
        f"{100 * tolerance:g}%",
        with_interval(pairs, 1),
        with_interval(cuts, 1),
        with_interval(cuts - pairs, 1, signed=True),
        f"{max(pairs.max(), cuts.max()):.0f}",
        str(violated),
    ]


def verdict(found: dict[tuple[str, float], Floats]) -> str:
    """Return a sentence on where cuts take significantly more or fewer questions."""
    more, fewer = [], []
    for (name, tolerance), difference in found.items():
        half = stats.t.ppf(0.975, len(difference) - 1) * stats.sem(difference)
        place = f"{name} at {100 * tolerance:g}%"
        if difference.mean() > half:
            more.append(place)
        elif difference.mean() < -half:
            fewer.append(place)
    return (
        f"Significantly more questions with cuts (95%, {len(found)} comparisons, of which chance "
        f"alone would give {0.025 * len(found):.0f}): {'; '.join(more) or 'none'}. Significantly "
        f"fewer: {'; '.join(fewer) or 'none'}."
    )


def report(problems: int, **how: Any) -> Iterator[list[str]]:
    """The parts of the page."""
    yield [
        "# Cuts and pairs",
        "",
        machine(),
        "",
        "Questions until policy iteration has proven a policy, with the polytope and a truthful "
        "tutor: asking about pairs of actions only (`cuts=False`), and by default, where a cut is "
        "asked if it promises twice as much as the pair. Means with 95% t-intervals over "
        f"{problems} problems (seeds from {FIRST} on) for each of two kinds of hidden scale, "
        f"{' and '.join(KINDS)}. *Difference*: paired, with cuts minus without. *Most*: the most "
        "questions of a run. *Violated*: runs whose true loss exceeded the stated bound.",
    ]
    settings = list(product(PROBLEMS, TOLERANCES))
    cells = [
        {"problem": name, "tolerance": tolerance, "kind": kind, "seed": seed}
        for name, tolerance in settings
        for kind in KINDS
        for seed in range(FIRST, FIRST + problems)
    ]
    runs = iter(sweep(run, cells, **how))
    rows, found = [], {}
    for name, tolerance in settings:
        part = [next(runs) for _ in range(len(KINDS) * problems)]
        rows.append(row(name, tolerance, part))
        found[name, tolerance] = np.array([one["cuts"] - one["pairs"] for one in part], dtype=float)
    yield [verdict(found), "", *markdown(HEAD, rows, 1)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    program = "benchmarks.asking.cuts_and_pairs"
    main_by_seeds(program, report, FIRST, ("problems", 6, "a row and kind"), arguments)


if __name__ == "__main__":
    main()
