"""Axes, names of levels, and legends that all pictures of comparators share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from elicit.model.comparator import Comparator, is_comparator
from elicit.model.scale import Floats, normalise

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TRUE_SCALE: dict[str, Any] = {
    "marker": "*", "markersize": 15, "color": "black", "markerfacecolor": "#F0E442",
    "linestyle": "none"
}  # fmt: skip


def answers_of(comparator: Any) -> str:
    """Return the number of a comparator's answers, in words."""
    n = len(comparator.answers)
    return f"{n} answer" + "s" * (n != 1)


def comparator_of(given: Any, taker: str) -> Comparator:
    """Return a comparator: ``given``, or the one in a Result. Raise TypeError for others."""
    if is_comparator(given):
        return given
    held = getattr(given, "comparator", None)
    if is_comparator(held) and not isinstance(given, type):
        return held
    raise TypeError(
        f"{taker} draws comparators, or results, each of which holds one, but among what it was "
        f"given is {given!r}"
    )


def unit_of(k: int) -> str:
    """Return the name of the unit of values on a scale of k levels."""
    return f"share of the range $e_{k if k < 10 else f'{{{k}}}'} - e_1$"


def names_of(labels: Sequence[str] | None, k: int) -> list[str]:
    """Return the levels' names; raise ValueError unless there are k."""
    names = (
        [f"$e_{{{j + 1}}}$" for j in range(k)]
        if labels is None
        else [str(label) for label in labels]
    )
    if isinstance(labels, str) or len(names) != k:
        found = (
            f"they are the text {labels!r}"
            if isinstance(labels, str)
            else f"there are {len(names)}: {names}"
        )
        raise ValueError(f"labels must name {k} levels, worst first, but {found}")
    return names


def true_scale(values: ArrayLike | None, k: int) -> Floats | None:
    """Return the true scale from 0 to 1, or None if none is given.

    Raises ValueError unless it is k increasing numbers.
    """
    if values is not None and np.shape(values) != (k,):
        raise ValueError(
            f"values must be the true scale, one number for each of {k} levels, not {values!r}"
        )
    return None if values is None else normalise(values)


def legend_above(ax: Axes, handles: Sequence[Any]) -> None:
    """Draw a legend above the axes, so that none of it is cut off.

    It has two columns, or one if two are too wide.
    """
    figure, spec = ax.get_figure(root=True), ax.get_subplotspec()
    assert figure is not None
    room = figure.bbox.width * (
        len(spec.colspan) / spec.get_gridspec().ncols if spec is not None else 1.0
    )
    where: dict[str, Any] = {
        "loc": "lower center",
        "bbox_to_anchor": (0.5, 1),
        "frameon": False,
        "handlelength": 3.5,
    }
    legend = ax.legend(handles=handles, ncols=2, **where)
    if legend.get_window_extent().width > 0.95 * room:
        legend = ax.legend(handles=handles, ncols=1, **where)
    padding = (
        0.02 * figure.bbox.height
    )  # between axes, legend and edge: about the height of a letter
    above = (
        legend.get_window_extent().height + padding + ax.bbox.y1 - figure.bbox.y1
    ) / figure.bbox.height
    if figure.get_layout_engine() is None and above > 0:  # otherwise the layout makes room
        box = ax.get_position()
        ax.set_position((box.x0, box.y0, box.width, max(0.2 * box.height, box.height - above)))


def axes_of(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """Return ax, or that of a new figure; raise ImportError without matplotlib."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install 'elicit-qlearn[ablation]'") from error
    return ax or plt.subplots(figsize=size, layout="constrained")[1]
