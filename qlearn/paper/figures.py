"""The paper's figures 2, 3 and 4, from the table of ``qlearn.paper.claims``."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.markers import CARETDOWN
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from elicit.catalogue import STYLES
from qlearn.experiments.catalogue import NAMES
from qlearn.experiments.settings import TRUTHFUL, TUTORS

_X = {"levels": "number of levels k", "states": "number of states |S|"}
_ASKED = {
    "asked_percent_all": "of all comparisons",
    "asked_percent_open": "of those that dominance leaves open",
    "asked_percent_fresh": "of the open ones not asked before",
}
_LOSSES = {
    "paper_loss_percent": (
        "figure 4's formula, signed as printed",
        "estimated v less the oracle's\n(% of max r)",
    ),
    "paper_abs_percent": ("the same, |v(s) - V(s)|", "distance from the oracle's v\n(% of max r)"),
    "excess_loss_percent": ("true policy loss", "loss beyond the oracle's\n(% of the value range)"),
}


def plot_asked(
    summary: pd.DataFrame,
    series: str,
    tutors: Sequence[str] | None = None,
    measures: Sequence[str] = tuple(_ASKED),
) -> Figure:
    """Draw the paper's figure 2 (``series`` "levels") or 3 ("states").

    It shows questions in percent of three denominators, on a log scale, with 95% t-intervals over
    the runs. An arrow at the lower end of the axis marks an interval that reaches further down. The
    fourth denominator, the unequal pairs, is nearly the same as all comparisons, and is left out.

    Parameters
    ----------
    summary : pandas.DataFrame
        The means of ``claims.summarise_series``.
    series : {"levels", "states"}
        The series to draw.
    tutors : sequence of str, optional
        The tutors to draw, at most two for all to be seen. Default: the one who never errs, and the
        last, who errs most.
    measures : sequence of str
        Columns of the summary, with a panel for each. Default: the three denominators.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    rows, figure, panels = _panels(
        summary, series, [_ASKED[one] for one in measures], tutors, sharey=True
    )
    means = rows[list(measures)].to_numpy(dtype=float)
    least = (
        float(means[means > 0].min()) / 2 if (means > 0).any() else 1.0
    )  # a log axis has no 0: it ends here
    cut = [
        _lines(axes, rows, measure, least, arrows=True)
        for axes, measure in zip(panels, measures, strict=True)
    ]
    for axes in panels:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_ylim(bottom=least)
    arrows = "\narrows: further down, or 0" if any(cut) else ""
    panels[0].set_ylabel(f"questions to the tutor (%, log scale){arrows}")
    number = {"levels": 2, "states": 3}[series]
    _title(figure, f"Figure {number}: how often the tutor is asked, by {_X[series]}", rows)
    return figure


def plot_loss(
    summary: pd.DataFrame,
    series: str = "states",
    tutors: Sequence[str] | None = None,
    measures: Sequence[str] = tuple(_LOSSES),
) -> Figure:
    """Draw the paper's figure 4, its percentage of loss, next to losses that it does not show.

    The percentage ignores which action the learner chose (``metrics.paper_loss``). Lines mark 1%,
    the paper's bound.

    Parameters
    ----------
    summary : pandas.DataFrame
        The means of ``claims.summarise_series``.
    series : {"levels", "states"}
        The series to draw. Default: "states".
    tutors : sequence of str, optional
        The tutors to draw, as for ``plot_asked``.
    measures : sequence of str
        Columns of the summary, with a panel for each. Default: the paper's formula, the same with
        absolute values, and the true policy loss.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    rows, figure, panels = _panels(
        summary, series, [_LOSSES[one][0] for one in measures], tutors, sharey=False
    )
    for axes, measure in zip(panels, measures, strict=True):
        axes.axhline(0, color="0.5", linewidth=0.8, zorder=0)
        for bound in (1,) if measure == "paper_abs_percent" else (-1, 1):
            axes.axhline(bound, color="0.35", linewidth=0.9, linestyle=(0, (1, 2)), zorder=0)
        axes.annotate(
            "1%", (0.995, 1), xycoords=("axes fraction", "data"), xytext=(0, -2),
            textcoords="offset points",
            fontsize=8, color="0.35", horizontalalignment="right", verticalalignment="top",
        )  # fmt: skip
        _lines(axes, rows, measure, 0.0 if measure == "paper_abs_percent" else -math.inf)
        axes.set_yscale("symlog", linthresh=1, linscale=0.8)
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.set_ylabel(_LOSSES[measure][1])
    title = (
        f"Figure 4: loss against always asking a truthful tutor, by {_X[series]} (log scale beyond "
        "±1%)"
    )
    _title(figure, title, rows)
    return figure


def save(figure: Figure, folder: Path, name: str) -> None:
    """Write ``name``.png and ``name``.svg to a folder, the same bytes for the same figure."""
    figure.savefig(folder / f"{name}.png", dpi=150, metadata={"Software": None})
    with mpl.rc_context({"svg.hashsalt": "qlearn"}):
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})


def _panels(
    summary: pd.DataFrame,
    series: str,
    titles: Sequence[str],
    tutors: Sequence[str] | None,
    sharey: bool,
) -> tuple[pd.DataFrame, Figure, Sequence[Axes]]:
    """Return the rows of a series with these tutors, and an empty panel for each title.

    The oracle's rows are left out.
    """
    rows = summary[(summary.series == series) & (summary.comparator != "always")]
    shown = tutors or (TRUTHFUL, max(rows.errs, key=TUTORS.index))
    rows = rows[rows.errs.isin(shown)]
    figure = Figure(
        figsize=(4.1 * max(2, len(titles)), 4.3 if len(titles) > 1 else 5.2), layout="constrained"
    )
    panels = figure.subplots(1, len(titles), sharex=True, sharey=sharey, squeeze=False)[0]
    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title, fontsize=10)
        axes.set_xlabel(_X[series])
        axes.grid(True, which="major", color="0.92", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.set_xticks(sorted(rows.x.unique()))
        axes.tick_params(labelleft=True)
        axes.margins(x=0.09)
    return rows, figure, panels


def _lines(
    axes: Axes, rows: pd.DataFrame, measure: str, least: float, arrows: bool = False
) -> bool:
    """Draw a line with error bars for each pair of comparator and tutor.

    The markers are hollow if the tutor never errs. Error bars are cut off at ``least``, and marked
    there if ``arrows`` is true. Return whether any was cut off.
    """
    cut = False
    arms: list[Any] = list(rows.groupby(["comparator", "errs"], sort=False))
    span = (rows.x.max() - rows.x.min()) or 1
    for i, ((comparator, errs), arm) in enumerate(arms):
        style = STYLES[comparator]
        aside = (
            0.012 * span * (i - (len(arms) - 1) / 2)
        )  # intervals beside each other, not on each other
        half, mean = arm[f"{measure}_half"].fillna(0), arm[measure].clip(lower=least)
        below = arm[measure] - half < least
        cut = cut or bool(below.any())
        if arrows and below.any():
            axes.plot(
                arm.x[below] + aside,
                np.full(int(below.sum()), least),
                **style | {"marker": CARETDOWN, "linestyle": "none"},
                markersize=8,
                clip_on=False,
                zorder=3,
            )
        axes.errorbar(
            arm.x + aside,
            mean,
            yerr=[half.clip(upper=mean - least), half],
            **style,
            markerfacecolor="white" if errs == TRUTHFUL else style["color"],
            markersize=7,
            linewidth=1.3,
            elinewidth=1,
            capsize=3,
            label=f"{NAMES[comparator]}, "
            + ("truthful tutor" if errs == TRUTHFUL else f"tutor errs ({errs})"),
        )
    return cut


def _title(figure: Figure, title: str, rows: pd.DataFrame) -> None:
    runs = rows.runs.unique()
    count = f"{runs[0]}" if len(runs) == 1 else f"{runs.min()} to {runs.max()}"
    wide = len(figure.axes) > 2
    about = (
        f"mean of {count} runs with 95% intervals; hollow markers: the tutor never errs; otherwise "
        "errors are those of eq. "
        "(6), most where it is close"
    )
    figure.suptitle(
        "\n".join(textwrap.fill(text, 140 if wide else 88) for text in (title, about)), fontsize=11
    )
    handles, labels = figure.axes[0].get_legend_handles_labels()
    columns = math.ceil(
        len(labels) / math.ceil(len(labels) / (3 if wide else 2))
    )  # in rows of about equal length
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, frameon=False, handlelength=3.4
    )
