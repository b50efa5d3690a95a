"""Five experts asked as a panel: is the bound for their mean held, and how many questions is that?

    python -m benchmarks.people.panel --out benchmarks/RESULTS-panel.md     about half an hour
    python -m benchmarks.people.panel --runs 2                              rough figures

Random MDPs and three families of problems where asking matters. Each expert has a scale of their
own, and policy iteration asks until the policy is within the tolerance for the mean of the scales.
Beside it stands what the same learner asks one of them, for the policy that is best for that one.

The problems are small, so that a bound can be checked in hundreds of runs: what a question costs
grows with the number of states, and most of the time went into interviews of one expert alone.
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
SMALL = "random MDP, k = 4"
SIZES = {"rover": 6, "surgery": 8, "care": 8}  # of a family's problem, where its own is 14 to 30
PROBLEMS = (SMALL, "random MDP, k = 5", *SIZES)
SCALES = {
    "independent": "each expert's scale is drawn for itself",
    "alike": "all experts have one scale, but for a tenth",
}


class Setting(NamedTuple):
    """The rate of errors, when a run ends, and the number of runs of a row."""

    rate: float
    tolerance: float
    most: int  # questions of a run
    runs: int
    alone: int  # runs, the first ones, in which each expert is asked alone as well


ERRORS = {
    "never": Setting(0.0, 0.01, 300, 10, 10),
    "10% flipped": Setting(0.1, 0.02, 100, 20, 4),
}


class Run(NamedTuple):
    """One run: questions of the panel, the mean of one expert, the true loss, and the bounds.

    ``alone`` is None where no expert was asked alone.
    """

    asked: int
    alone: float | None
    loss: float
    bound: float
    confidence: float
    members_held: bool
    finished: bool


def problem(name: str, seed: int) -> OrdinalMDP:
    """Return the problem of this name and seed."""
    if name in SIZES:
        return FAMILIES[name](seed, size=SIZES[name])
    return random_mdp(12, 3, 4 if name == SMALL else 5, discount=0.9, seed=seed)[0]


def scales(kind: str, k: int, seed: int) -> dict[str, Floats]:
    """Return the scale (k,) of each expert."""
    drawn = {name: hidden_scales("even", k, 1000 * seed + i) for i, name in enumerate(PEOPLE)}
    if kind == "independent":
        return drawn
    shared = hidden_scales("even", k, 1000 * seed + 999)
    return {name: normalise(0.9 * shared + 0.1 * own) for name, own in drawn.items()}


def one_run(name: str, kind: str, errs: str, seed: int) -> Run:
    """Return what a panel of five came to, and in the first runs each of the five alone."""
    mdp, setting = problem(name, seed), ERRORS[errs]
    values, rate = scales(kind, mdp.k, seed), setting.rate

    def comparator(i: int) -> Comparator:
        return PosteriorComparator(mdp.k, seed=seed + i) if rate else PolytopeComparator(mdp.k)

    def tutor(who: str, i: int) -> Tutor:
        if rate:
            return FlippingTutor(values[who], rate, seed=100 * seed + i)
        return TruthfulTutor(values[who])

    def solved(known: Comparator, tutors: Mapping[str, Tutor] | Tutor) -> Result:
        run = InteractivePolicyIteration(
            mdp, known, tolerance=setting.tolerance, max_queries=setting.most
        )
        return drive(run, tutors)

    panel = Panel({who: comparator(i) for i, who in enumerate(PEOPLE)})
    found = solved(panel, {who: tutor(who, i) for i, who in enumerate(PEOPLE)})
    alone = None
    if seed < setting.alone:
        each_asked = [solved(comparator(i), tutor(who, i)).asked for i, who in enumerate(PEOPLE)]
        alone = float(np.mean(each_asked))
    mean = normalise(np.mean([values[who] for who in PEOPLE], axis=0))
    each = {who: policy_loss(mdp, found.policy, values[who]).max() for who in PEOPLE}
    bounds = found.member_loss_bounds
    return Run(
        found.asked,
        alone,
        float(policy_loss(mdp, found.policy, mean).max()),
        found.loss_bound,
        found.confidence,
        all(each[who] <= bounds[who] + 1e-9 for who in PEOPLE),
        found.loss_bound <= setting.tolerance,
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


def times(found: Sequence[Run]) -> float:
    """Return the panel's questions over those of one expert, where both were asked."""
    both = [(run.asked, run.alone) for run in found if run.alone is not None]
    return float(sum(asked for asked, _ in both) / max(sum(alone for _, alone in both), 1.0))


def described(name: str, kind: str, errs: str, found: Sequence[Run]) -> list[str]:
    """Return a row of the table."""
    n = len(found)
    held = sum(run.loss <= run.bound + 1e-9 for run in found)
    low, high = stats.binomtest(held, n).proportion_ci(method="exact")
    return [
        name,
        kind,
        errs,
        str(n),
        with_interval([run.alone for run in found if run.alone is not None], 1),
        with_interval([run.asked for run in found], 1),
        f"{times(found):.2f}",
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
        of = [found for key, found in rows.items() if key[2] == errs]
        if not of:
            continue
        some = [run for found in of for run in found]
        over = [times(found) for found in of]
        said.append(
            f"Experts whose errors are: {errs}. The bound for the mean was held in "
            f"{held_in(some)}; of the runs in which anything was asked, in "
            f"{held_in([run for run in some if run.asked])}. {sum(run.finished for run in some)} "
            f"of {len(some)} runs ended within the tolerance. The panel of five took "
            f"{min(over):.2f} to {max(over):.2f} times the questions of one expert; at most 2.5 "
            f"times in {sum(one <= 2.5 for one in over)} of {len(over)} rows."
        )
    return " ".join(said)


def held_in(found: Sequence[Run]) -> str:
    """Return in how many runs the bound for the mean was held, with an exact 95% interval."""
    if not found:
        return "0 of 0"
    held = sum(run.loss <= run.bound + 1e-9 for run in found)
    low, high = stats.binomtest(held, len(found)).proportion_ci(method="exact")
    return f"{held} of {len(found)} ({100 * low:.1f} to {100 * high:.1f}%)"


def report(most: int | None = None, journal: Path | None = None) -> Iterator[list[str]]:
    """The parts of the page. ``most`` is the number of runs of a row, at most."""
    yield ["# Panels: five experts, their mean, and the number of questions", "", machine()]
    seeds = {
        errs: range(min(setting.runs, most or setting.runs)) for errs, setting in ERRORS.items()
    }
    rows = {
        (name, kind, errs): runs(name, kind, errs, seeds[errs], journal)
        for errs in ERRORS
        for name in PROBLEMS
        for kind in SCALES
    }
    never, flips = ERRORS["never"], ERRORS["10% flipped"]
    sizes = ", ".join(f"{name} {size}" for name, size in SIZES.items())
    yield [
        "Five experts with a scale each. Policy iteration asks them (`elicit.Panel`, equal "
        "weights) until the policy is within the tolerance for the mean of their scales, at every "
        "state, or until the questions are used up. With experts who never err the members are "
        f"polytopes and the bound is proven; the tolerance is {never.tolerance:.0%} of the value "
        f"range, with at most {never.most} questions. With experts who flip a tenth of their "
        "answers the members are posteriors and the bound is to hold with probability 95%; the "
        f"tolerance is {flips.tolerance:.0%}, with at most {flips.most} questions. The bound is "
        "checked as it stands when the run ends, for whichever reason.",
        "",
        "*One expert*: questions of the same learner with one of them alone, in the mean of the "
        "five, for a policy that is within the tolerance for that one. Of erring experts that was "
        f"run with the first {flips.alone} seeds. *Times*: the one over the other, in the same "
        "runs. *True loss*: by the mean scale, at the worst state, in the mean. *Members' bounds "
        "held*: runs in which the bounds on what the policy loses each were held for all five; "
        "those of posteriors hold with 95% each.",
        "",
        *(f"Scales {name}: {text}." for name, text in SCALES.items()),
        'Scales are drawn as `hidden_scales("even")`. '
        + " ".join(
            f"Seeds 0 to {len(each) - 1} with experts whose errors are: {errs}."
            for errs, each in seeds.items()
        )
        + " Means with 95% t-intervals.",
        "",
        "What is small: random MDPs have 12 states and 3 actions, and the families' problems have "
        f"size {sizes} instead of the families' own 14, 30 and 30, which gives 26 to 37 states. "
        f"Erring experts have a tolerance of {flips.tolerance:.0%} and {flips.most} questions at "
        f"most, where this page once had {never.tolerance:.0%} and {never.most}. A question about "
        "a larger problem takes longer to choose, and a tighter tolerance more questions. Neither "
        "makes a bound easier to hold: the check is the loss by the true scales against the bound "
        "that was stated.",
    ]
    yield [summary(rows)]
    yield [limits()]
    yield markdown(HEAD, [described(*key, found) for key, found in rows.items()], 3)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.people.panel", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--runs", type=int, help="runs of each row, at most (default: all)")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    last = max(setting.runs for setting in ERRORS.values()) - 1
    publish(report(given.runs, given.journal), given.out, f"0-{last}")


if __name__ == "__main__":
    main()
