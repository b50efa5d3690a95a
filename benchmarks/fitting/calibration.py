"""Share of wrong decisions of the comparators for noisy tutors, and the size of these errors.

    python -m benchmarks.fitting.calibration [--quick] [--journal FILE] [--out FILE.md] [--csv
    FILE.csv]
        [--jobs N] [--levels 5 10 20] [--rules posterior ...] [--settings flips ...] [--seed N]

A data set is a scale, a tutor and the answers. On random pairs: 1000 answers in order, and
after each of ``COUNTS`` of them the verdicts on fresh pairs. On a learner's pairs: a run of
Q-learning or value iteration asks what the comparator in question leaves open, up to a budget, and
its verdicts on what the run compares are judged. ``calibration_questions`` counts what the lapse
costs that nobody tells. ``--journal`` keeps finished data sets: while the code is the same, the
same command goes on where it was stopped.
"""

from __future__ import annotations

import os

from benchmarks.own_process import ONE_THREAD

os.environ |= ONE_THREAD  # read when the libraries load, hence set before they do

import argparse
import csv
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from time import perf_counter
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.fitting.calibration_tables import Row, report, summary
from benchmarks.fitting.tutor_data import open_pairs
from benchmarks.reporting import save
from benchmarks.stamps import sources
from elicit.comparators.bradley_terry.bootstrap_comparator import BradleyTerryComparator
from elicit.comparators.bradley_terry.first_particles import CONCENTRATION
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.model.comparator import Comparator, Tier
from elicit.model.difference import as_vectors, tail_sums
from elicit.model.query import Answers
from elicit.model.scale import Floats, values_of
from elicit.tutors.simulated import BradleyTerryTutor, FlippingTutor, Signs, TruthfulTutor
from qlearn import InteractiveQLearning, InteractiveValueIteration, drive, random_mdp
from qlearn.experiments.metrics import Watch, reference_differences
from qlearn.experiments.parallel import Cell, sweep

Rng: TypeAlias = np.random.Generator
Rule: TypeAlias = Callable[
    [int, float, float, float], Comparator
]  # of k, precision, lapse, refit_growth
COUNTS = (10, 30, 100, 300, 1000)
FRESH = 300  # pairs judged a data set
LEAST_GAP = 1e-9  # a tutor's levels must differ in floats


class Setting(NamedTuple):
    """A law of scales, and a tutor: the standard deviation of their logits over the pairs asked,
    or 0 where they flip a share ``flips`` of the answers instead; ``equal``: the largest |d.e| that
    they call equal. ``counts``: after how many answers fresh pairs are judged. ``learners``: True
    if learners run on it too. ``times``: how many times as many data sets."""

    name: str
    law: str
    spread: float
    counts: tuple[int, ...] = COUNTS[:-1]
    learners: bool = False
    times: int = 1
    flips: float = 0.0
    equal: float = 0.0


SETTINGS = (
    Setting("scales from the prior, logit sd 1", "prior", 1.0, COUNTS),
    Setting("scales from the prior, logit sd 2", "prior", 2.0, COUNTS, True),
    Setting("scales from the prior, logit sd 5", "prior", 5.0, COUNTS),
    Setting("scales from the prior, 10% flips", "prior", 0.0, learners=True, flips=0.1),
    Setting("skewed scales (Dirichlet .2), logit sd 2", "skewed", 2.0, learners=True),
    Setting("even scales (Dirichlet 1), logit sd 2", "even", 2.0),
    Setting("one huge gap (.9 of the range), logit sd 2", "two-step", 2.0, COUNTS[:3], times=3),
    Setting("geometric gaps (ratio 2 or 1/2), logit sd 2", "geometric", 2.0, COUNTS[:3], times=3),
    Setting("scales from the prior, no flips", "prior", 0.0, learners=True),
    Setting("scales from the prior, 5% flips", "prior", 0.0, learners=True, flips=0.05),
    Setting("scales from the prior, 20% flips", "prior", 0.0, learners=True, flips=0.2),
    Setting("scales from the prior, 30% flips", "prior", 0.0, learners=True, flips=0.3),
    Setting(
        "scales from the prior, no flips, equal within .005",
        "prior",
        0.0,
        learners=True,
        equal=0.005,
    ),
    Setting(
        "scales from the prior, no flips, equal within .02", "prior", 0.0, learners=True, equal=0.02
    ),
    Setting(
        "scales from the prior, 10% flips, equal within .01",
        "prior",
        0.0,
        learners=True,
        flips=0.1,
        equal=0.01,
    ),
)  # in this order ever since: a setting's place is part of its seed


def posterior(k: int, precision: float, lapse: float, growth: float) -> Comparator:
    return PosteriorComparator(k)


def posterior_told(k: int, precision: float, lapse: float, growth: float) -> Comparator:
    return PosteriorComparator(k, lapse=lapse)


def ensemble(k: int, precision: float, lapse: float, growth: float) -> Comparator:
    return BradleyTerryComparator(k, precision=precision, refit_growth=growth, region="ensemble")


def box(k: int, precision: float, lapse: float, growth: float) -> Comparator:
    return BradleyTerryComparator(k, precision=precision, refit_growth=growth, region="box")


RULES: dict[str, Rule] = {
    "posterior": posterior,
    "posterior, lapse told": posterior_told,
    "ensemble": ensemble,
    "box": box,
}


class Size(NamedTuple):
    """The size of a run.

    It has data sets on fresh pairs and with learners, levels, answers, budget, steps and sweeps.
    """

    sets: int
    runs: int
    levels: tuple[int, ...]
    most: int
    budget: int
    steps: int
    sweeps: int


FULL = Size(36, 30, (5, 10, 20), COUNTS[-1], 100, 2000, 30)
QUICK = Size(4, 2, (5,), 100, 30, 400, 8)


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark; print its tables and write them where told."""
    options = _options(arguments)
    size = QUICK if options.quick else FULL
    if options.levels:
        size = size._replace(levels=tuple(options.levels))
    chosen = [s for s in SETTINGS if any(part in s.name for part in options.settings)]
    cells = summary(
        measure(size, options.seed, options.jobs, chosen, options.rules, options.journal)
    )
    text = "\n".join(report(cells))
    print(text)
    save(text + "\n", options.out, str(options.seed))
    if options.csv is not None:
        options.csv.parent.mkdir(parents=True, exist_ok=True)
        with options.csv.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(cells[0].flat()))
            writer.writeheader()
            writer.writerows(c.flat() for c in cells)


def measure(
    size: Size,
    seed: int,
    jobs: int,
    settings: Sequence[Setting],
    rules: Sequence[str],
    journal: Path | None = None,
) -> list[Row]:
    """All rows, in an order that does not depend on the number of jobs; a journal keeps those of
    finished data sets.
    """
    _warm_up(size.levels)
    cells = [
        {"pairs": "fresh", "setting": s.name, "k": k, "number": i}
        for k in size.levels
        for s in settings
        for i in range(s.times * size.sets)
    ]
    cells += [
        {"pairs": pairs, "setting": s.name, "k": k, "number": i}
        for pairs in ("Q-learning", "value iteration")
        for k in size.levels
        for s in settings
        if s.learners
        for i in range(size.runs)
    ]
    from benchmarks.fitting import (
        calibration,
    )  # by the name that workers and the journal know, not as __main__

    shared = {
        "seed": seed,
        "rules": list(rules),
        "size": [size.most, size.budget, size.steps, size.sweeps],
    }
    made_of = sources(calibration.__name__)  # a row of other code is none of these
    how = {"shared": shared, "journal": journal, "jobs": jobs}
    found = sweep(calibration.on_a_data_set, cells, own=lambda cell: (made_of, {}), **how)
    return [Row(*row) for rows in found for row in rows]


def on_a_data_set(cell: Cell, seed: int, rules: Sequence[str], size: Sequence[int]) -> list[Row]:
    """The rows of one data set; ``size`` has the answers, the budget, the steps and the sweeps at
    most.
    """
    setting = next(s for s in SETTINGS if s.name == cell["setting"])
    most = Size(0, 0, (), *size)
    if cell["pairs"] == "fresh":
        return on_fresh_pairs(setting, cell["k"], cell["number"], seed, most, rules)
    return on_a_learner(cell["pairs"], setting, cell["k"], cell["number"], seed, most, rules)


def on_fresh_pairs(
    setting: Setting, k: int, number: int, seed: int, size: Size, rules: Sequence[str]
) -> list[Row]:
    """Each rule after some of the answers to random questions, on other random pairs."""
    rng = np.random.default_rng([seed, SETTINGS.index(setting), k, number])
    values = scale(setting.law, k, rng)
    counts = [n for n in setting.counts if n <= size.most]
    asked, fresh = open_pairs(k, counts[-1], rng), open_pairs(k, FRESH, rng)
    told, precision = tutor(setting, values, asked, number)
    y, truth = told.signs(asked), TruthfulTutor(values).signs(fresh)
    rows = []
    for name in rules:
        comparator, known = RULES[name](k, precision, 2.0 * setting.flips, 0.05), 0
        for n in counts:
            start = perf_counter()
            comparator = comparator.update(Answers(asked[known:n], y[known:n]))
            verdicts = comparator.compare(fresh)
            seconds = perf_counter() - start
            decided = np.abs(verdicts) == 1
            wrong = np.count_nonzero(decided & (truth != 0) & (verdicts != truth))
            counted = (len(fresh), int(np.count_nonzero(decided)), int(wrong), seconds, n - known)
            rows.append(Row("fresh", setting.name, name, k, n, number, *counted))
            known = n
    return rows


def on_a_learner(
    pairs: str, setting: Setting, k: int, number: int, seed: int, size: Size, rules: Sequence[str]
) -> list[Row]:
    """Each rule in a learner's hands, on what the learner compared and neither equality nor
    dominance settled.
    """
    rng = np.random.default_rng([seed, SETTINGS.index(setting), k, number, len(pairs)])
    values = scale(setting.law, k, rng)
    mdp, _ = random_mdp(50, 4, k, seed=rng)
    reference = reference_differences(mdp, values)
    rows = []
    for name in rules:
        told, precision = tutor(setting, values, reference, number)
        comparator, key = RULES[name](k, precision, 2.0 * setting.flips, 0.25), int(number)
        learner: InteractiveQLearning | InteractiveValueIteration
        if pairs == "Q-learning":
            settings = {"steps": size.steps, "max_queries": size.budget, "seed": key}
            learner = InteractiveQLearning(mdp, comparator, epsilon="constant", **settings)
        else:
            learner = InteractiveValueIteration(
                mdp, comparator, tolerance=0.02, max_sweeps=size.sweeps, max_queries=size.budget
            )
        watch = Watch(values)
        learner.watch(watch)
        start = perf_counter()
        result = drive(learner, told)
        seconds = perf_counter() - start
        trivial = sum(result.decided[tier.name.lower()] for tier in (Tier.EQUAL, Tier.DOMINANCE))
        judged_before, wrong_before, judged_after, wrong_after = watch.counts
        counted = (
            result.compared - trivial,
            judged_before + judged_after,
            wrong_before + wrong_after,
        )
        rows.append(
            Row(pairs, setting.name, name, k, size.budget, number, *counted, seconds, result.asked)
        )
    return rows


def scale(law: str, k: int, rng: Rng) -> Floats:
    """Values (k,) of a scale from 0 to 1."""
    p = k - 1
    if law == "prior":  # the posterior's own; log gamma variates may underflow
        low, high = CONCENTRATION
        a = low * (high / low) ** rng.random() / p
        log_gaps = np.log(rng.standard_gamma(a + 1.0, p)) + np.log(rng.random(p)) / a
        gaps = np.exp(log_gaps - log_gaps.max())
    elif law == "even":
        gaps = rng.dirichlet(np.ones(p))
    elif law == "skewed":
        gaps = rng.dirichlet(np.full(p, 0.2))
    elif law == "two-step":
        gaps = np.full(p, 0.1 / (p - 1))
        gaps[rng.integers(p)] = 0.9
    else:
        gaps = 2.0 ** (np.arange(p) * rng.choice([-1, 1]))
    gaps = np.maximum(gaps / gaps.sum(), LEAST_GAP)
    values = values_of(gaps)
    return np.asarray(values / values[-1])


def tutor(
    setting: Setting, values: Floats, asked: Floats, seed: int
) -> tuple[BradleyTerryTutor | FlippingTutor, float]:
    """The tutor, and the precision to tell the Bradley-Terry rules: the tutor's own, or their
    default where there is none.
    """
    spread = float(np.std(asked @ values)) if len(asked) else 0.0
    if not setting.spread:
        return Blurred(values, setting.flips, seed, setting.equal), 10.0
    precision = setting.spread / spread if spread > 0 else 10.0
    return BradleyTerryTutor(values, precision, seed), precision


class Blurred(FlippingTutor):
    """Calls equal what lies within ``equal``."""

    def __init__(self, values: Floats, error_rate: float, seed: int, equal: float) -> None:
        super().__init__(values, error_rate, seed)
        self._equal = equal

    def signs(self, d: ArrayLike) -> Signs:
        """Answers (n,) to differences d (n, k)."""
        close = np.abs(tail_sums(as_vectors(d, self.k)) @ np.diff(self.values)) <= self._equal
        return np.where(close & (self._equal > 0), np.int8(0), super().signs(d))


def _warm_up(levels: Iterable[int]) -> None:
    """Compile once, before the workers would each do it."""
    for k in levels:
        comparator = PosteriorComparator(k).update(Answers(np.eye(k)[:1] - np.eye(k)[1:2], [1]))
        comparator.compare(np.eye(k)[:1] - np.eye(k)[1:2])


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="How often noisy-tutor comparators are wrong in what they decide."
    )
    parser.add_argument(
        "--quick", action="store_true", help="few data sets: seconds, and nothing is judged"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md", help="write the report there as well"
    )
    parser.add_argument("--csv", type=Path, metavar="FILE.csv", help="write one line a cell there")
    parser.add_argument("--jobs", type=int, default=2, help="processes, one thread each")
    parser.add_argument("--journal", type=Path, help="file that keeps finished data sets")
    parser.add_argument("--levels", type=int, nargs="+", help="numbers of levels k")
    parser.add_argument(
        "--rules", nargs="+", choices=list(RULES), default=list(RULES), help="which to try"
    )
    parser.add_argument(
        "--settings",
        nargs="+",
        metavar="PART",
        default=[""],
        help="parts of the names of those to run",
    )
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()
