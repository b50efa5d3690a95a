"""Cost of one comparison over K_t: this project's comparator and the usual tools, in one run,
one thread each.

    python -m benchmarks.comparing.comparison_cost [--levels 5 10 20] [--streams Q-learning IVI]
    [--quick]
        [--out FILE.md]

Each method gets the differences that a real run put to its comparator, with the K_t that held at
that time. The slow ones get blocks of neighbouring rows, spread evenly over the run, so that their
mean cost is that of the run.
"""

from __future__ import annotations

import os

from benchmarks.own_process import ONE_THREAD

os.environ |= ONE_THREAD  # read when the libraries load, hence set before they do

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.comparing import big_batch as batch
from benchmarks.comparing import lp_methods as methods
from benchmarks.comparing.recorded_streams import KINDS, Kind, Stream, needed_rows, record
from benchmarks.reporting import machine, markdown, publish
from elicit import PolytopeComparator
from elicit.model.comparator import Verdicts

MARGIN = 1e-6
# neighbouring rows of a sample: a hot solver profits from neighbours, as it would in the run
BLOCK = 25


class Entry(NamedTuple):
    """A row of the table: its name, the method, and how many comparisons to time (None: all)."""

    name: str
    make: Callable[[int, float], methods.Method]
    rows: int | None = None


OURS = Entry("PolytopeComparator, a segment at a time", methods.Ours)
ENTRIES = (
    Entry("cvxpy, two programs, rebuilt each time", methods.CvxpyRebuilt, 200),
    Entry("cvxpy, two programs, Parameter objective", methods.CvxpyParameter, 500),
    Entry("scipy linprog, two programs", methods.Linprog, 500),
    Entry("Clarabel, two programs, `update(q=)`", methods.HotClarabel, 1000),
    Entry("HiGHS hot, two programs", methods.HotHighs, 2000),
    Entry("dominance, then one side in hot HiGHS", methods.Careful, 20_000),
    Entry("PolytopeComparator, one row at a time", methods.OursRowByRow),
    OURS,
)


class Pass(NamedTuple):
    """Result of one pass of a method over a stream.

    It has the seconds for learning the answers, the seconds for deciding the differences, and the
    verdicts.
    """

    learning: float
    comparing: float
    verdicts: Verdicts


class Cost(NamedTuple):
    """A line of the report; microseconds a comparison, ``whole`` with its share of the learning."""

    name: str
    rows: int
    passes: int
    alone: float
    whole: float
    wrong: int


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark; print its tables and, with --out, write them to a file."""
    options = _options(arguments)
    publish(
        report(options.levels, options.streams, options.seed, options.quick),
        options.out,
        str(options.seed),
    )


def report(levels: list[int], kinds: list[Kind], seed: int, quick: bool) -> Iterator[list[str]]:
    """The parts of the report, as lines of Markdown."""
    yield ["# The cost of one comparison over K_t", "", machine("one thread"), "", *NOTES]
    steps, tolerance = (2000, 0.02) if quick else (100_000, 0.0005)
    big = (10 if 10 in levels else levels[0], kinds[0])
    for k in levels:
        for kind in kinds:
            stream = record(kind, k, seed, steps=steps, tolerance=tolerance)
            yield [*about(stream), "", *table(costs(stream, quick))]
            if (k, kind) == big:
                yield batch.report(stream, 10_000 if quick else 1_000_000, 100, MARGIN, seed)


def costs(stream: Stream, quick: bool = False) -> list[Cost]:
    """Measure the cost of each method on one stream, the comparator of this project last."""
    truth = run(OURS.make, stream).verdicts  # also compiles what is to be compiled
    patience = 0.0 if quick else 2.0
    found = [cost(entry, stream, truth, patience, 10 if quick else 1) for entry in ENTRIES]
    return [*found, again(stream, truth)]


def cost(entry: Entry, stream: Stream, truth: Verdicts, patience: float, thinner: int) -> Cost:
    """Time a method in fresh passes, five of them or as many as begin within ``patience``
    seconds.
    """
    chosen = sample(len(stream), len(stream) if entry.rows is None else entry.rows // thinner)
    part = stream.take(chosen)
    passes = [run(entry.make, part)]
    while len(passes) < 5 and sum(p.learning + p.comparing for p in passes) < patience:
        passes.append(run(entry.make, part))
    alone = 1e6 * median(p.comparing for p in passes) / len(part)
    learning = (
        1e6 * median(p.learning for p in passes) / len(stream)
    )  # the part has all the answers
    wrong = max(int(np.count_nonzero(p.verdicts != truth[chosen])) for p in passes)
    return Cost(entry.name, len(part), len(passes), alone, alone + learning, wrong)


def run(make: Callable[[int, float], methods.Method], stream: Stream) -> Pass:
    """One pass of a fresh method over a stream."""
    method = make(stream.k, MARGIN)
    learning = comparing = 0.0
    verdicts = []
    for answers, d in stream.steps():
        start = perf_counter()
        if len(answers):
            method.learn(answers)
        between = perf_counter()
        if len(d):
            verdicts.append(method.compare(d))
        end = perf_counter()
        learning, comparing = learning + between - start, comparing + end - between
    return Pass(learning, comparing, np.concatenate(verdicts))


def again(stream: Stream, truth: Verdicts) -> Cost:
    """Our comparators once more on the segments that each of them has judged already."""
    comparator = PolytopeComparator(stream.k, MARGIN)
    seconds, verdicts = 0.0, []
    for answers, d in stream.steps():
        comparator = comparator.update(answers)
        comparator.compare(d)
        start = perf_counter()
        verdicts.append(comparator.compare(d))
        seconds += perf_counter() - start
    each = 1e6 * seconds / len(stream)
    wrong = np.count_nonzero(np.concatenate(verdicts) != truth)
    return Cost(
        "PolytopeComparator, the same segments again", len(stream), 1, each, each, int(wrong)
    )


def sample(n: int, wanted: int) -> NDArray[np.bool_]:
    """Marks about ``wanted`` of n rows, in blocks spread evenly over them."""
    chosen = np.ones(n, dtype=bool)
    if wanted < n:
        chosen[:] = False
        for first in np.linspace(0, n - BLOCK, max(1, wanted // BLOCK)).astype(int):
            chosen[first : first + BLOCK] = True
    return chosen


def about(stream: Stream) -> list[str]:
    """A heading, and what the run was like."""
    return [
        f"## {stream.kind}, k = {stream.k}",
        "",
        f"{len(stream):,} comparisons, of which equality and dominance settle "
        f"{stream.dominated:.1%}; "
        f"{len(stream.answers)} answers, of which {needed_rows(stream.answers, MARGIN)} are not "
        "redundant in the end.",
    ]


def table(found: list[Cost]) -> list[str]:
    """A Markdown table of costs; ratios are to our comparator on whole segments."""
    ours = next(cost.whole for cost in found if cost.name == OURS.name)
    head = (
        "method",
        "comparisons timed",
        "passes",
        "us a comparison",
        "with learning",
        "ratio",
        "disagreements",
    )
    lines = [
        [
            name,
            f"{rows:,}",
            f"{passes}",
            f"{alone:,.2f}",
            f"{whole:,.2f}",
            f"{whole / ours:,.1f}",
            f"{wrong:,}",
        ]
        for name, rows, passes, alone, whole, wrong in found
    ]
    return markdown(head, lines, 1)


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="What one comparison over K_t costs, by method.")
    parser.add_argument(
        "--levels", type=int, nargs="+", help="numbers of levels k (default: 5 10 20; quick: 5)"
    )
    parser.add_argument(
        "--streams", nargs="+", choices=KINDS, default=list(KINDS), help="whose comparisons"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the problem and of the exploration")
    parser.add_argument(
        "--quick", action="store_true", help="short runs and small samples: seconds, rough figures"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md", help="write the report there as well"
    )
    options = parser.parse_args(arguments)
    options.levels = options.levels or ([5] if options.quick else [5, 10, 20])
    return options


NOTES = [
    "Each method gets the comparisons of a run with a truthful tutor (100 states, 5 actions), with "
    "the answers known "
    f"at that time: all comparisons, or as many as stated, in blocks of {BLOCK} neighbours spread "
    "evenly over the run. "
    "Every pass starts afresh; several passes give the median. "
    '"With learning" adds what the answers cost (new rows, rebuilt solvers, fresh proofs), shared '
    "out over all "
    "comparisons of the run. The ratio is of that column, to the comparator on whole segments (all "
    "differences between "
    "two answers). The methods with two programs screen nothing: they pay for each comparison, "
    "dominated or not. "
    f"Methods in floats take an optimum within {methods.Linprog.tolerance:g} of zero (Clarabel: "
    f"{methods.HotClarabel.tolerance:g}) for zero, at a largest tail sum of 1; a disagreement is a "
    "verdict other than "
    "the comparator's, or none. Hot HiGHS runs the primal simplex without presolve, its fastest "
    "setting here, and once "
    "more from scratch where a warm basis gives no optimum.",
]


if __name__ == "__main__":
    main()
