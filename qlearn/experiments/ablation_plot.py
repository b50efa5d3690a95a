"""What a person looks at after an ablation: one table to print and one figure."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import StrMethodFormatter

from qlearn.experiments.label_placement import Marked, place_labels

NAMES = {
    "random": "random MDP",
    "icu": "ICU-Sepsis",
    "frozen-lake": "FrozenLake 8x8",
    "deep-sea-treasure": "deep-sea-treasure",
    "q-learning": "Q-learning",
    "ivi": "value iteration",
    "always": "always ask",
    "polytope": "polytope",
    "relaxed": "relaxed polytope",
    "posterior": "posterior",
    "posterior-close": "posterior, indifferent",
    "ensemble": "Bradley-Terry ensemble",
    "box": "Bradley-Terry box",
    "box-rescaled": "Bradley-Terry box, rescaled",
}
# Okabe and Ito's colours; the markers and line styles tell the same in grey
STYLES: dict[str, dict[str, Any]] = {
    "always": {"color": "#000000", "marker": "D", "linestyle": (0, (1, 1.5))},
    "polytope": {"color": "#D55E00", "marker": "s", "linestyle": "-"},
    "relaxed": {"color": "#E69F00", "marker": "v", "linestyle": (0, (1, 1))},
    "posterior": {"color": "#CC79A7", "marker": "P", "linestyle": (0, (8, 2))},
    "posterior-close": {"color": "#7A5195", "marker": "X", "linestyle": (0, (2, 1))},
    "ensemble": {"color": "#0072B2", "marker": "o", "linestyle": (0, (5, 1.5))},
    "box": {"color": "#009E73", "marker": "^", "linestyle": (0, (4, 1.5, 1, 1.5))},
    "box-rescaled": {"color": "#56B4E9", "marker": "v", "linestyle": (0, (1, 1))},
}

_HEADER = (
    f"{'comparator':<16}{'errors':>7}{'questions':>15}{'% asked':>8}{'excess loss %':>14}{'wrong %':>8}"
    f"{'after 1st':>10}  {'audits to conflict':<18} notes"
)
LEGEND = """\
errors       chance that the tutor answers wrongly
questions    asked, mean over the seeds ± half the width of the 95% t-interval
% asked      questions in percent of the comparisons that neither equality nor dominance settles
excess loss  true policy loss beyond that of always asking a truthful tutor, paired by seed, mean over the states, in
             percent of the value range
wrong %      verdicts against the hidden scale, in percent of those that the comparator decided from answers
after 1st    the same, after the tutor's first wrong answer
*            with audits, in runs that are shorter: their questions compare with each other only
audits to conflict   in the audited runs: audits until one first contradicted the answers, (runs in which one did
             / all), and in how many of those the audit itself was the wrong answer ("false")
notes        in how many runs the question budget was spent, or the limit of sweeps reached"""


def table(summary: pd.DataFrame, names: Mapping[str, str] | None = None) -> str:
    """The summary of ``ablation.summarise`` as text of at most 120 columns, by problem and learner; ``LEGEND``
    explains the columns. ``names`` overrides ``NAMES``."""
    shown = NAMES | dict(names or {})
    audited = summary[summary.audit > 0].set_index(["problem", "learner", "comparator", "error_rate"])
    lines = []
    for (problem, learner), part in summary[summary.audit == 0].groupby(["problem", "learner"], sort=False):
        lines += ["", f"{shown[str(problem)]}, {shown[str(learner)]}", _HEADER, "-" * len(_HEADER)]
        for row in part.itertuples():
            place = (problem, learner, row.comparator, row.error_rate)
            lines.append(_line(row.comparator, row, audited.loc[[place]].iloc[0] if place in audited.index else None))
        short = summary[(summary.audit > 0) & (summary.problem == problem) & (summary.learner == learner)]
        for row in short.itertuples():
            lines.append(_line(f"{row.comparator} *", row, row))
    return "\n".join(lines[1:])


def plot_ablation(
    summary: pd.DataFrame, *, max_queries: int | None = None, names: Mapping[str, str] | None = None
) -> Figure:
    """One panel a problem and learner: questions asked against excess policy loss, a path over the error rates
    for each comparator, with 95% t-intervals. Hollow markers: the budget was spent in at least one run. Where markers
    lie on each other the smaller is on top, and neighbours on a path share a label.

    ``summary`` is ``ablation.summarise(...)``; audited runs are not drawn. ``max_queries`` draws the budget.
    """
    shown = NAMES | dict(names or {})
    plain = summary[summary.audit == 0]
    problems, learners = plain.problem.unique(), plain.learner.unique()
    figure = Figure(figsize=(1.2 + 4.9 * len(learners), 1.7 + 3.5 * len(problems)), layout="constrained")
    grid = figure.subplots(len(problems), len(learners), squeeze=False, sharex=True, sharey=True)
    for i, problem in enumerate(problems):
        for j, learner in enumerate(learners):
            part = plain[(plain.problem == problem) & (plain.learner == learner)]
            axes = grid[i][j]
            _panel(axes, part, max_queries)
            axes.set_title(f"{shown[problem]}: {shown[learner]}", fontsize=11)
            if j == 0:
                axes.set_ylabel("excess policy loss\n(% of the value range; log scale beyond ±0.1)")
            if i == len(problems) - 1:
                axes.set_xlabel("questions asked (log scale)")
    grid[0][0].set_xlim(-1, 2 * max(10, plain.asked.max()))
    drawn = [name for name in STYLES if name in set(plain.comparator)]
    handles = [Line2D([], [], label=shown[name], markersize=7, **STYLES[name]) for name in drawn]
    if (plain.budget_spent > 0).any():
        hollow: dict[str, Any] = {"color": "0.35", "marker": "o", "markerfacecolor": "white", "linestyle": "none"}
        handles.append(Line2D([], [], label="hollow: budget spent", markersize=7, **hollow))
    columns = min(len(handles), 2 * len(learners))  # as many as the width of the panels holds
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, handlelength=3.2)
    rates = ", ".join(f"{rate:.3g}" for rate in 100 * plain.error_rate.drop_duplicates())
    title = (
        "What each comparator costs: questions to the tutor, and policy loss beyond always asking a truthful one",
        f"numbers at the markers (neighbours' together): wrong answers of the tutor in percent ({rates}); lower left "
        "is better",
    )
    width = 120 if len(learners) > 1 else 72
    figure.suptitle("\n".join(textwrap.fill(line, width) for line in title), fontsize=11 if len(learners) > 1 else 9.5)
    figure.draw_without_rendering()  # settles where everything is
    for i, problem in enumerate(problems):
        for j, learner in enumerate(learners):
            place_labels(grid[i][j], _marked(plain[(plain.problem == problem) & (plain.learner == learner)]))
    return figure


def _marked(part: pd.DataFrame) -> list[Marked]:
    """The markers of one panel, called by what they stand for."""
    return [
        Marked(
            np.stack([path.asked, 100 * path.excess_loss], axis=1),
            [f"{100 * rate:.3g}" for rate in path.error_rate],
            STYLES[str(name)]["color"],
        )
        for name, path in part.groupby("comparator", sort=False)
    ]


def _panel(axes: Axes, part: pd.DataFrame, max_queries: int | None) -> None:
    axes.axhline(0, color="0.6", linewidth=0.8, zorder=0)
    for rank, (name, path) in enumerate(part.groupby("comparator", sort=False)):
        style = STYLES[str(name)]
        x, y = path.asked, 100 * path.excess_loss
        axes.plot(x, y, color=style["color"], linestyle=style["linestyle"], linewidth=1.1, alpha=0.7, zorder=1)
        for row in path.itertuples():
            point: Any = row
            at = (point.asked, 100 * point.excess_loss)
            axes.errorbar(
                *at,
                xerr=[[min(_known(point.asked_half), at[0])], [_known(point.asked_half)]],
                yerr=_known(100 * point.excess_loss_half),
                color=style["color"],
                marker=style["marker"],
                markersize=max(5.5, 9.5 - 0.8 * rank),  # the later ones smaller, and seen on those below them
                markerfacecolor="white" if point.budget_spent else style["color"],
                markeredgecolor=style["color"] if point.budget_spent else "white",
                markeredgewidth=1.2 if point.budget_spent else 0.5,
                ecolor=(style["color"], 0.45),
                elinewidth=0.9,
                capsize=2,
                zorder=2 + 0.1 * rank,
            )
    axes.set_xscale("symlog", linthresh=10, linscale=0.5)
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.set_yscale("symlog", linthresh=0.1, linscale=0.5)
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.tick_params(labelbottom=True)
    axes.grid(True, color="0.92", linewidth=0.7)
    axes.set_axisbelow(True)
    if max_queries is not None:
        axes.axvline(max_queries, color="0.45", linestyle=(0, (2, 2)), linewidth=1, zorder=0)
        axes.annotate(
            "budget", (max_queries, 1), xycoords=("data", "axes fraction"), xytext=(3, -11),
            textcoords="offset points", fontsize=8, color="0.35",
        )  # fmt: skip


def _line(name: Any, row: Any, audited: Any) -> str:
    contradiction = ""
    if audited is not None:
        found = int(audited.contradicted)
        contradiction = f"none in {int(audited.runs)} runs"
        if found:
            false = f", {int(audited.audit_wrong)} false" if audited.audit_wrong else ""
            contradiction = f"{audited.audits_to_contradiction:.0f} ({found}/{int(audited.runs)}{false})"
    notes = [
        f"{text} {int(count)}/{int(row.runs)}"
        for count, text in ((row.budget_spent, "budget"), (row.sweep_limit, "sweeps"))
        if count
    ]
    return (
        f"{name:<16}{100 * row.error_rate:>6.3g}%{_with_half(row.asked, row.asked_half, 0):>15}"
        f"{_number(row.asked_percent_open, 2):>8}{_with_half(100 * row.excess_loss, 100 * row.excess_loss_half, 2):>14}"
        f"{_rate(row.wrong_percent):>8}{_rate(row.wrong_percent_after):>10}"
        f"  {contradiction:<18} {' '.join(notes)}"
    ).rstrip()


def _number(x: float, digits: int) -> str:
    return "" if math.isnan(x) else f"{round(x, digits) + 0.0:.{digits}f}"  # + 0.0: never -0.00


def _rate(x: float) -> str:
    return "<0.01" if 0 < x < 0.01 else _number(x, 2)  # 0.00 is for none at all


def _with_half(mean: float, half: float, digits: int) -> str:
    return _number(mean, digits) + ("" if math.isnan(half) else f" ± {half:.{digits}f}")


def _known(half: float) -> float:
    return 0.0 if math.isnan(half) else half
