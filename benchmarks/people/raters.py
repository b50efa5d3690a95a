"""One rater who answers at random beside four good ones: how far do they move the learned scale?

    python -m benchmarks.people.raters --out benchmarks/RESULTS-raters.md    about five minutes
    python -m benchmarks.people.raters --seeds 4                             rough figures

Five people answer the same number of random questions each. Four have one scale, a precision of 30
and a lapse of 5%; the fifth tosses a coin. The scale learned from all is compared with the one from
the four, with all answers taken as one person's and with ``raters=True``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.reporting import machine, markdown, publish, with_interval
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.model.query import Answers
from elicit.model.scale import Floats, normalise
from elicit.tutors.erring_tutor import says_left

PEOPLE = ("ann", "ben", "chen", "dora", "eve")
K, PRECISION, LAPSE = 4, 30.0, 0.05
EACH = (20, 40)  # answers of each person
HEAD = ("answers each", "as one person", "as raters", "ratio")


def answers_of_five(seed: int, each: int) -> Answers:
    """Return the answers of all five, by turns; the last one's are at random."""
    rng = np.random.default_rng(seed)
    values = normalise(np.concatenate([[0], np.cumsum(rng.dirichlet(np.ones(K - 1)))]))
    n = each * len(PEOPLE)
    d = rng.dirichlet(np.full(K, 0.7), n) - rng.dirichlet(np.full(K, 0.7), n)
    chance = np.asarray(says_left(d @ values, PRECISION, LAPSE))
    who = [PEOPLE[i % len(PEOPLE)] for i in range(n)]
    chance = np.where(np.array(who) == PEOPLE[-1], 0.5, chance)
    return Answers(d, np.where(rng.random(n) < chance, 1, -1), who=who)


def moved(seed: int, each: int, raters: bool) -> float:
    """Return the greatest change in a level's value that the random answers make."""
    answers = answers_of_five(seed, each)
    good = answers.take([row for row, who in enumerate(answers.who) if who != PEOPLE[-1]])
    fresh = PosteriorComparator(K, seed=seed, raters=raters)
    return float(np.abs(fresh.update(answers).values - fresh.update(good).values).max())


def changes(seeds: int, each: int, raters: bool) -> Floats:
    """Return the greatest change of each draw (seeds,), in percent of the value range."""
    return 100 * np.array([moved(seed, each, raters) for seed in range(seeds)])


def row(each: int, pooled: Floats, apart: Floats) -> list[str]:
    """Return a row of the table from the changes without and with ``raters=True``."""
    ratio = f"{apart.mean() / pooled.mean():.2f}"
    return [str(each), with_interval(pooled, 1), with_interval(apart, 1), ratio]


def report(seeds: int) -> Iterator[list[str]]:
    """Yield the parts of the page."""
    yield ["# Raters: one who answers at random beside four good ones", "", machine("one thread")]
    yield [
        f"Five people answer the same number of random questions about {K} levels. Four of them "
        f"have one scale, a precision of {PRECISION:g} and a lapse of {LAPSE:.0%}. The fifth "
        "tosses a coin. `PosteriorComparator` learns a scale from the answers of all five, and "
        "another one from the answers of the four."
    ]
    yield [
        "The numbers are the greatest difference between the two scales in the value of a level, "
        f"in percent of the value range: the mean over {seeds} draws of the scale, the questions "
        "and the answers, with its 95% t-interval. *As one person*: all answers are taken as one "
        "person's. *As raters*: `raters=True` learns the precision and the lapse of each person. "
        "*Ratio*: the second mean divided by the first."
    ]
    rows = [
        row(each, changes(seeds, each, raters=False), changes(seeds, each, raters=True))
        for each in EACH
    ]
    yield markdown(HEAD, rows, 1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.people.raters", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--seeds", type=int, default=20, help="runs of each row (default: 20)")
    parser.add_argument("--out", type=Path, help="the page to write")
    given = parser.parse_args(arguments)
    publish(report(given.seeds), given.out, f"0-{given.seeds - 1}")


if __name__ == "__main__":
    main()
