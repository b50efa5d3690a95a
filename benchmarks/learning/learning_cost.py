"""Cost of interactive Q-learning, beside the same loop that knows the values, and beside other
ways to do it.

    python -m benchmarks.learning.learning_cost [--quick] [--only NAME ...] [--levels 5 10 20]
    [--out FILE.md]

One table of ratios, each of two things measured side by side; then what the runs were like, and how
their cost grows. Every measurement has a process of its own (``benchmarks.own_process``), which
runs one thread.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median
from typing import NamedTuple

from benchmarks.learning import learning_growth as growth
from benchmarks.learning import learning_runs as runs
from benchmarks.learning.learning_runs import Found, Setting
from benchmarks.learning.learning_tables import (
    Kind,
    Limit,
    Part,
    Row,
    Text,
    about,
    number,
    render,
    took,
)
from benchmarks.own_process import Failed, apart
from benchmarks.reporting import markdown, save

MOST = {
    ("polytope", 5): 6,
    ("polytope", 10): 20,
    ("polytope", 20): 90,
    ("posterior", 10): 32,
    ("posterior", 20): 70,
}
KNOWING = "the same loop, values known"


class Plan(NamedTuple):
    """The setting that all measurements vary, the levels k, and the sizes of rivals' runs.

    A rival's run is cut short: to so many open comparisons, steps and questions, and a peer's to so
    many steps. The sizes at which growth is measured come last.
    """

    at: Setting
    levels: tuple[int, ...]
    opened: int = 300
    steps: int = 100_000
    questions: int = 10
    peer: int = 100_000
    states: tuple[int, ...] = (100, 1000, 10_000)
    every: tuple[int, ...] = (5, 10, 15, 20, 25)
    particles: tuple[int, ...] = (250, 500, 1000, 2000)


def truthful(plan: Plan) -> Iterator[Part]:
    """A polytope and a truthful tutor, beside the loop that knows the values."""
    for k in plan.levels:
        yield from beside_knowing(replace(plan.at, k=k))


def noisy(plan: Plan) -> Iterator[Part]:
    """A tutor who flips a tenth of the answers, uniform exploration, beside the loop that knows the
    values.
    """
    for at in noisy_settings(plan):
        yield from beside_knowing(at)
        for name in ("ensemble", "box"):
            few = replace(
                at, comparator=name, max_queries=at.steps // 50, seeds=min(3, at.seeds), repeats=1
            )
            yield from beside_knowing(few)
        yield from beside_knowing(replace(at, comparator="always-ask"))


def noisy_settings(plan: Plan) -> list[Setting]:
    """Return the settings with the posterior, one for each number of levels.

    Numbers below 10 are left to the truthful tutor if there are larger ones.
    """
    levels = [k for k in plan.levels if k >= 10] or plan.levels
    return [replace(plan.at, k=k, comparator="posterior", error=0.1, epsilon=1.0) for k in levels]


def beside_knowing(at: Setting) -> Iterator[Part]:
    """Yield the rows on one setting."""
    found, what = apart(runs.beside_knowing, at), named(at)
    guessed = fmean(found["guessed"])
    yield Row(
        what,
        KNOWING,
        took(median(found["seconds"])),
        took(median(found["knowing"])),
        median(found["ratio"]),
        (min(found["ratio"]), max(found["ratio"])),
        limited(at, Limit(most=MOST[at.comparator, at.k]))
        if (at.comparator, at.k) in MOST
        else None,
        f"{fmean(found['asked']):,.0f} questions"
        + (f", at most {at.max_queries:,} allowed" if at.max_queries else ""),
    )
    means = [fmean(found[name]) for name in ("asked", "compared", "opened")]
    losses = [fmean(found[name]) for name in ("loss", "loss knowing")]
    same = f"{sum(found['same'])} of {len(found['same'])}"
    yield Kind(
        what,
        took(median(found["made"])),
        means[0],
        means[1],
        means[2],
        guessed,
        losses[0],
        losses[1],
        same,
    )


def limited(at: Setting, limit: Limit) -> Limit | None:
    """The limit, for runs of the size that it was set for: short ones are all questions."""
    return limit if (at.states, at.steps) == (Setting.states, Setting.steps) else None


def named(at: Setting) -> str:
    """A setting in words."""
    tutor = f"{at.error:.0%} flipped, exploration {at.epsilon:g}" if at.error else "truthful"
    return f"{at.comparator}, k = {at.k}, {tutor}"


def plain(plan: Plan) -> Iterator[Part]:
    """The plain version: cvxpy programs, or a bootstrap of scikit-learn fits."""
    for k in plan.levels:
        at = replace(
            plan.at, k=k, rival="programs", prefix=plan.opened, repeats=min(3, plan.at.repeats)
        )
        found = apart(runs.beside_plain, at)
        yield whole_run(
            at, found, "plain loop, cvxpy programs rebuilt", limited(at, Limit(least=1000))
        )
    for noisy in noisy_settings(plan):
        for region in ("ensemble", "box"):
            at = replace(
                noisy, rival=region, prefix=plan.questions, repeats=min(3, plan.at.repeats)
            )
            yield from a_question(at, apart(runs.beside_plain, at), limited(at, Limit(least=100)))


def careful(plan: Plan) -> Iterator[Part]:
    """The careful version: dominance, then one program in hot HiGHS, in a Python loop."""
    for k in plan.levels:
        at = replace(
            plan.at, k=k, rival="careful", prefix=min(plan.steps, plan.at.steps), repeats=1
        )
        found = apart(runs.beside_plain, at)
        yield whole_run(
            at,
            found,
            "Python loop, one-sided hot HiGHS",
            limited(at, Limit(least=50)) if k == 10 else None,
        )


def whole_run(at: Setting, found: Found, rival: str, limit: Limit | None) -> Row:
    """A rival's run, extrapolated where it was cut short."""
    same = "the same questions as ours" if found["same questions"] else "other questions than ours"
    part = (
        f"extrapolated from the first {found['their steps']:,} steps, {found['their opened']:,} "
        "open comparisons "
        f"({found['us open']:,.0f} us each; {found['opened']:,} in our run)"
    )
    if found["their steps"] == at.steps:
        policy = "same policy" if found["same policy"] else "another policy"
        part = (
            f"the whole run: {found['their opened']:,} open comparisons, {found['us open']:,.0f} "
            f"us each, {policy}"
        )
    remark = f"{part}; {same}"
    return Row(
        named(at),
        rival,
        took(found["seconds"]),
        took(found["whole"]),
        found["ratio"],
        None,
        limit,
        remark,
    )


def a_question(at: Setting, found: Found, limit: Limit | None) -> Iterator[Row]:
    """Write the cost of a question with a bootstrap.

    It is taken over the rival's first questions, and over a whole run like ours.
    """
    what, here = f"{named(at)}: per question", took(found["ours a question"])
    rival, sizes, asked = (
        f"plain loop, {at.rival} of 100 scikit-learn fits",
        found["sizes"],
        found["asked"],
    )
    remark = (
        f"the rival's first {found['their asked']} questions, when its fits are shortest; ours: "
        f"all {asked:,}"
    )
    yield Row(
        what, rival, here, took(found["a question"]), found["ratio asked"], None, None, remark
    )
    remark = (
        f"extrapolated to a run with our {asked:,} questions: {took(found['refit'])} for their "
        "fits, the mean of "
        f"{len(sizes)} with {sizes[0]} to {sizes[-1]} of our answers; {found['opened']:,} open "
        "comparisons, "
        f"{took(found['deciding'])} each; {at.steps:,} steps, {took(found['a step'])} each"
    )
    here = took(found["ours then"])
    yield Row(what, rival, here, took(found["whole"] / asked), found["ratio"], None, limit, remark)


def peer(plan: Plan) -> Iterator[Part]:
    """Measure another package's tabular Q-learning, in steps a second.

    MushroomRL is left out, because it is pinned to NumPy 1.24.
    """
    rival = "pymdptoolbox QLearning, rewards known"
    at = replace(plan.at, k=10, prefix=plan.peer)
    pairs = [
        (apart(growth.speed, at), apart(growth.mdptoolbox, at)) for _ in range(min(3, at.repeats))
    ]
    theirs = median(other["knowing"] for _, other in pairs)
    remark = (
        f"steps a second; {pairs[0][1]['steps']:,} steps of the peer, one Q value for each action"
    )
    for name, what in (
        ("asking", "polytope, k = 10, truthful"),
        ("knowing", "our loop, values known, k = 10"),
    ):
        ratio = median(own[name] / other["knowing"] for own, other in pairs)
        ours = median(own[name] for own, _ in pairs)
        yield Row(what, rival, f"{ours:,.0f}/s", f"{theirs:,.0f}/s", ratio, None, None, remark)


def grow(plan: Plan) -> Iterator[Part]:
    """Time and memory by the sizes of the problem, the answers, and the particles."""
    at, lines = replace(plan.at, seeds=1, repeats=min(3, plan.at.repeats)), []
    for one in [replace(at, states=n, k=10) for n in plan.states] + [
        replace(at, k=k) for k in plan.every
    ]:
        found, held = apart(runs.beside_knowing, one), apart(growth.memory_of_a_run, one)
        lines.append(
            [f"{one.states:,}", str(one.k)]
            + [took(found[name][0]) for name in ("seconds", "knowing")]
            + [number(found["ratio"][0]), f"{found['asked'][0]:,}", took(found["made"][0])]
            + [f"{held[name] / 2**20:.0f}" for name in ("before", "peak")]
        )
    head = (
        "states",
        "k",
        "seconds",
        "values known",
        "ratio",
        "questions",
        "made in",
        "MiB before",
        "MiB at most",
    )
    note = (
        f"Polytope, truthful tutor, {at.steps:,} steps, one problem each. Memory: of a process "
        "that makes and runs it."
    )
    yield Text(["## Growth: states and levels", "", note, "", *markdown(head, lines, 0)])
    lines = []
    for k in plan.levels:
        lines.append(by_answers(replace(at, k=k)))
    for one in noisy_settings(plan):
        lines += [
            by_answers(replace(one, particles=m, seeds=1, repeats=at.repeats))
            for m in plan.particles
        ]
    note = (
        "Taking in one answer of a run and judging the difference asked next, mean over each fifth "
        "of the answers."
    )
    fifths = ("comparator", "run", "answers", *(f"fifth {i}" for i in range(1, 6)))
    yield Text(["## Growth: answers and particles", "", note, "", *markdown(fifths, lines, 1)])


def by_answers(at: Setting) -> list[str]:
    """Return a row on the cost of an answer."""
    found = apart(growth.per_answer, at)
    more = f", {at.particles:,} particles" if at.comparator == "posterior" else ""
    parts = [took(seconds) for _, _, seconds in found["parts"]]
    return [
        named(at) + more,
        took(found["seconds"]),
        f"{found['asked']:,}",
        *parts,
        *[""] * (5 - len(parts)),
    ]


def start(plan: Plan) -> Iterator[Part]:
    """New processes."""
    found = apart(growth.start_up, replace(plan.at, repeats=5))
    lines = [[name, took(seconds)] for name, seconds in found.items()]
    yield Text(
        [
            "## Start-up",
            "",
            "Wall time, median of 5 warm starts.",
            "",
            *markdown(("command", "time"), lines, 1),
        ]
    )


SECTIONS: dict[str, Callable[[Plan], Iterator[Part]]] = {
    each.__name__: each for each in (truthful, noisy, plain, careful, peer, grow, start)
}


def main(arguments: list[str] | None = None) -> None:
    """Measure; print the report and, with --out, write it to a file."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.learning.learning_cost", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument(
        "--quick", action="store_true", help="tiny runs: a minute or two, rough figures"
    )
    parser.add_argument(
        "--only", nargs="+", choices=SECTIONS, default=list(SECTIONS), help="what to measure"
    )
    parser.add_argument(
        "--levels", type=int, nargs="+", help="numbers of levels k (default: 5 10 20; quick: 5)"
    )
    parser.add_argument(
        "--seeds",
        type=int,
        help="problems for each ratio to the loop that knows (default: 5; quick: 2)",
    )
    parser.add_argument(
        "--repeats", type=int, help="timed runs of each problem (default: 5; quick: 1)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md", help="write the report there as well"
    )
    given = parser.parse_args(arguments)
    levels = tuple(given.levels or ((5,) if given.quick else (5, 10, 20)))
    if min(levels) < 3 or any(n is not None and n < 1 for n in (given.seeds, given.repeats)):
        parser.error(
            "--levels must be at least 3, as the order of two settles every pair; --seeds and "
            "--repeats 1"
        )
    at = Setting(seeds=given.seeds or 5, repeats=given.repeats or 5)
    plan = Plan(at, levels)
    if given.quick:
        at = replace(
            at, states=20, steps=2000, seeds=given.seeds or 2, repeats=given.repeats or 1, fits=2
        )
        plan = Plan(at, levels, 10, 500, 2, 10_000, (20, 40), (5, 6), (50,))
    parts: list[Part] = []
    for name in given.only:
        print(f"{name} ...", file=sys.stderr, flush=True)
        try:
            for part in SECTIONS[name](plan):
                parts.append(part)
        except Failed as failure:
            parts.append(Row(name, "", "", "", None, remark=f"not measured: {failure}"))
    text = "\n".join(
        [*render(parts, about(at.steps, at.states, at.actions, at.seeds, at.repeats)), ""]
    )
    print(text, end="")
    save(text, given.out, f"0-{at.seeds - 1}")


if __name__ == "__main__":
    main()
