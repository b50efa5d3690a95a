"""CPU time an answer of keeping a model of an unreliable tutor up to date, with each tool.

    python -m benchmarks.fitting.fit_cost [--answers 30 300 3000] [--levels 5 10 20] [--quick]
    [--out FILE.md]

Section 3.2 refits a logistic regression and all its bootstrap resamples after every answer. Each
tool does that here as its users would write it, on the same resamples; the project's two
comparators learn the same answers one by one.
"""

from __future__ import annotations

import os

from benchmarks.own_process import ONE_THREAD

os.environ |= ONE_THREAD  # read when the libraries load, hence set before they do

import argparse
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np

from benchmarks.fitting.fit_accuracy import References, completed, distances, references, rule
from benchmarks.fitting.fit_methods import ENTRIES, Entry, Problem
from benchmarks.fitting.fit_tables import Line, about, fastest, notes, table
from benchmarks.fitting.item_strengths import PER_ITEM, item_lines, item_tables
from benchmarks.fitting.tutor_data import Data, draw
from benchmarks.reporting import machine, publish
from elicit import Verdict


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark; print its tables and, with --out, write them to a file."""
    options = _options(arguments)
    seeds = f"{options.seed}-{options.seed + options.sets - 1}"
    publish(
        report(options.levels, options.answers, options.sets, options.resamples, options.seed),
        options.out,
        seeds,
    )


def report(
    levels: list[int], answers: list[int], sets: int, m: int, seed: int
) -> Iterator[list[str]]:
    """The parts of the report, as lines of Markdown: who is fastest comes first, so all is measured
    before.
    """
    also = ", ".join(f"{name} {version(name)}" for name in ("scikit-learn", "statsmodels"))
    head = [machine("one thread"), f"Also {also}.", "", *notes(sets, m)]
    small = draw(3, 8, 2, seed)
    costs([small], [references(small)])  # loads and compiles what is to be loaded and compiled
    measured, parts = {}, []
    for k in levels:
        for n in answers:
            cell = [draw(k, n, m, seed + i) for i in range(sets)]
            tight = [references(data) for data in cell]
            measured[k, n] = costs(cell, tight)
            parts.append(
                [f"## k = {k}, {n} answers", "", about(cell, tight), "", *table(measured[k, n])]
            )
    items = {
        (k, n): item_lines(k, n, sets, m, seed)
        for k in levels
        for n in answers
        if n >= PER_ITEM * k
    }
    yield [
        "# The cost of an answer of an unreliable tutor",
        "",
        *fastest(measured, items),
        "",
        *head,
    ]
    yield from parts
    if items:
        yield from item_tables(items, sets, m)


def costs(cell: list[Data], tight: list[References]) -> list[Line]:
    """Measure the cost of each method on these data sets, and the verdicts of its rule."""
    return [cost(entry, cell, tight) for entry in ENTRIES]


def cost(entry: Entry, cell: list[Data], tight: list[References]) -> Line:
    """One method, on all data sets."""
    every = len(cell[0].counts)
    fits = every if entry.fits is None else min(entry.fits, every)
    runs = [entry.run(data, fits) for data in cell]
    remarks, error = [], None
    if isinstance(entry.solves, Problem):
        known = [
            (run.gamma, exact[entry.solves], data)
            for run, exact, data in zip(runs, tight, cell, strict=True)
        ]
        off = np.concatenate([distances(gamma, exact, data.top) for gamma, exact, data in known])
        error = float(off[np.isfinite(off)].max(initial=0.0)) if np.isfinite(off).any() else None
        said = [rule(completed(gamma, exact), data.fresh) for gamma, exact, data in known]
        remarks += [f"{len(off)} of {every * len(cell)} fits run"] * (fits < every)
        remarks += [f"{np.isnan(off).sum()} of {len(off)} failed"] * bool(np.isnan(off).any())
        remarks += [f"{np.isinf(off).sum()} of {len(off)} where no maximum exists"] * bool(
            np.isinf(off).any()
        )
    else:
        said = [run.verdicts for run in runs]
        late = 1e3 * sum(run.late for run in runs) / len(runs)
        remarks.append(f"{late:.2f} ms in the last tenth of the run{runs[0].remark}")
    verdicts, truth = np.concatenate(said), np.concatenate([data.truth for data in cell])
    decided = np.isin(verdicts, (Verdict.WORSE, Verdict.BETTER))
    return Line(
        entry.name,
        str(entry.solves),
        1e3 * sum(run.seconds for run in runs) / len(runs),
        error,
        float(decided.mean()),
        float((verdicts != truth)[decided].mean()) if decided.any() else 0.0,
        "; ".join(remarks),
    )


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="What an answer of an unreliable tutor costs, by method."
    )
    parser.add_argument(
        "--answers",
        type=int,
        nargs="+",
        help="numbers of answers (default: 30 300 3000; quick: 30)",
    )
    parser.add_argument(
        "--levels", type=int, nargs="+", help="numbers of levels k (default: 5 10 20; quick: 5)"
    )
    parser.add_argument("--sets", type=int, help="data sets for each table (default: 4; quick: 1)")
    parser.add_argument(
        "--resamples", type=int, help="bootstrap resamples m (default: 200; quick: 40)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of the first data set; the others follow"
    )
    parser.add_argument("--quick", action="store_true", help="seconds, rough figures")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md", help="write the report there as well"
    )
    options = parser.parse_args(arguments)
    options.levels = options.levels or ([5] if options.quick else [5, 10, 20])
    options.answers = options.answers or ([30] if options.quick else [30, 300, 3000])
    options.sets = options.sets or (1 if options.quick else 4)
    options.resamples = options.resamples or (40 if options.quick else 200)
    if min(options.levels) < 3:
        parser.error("--levels must be at least 3: the order of two settles every pair")
    for name in ("answers", "sets", "resamples"):
        if np.min(getattr(options, name)) < 1:
            parser.error(f"--{name} must be at least 1")
    return options


if __name__ == "__main__":
    main()
