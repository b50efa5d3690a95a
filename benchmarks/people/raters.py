"""One rater who answers at random beside four good ones: how far do they move the learned scale?

    python -m benchmarks.people.raters              about five minutes
    python -m benchmarks.people.raters --seeds 4    rough figures

Five people answer the same number of random questions each. Four have one scale, a precision of 30
and a lapse of 5%; the fifth tosses a coin. The scale learned from all is compared with the one from
the four, with all answers taken as one person's and with ``raters=True``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from benchmarks.reporting import markdown
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.model.query import Answers
from elicit.model.scale import normalise
from elicit.tutors.erring_tutor import says_left

PEOPLE = ("ann", "ben", "chen", "dora", "eve")
K, PRECISION, LAPSE = 4, 30.0, 0.05


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


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.people.raters", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--seeds", type=int, default=20, help="runs of each row (default: 20)")
    given = parser.parse_args(arguments)
    rows = []
    for each in (20, 40):
        pooled, apart = (
            np.array([moved(seed, each, raters) for seed in range(given.seeds)])
            for raters in (False, True)
        )
        shares = [f"{100 * change.mean():.1f}" for change in (pooled, apart)]
        rows.append([str(each), *shares, f"{apart.mean() / pooled.mean():.2f}"])
    print("\n".join(markdown(("answers each", "as one person", "as raters", "ratio"), rows, 1)))


if __name__ == "__main__":
    main()
