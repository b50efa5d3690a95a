"""The policy for the worst off, against exhaustive search and minimax duality."""

import pickle
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import qlearn
from elicit import (
    Answer,
    Answers,
    Panel,
    PanelTutor,
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
)
from qlearn import cost_of_following, cost_of_following_a_choice, policy_for_the_worst_off
from tests.mdp_cases import messy_mdp
from tests.own_cases import Exact
from tests.scale_arithmetic import normalise
from tests.thoroughness import examples, scaled, thorough


def scales_of(k, n, seed):
    rng = np.random.default_rng(seed)
    return {
        f"{i}": np.concatenate([[0], np.cumsum(rng.dirichlet(np.full(k - 1, 0.5)))])
        for i in range(n)
    }


def small(seed):
    """A random MDP of 5 states, one of them terminal, with actions that do not exist."""
    return messy_mdp(seed, n=5, discount=[0.0, 0.5, 0.9][seed % 3], n_terminal=1)[0]


def exact(scales):
    return Panel({name: Exact(values) for name, values in scales.items()})


def greatest(mdp, policy, scales):
    return max(mdp.initial @ qlearn.policy_loss(mdp, policy, values) for values in scales.values())


def least_greatest(mdp, scales):
    """Return the least that any deterministic policy loses whom it serves worst."""
    worth = [mdp.normalise(values) for values in scales.values()]
    optima = [mdp.initial @ qlearn.value_iteration(mdp, values)[0] for values in worth]
    losses = []
    for policy in deterministic(mdp):
        shares = mdp.initial @ qlearn.evaluate_policy(mdp, policy)
        losses.append(max(best - shares @ v for best, v in zip(optima, worth, strict=True)))
    return min(losses)


def deterministic(mdp):
    choices = [
        np.flatnonzero(mdp.admissible[s]) if not mdp.terminal[s] else [0]
        for s in range(mdp.n_states)
    ]
    return map(np.array, product(*choices))


@examples(12)
@given(st.integers(0, 10_000))
def test_no_single_policy_leaves_the_worst_off_better_off(seed):
    mdp = small(seed)
    scales = scales_of(mdp.k, 3, seed)
    found = policy_for_the_worst_off(mdp, exact(scales))
    best = least_greatest(mdp, scales)
    assert found.greatest <= best + 1e-9
    assert found.greatest == pytest.approx(greatest(mdp, found.probabilities, scales), abs=1e-9)
    assert best - 1e-9 <= max(found.policy_losses.values())
    for name, loss in found.losses.items():
        assert found.bounds[name] == pytest.approx(loss, abs=1e-6), "nothing is open of the scales"


@examples(10)
@given(st.integers(0, 10_000))
def test_its_greatest_loss_is_that_of_the_weights_least_kind_to_it(seed):
    mdp = small(seed)
    scales = scales_of(mdp.k, 2, seed)
    found = policy_for_the_worst_off(mdp, exact(scales))
    optima = [mdp.initial @ qlearn.value_iteration(mdp, values)[0] for values in scales.values()]

    def least(share):
        weights = np.array([share, 1 - share])
        mixed = weights @ np.stack([*scales.values()])
        return weights @ optima - mdp.initial @ qlearn.value_iteration(mdp, mixed)[0]

    if thorough():
        most = max(map(least, np.linspace(0, 1, 401)))
    else:  # it is concave: the greatest lies between the neighbours of the best of few
        best = max(np.linspace(0, 1, 11), key=least)
        most = max(map(least, np.clip(best + np.linspace(-0.1, 0.1, 21), 0, 1)))
    assert most - 1e-9 <= found.greatest <= most + 0.005


@examples(5)
@given(st.integers(0, 10_000))
def test_bounds_hold_for_scales_that_are_still_open(seed):
    mdp, _ = qlearn.random_mdp(6, 3, 4, discount=0.9, seed=seed)
    scales, rng = scales_of(4, 2, seed), np.random.default_rng(seed)
    panel = Panel({name: PolytopeComparator(4) for name in scales})
    for name, values in scales.items():
        d = rng.dirichlet(np.ones(4), 4) - rng.dirichlet(np.ones(4), 4)
        y = TruthfulTutor(normalise(values + 1e-4 * np.arange(4))).signs(d)
        panel = panel.update(Answers(d, y, who=[name] * 4))
    found = policy_for_the_worst_off(mdp, panel)
    assert found.confidence == 1
    for name, member in panel.members.items():
        gaps, _, _ = member.draws
        for j in range(0, gaps.shape[1], 16):
            values = np.concatenate([[0], np.cumsum(gaps[:, j])])
            loss = mdp.initial @ qlearn.policy_loss(mdp, found.probabilities, values)
            assert loss <= found.bounds[name] + 1e-9


def test_two_who_want_opposite_things_are_served_half_and_half():
    # from state 0: the middle level for ever, or the worst and the best with even chances
    levels = np.array([[0, 0], [1, 1], [0, 0], [2, 2]])
    p = np.zeros((4, 2, 4))
    p[0, 0, 1] = 1
    p[0, 1, [2, 3]] = 0.5
    p[[1, 2, 3], :, [1, 2, 3]] = 1
    mdp = qlearn.OrdinalMDP.from_dense(
        p, levels, discount=0.5, labels=("bad", "fair", "good"), initial=[1, 0, 0, 0]
    )
    found = policy_for_the_worst_off(mdp, exact({"ann": [0, 0.1, 1], "ben": [0, 0.9, 1]}))
    np.testing.assert_allclose(found.probabilities[0], [0.5, 0.5], atol=1e-9)
    assert found.greatest == pytest.approx(0.5 * 0.2)
    assert max(found.policy_losses.values()) == pytest.approx(0.5 * 0.4)
    assert "ann 10.00%" in str(found)
    table = cost_of_following(mdp, exact({"ann": [0, 0.1, 1], "ben": [0, 0.9, 1]}))
    np.testing.assert_allclose(table.losses[:, :2], [[0, 0.2], [0.2, 0]], atol=1e-9)
    assert table.followed == ("ann", "ben", "the mean")
    assert "who loses" in str(table)


def test_the_confidence_of_all_bounds_is_a_union_bound():
    mdp, _ = qlearn.random_mdp(5, 2, 4, seed=1)
    panel = Panel({f"{i}": PosteriorComparator(4, seed=i) for i in range(3)})
    assert policy_for_the_worst_off(mdp, panel).confidence == pytest.approx(0.85)
    table = cost_of_following(mdp, panel)
    assert (table.losses <= table.bounds + 1e-9).all()


def test_what_is_no_panel_is_refused():
    mdp, _ = qlearn.random_mdp(5, 2, 4, seed=1)
    for function in (policy_for_the_worst_off, cost_of_following):
        with pytest.raises(TypeError, match=r"an elicit\.Panel is wanted"):
            function(mdp, PolytopeComparator(4))
    with pytest.raises(ValueError, match="4 levels, but the panel's scales have 3"):
        policy_for_the_worst_off(mdp, exact({"ann": [0, 0.5, 1]}))


def test_following_another_in_a_choice_loses_what_the_scales_say() -> None:
    vectors = np.array([[0.5, 0.0, 0.5], [0.0, 1.0, 0.0], [0.2, 0.8, 0.0]])
    panel = exact({"ann": [0, 0.1, 1], "ben": [0, 0.9, 1]})
    found = cost_of_following_a_choice(vectors, panel)
    scales = [member.values for member in panel.members.values()]
    worth = [vectors @ scale for scale in (*scales, panel.values)]
    for i, name in enumerate(panel.people):
        for j in range(3):
            lost = worth[i].max() - worth[i][worth[j].argmax()]
            assert found.losses[i, j] == pytest.approx(lost, abs=1e-9)
            assert found.bounds[i, j] >= lost - 1e-9
        assert name in str(found)
    assert "at the worst state" not in str(found)
    with pytest.raises(TypeError, match=r"elicit\.Panel"):
        cost_of_following_a_choice(vectors, panel.members["ann"])  # type: ignore[arg-type]


def test_bounds_are_those_of_each_choice_also_where_people_choose_the_same() -> None:
    vectors = np.random.default_rng(2).dirichlet(np.ones(4), 6)
    panel = Panel({f"{i}": PosteriorComparator(4, seed=i % 2) for i in range(4)})
    found = cost_of_following_a_choice(vectors, panel)
    scales = [*(member.values for member in panel.members.values()), panel.values]
    for j, chosen in enumerate(int((vectors @ scale).argmax()) for scale in scales):
        for i, member in enumerate(panel.members.values()):
            high, _ = member.simultaneous_bounds(vectors - vectors[chosen])
            assert found.bounds[i, j] == max(high.max(), 0.0)


def test_what_is_no_mdp_is_refused():
    panel = exact({"ann": [0, 0.5, 1]})
    for function in (policy_for_the_worst_off, cost_of_following):
        with pytest.raises(TypeError, match=r"mdp must be a qlearn\.OrdinalMDP"):
            function(panel, panel)
    with pytest.raises(ValueError, match="4 levels, but the panel's scales have 3"):
        cost_of_following(qlearn.random_mdp(5, 2, 4, seed=1)[0], panel)


def aimed(mdp, scales, member=PolytopeComparator):
    return Panel({name: member(mdp.k) for name in scales}, aim="worst")


@cache
def solved(seed):
    """An MDP, three people's scales, and what is found for the worst off of them."""
    # seed 1 of random MDPs has much to ask about
    mdp = qlearn.random_mdp(6, 3, 4, discount=0.5, seed=seed)[0] if seed == 1 else small(seed)
    scales = scales_of(mdp.k, 3, seed)
    tutors = {name: TruthfulTutor(values) for name, values in scales.items()}
    found = qlearn.solve(mdp, tutors, aimed(mdp, scales), tolerance=0.01, seed=1)
    return mdp, scales, tutors, found


@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.slow), 4])
def test_asked_for_the_worst_off_no_single_policy_is_better_by_more_than_the_tolerance(seed):
    mdp, scales, _, found = solved(seed)
    assert found.status is qlearn.Status.CONVERGED
    assert found.worst_off.excess <= 0.01
    assert found.worst_off.confidence == 1
    best = least_greatest(mdp, scales)
    had = greatest(mdp, found.worst_off.probabilities, scales)
    assert had <= best + 0.01
    least = policy_for_the_worst_off(mdp, exact(scales)).greatest
    assert had <= least + found.worst_off.excess + 1e-9
    assert f"{found.asked} questions were asked" in str(found)
    assert set(found.answers.who) <= {*scales}


def test_a_log_tells_again_what_was_asked_for_the_worst_off():
    mdp, scales, tutors, first = solved(4)
    assert first.asked > 2
    later = qlearn.WorstOffIteration(
        mdp, aimed(mdp, scales), tolerance=0.01, seed=1, known=first.answers
    )
    assert later.ask() == ()
    few = qlearn.solve(mdp, tutors, aimed(mdp, scales), tolerance=0.01, seed=1, max_queries=2)
    assert (few.asked, few.status) == (2, qlearn.Status.GUESSED)
    assert few.worst_off.excess > 0.01


def test_one_who_cannot_tell_is_not_asked_the_same_for_the_worst_off():
    mdp, scales = small(4), scales_of(4, 3, 4)
    tutors = {name: TruthfulTutor(values) for name, values in scales.items()}
    tutors["0"] = lambda query: Answer(query, None)
    learner = qlearn.WorstOffIteration(
        mdp, aimed(mdp, scales), tolerance=0.01, max_queries=scaled(6, 12)
    )
    seen = set()
    while queries := learner.ask():
        assert (queries[0].who, queries[0].d.tobytes()) not in seen
        seen.add((queries[0].who, queries[0].d.tobytes()))
        learner.tell([PanelTutor(tutors)(queries[0])])
    assert learner.result().cannot_tell > 1
    assert {"0"} < {who for who, _ in seen}, "the others are asked"


def test_the_aim_stays_with_a_panel_and_is_one_of_two():
    scales = {"ann": [0, 0.5, 1], "ben": [0, 0.2, 1]}
    panel = Panel({name: PolytopeComparator(3) for name in scales}, aim="worst")
    told = panel.update(Answers([[0.5, -1.0, 0.5]], [1], who=["ann"]))
    assert told.aim == pickle.loads(pickle.dumps(told)).aim == "worst"
    assert Panel({"ann": PolytopeComparator(3)}).aim == "mean"
    with pytest.raises(ValueError, match="aim must be 'mean' or 'worst'"):
        Panel({"ann": PolytopeComparator(3)}, aim="best")
    mdp, _ = qlearn.random_mdp(5, 2, 3, seed=1)
    tutors = {name: TruthfulTutor(values) for name, values in scales.items()}
    with pytest.raises(ValueError, match="'policy-iteration' for a panel with aim='worst'"):
        qlearn.solve(mdp, tutors, panel, learner="q-learning")


def test_the_worst_off_of_one_is_that_one():
    mdp, values = qlearn.random_mdp(5, 2, 4, seed=1)
    alone = qlearn.solve(mdp, TruthfulTutor(values), PolytopeComparator(4), seed=1)
    panel = Panel({"ann": PolytopeComparator(4)}, aim="worst")
    found = qlearn.solve(mdp, {"ann": TruthfulTutor(values)}, panel, seed=1)
    assert found.asked == alone.asked
    np.testing.assert_array_equal(found.answers.d, alone.answers.d)
    np.testing.assert_array_equal(found.policy, alone.policy)
