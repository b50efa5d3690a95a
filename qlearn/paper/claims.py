"""The paper's claims, tested on the rows of ``figures``, with intervals over runs.

Each claim is tested for every comparator and tutor.

The formula of figure 4 has a flaw: it takes the best action by the true scale, and so ignores which
action the learner chose (``qlearn.experiments.metrics.paper_loss``). The true policy loss stands
beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd

from elicit.model.scale import Floats
from qlearn.experiments.metrics import half_width, means
from qlearn.experiments.settings import ORDER, TUTORS

DENOMINATORS = ("all", "unequal", "open", "fresh")
LOSSES = ("paper_loss_percent", "paper_abs_percent", "excess_loss_percent")
MEASURES = (
    "asked",
    *(f"asked_percent_{name}" for name in DENOMINATORS),
    *LOSSES,
    "loss_percent",
    "error_rate",
    "realised_error_rate",
)
HOLDS, FAILS, OPEN = "holds", "does not hold", "inconclusive"
_ASKED = {
    "of all comparisons": "asked_percent_all",
    "of those dominance leaves open": "asked_percent_open",
}
READINGS = {
    2: _ASKED,
    3: _ASKED,
    4: {"the formula": "paper_loss_percent", "true policy loss": "excess_loss_percent"},
}
"""The measures that answer each figure's claim. The paper counts "all queries (tutor
or model)": whether those that dominance decides are among them depends on where its section 2.2
eliminates dominated vectors, which its Algorithm 2 does not say."""
_ARM = ["comparator", "errs"]
_STEP = {
    "levels": 5,
    "states": 100,
}  # slopes are told for this much more, the step of the paper's series
_BOUND = 1.0  # percent: "the average percentage of loss is lower than 1%"


def series_of(frame: pd.DataFrame, name: str) -> pd.DataFrame:
    """Return the rows of the series in which ``name`` varies, "levels" or "states".

    Parameters
    ----------
    frame : pandas.DataFrame
        The rows of ``figure_runs.figures``.
    name : {"levels", "states"}
        The number that varies. The other one is fixed at its commonest value.

    Returns
    -------
    pandas.DataFrame
        The rows of the series, by comparator, tutor, size and seed. The columns
        ``excess_loss_percent`` and ``loss_percent`` are added.
    """
    other = "states" if name == "levels" else "levels"
    points = frame[["states", "levels"]].drop_duplicates()
    fixed = points.groupby(other, sort=True)[name].nunique().idxmax()
    rows = frame[frame[other] == fixed]
    rows = rows.assign(excess_loss_percent=100 * rows.excess_loss, loss_percent=100 * rows.loss)
    places = {
        "place": rows.comparator.map(ORDER["comparator"].index),
        "tutor": rows.errs.map(TUTORS.index),
    }
    return rows.assign(**places).sort_values([*places, name, "seed"]).drop(columns=[*places])


def summarise_series(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each point of a series and each comparator: means over runs.

    Parameters
    ----------
    frame : pandas.DataFrame
        The rows of ``figure_runs.figures``.

    Returns
    -------
    pandas.DataFrame
        ``series`` is "levels" or "states", and ``x`` the size. For each of ``MEASURES`` there is
        its mean, and ``<name>_half``, half the width of its 95% t-interval (nan from a single run).
    """
    parts = []
    for name in ("levels", "states"):
        rows = series_of(frame, name)
        groups = rows.groupby([name, *_ARM], sort=False)
        table = groups.size().rename("runs").to_frame().join(means(groups, MEASURES)).reset_index()
        parts.append(table.rename(columns={name: "x"}).assign(series=name))
    whole: pd.DataFrame = pd.concat(parts, ignore_index=True)
    return whole[["series", "x", *(name for name in whole.columns if name not in ("series", "x"))]]


def claims(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the paper's claims: a row for every comparator and way of measuring.

    The oracle is left out, because it has nothing to be compared with.

    Parameters
    ----------
    frame : pandas.DataFrame
        The rows of ``figure_runs.figures``.

    Returns
    -------
    pandas.DataFrame
        The rows, each with its estimate, the ends ``low`` and ``high`` of a 95% t-interval over
        seeds, and the answer. A number that is not defined, as with one seed or one point, is nan.

    Notes
    -----
    Figures 2 and 3 claim that the percentage asked rises. ``estimate`` is the mean over seeds of
    its least squares slope, in percentage points for 5 more levels, or 100 more states.
    ``agreeing`` counts the seeds whose own slope has the same sign. ``answer`` is "holds" if the
    interval lies above 0, "does not hold" if below, else "inconclusive".

    Figure 4 claims that the loss is below 1%. Its formula ignores which action the learner chose
    (``paper_loss``); the excess loss does not. ``estimate`` is the mean loss over all sizes of a
    seed, in percent. ``worst`` is the greatest distance from zero of an end of the interval at one
    size. ``answer`` is "holds" if ``worst`` is below 1, "does not hold" if the interval of some
    size lies beyond 1% on one side, else "inconclusive".
    """
    found: list[dict[str, Any]] = []
    for figure, name in ((2, "levels"), (3, "states")):
        for arm, rows in series_of(frame, name).groupby(_ARM, sort=False):
            if arm[0] != "always":
                found += [
                    _trend(figure, name, arm, rows, f"asked_percent_{each}")
                    for each in DENOMINATORS
                ]
    for arm, rows in series_of(frame, "states").groupby(_ARM, sort=False):
        if arm[0] != "always":
            found += [_below(arm, rows, measure) for measure in LOSSES]
    return pd.DataFrame(found)


def answers(told: pd.DataFrame, figure: int, measure: str) -> dict[str, dict[str, Any]]:
    """Return the rows of ``claims`` of a figure and a measure, by comparator and tutor.

    Parameters
    ----------
    told : pandas.DataFrame
        The table of ``claims``.
    figure : {2, 3, 4}
        The number of the paper's figure.
    measure : str
        The measure's name in the table, such as one that ``READINGS`` has for the figure.

    Returns
    -------
    dict of str to dict
        For each comparator a dict from the tutor's name to the row.
    """
    rows = told[(told.figure == figure) & (told.measure == measure)]
    return {
        str(name): {str(row.errs): row for row in some.itertuples()}
        for name, some in rows.groupby(_ARM[0], sort=False)
    }


def tutors_of(told: pd.DataFrame) -> list[str]:
    """Return the tutors in a table of ``claims``, the most precise first.

    Parameters
    ----------
    told : pandas.DataFrame
        The table of ``claims``.

    Returns
    -------
    list of str
        The tutors' names, such as "truthful" and "2%".
    """
    return [name for name in TUTORS if (told.errs == name).any()]


def sizes_of(frame: pd.DataFrame, figure: int, names: Mapping[str, str] | None = None) -> str:
    """Return, in words, the sizes in a figure and its number of runs for each point.

    Parameters
    ----------
    frame : pandas.DataFrame
        The rows of ``figure_runs.figures``.
    figure : {2, 3, 4}
        The number of the paper's figure.
    names : mapping of str to str, optional
        Names of comparators other than the usual ones.

    Returns
    -------
    str
        The sizes. The text also says which comparators with which tutors have fewer sizes.
    """
    axis = "levels" if figure == 2 else "states"
    rows = series_of(frame, axis)
    ends = ((rows[name].min(), rows[name].max(), name) for name in ("states", "levels"))
    sizes = [
        f"{least} to {most} {name}" if least < most else f"{least} {name}"
        for least, most, name in ends
    ]
    fewer: dict[str, dict[str, list[str]]] = {}
    for (name, tutor), some in rows.groupby(_ARM, sort=False):
        if some[axis].nunique() < rows[axis].nunique():
            places = ", ".join(map(str, sorted(some[axis].unique())))
            fewer.setdefault(places, {}).setdefault(
                (names or {}).get(str(name), str(name)), []
            ).append(str(tutor))
    thin = [f"at {places} {axis} only: {listed(arms)}" for places, arms in fewer.items()]
    return "; ".join([f"{', '.join(sizes)}, {rows.seed.nunique()} runs a point", *thin])


def listed(arms: Mapping[str, Sequence[str]]) -> str:
    """Return the comparators with their tutors, in words.

    Parameters
    ----------
    arms : mapping of str to sequence of str
        The tutors of each comparator.

    Returns
    -------
    str
        A text such as "box (2%, 10%)".
    """
    return ", ".join(f"{name} ({', '.join(tutors)})" for name, tutors in arms.items())


def error_rates(frame: pd.DataFrame) -> pd.DataFrame:
    """Return tutors' error rates in percent: a row for each comparator and erring tutor.

    Column ``reference`` is the expected share of wrong answers to the comparisons of an optimal
    policy that dominance does not decide. Column ``realised`` is the share of wrong answers that
    were given. Both are means over runs and sizes. ``_low`` and ``_high`` are the least and the
    greatest mean at a single size.
    """
    rows = frame[frame.error_rate > 0]
    parts = [("reference", "error_rate"), ("realised", "realised_error_rate")]
    of_sizes = (
        rows.groupby([*_ARM, "states", "levels"], sort=False)[
            [column for _, column in parts]
        ].mean()
        * 100
    )
    table = pd.DataFrame(index=of_sizes.groupby(_ARM, sort=False).size().index)
    for name, column in parts:
        found = of_sizes[column].groupby(_ARM, sort=False)
        table[name], table[f"{name}_low"], table[f"{name}_high"] = (
            found.mean(),
            found.min(),
            found.max(),
        )
    return table.reset_index()


_PAGE = """\
# The claims of figures 2, 3 and 4

{runs} runs a point, {steps:,} steps each; 95% t-intervals over the runs. Written by `qlearn figures`.

{sizes}

The paper does not say how precise its tutor was. Here it never errs (truthful), or errs as in eq. (6): with c = 1
where vectors are discounted counts and values those of 0..99 (c=1), or with a precision that makes it err in a
given share of the comparisons of an optimal policy that dominance leaves open (the reference). What is asked is
what is close, so that far more of the *answers given* are wrong:

"""  # noqa: E501
_SAID = """
## Each claim at each precision

- figures 2 and 3: the percentage asked rises with the levels, with the states. "Holds" where the interval of the
  slope lies above 0, "does not hold" where it lies below, "inconclusive" where it has 0 inside. The paper counts "all
  queries (tutor or model)". Its section 2.2 eliminates dominated vectors, its Algorithm 2 does not say where: if
  first, queries are the comparisons that dominance leaves open; if not at all, they are all comparisons.
- figure 4: the loss is lower than 1%. The formula is v - V, the values learned with the model less those without it,
  so that what the model loses is negative: "holds" where the interval of every size lies within 1% of zero, "does
  not hold" where that of some size lies wholly beyond, else "inconclusive". The true policy loss, beyond that of
  Q-learning which always asks, is held to the same 1%, of the value range.

"""  # noqa: E501
_ALL = """
## With intervals, by every denominator and every loss

Figure 2: slope of the percentage asked, in percentage points for 5 levels more; figure 3: for 100 states more;
figure 4: percent, mean over the sizes. In brackets: how many runs' own slopes have the sign of the mean; of
figure 4 the farthest end of the interval at one size. "Paper loss" is its formula, "paper abs" the same with
|v(s) - V(s)|, "excess loss" the true policy loss beyond the oracle's.

"""  # noqa: E501
_ANSWERED = ("comparator", "tutor", "wrong in the reference", "wrong in the answers given, by size")
_HEAD = ("figure", "comparator", "tutor", "measured", "estimate", "95% interval", "answer")


def claims_page(frame: pd.DataFrame) -> str:
    """Return the claims of these runs as a page of Markdown.

    Its lines have at most 140 columns, so that it can be read as text too.
    """
    told = claims(frame)
    tutors = tutors_of(told)
    verdicts = [
        (
            str(figure),
            measured,
            name,
            *(str(rows[tutor].answer) if tutor in rows else "" for tutor in tutors),
        )
        for figure, readings in READINGS.items()
        for measured, measure in readings.items()
        for name, rows in answers(told, figure, measure).items()
    ]
    answered = [
        (
            str(row.comparator),
            str(row.errs),
            f"{row.reference:.1f}%",
            ""  # where nothing was asked
            if _undefined(row.realised)
            else f"{row.realised:.1f}% ({row.realised_low:.1f} to {row.realised_high:.1f})",
        )
        for row in error_rates(frame).itertuples()
    ]
    sizes = "\n".join(
        fill(f"- Figure{n}: {sizes_of(frame, int(n[-1]))}.", 118, subsequent_indent="  ")
        for n in (" 2", "s 3 and 4")
    )
    page = _PAGE.format(runs=frame.seed.nunique(), steps=frame.rounds.max(), sizes=sizes)
    page += (
        _table(_ANSWERED, answered)
        + _SAID
        + _table(("figure", "measured", "comparator", *tutors), verdicts)
    )
    return page + _ALL + _table(_HEAD, [_cells(row) for row in told.itertuples()])


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    table = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    table.insert(1, ["-" * width for width in widths])
    lines = (
        " | ".join(f"{cell:<{n}}" for cell, n in zip(cells, widths, strict=True)) for cells in table
    )
    return "".join(f"| {line} |\n" for line in lines)


def _cells(row: Any) -> tuple[str, ...]:
    """Return a claim as a line of the page's last table.

    What is not defined (with a single run, say) is empty.
    """
    measure = (
        str(row.measure)
        .replace("asked_percent_", "% asked of ")
        .removesuffix("_percent")
        .replace("_", " ")
    )
    note = f"worst {row.worst:.2f}" if row.figure == 4 else f"{row.agreeing} of {row.runs}"
    interval = "" if _undefined(row.low) else f"{row.low:+.3f} to {row.high:+.3f}"
    mean = "" if _undefined(row.estimate) else f"{row.estimate:+.3f}"
    answer = str(row.answer) if not interval else f"{row.answer} ({note})"
    return str(row.figure), str(row.comparator), str(row.errs), measure, mean, interval, answer


def _undefined(x: Any) -> bool:
    return bool(np.isnan(x))


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
        "answer": HOLDS if low > 0 else FAILS if high < 0 else OPEN,
    }


def _below(arm: Any, rows: pd.DataFrame, measure: str) -> dict[str, Any]:
    table = rows.pivot(index="seed", columns="states", values=measure).to_numpy()
    means_of_seeds = table.mean(axis=1)
    ends = np.array([_interval(column)[1:] for column in table.T])
    worst = float(np.abs(ends).max())
    beyond = bool(((ends > _BOUND).all(axis=1) | (ends < -_BOUND).all(axis=1)).any())
    return {
        **_claim(4, arm, measure, "mean over sizes", means_of_seeds),
        "agreeing": int((np.abs(means_of_seeds) < _BOUND).sum()),
        "worst": worst,
        "answer": HOLDS if worst < _BOUND else FAILS if beyond else OPEN,
    }


def _claim(figure: int, arm: Any, measure: str, statistic: str, by_seed: Floats) -> dict[str, Any]:
    """Return a claim on some runs: a row with the mean over seeds and its interval."""
    head = {
        "figure": figure,
        "comparator": arm[0],
        "errs": arm[1],
        "measure": measure,
        "statistic": statistic,
    }
    interval = zip(("estimate", "low", "high"), _interval(by_seed), strict=True)
    return head | dict(interval) | {"runs": len(by_seed)}


def _interval(x: Floats) -> tuple[float, float, float]:
    """Return the mean and the ends of the 95% t-interval; nan from a single number."""
    mean, half = float(np.mean(x)), half_width(x)
    return mean, mean - half, mean + half
