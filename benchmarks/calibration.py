"""How often the noisy-tutor comparators are wrong in what they decide, and how much that is.

    python -m benchmarks.calibration [--quick] [--out FILE.md] [--csv FILE.csv] [--jobs N] [--levels 5 10 20] [--seed N]

A data set is a scale, a tutor and what she answered. On random pairs: 1000 answers in order, and after each of
``COUNTS`` of them the verdicts on fresh pairs. On a learner's pairs: a run of Q-learning or value iteration asks what
the comparator in question leaves open, up to a budget, and its verdicts on what the run compares are judged.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

# read when the libraries load, hence set before they do
os.environ |= {f"{pool}_NUM_THREADS": "1" for pool in ("OPENBLAS", "OMP", "MKL", "NUMBA")}
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import argparse
import csv
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
from time import perf_counter
from typing import NamedTuple, TypeAlias

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from benchmarks.lp import machine
from elicit.bradley_terry import BradleyTerryComparator
from elicit.comparator import Comparator, Tier
from elicit.posterior import PosteriorComparator
from elicit.query import Answers, Verdict
from elicit.scale import Floats, dominance, tail_sums, values_of
from elicit.tutor import BradleyTerryTutor, FlippingTutor, TruthfulTutor
from qlearn import InteractiveQLearning, InteractiveValueIteration, drive, random_mdp
from qlearn.metrics import Watch, reference_differences

Rng: TypeAlias = np.random.Generator
Ints: TypeAlias = NDArray[np.int64]
Rule: TypeAlias = Callable[[int, float, float], Comparator]
PROMISE = 0.05
ENOUGH_DECIDED, ENOUGH_SETS = 200, 30  # a cell with fewer is shown, not judged
COUNTS = (10, 30, 100, 300, 1000)
FRESH = 300  # pairs judged a data set
RESAMPLES = 2000
LEAST_GAP = 1e-9  # a tutor's levels must differ in floats


class Setting(NamedTuple):
    """A law of scales, and a tutor: the standard deviation of her logits over the pairs asked, or 0 for 10% flips.
    ``counts``: after how many answers fresh pairs are judged. ``learners``: whether learners run on it too."""

    name: str
    law: str
    spread: float
    counts: tuple[int, ...] = COUNTS[:-1]
    learners: bool = False


SETTINGS = (
    Setting("scales from the prior, logit sd 1", "prior", 1.0, COUNTS),
    Setting("scales from the prior, logit sd 2", "prior", 2.0, COUNTS, True),
    Setting("scales from the prior, logit sd 5", "prior", 5.0, COUNTS),
    Setting("scales from the prior, 10% flips", "prior", 0.0, learners=True),
    Setting("skewed scales (Dirichlet .2), logit sd 2", "skewed", 2.0, learners=True),
    Setting("one huge gap (.9 of the range), logit sd 2", "two-step", 2.0),
    Setting("geometric gaps (ratio 2 or 1/2), logit sd 2", "geometric", 2.0),
)


def posterior(k: int, precision: float, growth: float) -> Comparator:
    return PosteriorComparator(k)


def posterior_uniform(k: int, precision: float, growth: float) -> Comparator:
    return PosteriorComparator(k, shape=(1.0, 1.0))


def posterior_lapse(k: int, precision: float, growth: float) -> Comparator:
    return PosteriorComparator(k, lapse=0.1)


def ensemble(k: int, precision: float, growth: float) -> Comparator:
    return BradleyTerryComparator(k, precision=precision, refit_growth=growth)


def box(k: int, precision: float, growth: float) -> Comparator:
    return BradleyTerryComparator(k, precision=precision, refit_growth=growth, region="box")


def box_rescaled(k: int, precision: float, growth: float) -> Comparator:
    return BradleyTerryComparator(k, precision=precision, refit_growth=growth, region="box", rescale=True)


RULES: dict[str, Rule] = {
    "posterior": posterior,
    "posterior, lapse .1": posterior_lapse,
    "posterior, shape (1, 1)": posterior_uniform,
    "ensemble": ensemble,
    "box": box,
    "box, rescaled": box_rescaled,
}


class Size(NamedTuple):
    """How much to run: data sets on fresh pairs and with learners, levels, answers, budget, steps and sweeps."""

    sets: int
    runs: int
    levels: tuple[int, ...]
    most: int
    budget: int
    steps: int
    sweeps: int


FULL = Size(40, 30, (5, 10, 20), COUNTS[-1], 100, 2000, 30)
QUICK = Size(4, 2, (5,), 100, 30, 400, 8)


class Row(NamedTuple):
    """One rule on one data set: how many pairs were open, decided and decided wrongly; ``seconds`` for the answers
    since the row before."""

    pairs: str
    setting: str
    rule: str
    k: int
    answers: int
    number: int
    open: int
    decided: int
    wrong: int
    seconds: float
    learned: int


class Share(NamedTuple):
    """A share, and the ends of its 95% interval; nan of nothing."""

    at: float
    low: float
    high: float

    @staticmethod
    def of(part: int, whole: int, parts: Ints, wholes: Ints) -> Share:
        """Of the totals, and of the totals (m,) of resamples."""
        some = wholes > 0
        if not whole or not some.any():
            return Share(np.nan, np.nan, np.nan)
        return Share(part / whole, *np.quantile(parts[some] / wholes[some], (0.025, 0.975)).tolist())


class Cell(NamedTuple):
    """All data sets of one rule, setting, k and number of answers together."""

    pairs: str
    setting: str
    rule: str
    k: int
    answers: int
    sets: int
    open: int
    decided: int
    wrong: int
    share_decided: Share
    share_wrong: Share
    judged: bool
    ms_per_answer: float

    @property
    def broken(self) -> bool:
        """Whether the promise surely does not hold."""
        return self.judged and self.share_wrong.low > PROMISE

    def flat(self) -> dict[str, object]:
        """A line of the table of cells."""
        line: dict[str, object] = {}
        for name, value in self._asdict().items():
            if isinstance(value, Share):
                line |= {name: value.at, f"{name}_low": value.low, f"{name}_high": value.high}
            else:
                line[name] = value
        return line


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark; print its tables and write them where told."""
    options = _options(arguments)
    size = QUICK if options.quick else FULL
    if options.levels:
        size = size._replace(levels=tuple(options.levels))
    cells = summary(measure(size, options.seed, options.jobs))
    text = "\n".join(report(cells, size))
    print(text)
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(text + "\n", encoding="utf-8")
    if options.csv is not None:
        options.csv.parent.mkdir(parents=True, exist_ok=True)
        with options.csv.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(cells[0].flat()))
            writer.writeheader()
            writer.writerows(c.flat() for c in cells)


def measure(size: Size, seed: int, jobs: int) -> list[Row]:
    """All rows, in an order that does not depend on the number of jobs."""
    _warm_up(size.levels)
    tasks = [
        delayed(on_fresh_pairs)(s, k, i, seed, size) for k in size.levels for s in SETTINGS for i in range(size.sets)
    ]
    for pairs in ("Q-learning", "value iteration"):
        chosen = [s for s in SETTINGS if s.learners]
        tasks += [
            delayed(on_a_learner)(pairs, s, k, i, seed, size)
            for k in size.levels
            for s in chosen
            for i in range(size.runs)
        ]
    return [row for rows in Parallel(n_jobs=jobs)(tasks) for row in rows]


def on_fresh_pairs(setting: Setting, k: int, number: int, seed: int, size: Size) -> list[Row]:
    """Each rule after some of the answers to random questions, on other random pairs."""
    rng = np.random.default_rng([seed, SETTINGS.index(setting), k, number])
    values = scale(setting.law, k, rng)
    counts = [n for n in setting.counts if n <= size.most]
    asked, fresh = open_pairs(k, counts[-1], rng), open_pairs(k, FRESH, rng)
    told, precision = tutor(setting, values, asked, number)
    y, truth = told.signs(asked), TruthfulTutor(values).signs(fresh)
    rows = []
    for name in rules(setting):
        comparator, known = RULES[name](k, precision, 0.05), 0
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


def on_a_learner(pairs: str, setting: Setting, k: int, number: int, seed: int, size: Size) -> list[Row]:
    """Each rule in a learner's hands, on what the learner compared and neither equality nor dominance settled."""
    rng = np.random.default_rng([seed, SETTINGS.index(setting), k, number, len(pairs)])
    values = scale(setting.law, k, rng)
    mdp, _ = random_mdp(50, 4, k, rng=rng)
    reference = reference_differences(mdp, values)
    rows = []
    for name in rules(setting):
        told, precision = tutor(setting, values, reference, number)
        comparator, key = RULES[name](k, precision, 0.25), int(number)
        learner: InteractiveQLearning | InteractiveValueIteration
        if pairs == "Q-learning":
            learner = InteractiveQLearning(mdp, comparator, steps=size.steps, max_queries=size.budget, rng=key)
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
        counted = (result.compared - trivial, judged_before + judged_after, wrong_before + wrong_after)
        rows.append(Row(pairs, setting.name, name, k, size.budget, number, *counted, seconds, result.asked))
    return rows


def rules(setting: Setting) -> list[str]:
    """The rules to try; another lapse is for tutors who flip."""
    return [name for name in RULES if "lapse" not in name or not setting.spread]


def scale(law: str, k: int, rng: Rng) -> Floats:
    """Values (k,) of a scale from 0 to 1."""
    p = k - 1
    if law == "prior":  # gaps from Dirichlet(a), log a uniform on [log .1, log 2]: log gamma variates may underflow
        a = 0.1 * 20.0 ** rng.random()
        log_gaps = np.log(rng.standard_gamma(a + 1.0, p)) + np.log(rng.random(p)) / a
        gaps = np.exp(log_gaps - log_gaps.max())
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
    """The tutor, and the precision to tell the Bradley-Terry rules: her own, or their default where she has none."""
    spread = float(np.std(asked @ values)) if len(asked) else 0.0
    if not setting.spread:
        return FlippingTutor(values, 0.1, seed), 10.0
    precision = setting.spread / spread if spread > 0 else 10.0
    return BradleyTerryTutor(values, precision, seed), precision


def open_pairs(k: int, n: int, rng: Rng) -> Floats:
    """n differences (n, k) of uniform share vectors that dominance leaves open."""
    found: list[Floats] = []
    while sum(map(len, found)) < n:
        d = rng.dirichlet(np.ones(k), 2 * n) - rng.dirichlet(np.ones(k), 2 * n)
        found.append(d[dominance(tail_sums(d)) == Verdict.UNKNOWN])
    return np.concatenate(found)[:n]


def summary(rows: Iterable[Row]) -> list[Cell]:
    """The data sets of each cell together."""
    ordered = sorted(rows, key=_cell_of)  # stable: data sets stay in order
    return [cell(list(group)) for _, group in groupby(ordered, key=_cell_of)]


def cell(rows: list[Row]) -> Cell:
    """Pooled shares, with percentile intervals from resampled data sets."""
    counts = np.array([(row.open, row.decided, row.wrong) for row in rows])
    n, first, (opened, decided, wrong) = len(rows), rows[0], counts.sum(axis=0).tolist()
    weights = np.random.default_rng(0).multinomial(n, np.full(n, 1.0 / n), RESAMPLES)
    resampled = (weights @ counts).T
    return Cell(
        pairs=first.pairs,
        setting=first.setting,
        rule=first.rule,
        k=first.k,
        answers=first.answers,
        sets=n,
        open=opened,
        decided=decided,
        wrong=wrong,
        share_decided=Share.of(decided, opened, resampled[1], resampled[0]),
        share_wrong=Share.of(wrong, decided, resampled[2], resampled[1]),
        judged=n >= ENOUGH_SETS and decided >= ENOUGH_DECIDED,
        ms_per_answer=1e3 * sum(row.seconds for row in rows) / max(1, sum(row.learned for row in rows)),
    )


def report(cells: list[Cell], size: Size) -> Iterator[str]:
    """The report, as lines of Markdown."""
    yield from ("# Wrong among decided", "", *machine(), "", *NOTES, "")
    for (pairs, setting), group in groupby(cells, key=lambda c: (c.pairs, c.setting)):
        here = list(group)
        names = [name for name in RULES if any(c.rule == name for c in here)]
        yield from (f"## {_TITLES[pairs]}: {setting}", "", "| k | answers | " + " | ".join(names) + " |")
        yield "|---:|---:|" + "---|" * len(names)
        for k, n in sorted({(c.k, c.answers) for c in here}):
            found = {c.rule: c for c in here if (c.k, c.answers) == (k, n)}
            yield f"| {k} | {n} | " + " | ".join(shown(found[name]) for name in names) + " |"
        yield ""
    yield from costs(cells)
    broken = [c for c in cells if c.broken]
    judged = sum(c.judged for c in cells)
    yield from (
        "## Promises broken",
        "",
        f"{judged} of {len(cells)} cells are judged; {len(broken)} break the promise.",
        "",
    )
    for c in sorted(broken, key=lambda c: -c.share_wrong.low):
        yield f"- {c.rule}; {_TITLES[c.pairs].lower()}, {c.setting}, k = {c.k}, {c.answers} answers: {shown(c)}"


def shown(c: Cell) -> str:
    """A cell of the tables."""
    if not c.decided:
        return "0 / -"
    decided, (at, low, high) = 100 * c.share_decided.at, (100 * x for x in c.share_wrong)
    text = f"{decided:.0f} / {at:.1f} [{low:.1f}, {high:.1f}]"
    return f"**{text}**" if c.broken else text if c.judged else f"({text})"


def costs(cells: list[Cell]) -> Iterator[str]:
    """Milliseconds an answer on fresh pairs, where the answers come one after the other."""
    fresh = [c for c in cells if c.pairs == "fresh" and c.rule.startswith("posterior")]
    counts = sorted({c.answers for c in fresh})
    yield from ("## Milliseconds an answer, the verdicts on fresh pairs included", "")
    yield "| k | rule | " + " | ".join(f"up to {n}" for n in counts) + " |"
    yield "|---:|---|" + "---:|" * len(counts)
    for k, rule in sorted({(c.k, c.rule) for c in fresh}):
        means = [[c.ms_per_answer for c in fresh if (c.k, c.rule, c.answers) == (k, rule, n)] for n in counts]
        yield f"| {k} | {rule} | " + " | ".join(f"{np.mean(m):.2f}" if m else "-" for m in means) + " |"
    yield ""


def _cell_of(row: Row) -> tuple[int, int, int, int, int]:
    names = [s.name for s in SETTINGS]
    return [*_TITLES].index(row.pairs), names.index(row.setting), row.k, row.answers, [*RULES].index(row.rule)


def _warm_up(levels: Iterable[int]) -> None:
    """Compile once, before the workers would each do it."""
    for k in levels:
        comparator = PosteriorComparator(k).update(Answers(np.eye(k)[:1] - np.eye(k)[1:2], [1]))
        comparator.compare(np.eye(k)[:1] - np.eye(k)[1:2])


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="How often noisy-tutor comparators are wrong in what they decide.")
    parser.add_argument("--quick", action="store_true", help="few data sets: seconds, and nothing is judged")
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="write the report there as well")
    parser.add_argument("--csv", type=Path, metavar="FILE.csv", help="write one line a cell there")
    parser.add_argument("--jobs", type=int, default=2, help="processes, one thread each")
    parser.add_argument("--levels", type=int, nargs="+", help="numbers of levels k")
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args(arguments)


_TITLES = {
    "fresh": "Fresh pairs",
    "Q-learning": "Pairs that Q-learning chose",
    "value iteration": "Pairs that value iteration chose",
}
NOTES = [
    "Each entry: percent decided of the pairs that dominance leaves open / percent wrong among these [95% interval, "
    f"data sets resampled {RESAMPLES} times]. In brackets: fewer than {ENOUGH_DECIDED} decided pairs or {ENOUGH_SETS} "
    f"data sets, not judged. Bold: the interval lies wholly above {PROMISE:.0%}. Where nothing is wrong in any data "
    "set the interval has no width.",
    "",
    "Shares are pooled over data sets: a posterior rule promises that much on average over scales from its prior. The "
    "rows of one k share their data sets. The Bradley-Terry rules are told the tutor's own precision (10 where she "
    "flips), the posterior ones learn it; both meet a default lapse of .05. With learners the budget is the number "
    "of answers at most, and the fits are renewed at every fourth more answers only (`refit_growth=0.25`).",
]


if __name__ == "__main__":
    main()
