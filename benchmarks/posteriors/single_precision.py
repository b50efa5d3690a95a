"""CPU time that single precision saves the posterior's moves.

    python -m benchmarks.posteriors.single_precision [--out FILE]

``mcmc.move`` decides on a proposal in single precision, unless its error could change the decision.
``in_double`` decides all of them in double precision. Both move the same particles, in turns, to
the same places.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.reporting import machine, markdown, publish
from elicit import Answers, PosteriorComparator
from elicit._support.hashing import mix
from elicit._support.jit import compiled, compiling
from elicit.comparators.bradley_terry.density import BLOCK, log_prior, powered, slips
from elicit.comparators.bradley_terry.mcmc import SWAPS, move, step, swap, unit
from elicit.model.difference import tail_sums

CELLS = [(k, n) for k in (5, 10, 20) for n in (20, 50, 100, 300, 1000)]
SWEEPS = 16  # as many as the posterior makes at a move
TURNS = 7


@compiled
def in_double(
    x: Any, rows: Any, tied: Any, n: int, last: float, prior: Any, key: Any, turns: int
) -> int:
    """Move particles x (m, >= p) as ``mcmc.move`` does, in double precision only."""
    p, (m, size) = len(rows), x.shape
    proposal, theta, work = np.empty(size), np.empty(p), np.empty((2, BLOCK))
    logs, accepted = np.empty(m), 0
    for i in range(m):
        logs[i] = log_prior(x[i], prior, theta, work)
        lapse, width = slips(x[i], theta, prior)
        logs[i] += powered(theta, rows, tied, n, last, lapse, width, -math.inf, work)
    for draw in range(turns * m):
        i = draw % m
        h = mix(mix(key, 1 + draw // m), i)
        if p > 1 and unit(mix(h, 0)) < SWAPS:
            away = swap(x, i, p, proposal, h)
        else:
            away = step(x, i, p, proposal, h)
        density = log_prior(proposal, prior, theta, work)
        least = logs[i] + math.log(unit(mix(h, 1))) - density
        if density == -math.inf or least > 0.0:
            continue
        lapse, width = slips(proposal, theta, prior)
        found = powered(theta, rows, tied, n, last, lapse, width, least, work)
        if found >= least:
            for j in range(size):
                x[i, j] = proposal[j]
            logs[i] = density + found
            accepted += away
    return accepted


def cell(k: int, n: int, turns: int = TURNS) -> tuple[float, float, bool]:
    """Return the least CPU seconds of a move with single precision and without, and whether the
    particles end in the same places.

    They are the 500 particles of a posterior that has learned n answers, a tenth of them flipped.
    """
    rng = np.random.default_rng([k, n])
    d = rng.dirichlet(np.ones(k), n) - rng.dirichlet(np.ones(k), n)
    y = np.where(d @ np.linspace(0.0, 1.0, k) > 0.0, 1, -1) * np.where(rng.random(n) < 0.1, -1, 1)
    posterior = PosteriorComparator(k, particles=500, seed=0).update(Answers(d, y))
    rows, tied = np.ascontiguousarray((tail_sums(d) * y[:, None]).T), np.zeros(n, np.bool_)
    methods, seconds, ends = (move, in_double), [math.inf, math.inf], [b"", b""]
    with compiling():
        for turn in range(turns + 1):
            for i, method in enumerate(methods):
                x = posterior._x.copy()
                begun = process_time()
                method(x, rows, tied, n, 1.0, posterior._prior, np.uint64(turn), SWEEPS)
                if turn > 0:  # the first may compile
                    seconds[i] = min(seconds[i], process_time() - begun)
                ends[i] += x.tobytes()
    return seconds[0], seconds[1], ends[0] == ends[1]


def report(cells: list[tuple[int, int]], turns: int = TURNS) -> Iterator[list[str]]:
    """The page."""
    yield ["# What single precision saves the posterior", "", machine("one thread a process")]
    yield [
        "CPU milliseconds for 16 moves of each of 500 particles, by levels k and number of "
        "answers; the",
        f"least of {turns}, in turns. The posterior moves its particles after some of the answers.",
    ]
    rows = []
    for k, n in cells:
        single, double, same = cell(k, n, turns)
        rows.append(
            [
                f"{k}",
                f"{n}",
                f"{1000 * single:.1f}",
                f"{1000 * double:.1f}",
                f"{double / single:.2f}",
                "yes" if same else "no",
            ]
        )
    yield markdown(
        ["k", "answers", "with it", "without", "ratio", "the same particles"], rows, words=0
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="the file to write, in Markdown")
    publish(report(CELLS), parser.parse_args().out, "0")


if __name__ == "__main__":
    main()
