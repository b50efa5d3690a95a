"""The table and the figure of an ablation."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import StrMethodFormatter

from elicit.catalogue import STYLES, styles
from qlearn.experiments.catalogue import NAMES
from qlearn.experiments.settings import ORDER

_BUDGET: dict[str, Any] = {"color": "0.45", "linestyle": (0, (2, 2)), "linewidth": 1}
_INCHES_A_CHARACTER = 0.075  # of a legend's text, of the default font and size
_INCHES_A_HANDLE = 0.75  # of its handle and the space between two columns
_UNASKED: dict[str, Any] = {"color": "0.6", "linestyle": "-", "linewidth": 2.2}
_NONE = "none"  # the row of the table for the policy of equal gaps, which asks nothing
_LINES, _INCHES_A_LINE = (
    5,
    0.21,
)  # lines of a legend that the figure's height allows for; the height of one more
_ASKED = "questions asked"
_LOST = "policy loss, %"
_LOG_ASKED = "\n(log scale)"
_LOG_LOST = "\n(log scale beyond 0.1)"
LEGEND = """\
none         nobody is asked: the policy that is best if the steps between neighbouring levels are equal
errors       chance that the tutor answers wrongly, or the name of a tutor of yours
seeds        over which the means of the row are taken; "3 of 8": the rest had not finished
questions    asked, mean over the seeds ± half the width of the 95% t-interval
% asked      questions in percent of the comparisons that neither equality nor dominance decides
loss         true policy loss against the optimal policy under the hidden values, for each learner alike: mean over the
             states, in percent of the value range
wrong %      verdicts against the hidden scale, in percent of those that the comparator decided from answers
after 1st    the same, after the tutor's first wrong answer
*            with audits, in runs that are shorter: their questions compare with each other only
audits to conflict   in the audited runs: audits until one first contradicted the answers, (runs in which one did
             / all), and in how many of those the audit itself was the wrong answer ("false")
notes        with how many seeds the question budget was spent, or the limit of sweeps reached"""  # noqa: E501


def table(
    summary: pd.DataFrame, names: Mapping[str, str] | None = None, seeds: int | None = None
) -> str:
    """Return the summary of ``ablation.summarise`` as text, by problem and learner.

    Parameters
    ----------
    summary : pandas.DataFrame
        The means of ``ablation.summarise``.
    names : mapping of str to str, optional
        Labels of problems, learners and comparators, in place of those of ``NAMES``.
    seeds : int, optional
        The number of seeds that each row should have. Rows with fewer say so.

    Returns
    -------
    str
        The tables. They are at most 120 columns wide, if names of your own are short. ``LEGEND``
        explains the columns.

    Raises
    ------
    TypeError
        If ``summary`` is no such table, such as the rows of single runs.
    """
    _check_summary("table", summary)
    parts = []
    for (problem, learner), part in summary.groupby(["problem", "learner"], sort=False):
        conflicts = {
            (row.comparator, row.error_rate): _conflict(row)
            for row in part[part.audit > 0].itertuples()
        }
        cells = [
            _cells(row, conflicts.get((row.comparator, row.error_rate), ""), seeds)
            for row in part.sort_values("audit", kind="stable").itertuples()
        ]
        cells = [*_unasked_cells(part, seeds), *cells]
        text = pd.DataFrame(cells).set_index("comparator").rename_axis(None).to_string()
        parts.append(
            f"{_called(names, 'problem', str(problem))}, "
            f"{_called(names, 'learner', str(learner))}\n{text}"
        )
    return "\n\n".join(parts)


def plot_ablation(
    summary: pd.DataFrame,
    *,
    max_queries: int | None = None,
    names: Mapping[str, str] | None = None,
    seeds: int | None = None,
    linear: bool = False,
) -> Figure:
    """Draw questions and true policy loss for each problem and learner.

    There are two panels, one above the other. The loss is against the optimal policy under the
    hidden values, by the tutor's error rate. A line joins the error rates of a comparator. Your own
    tutors are drawn next to the error rates, by name, without a line. 95% t-intervals are drawn if
    there are three seeds or more: those of two seeds would hide everything else. Hollow markers
    mean that the budget was spent in at least one run. A grey horizontal line is the loss without
    any question.

    Parameters
    ----------
    summary : pandas.DataFrame
        The means of ``ablation.summarise``. Audited runs are not drawn.
    max_queries : int, optional
        The budget of questions, which is drawn as a line. None: no line.
    names : mapping of str to str, optional
        Labels of problems, learners and comparators, in place of those of ``NAMES``.
    seeds : int, optional
        The number of runs that each point should have. If points have fewer, the title says so.
    linear : bool
        If False, both axes of values are logarithmic beyond a small value. Default: False.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    TypeError
        If ``summary`` is no such table, such as the rows of single runs.
    """
    _check_summary("plot_ablation", summary)
    called = partial(_called, names)
    plain = summary[summary.audit == 0]
    problems, learners = plain.problem.unique(), plain.learner.unique()
    figure = Figure(
        figsize=(1.4 + 4.9 * len(learners), 1.6 + 4.6 * len(problems)), layout="constrained"
    )
    grid = figure.subplots(
        2 * len(problems), len(learners), squeeze=False, sharex=True, sharey="row"
    )
    looks, tutors = styles(plain.comparator), _tutors(plain)
    for i, problem in enumerate(problems):
        for j, learner in enumerate(learners):
            asked, lost = grid[2 * i][j], grid[2 * i + 1][j]
            part = plain[(plain.problem == problem) & (plain.learner == learner)]
            _paths(asked, part, part.asked, part.asked_half, looks, tutors)
            _paths(lost, part, 100 * part.loss, 100 * part.loss_half, looks, tutors)
            unasked = _unasked_row(part)
            if unasked is not None:
                lost.axhline(100 * unasked.loss_unasked, zorder=1, **_UNASKED)
            _scales(asked, lost, max_queries, linear)
            most = _highest(plain[plain.problem == problem])
            if linear:
                asked.set_ylim(0, 1.08 * max(10, _most_asked(plain), max_queries or 0))
                lost.set_ylim(0, 108 * max(0.001, most))
            else:
                asked.set_ylim(0, 3 * max(10, plain.asked.max()))
                lost.set_ylim(0, 200 * max(0.001, most))
            asked.set_title(
                f"{called('problem', problem)}: {called('learner', learner)}", fontsize=11
            )
            if j == 0:
                asked.set_ylabel(_ASKED + ("" if linear else _LOG_ASKED))
                lost.set_ylabel(_LOST + ("" if linear else _LOG_LOST))
            own = any(isinstance(tutor, str) for tutor in tutors)
            lost.set_xlabel("the tutor's wrong answers (%)" + (", or your tutor" if own else ""))
            lost.set_xticks(
                range(len(tutors)), [t if isinstance(t, str) else f"{100 * t:.3g}" for t in tutors]
            )
    drawn = sorted(looks, key=lambda name: [*STYLES].index(name) if name in STYLES else len(STYLES))
    handles = [
        Line2D([], [], label=called("comparator", name), markersize=7, **looks[name])
        for name in drawn
    ]
    if max_queries is not None:
        handles.append(Line2D([], [], label="budget", **_BUDGET))
    if "loss_unasked" in plain:
        label = "asked nothing (equal gaps)"
        handles.append(Line2D([], [], label=label, **_UNASKED))
    if (plain.budget_spent > 0).any():
        hollow: dict[str, Any] = {
            "color": "0.35",
            "marker": "o",
            "markerfacecolor": "white",
            "linestyle": "none",
        }
        handles.append(Line2D([], [], label="hollow: budget spent", markersize=7, **hollow))
    longest = max(len(str(handle.get_label())) for handle in handles)
    columns = max(
        1,
        min(
            len(handles),
            int(figure.get_figwidth() / (_INCHES_A_CHARACTER * longest + _INCHES_A_HANDLE)),
        ),
    )
    more_lines = math.ceil(len(handles) / columns) - _LINES
    figure.set_figheight(figure.get_figheight() + max(0, more_lines) * _INCHES_A_LINE)
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, frameon=False, handlelength=3.2
    )
    title = (
        "What each comparator costs: questions to the tutor, and true policy loss under the hidden "
        "values (share of the value range); lower is better"
    )
    many = len(learners) > 1
    lines = [textwrap.fill(title, 50 * len(learners) if many else 64), _means_of(plain.runs, seeds)]
    figure.suptitle("\n".join(lines), fontsize=11 if many else 9.5)
    return figure


def _check_summary(taker: str, summary: object) -> None:
    """Raise TypeError unless this is a table of ``ablation.summarise``."""
    if isinstance(summary, pd.DataFrame) and {"runs", "asked_half"} <= {*summary.columns}:
        return
    if isinstance(summary, pd.DataFrame) and {"asked", "seed"} <= {*summary.columns}:
        found = "these are the rows of single runs"
    else:
        found = f"this is {type(summary).__name__}"
    raise TypeError(
        f"{taker} takes the means that ablation.summarise makes, but {found}: write "
        f"{taker}(ablation.summarise(rows))"
    )


def _highest(rows: pd.DataFrame) -> float:
    """Return the greatest loss in the picture, as a share of the value range.

    It is a mean, an end of an interval, or the loss without any question.
    """
    half = rows.loss_half.where(rows.runs > 2).fillna(0.0)
    highest = float((rows.loss + half).max())
    return max(highest, float(rows.loss_unasked.max())) if "loss_unasked" in rows else highest


def _most_asked(rows: pd.DataFrame) -> float:
    """Return the greatest number of questions in the picture: a mean, or an end of an interval."""
    return float((rows.asked + rows.asked_half.where(rows.runs > 2).fillna(0.0)).max())


def _called(names: Mapping[str, str] | None, column: str, name: str) -> str:
    """Return the label of a problem, learner or comparator. The user's own have their names."""
    return (names or {}).get(name, NAMES[name] if name in ORDER[column] else name)


def _tutors(summary: pd.DataFrame) -> list[float | str]:
    """Return the error rates in the summary, and after them the user's tutors by name."""
    told = list(dict.fromkeys(summary.error_rate))
    return [
        *sorted(rate for rate in told if not isinstance(rate, str)),
        *(name for name in told if isinstance(name, str)),
    ]


def _means_of(runs: pd.Series, seeds: int | None) -> str:
    """Return the number of seeds behind the means, in words."""
    least, most = int(runs.min()), int(runs.max())
    if seeds is not None and least < seeds:
        return f"INCOMPLETE: of {seeds} seeds some means have {least} only"
    number = f"{most}" if least == most else f"{least} to {most}"
    seeds_in_words = "one seed" if most == 1 else f"{number} seeds"
    return f"means over {seeds_in_words}" + (
        ", with 95% intervals" if most > 2 else ": too few for intervals"
    )


def _paths(
    axes: Axes,
    part: pd.DataFrame,
    mean: pd.Series,
    half: pd.Series,
    looks: Mapping[str, Mapping[str, Any]],
    tutors: list[float | str],
) -> None:
    """Draw the means of each comparator, with a line through those of the error rates only.

    Intervals are drawn side by side, and none reaches below 0.
    """
    for place, name in enumerate(looks):  # the same place in every panel
        if not (part.comparator == name).any():
            continue
        style, own = looks[name], part.comparator == name
        x = part.error_rate[own].map(tutors.index) + 0.6 * ((place + 0.5) / len(looks) - 0.5)
        y, wide = mean[own], half[own].where(part.runs[own] > 2).fillna(0.0)
        hollow = (part.budget_spent[own] > 0).to_numpy()
        is_rate = part.error_rate[own].map(lambda tutor: not isinstance(tutor, str)).to_numpy()
        for chosen, line in (
            (is_rate, style["linestyle"]),
            (~is_rate, "none"),
        ):  # a name is a category: no line
            if chosen.any():
                axes.errorbar(
                    x[chosen],
                    y[chosen],
                    [np.minimum(wide, y)[chosen], wide[chosen]],
                    color=style["color"],
                    linestyle=line,
                    linewidth=1.0,
                    ecolor=(style["color"], 0.6),
                    elinewidth=1.1,
                    capsize=2.5,
                )
        for chosen, face in ((~hollow, style["color"]), (hollow, "white")):
            look = {
                "color": style["color"],
                "marker": style["marker"],
                "markerfacecolor": face,
                "markersize": 6.5,
            }
            for line in axes.plot(
                x[chosen], y[chosen], linestyle="none", **look, zorder=3, clip_on=False
            ):
                line.set_in_layout(
                    False
                )  # not clipped, because 0 lies on the edge, and so taking room


def _scales(asked: Axes, lost: Axes, max_queries: int | None, linear: bool) -> None:
    """Set both axes to log scales that are linear near 0, unless linear, and draw the budget."""
    if not linear:
        asked.set_yscale("symlog", linthresh=10, linscale=0.5)
        lost.set_yscale("symlog", linthresh=0.1, linscale=0.5)
    asked.yaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    lost.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    lost.tick_params(labelbottom=True)
    for axes in (asked, lost):
        axes.grid(True, axis="y", color="0.92", linewidth=0.7)
        axes.set_axisbelow(True)
    if max_queries is not None:
        asked.axhline(max_queries, zorder=0, **_BUDGET)


def _unasked_row(part: pd.DataFrame) -> Any:
    """Return the row whose loss without any question is shown; None if it is unknown.

    This loss is the same for every comparator of a problem if no seeds are missing. So the row with
    most seeds is taken.
    """
    if "loss_unasked" not in part or not part.loss_unasked.notna().any():
        return None
    known = part[part.loss_unasked.notna()]
    return known.iloc[int(np.argmax(known.runs))]


def _unasked_cells(part: pd.DataFrame, seeds: int | None) -> list[dict[str, str]]:
    """Return the table's line for the loss without any question, if the summary has it."""
    row = _unasked_row(part)
    if row is None:
        return []
    return [
        {
            "comparator": _NONE,
            "errors": "",
            "seeds": _seeds(row.runs, seeds),
            "questions": "0",
            "% asked": "",
            "loss %": _with_half(100 * row.loss_unasked, 100 * row.loss_unasked_half, 2),
            "wrong %": "",
            "after 1st": "",
            "audits to conflict": "",
            "notes": "",
        }
    ]


def _seeds(runs: Any, seeds: int | None) -> str:
    return f"{int(runs)}" if seeds in (None, runs) else f"{int(runs)} of {seeds}"


def _cells(row: Any, conflict: str, seeds: int | None) -> dict[str, str]:
    """Return a row of the summary as a line of the table."""
    tutor = row.error_rate if isinstance(row.error_rate, str) else f"{100 * row.error_rate:.3g}%"
    notes = ((row.budget_spent, "budget"), (row.sweep_limit, "sweeps"))
    return {
        "comparator": f"{row.comparator} *" if row.audit else row.comparator,
        "errors": tutor,
        "seeds": _seeds(row.runs, seeds),
        "questions": _with_half(row.asked, row.asked_half, 0),
        "% asked": _number(row.asked_percent_open, 2),
        "loss %": _with_half(100 * row.loss, 100 * row.loss_half, 2),
        "wrong %": _rate(row.wrong_percent),
        "after 1st": _rate(row.wrong_percent_after),
        "audits to conflict": conflict,
        "notes": " ".join(f"{text} {int(count)}" for count, text in notes if count),
    }


def _conflict(row: Any) -> str:
    """Return the outcome of a row's audits, in words."""
    if not row.contradicted:
        return "none"
    false = f", {int(row.audit_wrong)} false" if row.audit_wrong else ""
    return f"{row.audits_to_contradiction:.0f} ({int(row.contradicted)}/{int(row.runs)}{false})"


def _number(x: float, digits: int) -> str:
    return "" if math.isnan(x) else f"{round(x, digits) + 0.0:.{digits}f}"  # + 0.0: never -0.00


def _rate(x: float) -> str:
    return "<0.01" if 0 < x < 0.01 else _number(x, 2)  # 0.00 is for none at all


def _with_half(mean: float, half: float, digits: int) -> str:
    return _number(mean, digits) + ("" if math.isnan(half) else f" ± {half:.{digits}f}")
