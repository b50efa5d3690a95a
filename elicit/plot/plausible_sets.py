"""Plausible scales at k = 4, in the plane of the two middle levels' values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from elicit.catalogue import STYLES, kind_of
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator
from elicit.model.scale import Floats, exact_dot
from elicit.plot.axes import (
    TRUE_SCALE,
    answers_of,
    axes_of,
    comparator_of,
    names_of,
    true_scale,
    unit_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def polytope(
    comparators: PolytopeComparator | Sequence[PolytopeComparator],
    ax: Axes | None = None,
    *,
    labels: Sequence[str] | None = None,
    values: ArrayLike | None = None,
    cuts: bool = True,
) -> Axes:
    """Draw a polytope's plausible scales at k = 4, in the plane of the two middle levels' values.

    All ordered scales, 0 <= e_2 <= e_3 <= 1, are a triangle. The margin, the prior and the answers
    leave a part of it. The ratio of two areas is that of the volumes in the simplex of gaps.

    Parameters
    ----------
    comparators : PolytopeComparator or sequence
        A comparator, or several, each of which knows more than the one before. A ``Result`` stands
        for its comparator. The last area is filled, and the point in it is its analytic centre.
    ax : matplotlib Axes, optional
    labels, values : optional
        Names of the levels, and the true scale: see ``elicit.plot``.
    cuts : bool
        False leaves out the lines of the last comparator's answers and prior.

    Returns
    -------
    Axes

    Raises
    ------
    ValueError
        For k other than 4.
    """
    given = list(comparators) if isinstance(comparators, Iterable) else [comparators]
    if not given:
        raise ValueError("polytope needs at least one comparator")
    shown = [cast(PolytopeComparator, comparator_of(one, "polytope")) for one in given]
    areas = [_plane(corners(one)) for one in shown]
    names, true = names_of(labels, 4), true_scale(values, 4)
    ax = axes_of(ax, (6.4, 6.0))
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Polygon

    colour = STYLES["polytope"]["color"]
    ax.add_patch(
        Polygon([(0, 0), (0, 1), (1, 1)], facecolor="0.97", edgecolor="0.6", linewidth=1, zorder=0)
    )
    for i, (one, points) in enumerate(zip(shown, areas, strict=True)):
        depth, last = (i + 1) / len(shown), i == len(shown) - 1
        inner, width, dashes = (0.3, 2.0, "-") if last else (0.05, 1.3, (0, (1 + 5 * depth, 1.5)))
        area = Polygon(
            points, label=f"scales that fit {answers_of(one)}", zorder=2 + depth, linewidth=width
        )
        area.set(
            facecolor=(colour, inner), edgecolor=(colour, 0.35 + 0.65 * depth), linestyle=dashes
        )
        ax.add_patch(area)
        if np.ptp(points, axis=0).max() < 0.01:  # the area is too small to be seen
            ax.plot(
                *points.mean(axis=0),
                "o",
                markersize=13,
                markerfacecolor="none",
                color=colour,
                zorder=3,
            )
    if cuts:
        region = shown[-1].region
        crossing = [_across(row, limit) for row, limit in zip(region.rows, region.rhs, strict=True)]
        for of_prior, color, dashes, label in (
            (True, "0.15", "-", "limits of the prior"),
            (False, "0.45", (0, (4, 2)), "limits of the answers"),
        ):
            own = (region.owner < 0) == of_prior
            if lines := [
                line for line, mine in zip(crossing, own, strict=True) if mine and line is not None
            ]:
                drawn = LineCollection(
                    lines, colors=color, linestyles=dashes, linewidths=0.8, label=label, zorder=1.5
                )
                ax.add_collection(drawn)
    ax.plot(
        *shown[-1].values[1:3],
        "o",
        color="black",
        markersize=6,
        label="best guess (analytic centre)",
        zorder=5,
    )
    if true is not None:
        ax.plot(*true[1:3], label="true scale", zorder=4, **TRUE_SCALE)
    for at, shift, side, j in (
        ((0, 1), (0, 6), "left", 1),
        ((1, 1), (0, 6), "right", 0),
        ((0, 0), (34, 1), "left", 2),
    ):
        text = f"all of the difference lies\nbetween {names[j]} and {names[j + 1]}"
        ax.annotate(
            text,
            at,
            shift,
            textcoords="offset points",
            ha=side,
            va="bottom",
            fontsize=9,
            color="0.25",
        )
    ax.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), aspect="equal")
    ax.set(
        xlabel=f"value of {names[1]}\n({unit_of(4)})", ylabel=f"value of {names[2]}\n({unit_of(4)})"
    )
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.1), frameon=False, fontsize=9)
    return ax


def plausible(
    comparator: Comparator,
    ax: Axes | None = None,
    *,
    labels: Sequence[str] | None = None,
    values: ArrayLike | None = None,
) -> Axes:
    """Draw the scales that a comparator holds possible at k = 4, in its own colour.

    They are drawn in the plane of the two middle levels' values. A polytope is an area. A
    Bradley-Terry box is the rectangle of the two levels' intervals, which may reach beyond the
    triangle of ordered scales. An ensemble's fits and a posterior's particles are dots, larger with
    more weight.

    Parameters
    ----------
    comparator : Comparator
        A ``Result`` stands for its comparator.
    ax : matplotlib Axes, optional
    labels, values : optional
        Names of the levels, and the true scale: see ``elicit.plot``.

    Returns
    -------
    Axes

    Raises
    ------
    ValueError
        For k other than 4, and for a comparator of another kind.
    """
    comparator = comparator_of(comparator, "plausible")
    kind, four = kind_of(comparator), comparator.k == 4
    if not four or kind not in ("polytope", "box", "box-rescaled", "ensemble", "posterior"):
        name = type(comparator).__name__
        raise ValueError(
            f"no area in a plane shows a {name} of {comparator.k} levels: use scale_intervals"
        )
    names, true, known = names_of(labels, 4), true_scale(values, 4), cast(Any, comparator)
    ax = axes_of(ax, (4.6, 4.4))
    from matplotlib.patches import Polygon, Rectangle

    colour = STYLES[kind]["color"]
    face: dict[str, Any] = {"facecolor": (colour, 0.3), "edgecolor": colour, "linewidth": 1.5}
    ax.add_patch(
        Polygon([(0, 0), (0, 1), (1, 1)], facecolor="0.97", edgecolor="0.6", linewidth=1, zorder=0)
    )
    if kind == "polytope":
        ax.add_patch(Polygon(_plane(corners(known)), **face))
    elif kind in ("ensemble", "posterior") and (draws := known.draws) is not None:
        (x, y), size = _plane(draws.gaps.T).T, 14 * len(draws.weights) * draws.weights
        ax.scatter(x, y, s=size, color=colour, alpha=0.35, linewidths=0)
    elif kind.startswith("box") and len(known.rule.scales):
        low, high = known.bounds(np.eye(4)[1:3] - np.eye(4)[0])
        ax.add_patch(Rectangle((low[0], low[1]), *(high - low), **face))
    else:
        ax.text(0.97, 0.1, "says nothing yet", ha="right", fontsize=9)
    if true is not None:
        ax.plot(*true[1:3], label="true scale", zorder=4, **TRUE_SCALE)
    ax.set(
        xlim=(-0.02, 1.02),
        ylim=(-0.02, 1.02),
        aspect="equal",
        xticks=[0, 0.5, 1],
        yticks=[0, 0.5, 1],
    )
    ax.set(
        xlabel=f"value of {names[1]}\n({unit_of(4)})", ylabel=f"value of {names[2]}\n({unit_of(4)})"
    )
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def corners(comparator: PolytopeComparator) -> Floats:
    """Return the vertices of a polytope's plausible set at k = 4, as gaps, in order around it.

    They are computed in rationals and rounded at the end.

    Parameters
    ----------
    comparator : PolytopeComparator

    Returns
    -------
    (m, 3)
        Two vertices if the set is a segment, one if it is a point.

    Raises
    ------
    ValueError
        For k other than 4.
    """
    if comparator.k != 4:
        raise ValueError(
            "only for k = 4 levels the scales that fit form an area in a plane, and here k = "
            f"{comparator.k}: "
            "scale_intervals shows each level's interval for any k"
        )
    if not isinstance(comparator, PolytopeComparator):
        raise ValueError(
            f"polytope draws PolytopeComparators, not {type(comparator).__name__}: use "
            "scale_intervals"
        )
    region, area = comparator.region, _SIMPLEX
    for axis in np.eye(3):
        area = _clipped(area, axis, region.exact_margin)
    for row, limit in zip(region.rows, region.rhs, strict=True):
        area = _clipped(area, row, Fraction(float(limit)))
    return np.array(area, dtype=np.float64).reshape(-1, 3)


def _plane(g: Floats) -> Floats:
    """Return the points (e_2, e_3), (m, 2), of scales with gaps g (m, 3)."""
    return np.cumsum(g, axis=1)[:, :2]


def _across(row: Floats, limit: float) -> Floats | None:
    """Return the ends (2, 2) of the line row.g = limit across the triangle of ordered scales.

    The result is None if the line misses the triangle.
    """
    if not row.min() < limit < row.max():
        return None
    exact = Fraction(float(limit))
    ends = [point for point in _clipped(_SIMPLEX, row, exact) if exact_dot(row, point) == exact]
    return _plane(np.array(ends, dtype=np.float64))


_Points: TypeAlias = list[tuple[Fraction, ...]]
_SIMPLEX: _Points = [tuple(Fraction(int(i == j)) for j in range(3)) for i in range(3)]


def _clipped(area: _Points, row: Floats, limit: Fraction) -> _Points:
    """Return the part of a convex polygon where row.g >= limit, in exact arithmetic.

    Its vertices stay in the same order.
    """
    height = [exact_dot(row, point) - limit for point in area]
    kept = []
    for i, point in enumerate(area):
        j = (i + 1) % len(area)
        if height[i] >= 0:
            kept.append(point)
        if height[i] * height[j] < 0:
            share = height[i] / (height[i] - height[j])
            kept.append(tuple(g + share * (h - g) for g, h in zip(point, area[j], strict=True)))
    return list(dict.fromkeys(kept))
