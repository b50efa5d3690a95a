"""Transitivity decides with a proof, and a circle of answers is found however it closes."""

import itertools

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import (
    Answer,
    AnswerLog,
    Answers,
    InconsistentAnswers,
    PolytopeComparator,
    Query,
    TruthfulTutor,
    Verdict,
)
from elicit.diagnostics.preference_graph import (
    Cycle,
    Implied,
    Step,
    cycles,
    follows,
    preference_graph,
)
from tests.thoroughness import examples

# neither of two dominates the other: what the middle level gains, both ends lose
A, B, C, D = [0.5, 0.0, 0.5], [0.4375, 0.125, 0.4375], [0.375, 0.25, 0.375], [0.25, 0.5, 0.25]
BEST, WORST = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]
BETTER, WORSE, EQUAL = Verdict.BETTER, Verdict.WORSE, Verdict.EQUAL


def said(name, left, verdict, right):
    return Answer(Query(name, left, right), verdict)


def test_nodes_are_the_vectors_shown_and_edges_lead_from_better_to_worse():
    told = [
        (A, BETTER, B),
        (C, WORSE, A),
        (B, EQUAL, C),
        (C, None, D),
        (B, WORSE, A),
        (B, EQUAL, A),
    ]
    graph = preference_graph([said(str(i), *one) for i, one in enumerate(told, 1)], dominance=False)
    assert [graph.nodes[n]["vector"].tolist() for n in range(4)] == [A, B, C, D]
    assert {edge: (about["kind"], about["ids"]) for edge, about in graph.edges.items()} == {
        (0, 1): ("better", ("1", "5", "6")),
        (1, 0): ("equal", ("6",)),
        (0, 2): ("better", ("2",)),
        (1, 2): ("equal", ("3",)),
        (2, 1): ("equal", ("3",)),
    }
    assert not any(about["dominates"] for about in graph.edges.values())


def test_those_that_say_better_come_first():
    graph = preference_graph([said("1", A, EQUAL, B), said("2", A, BETTER, B)])
    assert graph.edges[0, 1] == {"kind": "better", "ids": ("2", "1"), "dominates": False}


def test_dominance_joins_what_the_order_settles():
    answers = [said("1", A, BETTER, B), said("2", WORST, WORSE, B), said("3", BEST, None, C)]
    graph = preference_graph(answers)
    a, b, worst, best, c = range(5)
    assert {edge for edge, about in graph.edges.items() if about["kind"] == "dominance"} == {
        *((best, other) for other in (a, b, worst, c)),
        *((other, worst) for other in (a, c)),
    }
    assert graph.edges[b, worst] == {"kind": "better", "ids": ("2",), "dominates": True}
    assert all(about["ids"] == () for about in graph.edges.values() if about["kind"] == "dominance")
    assert set(preference_graph(answers, dominance=False).edges) == {(a, b), (b, worst)}


def test_vectors_that_differ_at_the_worst_level_only_are_one_node():
    graph = preference_graph([said("1", A, BETTER, B), said("2", [0.25, -0.0, 0.5], EQUAL, A)])
    assert (len(graph), set(graph.edges)) == (2, {(0, 1)})


def test_a_log_gives_what_counts(tmp_path):
    log = AnswerLog(tmp_path / "log.jsonl")
    log.append(said("1", A, BETTER, B))
    log.append(said("2", B, BETTER, A), used=False)
    log.append(said("3", B, BETTER, C))
    log.append(said("4", C, BETTER, A))
    assert len(cycles(preference_graph(log))) == 1
    log.retract("4")
    for answers in (log, AnswerLog.read(tmp_path / "log.jsonl"), [e for e in log if e.used]):
        graph = preference_graph(answers)
        assert set(graph.edges) == {(0, 1), (1, 2)}
        assert cycles(graph) == []
        assert [one.ids for one in follows(graph)] == [("1", "3")]


def test_nothing_said():
    for answers in ([], [said("1", A, None, B)]):
        graph = preference_graph(answers)
        assert list(graph.edges) == follows(graph) == cycles(graph) == []


def test_other_numbers_of_levels_are_refused():
    with pytest.raises(
        ValueError, match="query 2 is about 2 levels, but the first answer is about 3"
    ):
        preference_graph([said("1", A, BETTER, B), said("2", [0, 1], BETTER, [1, 0])])


def test_a_chain_and_its_proof():
    graph = preference_graph(
        [said("1", A, BETTER, B), said("2", C, EQUAL, B), said("3", C, BETTER, D)]
    )
    a, b, c, d = range(4)
    steps = (
        Step(a, b, "better", ("1",)),
        Step(b, c, "equal", ("2",)),
        Step(c, d, "better", ("3",)),
    )
    assert follows(graph) == [
        Implied(a, c, BETTER, steps[:2]),
        Implied(a, d, BETTER, steps),
        Implied(b, d, BETTER, steps[1:]),
    ]
    assert [one.ids for one in follows(graph)] == [("1", "2"), ("1", "2", "3"), ("2", "3")]


@pytest.mark.parametrize(
    ("told", "found"),
    [
        ([("1", C, EQUAL, B), ("2", B, EQUAL, A)], (0, 2, EQUAL, ("1", "2"))),
        ([("0", C, None, A), ("1", A, BETTER, B), ("2", B, BETTER, C)], (1, 0, BETTER, ("1", "2"))),
    ],
)
def test_ties_and_untold_pairs_are_listed_once(told, found):
    (one,) = follows(preference_graph([said(*answer) for answer in told]))
    assert (one.better, one.worse, one.verdict, one.ids) == found


shares = st.lists(st.integers(0, 3), min_size=3, max_size=3).map(
    lambda n: [6 - sum(n), *n] if sum(n) <= 6 else [*n, 0]
)
pairs = st.lists(st.tuples(shares, shares, st.sampled_from([-1, -1, 0, 1, 1, None])), max_size=9)


def tails(vector):
    return list(itertools.accumulate(vector[:0:-1]))


def plain_relation(told, dominance):
    """(at least as good, better), as sets of pairs of nodes' vectors without level 1, stated
    anew.
    """
    nodes = list(dict.fromkeys(tuple(v[1:]) for left, right, _ in told for v in (left, right)))
    good, strict = set(), set()
    for left, right, verdict in told:
        pair = (tuple(left[1:]), tuple(right[1:]))
        if verdict == 0 and pair[0] != pair[1]:
            good |= {pair, pair[::-1]}
        elif verdict:
            good.add(pair[::verdict])
            strict.add(pair[::verdict])
    if dominance:
        for u, v in itertools.permutations(nodes, 2):
            if all(x >= y for x, y in zip(tails([0, *u]), tails([0, *v]), strict=True)):
                good.add((u, v))
                strict.add((u, v))
    return nodes, good, strict


def fewest_answers(nodes, good, free):
    """Floyd and Warshall, in (answers, steps)."""
    cost = {pair: ((0, 1) if pair in free else (1, 1)) for pair in good}
    for via, u, v in itertools.product(nodes, nodes, nodes):
        if (u, via) in cost and (via, v) in cost:
            through = tuple(map(sum, zip(cost[u, via], cost[via, v], strict=True)))
            cost[u, v] = min(cost.get((u, v), through), through)
    return cost


def graph_of(told, dominance):
    answers = [
        Answer(Query(str(i), left, right), verdict) for i, (left, right, verdict) in enumerate(told)
    ]
    graph = preference_graph(answers, dominance)
    return (
        graph,
        {n: tuple(graph.nodes[n]["vector"][1:].astype(int).tolist()) for n in graph},
        answers,
    )


def holds(step, graph, answers, name):
    """Return whether a step says the same as its answers, or as the order."""
    better, worse = name[step.better], name[step.worse]
    if step.kind == "dominance":
        u, v = tails([0, *better]), tails([0, *worse])
        return step.ids == () and u != v and all(x >= y for x, y in zip(u, v, strict=True))
    found = []
    for one in (answers[int(i)] for i in step.ids):
        shown = (tuple(one.query.left[1:]), tuple(one.query.right[1:]))
        assert shown in ((better, worse), (worse, better))
        found.append(one.verdict if shown == (better, worse) else one.verdict.flipped)
    if better == worse:  # a vector said to be better than itself
        return step.kind == "better" and bool(found)
    return found[0] == (BETTER if step.kind == "better" else EQUAL) and all(
        v in (BETTER, EQUAL) for v in found
    )


@given(pairs, st.booleans())
@examples(200)
def test_what_follows_is_the_transitive_closure(told, dominance):
    graph, name, answers = graph_of(told, dominance)
    nodes, good, strict = plain_relation(told, dominance)
    free = strict & plain_relation([(u, v, None) for u, v, _ in told], dominance)[1]
    cost = fewest_answers(nodes, good, free)
    wanted = {(u, v) for u, v in cost if u != v and (u, v) not in good and (v, u) not in good}
    found = follows(graph)
    ties = {(name[o.worse], name[o.better]) for o in found if o.verdict == EQUAL}
    listed = [(name[one.better], name[one.worse]) for one in found]
    assert len(set(listed)) == len(listed)
    assert set(listed) <= wanted <= set(listed) | ties
    for one in found:
        assert (one.steps[0].better, one.steps[-1].worse) == (one.better, one.worse)
        assert all(a.worse == b.better for a, b in itertools.pairwise(one.steps))
        assert all(holds(step, graph, answers, name) for step in one.steps)
        assert (len(one.ids), len(one.steps)) == cost[name[one.better], name[one.worse]]
        assert (one.verdict == EQUAL) == all(step.kind == "equal" for step in one.steps)


def test_what_follows_is_what_a_comparator_is_sure_of():
    rng = np.random.default_rng(0)
    tutor = TruthfulTutor([0, 1, 5, 6, 9])
    vectors = (
        rng.multinomial(1024, rng.dirichlet(np.ones(5), 30)) / 1024
    )  # whose differences add up exactly
    answers = [tutor(Query(str(i), *vectors[rng.choice(30, 2, replace=False)])) for i in range(60)]
    graph = preference_graph(answers)
    sure = PolytopeComparator(5, margin=0).update(Answers.of(answers, 5))
    implied = follows(graph)
    assert len(implied) > 40
    assert cycles(graph) == []
    d = [graph.nodes[one.better]["vector"] - graph.nodes[one.worse]["vector"] for one in implied]
    assert (sure.compare(d) == [one.verdict for one in implied]).all()
    for one in implied[::7]:  # the answers named are proof enough
        named = [answers[int(i)] for i in one.ids]
        alone = PolytopeComparator(5, margin=0).update(Answers.of(named, 5))
        difference = graph.nodes[one.better]["vector"] - graph.nodes[one.worse]["vector"]
        assert alone.compare(difference)[0] == BETTER


def test_better_better_better_and_back():
    answers = [
        said("1", A, BETTER, B),
        said("2", B, BETTER, C),
        said("3", A, WORSE, C),
        said("4", C, BETTER, D),
    ]
    (one,) = cycles(preference_graph(answers))
    assert one == Cycle(
        (Step(0, 1, "better", ("1",)), Step(1, 2, "better", ("2",)), Step(2, 0, "better", ("3",)))
    )
    assert one.ids == ("1", "2", "3")
    # A - C is twice A - B: to a reliable tutor opposite answers to one pair, and no tie
    with pytest.raises(InconsistentAnswers) as caught:
        PolytopeComparator(3).update(Answers.of(answers, 3))
    assert [name for _, name in caught.value.answers] == ["1", "3"]


@pytest.mark.parametrize(
    ("told", "found"),
    [
        (
            [(A, BETTER, B), (B, BETTER, A), (A, BETTER, B)],
            [("1", "3", "2")],
        ),  # opposite answers to one pair
        ([(A, EQUAL, B), (B, EQUAL, C), (A, EQUAL, C)], []),
        ([(A, EQUAL, B), (B, EQUAL, C), (A, BETTER, C)], [("3", "2", "1")]),
        ([(A, BETTER, A), (B, EQUAL, B)], [("1",)]),  # a vector better than itself
    ],
)
def test_small_circles(told, found):
    assert [
        one.ids
        for one in cycles(preference_graph([said(str(i), *one) for i, one in enumerate(told, 1)]))
    ] == found


def test_an_answer_against_the_order_of_the_levels():
    for verdict in (BETTER, EQUAL):
        graph = preference_graph(
            [said("1", WORST, verdict, A), said("2", A, BETTER, B), said("3", BEST, BETTER, A)]
        )
        (one,) = cycles(graph)
        assert one.ids == ("1",)
        assert sorted(step.kind for step in one.steps) == sorted(
            ["dominance", verdict.name.lower()]
        )
        without = preference_graph([said("1", WORST, verdict, A)], dominance=False)
        assert cycles(without) == []


def said_on(cycle):
    """Its answers as a set that does not depend on the direction in which an EQUAL is used."""
    return {
        (frozenset(step[:2]) if step.kind == "equal" else step[:2], step.kind)
        for step in cycle.steps
        if step.ids
    }


def all_circles(graph):
    """Every simple circle with an answer and a strict step, by enumeration: (answers on it, steps,
    nodes).
    """
    found = []
    for nodes in nx.simple_cycles(graph):
        edges = list(itertools.pairwise([*nodes, nodes[0]]))
        about = [graph.edges[edge] for edge in edges]
        answered = [
            (edge, a["kind"]) for edge, a in zip(edges, about, strict=True) if not a["dominates"]
        ]
        needs = {(frozenset(edge) if kind == "equal" else edge, kind) for edge, kind in answered}
        if needs and any(a["dominates"] or a["kind"] == "better" for a in about):
            found.append((needs, len(edges), nodes))
    return found


@given(pairs, st.booleans())
@examples(300)
def test_circles_against_all_there_are(told, dominance):
    graph, name, answers = graph_of(told, dominance)
    if len(graph) > 9:
        graph = graph.subgraph(range(9))
    every = all_circles(graph)
    found = cycles(graph)
    assert bool(found) == bool(every)
    # each is a circle that holds
    for one in found:
        assert all(holds(step, graph, answers, name) for step in one.steps)
        nodes = [step.better for step in one.steps]
        assert nodes[1:] + nodes[:1] == [step.worse for step in one.steps]
        assert (nodes[0], len(set(nodes))) == (min(nodes), len(nodes))
        assert any(step.kind != "equal" for step in one.steps)
        # minimal: no circle has a part of its answers, nor the same answers in fewer steps
        assert not any(needs < said_on(one) for needs, _, _ in every)
        assert len(one.steps) == min(steps for needs, steps, _ in every if needs == said_on(one))
    sets = [said_on(one) for one in found]
    assert not any(a == b for a, b in itertools.combinations(sets, 2))
    assert [len(s) for s in sets] == sorted(len(s) for s in sets)
    # through each strict answer on a circle: one that is as short as any, or a part of such a one
    for edge, about in graph.edges.items():
        if about["kind"] == "better" and not about["dominates"]:
            through = [needs for needs, _, _ in every if (edge, "better") in needs]
            fewest = min(map(len, through), default=0)
            assert not through or any(
                s <= needs for needs in through if len(needs) == fewest for s in sets
            )


def test_one_wrong_answer_among_many_is_on_every_cycle():
    """At a size where circles cannot be enumerated."""
    rng = np.random.default_rng(1)
    tutor = TruthfulTutor([0, 2, 3, 7, 8, 10])
    vectors = rng.dirichlet(np.ones(6), 150)
    answers = [
        tutor(Query(str(i), *vectors[rng.choice(150, 2, replace=False)])) for i in range(300)
    ]
    assert cycles(preference_graph(answers)) == []
    worth = vectors @ tutor.values
    bad = said("wrong", vectors[worth.argmin()], BETTER, vectors[worth.argmax()])
    graph = preference_graph([*answers, bad])
    found = cycles(graph)
    assert 0 < len(found) <= graph.number_of_edges()
    assert all("wrong" in one.ids for one in found)


def test_ten_thousand_circles_take_no_time():
    """There are 2^12 cycles and more: two vectors a layer, each better than both of the next layer.

    The last layer is better than the first. Each step needs only one of the cycles.
    """
    layers = [
        [[0.5 - s - t, 2 * (s + t), 0.5 - s - t] for t in (0.0, 0.005)]
        for s in np.linspace(0, 0.4, 12)
    ]
    every = itertools.product(range(12), range(2), range(2))
    answers = [
        said(f"{i}{a}{b}", layers[i][a], BETTER, layers[(i + 1) % 12][b]) for i, a, b in every
    ]
    found = cycles(preference_graph(answers))
    assert 0 < len(found) <= 48
    assert {name for one in found for name in one.ids} == {answer.query.id for answer in answers}
    assert all(len(one.ids) == 12 for one in found)
