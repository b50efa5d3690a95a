"""Pages on the paper's figures, from their runs: docs/claims.md, and of docs/paper.md
five rows and the section on figures 2 to 4.

python -m benchmarks.paper.figure_pages                             from the committed runs
python -m benchmarks.paper.figure_pages results/figures/runs.csv    from those of `make figures`,
                                                                    which it commits
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.reporting import markdown, save, with_interval
from qlearn.experiments.settings import TUTORS
from qlearn.paper.claims import (
    FAILS,
    HOLDS,
    OPEN,
    READINGS,
    answers,
    claims,
    claims_page,
    listed,
    sizes_of,
    tutors_of,
)

ROOT = Path(__file__).resolve().parents[2]
RUNS = ROOT / "notebooks" / "data" / "figures.csv"
SAID = {
    2: "figure 2: the percentage asked rises with k",
    3: "figure 3: it rises slightly with the number of states",
    4: "figure 4: the loss is below 1%",
}
_UNIT = {
    2: "Slopes in percentage points for 5 levels more; {places}.",
    3: "Slopes in percentage points for 100 states more; {places}.",
    4: "Percent, mean over the sizes; {places}. In brackets the interval, and after it the "
    "farthest end of the "
    "interval of one size: below 1 the claim holds. It does not hold where the "
    "whole interval of some size lies beyond 1%.",
}
SECTION = "## Figures 2 to 4, by tutor"
DOMINANCE = "2.2: dominance is partial and may not be very discriminating"
FEWER = "6: the method learns a good policy with fewer questions"
OWN = ("box", "box-rescaled")
"""The paper's comparator, without and with its footnote 3."""
_FOOTNOTE = {"box-rescaled": "box with footnote 3"}


def claim_rows(frame: pd.DataFrame) -> list[str]:
    """The rows of docs/paper.md on the runs: claim, verdict, of figures 2, 3 and 4 by tutor,
    numbers with intervals.
    """
    told = claims(frame)
    rows = [_dominance(frame), _fewer(frame)]
    for figure, claim in SAID.items():
        verdicts, others = [], []
        for measured, measure in READINGS[figure].items():
            own = {
                name: rows for name, rows in answers(told, figure, measure).items() if name in OWN
            }
            by_answer = _by_answer(own)
            counts = ", ".join(
                f"{answer} in {sum(map(len, arms.values()))}" for answer, arms in by_answer.items()
            )
            verdicts.append(f"{_capital(measured)}, {sum(map(len, own.values()))} cases: {counts}")
            others += [
                f"{_capital(answer)}, {measured}: "
                f"{listed({_name(name): of for name, of in arms.items()})}"
                for answer, arms in by_answer.items()
                if answer != HOLDS
            ]
        links = f"[Figure {figure}, by tutor](#figure-{figure})"
        rows.append(f"| {claim} | {'<br>'.join(verdicts)} | {'<br>'.join([*others, links])} |")
    return rows


def claim_section(frame: pd.DataFrame) -> str:
    """The section of docs/paper.md with the answer of every comparator, tutor and measure, and its
    interval.
    """
    told = claims(frame)
    lines = [SECTION]
    for figure, readings in READINGS.items():
        lines += [
            "",
            f"### Figure {figure}",
            "",
            _UNIT[figure].format(places=sizes_of(frame, figure, _FOOTNOTE)),
        ]
        for measured, measure in readings.items():
            by_name = answers(told, figure, measure)
            cells = [
                [
                    _name(name),
                    *(_cell(rows[tutor]) if tutor in rows else "" for tutor in tutors_of(told)),
                ]
                for name, rows in by_name.items()
            ]
            lines += ["", f"{_capital(measured)}:", ""]
            lines += markdown(["comparator", *tutors_of(told)], cells, 1 + len(tutors_of(told)))
            if measure == "paper_loss_percent":
                lines += ["", _with_sign(told)]
    return "\n".join([*lines, "", ""])


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _cell(row: Any) -> str:
    """A claim's answer and its number."""
    worst = f"; {row.worst:.2f}" if row.figure == 4 else ""
    return f"{row.answer}<br>{row.estimate:+.2f} ({row.low:+.2f} to {row.high:+.2f}{worst})"


def _dominance(frame: pd.DataFrame) -> str:
    """Write the share of the polytope's comparisons that dominance decides, in the first series."""
    parts = []
    for k, runs in _first_series(frame[frame.comparator == "polytope"]).groupby("levels"):
        parts.append(f"{with_interval(100 * runs.dominance / runs.compared, 1)}% at k = {k}")
    return (
        f"| {DOMINANCE} | holds | of all comparisons it decides {', '.join(parts)} "
        f"({_places(frame)}) |"
    )


def _fewer(frame: pd.DataFrame) -> str:
    """Write the questions and the losses at the fewest and at the most levels.

    The polytope has a truthful tutor, the others have the worst.
    """
    parts = []
    for name in dict.fromkeys(frame.comparator):
        runs = _first_series(frame[frame.comparator == name])
        errs = max(runs.errs, key=TUTORS.index)
        ends = [
            runs[(runs.errs == errs) & (runs.levels == k)]
            for k in (runs.levels.min(), runs.levels.max())
        ]
        if name != "always":
            asked = " to ".join(f"{with_interval(end.asked_percent_all, 2)}%" for end in ends)
            counts = " to ".join(with_interval(end.asked, 0) for end in ends)
            lost = " to ".join(with_interval(100 * end.excess_loss, 2) for end in ends)
            parts.append(
                f"{_name(name)}, {errs}: {asked} of the comparisons ({counts} questions), loses "
                f"{lost}%"
            )
    said = (
        f"from the fewest levels to the most, beyond the oracle's loss ({_places(frame)}): "
        f"{'; '.join(parts)}"
    )
    return f"| {FEWER} | holds | {said} |"


def _first_series(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame.states == frame.states.min()]


def _places(frame: pd.DataFrame) -> str:
    return f"{frame.states.min()} states, {frame.seed.nunique()} runs"


def _with_sign(told: pd.DataFrame) -> str:
    """Write whether the formula is below 1% if its sign is left as it is."""
    rows = told[(told.figure == 4) & (told.measure == "paper_loss_percent")]
    below = (rows.high < 1).sum()
    return (
        f"Left with its sign, the formula is below 1% in {below} of {len(rows)} cases, for it is v "
        "- V, "
        "which is negative where the model loses. So it is its size that is held to 1%."
    )


def _by_answer(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, list[str]]]:
    """Return the tutors with whom each answer is true, by comparator; "holds" comes first."""
    found: dict[str, dict[str, list[str]]] = {}
    for answer in (HOLDS, FAILS, OPEN):
        for name, by_tutor in rows.items():
            if of := [tutor for tutor, row in by_tutor.items() if row.answer == answer]:
                found.setdefault(answer, {})[name] = of
    return found


def _name(comparator: Any) -> str:
    return _FOOTNOTE.get(str(comparator), str(comparator))


def with_rows(page: str, rows: Sequence[str]) -> str:
    """The page with these rows in place of those that begin with the same claims. Raises ValueError
    without them.
    """
    lines = page.splitlines()
    for row in rows:
        start = row[: row.index("|", 2) + 1]
        places = [i for i, line in enumerate(lines) if line.startswith(start)]
        if len(places) != 1:
            raise ValueError(
                f"the page must have one row that begins with {start!r}, not {len(places)}"
            )
        lines[places[0]] = row
    return "\n".join(lines) + "\n"


def with_section(page: str, section: str) -> str:
    """The page with this section in place of the one with the same heading, which ends where the
    next one of its level begins. Raises ValueError without it."""
    heading = section.splitlines()[0]
    before, found, after = page.partition(f"\n{heading}\n")
    if not found or "\n## " not in after:
        raise ValueError(
            f"the page must have the heading {heading!r}, and another of its level after it"
        )
    rest = after[after.index("\n## ") + 1 :]
    return f"{before}\n{section}{rest}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write both pages, and keep the runs that they are of."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "runs",
        nargs="?",
        type=Path,
        default=RUNS,
        help="runs.csv of `qlearn figures` [%(default)s]",
    )
    given = parser.parse_args(arguments).runs
    if given.resolve() != RUNS:
        shutil.copyfile(given, RUNS)
    frame = pd.read_csv(RUNS)
    save(claims_page(frame), ROOT / "docs" / "claims.md", f"0-{frame.seed.max()}")
    page = ROOT / "docs" / "paper.md"
    text = with_rows(page.read_text(encoding="utf-8"), claim_rows(frame))
    page.write_text(with_section(text, claim_section(frame)), encoding="utf-8")


if __name__ == "__main__":
    main()
