"""Growth of seconds, questions and memory with states, levels and answers, and its exponents.

    python -m benchmarks.learning.growth_by_size [--journal FILE] [--afford 60] [--quick] \
        [--out FILE.md]

Each cell, a method at one size, has a process and one thread of its own. A size is left out, and
all that are larger, where one problem of it would take more CPU seconds than ``--afford``, judged
by the sizes before. ``--journal`` keeps finished cells while the code is the same. Beside the page,
under the same name, is its picture (``growth_picture``).
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from benchmarks.fitting.tutor_data import open_pairs
from benchmarks.learning.growth_picture import draw
from benchmarks.learning.learning_runs import Setting, comparator, ours, tutor
from benchmarks.learning.scalar_solvers import SOLVERS
from benchmarks.own_process import Failed, apart, memory
from benchmarks.reporting import machine, markdown, publish, with_interval
from benchmarks.stamps import sources
from elicit import Answers, BradleyTerryComparator, PolytopeComparator, TruthfulTutor, Verdict
from elicit.model.scale import Floats
from qlearn import (
    InteractivePolicyIteration,
    InteractiveValueIteration,
    OrdinalMDP,
    draw_values,
    drive,
    random_mdp,
)
from qlearn.experiments.parallel import sweep

TOLERANCE, ACTIONS, LEVELS, STATES = 0.001, 5, 10, 1000
STEPS_A_STATE, MOST_ASKED = (
    100,
    2000,
)  # of Q-learning; the most that the box may ask, which else never stops
PROBLEMS, ENOUGH = 3, 6.0  # of each cell, but none begins after so many CPU seconds
UPDATES, JUDGED = 10, 10_000
UPPER = 3  # sizes, the largest, that an exponent is of
LEAST = 2**20  # bytes below which memory is not told from that of the process
LOWEST = {"bytes": LEAST, "asked": 1, "open": 1}  # what has a logarithm
SIZES = {
    "states": (100, 1000, 10_000, 100_000, 1_000_000),
    "levels": (5, 10, 20, 30, 50),
    "answers": (10, 100, 1000, 10_000),
}
QUICK = {"states": (20, 40), "levels": (3, 4), "answers": (5, 10)}
Cell = dict[str, Any]
Found = dict[
    str, list[float]
]  # of each problem the seconds, and what else; of all "bytes", and the "cost" of one


Method = Callable[
    [OrdinalMDP, Floats, int], tuple[float, int | None]
]  # CPU seconds, and questions if it asks


class Series(NamedTuple):
    """Measurements of a method at each size along an axis, and why there are no more."""

    axis: str
    who: str
    found: dict[int, Found]
    left_out: str = ""


def q_learning(name: str) -> Method:
    """Return Q-learning with a comparator, as ``learning_cost`` runs it.

    The polytope has a truthful tutor. The others have one who flips a tenth, and explore at random.
    """
    noisy: Any = {} if name == "polytope" else {"error": 0.1, "epsilon": 1.0}
    noisy |= {"max_queries": MOST_ASKED} if name == "box" else {}

    def learn(mdp: OrdinalMDP, values: Floats, seed: int) -> tuple[float, int | None]:
        at = Setting(k=mdp.k, comparator=name, steps=STEPS_A_STATE * mdp.n_states, **noisy)
        made, seconds, result = ours(at, mdp, mdp.normalise(values), seed)
        return made + seconds, result.asked

    return learn


def planning(learner: Any) -> Method:
    """A learner from the model, with a polytope and a truthful tutor."""

    def learn(mdp: OrdinalMDP, values: Floats, seed: int) -> tuple[float, int | None]:
        start = process_time()
        result = drive(
            learner(mdp, PolytopeComparator(mdp.k), tolerance=TOLERANCE), TruthfulTutor(values)
        )
        return process_time() - start, result.asked

    return learn


def knowing(name: str) -> Method:
    """A solver of the problem whose values are known."""

    def solve(mdp: OrdinalMDP, values: Floats, seed: int) -> tuple[float, int | None]:
        return SOLVERS[name].solve(mdp, values, TOLERANCE).cpu, None

    return solve


LEARNERS: dict[str, Method] = {
    "Q-learning, polytope": q_learning("polytope"),
    "Q-learning, posterior": q_learning("posterior"),
    "Q-learning, box": q_learning("box"),
    "value iteration": planning(InteractiveValueIteration),
    "policy iteration": planning(InteractivePolicyIteration),
} | {
    f"values known: {name}": knowing(name)
    for name in ("qlearn, modified policy iteration", "QuantEcon, modified policy iteration")
    if not SOLVERS[name].missing
}
COMPARATORS = ("polytope", "posterior", "box", "ensemble")
MEASURES = {  # of an axis: what is measured, with the heading of its column and its unit there
    "states": {
        "seconds": ("CPU seconds", 1.0),
        "asked": ("questions", 1.0),
        "bytes": ("memory, MiB", 2**20),
    },
    "answers": {
        "update": ("an update, ms", 1e-3),
        "judge": (f"judging {JUDGED:,}, ms", 1e-3),
        "open": (f"left to ask, of {JUDGED:,}", 1.0),
        "bytes": ("memory, MiB", 2**20),
    },
}
MEASURES["levels"] = MEASURES["states"]


def learned(who: str, states: int, k: int) -> Found:
    """A method on random MDPs, in this process. Bytes: what making the problem and solving it adds
    to the peak.
    """
    method = LEARNERS[who]
    small, small_values = random_mdp(30, ACTIONS, k, seed=0)
    method(small, small_values, 0)  # loads what is compiled
    gc.collect()
    runs: list[tuple[float, int | None]] = []
    before, begun = memory("VmHWM"), process_time()
    while len(runs) < PROBLEMS and (not runs or process_time() - begun < ENOUGH):
        mdp, values = random_mdp(states, ACTIONS, k, seed=len(runs))
        gc.collect()
        runs.append(method(mdp, values, len(runs)))
    seconds, asked = zip(*runs, strict=True)
    found = {"seconds": list(seconds), "bytes": [float(memory("VmHWM") - before)]}
    found["cost"] = [(process_time() - begun) / len(runs)]
    return found if None in asked else found | {"asked": list(map(float, asked))}


def informed(who: str, answers: int) -> Found:
    """A comparator of ``LEVELS`` levels that has so many answers, in this process: seconds of one
    more, with the first comparison after it, which waits for the fit; seconds of judging many; how
    many of these it would still ask. Box and ensemble fit at every answer."""
    at = Setting(k=LEVELS, comparator=who, error=0.0 if who == "polytope" else 0.1)
    fresh = comparator(at)
    if isinstance(fresh, BradleyTerryComparator):
        fresh = replace(fresh, refit_growth=0.0)

    def once(n: int, seed: int) -> tuple[float, float, float]:
        d = open_pairs(at.k, n + UPDATES + JUDGED, np.random.default_rng([seed, n]))
        given = Answers(d[:-JUDGED], tutor(at, draw_values(at.k, seed), seed).signs(d[:-JUDGED]))
        known = fresh.update(given[:n])
        known.compare(d[-1:])
        start = process_time()
        for i in range(n, n + UPDATES):
            known = known.update(given[i : i + 1])
            known.compare(d[i - n - JUDGED : i - n - JUDGED + 1])
        between = process_time()
        verdicts = known.compare(d[-JUDGED:])
        return (
            (between - start) / UPDATES,
            process_time() - between,
            float((verdicts == Verdict.UNKNOWN).sum()),
        )

    once(5, 0)  # loads what is compiled
    gc.collect()
    runs: list[tuple[float, float, float]] = []
    before, begun = memory("VmHWM"), process_time()
    while len(runs) < PROBLEMS and (not runs or process_time() - begun < ENOUGH):
        runs.append(once(answers, len(runs)))
    update, judge, still_open = map(list, zip(*runs, strict=True))
    found = {
        "update": update,
        "judge": judge,
        "open": still_open,
        "bytes": [float(memory("VmHWM") - before)],
    }
    return found | {"cost": [(process_time() - begun) / len(runs)]}


def measure(cell: Cell) -> Found | str:
    """A cell in a process of its own, or why it has nothing."""
    try:
        if cell["axis"] == "answers":
            return apart(informed, cell["who"], cell["size"])
        states, k = (
            (cell["size"], LEVELS) if cell["axis"] == "states" else (cell["states"], cell["size"])
        )
        return apart(learned, cell["who"], states, k)
    except Failed as failure:
        return str(failure)


def series(
    axis: str, who: str, sizes: Sequence[int], states: int, afford: float, **how: Any
) -> Series:
    """A method at one size after the other, as long as the next can be expected to take no more
    than ``afford`` CPU seconds a problem: to grow as in the last step, and at least in
    proportion."""
    found: dict[int, Found] = {}
    for size in sizes:
        if found:
            *earlier, last = (cell["cost"][0] for cell in found.values())
            grown = max([size / max(found), *(last / before for before in earlier[-1:])])
            if last * grown > afford:
                return Series(
                    axis, who, found, f"{size:,} {axis}: some {last * grown:,.0f} s expected"
                )
        cell: Cell = {"axis": axis, "who": who, "size": size} | (
            {"states": states} if axis == "levels" else {}
        )
        (there,) = sweep(measure, [cell], jobs=1, **how)
        if isinstance(there, str):
            return Series(axis, who, found, f"{size:,} {axis}: {there}")
        found[size] = there
    return Series(axis, who, found)


def exponent(found: dict[int, Found], name: str) -> str:
    """The slope of log(measure) against log(size), by least squares over the problems of the
    largest sizes, and half of its 95% interval; empty where fewer than two sizes have it."""
    points = [
        (n, y)
        for n in sorted(found)[-UPPER:]
        for y in found[n].get(name, [])
        if y >= LOWEST.get(name, 1e-9)
    ]
    if len({n for n, _ in points}) < 2:
        return ""
    x, y = np.log(points).T
    fitted = stats.linregress(x, y)
    told = len(x) > 2 and np.isfinite(fitted.stderr)  # which it is not of what never varies
    half = f" ± {stats.t.ppf(0.975, len(x) - 2) * fitted.stderr:.2f}" if told else ""
    return f"{fitted.slope + 0.0:.2f}{half}"


def cell_of(values: Sequence[float] | None, name: str, unit: float) -> str:
    """Write one measure of a cell as a table shows it."""
    if values is None:
        return ""
    if name == "bytes" and values[0] < LEAST:
        return "under 1"
    mean = np.mean(values) / unit
    return with_interval(
        np.divide(values, unit), max(0, 2 - int(np.floor(np.log10(mean)))) if mean > 0 else 0
    )


def row(axis: str, who: str, size: int, cell: Found) -> list[str]:
    """A method at one size: the number of problems, and each measure."""
    measures = MEASURES[axis]
    problems = len(cell[next(iter(measures))])
    shown = [cell_of(cell.get(name), name, unit) for name, (_, unit) in measures.items()]
    return [who, f"{size:,}", str(problems), *shown]


def tables(all_series: Sequence[Series], axis: str) -> list[str]:
    """The exponents of all methods along an axis, then each size."""
    measures, here = MEASURES[axis], [one for one in all_series if one.axis == axis]
    names = [heading.rsplit(", ", 1)[0] for heading, _ in measures.values()]
    rows = [
        [one.who, ", ".join(f"{n:,}" for n in sorted(one.found)[-UPPER:])]
        + [exponent(one.found, name) for name in measures]
        for one in here
    ]
    lines = [
        f"## Against {axis}",
        "",
        "Exponents:",
        "",
        *markdown(("method", "over", *names), rows, 2),
        "",
    ]
    rows = [row(axis, one.who, size, cell) for one in here for size, cell in one.found.items()]
    lines += markdown(
        ("method", axis, "problems", *(heading for heading, _ in measures.values())), rows, 1
    )
    left = [f"{one.who} from {one.left_out}" for one in here if one.left_out]
    return [*lines, *(["", f"Left out: {'; '.join(left)}."] if left else [])]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the report; ``--out`` also writes it, and the picture beside it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.learning.growth_by_size", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--quick", action="store_true", help="two tiny sizes each: a minute")
    parser.add_argument(
        "--only", nargs="+", choices=SIZES, default=list(SIZES), help="against what"
    )
    parser.add_argument(
        "--afford", type=float, default=60.0, help="CPU seconds that a problem may take"
    )
    parser.add_argument("--journal", type=Path, help="file that keeps finished cells")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE.md",
        help="write the report there, and the picture beside it",
    )
    given = parser.parse_args(arguments)
    made_of = sources("benchmarks.learning.growth_by_size")  # a cell of other code is none of these
    how = {"journal": given.journal, "own": lambda cell: (made_of, {})}
    sizes, states = (QUICK, QUICK["states"][0]) if given.quick else (SIZES, STATES)
    done = [
        series(axis, who, sizes[axis], states, given.afford, **how)
        for axis in given.only
        for who in (COMPARATORS if axis == "answers" else LEARNERS)
    ]
    intro = (
        f"Random MDPs, {ACTIONS} actions, discount .95; against states with {LEVELS} levels, "
        "against levels with "
        f"{states:,} states. Tolerance {TOLERANCE:g} of the value range for those that plan; "
        "Q-learning takes "
        f"{STEPS_A_STATE} steps a state. The box and the posterior learn from a tutor who flips a "
        "tenth of the answers "
        f"and explore at random, the box with at most {MOST_ASKED:,} questions, after which it "
        "guesses; all others ask "
        "a truthful tutor, value and policy iteration for a polytope. The solvers are given "
        "the values: a "
        f"problem k times smaller. Against answers: a comparator of {LEVELS} levels that was given "
        "so many at once, "
        "about random differences that dominance does not settle; one more answer and the first "
        "comparison after it, "
        "for which box and ensemble fit again at every answer here, though by default only when "
        "the answers have grown "
        "by a share; "
        f"then {JUDGED:,} fresh differences."
    )
    reading = (
        f"Means over up to {PROBLEMS} problems, of which none begins after {ENOUGH:g} CPU seconds, "
        "and 95% intervals. "
        "Memory: what a process of its own needs at most, with the problem, beyond what it had "
        "before. Exponents: "
        f"least squares in logarithms over the {UPPER} largest sizes measured, all problems, with "
        "a 95% interval that "
        "holds for a straight line. A size of which one problem would take more than "
        f"{given.afford:g} CPU seconds is "
        "left out; policy iteration with a million states is in [policy iteration at "
        "scale](RESULTS-scale.md), value "
        "iteration in [a million states](RESULTS-ivi-huge.md)."
    )
    head = [
        "# How time, questions and memory grow",
        "",
        machine("one thread a cell, CPU seconds"),
        "",
        intro,
        "",
    ]
    head.append(reading)
    if given.out:
        picture = given.out.with_suffix(".svg")
        draw(
            {axis: {one.who: one.found for one in done if one.axis == axis} for axis in given.only},
            picture,
        )
        head += [
            "",
            f"![Seconds, questions and memory against states, levels and answers]({picture.name})",
        ]
    publish([head, *(tables(done, axis) for axis in given.only)], given.out, f"0-{PROBLEMS - 1}")


if __name__ == "__main__":
    main()
