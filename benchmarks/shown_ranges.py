"""Share of levels whose value lies in the range that an interview shows: RESULTS-ranges.md.

    python -m benchmarks.shown_ranges --out benchmarks/RESULTS-ranges.md

Simulated people with hidden scales answer a whole interview (``elicit.Interview``), until it ends
by itself. Then each level's range is compared with its true value.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import expit
from scipy.stats import binomtest

from benchmarks.reporting import machine, markdown, publish
from elicit import AnswerLog, Comparator, Interview, PersonTutor, Query, Session, value_bounds
from elicit.model.scale import Floats
from elicit.people.rankin import WEIGHTS
from elicit.person.course.ranges import value_ranges
from elicit.person.findings import scale_rows
from elicit.person.showing import Subject
from qlearn.cli.teach_subjects import taught_by

Person = Callable[[dict[str, Any]], str]
ICU = "icu-sepsis"
LISTS = {
    "list of 8, 6 levels": (
        ("died", "critical", "severe", "moderate", "mild", "recovered"),
        (33, 11, 0, 1, 4, 51),
        (13, 4, 46, 0, 26, 11),
        (1, 20, 1, 69, 1, 8),
        (6, 19, 42, 3, 5, 25),
        (22, 8, 1, 7, 62, 0),
        (8, 12, 38, 16, 0, 26),
        (19, 13, 6, 30, 0, 32),
        (6, 7, 24, 21, 42, 0),
    ),
    "list of 6, 4 levels": (
        ("died", "needs daily care", "limited", "no complaints"),
        (6, 4, 20, 70),
        (3, 9, 38, 50),
        (2, 14, 54, 30),
        (1, 24, 45, 30),
        (1, 10, 69, 20),
        (4, 30, 36, 30),
    ),
}
"""Alternatives that are nearly equal in value if all steps between levels are equal, or whose order
depends on the person: outcomes of 100 each."""
_LEVELS = {name: len(rows[0]) for name, rows in LISTS.items()} | {ICU: 6}
_EQUAL, _PRECISION, _LAPSE = 0.03, 100.0, 0.02  # of a careful person


class Setting(NamedTuple):
    """A law of hidden scales, and a law of errors."""

    scales: str
    errors: str


SETTINGS = (
    Setting("uniform", "few"),
    Setting("nearly equal steps", "few"),
    Setting("few large steps", "few"),
    Setting("published", "few"),
    Setting("uniform", "as people"),
)


class Found(NamedTuple):
    """The levels between the best and the worst (n,) of an interview that is settled.

    ``once`` has ranges (2, n) that leave out 5% at each end, ``whole`` those that leave out 2.5%,
    both from the comparator's own draws, and ``shown`` those on the screen, from 0 to 1. ``known``
    says which best guesses are shown.
    """

    values: Floats
    once: Floats
    whole: Floats
    shown: Floats
    known: Any
    guesses: Floats
    answered: int


def scale(law: str, k: int, number: int) -> Floats:
    """Return a hidden scale (k,), from 0 to 1."""
    rng, p = np.random.default_rng([number, k, 11]), k - 1
    if law == "published":  # a mixture of three sets of weights, with as many levels as needed
        at = np.linspace(0.0, 6.0, k)
        sets = [np.interp(at, np.arange(7), np.maximum(w.values, 0.0)) for w in WEIGHTS.values()]
        mixed = rng.dirichlet(np.ones(3)) @ np.maximum.accumulate(sets, axis=1)
        gaps = np.diff(mixed)
    else:
        sparse = float(np.exp(rng.uniform(np.log(0.2), np.log(2.0)))) / p  # as the comparator's
        a = {"uniform": 1.0, "nearly equal steps": 5.0, "few large steps": sparse}[law]
        gaps = rng.dirichlet(np.full(p, a))
    gaps = np.maximum(gaps, 1e-9)
    return np.concatenate([[0.0], np.cumsum(gaps[:-1]) / gaps.sum(), [1.0]])


def careful(values: Floats, number: int) -> Person:
    """Return a person who calls differences of up to 3 of 100 equal, and seldom errs."""
    rng = np.random.default_rng([number, 7])

    def says(question: dict[str, Any]) -> str:
        rows, of = question["rows"], question["of"]
        apart = sum((row["a"] - row["b"]) * values[row["level"]] for row in rows) / of
        at_random, u = rng.random() < _LAPSE, rng.random()
        if at_random:
            return "a" if u < 0.5 else "b"
        if abs(apart) <= _EQUAL:
            return "equal"
        return "a" if u < expit(_PRECISION * apart) else "b"

    return says


def as_people(values: Floats, number: int) -> Person:
    """Return a person who errs as ``PersonTutor`` does. They see the rows that differ."""
    tutor = PersonTutor(values, seed=number)

    def says(question: dict[str, Any]) -> str:
        sides = np.zeros((2, len(values)))
        for row in question["rows"]:
            sides[:, row["level"]] = row["a"], row["b"]
        verdict = tutor(Query("shown", *sides / question["of"])).verdict
        assert verdict is not None
        return {1: "a", -1: "b", 0: "equal"}[int(verdict)]

    return says


def interview(problem: str, setting: Setting, number: int, folder: Path) -> Found | None:
    """Return what an interview about a problem shows at its end, or None if it is not settled.

    Offers to stop are left out, because these people would decline them.
    """
    k = _LEVELS[problem]
    values = scale(setting.scales, k, number)
    says = (careful if setting.errors == "few" else as_people)(values, number)
    path = str(folder / f"{problem}.csv") if problem in LISTS else problem
    subject = (taught := taught_by(path, "posterior", 10, None, number, 0.01)).subject
    plain = Subject(subject.labels)
    course = replace(subject, nearly=plain.nearly, conclude=plain.conclude, stakes=plain.stakes)
    log = AnswerLog()
    with (
        Session(taught.make, log, audit=0.1, seed=number) as session,
        Interview(session, course) as asks,
    ):
        screen = asks.handle({"do": "practised", "choice": "a"})
        while screen["stage"] != "end":
            if found := screen["conflict"]:
                choice = found["choices"][0]["choice"]
                screen = asks.handle({"do": "settle", "id": found["id"], "choice": choice})
            else:
                put = screen["question"]
                screen = asks.handle({"do": "answer", "id": put["id"], "choice": says(put)})
        result = session.result()
        if not subject.conclude(result, None).settled:
            return None
        return found_at_end(result.comparator, values, subject.labels, log, screen["answered"])


def found_at_end(
    comparator: Comparator, values: Floats, labels: Sequence[str], log: AnswerLog, answered: int
) -> Found:
    """Return the ranges of a comparator, beside the true values (k,)."""
    rows = scale_rows(comparator, labels, log)[-2:0:-1]
    return Found(
        values[1:-1],
        outwards(value_bounds(comparator)),
        outwards(value_ranges(comparator)),
        np.array([(row.low, row.high) for row in rows]).T / 100.0,
        np.array([row.known for row in rows]),
        np.array([row.value for row in rows]) / 100.0,
        answered,
    )


def outwards(ends: tuple[Floats, Floats]) -> Floats:
    """Return ranges (2, k - 2) rounded outwards to whole numbers of 100, as they are shown."""
    low, high = (100.0 * end[1:-1] for end in ends)
    return np.array([np.floor(low + 1e-6), np.ceil(high - 1e-6)]) / 100.0


def held(values: Floats, ranges: Floats) -> Any:
    """Return which values (n,) lie in their ranges (2, n)."""
    return (values >= ranges[0] - 1e-9) & (values <= ranges[1] + 1e-9)


def share(of: Any) -> str:
    """Return the percentage of a list of flags, with its 95% interval by Wilson."""
    if not len(of):
        return "none"
    hits = binomtest(int(np.sum(of)), len(of))
    ends = hits.proportion_ci(method="wilson")
    return f"{100 * np.mean(of):.1f} ({100 * ends.low:.0f} to {100 * ends.high:.0f})"


HEAD = (
    "problem",
    "scales",
    "errors",
    "settled",
    "answers",
    "levels",
    "5% at each end, once",
    "2.5% at each end, once",
    "as shown",
    "width, once",
    "width, as shown",
    "best guess shown",
    "of these in range, once",
    "of these in range, as shown",
)


def row_of(names: Sequence[str], asked: int, found: Sequence[Found]) -> list[str]:
    """Return a line of the table."""
    if not found:
        return [*names, f"0 of {asked}", *["none"] * (len(HEAD) - 4)]
    values, known = (np.concatenate([getattr(one, name) for one in found]) for name in _FLAT)
    once, whole, shown = (
        np.concatenate([getattr(one, name) for one in found], axis=1) for name in _RANGES
    )
    return [
        *names,
        f"{len(found)} of {asked}",
        f"{np.mean([one.answered for one in found]):.1f}",
        f"{len(values)}",
        *(share(held(values, ranges)) for ranges in (once, whole, shown)),
        *(f"{100 * np.mean(ranges[1] - ranges[0]):.0f}" for ranges in (once, shown)),
        f"{100 * np.mean(known):.0f}%",
        share(held(values, once)[known]),
        share(held(values, shown)[known]),
    ]


_FLAT, _RANGES = ("values", "known"), ("once", "whole", "shown")


def write_lists(folder: Path) -> None:
    """Write the lists of alternatives as CSV files into a folder."""
    for name, (labels, *rows) in LISTS.items():
        lines = [",".join(["alternative", *labels])]
        lines += [",".join([f"T{i}", *map(str, row)]) for i, row in enumerate(rows, start=1)]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def report(sessions: Sequence[int]) -> Iterator[list[str]]:
    """The parts of the page."""
    yield ["# Ranges that an interview shows", "", machine()]
    yield [
        "Simulated people answer an interview of `qlearn teach` (posterior, tolerance 0.01, with "
        "repeated questions) until it ends. They never stop early. Then each level between the "
        "worst and the best has its true value in its range, or not. Shares are in percent, with a "
        "95% interval by Wilson, which takes levels of one interview as independent. The screen "
        "states a probability of 95%.",
        "",
        "- *5% at each end, once*: the ranges that were shown until 27 November 2026, from the "
        "comparator's own draws.",
        "- *2.5% at each end, once*: the same draws, but the whole range has the probability.",
        "- *As shown*: from these draws, and those of the same posterior learned three times more "
        "with other seeds.",
        "- *Few* errors: differences of up to 3 of 100 are called equal, and 2% of answers are "
        "random. The others err by a logistic law, with 5% wrong at a difference of 3 of 100. *As "
        "people*: `PersonTutor`.",
        "- *Few large steps* are drawn from the comparator's prior. *Published*: mixtures of three "
        "published sets of weights of the Rankin scale.",
    ]
    lines, every = [], []
    with tempfile.TemporaryDirectory() as name:
        write_lists(folder := Path(name))
        for problem, asked in zip(_LEVELS, sessions, strict=True):
            of_problem = list[Found]()
            for setting in SETTINGS:
                runs = [interview(problem, setting, number, folder) for number in range(asked)]
                settled = [found for found in runs if found is not None]
                of_problem += settled
                lines.append(row_of((problem, *setting), asked, settled))
            every += of_problem
            lines.append(row_of((problem, "all", "all"), asked * len(SETTINGS), of_problem))
    lines.append(row_of(("all", "all", "all"), len(SETTINGS) * sum(sessions), every))
    yield markdown(HEAD, lines, 3)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--sessions",
        type=int,
        nargs=len(_LEVELS),
        default=[30, 10, 3],
        help=f"interviews a row, of {', '.join(_LEVELS)} %(default)s",
    )
    parser.add_argument("--out", type=Path, help="the page to write")
    given = parser.parse_args()
    publish(report(given.sessions), given.out, f"0-{max(given.sessions) - 1}")


if __name__ == "__main__":
    main()
