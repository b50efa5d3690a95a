"""Gain by asking, at most: the loss of acting as if the gaps between levels were equal.

    python -m benchmarks.asking.headroom --out benchmarks/RESULTS-headroom.md    a few minutes
    python -m benchmarks.asking.headroom --problems 5                            rough figures

The families of ``qlearn.problems``, random MDPs of the paper's law and ICU-Sepsis, each with hidden
scales of several kinds. Nobody is asked: what is lost is what questions can save.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.reporting import machine, markdown, publish, with_interval
from elicit.model.scale import Floats
from qlearn.mdp.equal_gaps import equal_gaps_policy, unasked_loss
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions
from qlearn.problems.families.catalogue import FAMILIES
from qlearn.problems.hidden_scales import hidden_scales
from qlearn.problems.icu_sepsis import icu_sepsis
from qlearn.problems.random_mdp import random_mdp

SCALES: Mapping[str, str] = {
    "even": "Gaps between neighbouring levels drawn uniformly from all that total 1: Dirichlet(1).",
    "skewed": "Gaps drawn from Dirichlet(.3): a few of them make up most of the range.",
    "convex": "A power of evenly spaced values, from 1.5 to 5: the bad levels lie close together.",
    "concave": "The same mirrored: the good levels lie close together.",
}
RANDOM = {f"random MDP, k = {k}": k for k in (5, 10, 20)}
ICU = "ICU-Sepsis"
PROBLEMS = (*FAMILIES, *RANDOM, ICU)
ENOUGH = 0.01  # a loss within which a policy counts as good enough without a question
WORST, INITIAL = 0, 1
MUCH = {WORST: 5.0, INITIAL: 3.0}  # percent of the value range


def problem(name: str, seed: int) -> OrdinalMDP:
    """Return the problem of this name and seed; ICU-Sepsis is always the same."""
    if name in FAMILIES:
        return FAMILIES[name](seed)
    return random_mdp(100, 5, RANDOM[name], seed=seed)[0] if name in RANDOM else _icu()[0]


@cache
def _icu() -> tuple[OrdinalMDP, Actions]:
    mdp = icu_sepsis()
    return mdp, equal_gaps_policy(mdp)


def losses(name: str, seeds: Sequence[int], kinds: Sequence[str]) -> dict[str, Floats]:
    """Return losses (seeds, 2) in percent by kind of scale: at the worst state, from the start."""
    found: dict[str, list[tuple[float, float]]] = {kind: [] for kind in kinds}
    for seed in seeds:
        mdp = problem(name, seed)
        policy = _icu()[1] if name == ICU else equal_gaps_policy(mdp)
        for kind in kinds:
            found[kind].append(unasked_loss(mdp, hidden_scales(kind, mdp.k, seed), policy))
    return {kind: 100 * np.array(each) for kind, each in found.items()}


def described(name: str, drawn: Floats) -> list[str]:
    """Return one row of a table of losses."""
    cells = [name]
    for column in drawn.T:
        enough = np.mean(column <= 100 * ENOUGH)
        cells += [
            with_interval(column, 1),
            f"{np.quantile(column, 0.9):.1f}",
            f"{column.max():.1f}",
        ]
        cells.append(f"{enough:.0%}")
    return cells


def sized(name: str) -> list[str]:
    """Return one row of the table of sizes."""
    mdp = problem(name, 0)
    ends = int(np.count_nonzero(mdp.terminal))
    sizes = (mdp.n_states, ends, mdp.n_actions, mdp.k, mdp.discount)
    return [name, *(f"{size:g}" for size in sizes)]


HEAD = [
    "problem",
    *(
        f"{place} {measure}"
        for place in ("worst", "start")
        for measure in ("mean", "90%", "most", "within 1%")
    ),
]


def summary(found: Mapping[str, Mapping[str, Floats]]) -> str:
    """Return a sentence on the number of families that lose much on evenly spaced scales."""
    means = np.array([found[name]["even"].mean(axis=0) for name in FAMILIES])
    worst, initial = (
        int(np.count_nonzero(means[:, column] >= MUCH[column])) for column in (WORST, INITIAL)
    )
    return (
        f"On even scales {worst} of {len(FAMILIES)} families lose {MUCH[WORST]:g}% or more in "
        f"the mean at the worst state, and {initial} lose {MUCH[INITIAL]:g}% or more from where "
        "episodes start."
    )


def report(problems: int) -> Iterator[list[str]]:
    """The parts of the page."""
    yield ["# Headroom: what is lost if nothing is asked", "", machine()]
    found = {name: losses(name, range(problems), [*SCALES]) for name in PROBLEMS}
    yield [
        "The policy is the best one if all gaps between neighbouring levels were equal: the "
        "guess of somebody who asks nobody. Its loss under a hidden scale is the most that "
        "questions can save. Where it is small, a learner that asks well cannot be told from "
        "one that asks badly. A loss is in percent of the value range, in the unit of "
        "`Result.loss_bound`: (1 - discount) times the loss of return, over the value of the "
        "best level against the worst.",
        "",
        f"Each row is of {problems} draws of the problem and the scale (seeds 0 to "
        f"{problems - 1}; ICU-Sepsis has one problem): the mean with its 95% t-interval, the 90% "
        "quantile, the most, and the share of draws that lose 1% or less. *Worst*: at the worst "
        "state; *start*: from the initial distribution.",
        "",
        summary(found),
    ]
    for kind, text in SCALES.items():
        rows = [described(name, found[name][kind]) for name in PROBLEMS]
        yield [f"## Hidden scale: {kind}", "", text, "", *markdown(HEAD, rows, 1)]
    head = ("problem", "states", "terminal", "actions", "levels", "discount")
    yield ["## Sizes", "", *markdown(head, [sized(name) for name in PROBLEMS], 1)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.asking.headroom", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--problems", type=int, default=40, help="draws of each row (default: 40)")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    publish(report(given.problems), given.out, f"0-{given.problems - 1}")


if __name__ == "__main__":
    main()
