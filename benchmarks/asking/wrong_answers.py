"""The number of questions, CPU time and bounds where some answers may be wrong.

    python -m benchmarks.asking.wrong_answers --out benchmarks/RESULTS-wrong.md     half an hour
    python -m benchmarks.asking.wrong_answers --levels 5 --problems 2               rough figures

``--journal FILE`` keeps finished runs. The comparator is ``PolytopeComparator(k, wrong=m)``.

Random MDPs of the paper's law (|S| = 100, |A| = 5, discount .95), each with a hidden scale of its
own. Policy iteration with a tolerance of 1%, every other setting at its default. Every problem is
solved for every number of wrong answers that is allowed for, and by each tutor.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.reporting import machine, markdown, publish, with_interval
from benchmarks.stamps import sources
from elicit import (
    Answer,
    FlippingTutor,
    InconsistentAnswers,
    PolytopeComparator,
    Query,
    TruthfulTutor,
)
from elicit.model.scale import Floats
from qlearn import InteractivePolicyIteration, drive, policy_loss, random_mdp
from qlearn.experiments.parallel import Cell, sweep

LEVELS, PROBLEMS, ALLOWED = (5, 10), (20, 8), (0, 1, 2)
TOLERANCE, MOST, ERRORS = 0.01, 200, 0.05
HEAD = (
    "levels",
    "tutor",
    "wrong=",
    "runs",
    "questions",
    "CPU seconds",
    "within the tolerance",
    "more wrong than allowed",
    "of these noticed",
    "bound violated",
    "of these with no more wrong than allowed",
)


class LyingOnce:
    """A tutor who is right, but for the answer with this number, counted from 0."""

    def __init__(self, values: Floats, at: int) -> None:
        self._truthful, self._left = TruthfulTutor(values), at

    def __call__(self, query: Query) -> Answer:
        """Answer, and count."""
        answer = self._truthful(query)
        self._left -= 1
        wrong = self._left == -1 and answer.verdict is not None
        return (
            Answer(query, answer.verdict.flipped)
            if wrong and answer.verdict is not None
            else answer
        )


Tutor = Callable[[Query], Answer]


def lying_once(values: Floats, seed: int) -> Tutor:
    """Return a tutor who lies once, at a random position among the first k questions."""
    return LyingOnce(values, int(np.random.default_rng([seed, 1]).integers(len(values))))


TUTORS: dict[str, Callable[[Floats, int], Tutor]] = {
    "truthful": lambda values, seed: TruthfulTutor(values),
    "one lie": lying_once,
    "5% flipped": lambda values, seed: FlippingTutor(values, ERRORS, seed=seed),
}


class Run(NamedTuple):
    """The numbers of one run."""

    asked: int
    seconds: float
    wrong: int  # answers that were wrong
    noticed: bool  # more wrong answers than allowed were seen
    bound: float
    loss: float


def run(cell: Cell) -> dict[str, Any]:
    """Solve one problem, and return the parts of a ``Run``. A cell has "k", "tutor", "allowed" and
    "seed"."""
    k, name, allowed, seed = (cell[key] for key in ("k", "tutor", "allowed", "seed"))
    mdp, values = random_mdp(100, 5, k, seed=seed)
    truth = TruthfulTutor(values)
    given: list[Answer] = []

    def tutor(query: Query) -> Answer:
        given.append(asked_of(query))
        return given[-1]

    asked_of = TUTORS[name](values, seed)
    begin = time.process_time()
    learner = InteractivePolicyIteration(
        mdp, PolytopeComparator(k, wrong=allowed), tolerance=TOLERANCE, max_queries=MOST
    )
    noticed = False
    try:
        drive(learner, tutor)
    except InconsistentAnswers:
        noticed = True
    result = learner.result()
    bound = result.loss_bound
    seconds = time.process_time() - begin
    wrong = int(sum(truth(answer.query).verdict != answer.verdict for answer in given))
    loss = float(policy_loss(mdp, result.policy, values).max())
    return Run(len(given), seconds, wrong, noticed, bound, loss)._asdict()


def row(k: int, name: str, allowed: int, runs: Sequence[Run]) -> tuple[str, ...]:
    """Return the cells of one setting."""
    asked, seconds, wrong, noticed, bound, loss = (
        np.array(column, dtype=float) for column in zip(*runs, strict=True)
    )
    more, stopped = wrong > allowed, noticed > 0
    violated = (loss > bound + 1e-12) & ~stopped
    return (
        f"{k}",
        name,
        f"{allowed}",
        f"{len(runs)}",
        with_interval(asked, 1),
        with_interval(seconds, 1),
        f"{np.count_nonzero((bound <= TOLERANCE) & ~stopped)}",
        f"{np.count_nonzero(more)}",
        f"{np.count_nonzero(more & stopped)}",
        f"{np.count_nonzero(violated)}",
        f"{np.count_nonzero(violated & ~more)}",
    )


def report(levels: Sequence[int], problems: Sequence[int], **how: Any) -> Iterator[list[str]]:
    """Yield the parts of the page."""
    given = f"--levels {' '.join(map(str, levels))} --problems {' '.join(map(str, problems))}"
    yield [
        "# Allowing for wrong answers",
        "",
        "`PolytopeComparator(k, wrong=m)` proves what holds if at most m of the answers are "
        "wrong. This page says "
        "how many more questions that takes, and what happens if more answers "
        "are wrong.",
        "",
        f"`python -m benchmarks.asking.wrong_answers {given}`. {machine()}",
        "",
        f"Seeds from 0 on: random MDPs (|S| = 100, |A| = 5), policy iteration, tolerance "
        f"{TOLERANCE:.0%}, at most "
        f"{MOST} questions. Tutors: *truthful*; *one lie*, at a random position among the first "
        f"k questions (a run "
        f"may end before); *5% flipped*: each answer is wrong with probability {ERRORS:.0%}. "
        f"Means with 95% "
        "t-intervals. *Noticed*: the run ended with InconsistentAnswers, for more answers were "
        "seen to be wrong than "
        "allowed. *Bound violated*: the true loss at the worst state exceeds `loss_bound`, among "
        "the runs that were "
        "not stopped so. The last column must be 0.",
    ]
    keys, settings = ("k", "tutor", "allowed"), list(product(levels, TUTORS, ALLOWED))
    count = dict(zip(levels, problems, strict=True))
    cells = [
        dict(zip(keys, one, strict=True)) | {"seed": seed}
        for one in settings
        for seed in range(count[one[0]])
    ]
    runs = iter([Run(**found) for found in sweep(run, cells, **how)])
    yield markdown(
        HEAD, [row(*one, [next(runs) for _ in range(count[one[0]])]) for one in settings], 2
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.asking.wrong_answers", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument(
        "--levels", type=int, nargs="+", default=LEVELS, help="numbers of levels (default: 5 10)"
    )
    parser.add_argument(
        "--problems",
        type=int,
        nargs="+",
        default=PROBLEMS,
        help="for each of these (default: 20 8)",
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    if len(given.problems) != len(given.levels):
        parser.error("--problems takes one number for each of --levels")
    made_of = sources("benchmarks.asking.wrong_answers")  # a run of other code is none of these
    how = {"journal": given.journal, "jobs": given.jobs, "own": lambda cell: (made_of, {})}
    publish(report(given.levels, given.problems, **how), given.out, f"0-{max(given.problems) - 1}")


if __name__ == "__main__":
    main()
