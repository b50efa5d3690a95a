"""The picture of ``growth_by_size``: seconds, questions and memory against states, levels and
answers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, StrMethodFormatter

from elicit.catalogue import OWN, styles

# of an axis: the measures of each row, and its label; the second of a pair has hollow markers
PANELS = {
    "states": (("seconds",), ("asked",), ("bytes",)),
    "levels": (("seconds",), ("asked",), ("bytes",)),
    "answers": (("update", "judge"), ("open",), ("bytes",)),
}
LABELS = {
    "seconds": "CPU seconds",
    "asked": "questions",
    "bytes": "memory, MiB",
    "update": "CPU seconds\n(filled: an update; hollow: judging 10,000)",
    "open": "left to ask, of 10,000",
}
UNITS = {"bytes": 2**20}
LEAST = {"bytes": 1.0, "open": 1.0}  # below which nothing is drawn


def draw(
    found: Mapping[str, Mapping[str, Mapping[int, Mapping[str, list[float]]]]], out: Path
) -> None:
    """Three rows of three panels, all axes logarithmic, a line a method; ``found``: of each axis,
    method and size what was measured. Texts stay texts in the SVG."""
    figure = Figure(figsize=(4.4 * len(found), 11), layout="constrained")
    panels = figure.subplots(3, len(found), squeeze=False)
    looks = looks_of([who for methods in found.values() for who in methods])
    for column, (axis, methods) in enumerate(found.items()):
        sizes = sorted({size for cells in methods.values() for size in cells})
        for row, measures in enumerate(PANELS[axis]):
            panel = panels[row, column]
            for who, cells in methods.items():
                for i, name in enumerate(measures):
                    line = {
                        n: np.mean(cell[name]) / UNITS.get(name, 1)
                        for n, cell in cells.items()
                        if name in cell
                    }
                    line = {n: y for n, y in line.items() if y >= LEAST.get(name, 1e-9)}
                    fill, label = ("white", None) if i else (looks[who]["color"], who)
                    x, y = list(line), list(line.values())
                    panel.plot(
                        x,
                        y,
                        **looks[who],
                        markerfacecolor=fill,
                        markersize=6,
                        linewidth=1.2,
                        label=label,
                    )
            panel.set_xscale("log")
            panel.set_yscale("log")
            panel.xaxis.set_major_locator(FixedLocator(sizes))
            panel.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
            panel.xaxis.set_minor_formatter(NullFormatter())
            panel.yaxis.set_major_locator(
                LogLocator(subs=(1, 2, 5) if decades(panel) < 2 else (1,))
            )
            panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            panel.yaxis.set_minor_formatter(NullFormatter())
            panel.set_xlim(sizes[0] / 1.2, sizes[-1] * 1.2)
            panel.set_xlabel(axis)
            panel.set_ylabel(LABELS[measures[0]])
            panel.grid(True, which="major", color="0.92", linewidth=0.7)
            panel.set_axisbelow(True)
    if "answers" in found:
        panels[0, list(found).index("answers")].legend(fontsize=8, frameon=False)
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=4,
        frameon=False,
    )
    with mpl.rc_context({"svg.hashsalt": "qlearn", "svg.fonttype": "none"}):
        figure.savefig(out, metadata={"Date": None})


def decades(panel: Axes) -> float:
    """Number of decades that the logarithmic vertical axis of a panel spans."""
    low, high = panel.get_ylim()
    return float(np.log10(high / low))


def looks_of(methods: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return one colour, marker and line a method.

    Those of Q-learning with a comparator are the comparator's. No method has the look of a user's
    own comparator.
    """
    names = {who: who.removeprefix("Q-learning, ") for who in methods}
    looks = styles([OWN, *names.values()])
    return {who: looks[name] for who, name in names.items()}
