"""A picture of each level's interval and best guess, for comparators or people side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from elicit.catalogue import OTHER_LOOKS, PEOPLE, kind_of, styles
from elicit.model.comparator import Comparator, offers
from elicit.plot.axes import (
    answers_of,
    axes_of,
    comparator_of,
    legend_above,
    names_of,
    true_scale,
    unit_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from elicit.diagnostics.agreement import Agreement

_GROUP_LINES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)))
_NAME = "scale_intervals"
_FAINTER = tuple(
    {name: style[name] for name in ("marker", "linestyle")}
    for style in (*OTHER_LOOKS[1:], OTHER_LOOKS[0])
)


def scale_intervals(
    comparators: Comparator | Sequence[Comparator] | Mapping[str, Comparator],
    ax: Axes | None = None,
    *,
    labels: Sequence[str] | None = None,
    values: ArrayLike | None = None,
) -> Axes:
    """Draw each level's interval, by a comparator's ``bounds``, and its best guess.

    It works for any comparator and any k. Comparators of the same kind have the same colour, which
    is stronger for later ones.

    Parameters
    ----------
    comparators : Comparator, sequence or mapping
        A comparator, or several, perhaps by name. Several are drawn side by side. A ``Result``
        stands for its comparator.
    ax : matplotlib Axes, optional
    labels, values : optional
        Names of the levels, and the true scale: see ``elicit.plot``.

    Returns
    -------
    Axes

    Raises
    ------
    TypeError
        If something else than a comparator or a result is given.
    ValueError
        If the comparators differ in k.
    """
    named = _named(comparators)
    if not named:
        raise ValueError("scale_intervals needs at least one comparator")
    k = named[0][1].k
    for name, one in named:
        if one.k != k:
            raise ValueError(f"{name} is about {one.k} levels, but {named[0][0]} is about {k}")
    names, true = names_of(labels, k), true_scale(values, k)
    ax = axes_of(ax, (6.4, 0.9 + k * max(0.35, 0.2 * len(named)) + 0.25 * len(named)))
    from matplotlib.lines import Line2D

    rows, handles = np.arange(k), []
    if true is not None:
        ax.vlines(true, rows - 0.42, rows + 0.42, color="black", linewidth=1.2, zorder=3)
        handles.append(
            Line2D(
                [],
                [],
                color="black",
                marker="|",
                markersize=12,
                linestyle="none",
                label="true value",
            )
        )
    for i, ((name, one), style) in enumerate(
        zip(named, _looks([one for _, one in named]), strict=True)
    ):
        at = rows + ((len(named) - 1) / 2 - i) * min(0.22, 0.75 / len(named))
        low, high = one.bounds(np.eye(k) - np.eye(k)[0])  # each level against the worst one
        ax.hlines(
            at, low, high, color=style["color"], linestyle=style["linestyle"], linewidth=2, zorder=1
        )
        for end in (low, high):
            ax.plot(end, at, "|", color=style["color"], markersize=7, markeredgewidth=1.5, zorder=1)
        dots = {"color": style["color"], "marker": style["marker"], "linestyle": "none"}
        ax.plot(one.values, at, markersize=6, zorder=2, **dots)
        handles.append(Line2D([], [], linewidth=2, markersize=6, label=name, **style))
    ax.set_yticks(rows, names)
    ax.set(ylim=(-0.6, k - 0.4), xlabel=f"value ({unit_of(k)})")
    ax.tick_params(axis="y", length=0)
    ax.hlines(rows[1:] - 0.5, 0, 1, color="0.9", linewidth=0.7, zorder=0)
    ax.spines[["top", "right", "left"]].set_visible(False)
    if len(handles) > 1 or isinstance(comparators, Mapping):
        legend_above(ax, handles)
    return ax


def agreement(found: Agreement, ax: Axes | None = None) -> Axes:
    """Draw each person's interval and best guess of each level's value, side by side.

    Each person has a colour and a marker. People of the same group are drawn next to each other,
    with the same kind of line. With more than six people the looks repeat.

    Parameters
    ----------
    found : Agreement
        The result of ``elicit.agreement``.
    ax : matplotlib Axes, optional

    Returns
    -------
    Axes
    """
    k, n = len(found.labels), len(found.people)
    step = min(0.16, 0.8 / n)
    ax = axes_of(ax, (6.8, 1.2 + k * max(0.4, 0.14 * n)))
    from matplotlib.lines import Line2D

    rows, handles = np.arange(k), []
    order = [(group, name) for group, names in enumerate(found.groups) for name in names]
    for i, (group, name) in enumerate(order):
        who = found.people.index(name)
        look = PEOPLE[i % len(PEOPLE)]
        line = _GROUP_LINES[group % len(_GROUP_LINES)]
        at = rows + ((n - 1) / 2 - i) * step
        ax.hlines(
            at,
            found.low[who],
            found.high[who],
            color=look["color"],
            linestyle=line,
            linewidth=2,
            zorder=1,
        )
        ax.plot(found.values[who], at, linestyle="none", markersize=6, zorder=2, **look)
        label = name if len(found.groups) == 1 else f"{name} (group {group + 1})"
        handles.append(Line2D([], [], linestyle=line, linewidth=2, label=label, **look))
    ax.set_yticks(rows, list(found.labels))
    ax.set(ylim=(-0.6, k - 0.4), xlim=(-0.02, 1.02), xlabel=f"value ({unit_of(k)})")
    ax.tick_params(axis="y", length=0)
    ax.hlines(rows[1:] - 0.5, 0, 1, color="0.9", linewidth=0.7, zorder=0)
    ax.spines[["top", "right", "left"]].set_visible(False)
    legend_above(ax, handles)
    return ax


def _named(
    comparators: Comparator | Sequence[Comparator] | Mapping[str, Comparator],
) -> list[tuple[str, Comparator]]:
    if isinstance(comparators, Mapping):
        return [(name, comparator_of(one, _NAME)) for name, one in comparators.items()]
    given = comparators if isinstance(comparators, Iterable) else [comparators]
    several = [comparator_of(one, _NAME) for one in given]
    kinds = [(type(one).__name__.removesuffix("Comparator"), one) for one in several]
    return [
        (f"{kind}, {answers_of(one)}" if offers(one, "answers") else kind, one)
        for kind, one in kinds
    ]


def _looks(comparators: Sequence[Comparator]) -> list[dict[str, Any]]:
    """Return a style for each comparator: that of its kind.

    Several comparators of the same kind go from faint to strong, and have different markers.
    """
    kinds = [kind_of(one) for one in comparators]
    each, alike, seen, looks = styles(kinds), Counter(kinds), Counter[str](), []
    for kind in kinds:
        seen[kind] += 1
        style, back = (
            each[kind],
            alike[kind] - seen[kind],
        )  # ``back``: number of its kind that come after it
        if back:
            other = _FAINTER[(back - 1) % len(_FAINTER)]
            style = other | {"color": (style["color"], 0.3 + 0.6 * seen[kind] / alike[kind])}
        looks.append(style)
    return looks
