"""Loss bounds against brute force, with exact values and with values that are wrong on purpose."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from elicit import (
    AlwaysAsk,
    Answers,
    Dominance,
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
    simultaneous_bounds,
)
from qlearn import (
    InteractivePolicyIteration,
    OrdinalMDP,
    Status,
    drive,
    evaluate_policy,
    loss_bound,
    policy_loss,
    random_mdp,
    value_iteration,
)
from qlearn.certificates.advantages import advantages_over
from qlearn.certificates.box_bounds import bounds_of_many
from qlearn.certificates.loss_bound import drawn_set, draws_of, guarantee
from qlearn.learners.query_strategies import most_even_cut
from tests.mdp_cases import losses_under, messy_mdp
from tests.thoroughness import examples, scaled


def solve(mdp, comparator, tutor, **settings):
    return drive(
        InteractivePolicyIteration(mdp, comparator, **{"tolerance": 0.005, **settings}), tutor
    )


def test_a_bound_can_be_had_for_any_policy():
    mdp, values = random_mdp(15, 3, 4, rng=8)
    worst = value_iteration(mdp, values)[1][::-1].copy()
    found = loss_bound(mdp, worst, PolytopeComparator(4))
    assert policy_loss(mdp, worst, values).max() <= found.loss_bound <= 1
    assert found.confidence == 1
    learner = InteractivePolicyIteration(
        mdp, PolytopeComparator(4), strategy=most_even_cut, tolerance=1e-3
    )
    known = drive(learner, TruthfulTutor(values)).comparator
    assert loss_bound(mdp, worst, known).loss_bound <= found.loss_bound


@pytest.mark.parametrize(
    "comparator", [PolytopeComparator(4), PosteriorComparator(4, particles=60)]
)
def test_an_error_in_the_values_counts_in_every_step(comparator):
    mdp, values = random_mdp(15, 3, 4, discount=0.9, rng=8)
    advantages = advantages_over(mdp, value_iteration(mdp, values)[1])
    assert advantages.doubt < 1e-12
    exact, rough = (
        guarantee(mdp, advantages._replace(doubt=doubt), comparator).loss_bound
        for doubt in (advantages.doubt, 0.002)
    )
    assert 0 < exact < 0.9
    assert rough - exact == pytest.approx(0.002 / (1 - 0.9), abs=1e-9)


@pytest.mark.parametrize(
    "comparator", [PolytopeComparator(3), PosteriorComparator(3, particles=60)]
)
@pytest.mark.parametrize("wrong", [0.0, 0.01, 0.3])
def test_the_bound_holds_for_values_made_wrong_on_purpose(comparator, wrong):
    for seed in range(scaled(2, 6)):
        mdp = (random_mdp(15, 3, 3, discount=0.9, rng=seed) if seed % 2 else messy_mdp(seed, k=3))[
            0
        ]
        live = ~mdp.terminal
        rng = np.random.default_rng(seed)
        policy = np.where(rng.random(mdp.n_states) < 0.7, value_iteration(mdp, [0, 1, 2])[1], 0)
        policy = np.where(
            mdp.admissible[np.arange(mdp.n_states), policy],
            policy,
            np.argmax(mdp.admissible, axis=1),
        )
        v = evaluate_policy(mdp, policy)
        v[live] = (1 - wrong) * v[live] + wrong * rng.dirichlet(np.ones(3), int(live.sum()))
        bound = guarantee(mdp, advantages_over(mdp, policy, v), comparator).loss_bound
        gaps = (
            PolytopeComparator(3).draws.gaps
            if drawn_set(comparator) is None
            else comparator.draws.gaps
        )
        losses = losses_under(mdp, policy, gaps[:, ::8])
        assert np.quantile(losses, 1.0 if drawn_set(comparator) is None else 0.9) <= bound + 1e-9


def test_an_error_counts_where_it_flatters_the_policy_and_where_it_belittles_the_rest():
    # state 0 stays at the worst level or moves on to state 1, which stays at the best: to stay
    # loses all but one step; a value of a half for both hides that, half of it in each
    successors, levels = [[[0], [1]], [[1], [1]]], [[0, 0], [1, 1]]
    ways = [[True, True], [True, False]]
    mdp = OrdinalMDP(successors, np.ones((2, 2, 1)), levels, 0.9, ("bad", "good"), admissible=ways)
    advantages = advantages_over(mdp, [0, 0], np.full((2, 2), 0.5))
    assert advantages.d[:, 1].tolist() == pytest.approx([-0.05])
    loss = policy_loss(mdp, np.array([0, 0]), [0, 1])
    np.testing.assert_allclose(loss, [0.9, 0.0], atol=1e-9)
    comparator = PolytopeComparator(2)
    assert guarantee(mdp, advantages, comparator).loss_bound >= 0.9
    assert (
        guarantee(mdp, advantages._replace(doubt=advantages.doubt / 2), comparator).loss_bound < 0.9
    )


@given(seed=some.integers(0, 10**6), k=some.integers(2, 12), tie=some.sampled_from([0.0, 0.01]))
@examples(25)
def test_bounds_of_many_are_bounds_and_tight_where_they_are_positive(seed, k, tie):
    rng, values = np.random.default_rng(seed), np.linspace(0, 1, k) ** 2
    pairs = rng.dirichlet(np.ones(k), (20, 2))
    tutor = TruthfulTutor(values)
    answers = Answers(pairs[:, 0] - pairs[:, 1], tutor.signs(pairs[:, 0] - pairs[:, 1]))
    d = np.concatenate(
        [np.diff(rng.dirichlet(np.ones(k), (80, 2)), axis=1)[:, 0], np.zeros((2, k))]
    )
    for comparator in (
        PolytopeComparator(k, tie=tie).update(answers),
        PolytopeComparator(k, wrong=1).update(answers),
    ):
        tight, confidence = simultaneous_bounds(
            comparator, d
        )  # which are not tight where they are negative
        high, same = bounds_of_many(comparator, d)
        assert same == confidence == 1
        assert (high >= np.minimum(comparator.bounds(d)[1], tight) - 1e-9).all()
        np.testing.assert_allclose(high[tight > 0], tight[tight > 0], atol=1e-9)
        assert (high[tight <= 0] <= 1e-9).all()


@given(seed=some.integers(0, 10**6), k=some.integers(2, 8), wrong=some.sampled_from([0, 1]))
@examples(20)
def test_a_bound_is_left_out_only_where_it_is_more_than_enough(seed, k, wrong):
    rng = np.random.default_rng(seed)
    mdp, values = random_mdp(12, 3, k, 0.9, rng=seed) if seed % 2 else messy_mdp(seed, k=k)
    d = np.diff(rng.dirichlet(np.ones(k), (8, 2)), axis=1)[:, 0]
    answers = Answers(d, TruthfulTutor(values).signs(d))
    known = PolytopeComparator(k, wrong=wrong)
    policy = value_iteration(mdp, np.arange(k))[1]
    advantages = advantages_over(mdp, policy)
    for part in range(3):
        exact = guarantee(mdp, advantages, PolytopeComparator(k, wrong=wrong).update(known.answers))
        bound = exact.loss_bound
        for enough in (0.3 * bound, bound * (1 - 1e-6), bound * (1 + 1e-6), 2 * bound):
            if enough >= 1:  # no policy loses more than 1
                continue
            found = guarantee(mdp, advantages, known, enough)
            assert (found.loss_bound <= enough) == (bound <= enough)
            assert found.loss_bound in (np.inf, pytest.approx(bound, abs=1e-9))
        some_rows = slice(4 * part, 4 * part + 4)
        known = known.update(Answers(answers.d[some_rows], answers.y[some_rows]))


def test_bounds_that_are_not_certain_are_asked_for_all_at_once():
    asked = []

    class Doubtful(PolytopeComparator):
        def simultaneous_bounds(self, d):
            asked.append(len(d))
            return super().simultaneous_bounds(d)[0], 0.95

    d = np.diff(np.random.default_rng(1).dirichlet(np.ones(5), (50, 2)), axis=1)[:, 0]
    high, confidence = bounds_of_many(Doubtful(5), d)
    assert (asked[-1], confidence) == (50, 0.95)
    np.testing.assert_array_equal(high, PolytopeComparator(5).simultaneous_bounds(d)[0])


def test_bounds_that_say_nothing_certify_nothing():
    class Ignorant(PolytopeComparator):
        def simultaneous_bounds(self, d):
            return np.full(len(d), np.inf), 1.0

        def update(self, answers):
            known = super().update(answers)
            known.__class__ = Ignorant
            return known

    high, _ = bounds_of_many(Ignorant(3), np.array([[1.0, -2, 1], [0, 0, 0], [-1, 0, 1]]))
    np.testing.assert_array_equal(high, [1, 0, 1])  # what the order of the levels says
    mdp, values = random_mdp(8, 3, 4, seed=1)  # which a polytope certifies
    result = solve(mdp, Ignorant(4), TruthfulTutor(values), exact=False, cuts=False, max_queries=30)
    assert result.status is not Status.CONVERGED


def test_a_comparator_that_bounds_nothing_leaves_a_bound_of_one():
    class Boundless(Dominance):
        def simultaneous_bounds(self, d):
            return np.full(len(d), np.inf), 1.0

    mdp, _ = random_mdp(15, 3, 4, rng=8)
    policy = value_iteration(mdp, np.arange(4.0))[1]
    wanted = loss_bound(mdp, policy, Dominance(4))
    assert tuple(loss_bound(mdp, policy, Boundless(4))) == pytest.approx((wanted.loss_bound, 1.0))
    learner = InteractivePolicyIteration(mdp, Boundless(4), max_queries=0)
    learner.ask()
    assert 0 < learner.result().loss_bound <= 1
    assert learner.result().confidence == 1


def test_where_a_comparator_has_no_draws_they_are_of_all_ordered_scales() -> None:
    gaps, weights, _ = draws_of(AlwaysAsk(4))
    assert gaps.shape == (3, len(weights))
    assert gaps.min() >= 0
    assert gaps.sum(axis=0) == pytest.approx(1)
    assert gaps.mean(axis=1) == pytest.approx(1 / 3, abs=0.05)
