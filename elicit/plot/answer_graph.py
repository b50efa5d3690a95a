"""Picture of the graph of answers: better vectors lie in layers above worse ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from elicit.model.scale import Floats, rounded_to_total
from elicit.plot.axes import axes_of

if TYPE_CHECKING:
    import networkx as nx
    from matplotlib.axes import Axes

    from elicit.diagnostics.preference_graph import Cycle

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


def preference_graph(
    graph: nx.DiGraph,
    ax: Axes | None = None,
    *,
    names: Mapping[int, str] | Sequence[str] | None = None,
    cycles: Iterable[Cycle] = (),
) -> Axes:
    """Draw the graph of answers in layers, better vectors above worse ones.

    Solid arrows are answers "better", and dashed lines answers "equal". Dotted arrows are
    dominance, without those that follow from others. On a cycle some arrows lead upwards. With more
    than 30 nodes, arrows that follow from answers and dominance together are left out too, unless
    they are on a cycle or lead upwards.

    Parameters
    ----------
    graph : networkx.DiGraph
        As ``graph.preference_graph`` makes it.
    ax : matplotlib.axes.Axes, optional
        Where to draw. None: the axes of a new figure.
    names : mapping or sequence of str, optional
        A text for each node. By default its shares in percent, worst level first. With more than 30
        nodes there is no room for these, and ``graph.nodes[number]["vector"]`` has them.
    cycles : iterable of Cycle, optional
        Those of ``graph.cycles(graph)`` are drawn in colour and bold.

    Returns
    -------
    matplotlib.axes.Axes
        The axes with the drawing.

    Raises
    ------
    ValueError
        If ``names`` is a single text.
    ImportError
        Without matplotlib.
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
    ax = axes_of(ax, size)
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
    """Return shares (k,) in percent, in whole numbers of total 100 if these are exact.

    Vectors that are no shares are multiplied by 100.
    """
    percent = 100.0 * vector
    if (vector < 0).any() or abs(vector.sum() - 1.0) > 1e-9:
        return np.array([float(f"{share:.3g}") for share in percent])
    return rounded_to_total(percent, 0 if np.abs(percent - np.rint(percent)).max() < 1e-6 else 1)


def _untangled(
    at: dict[int, tuple[float, float]], arrows: nx.DiGraph
) -> dict[int, tuple[float, float]]:
    """Return node positions in the same layers, reordered so that fewer arrows cross.

    Several times over, each layer is sorted by the mean place of its nodes' neighbours.
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
    """Return the position of each node, and the graph of the arrows that lead down.

    A node is below all nodes that are better, near their middle. On a circle that is impossible,
    and nodes that are better more often come first.
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
