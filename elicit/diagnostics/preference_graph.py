"""The graph of the vectors that were shown: conclusions by transitivity, and circular answers.

A comparator concludes more, because it also adds answers up. But people can read the graph: each
conclusion is a chain of answers. It also finds conclusions that a comparator misses if the vectors'
differences were rounded. A circle in a person's answers most likely holds an error. Show it to the
person, and retract the answers that they take back.
"""

from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import networkx as nx
import numpy as np

from elicit.model.difference import dominance as by_order
from elicit.model.difference import tail_sums
from elicit.model.query import Answer, Verdict
from elicit.tutors.answer_log import Entry, entries_of


class Step(NamedTuple):
    """A link of a chain: node ``better`` is at least as good as node ``worse``.

    Attributes
    ----------
    better, worse : int
        The two nodes of the graph.
    kind : str
        "dominance" if the order of the levels shows it. Otherwise "better" or "equal", as the
        answers say.
    ids : tuple of str
        The answers that say so, those that say "better" first; () for dominance.
    """

    better: int
    worse: int
    kind: str
    ids: tuple[str, ...]


class Implied(NamedTuple):
    """A conclusion that node ``better`` is better than ``worse`` (BETTER) or as good (EQUAL).

    Attributes
    ----------
    better, worse : int
        The two nodes of the graph.
    verdict : Verdict
        BETTER or EQUAL.
    steps : tuple of Step
        The chain from ``better`` to ``worse``.
    """

    better: int
    worse: int
    verdict: Verdict
    steps: tuple[Step, ...]

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of answers that prove the conclusion, one for each step that needs an answer."""
        return tuple(step.ids[0] for step in self.steps if step.ids)


class Cycle(NamedTuple):
    """A circular chain: each node is at least as good as the next, and in some step better.

    Attributes
    ----------
    steps : tuple of Step
        The chain. The last step returns to the node where the first begins, which is the node shown
        first.
    """

    steps: tuple[Step, ...]

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of all answers on the cycle.

        To break the cycle, withdraw all answers of one of its steps.
        """
        return tuple(name for step in self.steps for name in step.ids)


def preference_graph(answers: Iterable[Answer | Entry], dominance: bool = True) -> nx.DiGraph:
    """Return the graph of the vectors that were shown, with edges from better to worse.

    EQUAL makes edges in both directions, and so do opposite answers to the same pair. "Cannot tell"
    makes none. Entries that are not used, such as retracted ones, are left out.

    Parameters
    ----------
    answers : Answers, AnswerLog, or some of its entries
    dominance : bool
        If True, add the edges that the order of the levels decides: n (n - 1) / 2 comparisons.

    Returns
    -------
    networkx.DiGraph
        Nodes are 0, 1, ... in the order in which the vectors were first shown, with the attribute
        ``vector`` (k,). Vectors that differ at level 1 only are worth the same, and are one node.
        An edge's ``ids`` are the answers that say that its start is at least as good as its end,
        those that say "better" first. Its ``kind`` is "better" if some answers say that, else
        "equal", or "dominance" if there are no answers. Its ``dominates`` is True if the order of
        the levels shows that the start is better.

    Raises
    ------
    ValueError
        If the answers are about different numbers of levels.
    """
    graph = nx.DiGraph()
    nodes: dict[bytes, int] = {}
    said: dict[
        tuple[int, int], tuple[list[str], list[str]]
    ] = {}  # answers that say "better", and "equal"
    for answer in (entry.answer for entry in entries_of(answers) if entry.used):
        query = answer.query
        k = len(graph.nodes[0]["vector"]) if graph else len(query.left)
        if len(query.left) != k:
            raise ValueError(
                f"query {query.id} is about {len(query.left)} levels, but the first answer is "
                f"about {k}"
            )
        left, right = (
            nodes.setdefault((v[1:] + 0.0).tobytes(), len(nodes)) for v in (query.left, query.right)
        )
        for node, vector in ((left, query.left), (right, query.right)):
            if node not in graph:
                graph.add_node(node, vector=vector)
        if answer.verdict is not None and (answer.verdict != Verdict.EQUAL or left != right):
            for edge in [(left, right)] * (answer.verdict >= 0) + [(right, left)] * (
                answer.verdict <= 0
            ):
                said.setdefault(edge, ([], []))[answer.verdict == Verdict.EQUAL].append(query.id)
    for (start, end), (better, equal) in said.items():
        kind = "better" if better else "equal"
        graph.add_edge(start, end, ids=(*better, *equal), kind=kind, dominates=False)
    vectors = np.array(
        [graph.nodes[node]["vector"] for node in range(len(graph) if dominance else 0)]
    )
    for above, vector in enumerate(vectors):
        for below in np.flatnonzero(
            by_order(tail_sums(vector - vectors)) == Verdict.BETTER
        ).tolist():
            if (above, below) in graph.edges:
                graph.edges[above, below]["dominates"] = True
            else:
                graph.add_edge(above, below, ids=(), kind="dominance", dominates=True)
    return graph


def follows(graph: nx.DiGraph) -> list[Implied]:
    """Return conclusions by transitivity about pairs of nodes without an edge.

    Nobody needs to ask about these pairs.

    Each conclusion comes with a chain of steps that shows it. Of several chains it is the one that
    needs the fewest answers, and of these the shortest. If two nodes are as good as each other, the
    pair is listed once, and the node shown first is ``better``. Between two nodes of a cycle both a
    conclusion and its opposite follow, so look at ``cycles`` first. The function makes a
    shortest-path search from each node.

    Parameters
    ----------
    graph : networkx.DiGraph
        As ``preference_graph`` returns it.

    Returns
    -------
    list of Implied
        Sorted by node.
    """
    found = []
    joined = {pair for u, v in graph.edges for pair in ((u, v), (v, u))}
    for better in sorted(graph):
        for worse, path in sorted(_shortest_paths(graph, better).items()):
            if worse != better and (better, worse) not in joined:
                steps = _steps(graph, path)
                tie = all(step.kind == "equal" for step in steps)
                found.append(
                    Implied(better, worse, Verdict.EQUAL if tie else Verdict.BETTER, steps)
                )
    ties = {
        (one.better, one.worse)
        for one in found
        if one.verdict == Verdict.EQUAL and one.better < one.worse
    }
    return [
        one for one in found if one.verdict != Verdict.EQUAL or (one.worse, one.better) not in ties
    ]


def cycles(graph: nx.DiGraph) -> list[Cycle]:
    """Return minimal circular chains of answers and of dominance.

    A circle has at least one answer and at least one step that is not "equal". It is minimal if no
    part of its answers makes a circle. For each step on some circle that is not "equal", the
    function looks for the circle through it with the fewest answers, and of those the one with the
    fewest steps. If a part of that circle's answers makes a circle too, the result has the
    smaller circle instead.

    An empty list means that, by transitivity alone, the answers contradict neither each other nor
    the order of the levels. Otherwise a comparator for reliable tutors takes all vectors on a cycle
    as equally good, if a scale allows that. (A cycle with dominance needs equal levels, which a
    margin above 0 forbids.) A cycle in a person's answers most likely means that one of them is
    wrong. Ask first about an answer that is on many cycles.

    Parameters
    ----------
    graph : networkx.DiGraph
        As ``preference_graph`` returns it.

    Returns
    -------
    list of Cycle
        Sorted, fewest answers first. There are no more cycles than edges, and a shortest-path
        search for each node and each cycle.
    """
    minimal = {_circles(_only(graph, said, nodes))[0] for said, nodes in _circles(graph)}
    return [
        Cycle(_steps(graph, (*nodes, nodes[0]))) for _, nodes in sorted(minimal, key=_fewest_first)
    ]


_Nodes: TypeAlias = tuple[int, ...]
_Said: TypeAlias = tuple[int, int, str]
"""A relation between two nodes that answers state: (better node, worse node, "better"), or (the two
nodes in order, "equal")."""


def _steps(graph: nx.DiGraph, path: Iterable[int]) -> tuple[Step, ...]:
    """Return the edges along a path as steps. A step shown by dominance names no answers."""
    steps = []
    for edge in pairwise(path):
        about = graph.edges[edge]
        steps.append(
            Step(*edge, "dominance", ())
            if about["dominates"]
            else Step(*edge, about["kind"], about["ids"])
        )
    return tuple(steps)


def _circles(graph: nx.DiGraph) -> list[tuple[frozenset[_Said], _Nodes]]:
    """Return shortest circles, each as the set of its answers and its nodes, fewest answers first.

    For every strict step that lies on a circle there is the shortest circle through it. Circles
    with the same answers are listed once. The nodes begin with the smallest.
    """
    better = [
        edge
        for edge, about in graph.edges.items()
        if about["kind"] == "better" and not about["dominates"]
    ]
    without = nx.DiGraph(graph)
    without.remove_edges_from(better)
    found = []
    # A circle of dominance and "better" is found from the "better" step: dominance is tried against
    # "equal" only.
    for whole, dominates in ((graph, False), (without, True)):
        for nodes in nx.strongly_connected_components(whole):
            part = whole.subgraph(nodes).copy()
            ends: dict[
                int, list[int]
            ] = {}  # the end of each strict step, and the starts that lead to it
            for start, end, about in part.edges(data=True):
                if about["dominates"] == dominates and (dominates or about["kind"] == "better"):
                    ends.setdefault(end, []).append(start)
            for end, starts in ends.items():
                paths = _shortest_paths(part, end)
                for path in (paths[start] for start in starts):
                    first = path.index(min(path))
                    circle = (*path[first:], *path[:first])
                    found.append((_said(graph, circle), circle))
    shortest: dict[frozenset[_Said], _Nodes] = {}
    for said, circle in sorted(found, key=_fewest_first):
        shortest.setdefault(said, circle)
    return [(said, circle) for said, circle in shortest.items() if said]


def _only(graph: nx.DiGraph, said: frozenset[_Said], nodes: _Nodes) -> nx.DiGraph:
    """Return the graph of these nodes, with these answers and dominance as its only edges."""
    edges = {(better, worse) for better, worse, _ in said} | {
        (b, a) for a, b, kind in said if kind == "equal"
    }
    inner = graph.subgraph(nodes)
    return inner.edge_subgraph(
        edge for edge, about in inner.edges.items() if about["dominates"] or edge in edges
    )


def _shortest_paths(graph: nx.DiGraph, start: int) -> dict[int, list[int]]:
    """Return the path with the fewest answers, then the fewest steps, to each node."""
    answer = len(graph) + 1  # more than any number of steps
    paths: dict[int, list[int]] = nx.single_source_dijkstra_path(
        graph, start, weight=lambda _, __, about: 1 if about["dominates"] else 1 + answer
    )
    return paths


def _said(graph: nx.DiGraph, nodes: _Nodes) -> frozenset[_Said]:
    """Return the steps of a circle through these nodes that need answers.

    Each is given by its two nodes and its kind.
    """
    steps = _steps(graph, (*nodes, nodes[0]))
    return frozenset(
        (min(s[:2]), max(s[:2]), s.kind) if s.kind == "equal" else (s.better, s.worse, s.kind)
        for s in steps
        if s.ids
    )


def _fewest_first(found: tuple[frozenset[_Said], _Nodes]) -> tuple[int, int, _Nodes]:
    said, nodes = found
    return len(said), len(nodes), nodes
