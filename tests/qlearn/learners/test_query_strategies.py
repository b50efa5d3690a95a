"""Question strategies against their formulas written out, and learners that put questions off."""

import inspect
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from elicit import (
    AlwaysAsk,
    Answer,
    Answers,
    Dominance,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
)
from elicit._support.fixed_order import product
from elicit.asking.bags import Bags, entropy
from elicit.asking.elicitation import Elicitation
from elicit.model.difference import tail_sums
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    InteractiveValueIteration,
    LateQLearning,
    LateValueIteration,
    Status,
    drive,
    policy_loss,
    random_mdp,
    strategies,
)
from qlearn.learners.query_strategies import Candidates, simple_pair
from tests.thoroughness import on_any_processor, quick_first, scaled

ALL = (
    strategies.first_come,
    strategies.widest_bound,
    strategies.max_regret,
    strategies.most_even_cut,
    strategies.mutual_information,
    strategies.telling_violation,
)


def candidates(comparator, n=7, limit=0.05, seed=0):
    rng = np.random.default_rng(seed)
    k = comparator.k
    d = rng.dirichlet(np.ones(k), n) - rng.dirichlet(np.ones(k), n)
    return Candidates(d, np.arange(n), np.zeros(n, np.int64), limit, comparator)


def posterior():
    d = np.array([[0.5, -0.5, 0.0, 0.0], [0.2, -0.6, 0.4, 0.0], [0.0, 0.5, -0.9, 0.4]])
    return PosteriorComparator(4, lapse=0.2, particles=40, seed=3).update(Answers(d, [-1, 1, 1]))


def bits(p):
    return 0.0 if p in (0.0, 1.0) else -p * math.log2(p) - (1 - p) * math.log2(1 - p)


def test_each_strategy_is_its_formula():
    pool = candidates(posterior())
    gaps, weights, precision = pool.comparator.draws
    even, told, beyond = [], [], []
    for d in pool.d:
        up = down = mean = noise = over = 0.0
        for j, w in enumerate(weights):
            e = np.concatenate([[0.0], np.cumsum(gaps[:, j])])
            score = float(d @ e)
            p = (
                0.1 + 0.8 / (1.0 + math.exp(-precision[j] * score))
                if precision[j] * score > -700
                else 0.1
            )
            up, down, over = up + w * (score > 0), down + w * (score < 0), over + w * (score > 0.05)
            mean, noise = mean + w * p, noise + w * bits(p)
        even.append(min(up, down))
        told.append(bits(mean) - noise)
        beyond.append(over)
    np.testing.assert_allclose(strategies.most_even_cut(pool), even, atol=1e-12)
    np.testing.assert_allclose(strategies.mutual_information(pool), told, atol=1e-9)
    np.testing.assert_allclose(strategies.violated_weight(pool), beyond, atol=1e-12)
    joint = np.array(told) * (np.array(beyond) + 1 / 40)
    np.testing.assert_allclose(strategies.telling_violation(pool), joint, atol=1e-9)
    assert strategies.first_come(pool).argmax() == 0


def test_bounds_of_a_polytope_give_the_widest_and_the_greatest_regret():
    comparator = PolytopeComparator(5).update(Answers([[0.3, -0.6, 0.0, 0.3, 0.0]], [1]))
    pool = candidates(comparator)
    low, high = comparator.bounds(pool.d)
    np.testing.assert_allclose(strategies.max_regret(pool), high, atol=1e-8)
    np.testing.assert_allclose(strategies.widest_bound(pool), high - low, atol=1e-8)


def test_a_truthful_tutor_tells_the_entropy_of_the_cut():
    pool = candidates(PolytopeComparator(4))
    np.testing.assert_allclose(
        strategies.mutual_information(pool), entropy((pool.scores > 0) @ pool.weights), atol=1e-9
    )


def test_a_comparator_without_draws_is_served_by_all_ordered_scales():
    pool = candidates(Dominance(4))
    assert pool.scores.shape == (7, len(pool.weights))
    assert all(np.isfinite(strategy(pool)).all() for strategy in ALL)


def test_the_strategy_of_the_documentation_is_one():
    source = strategies.__doc__.split("Your own:\n")[1].split("\n``candidates")[0]
    namespace: dict = {}
    exec("\n".join(line.removeprefix("    ") for line in source.splitlines()), namespace)
    own = namespace["closest_to_even_odds"]
    pool = candidates(PolytopeComparator(4))
    assert own(pool).shape == (7,)
    assert strategies.best(own, pool) == strategies.best(strategies.most_even_cut, pool)
    mdp, values = random_mdp(20, 3, 4, rng=0)
    learner = InteractivePolicyIteration(mdp, PolytopeComparator(4), tolerance=0.01, strategy=own)
    assert drive(learner, TruthfulTutor(values)).status is Status.CONVERGED


@pytest.mark.parametrize("strategy", quick_first(ALL, len(ALL), older=3))
def test_every_strategy_reaches_the_same_promise(strategy):
    mdp, values = random_mdp(20, 3, 5, rng=2)
    for learner in (
        InteractivePolicyIteration(mdp, PolytopeComparator(5), tolerance=1e-3, strategy=strategy),
        LateValueIteration(mdp, PolytopeComparator(5), tolerance=1e-3, strategy=strategy),
    ):
        result = drive(learner, TruthfulTutor(values))
        assert result.status is Status.CONVERGED
        assert policy_loss(mdp, result.policy, values).max() <= 1e-3


def test_scores_that_are_no_numbers_are_refused():
    pool = candidates(PolytopeComparator(4))
    for bad in (lambda c: np.full(7, np.nan), lambda c: np.zeros((7, 1))):
        with pytest.raises(ValueError, match="a strategy must return one number"):
            strategies.best(bad, pool)
    assert strategies.best(lambda c: np.array([0, 2, 1, 2, 0, 0, 0]), pool, 3) == [1, 3, 2]


def test_value_iteration_that_asks_late_keeps_its_promise_with_fewer_questions():
    asked = np.zeros(2)
    for seed in range(2):
        mdp, values = random_mdp(30, 4, 5, discount=0.85, rng=seed)
        for i, learner in enumerate((InteractiveValueIteration, LateValueIteration)):
            result = drive(
                learner(mdp, PolytopeComparator(5), tolerance=1e-3), TruthfulTutor(values)
            )
            asked[i] += result.asked
            assert result.status is Status.CONVERGED
            assert policy_loss(mdp, result.policy, values).max() <= 1e-3
    assert asked[1] <= 0.6 * asked[0]


def test_late_value_iteration_ends_where_the_tutor_errs_or_cannot_tell():
    mdp, values = random_mdp(15, 3, 4, discount=0.8, rng=4)
    comparator = PosteriorComparator(4, lapse=0.2, particles=100)
    make = partial(LateValueIteration, mdp, tolerance=0.01)
    ended = drive(make(comparator), FlippingTutor(values, 0.1, seed=0))
    assert ended.status is (Status.CONVERGED if ended.loss_bound <= 0.01 else Status.DONE)
    spent = drive(make(PolytopeComparator(4), max_queries=2), TruthfulTutor(values))
    assert (spent.status, spent.asked) == (Status.GUESSED, 2)
    silent = drive(make(PolytopeComparator(4), batch=3), lambda query: Answer(query, None))
    assert silent.status is Status.UNSURE
    assert silent.cannot_tell == silent.asked > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "comparator", [PolytopeComparator(4), PosteriorComparator(4, particles=100)]
)
def test_late_q_learning_goes_on_where_the_tutor_cannot_tell(comparator):
    for seed in range(3):
        mdp, values = random_mdp(6, 3, 4, rng=seed)
        learner = LateQLearning(mdp, comparator, steps=3000, rng=seed)
        tutor, asked = TruthfulTutor(values), 0
        while queries := learner.ask():
            asked += 1
            learner.tell(
                [Answer(query, None) if asked % 3 == 1 else tutor(query) for query in queries]
            )
        assert learner.result().status is Status.DONE
        assert learner.result().cannot_tell == (asked + 2) // 3 > 0


@pytest.mark.parametrize(
    ("learner", "settings", "enough"),
    [
        (InteractiveValueIteration, {"tolerance": 1e-4}, 0.1),
        (LateValueIteration, {"tolerance": 1e-4}, 0.1),
        (LateQLearning, {"steps": 20_000, "epsilon": 1.0}, 0.15),
    ],
)
def test_learners_stop_where_the_loss_is_small_enough(learner, settings, enough):
    mdp, values = random_mdp(20, 3, 5, discount=0.9, rng=3)
    comparator, tutor = PolytopeComparator(5), TruthfulTutor(values)
    full = drive(learner(mdp, comparator, **settings), tutor)
    some = drive(learner(mdp, comparator, **settings, max_loss=enough), tutor)
    assert some.status is Status.CERTIFIED
    assert some.rounds < full.rounds
    assert policy_loss(mdp, some.policy, values).max() <= some.loss_bound <= enough


def late_and_usual(mdp, values, seed, particles, **settings):
    """Return the results of both kinds of Q-learning with a tutor who errs."""
    tutor = FlippingTutor(values, 0.1, seed=seed)
    comparator = PosteriorComparator(mdp.k, lapse=0.2, particles=particles, seed=seed)
    learners = [
        learner(mdp, comparator, rng=seed, **settings)
        for learner in (LateQLearning, InteractiveQLearning)
    ]
    return [drive(learner, tutor) for learner in learners]


@on_any_processor
def test_q_learning_that_asks_late_asks_few_and_loses_no_more():
    few, many, lost = 0, 0, []
    for seed in range(scaled(2, 4)):
        mdp, values = random_mdp(30, 3, 5, discount=0.9, rng=seed)
        late, usual = late_and_usual(mdp, values, seed, 150, steps=20_000, epsilon=1.0)
        few, many = few + late.asked, many + usual.asked
        losses = [policy_loss(mdp, r.policy, values).mean() for r in (late, usual)]
        lost.append(losses[0] - losses[1])
        assert late.status is usual.status is Status.DONE
        assert late.rounds == 20_000
    assert few <= 0.6 * many
    assert np.mean(lost) <= 0.002


@pytest.mark.slow
@pytest.mark.parametrize("exploration", ["optimistic", "uniform"])
@pytest.mark.parametrize("k", [10, 20])
def test_asking_late_halves_the_questions_on_the_papers_problems(k, exploration):
    few, many, lost = 0, 0, []
    for seed in range(6):
        mdp, values = random_mdp(100, 5, k, rng=seed)
        late, usual = late_and_usual(mdp, values, seed, 1000, epsilon=exploration)
        known = InteractiveQLearning(mdp, AlwaysAsk(k), rng=seed, epsilon=exploration)
        oracle = drive(known, TruthfulTutor(values))
        few, many = few + late.asked, many + usual.asked
        lost.append(
            policy_loss(mdp, late.policy, values).mean()
            - policy_loss(mdp, oracle.policy, values).mean()
        )
    assert few <= many / 2
    assert abs(np.mean(lost)) <= 0.001


def test_a_budget_that_nothing_was_refused_for_is_no_guess():
    mdp, values = random_mdp(20, 3, 4, rng=0)

    def late(budget):
        learner = LateQLearning(mdp, PolytopeComparator(4), steps=4000, max_queries=budget)
        return drive(learner, TruthfulTutor(values))

    free = late(None)
    assert free.status is late(free.asked).status is Status.DONE
    assert late(free.asked - 1).status is Status.GUESSED


def test_an_oracle_is_asked_at_once_all_the_same():
    mdp, values = random_mdp(10, 3, 4, discount=0.8, rng=4)
    for learners, settings in (
        ((LateValueIteration, InteractiveValueIteration), {"tolerance": 0.01}),
        ((LateQLearning, InteractiveQLearning), {"steps": 500}),
    ):
        late, usual = (
            drive(learner(mdp, AlwaysAsk(4), **settings), TruthfulTutor(values))
            for learner in learners
        )
        assert (late.policy == usual.policy).all()
        assert late.status is usual.status
        assert late.decided["guess"] == 0


def test_late_questions_grow_with_the_logarithm_of_the_steps():
    mdp, values = random_mdp(20, 3, 4, discount=0.9, rng=1)
    asked = []
    for steps in (1_000, 8_000, 64_000):
        learner = LateQLearning(
            mdp, PosteriorComparator(4, particles=100), steps=steps, epsilon=1.0
        )
        asked.append(drive(learner, FlippingTutor(values, 0.1, seed=0)).asked)
    checkpoints = [1 + math.ceil(math.log2(steps / (2 * 60))) for steps in (1_000, 8_000, 64_000)]
    assert all(n <= 6 * stops for n, stops in zip(asked, checkpoints, strict=True))
    assert asked[2] < 8 * max(1, asked[0])


def test_late_questions_are_about_actions_that_were_tried():
    mdp, _ = random_mdp(60, 4, 6, rng=1)
    offered = set()

    def strategy(pool):
        offered.update(zip(pool.states.tolist(), pool.actions.tolist(), strict=True))
        return strategies.first_come(pool)

    learner = LateQLearning(mdp, Dominance(6), steps=60, epsilon=1.0, strategy=strategy)
    drive(learner, lambda query: Answer(query, None))
    assert len(offered) > 3
    assert all(learner.state.visits[pair] > 0 for pair in offered)


def test_late_answers_of_q_learning_settle_their_own_pair_alone():
    # the verdict on a question between two steps must not leak into the loop's next comparison
    mdp, values = random_mdp(12, 3, 4, discount=0.9, rng=9)
    tutor, known = TruthfulTutor(values), PolytopeComparator(4)
    learner = LateQLearning(mdp, known, steps=5_000, epsilon=1.0)
    while queries := learner.ask():
        before = learner.result()
        learner.tell([tutor(query) for query in queries])
        after = learner.result()
        assert after.status is Status.WAITING
        assert after.compared == before.compared + 1
        assert (after.policy == before.policy).all()
    assert learner.result().status is Status.DONE


@on_any_processor
@pytest.mark.parametrize(
    "learner",
    [
        InteractivePolicyIteration,
        LateValueIteration,
        partial(LateQLearning, steps=200, epsilon=1.0),
    ],
)
def test_a_strategy_goes_by_its_name(learner):
    mdp, values = random_mdp(12, 3, 8, discount=0.9, seed=2)
    asked = {}
    for name in ("first_come", "max_regret"):
        by_name, itself = (
            drive(
                learner(mdp, PolytopeComparator(8), strategy=strategy, max_queries=8),
                TruthfulTutor(values),
            ).answers.ids
            for strategy in (name, getattr(strategies, name))
        )
        assert by_name == itself
        asked[name] = by_name
    assert asked["first_come"] != asked["max_regret"]
    with pytest.raises(
        ValueError, match=r"strategy must be .* one of the names first_come, .*, not 'max regret'"
    ):
        learner(mdp, PolytopeComparator(8), strategy="max regret")


def test_every_strategy_has_its_name():
    functions = {name: made for name, made in vars(strategies).items() if inspect.isfunction(made)}
    takes = {name: [*inspect.signature(made).parameters] for name, made in functions.items()}
    assert {name for name in functions if takes[name] == ["candidates"]} == set(
        strategies.STRATEGIES
    )
    assert all(strategies.strategy_of(name) is functions[name] for name in strategies.STRATEGIES)


def test_the_module_lists_its_strategies_and_little_else():
    listed = dir(strategies)
    assert (
        set(strategies.STRATEGIES) | {"STRATEGIES", "Candidates", "Strategy"}
        == set(listed)
        == set(strategies.__all__)
    )
    namespace = {}
    exec("from qlearn.learners.query_strategies import *", namespace)
    assert set(strategies.__all__) <= set(namespace)


@pytest.mark.parametrize("seed", range(3))
def test_who_called_five_near_pairs_equal_is_asked_no_bag_that_is_as_near(seed):
    k, tie = 5, 0.1
    rng = np.random.default_rng(seed)
    e = np.concatenate([[0.0], np.sort(rng.random(k - 2)), [1.0]])
    d = rng.dirichlet(np.ones(k), 20) - rng.dirichlet(np.ones(k), 20)
    comparator = PolytopeComparator(k, tie=tie).update(Answers(d, np.sign(d @ e).astype(int)))
    elicitation = Elicitation(comparator, "x")
    elicitation._near_ties = replace(elicitation._near_ties, in_a_row=5)
    assert elicitation.gave_up
    about = rng.dirichlet(np.ones(k), 8) - rng.dirichlet(np.ones(k), 8)
    some = Candidates(about, np.arange(8), np.zeros(8, np.int64), 0.0, comparator)
    pair = simple_pair(elicitation, Bags(), some, about, list("abcde"))
    assert pair is not None
    worth = np.abs(product(tail_sums((pair.left - pair.right)[None]), some.draws.gaps))
    assert worth.max() > elicitation.indifference > comparator.tie
