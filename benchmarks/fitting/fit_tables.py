"""The tables of ``benchmarks.fitting.fit_cost``, and the notes on how to read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.fitting.fit_accuracy import References, disagreement, doubt
from benchmarks.fitting.fit_methods import LEVEL, ORDERED, PARTICLES, POSTERIOR, RIDGED
from benchmarks.fitting.item_strengths import OURS, ItemLine
from benchmarks.fitting.logistic_libraries import RIDGE
from benchmarks.fitting.tutor_data import FRESH, SPREAD, Data
from benchmarks.reporting import markdown


class Line(NamedTuple):
    """A line of the table: milliseconds an answer; error None where the method solves no
    ``Problem``.
    """

    name: str
    solves: str
    milliseconds: float
    error: float | None
    decided: float
    wrong: float
    remark: str


def about(cell: list[Data], tight: list[References]) -> str:
    """Write the error rate of the tutors, and the accuracy of the references with a ridge."""
    errors = np.mean([data.errors for data in cell])
    off = max(
        doubt(problem, data, each[problem])
        for data, each in zip(cell, tight, strict=True)
        for problem in (RIDGED, ORDERED)
    )
    apart = [disagreement(problem, cell[0], tight[0][problem][:2]) for problem in (RIDGED, ORDERED)]
    checked = [each for each in apart if each == each]
    return (
        f"{errors:.0%} of the answers are wrong. The references are within {off:.0e} of the "
        "optima, by their "
        "gradients"
        + (
            f", and within {max(checked):.0e} of cvxpy's fits at tight tolerances, on a sample."
            if checked
            else "; Clarabel broke down on a sample at tight tolerances."
        )
    )


def table(found: list[Line]) -> list[str]:
    """A Markdown table; ratios are to the posterior without lapses."""
    least = next(line.milliseconds for line in found if line.name == POSTERIOR.name)
    lines = []
    for name, solves, milliseconds, error, decided, wrong, remark in found:
        cells = [
            f"{milliseconds:,.2f}",
            f"{milliseconds / least:,.1f}",
            "" if error is None else f"{error:.0e}",
        ]
        cells += [f"{decided:.1%}", f"{wrong:.2%}" if decided else ""]
        lines.append([name, solves, *cells, remark])
    head = ("method", "solves", "ms an answer", "ratio", "error", "decided", "wrong", "remark")
    return markdown(head, lines, 2)


def fastest(
    measured: dict[tuple[int, int], list[Line]],
    items: dict[tuple[int, int], tuple[list[ItemLine], int]],
) -> list[str]:
    """Write who fits the same problem fastest, by (k, n), as a sentence and a table.

    Cases that another library wins come first.
    """
    rows = []
    for (k, n), lines in measured.items():
        own = next(line for line in lines if line.name == f"{OURS}, monotone=False")
        others = [line for line in lines if line.solves == str(RIDGED) and line is not own]
        rows.append(("bags, ridge", k, n, min(others, key=lambda line: line.milliseconds), own))
    for (k, n), (found, _) in items.items():
        fits = [line for line in found if not line.missing]
        own_items = next(line for line in found if line.name == OURS)
        best = min((line for line in fits if line.name != OURS), key=lambda line: line.milliseconds)
        rows.append(("items", k, n, best, own_items))
    rows.sort(key=lambda row: row[3].milliseconds / row[4].milliseconds)
    lost = [row for row in rows if row[3].milliseconds < row[4].milliseconds]
    cells = []
    for problem, k, n, best, own in rows:
        times = [
            f"{best.milliseconds:,.1f}",
            f"{own.milliseconds:,.1f}",
            f"{best.milliseconds / own.milliseconds:.2f}",
        ]
        cells.append([problem, str(k), str(n), best.name, *times])
    names = " and ".join(dict.fromkeys(row[3].name for row in lost))
    problems = " and ".join(dict.fromkeys(row[0] for row in lost))
    won = (
        f"on {problems} {names} fits them faster than `{OURS}` in {len(lost)} of {len(rows)} "
        "tables."
        if lost
        else ""
    )
    return [
        (won[:1].upper() + won[1:] or f"No other library fits all resamples faster than `{OURS}`.")
        + " The fastest of the others against it, all fits, milliseconds of processor time; below "
        "1 the other wins:",
        "",
        *markdown(
            ("problem", "k", "answers", "fastest of the others", "ms", "ours", "ratio"), cells, 1
        ),
    ]


def notes(sets: int, m: int) -> list[str]:
    """Write notes on what was measured, and how to read it."""
    return [
        f"Milliseconds of processor time an answer, mean over {sets} data set(s) for each table: a "
        "tutor whose gaps "
        "are uniform on their simplex and who answers by eq. (6), with the precision that gives "
        "logits a standard "
        f"deviation of {SPREAD:g}. The pairs are uniform, without those that the order of the "
        "levels settles.",
        "",
        f"The fits: all {m} bootstrap resamples and the answers themselves, once more after the "
        "last answer, as the "
        "paper does after each; the time to draw resamples and to decide is left out. All tools "
        "get the same rows "
        f"(tail sums), no intercept, and the ridge {RIDGE:g} / 2 times the squares of the gaps, in "
        "logits "
        f"(scikit-learn: C = {1 / RIDGE:g}). statsmodels' Logit has no ridge; resamples without a "
        "finite maximum fail. "
        "The tools skip the rows that a resample does not hold, and start from the fit to the "
        "answers or from the last "
        "resample where they can; unchecked: without scikit-learn's own checks of its input. One "
        "row gives SciPy all "
        "resamples as one program. Of slow tools few fits are run, and the time for all is "
        "extrapolated; cvxpy's "
        "Parameter program includes being compiled once, as the next answer changes its size. The "
        "comparators take in "
        "one answer, decide one pair, and so on: these three rows are means over the whole run. "
        "BradleyTerryComparator, told the tutor's precision (only its prior uses it), refits on "
        "its schedule; "
        f"PosteriorComparator, with {PARTICLES} particles, learns the precision.",
        "",
        "Ratio: to PosteriorComparator without lapses. Error: the largest difference from the "
        "reference, over levels "
        "and resamples, as a share of the tutor's theta_k; the references are the project's fits "
        "after further Newton "
        f"steps. Decided: the share of {FRESH} fresh pairs for each data set, open "
        f"to dominance, that the rule settles at {LEVEL:.0%}: the percentiles over the resamples "
        "and the fit to the "
        "answers agree on the sign, or the posterior is sure. Wrong: the share of wrong verdicts "
        "among these. Where a "
        "tool ran on some resamples only, the references stand in for the others. A stronger ridge "
        "decides more, and "
        "errs more.",
    ]
