"""What the rows of ``series`` say, with intervals over runs: means, trends, and whether a loss is below 1%."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from elicit.model.scale import Floats
from qlearn.experiments.metrics import half_width, means
from qlearn.experiments.settings import COMPARATORS

DENOMINATORS = ("all", "unequal", "open", "fresh")
LOSSES = ("paper_loss_percent", "paper_abs_percent", "excess_loss_percent")
MEASURES = (
    "asked",
    *(f"asked_percent_{name}" for name in DENOMINATORS),
    *LOSSES,
    "loss_percent",
    "realised_error_rate",
)
_ARM = ["comparator", "error_rate"]
_STEP = {"levels": 5, "states": 100}  # slopes are told for this much more, the step of the paper's series
_BOUND = 1.0  # percent: "the average percentage of loss is lower than 1%"


def series_of(frame: pd.DataFrame, name: str) -> pd.DataFrame:
    """The rows of the series over ``name``, "levels" or "states": those with the commonest number of the other one."""
    other = "states" if name == "levels" else "levels"
    points = frame[["states", "levels"]].drop_duplicates()
    fixed = points.groupby(other, sort=True)[name].nunique().idxmax()
    rows = frame[frame[other] == fixed]
    rows = rows.assign(excess_loss_percent=100 * rows.excess_loss, loss_percent=100 * rows.loss)
    place = rows.comparator.map(COMPARATORS.index)
    return rows.assign(place=place).sort_values(["place", "error_rate", name, "seed"]).drop(columns="place")


def summarise_series(frame: pd.DataFrame) -> pd.DataFrame:
    """One row a point of a series and comparator: the mean over runs of each of ``MEASURES`` and, as ``<name>_half``,
    half the width of its 95% t-interval (nan from one run)."""
    parts = []
    for name in ("levels", "states"):
        rows = series_of(frame, name)
        groups = rows.groupby([name, *_ARM], sort=False)
        table = groups.size().rename("runs").to_frame().join(means(groups, MEASURES)).reset_index()
        parts.append(table.rename(columns={name: "x"}).assign(series=name))
    whole: pd.DataFrame = pd.concat(parts, ignore_index=True)
    return whole[["series", "x", *(name for name in whole.columns if name not in ("series", "x"))]]


def claims(frame: pd.DataFrame) -> pd.DataFrame:
    """The paper's claims, one row each for every comparator and way of measuring, with a 95% t-interval over seeds.

    Figures 2 and 3: ``estimate`` is the mean over seeds of the least squares slope of the percentage asked, in
    percentage points for 5 levels, or 100 states, more; ``agreeing`` counts the seeds whose own slope has its sign.
    ``answer``: "rises", "falls", or "not told" where the interval holds 0. Figure 4: the mean loss over all sizes of a
    seed, in percent; ``worst`` is the greatest distance from zero of an end of the interval at one size. ``answer``:
    "below 1%" if ``worst`` is; "above 1%" if the interval of every size lies beyond 1% on one side; else "not told".
    The oracle, with nothing to compare, is left out. What is not defined (one seed, one point) is nan.
    """
    found: list[dict[str, Any]] = []
    for figure, name in ((2, "levels"), (3, "states")):
        for arm, rows in series_of(frame, name).groupby(_ARM, sort=False):
            if arm[0] != "always":
                found += [_trend(figure, name, arm, rows, f"asked_percent_{each}") for each in DENOMINATORS]
    for arm, rows in series_of(frame, "states").groupby(_ARM, sort=False):
        if arm[0] != "always":
            found += [_below(arm, rows, measure) for measure in LOSSES]
    return pd.DataFrame(found)


_PAGE = """\
# The claims of figures 2, 3 and 4

{runs} runs a point, {steps:,} steps each; 95% t-intervals over the runs. Written by `qlearn figures`.

- figure 2: slope of the percentage asked, in percentage points for 5 levels more; figure 3: for 100 states
  more. In brackets, how many runs' own slopes have that sign.
- figure 4: its formula signed as printed (paper loss), the same with |v(s) - V(s)| (paper abs), and true
  policy loss beyond the oracle's (excess loss), in percent, mean over the sizes; `worst` is the farthest end
  of the interval at one size.

"""
_HEAD = ("figure", "comparator", "tutor errs", "measured", "estimate", "95% interval", "answer")


def claims_page(frame: pd.DataFrame) -> str:
    """The claims of these runs as a page of Markdown of at most 120 columns, to be read as text too."""
    table = [_HEAD, *map(_cells, claims(frame).itertuples())]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    table.insert(1, tuple("-" * width for width in widths))
    rows = (" | ".join(f"{cell:<{n}}" for cell, n in zip(cells, widths, strict=True)) for cells in table)
    page = _PAGE.format(runs=frame.seed.nunique(), steps=frame.rounds.max())
    return page + "".join(f"| {row} |\n" for row in rows)


def _cells(row: Any) -> tuple[str, ...]:
    """A claim as a line of the page's table."""
    measure = str(row.measure).replace("asked_percent_", "% asked of ").removesuffix("_percent").replace("_", " ")
    note = f"worst {row.worst:.2f}" if row.figure == 4 else f"{row.agreeing} of {row.runs}"
    interval = f"{row.low:+.3f} to {row.high:+.3f}"
    rate, mean = f"{100 * row.error_rate:g}%", f"{row.estimate:+.3f}"
    return str(row.figure), str(row.comparator), rate, measure, mean, interval, f"{row.answer} ({note})"


def _trend(figure: int, name: str, arm: Any, rows: pd.DataFrame, measure: str) -> dict[str, Any]:
    table = rows.pivot(index="seed", columns=name, values=measure)
    x = table.columns.to_numpy(dtype=float)
    slopes = np.full(len(table), np.nan)
    if len(x) > 1:
        centred = x - x.mean()
        slopes = table.to_numpy() @ centred / (centred @ centred) * _STEP[name]
    mean, low, high = _interval(slopes)
    return {
        **_claim(figure, arm, measure, f"slope per {_STEP[name]} {name}", slopes),
        "agreeing": int((np.sign(slopes) == np.sign(mean)).sum()),
        "worst": np.nan,
        "answer": "rises" if low > 0 else "falls" if high < 0 else "not told",
    }


def _below(arm: Any, rows: pd.DataFrame, measure: str) -> dict[str, Any]:
    table = rows.pivot(index="seed", columns="states", values=measure).to_numpy()
    means_of_seeds = table.mean(axis=1)
    ends = np.array([_interval(column)[1:] for column in table.T])
    worst = float(np.abs(ends).max())
    beyond = (ends > _BOUND).all() or (ends < -_BOUND).all()
    return {
        **_claim(4, arm, measure, "mean over sizes", means_of_seeds),
        "agreeing": int((np.abs(means_of_seeds) < _BOUND).sum()),
        "worst": worst,
        "answer": "below 1%" if worst < _BOUND else "above 1%" if beyond else "not told",
    }


def _claim(figure: int, arm: Any, measure: str, statistic: str, by_seed: Floats) -> dict[str, Any]:
    """What is claimed of which runs, and the mean over seeds with its interval."""
    head = {"figure": figure, "comparator": arm[0], "error_rate": arm[1], "measure": measure, "statistic": statistic}
    interval = zip(("estimate", "low", "high"), _interval(by_seed), strict=True)
    return head | dict(interval) | {"runs": len(by_seed)}


def _interval(x: Floats) -> tuple[float, float, float]:
    """Mean, and the ends of the 95% t-interval; nan from one number."""
    mean, half = float(np.mean(x)), half_width(x)
    return mean, mean - half, mean + half
