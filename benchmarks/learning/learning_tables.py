"""The tables of ``learning_cost``: ratios with their limits, what the runs were like, and the
notes.
"""

from __future__ import annotations

from typing import NamedTuple

from benchmarks.reporting import machine, markdown


class Limit(NamedTuple):
    """A limit on a ratio: at most so much (a cost), or at least so much (a saving)."""

    most: float | None = None
    least: float | None = None

    def __str__(self) -> str:
        return f"at most {self.most:,g}" if self.most is not None else f"at least {self.least:,g}"

    def kept(self, ratio: float) -> bool:
        """Return whether the ratio keeps to the limit."""
        return ratio <= self.most if self.most is not None else ratio >= (self.least or 0.0)


class Row(NamedTuple):
    """A line of the table of ratios. ``ours`` and ``theirs`` are as they shall be printed;
    ``spread``: least and greatest ratio over the problems; ratio None: nothing was measured, and
    the remark says why."""

    what: str
    against: str
    ours: str
    theirs: str
    ratio: float | None
    spread: tuple[float, float] | None = None
    limit: Limit | None = None
    remark: str = ""


class Kind(NamedTuple):
    """A line on what the runs beside the knowing loop were like, means over the problems."""

    what: str
    made: str
    asked: float
    compared: float
    opened: float
    guessed: float
    loss: float
    loss_knowing: float
    same: str


class Text(NamedTuple):
    """Lines of Markdown for the end of the report."""

    lines: list[str]


Part = Row | Kind | Text


def render(parts: list[Part], about: list[str]) -> list[str]:
    """The whole report as lines of Markdown."""
    rows = [part for part in parts if isinstance(part, Row)]
    kinds = [part for part in parts if isinstance(part, Kind)]
    lines = ["# The cost of interactive Q-learning", "", machine(), "", *about]
    if rows:
        lines += ["", "## Ratios", "", *markdown(RATIOS, [cells(row) for row in rows], 2)]
    if kinds:
        lines += [
            "",
            "## What the runs were like",
            "",
            *markdown(KINDS, [described(kind) for kind in kinds], 1),
        ]
    for part in parts:
        if isinstance(part, Text):
            lines += ["", *part.lines]
    return lines


RATIOS = (
    "measured",
    "beside",
    "ours",
    "theirs",
    "ratio",
    "over the problems",
    "limit",
    "kept",
    "remark",
)
KINDS = (
    "run",
    "made in",
    "questions",
    "comparisons",
    "open",
    "guessed",
    "loss",
    "loss, knowing",
    "same policy",
)


def cells(row: Row) -> list[str]:
    """A row of the table of ratios."""
    if row.ratio is None:
        return [
            row.what,
            row.against,
            row.ours,
            row.theirs,
            "",
            "",
            str(row.limit or ""),
            "",
            row.remark,
        ]
    spread = f"{number(row.spread[0])}-{number(row.spread[1])}" if row.spread else ""
    kept = "" if row.limit is None else "yes" if row.limit.kept(row.ratio) else "NO"
    measured = [number(row.ratio), spread, str(row.limit or ""), kept]
    return [row.what, row.against, row.ours, row.theirs, *measured, row.remark]


def described(kind: Kind) -> list[str]:
    """A row of the table of runs."""
    counts = [f"{n:,.0f}" for n in (kind.asked, kind.compared, kind.opened, kind.guessed)]
    return [
        kind.what,
        kind.made,
        *counts,
        f"{kind.loss:.5f}",
        f"{kind.loss_knowing:.5f}",
        kind.same,
    ]


def number(x: float) -> str:
    """Three digits, or all before the point."""
    return f"{x:,.0f}" if x >= 100 else f"{x:.3g}"


def took(seconds: float) -> str:
    """A duration with its unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{number(seconds / size)} {unit}"
    return f"{number(seconds / 1e-6)} us"


def about(steps: int, states: int, actions: int, seeds: int, repeats: int) -> list[str]:
    """Write notes on what was measured, and how to read it."""
    return [
        f"Unless said otherwise: {steps:,} steps of Q-learning on random MDPs of {states} states "
        f"and {actions} "
        f"actions, discount .95, exploration .1, and {seeds} problems. CPU seconds of one thread. "
        "The two sides of a "
        f"ratio alternate; {repeats} pairs count (of rivals at most 3; of the Python loop with "
        "HiGHS, of ensemble and "
        "of box 1), after a first run that does not. The ratio is the median over these pairs, "
        "then over the problems. "
        "Only the loop is timed, answers included, not the making of the problem and of the "
        'learner ("made in").',
        "",
        "The loop that knows the values (`benchmarks/learning/known_values.py`) makes the same "
        "steps on the same share "
        "vectors with the same random numbers, from a copy of the learner's first state, and "
        "compares two numbers "
        'where the learner compares two vectors. "Open": comparisons left by equality and '
        "dominance. Loss: the share "
        "of the value range that the policy loses, mean over the states.",
        "",
        "The rivals (`benchmarks/learning/plain_q_learning.py`) are Python loops over NumPy arrays "
        "with the same "
        "random numbers, drawn beforehand and not timed. Where they run only the beginning, the "
        "remark says how much "
        "of it, and the rest is extrapolated: steps at the mean cost of a step, open comparisons "
        "at the mean cost of "
        "an open comparison so far, times their numbers in our whole run. Programs grow and fits "
        "get longer with the "
        "answers, which these estimates leave out, in favour of the rival.",
    ]
