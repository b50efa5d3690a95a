"""Posteriors over a tutor's preferences, ours and others': held-out answers, intervals, time.

    python -m benchmarks.posteriors.preference_posteriors --quick
        # seconds; rough figures
    python -m benchmarks.posteriors.preference_posteriors --out benchmarks/RESULTS-posteriors.md

``PosteriorComparator``, the same posterior by plain Hamiltonian Monte Carlo and by emcee's ensemble
sampler, and BoTorch's ``PairwiseGP``, on the same answers. emcee comes with the extra ``test``; for
the Gaussian process ``pip install torch==2.13.0 botorch``. What is not installed is left out, and
the page says so. ``--journal`` keeps finished runs: the same command goes on where it was stopped.
"""

from __future__ import annotations

import os

from benchmarks.own_process import ONE_THREAD

os.environ |= ONE_THREAD  # read when the libraries load, hence set before they do

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import expit

from benchmarks.fitting.calibration import scale
from benchmarks.posteriors import gaussian_process
from benchmarks.posteriors.markov_chains import (
    Density,
    Scales,
    hamiltonian,
    log_posterior,
    scales,
    start,
)
from benchmarks.reporting import machine, markdown, publish, with_interval
from benchmarks.stamps import sources
from elicit import Answers, BradleyTerryTutor, FlippingTutor, PosteriorComparator, Verdict
from elicit.model.difference import dominance, tail_sums
from elicit.model.scale import Floats
from qlearn.experiments.parallel import Cell, sweep

FRESH = 300  # held-out pairs
SPREAD = 2.0  # standard deviation of a logistic tutor's logits
FLIPS = 0.1
TUTORS = ("logistic", "flips")
LAWS = ("even", "skewed", "prior")  # of the scales, in turn
LEVEL = 0.95
GP_DRAWS = 2000
INSTALL = "`pip install emcee torch==2.13.0 botorch`"
LONG = (300, 500, 8)  # warm-up, draws and leaps of the run that others are compared with
Row = dict[str, Any]


class Problem(NamedTuple):
    """Answers y (n,) about left (n, k) and right (n, k), and as many held out; the scale, and the
    chances (FRESH,) that the tutor says left is better."""

    left: Floats
    right: Floats
    y: NDArray[np.int8]
    fresh_left: Floats
    fresh_right: Floats
    fresh_y: NDArray[np.int8]
    values: Floats
    chances: Floats

    @property
    def answers(self) -> Answers:
        return Answers(self.left - self.right, self.y)

    @property
    def fresh(self) -> Floats:
        """Differences (FRESH, k)."""
        return self.fresh_left - self.fresh_right


class Believed(NamedTuple):
    """Under each of m draws of weights (m,): the chance (FRESH, m) that left is said to be better,
    and d.e (FRESH, m) in units of e_k - e_1."""

    weights: Floats
    chance: Floats
    difference: Floats


Method = Callable[
    [Problem, int], tuple[Believed, float]
]  # with a seed; and seconds for one more answer


def draw(k: int, n: int, tutor: str, seed: int) -> Problem:
    """A scale of the law whose turn it is, and a tutor; vectors uniform, without pairs that
    dominance settles.
    """
    rng = np.random.default_rng([seed, k, n, len(tutor)])
    values = scale(LAWS[seed % len(LAWS)], k, rng)
    left, right = (rng.dirichlet(np.ones(k), 8 * (n + FRESH)) for _ in range(2))
    open_ = np.flatnonzero(dominance(tail_sums(left - right)) == Verdict.UNKNOWN)[: n + FRESH]
    left, right = left[open_], right[open_]
    z = (left - right) @ values
    if tutor == "flips":
        signs, chances = (
            FlippingTutor(values, FLIPS, seed).signs(left - right),
            np.where(z > 0, 1 - FLIPS, FLIPS),
        )
    else:
        precision = SPREAD / float(z.std())
        signs, chances = (
            BradleyTerryTutor(values, precision, seed).signs(left - right),
            expit(precision * z),
        )
    return Problem(
        left[:n], right[:n], signs[:n], left[n:], right[n:], signs[n:], values, chances[n:]
    )


def _of_scales(found: Scales, weights: Floats, d: Floats) -> Believed:
    difference = tail_sums(d) @ found.gaps.T
    return Believed(
        weights,
        found.lapse / 2 + (1 - found.lapse) * expit(difference * found.precision),
        difference,
    )


def particles(problem: Problem, seed: int) -> tuple[Believed, float]:
    """Run our posterior with its defaults, and take the lapse by its mean."""
    answers, k = problem.answers, len(problem.values)
    before = PosteriorComparator(k, seed=seed).update(answers[:-1])
    begin = process_time()
    comparator = before.update(answers[-1:])
    more = process_time() - begin
    draws = comparator.draws
    found = Scales(draws.gaps.T, draws.precision, np.full(len(draws.weights), comparator.lapse))
    return _of_scales(found, draws.weights, problem.fresh), more


def by_hamiltonian(
    problem: Problem, seed: int, warm_up: int = 200, draws: int = 200, leaps: int = 8
) -> tuple[Believed, float]:
    """64 chains; nothing is kept from one answer to the next."""
    begin, k, rng = process_time(), len(problem.values), np.random.default_rng(seed)
    kept, _ = hamiltonian(
        log_posterior(problem.answers), start(k, 64, rng), warm_up, draws, rng, leaps
    )
    some = kept[:: max(1, draws // 100)].reshape(-1, k + 1)
    return _of_scales(
        scales(some), np.full(len(some), 1 / len(some)), problem.fresh
    ), process_time() - begin


def by_ensemble(problem: Problem, seed: int, steps: int = 1000) -> tuple[Believed, float]:
    """Run emcee with 64 walkers.

    They move by differential evolution, which mixes better here than its stretch move.
    """
    import emcee

    begin, k, rng = process_time(), len(problem.values), np.random.default_rng(seed)
    density: Density = log_posterior(problem.answers)
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    sampler = emcee.EnsembleSampler(64, k + 1, lambda x: density(x)[0], moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(start(k, 64, rng), 2 * steps)
    some = sampler.get_chain(discard=steps, thin=max(1, steps // 50), flat=True)
    return _of_scales(
        scales(some), np.full(len(some), 1 / len(some)), problem.fresh
    ), process_time() - begin


def by_gaussian_process(name: str) -> Method:
    """The utility of the worst and of the best level, drawn too, are the range that d.e is a share
    of.
    """

    def run(problem: Problem, seed: int) -> tuple[Believed, float]:
        begin, k = process_time(), len(problem.values)
        at = np.concatenate([problem.fresh_left, problem.fresh_right, np.eye(k)[[0, -1]]])
        utility = gaussian_process.utility_draws(
            name, problem.left, problem.right, problem.y, at, GP_DRAWS, seed
        )
        apart = (utility[:, :FRESH] - utility[:, FRESH : 2 * FRESH]).T
        chance = gaussian_process.chance(name, apart)
        whole = utility[:, -1] - utility[:, -2]
        weights = np.full(GP_DRAWS, 1 / GP_DRAWS)
        return Believed(weights, chance, apart / whole), process_time() - begin

    return run


def methods() -> dict[str, Method]:
    """Return the methods whose libraries are installed, by name; ours first."""
    found: dict[str, Method] = {
        "PosteriorComparator": particles,
        "Hamiltonian, same posterior": by_hamiltonian,
    }
    if find_spec("emcee"):
        found["emcee, same posterior"] = by_ensemble
    if gaussian_process.available():
        found |= {name: by_gaussian_process(name) for name in gaussian_process.KERNELS}
    return found


def run(cell: Cell) -> dict[str, Row]:
    """All methods on one problem, one after another: their scores by name."""
    problem = draw(cell["k"], cell["n"], cell["tutor"], cell["seed"])
    long = by_hamiltonian(problem, cell["seed"] + 1, *LONG)[0]
    rows = {
        "": score(
            problem,
            Believed(
                np.ones(1), problem.chances[:, None], (problem.fresh @ problem.values)[:, None]
            ),
        )
    }
    _warm_up()
    for name, method in methods().items():
        begin = process_time()
        believed, more = method(problem, cell["seed"])
        row = score(problem, believed) | {"seconds": process_time() - begin, "more": more}
        if not name.startswith("PairwiseGP"):
            apart = believed.chance @ believed.weights - long.chance @ long.weights
            row["from_long"] = float(np.sqrt((apart**2).mean()))
        rows[name] = row
    return rows


@cache
def _warm_up() -> None:
    """Load and compile once a process what is to be loaded and compiled."""
    tiny = draw(3, 4, "flips", 0)
    for method in methods().values():
        method(tiny, 0)


def score(problem: Problem, believed: Believed) -> Row:
    """Log loss of the held-out answers, in nats; of the interval of ``LEVEL`` for d.e and of that
    for the chance of an answer, how often it holds the truth, and the first one's mean width; and
    of the signs of d.e that are as sure as ``LEVEL``, their share, and how many of them are
    wrong."""
    chance = np.clip(believed.chance @ believed.weights, 1e-6, 1 - 1e-6)
    truth = problem.fresh @ problem.values
    low, high = intervals(believed.difference, believed.weights)
    least, most = intervals(believed.chance, believed.weights)
    better = (believed.chance > 0.5) @ believed.weights
    sure = np.maximum(better, 1 - better) >= LEVEL
    wrong = sure & ((better > 0.5) != (truth > 0))
    return {
        "loss": float(-np.log(np.where(problem.fresh_y > 0, chance, 1 - chance)).mean()),
        "covered": float(((low <= truth) & (truth <= high)).mean()),
        "width": float(np.median(high - low)),
        "chance_covered": float(((least <= problem.chances) & (problem.chances <= most)).mean()),
        "decided": float(sure.mean()),
        "wrong": int(wrong.sum()),
        "sure": int(sure.sum()),
    }


def intervals(x: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """The central interval of ``LEVEL`` of each row of x (n, m) under weights (m,)."""
    order = np.argsort(x, axis=1)
    below = np.cumsum(weights[order], axis=1)
    found = []
    for share in ((1 - LEVEL) / 2, (1 + LEVEL) / 2):
        place = np.minimum((below < share).sum(axis=1), x.shape[1] - 1)
        found.append(np.take_along_axis(x, np.take_along_axis(order, place[:, None], 1), 1)[:, 0])
    return found[0], found[1]


def report(cells: Sequence[Cell], rows: Sequence[dict[str, Row]]) -> Iterator[list[str]]:
    """The page, part by part."""
    names = [name for name in rows[0] if name]
    seeds = len({cell["seed"] for cell in cells})
    groups: dict[tuple[str, int, int], list[dict[str, Row]]] = {}
    for cell, row in zip(cells, rows, strict=True):
        groups.setdefault((cell["tutor"], cell["k"], cell["n"]), []).append(row)
    given = [f"--seeds {seeds}"]
    for name, key in (("tutors", "tutor"), ("levels", "k"), ("answers", "n")):
        given.append(f"--{name} {' '.join(dict.fromkeys(str(cell[key]) for cell in cells))}")
    packages = [name for name in ("emcee", "torch", "botorch") if find_spec(name)]
    absent = [name for name in ("emcee", "botorch") if not find_spec(name)]
    yield [
        "# Posteriors over a tutor's preferences",
        "",
        *_wins(groups, names),
        "",
        machine("one thread"),
        f"Also {', '.join(f'{name} {version(name)}' for name in packages)}." if packages else "",
        *[f"{name} is not installed: its rows are left out ({INSTALL})." for name in absent],
        "",
        f"`python -m benchmarks.posteriors.preference_posteriors {' '.join(given)}`, after "
        f"{INSTALL}.",
        "",
        f"{seeds} problems for each table, scales by turns {', '.join(LAWS)} ('prior': "
        "PosteriorComparator's own law); "
        f"a tutor by eq. (6) with logits of standard deviation {SPREAD:g}, or who flips "
        f"{FLIPS:.0%} of the answers; "
        f"{FRESH} held-out answers each; pairs of uniform share vectors that the order of the "
        "levels leaves open. "
        "Means ± half a 95% interval over the problems.",
        "",
        "- *log loss*: of the held-out answers, in nats, beyond that of the tutor's own chances.",
        f"- *d.e held*: how often the {LEVEL:.0%} interval of d.e, as a share of e_k - e_1, holds "
        "the truth; *width*: "
        "the median width of these intervals. A Gaussian process has to extrapolate to the two "
        "pure levels for it.",
        f"- *chance held*: the same for the {LEVEL:.0%} interval of the chance of an answer "
        "(PosteriorComparator: with "
        "the mean of its lapses, for it gives out no others; a Gaussian process knows no lapse).",
        f"- *decided*: pairs whose sign has a probability of {LEVEL:.0%} or more; *wrong*: of "
        "these, all problems "
        "together.",
        "- *from a long run*: root mean square difference of the chances from another, longer "
        "Hamiltonian run, for "
        "those that sample the same posterior.",
        "- *s, all*: processor seconds for all answers, PosteriorComparator taking them one by "
        "one; *s, one more*: for "
        "one answer more, where the others start anew.",
    ]
    for (tutor, k, n), found in groups.items():
        head = ("method", "log loss", "d.e held", "width", "chance held", "decided", "wrong",
                "from a long run",
                "s, all", "s, one more")  # fmt: skip
        title = f"{FLIPS:.0%} of the answers flipped" if tutor == "flips" else "a tutor by eq. (6)"
        yield [
            f"## {title}, k = {k}, {n} answers",
            "",
            *markdown(head, [_line(name, found) for name in names], 1),
        ]


def _line(name: str, found: Sequence[dict[str, Row]]) -> list[str]:
    def of(key: str) -> list[float]:
        return [each[name][key] for each in found]

    sure = sum(of("sure"))
    return [
        name,
        with_interval(_beyond(found, name), 3),
        f"{with_interval(100 * np.array(of('covered')), 0)}%",
        f"{np.mean(of('width')):.2f}",
        f"{with_interval(100 * np.array(of('chance_covered')), 0)}%",
        f"{100 * np.mean(of('decided')):.0f}%",
        f"{100 * sum(of('wrong')) / sure:.1f}%" if sure else "",
        f"{np.mean(of('from_long')):.3f}" if "from_long" in found[0][name] else "",
        f"{np.mean(of('seconds')):.2f}",
        f"{np.mean(of('more')):.3f}",
    ]


def _beyond(found: Sequence[dict[str, Row]], name: str) -> Floats:
    return np.array([each[name]["loss"] - each[""]["loss"] for each in found])


def _wins(
    groups: dict[tuple[str, int, int], list[dict[str, Row]]], names: Sequence[str]
) -> list[str]:
    """Write where others are better than ours, problem by problem, then where they are worse."""
    ours, rows, better, safer = names[0], list[tuple[float, list[str]]](), list[str](), list[str]()
    runs = [run for found in groups.values() for run in found]
    for name in names[1:]:
        loss = _beyond(runs, name) - _beyond(runs, ours)
        held = np.array([run[name]["chance_covered"] - run[ours]["chance_covered"] for run in runs])
        faster = sum(
            _mean(found, name, "seconds") < _mean(found, ours, "seconds")
            for found in groups.values()
        )
        more = _mean(runs, name, "more") / _mean(runs, ours, "more")
        shown = [
            name,
            with_interval(1e3 * loss, 1, signed=True),
            with_interval(100 * held, 0, signed=True),
        ]
        rows.append((float(loss.mean()), [*shown, f"{faster} of {len(groups)}", f"{more:,.1f}"]))
        better += [name] * _surely_below(loss)
        safer += [name] * _surely_below(-held)
    rows.sort()
    head = ("method", "log loss beyond ours, thousandths", "chance held, points beyond ours",
            "faster, all answers",
            "one more answer, ratio")  # fmt: skip
    return [
        "Better than `PosteriorComparator` at predicting held-out answers, beyond the interval: "
        f"{_listed(better)}. "
        "With intervals for the chance of an answer that hold the truth more often: "
        f"{_listed(safer)}.",
        "",
        "The others beside it, problem by problem, the best at predicting first: what they lose "
        "more, in thousandths "
        "of a nat (less than 0: they are better); how much more often their intervals for the "
        "chance hold the truth; "
        "in how many tables they take less time for all answers at once; and how many times its "
        "time they take for one "
        "answer more.",
        "",
        *markdown(head, [shown for _, shown in rows], 1),
    ]


def _listed(names: Sequence[str]) -> str:
    return "; ".join(names) or "none of the others"


def _surely_below(x: Floats) -> bool:
    """Return whether the mean of x (n,) is significantly below 0 (95% t-interval)."""
    return len(x) > 1 and bool(x.mean() + stats.t.ppf(0.975, len(x) - 1) * stats.sem(x) < 0)


def _mean(runs: Sequence[dict[str, Row]], name: str, key: str) -> float:
    return float(np.mean([run[name][key] for run in runs]))


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        description="Posteriors over a tutor's preferences, ours and others'."
    )
    parser.add_argument(
        "--quick", action="store_true", help="two problems, k = 5, 20 answers: seconds"
    )
    parser.add_argument("--seeds", type=int, help="problems for each table (default: 9; quick: 2)")
    parser.add_argument("--jobs", type=int, default=1, help="processes, one thread each")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md", help="write the report there as well"
    )
    parser.add_argument(
        "--levels", type=int, nargs="+", help="numbers of levels (default: 5 10; quick: 5)"
    )
    parser.add_argument(
        "--answers", type=int, nargs="+", help="numbers of answers (default: 20 100; quick: 20)"
    )
    parser.add_argument(
        "--tutors", nargs="+", choices=TUTORS, help="who answers (default: both; quick: logistic)"
    )
    chosen = parser.parse_args(arguments)
    levels = chosen.levels or ([5] if chosen.quick else [5, 10])
    counts = chosen.answers or ([20] if chosen.quick else [20, 100])
    tutors = chosen.tutors or TUTORS[: 1 if chosen.quick else 2]
    seeds = chosen.seeds or (2 if chosen.quick else 9)
    cells: list[Cell] = [
        {"tutor": tutor, "k": k, "n": n, "seed": seed}
        for tutor in tutors
        for k in levels
        for n in counts
        for seed in range(seeds)
    ]
    from benchmarks.posteriors import (
        preference_posteriors,
    )  # by the name that workers know, not as __main__

    made_of = sources(preference_posteriors.__name__)  # a row of other code is none of these
    how = {"journal": chosen.journal, "jobs": chosen.jobs, "own": lambda cell: (made_of, {})}
    rows = sweep(preference_posteriors.run, cells, **how)
    publish(report(cells, rows), chosen.out)


if __name__ == "__main__":
    main()
