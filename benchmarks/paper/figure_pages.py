"""What the site says of the paper's figures, from their runs: docs/claims.md, and five rows of docs/paper.md.

python -m benchmarks.paper.figure_pages                             from the committed runs
python -m benchmarks.paper.figure_pages results/figures/runs.csv    from those of `make figures`, which it commits
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.reporting import save, with_interval
from qlearn.experiments.settings import TUTORS
from qlearn.paper.claims import AS_PRINTED, claims, claims_page

ROOT = Path(__file__).resolve().parents[2]
RUNS = ROOT / "notebooks" / "data" / "figures.csv"
SAID = {
    2: "figure 2: the percentage asked rises with k",
    3: "figure 3: it rises slightly with the number of states",
    4: "figure 4: the loss is below 1%",
}
_MEASURED = {
    2: "Slope for 5 levels more, of all comparisons, in points",
    3: "Slope for 100 states more, of all comparisons, in points",
    4: "The formula, signed as printed, mean over the sizes, in percent",
}
_EXCESS = "excess_loss_percent"
DOMINANCE = "2.2: dominance is partial and may not be very discriminating"
FEWER = "6: the method learns a good policy with fewer questions"
_FOOTNOTE = {"box-rescaled": "box with footnote 3"}


def claim_rows(frame: pd.DataFrame) -> list[str]:
    """The rows of docs/paper.md on the runs: claim, verdict, of figures 2, 3 and 4 by tutor, numbers with intervals."""
    told = claims(frame)
    rows = [_dominance(frame), _fewer(frame)]
    for figure, claim in SAID.items():
        printed = told[(told.figure == figure) & (told.measure == AS_PRINTED[figure])]
        numbers = f"{_MEASURED[figure]}: {_numbers(printed)}"
        if figure == 4:
            excess = told[(told.figure == 4) & (told.measure == _EXCESS)]
            numbers += f". True policy loss beyond the oracle's: {_numbers(excess)}; below 1%: {_verdicts(excess)}"
        rows.append(f"| {claim} | {_verdicts(printed)} | {numbers} |")
    return rows


def _dominance(frame: pd.DataFrame) -> str:
    """What dominance settles of the comparisons of runs with the polytope, in the first series."""
    parts = []
    for k, runs in _first_series(frame[frame.comparator == "polytope"]).groupby("levels"):
        parts.append(f"{with_interval(100 * runs.dominance / runs.compared, 1)}% at k = {k}")
    return f"| {DOMINANCE} | holds | of all comparisons it settles {', '.join(parts)} ({_places(frame)}) |"


def _fewer(frame: pd.DataFrame) -> str:
    """What the fewest and the most levels take, and lose: the polytope with a truthful tutor, others with the worst."""
    parts = []
    for name in dict.fromkeys(frame.comparator):
        runs = _first_series(frame[frame.comparator == name])
        errs = max(runs.errs, key=TUTORS.index)
        ends = [runs[(runs.errs == errs) & (runs.levels == k)] for k in (runs.levels.min(), runs.levels.max())]
        if name != "always":
            asked = " to ".join(f"{with_interval(end.asked_percent_all, 2)}%" for end in ends)
            counts = " to ".join(with_interval(end.asked, 0) for end in ends)
            lost = " to ".join(with_interval(100 * end.excess_loss, 2) for end in ends)
            parts.append(f"{_name(name)}, {errs}: {asked} of the comparisons ({counts} questions), loses {lost}%")
    said = f"from the fewest levels to the most, beyond the oracle's loss ({_places(frame)}): {'; '.join(parts)}"
    return f"| {FEWER} | holds | {said} |"


def _first_series(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame.states == frame.states.min()]


def _places(frame: pd.DataFrame) -> str:
    return f"{frame.states.min()} states, {frame.seed.nunique()} runs"


def _verdicts(told: pd.DataFrame) -> str:
    """Of each comparator, each answer with the tutors of whom it is true."""
    parts = []
    for name, rows in told.groupby("comparator", sort=False):
        answers = []
        for answer, some in rows.groupby("answer", sort=False):
            answers.append(f"{answer} ({', '.join(sorted(some.errs, key=TUTORS.index))})")
        parts.append(f"{_name(name)}: {', '.join(answers)}")
    return "; ".join(parts)


def _name(comparator: Any) -> str:
    return _FOOTNOTE.get(str(comparator), str(comparator))


def _numbers(told: pd.DataFrame) -> str:
    """Of each comparator, the estimate and its interval by tutor."""
    parts = []
    for name, rows in told.groupby("comparator", sort=False):
        by_tutor = [f"{row.errs} {row.estimate:+.2f} ({row.low:+.2f} to {row.high:+.2f})" for row in rows.itertuples()]
        parts.append(f"{_name(name)} {', '.join(by_tutor)}")
    return "; ".join(parts)


def with_rows(page: str, rows: Sequence[str]) -> str:
    """The page with these rows in place of those that begin with the same claims. Raises ValueError without them."""
    lines = page.splitlines()
    for row in rows:
        start = row[: row.index("|", 2) + 1]
        places = [i for i, line in enumerate(lines) if line.startswith(start)]
        if len(places) != 1:
            raise ValueError(f"the page must have one row that begins with {start!r}, not {len(places)}")
        lines[places[0]] = row
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write both pages, and keep the runs that they are of."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="?", type=Path, default=RUNS, help="runs.csv of `qlearn figures` [%(default)s]")
    given = parser.parse_args(arguments).runs
    if given.resolve() != RUNS:
        shutil.copyfile(given, RUNS)
    frame = pd.read_csv(RUNS)
    save(claims_page(frame), ROOT / "docs" / "claims.md", f"0-{frame.seed.max()}")
    page = ROOT / "docs" / "paper.md"
    page.write_text(with_rows(page.read_text(encoding="utf-8"), claim_rows(frame)), encoding="utf-8")


if __name__ == "__main__":
    main()
