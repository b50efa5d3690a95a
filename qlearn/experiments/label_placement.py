"""Labels beside markers that do not lie on each other: few, short, and each where there is room for it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

_SIZE, _WIDE, _HIGH = 8.0, 4.9, 8.5  # points: of the letters, and about how wide one and how high a line is
_NEAR = 11.0  # points: markers of one path that are nearer than this to the next share a label
_FAR = 17.0  # points: beyond, a line leads from the marker to its label
_MARKER = 4.0  # points: half of a marker's width
_WAYS = [np.array([np.sin(a), np.cos(a)]) for a in np.radians([180, 0, 90, 270, 135, 225, 45, 315])]  # below first


class Marked(NamedTuple):
    """A path's markers: ``at`` (n, 2) in data coordinates, what each is called (n,), and the colour of that."""

    at: NDArray[np.float64]
    names: Sequence[str]
    color: str


def place_labels(axes: Axes, paths: Iterable[Marked]) -> None:
    """Write each marker's name beside it, those of neighbours on a path in one label, clear of other labels and of
    markers as far as there is room within the axes. To be called once the axes' limits and place are final."""
    paths, points = list(paths), 72.0 / axes.figure.dpi
    frame = axes.bbox.get_points() * points
    shown = [axes.transData.transform(path.at) * points for path in paths]
    taken = [_box(at, 2 * _MARKER, 2 * _MARKER) for at in np.concatenate(shown)] if shown else []
    for path, at in zip(paths, shown, strict=True):
        for group in _groups(at):
            text = ", ".join(dict.fromkeys(path.names[i] for i in group))
            middle = at[group[len(group) // 2]]
            size = np.array([_WIDE * len(text), _HIGH])
            box, shift = _free(middle, size, taken, frame)
            taken.append(box)
            far = np.hypot(*(shift / (1 + size / 20))) > _FAR
            axes.annotate(
                text,
                path.at[group[len(group) // 2]],
                xytext=(float(shift[0]), float(shift[1])),
                textcoords="offset points",
                fontsize=_SIZE,
                color=path.color,
                horizontalalignment="center",
                verticalalignment="center",
                path_effects=[withStroke(linewidth=2, foreground="white")],
                arrowprops={"arrowstyle": "-", "color": path.color, "linewidth": 0.6, "shrinkA": 0} if far else None,
                zorder=4,
            )


def _groups(at: NDArray[np.float64]) -> list[list[int]]:
    """Neighbours (n, 2) on a path, in points, that are near each other."""
    groups: list[list[int]] = []
    for i in range(len(at)):
        if groups and np.hypot(*(at[i] - at[groups[-1][0]])) < _NEAR:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _free(
    at: NDArray[np.float64], size: NDArray[np.float64], taken: list[NDArray[np.float64]], frame: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The box and the shift of the nearest place beside a marker that covers least of what is there."""
    best, least = None, np.inf
    for ring in range(7):
        for way in _WAYS:
            shift = way * (_MARKER + 1.5 + 6.0 * ring + size / 2)
            box = _box(at + shift, *size)
            outside = np.maximum(frame[0] - box[0], 0).sum() + np.maximum(box[1] - frame[1], 0).sum()
            cost = sum(_overlap(box, other) for other in taken) + 20.0 * outside + 2.0 * ring
            if cost < least - 1e-9:
                best, least = (box, shift), cost
    assert best is not None
    return best


def _box(at: NDArray[np.float64], width: float, height: float) -> NDArray[np.float64]:
    half = np.array([width, height]) / 2
    return np.array([at - half, at + half])


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    sides = np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])
    return float(sides[0] * sides[1]) if (sides > 0).all() else 0.0
