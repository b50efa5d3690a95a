"""Rules for the next question: those of others beside ours, all else equal.

    python -m benchmarks.asking.question_rules --quick
        # a minute; rough figures
    python -m benchmarks.asking.question_rules --out benchmarks/RESULTS-question-rules.md

``InteractivePolicyIteration`` on random MDPs of the paper (|S| = 100, |A| = 5, discount .95), each
time with another rule for its next question: our own, APReL's (mutual information, volume removal,
greatest regret), Toubia's polyhedral one, and chance. ``--journal`` keeps finished runs: the same
command goes on where it was stopped, also with more seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.asking import question_counts as questions
from benchmarks.reporting import machine, markdown, publish, with_interval
from benchmarks.stamps import sources
from elicit.model.scale import Floats
from qlearn.experiments.parallel import Cell, sweep

OURS = "ours: telling violation (the default)"
RULES = {  # by whom, and the method of question_counts
    OURS: "policy iteration, telling violation",
    "ours: greatest bound": "policy iteration, max regret",
    "mutual information, or BALD (Houlsby 2011; Biyik 2019; APReL)": (
        "policy iteration, mutual information"
    ),
    "volume removal (Sadigh 2017; APReL)": "policy iteration, volume removal",
    "greatest regret of two scales (Wilde 2020; APReL)": "policy iteration, regret of two scales",
    "polyhedral (Toubia 2004)": "policy iteration, polyhedral",
    "a random candidate": "policy iteration, random candidate",
}
TUTORS = {  # share of answers flipped, and who learns from them
    "truthful, polytope": (0.0, "polytope"),
    "truthful, posterior": (0.0, "posterior"),
    "10% flipped, posterior": (0.1, "posterior"),
}
Row = dict[str, Any]
Key = tuple[str, str]  # an environment and a tutor


def cells(environments: Sequence[str], seeds: int) -> list[Cell]:
    """All rules on the same problems."""
    return [
        {"environment": environment, "method": method, "error": error, "comparator": name,
         "bounds": False,
         "seed": seed}
        for environment in environments
        for error, name in TUTORS.values()
        for method in RULES.values()
        for seed in range(seeds)
    ]  # fmt: skip


def report(done: Sequence[tuple[Cell, Row]]) -> Iterator[list[str]]:
    """The page, part by part, of (cell, row) pairs in the order of ``cells``."""
    tutors, rules = (
        {pair: name for name, pair in TUTORS.items()},
        {method: name for name, method in RULES.items()},
    )
    groups: dict[Key, dict[str, list[Row]]] = {}
    for cell, row in done:
        key = cell["environment"], tutors[cell["error"], cell["comparator"]]
        groups.setdefault(key, {}).setdefault(rules[cell["method"]], []).append(row)
    seeds = len(next(iter(groups.values()))[OURS])
    levels = dict.fromkeys(environment.removeprefix("k = ") for environment, _ in groups)
    yield [
        "# Which question next?",
        "",
        *_fewer(groups),
        "",
        machine(),
        "",
        f"`python -m benchmarks.asking.question_rules --seeds {seeds} --levels {' '.join(levels)}`.",  # noqa: E501
        "",
        f"{seeds} problems for each table, the same for all rules; means ± half a 95% interval. "
        "*Asked*: questions "
        f"until no plausible scale lets the policy lose over {questions.TOLERANCE:.0%} of the "
        "value range anywhere "
        f"(`InteractivePolicyIteration`), at most {questions.GRID[-1]}. *Beyond ours*: questions "
        "more than our default "
        "asked on the same problem. A posterior is told how often answers are flipped, and 5% "
        "random ones where none "
        "are. Then the true loss at the worst state after so many answers, in percent of the "
        "value range; who has finished, keeps the policy.",
        "",
        "The rules differ, and nothing else: the candidates (advantages that some plausible scale "
        "puts above the "
        "indifference), the draws of scales, the comparator and the stopping rule are ours for all "
        "of them; cuts, "
        "which our default asks about besides, are off. Without errors volume removal and mutual "
        "information are one "
        "rule, the most even cut, but for rounding.",
    ]
    for (environment, tutor), found in groups.items():
        head = ("rule", "asked", "beyond ours", *(f"after {n}" for n in questions.GRID[:-1]))
        rows = []
        for rule in sorted(found, key=lambda name: float(np.mean(_asked(found[name])))):
            loss = 100 * np.array([row["loss"] for row in found[rule]])
            beyond = (
                ""
                if rule == OURS
                else with_interval(_asked(found[rule]) - _asked(found[OURS]), 1, signed=True)
            )
            asked = with_interval(_asked(found[rule]), 1)
            rows.append(
                [rule, asked, beyond, *(with_interval(column, 2) for column in loss.T[:-1])]
            )
        yield [f"## {environment}, {tutor}", "", *markdown(head, rows, 1)]


def _fewer(groups: dict[Key, dict[str, list[Row]]]) -> list[str]:
    """Write where another rule asks fewer questions than our default, or loses less after so many.

    The number of further questions that each rule asks comes after it.
    """
    rows, fewer, less_lost = [], list[str](), list[str]()
    others, columns = [rule for rule in RULES if rule != OURS], range(1, len(questions.GRID) - 1)
    for rule in others:
        more_asked, counts = [], [0, 0, 0]
        for (environment, tutor), found in groups.items():
            where = f"{environment}, {tutor}"
            beyond = _asked(found[rule]) - _asked(found[OURS])
            low, high = _interval(beyond)
            fewer += [f"{rule} at {where}"] * (high < 0)
            counts[0 if high < 0 else 2 if low > 0 else 1] += 1
            more_asked.append(beyond)
            lost = np.array([row["loss"] for row in found[rule]]) - [
                row["loss"] for row in found[OURS]
            ]
            better = [str(questions.GRID[i]) for i in columns if _interval(lost[:, i])[1] < 0]
            less_lost += [f"{rule} at {where} after {', '.join(better)}"] * bool(better)
        every = np.concatenate(more_asked)
        rows.append(
            (
                float(every.mean()),
                [rule, with_interval(every, 1, signed=True), " / ".join(map(str, counts))],
            )
        )
    rows.sort()
    compared = len(others) * len(groups) * len(columns)
    head = (
        "rule",
        "questions beyond our default",
        f"fewer / inconclusive / more, of {len(groups)} tables",
    )
    return [
        ("Fewer questions than our default, beyond the interval: " + "; ".join(fewer) + "." if fewer else  # noqa: E501
         "In no table another rule asks fewer questions than our default beyond the interval."),
        "",
        ("A lower loss than our default's after so many answers, beyond the interval: " + "; ".join(less_lost) if  # noqa: E501
         less_lost else "In no table another rule loses less than our default after any number of "
                        "answers, beyond the "
         "interval")
        + f". (Of {compared} such comparisons of equals chance alone would put "
          f"{0.025 * compared:.0f} here.)",
        "",
        "All tables together, the fewest questions first:",
        "",
        *markdown(head, [shown for _, shown in rows], 1),
    ]  # fmt: skip


def _asked(rows: Sequence[Row]) -> Floats:
    return np.array([row["asked"] for row in rows], dtype=np.float64)


def _interval(x: Floats) -> tuple[float, float]:
    """Return the 95% interval of the mean of x (n,), by Student's t."""
    half = float(stats.t.ppf(0.975, len(x) - 1) * stats.sem(x)) if len(x) > 1 else np.inf
    return float(x.mean()) - half, float(x.mean()) + half


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark and print its report; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(description="Others' rules for the next question beside ours.")
    parser.add_argument("--quick", action="store_true", help="two problems, k = 5 only")
    parser.add_argument("--seeds", type=int, help="problems for each table (default: 20; quick: 2)")
    parser.add_argument(
        "--levels", type=int, nargs="+", help="numbers of levels (default: 5 10 20; quick: 5)"
    )
    parser.add_argument("--jobs", type=int, default=-1, help="processes (default: one a core)")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md", help="write the report there as well"
    )
    chosen = parser.parse_args(arguments)
    levels = chosen.levels or ([5] if chosen.quick else [5, 10, 20])
    todo = cells([f"k = {k}" for k in levels], chosen.seeds or (2 if chosen.quick else 20))
    made_of = sources("benchmarks.asking.question_rules")  # a row of other code is none of these
    how = {"journal": chosen.journal, "jobs": chosen.jobs, "own": lambda cell: (made_of, {})}
    rows = sweep(questions.run, todo, **how)
    publish(report(list(zip(todo, rows, strict=True))), chosen.out)


if __name__ == "__main__":
    main()
