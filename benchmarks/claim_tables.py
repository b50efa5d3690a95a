"""Tables and sentences of docs/paper.md on the runs of the paper's figures.

A text in benchmarks/blocks names them with the table of the runs, and ``quotes`` writes them there:
`{{notebooks/data/figures.csv: figure 2, of all comparisons}}`. ``parts`` has all names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.reporting import markdown, with_interval
from qlearn.experiments.settings import TUTORS
from qlearn.paper.claims import (
    FAILS,
    HOLDS,
    OPEN,
    READINGS,
    answers,
    claims,
    sizes_of,
    tutors_of,
)

_RESCALED = "box-rescaled"
_OWN = ("box", _RESCALED)
"""The paper's comparator: as it is, and with each resample rescaled."""
_NAMES = {_RESCALED: "box, rescaled"}


def part(runs: Path, name: str) -> str:
    """Return a table or a sentence on the runs of the paper's figures.

    Parameters
    ----------
    runs : Path
        The table ``runs.csv`` of `qlearn figures`.
    name : str
        One of the names of ``parts``.

    Raises
    ------
    ValueError
        If there is no such part.
    """
    known = _parts_of(runs, runs.stat().st_mtime_ns)
    if name not in known:
        raise ValueError(f"of {runs.name} there is no {name!r}: there are {', '.join(known)}")
    return known[name]()


def parts(frame: pd.DataFrame) -> dict[str, Callable[[], str]]:
    """Return the functions that write the parts, by their names.

    Parameters
    ----------
    frame : DataFrame
        One row for each run, as in ``runs.csv`` of `qlearn figures`.
    """
    told = claims(frame)
    found: dict[str, Callable[[], str]] = {
        "decided by dominance": partial(_dominance, frame),
        "few questions": partial(_few_questions, frame),
        "runs with the fewest states": partial(_places, frame),
        "signed losses": partial(_with_sign, told),
    }
    for figure, readings in READINGS.items():
        found[f"figure {figure}, sizes"] = partial(_sizes, frame, figure)
        found[f"figure {figure}, verdicts"] = partial(_verdicts, told, figure)
        found[f"figure {figure}, exceptions"] = partial(_exceptions, told, figure)
        for measured, measure in readings.items():
            found[f"figure {figure}, {measured}"] = partial(_table, told, figure, measure)
    return found


@cache
def _parts_of(runs: Path, changed: int) -> Mapping[str, Callable[[], str]]:
    """Return the parts of a table that was last changed at that time."""
    return parts(pd.read_csv(runs))


def _table(told: pd.DataFrame, figure: int, measure: str) -> str:
    """Return a table with a line for each comparator and a column for each tutor."""
    tutors = tutors_of(told)
    rows = [
        [_name(name), *(_cell(of[tutor]) if tutor in of else "" for tutor in tutors)]
        for name, of in answers(told, figure, measure).items()
    ]
    return "\n".join(markdown(["comparator", *tutors], rows, 1 + len(tutors)))


def _cell(row: Any) -> str:
    """Return a claim's answer and its number, on two lines of a cell."""
    worst = f"; {row.worst:.2f}" if row.figure == 4 else ""
    return f"{row.answer}<br>{row.estimate:+.2f} ({row.low:+.2f} to {row.high:+.2f}{worst})"


def _sizes(frame: pd.DataFrame, figure: int) -> str:
    """Return the sizes in a figure, in words."""
    return sizes_of(frame, figure, _NAMES).replace("), ", "); ")  # a name may have a comma


def _verdicts(told: pd.DataFrame, figure: int) -> str:
    """Return in how many cases of the paper's comparator each answer is true."""
    lines = []
    for measured, by_answer in _own(told, figure):
        counts = {answer: sum(map(len, arms.values())) for answer, arms in by_answer.items()}
        listed = ", ".join(f"{answer} in {count}" for answer, count in counts.items())
        lines.append(f"{_capital(measured)}, {sum(counts.values())} cases: {listed}")
    return "<br>".join(lines)


def _exceptions(told: pd.DataFrame, figure: int) -> str:
    """Return the cases of the paper's comparator in which a claim does not hold, or may not."""
    lines = [
        f"{_capital(answer)}, {measured}: "
        + "; ".join(f"{_name(name)} ({', '.join(tutors)})" for name, tutors in arms.items())
        for measured, by_answer in _own(told, figure)
        for answer, arms in by_answer.items()
        if answer != HOLDS
    ]
    return "<br>".join(lines) or "No exceptions"


def _own(told: pd.DataFrame, figure: int) -> Iterator[tuple[str, dict[str, dict[str, list[str]]]]]:
    """Yield each measure of a figure, and the tutors with whom each answer is true.

    The tutors are in lists by answer and by comparator, those of "holds" first. Only the paper's
    comparator is there.
    """
    for measured, measure in READINGS[figure].items():
        found: dict[str, dict[str, list[str]]] = {}
        rows = answers(told, figure, measure)
        for answer in (HOLDS, FAILS, OPEN):
            for name in rows:
                tutors = [tutor for tutor, row in rows[name].items() if row.answer == answer]
                if tutors and name in _OWN:
                    found.setdefault(answer, {})[name] = tutors
        yield measured, found


def _dominance(frame: pd.DataFrame) -> str:
    """Return the share of the polytope's comparisons that dominance decides, by the levels."""
    runs = _first_series(frame[frame.comparator == "polytope"])
    shares = (100 * runs.dominance / runs.compared).groupby(runs.levels).mean()
    return ", ".join(f"{share:.0f}% at k = {k}" for k, share in shares.items())


def _few_questions(frame: pd.DataFrame) -> str:
    """Return a table of questions and losses at the fewest and at the most levels.

    The polytope has a truthful tutor. The others have the tutor who errs most.
    """
    rows = []
    ends = (frame.levels.min(), frame.levels.max())
    for name in dict.fromkeys(frame.comparator):
        if name == "always":
            continue
        runs = _first_series(frame[frame.comparator == name])
        errs = max(runs.errs, key=TUTORS.index)
        few, many = (runs[(runs.errs == errs) & (runs.levels == k)] for k in ends)
        rows.append(
            [
                _name(name),
                errs,
                *(f"{_two_digits(end.asked_percent_all.mean())}%" for end in (few, many)),
                f"{with_interval(100 * many.excess_loss, 2)}%",
            ]
        )
    asked = [f"asked at k = {k}" for k in ends]
    return "\n".join(
        markdown(["comparator", "tutor", *asked, f"excess loss at k = {ends[1]}"], rows, 2)
    )


def _two_digits(x: float) -> str:
    """Return a positive number below 100 with its first two digits, or fewer if they are zeros."""
    return f"{x:.0f}" if x >= 10 else f"{x:.1f}" if x >= 1 else f"{x:.2f}"


def _first_series(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame.states == frame.states.min()]


def _places(frame: pd.DataFrame) -> str:
    return f"{frame.states.min()} states, {frame.seed.nunique()} runs"


def _with_sign(told: pd.DataFrame) -> str:
    """Return in how many cases the formula is below 1% if its sign is left as it is."""
    rows = told[(told.figure == 4) & (told.measure == "paper_loss_percent")]
    return f"{(rows.high < 1).sum()} of {len(rows)} cases"


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _name(comparator: str) -> str:
    return _NAMES.get(comparator, comparator)
