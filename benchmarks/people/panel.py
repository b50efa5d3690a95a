"""Five experts asked as a panel: is the bound for their mean held, and how many questions is that?

    python -m benchmarks.people.panel --out benchmarks/RESULTS-panel.md     about half an hour
    python -m benchmarks.people.panel --problems 2                          rough figures

Random MDPs and three families of problems where asking matters. Each expert has a scale of their
own, and policy iteration asks until the policy is within the tolerance for the mean of the scales.
Beside it stands what the same learner asks one of them, for the policy that is best for that one.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import stats

from benchmarks.reporting import machine, markdown, publish, with_interval
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.comparators.panel import Panel
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator
from elicit.model.scale import Floats, normalise
from elicit.model.tutor import Tutor
from elicit.tutors.simulated import FlippingTutor, TruthfulTutor
from qlearn.learners.driving import drive
from qlearn.learners.learner import Result
from qlearn.learners.policy_iteration import InteractivePolicyIteration
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import policy_loss
from qlearn.problems.families.catalogue import FAMILIES
from qlearn.problems.hidden_scales import hidden_scales
from qlearn.problems.random_mdp import random_mdp

PEOPLE = ("ann", "ben", "chen", "dora", "eve")
TOLERANCE = 0.01
MOST = 300  # questions of a run
RANDOM = "random MDP, k = 5"
SMALL = "small random MDP, k = 4"
PROBLEMS = (SMALL, RANDOM, "rover", "surgery", "care")
MORE = 10  # times as many runs of the small problems, to see how often bounds are held
SCALES = {
    "independent": "each expert's scale is drawn for itself",
    "alike": "all experts have one scale, but for a tenth",
}
ERRORS = {"never": 0.0, "10% flipped": 0.1}


class Run(NamedTuple):
    """One run: questions of the panel, the mean of one expert, the true loss, and the bounds."""

    asked: int
    alone: float
    loss: float
    bound: float
    confidence: float
    members_held: bool
    finished: bool


def problem(name: str, seed: int) -> OrdinalMDP:
    """Return the problem of this name and seed."""
    if name == SMALL:
        return random_mdp(12, 3, 4, discount=0.9, seed=seed)[0]
    return random_mdp(50, 4, 5, seed=seed)[0] if name == RANDOM else FAMILIES[name](seed)


def seeds_of(name: str, problems: int) -> int:
    """Return the number of runs of a problem's rows."""
    return MORE * problems if name == SMALL else problems


def scales(kind: str, k: int, seed: int) -> dict[str, Floats]:
    """Return the scale (k,) of each expert."""
    drawn = {name: hidden_scales("even", k, 1000 * seed + i) for i, name in enumerate(PEOPLE)}
    if kind == "independent":
        return drawn
    shared = hidden_scales("even", k, 1000 * seed + 999)
    return {name: normalise(0.9 * shared + 0.1 * own) for name, own in drawn.items()}


def one_run(name: str, kind: str, errs: str, seed: int) -> Run:
    """Return what a panel of five, and each of the five alone, came to."""
    mdp, rate = problem(name, seed), ERRORS[errs]
    values = scales(kind, mdp.k, seed)

    def comparator(i: int) -> Comparator:
        return PosteriorComparator(mdp.k, seed=seed + i) if rate else PolytopeComparator(mdp.k)

    def tutor(who: str, i: int) -> Tutor:
        if rate:
            return FlippingTutor(values[who], rate, seed=100 * seed + i)
        return TruthfulTutor(values[who])

    def solved(known: Comparator, tutors: Mapping[str, Tutor] | Tutor) -> Result:
        run = InteractivePolicyIteration(mdp, known, tolerance=TOLERANCE, max_queries=MOST)
        return drive(run, tutors)

    panel = Panel({who: comparator(i) for i, who in enumerate(PEOPLE)})
    found = solved(panel, {who: tutor(who, i) for i, who in enumerate(PEOPLE)})
    alone = [solved(comparator(i), tutor(who, i)).asked for i, who in enumerate(PEOPLE)]
    mean = normalise(np.mean([values[who] for who in PEOPLE], axis=0))
    each = {who: policy_loss(mdp, found.policy, values[who]).max() for who in PEOPLE}
    bounds = found.member_loss_bounds
    return Run(
        found.asked,
        float(np.mean(alone)),
        float(policy_loss(mdp, found.policy, mean).max()),
        found.loss_bound,
        found.confidence,
        all(each[who] <= bounds[who] + 1e-9 for who in PEOPLE),
        found.loss_bound <= TOLERANCE,
    )


def runs(
    name: str, kind: str, errs: str, seeds: Sequence[int], journal: Path | None = None
) -> list[Run]:
    """Return the runs of a row. Those in the journal are not made again."""
    kept = {}
    if journal is not None and journal.exists():
        kept = dict(map(json.loads, journal.read_text(encoding="utf-8").splitlines()))
    found = []
    for seed in seeds:
        key = f"{name}/{kind}/{errs}/{seed}"
        if key not in kept:
            kept[key] = one_run(name, kind, errs, seed)
            if journal is not None:
                journal.parent.mkdir(parents=True, exist_ok=True)
                with journal.open("a", encoding="utf-8") as text:
                    text.write(json.dumps([key, kept[key]]) + "\n")
        found.append(Run(*kept[key]))
    return found


HEAD = (
    "problem",
    "scales",
    "errors",
    "runs",
    "one expert",
    "panel of five",
    "times",
    "true loss %",
    "bound held",
    "95% interval",
    "members' bounds held",
    "finished",
)


def described(name: str, kind: str, errs: str, found: Sequence[Run]) -> list[str]:
    """Return a row of the table."""
    n = len(found)
    held = sum(run.loss <= run.bound + 1e-9 for run in found)
    low, high = stats.binomtest(held, n).proportion_ci(method="exact")
    asked, alone = np.array([run.asked for run in found]), np.array([run.alone for run in found])
    return [
        name,
        kind,
        errs,
        str(n),
        with_interval(alone, 1),
        with_interval(asked, 1),
        f"{asked.sum() / max(alone.sum(), 1.0):.2f}",
        f"{100 * np.mean([run.loss for run in found]):.3f}",
        f"{held} of {n}",
        f"{100 * low:.1f} to {100 * high:.1f}%",
        f"{sum(run.members_held for run in found)} of {n}",
        f"{sum(run.finished for run in found)} of {n}",
    ]


def fewest_questions(people: int, near: float, draws: int = 20_000) -> float:
    """Return a lower bound on the mean number of questions that decide one pair for the mean.

    Each person's d.e is uniform on -1 to 1, for itself. A question has two answers and goes to one
    person. The pair is decided once the mean is proven to be at least -near, or at most near.

    Whatever is asked, the answers leave a set of values for each person, and their product lies on
    one side. So it lies in a box l_i to 1 with a mean of the l_i of at least -near, or in the
    mirror image of one. The mean number of yes and no answers is at least the entropy of what they
    leave, and so at least the mean of -log2 of the probability of the largest such box.
    """
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (draws, people))
    return float(np.minimum(_bits(x, near), _bits(-x, near)).mean())


def _bits(x: Floats, near: float) -> Floats:
    """Return -log2 (n,) of the probability of the largest box around x (n, people) on one side.

    Its sides 1 - l_i are as equal as they can be. inf if there is none.
    """
    side = 1.0 - x  # at least
    room = x.shape[1] * (1.0 + near)
    low, high = np.zeros(len(x)), np.full(len(x), 2.0)
    for _ in range(50):
        middle = 0.5 * (low + high)
        fits = np.clip(side, middle[:, None], 2.0).sum(axis=1) <= room
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    bits = -np.log2(np.clip(side, low[:, None], 2.0) / 2.0).sum(axis=1)
    return np.asarray(np.where(side.sum(axis=1) <= room, bits, np.inf))


def limits() -> str:
    """Return sentences on how few questions there could be."""
    least = ", ".join(f"{n}: {fewest_questions(n, 0.01):.1f}" for n in (1, 2, 3, 5, 10))
    return (
        "How few there could be: one pair, each expert's d.e uniform on -1 to 1 and independent, "
        "the mean's sign wanted up to .01. However one chooses whom and what to ask, if each "
        "question goes to one expert and has two answers, the mean number of questions is at "
        f"least, by the number of experts, {least} (`fewest_questions`). One expert says the sign "
        "at once. A sum of five has no sign until it is known how large its parts are."
    )


def summary(rows: Mapping[tuple[str, str, str], Sequence[Run]]) -> str:
    """Return sentences on whether bounds were held and how many questions were asked."""
    said = []
    for errs in ERRORS:
        some = [run for key, found in rows.items() if key[2] == errs for run in found]
        held = sum(run.loss <= run.bound + 1e-9 for run in some)
        times = [
            sum(run.asked for run in found) / max(sum(run.alone for run in found), 1.0)
            for key, found in rows.items()
            if key[2] == errs
        ]
        if not times:
            continue
        few = sum(one <= 2.5 for one in times)
        said.append(
            f"Experts whose errors are: {errs}. The bound for the mean was held in {held} of "
            f"{len(some)} runs. The panel of five took {min(times):.2f} to {max(times):.2f} times "
            f"the questions of one expert; at most 2.5 times in {few} of {len(times)} rows."
        )
    return " ".join(said)


def report(problems: int, journal: Path | None = None) -> Iterator[list[str]]:
    """The parts of the page."""
    yield ["# Panels: five experts, their mean, and the number of questions", "", machine()]
    rows = {
        (name, kind, errs): runs(name, kind, errs, range(seeds_of(name, problems)), journal)
        for errs in ERRORS
        for name in PROBLEMS
        for kind in SCALES
    }
    yield [
        "Five experts with a scale each. Policy iteration asks them (`elicit.Panel`, equal "
        f"weights) until the policy is within {TOLERANCE:.0%} of the value range for the mean of "
        "their scales, at every state. With experts who never err the members are polytopes and "
        "the bound is proven; with experts who flip a tenth of their answers they are posteriors "
        "and the bound is to hold with probability 95%. *One expert*: questions of the same "
        "learner with one of them alone, in the mean of the five, for a policy that is within the "
        "tolerance for that one. *Times*: the one over the other. *True loss*: by the mean scale, "
        "at the worst state, in the mean. *Members' bounds held*: runs in which the bounds on what "
        "the policy loses each were held for all five; those of posteriors hold with 95% each.",
        "",
        *(f"Scales {name}: {text}." for name, text in SCALES.items()),
        f'Scales are drawn as `hidden_scales("even")`. Seeds 0 to {problems - 1}, of the small '
        f"problems 0 to {MORE * problems - 1}; at most {MOST} questions. Means with 95% "
        "t-intervals.",
    ]
    yield [summary(rows)]
    yield [limits()]
    yield markdown(HEAD, [described(*key, found) for key, found in rows.items()], 3)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.people.panel", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--problems", type=int, default=6, help="runs of each row (default: 6)")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    publish(report(given.problems, given.journal), given.out, f"0-{given.problems - 1}")


if __name__ == "__main__":
    main()
