"""Laws of the answer "equal", beside each other, by how they predict people who could give it.

    python -m benchmarks.people.equal_laws results/people --out benchmarks/RESULTS-equal.md

Needs a table that is not shipped; docs/people.md says what it holds.

Each law is that of ``PosteriorComparator``, with another share of lapses that say "equal" and
another prior of the width of "equal". The posterior is computed by weighing draws from the prior,
without the comparator's own sampler. So a law that the comparator no longer has can be compared.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logsumexp

from benchmarks.people.choices import choosing_half
from benchmarks.reporting import machine, markdown, publish, with_interval
from elicit.comparators.bradley_terry.density import EQUAL_LAPSES
from elicit.model.difference import tail_sums
from elicit.model.pairs import same_pairs
from elicit.model.query import Answers
from elicit.model.scale import Floats
from elicit.people.experiments import repeated_gambles

SETS = (1, 2)
LEARNED = (20, 40, 80)  # answers of a person that are learned; all others of the set are predicted
ORDERS = 8  # in which a person's answers are dealt
DRAWS = 100_000  # from the prior
TIE = 0.01  # the comparator's default
WIDTHS = {"uniform up to 2 tie": "uniform", "median tie, may be far from it": "logistic"}
SHARES = {"a third": 1 / 3, "one in a hundred": EQUAL_LAPSES}
OLDER = ("a third", "uniform up to 2 tie")
NOW = ("one in a hundred", "median tie, may be far from it")
HEAD = ("lapses that say equal", "width", "choosing half", "gain", "reporting half", "gain")
Counts = NDArray[np.float64]


class Drawn(NamedTuple):
    """Draws from the posterior's prior: gaps (m, k - 1), precision, lapse and chance (m,)."""

    gaps: Floats
    precision: Floats
    lapse: Floats
    chance: Floats  # uniform, of which the width is made


class Dealt(NamedTuple):
    """A person's answers to one set, in one order: counts of left, right, equal by pair."""

    who: str
    learned: Counts  # (3 pairs,)
    others: Counts  # (3 pairs,)


def draws(p: int, count: int) -> Drawn:
    """Return draws from the prior of docs/posterior.md."""
    rng = np.random.default_rng(1)
    shape = np.exp(rng.uniform(np.log(0.2 / p), np.log(2 / p), count))[:, None]
    # the logarithm of a gamma variate of a small shape: the variate itself would underflow
    logs = (
        np.log(rng.standard_gamma(shape + 1, (count, p))) + np.log(rng.random((count, p))) / shape
    )
    gaps = np.exp(logs - logs.max(axis=1, keepdims=True))
    return Drawn(
        gaps / gaps.sum(axis=1, keepdims=True),
        np.exp(rng.normal(np.log(30.0), 2.5, count)),
        rng.beta(1.0, 4.0, count),
        rng.random(count),
    )


def widths(kind: str, chance: Floats) -> Floats:
    """Return the width of "equal" of each draw, as a share of the value range."""
    if kind == "uniform":
        return 2.0 * TIE * chance
    return np.asarray(np.minimum(1.0, TIE * chance / (1.0 - chance)))


def by_pair(logs: Sequence[Answers]) -> tuple[Floats, list[NDArray[np.intp]]]:
    """Return the tail sums (n, k - 1) of the pairs, and where each person's answers are counted.

    Counts have length 3 n: those of "left" for each pair, then of "right", then of "equal".
    """
    pairs: list[Floats] = []
    found: list[list[tuple[int, int]]] = []
    for answers in logs:
        found.append([])
        for t, y in zip(tail_sums(answers.d), answers.y, strict=True):
            ways = same_pairs(t, np.array(pairs)) if pairs else np.zeros(0, np.int8)
            if not ways.any():
                pairs.append(t)
                ways = np.append(ways, np.int8(1))
            at = int(np.flatnonzero(ways)[0])
            found[-1].append(({1: 0, -1: 1, 0: 2}[int(y) * int(ways[at])], at))
    n = len(pairs)
    return np.array(pairs), [np.array([part * n + at for part, at in each]) for each in found]


def dealt(who: str, number: int, places: NDArray[np.intp], size: int) -> Iterator[Dealt]:
    """Deal one person's answers, in every order that has an "equal" among the learned ones."""
    rng = np.random.default_rng([number, int(who)])
    for count in LEARNED:
        for _ in range(ORDERS):
            order = rng.permutation(places)
            learned, others = (
                np.bincount(part, minlength=size).astype(np.float64)
                for part in (order[:count], order[count:])
            )
            if learned[2 * size // 3 :].any():
                yield Dealt(who, learned, others)


def predicted(
    drawn: Drawn, t: Floats, law: tuple[str, str], some: Sequence[Dealt]
) -> tuple[Floats, Floats]:
    """Return two arrays (n,): how well each deal's other answers are predicted by the learned ones.

    The first is the mean log-likelihood of an answer, the second how many draws the weights are
    worth.
    """
    share, width = SHARES[law[0]], widths(WIDTHS[law[1]], drawn.chance)[:, None]
    worth, c, lapse = drawn.gaps @ t.T, drawn.precision[:, None], drawn.lapse[:, None]
    left, right = expit(c * (worth - width)), expit(-c * (worth + width))
    chances = [
        lapse * part + (1.0 - lapse) * np.maximum(each, 1e-30)
        for each, part in (
            (left, (1.0 - share) / 2),
            (right, (1.0 - share) / 2),
            (1.0 - left - right, share),
        )
    ]
    chance = np.concatenate(chances, axis=1)
    logs, found, worth_draws = np.log(chance), [], []
    for one in some:
        weights = logs @ one.learned
        weights = np.exp(weights - logsumexp(weights))
        answer = np.log(np.maximum(chance.T @ weights, 1e-12))
        found.append(float(answer @ one.others / one.others.sum()))
        worth_draws.append(1.0 / float(weights @ weights))
    return np.array(found), np.array(worth_draws)


def by_person(
    folder: Path, choosing: bool, count: int
) -> tuple[Mapping[tuple[str, str], Floats], list[float]]:
    """Return each law's mean log-likelihood (people,) on one half of the people.

    Beside it is the number of draws that each prediction by ``NOW`` is worth.
    """
    laws = [(share, width) for width in WIDTHS for share in SHARES]
    found: dict[tuple[str, str], dict[str, list[float]]] = {law: {} for law in laws}
    worth_draws: list[float] = []
    for number in SETS:
        logs = repeated_gambles(folder / "gambles_45_times.csv", sets=[number])
        chosen = choosing_half(len(logs)) == choosing
        names = [who for who, one in zip(sorted(logs), chosen, strict=True) if one]
        t, places = by_pair([logs[who].answers() for who in names])
        some = [
            one
            for who, each in zip(names, places, strict=True)
            for one in dealt(who, number, each, 3 * len(t))
        ]
        drawn = draws(t.shape[1], count)
        for law in laws:
            values, worth = predicted(drawn, t, law, some)
            worth_draws += worth.tolist() if law == NOW else []
            for one, value in zip(some, values.tolist(), strict=True):
                found[law].setdefault(one.who, []).append(value)
    means = {law: np.array([np.mean(x) for x in each.values()]) for law, each in found.items()}
    return means, worth_draws


def report(folder: Path, count: int) -> Iterator[list[str]]:
    """The parts of the page."""
    yield ["# Laws of equal", "", machine("one thread")]
    (first, worth), (second, more) = (by_person(folder, half, count) for half in (True, False))
    halves, people = (first, second), (len(first[NOW]), len(second[NOW]))
    worth += more
    yield [
        "30 people answered the ten pairs of two sets of gambles 45 times each, and could say "
        '"indifferent" (Regenwetter and Davis-Stober 2012). The law of the posterior was '
        "chosen on the *choosing half* of them. The others are the *reporting half*. The halves "
        "are those of RESULTS-people. (The law was first chosen on the 15 people with odd numbers, "
        "of whom 9 are of the reporting half; the choosing half ranks the laws the same way.)",
        "",
        f"A law learns {', '.join(map(str, LEARNED))} of a person's answers to a set, in {ORDERS} "
        "random orders each, and predicts the person's other answers to it. Only orders with an "
        '"indifferent" among the learned answers count, for without one all laws are the same: '
        f"{people[0]} and {people[1]} people have such orders.",
        "",
        "The numbers are the mean log-likelihood of an answer in nats, a mean over people of each "
        "person's mean, and the *gain* over the first law, paired by person, with its 95% "
        f"t-interval. The posterior is computed by weighing {count:,} draws from the prior, with a "
        f"tie of {TIE:g}. By the last law the median prediction is worth {np.median(worth):,.0f} "
        f"draws, and {np.mean(np.array(worth) < 20):.0%} of them fewer than 20. The first law was "
        "the posterior's until 27 November 2026. The last one is since then.",
        "",
    ]
    rows = []
    for law in halves[0]:
        row = list(law)
        for half in halves:
            row.append(f"{half[law].mean():.3f}")
            row.append(
                "" if law == OLDER else with_interval(half[law] - half[OLDER], 3, signed=True)
            )
        rows.append(row)
    yield markdown(HEAD, rows, 2)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.people.equal_laws", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("folder", type=Path, help="of the table that is not shipped")
    parser.add_argument("--draws", type=int, default=DRAWS, help="from the prior [%(default)s]")
    parser.add_argument("--out", type=Path, help="the page to write")
    given = parser.parse_args(arguments)
    publish(report(given.folder, given.draws), given.out, "1")


if __name__ == "__main__":
    main()
