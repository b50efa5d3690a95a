"""Cost of a tutor who calls close things equal, in questions and in what can be promised:
docs/about-equal.md.

    python -m benchmarks.asking.about_equal --out docs/about-equal.md   twenty minutes on one core
    python -m benchmarks.asking.about_equal --problems 2                 a minute; rough figures

Random MDPs of the paper's law (|S| = 100, |A| = 5, discount .95, k = 5, 8 and 12), each with a
hidden scale of its own, and every setting at its default.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.reporting import machine, markdown, publish, with_interval
from elicit import Comparator, PolytopeComparator, PosteriorComparator, TruthfulTutor
from qlearn import (
    InteractivePolicyIteration,
    InteractiveValueIteration,
    drive,
    policy_loss,
    random_mdp,
)

LEVELS, TIES = (5, 8, 12), (0.0, 0.002, 0.005, 0.01, 0.02)
LEARNERS = {
    "policy iteration": InteractivePolicyIteration,
    "value iteration": InteractiveValueIteration,
}
COMPARATORS = {"polytope": PolytopeComparator, "posterior": PosteriorComparator}
MOST = 500  # questions
HEAD = (
    "comparator",
    "learner",
    "equal within",
    "runs",
    "questions",
    "most",
    "of them equal",
    "bound",
    "loss",
    "violated",
)

INTRODUCTION = """# About equal

This page is for readers whose tutor may say "equal". It says what such an answer teaches, what is still promised, and how many
questions it costs. A person says "equal" when two things are close. Each of our comparators has a `tie`: the largest |d.e|, as a share of
the value range e_k - e_1, that the tutor may call equal. It is .01 by default. Set it to 0 for a tutor known to be exact:
then "equal" means equal, to one part in 10^9.

- **What an answer "equal" teaches.** The polytope keeps only the scales with |d.e| <= tie, or all others if
  this answer is among the wrong ones that it allows for (`wrong=`). The Bradley-Terry fit and the posterior use the law of Rao and Kupper (1967): P(left is better) =
  sigma(c (d.e - w)) and P(right is better) = sigma(-c (d.e + w)). In the fit w is the tie. The posterior learns w, whose median
  is the tie a priori ([the posterior's model](posterior.md#ties)). A tutor who has called nothing equal is taken to be exact: until the first "equal"
  every comparator gives the same numbers as with tie = 0, to the last digit, and asks no more questions.
- **What it decides.** A pair called equal is not asked again, and a learner keeps the action that it has. `Result.loss_bound`
  includes what that may lose, because it bounds the loss over all scales that the answers allow.
- **When asking ends.** If |d.e| <= 2 ties is certain for a pair, the answer "equal" would teach almost nothing. After five "equal" to such
  pairs in a row the tutor is asked about no more of them. A learner that then has nothing else to ask ends
  with the status `CALLED_EQUAL`, and `loss_bound` says what is left open.
- **What is promised.** Nobody knows their own tie. Guarantees of confidence 1 (`simultaneous_bounds`) therefore
  allow for twice the `tie` that the comparator was given. Verdicts and `bounds` use the tie itself. If a
  person's "equal" may reach farther than that, give a larger `tie`: the polytope cannot notice. The posterior learns a larger width
  from a few answers "equal", but its 95% may fail until then. In 36 of 37 runs in which simulated persons called more than three in
  ten pairs equal [the bound held](../benchmarks/RESULTS-promise.md) (86 to 99.9%). Since these are few, `print(result)` still
  warns if three answers in ten or more are "equal", and at least three (`Result.tie_warning`).
- **What the likelihoods promise.** The posterior's 95% is a promise on average over its prior, and answers are "equal" by Rao and
  Kupper's law, or in one lapse of a hundred. The rows "equal within 0" and the tables of the polytope do not depend on this law. The
  resamples of a Bradley-Terry fit all have the same answers "equal", and so do not show what these leave open. The fit's guarantees then
  have a confidence of nan.

Questions about simple bags (`bags=`) can tell apart what questions about single actions cannot: the differences that are left open
between two actions are often smaller than any tie.
"""  # noqa: E501


class Run(NamedTuple):
    """The cost of one run, and what it promised."""

    asked: int
    equal: int
    bound: float
    loss: float


def run(comparator: str, learner: str, k: int, tie: float, seed: int) -> Run:
    """One learner with a tutor who calls equal what lies within ``tie``, and is right otherwise."""
    mdp, values = random_mdp(100, 5, k, seed=seed)
    made: Comparator = COMPARATORS[comparator](k)
    result = drive(LEARNERS[learner](mdp, made, max_queries=MOST), TruthfulTutor(values, tie=tie))
    equal = int(np.count_nonzero(result.answers.y == 0))
    return Run(
        result.asked, equal, result.loss_bound, float(policy_loss(mdp, result.policy, values).max())
    )


def row(comparator: str, learner: str, tie: float, problems: int) -> tuple[str, ...]:
    """The cells of one setting: so many problems for each k."""
    runs = [run(comparator, learner, k, tie, seed) for k in LEVELS for seed in range(problems)]
    asked, equal, bound, loss = (
        np.array(column, dtype=np.float64) for column in zip(*runs, strict=True)
    )
    return (
        comparator,
        learner,
        f"{tie:g}",
        f"{len(runs)}",
        with_interval(asked, 1),
        f"{asked.max():.0f}",
        with_interval(equal, 1),
        f"{np.median(bound):.4f}",
        f"{loss.max():.4f}",
        f"{np.count_nonzero(loss > bound + 1e-12)}",
    )


def report(problems: int) -> Iterator[list[str]]:
    """The parts of the page."""
    yield INTRODUCTION.splitlines()
    yield [
        "## What it costs",
        "",
        f"`python -m benchmarks.asking.about_equal --problems {problems} --out "
        f"docs/about-equal.md`. {machine()}",
        "",
        f"Seeds 0 to {problems - 1} for each of k = {', '.join(map(str, LEVELS))}; |S| = 100, |A| "
        f"= 5; at most {MOST} questions. The tutor never errs, but calls two sides equal if they "
        "differ by no more than the third column (0: never). *Questions* and *of them equal* are "
        "means with 95% t-intervals, and *most* is the largest number of questions. *Bound* is the "
        "median `loss_bound`, and *loss* the greatest true loss at the worst state, both as shares "
        "of the value range. *Violated* counts the runs whose true loss exceeds their bound. The "
        "bounds have confidence 1 with the polytope and 95% with the posterior.",
        "",
    ]
    for comparator in COMPARATORS:
        for learner in LEARNERS:
            rows = [row(comparator, learner, tie, problems) for tie in TIES]
            yield markdown(HEAD, rows, 2)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.asking.about_equal", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument(
        "--problems", type=int, default=17, help="for each number of levels (default: 17)"
    )
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    publish(report(given.problems), given.out, f"0-{given.problems - 1}")


if __name__ == "__main__":
    main()
