"""Pictures of comparators: plausible scales, intervals of levels, and graphs of answers.

Each comparator has one colour and marker, in these and all other pictures. All functions take
``ax`` (None makes a figure of its own), return it, show nothing and change no settings. matplotlib
is imported when one is called. Without it they raise ImportError.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from elicit.catalogue import OTHER_LOOKS, STYLES, kind_of, styles
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator, offers
from elicit.model.scale import Floats, exact_dot, normalise, rounded_to_total

if TYPE_CHECKING:
    import networkx as nx
    from matplotlib.axes import Axes

    from elicit.diagnostics.agreement import Agreement
    from elicit.diagnostics.preference_graph import Cycle

_GROUPS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#666666")  # told apart by the colour-blind
_MARKERS = "os^Dv<>ph*"
_FAINTER = tuple({name: style[name] for name in ("marker", "linestyle")} for style in OTHER_LOOKS)
_TRUE: dict[str, Any] = {
    "marker": "*", "markersize": 15, "color": "black", "markerfacecolor": "#F0E442",
    "linestyle": "none"
}  # fmt: skip
_MANY = 30
"""Largest number of nodes of a graph of answers whose arrows and shares can all be read, by eye."""
_SWEEPS = (
    12  # sweeps up and down through the layers: more of them improved no picture that was looked at
)
_HEAD = "-|>,head_width=0.25,head_length=0.5"
_ARROWS: dict[str, dict[str, Any]] = {
    "answer: better": {"arrowstyle": _HEAD, "color": "0.15", "linestyle": "-", "linewidth": 1.2},
    "equal": {"arrowstyle": "-", "color": "0.15", "linestyle": (0, (5, 3)), "linewidth": 1.2},
    "by dominance": {
        "arrowstyle": _HEAD,
        "color": "0.55",
        "linestyle": (0, (1, 2)),
        "linewidth": 1.2,
    },
    "on a cycle": {"linewidth": 2.2, "color": "#882255"},
}
_NAMES = {"better": "answer: better", "equal": "equal", "dominance": "by dominance"}


def polytope(
    comparators: PolytopeComparator | Sequence[PolytopeComparator],
    ax: Axes | None = None,
    *,
    labels: Sequence[str] | None = None,
    values: ArrayLike | None = None,
    cuts: bool = True,
) -> Axes:
    """Draw K_t at k = 4, as an area in the plane of the two middle levels' values.

    All ordered scales, 0 <= e_2 <= e_3 <= 1, are a triangle, of which margin, prior and answers
    leave a part. Areas compare like those in the simplex of the gaps.

    Parameters
    ----------
    comparators : PolytopeComparator or sequence
        One, or several of which each knows more than the last. The last one is filled, and its
        analytic centre is the point.
    ax : matplotlib Axes, optional
    labels : (4,) str, optional
        Names of the levels, worst first.
    values : (4,), optional
        The true scale, in any unit, drawn as a star.
    cuts : bool
        False leaves out the lines of the last one's answers and prior.

    Returns
    -------
    Axes

    Raises
    ------
    ValueError
        For k other than 4.
    """
    shown = list(comparators) if isinstance(comparators, Iterable) else [comparators]
    if not shown:
        raise ValueError("polytope needs at least one comparator")
    areas = [_plane(corners(one)) for one in shown]
    names, true = _labels(labels, 4), _true(values, 4)
    ax = _axes(ax, (6.4, 6.0))
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
            points, label=f"scales that fit {_count(one)}", zorder=2 + depth, linewidth=width
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
        ax.plot(*true[1:3], label="true scale", zorder=4, **_TRUE)
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
    ax.set(xlabel=f"value of {names[1]}\n({_unit(4)})", ylabel=f"value of {names[2]}\n({_unit(4)})")
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
    Bradley-Terry box is the rectangle of the two levels' intervals, which may leave the triangle of
    ordered scales. An ensemble's fits and a posterior's particles are dots, the larger the more
    they weigh.

    Parameters
    ----------
    comparator : Comparator
    ax : matplotlib Axes, optional
    labels : (4,) str, optional
        Names of the levels, worst first.
    values : (4,), optional
        The true scale, in any unit, drawn as a star.

    Returns
    -------
    Axes

    Raises
    ------
    ValueError
        For k other than 4, and for a comparator of another kind.
    """
    kind, four = kind_of(comparator), comparator.k == 4
    if not four or kind not in ("polytope", "box", "box-rescaled", "ensemble", "posterior"):
        name = type(comparator).__name__
        raise ValueError(
            f"no area in a plane shows a {name} of {comparator.k} levels: use scale_intervals"
        )
    names, true, known = _labels(labels, 4), _true(values, 4), cast(Any, comparator)
    ax = _axes(ax, (4.6, 4.4))
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
        ax.plot(*true[1:3], label="true scale", zorder=4, **_TRUE)
    ax.set(
        xlim=(-0.02, 1.02),
        ylim=(-0.02, 1.02),
        aspect="equal",
        xticks=[0, 0.5, 1],
        yticks=[0, 0.5, 1],
    )
    ax.set(xlabel=f"value of {names[1]}\n({_unit(4)})", ylabel=f"value of {names[2]}\n({_unit(4)})")
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def corners(comparator: PolytopeComparator) -> Floats:
    """Return the vertices of K_t at k = 4, as gaps, in order around it.

    They are computed in rationals and rounded at the end.

    Parameters
    ----------
    comparator : PolytopeComparator

    Returns
    -------
    (m, 3)
        Two vertices if K_t is a segment, one if it is a point.

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


def scale_intervals(
    comparators: Comparator | Sequence[Comparator] | Mapping[str, Comparator],
    ax: Axes | None = None,
    *,
    labels: Sequence[str] | None = None,
    values: ArrayLike | None = None,
) -> Axes:
    """Draw each level's interval by ``bounds`` and its single best guess.

    It works for any comparator and any k.

    Several comparators of the same kind have its colour, the stronger the later.

    Parameters
    ----------
    comparators : Comparator, sequence or mapping
        One, several, or several by name, drawn beside each other.
    ax : matplotlib Axes, optional
    labels : (k,) str, optional
        Names of the levels, worst first.
    values : (k,), optional
        The true scale, in any unit, drawn as ticks.

    Returns
    -------
    Axes

    Raises
    ------
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
    names, true = _labels(labels, k), _true(values, k)
    ax = _axes(ax, (6.4, 0.9 + k * max(0.35, 0.2 * len(named)) + 0.25 * len(named)))
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
        ax.plot(one.values, at, style["marker"], color=style["color"], markersize=6, zorder=2)
        handles.append(Line2D([], [], linewidth=2, markersize=6, label=name, **style))
    ax.set_yticks(rows, names)
    ax.set(ylim=(-0.6, k - 0.4), xlabel=f"value ({_unit(k)})")
    ax.tick_params(axis="y", length=0)
    ax.hlines(rows[1:] - 0.5, 0, 1, color="0.9", linewidth=0.7, zorder=0)
    ax.spines[["top", "right", "left"]].set_visible(False)
    if len(handles) > 1 or isinstance(comparators, Mapping):
        _legend_above(ax, handles)
    return ax


def agreement(found: Agreement, ax: Axes | None = None) -> Axes:
    """Draw each person's interval of each level's value, and their best guess, side by side.

    People of one group stand together and have one colour.

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
    ax = _axes(ax, (6.8, 1.2 + k * max(0.4, 0.14 * n)))
    from matplotlib.lines import Line2D

    rows, handles = np.arange(k), []
    order = [(group, name) for group, names in enumerate(found.groups) for name in names]
    for i, (group, name) in enumerate(order):
        who = found.people.index(name)
        colour = _GROUPS[group % len(_GROUPS)]
        marker = _MARKERS[i % len(_MARKERS)]
        at = rows + ((n - 1) / 2 - i) * step
        ax.hlines(at, found.low[who], found.high[who], color=colour, linewidth=2, zorder=1)
        ax.plot(found.values[who], at, marker, color=colour, markersize=6, zorder=2)
        label = name if len(found.groups) == 1 else f"{name} (group {group + 1})"
        handles.append(Line2D([], [], color=colour, marker=marker, linewidth=2, label=label))
    ax.set_yticks(rows, list(found.labels))
    ax.set(ylim=(-0.6, k - 0.4), xlim=(-0.02, 1.02), xlabel=f"value ({_unit(k)})")
    ax.tick_params(axis="y", length=0)
    ax.hlines(rows[1:] - 0.5, 0, 1, color="0.9", linewidth=0.7, zorder=0)
    ax.spines[["top", "right", "left"]].set_visible(False)
    _legend_above(ax, handles)
    return ax


def preference_graph(
    graph: nx.DiGraph,
    ax: Axes | None = None,
    *,
    names: Mapping[int, str] | Sequence[str] | None = None,
    cycles: Iterable[Cycle] = (),
) -> Axes:
    """Draw ``graph.preference_graph`` in layers, better vectors above worse ones.

    On a cycle some arrows lead upwards.

    Solid arrows are answers "better", and dashed lines answers "equal". Dotted arrows are
    dominance, transitively reduced. With more than 30 nodes, answers and dominance are transitively
    reduced together, except for arrows on a cycle and arrows that lead upwards.

    Parameters
    ----------
    graph : networkx.DiGraph
        As ``graph.preference_graph`` makes it.
    names : mapping or sequence of str, optional
        A text for each node. By default its shares in percent, worst level first. With more than 30
        nodes there is no room for these, and ``graph.nodes[number]["vector"]`` has them.
    cycles : iterable of Cycle, optional
        Those of ``graph.cycles(graph)`` are drawn in colour and bold.
    """
    import networkx as nx

    if isinstance(names, str):
        raise ValueError(
            f"names must be a list or a dict with a text for each node, not the one text {names!r}"
        )
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import withStroke

    many = len(graph) > _MANY
    at, downwards = _layers(graph)
    if many:
        downwards = nx.transitive_reduction(downwards)
        at = _untangled(at, downwards)
    layers = Counter(y for _, y in at.values())
    size = (
        (max(7.0, 0.9 * max(layers.values())), max(6.0, 0.7 * len(layers))) if many else (7.0, 6.0)
    )
    ax = _axes(ax, size)
    ring = {step[:2] for cycle in cycles for step in cycle.steps}
    dominance = nx.DiGraph(
        edge for edge, about in graph.edges.items() if about["kind"] == "dominance"
    )
    if nx.is_directed_acyclic_graph(dominance):  # dominance is acyclic up to rounding
        dominance = nx.transitive_reduction(dominance)
    for (start, end), about in graph.edges.items():
        kind, back = about["kind"], graph.edges.get((end, start))
        mutual = kind == "equal" and back is not None and back["kind"] == "equal"
        on_ring = (start, end) in ring or (mutual and (end, start) in ring)
        if many:
            leads_down = at[start][1] > at[end][1]
            implied = (
                kind != "equal"
                and not on_ring
                and leads_down
                and not downwards.has_edge(start, end)
            )
        else:
            implied = kind == "dominance" and not on_ring and not dominance.has_edge(start, end)
        if start == end or implied or (mutual and end < start):
            continue
        straight = at[start][1] - at[end][1] == 1 and (mutual or back is None)
        faint = {"color": "0.75", "linewidth": 0.9} if many and kind == "dominance" else {}
        style = _ARROWS[_NAMES[kind]] | faint | (_ARROWS["on a cycle"] if on_ring else {})
        bend = f"arc3,rad={0.0 if straight else 0.2}"
        arrow = dict(style, connectionstyle=bend, shrinkA=9, shrinkB=9)
        ax.annotate("", at[end], at[start], arrowprops=arrow, zorder=1)
    for node, (x, y) in at.items():
        ax.plot(x, y, "o", markersize=17, color="white", markeredgecolor="0.15", zorder=2)
        ax.annotate(str(node), (x, y), ha="center", va="center", fontsize=9, zorder=3)
        if many and names is None:
            continue
        shares = "/".join(f"{share:g}" for share in _percentages(graph.nodes[node]["vector"]))
        halo = [withStroke(linewidth=2.5, foreground="white")]
        aside: dict[str, Any] = {
            "textcoords": "offset points",
            "va": "center",
            "fontsize": 8,
            "path_effects": halo,
        }
        ax.annotate(shares if names is None else names[node], (x, y), (11, 0), zorder=3, **aside)
    lines = {
        name: {k: v for k, v in style.items() if k != "arrowstyle"}
        for name, style in _ARROWS.items()
    }
    handles = [
        Line2D([], [], label=name, **line)
        for name, line in lines.items()
        if ring or name != "on a cycle"
    ]
    ax.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        ncols=4,
        frameon=False,
        fontsize=8,
    )
    ax.margins(0.22, 0.06)
    ax.set_axis_off()
    return ax


def _percentages(vector: Floats) -> Floats:
    """Return shares (k,) in percent, of total 100, in whole ones if that is exact.

    Other vectors are multiplied by 100.
    """
    percent = 100.0 * vector
    if (vector < 0).any() or abs(vector.sum() - 1.0) > 1e-9:
        return np.array([float(f"{share:.3g}") for share in percent])
    return rounded_to_total(percent, 0 if np.abs(percent - np.rint(percent)).max() < 1e-6 else 1)


def _untangled(
    at: dict[int, tuple[float, float]], arrows: nx.DiGraph
) -> dict[int, tuple[float, float]]:
    """Return the same layers, each sorted by the mean place of its nodes' neighbours.

    It is done several times.
    """
    layers: dict[float, list[int]] = {}
    for node in sorted(at, key=lambda node: at[node]):
        layers.setdefault(at[node][1], []).append(node)
    x = {node: place for node, (place, _) in at.items()}
    down = sorted(layers, reverse=True)
    for depth in [*down, *down[::-1]] * _SWEEPS:
        own = layers[depth]
        joined = {
            node: [x[other] for other in (*arrows.predecessors(node), *arrows.successors(node))]
            for node in own
        }
        middle = {node: float(np.mean(joined[node])) if joined[node] else x[node] for node in own}
        for i, node in enumerate(sorted(own, key=lambda node: (middle[node], node))):
            x[node] = i - (len(own) - 1) / 2
    return {node: (x[node], y) for node, (_, y) in at.items()}


def _layers(graph: nx.DiGraph) -> tuple[dict[int, tuple[float, float]], nx.DiGraph]:
    """Return where to draw each node, and the arrows between nodes that lead down.

    A node is below all that are better, near the middle of those. On a circle, where that is
    impossible, nodes that are better more often come first.
    """
    import networkx as nx

    strict = [
        edge
        for edge, about in graph.edges.items()
        if about["kind"] != "equal" and edge[0] != edge[1]
    ]
    plain = nx.DiGraph(strict)
    plain.add_nodes_from(graph)
    parts = nx.condensation(plain)
    level = {
        node: i
        for i, part in enumerate(nx.topological_sort(parts))
        for node in parts.nodes[part]["members"]
    }
    rank = {
        node: (i, plain.in_degree(node) - plain.out_degree(node), node) for node, i in level.items()
    }
    plain.remove_edges_from([(start, end) for start, end in strict if rank[start] > rank[end]])
    at: dict[int, tuple[float, float]] = {}
    for depth, layer in enumerate(nx.topological_generations(plain)):
        middle = {
            node: np.mean([at[over][0] for over in plain.predecessors(node)] or [0.0])
            for node in layer
        }
        for i, node in enumerate(sorted(layer, key=lambda node: (middle[node], node))):
            at[node] = (i - (len(layer) - 1) / 2, -float(depth))
    return at, plain


def _plane(g: Floats) -> Floats:
    """Return (e_2, e_3) (m, 2) of gaps g (m, 3)."""
    return np.cumsum(g, axis=1)[:, :2]


def _across(row: Floats, limit: float) -> Floats | None:
    """Return the line row.g = limit across the triangle, (2, 2) in the plane.

    None if it misses the triangle.
    """
    if not row.min() < limit < row.max():
        return None
    exact = Fraction(float(limit))
    ends = [point for point in _clipped(_SIMPLEX, row, exact) if exact_dot(row, point) == exact]
    return _plane(np.array(ends, dtype=np.float64))


_Points: TypeAlias = list[tuple[Fraction, ...]]
_SIMPLEX: _Points = [tuple(Fraction(int(i == j)) for j in range(3)) for i in range(3)]


def _clipped(area: _Points, row: Floats, limit: Fraction) -> _Points:
    """Return the part of a convex polygon where row.g >= limit, exactly.

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


def _named(
    comparators: Comparator | Sequence[Comparator] | Mapping[str, Comparator],
) -> list[tuple[str, Comparator]]:
    if isinstance(comparators, Mapping):
        return list(comparators.items())
    several = comparators if isinstance(comparators, Iterable) else [comparators]
    kinds = [(type(one).__name__.removesuffix("Comparator"), one) for one in several]
    return [
        (f"{kind}, {_count(one)}" if offers(one, "answers") else kind, one) for kind, one in kinds
    ]


def _looks(comparators: Sequence[Comparator]) -> list[dict[str, Any]]:
    """Return a style each: that of its kind.

    If there are several of a kind, the fainter ones come first, each with a marker of its own.
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


def _count(comparator: Any) -> str:
    n = len(comparator.answers)
    return f"{n} answer" + "s" * (n != 1)


def _unit(k: int) -> str:
    return f"share of the range $e_{k if k < 10 else f'{{{k}}}'} - e_1$"


def _labels(labels: Sequence[str] | None, k: int) -> list[str]:
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


def _true(values: ArrayLike | None, k: int) -> Floats | None:
    """Return the true scale from 0 to 1, if there is one.

    Raises ValueError unless it is k increasing numbers.
    """
    if values is not None and np.shape(values) != (k,):
        raise ValueError(
            f"values must be the true scale, one number for each of {k} levels, not {values!r}"
        )
    return None if values is None else normalise(values)


def _legend_above(ax: Axes, handles: Sequence[Any]) -> None:
    """Draw a legend above the axes, in two columns or, if these are too wide, in one.

    None of it is cut off.
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


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """Return ax, or that of a new figure; raise ImportError without matplotlib."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install 'elicit-qlearn[ablation]'") from error
    return ax or plt.subplots(figsize=size, layout="constrained")[1]
