"""The graph of answered vectors: conclusions by transitivity alone, and circular answers.

The graph is weaker than a comparator, which also adds answers up, but people can read it: each
conclusion is a chain of answers. If differences of vectors are rounded, a comparator that is exact
about the rounded numbers can miss such a conclusion by the rounding. A circle of a person's answers
most likely holds an error. Show it to the person, and retract the answers that they take back.
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
    kind
        "dominance" if the order of the levels says so (eq. 4), else "better" or "equal", as the
        answers do.
    ids
        The answers that say so, those that say "better" first; () for dominance.
    """

    better: int
    worse: int
    kind: str
    ids: tuple[str, ...]


class Implied(NamedTuple):
    """A conclusion about two nodes.

    ``better`` is better than ``worse`` (verdict BETTER) or as good (EQUAL).

    ``steps`` leads from the one to the other.
    """

    better: int
    worse: int
    verdict: Verdict
    steps: tuple[Step, ...]

    @property
    def ids(self) -> tuple[str, ...]:
        """One answer for each answered step: together they prove it."""
        return tuple(step.ids[0] for step in self.steps if step.ids)


class Cycle(NamedTuple):
    """A circular chain: each node is at least as good as the next, at least one of them better.

    The last step ends at the node where the first begins. It is the node that was shown first.
    """

    steps: tuple[Step, ...]

    @property
    def ids(self) -> tuple[str, ...]:
        """All answers on the cycle.

        To break it, all answers of one of its steps must be withdrawn.
        """
        return tuple(name for step in self.steps for name in step.ids)


def preference_graph(answers: Iterable[Answer | Entry], dominance: bool = True) -> nx.DiGraph:
    """Return the graph of the vectors that were shown, with edges from better to worse.

    EQUAL makes an edge in either direction, and so do opposite answers to one pair. "Cannot tell"
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
        Edges have ``ids``, the answers that say that the start is at least as good as the end
        (those that say "better" first). Their ``kind`` is "better" if some answers say that, else
        "equal", or "dominance" if there are none. Their ``dominates`` is True if the order of the
        levels says that the start is better.

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
    """Return conclusions by transitivity about pairs that no edge joins.

    Nobody needs to ask about them.

    For each pair it is the chain with the fewest answers, and among those one with the fewest
    steps. Two nodes that are as good as each other are listed once, the first one shown as
    ``better``. About nodes on a cycle everything follows, also opposites, so look at ``cycles``
    first. There is one shortest-path search per node.

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

    A circle has at least one answer and a step that is not "equal". It is minimal if no part of its
    answers makes a circle. For each such step that lies on a circle, the circle returned is that
    through it with the fewest answers, then the fewest steps, or a smaller one that is part of it.

    An empty list means that, by transitivity alone, the answers contradict neither each other nor
    the order of the levels. Otherwise a comparator for reliable tutors takes all vectors on a cycle
    as equally good, if a scale allows that (with dominance on the cycle it needs equal levels,
    which a margin above 0 forbids). From a person a cycle most likely means that one of its answers
    is wrong. Ask first about an answer that is on many cycles.

    Parameters
    ----------
    graph : networkx.DiGraph
        As ``preference_graph`` returns it.

    Returns
    -------
    list of Cycle
        Sorted, fewest answers first. There are no more cycles than edges, and one shortest-path
        search per node and per cycle.
    """
    minimal = {_circles(_only(graph, said, nodes))[0] for said, nodes in _circles(graph)}
    return [
        Cycle(_steps(graph, (*nodes, nodes[0]))) for _, nodes in sorted(minimal, key=_fewest_first)
    ]


_Nodes: TypeAlias = tuple[int, ...]
_Said: TypeAlias = tuple[int, int, str]
"""Relation that one or more answers state between two nodes.

It is better, worse, and "better"; or both in order, and "equal".
"""


def _steps(graph: nx.DiGraph, path: Iterable[int]) -> tuple[Step, ...]:
    """Return the edges along a path; where dominance suffices, no answer is named."""
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
    """Return the shortest circles through the strict steps that lie on one, fewest answers first.

    Each comes as the answers on it, of each such set one circle only, and its nodes, the smallest
    first.
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
    """Return the graph of these nodes with these answers and dominance, and no other answers."""
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
    """Return the answers that a circle needs."""
    steps = _steps(graph, (*nodes, nodes[0]))
    return frozenset(
        (min(s[:2]), max(s[:2]), s.kind) if s.kind == "equal" else (s.better, s.worse, s.kind)
        for s in steps
        if s.ids
    )


def _fewest_first(found: tuple[frozenset[_Said], _Nodes]) -> tuple[int, int, _Nodes]:
    said, nodes = found
    return len(said), len(nodes), nodes
