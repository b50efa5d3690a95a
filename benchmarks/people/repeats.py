"""Repeated questions to people: disagreement, sides, and laws of error for repeats.

A law needs a scale. With one prize a gamble and few pairs, a scale of one parameter will do: the
value of a prize is its power r. So a person has three or four parameters for each set of gambles,
and importance sampling from the prior is exact enough.
"""

from __future__ import annotations

import csv
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import expit

from benchmarks.people.choices import Bools, choosing_half
from benchmarks.people.error_laws import normalised, spread_of
from elicit.model.scale import Floats
from elicit.people.experiments import GAMBLES
from elicit.tutors.answer_log import AnswerLog

DRAWS = 40_000
POWER = (np.log(0.7), 0.8)  # of log r a priori
PRECISION = (np.log(10.0), 2.0)  # of log c a priori
LAPSE = (0.5, 4.5)  # Beta: a tenth in the mean, and often next to none
WIDTH = (-3.0, 2.0)  # of the log width of EQUAL in logits, for those who ever said it

Pair = tuple[str, str]


class Repeats(NamedTuple):
    """Counts (people, pairs, 3) of left, right, equal; and the pairs' names."""

    names: list[str]
    pairs: list[Pair]
    counts: Floats


def of_logs(logs: Mapping[str, AnswerLog]) -> dict[int, Repeats]:
    """Return the counts of repeated gambles, by set."""
    found: dict[int, dict[tuple[str, Pair], Counter[int]]] = defaultdict(
        lambda: defaultdict(Counter)
    )
    for name, log in logs.items():
        for entry in log:
            number, pair, _ = entry.answer.query.id.split(":")
            found[int(number)][name, (pair[0], pair[1])][int(entry.answer.verdict or 0)] += 1
    repeats = {}
    for number, counts in found.items():
        names, pairs = sorted({name for name, _ in counts}), sorted({pair for _, pair in counts})
        table = np.array([[[counts[n, p][v] for v in (1, -1, 0)] for p in pairs] for n in names])
        repeats[number] = Repeats(names, pairs, table.astype(float))
    return repeats


def of_subsets(path: Path) -> tuple[Repeats, Floats]:
    """Return the counts of the pairs among subsets of five gambles, and for each person the number
    of choices of the side shown left and of choices (people, 2)."""
    counts: dict[tuple[str, Pair], Counter[str]] = defaultdict(Counter)
    sides: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    with open(path, newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if len(row["set"]) == 2:
                counts[row["subject"], (row["set"][0], row["set"][1])][row["choice"]] += 1
                sides[row["subject"]][0] += row["shown"][0] == row["choice"]
                sides[row["subject"]][1] += 1
    names, pairs = sorted({name for name, _ in counts}), sorted({pair for _, pair in counts})
    table = np.array([[[*(counts[n, p][x] for x in p), 0] for p in pairs] for n in names])
    return Repeats(names, pairs, table.astype(float)), np.array([sides[n] for n in names], float)


def minority_shares(counts: Floats) -> Floats:
    """Return the share (...,) of answers to a pair that are not the most frequent one."""
    return np.asarray(1.0 - counts.max(axis=-1) / counts.sum(axis=-1))


def extra_spread(left: Floats, total: Floats) -> float:
    """Return the standard deviation over people of the probability of "left", beyond chance."""
    share = left / total
    chance = (share.mean() * (1 - share.mean()) / total).mean()
    return float(np.sqrt(max(0.0, share.var(ddof=1) - chance)))


class RepeatDraws(NamedTuple):
    """Parameters (n,): log power, log precision, lapse, log width of EQUAL."""

    power: Floats
    precision: Floats
    lapse: Floats
    width: Floats


def draws(n: int = DRAWS, seed: int = 0) -> RepeatDraws:
    """Return n draws from the prior."""
    rng = np.random.default_rng(seed)
    normal = [mean + sd * rng.normal(size=n) for mean, sd in (POWER, PRECISION, WIDTH)]
    return RepeatDraws(normal[0], normal[1], rng.beta(*LAPSE, n), normal[2])


LAWS = {
    "flips": "the same error rate everywhere",
    "logistic": "logistic in d.e",
    "logistic, lapse": "logistic in d.e, lapse",
    "spread": "logistic in d.e / spread of the pair",
    "spread, lapse": "logistic in d.e / spread of the pair, lapse",
}


def log_chances(law: str, drawn: RepeatDraws, number: int, pairs: list[Pair], ties: bool) -> Floats:
    """Return log P(left, right, equal) (draws, pairs, 3) of a set of gambles."""
    gambles = GAMBLES[number]
    names = sorted(gambles)
    prizes = np.array([gambles[name][1] for name in names])
    values = np.concatenate(
        [
            np.zeros((len(drawn.power), 1)),
            (prizes / prizes.max()) ** np.exp(np.minimum(drawn.power, 5.0))[:, None],
        ],
        axis=1,
    )
    bags = np.zeros((len(names), len(names) + 1))
    for i, name in enumerate(names):
        bags[i, 0], bags[i, i + 1] = 1 - gambles[name][0], gambles[name][0]
    left = bags[[names.index(a) for a, _ in pairs]]
    right = bags[[names.index(b) for _, b in pairs]]
    apart = values @ (left - right).T
    if law.startswith("spread"):
        apart = apart / spread_of(values, left, right)
    logits = 1e9 * np.sign(apart) if law == "flips" else np.exp(drawn.precision)[:, None] * apart
    lapse = np.zeros((len(values), 1)) if law in ("logistic", "spread") else drawn.lapse[:, None]
    width = np.exp(drawn.width)[:, None] if ties else 0.0
    answers = 3.0 if ties else 2.0
    yes = lapse / answers + (1 - lapse) * expit(logits - width)
    no = lapse / answers + (1 - lapse) * expit(-logits - width)
    each = np.stack([yes, no, np.maximum(1 - yes - no, 0.0)], axis=-1)
    return np.asarray(np.log(np.maximum(each, 1e-9)))


def held_out_pairs(
    law: str, repeats: Repeats, number: int, drawn: RepeatDraws
) -> tuple[Floats, Floats]:
    """Return for each person the mean log-probability of the answers to each pair by the others
    (people,), and the log weights of all draws by all answers (draws, people)."""
    found, full = np.zeros(len(repeats.names)), np.zeros((len(drawn.power), len(repeats.names)))
    for ties in (False, True):
        logs = log_chances(law, drawn, number, repeats.pairs, ties)
        who = np.flatnonzero((repeats.counts[:, :, 2].sum(axis=1) > 0) == ties)
        for person in who:
            counts = repeats.counts[person]
            by_pair = (logs * counts).sum(axis=-1)  # (draws, pairs)
            full[:, person] = by_pair.sum(axis=1)
            total = 0.0
            for pair in range(len(counts)):
                weights = normalised(full[:, person] - by_pair[:, pair])
                total += float(counts[pair] @ np.log(weights @ np.exp(logs[:, pair])))
            found[person] = total / counts.sum()
    return found, full


def halves(repeats: Repeats) -> Bools:
    """Return which people are of the choosing half."""
    return choosing_half(len(repeats.names))
