"""A posterior over both orders of two levels, held to weighted draws from the prior."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.special import expit

import elicit
import qlearn
from elicit import Answers, FlippingTutor, OpenOrderPosterior, PosteriorComparator, Verdict
from elicit.testing import check_comparator
from tests.thoroughness import quick_first

FEW = 300  # particles enough for rough checks


def scale(rng: np.random.Generator, k: int, unordered: tuple[int, int], swap: bool) -> Any:
    """A hidden scale of either order, from 0 to 1."""
    values = np.concatenate([[0.0], np.cumsum(rng.dirichlet(np.ones(k - 1)))])
    if swap:
        values[list(unordered)] = values[list(unordered)[::-1]]
    return (values - values.min()) / (values.max() - values.min())


def says(values: Any, d: Any, flips: Any) -> Any:
    """Signs (n,) of a tutor of these values who is wrong where ``flips`` (n,) says so."""
    return np.sign(np.asarray(d) @ values).astype(np.int8) * np.where(flips, -1, 1)


@pytest.mark.parametrize("unordered", quick_first([(2, 3), (0, 1), (1, 2)], 1))
def test_it_conforms(unordered: tuple[int, int]) -> None:
    check_comparator(OpenOrderPosterior(4, unordered, particles=FEW))


@pytest.mark.parametrize("seed", quick_first(range(6), 2))
def test_orders_and_signs_are_as_likely_as_weighted_draws_from_the_prior_say(seed: int) -> None:
    rng, k, pair = np.random.default_rng(seed), 4, (0, 1)
    d = rng.multinomial(10, np.ones(k) / k, 12) / 10 - rng.multinomial(10, np.ones(k) / k, 12) / 10
    y = says(scale(rng, k, pair, bool(seed % 2)), d, rng.random(12) < 0.1)
    told = Answers(d[y != 0], y[y != 0])
    known = OpenOrderPosterior(k, pair, particles=1500, seed=seed).update(told)

    prior = PosteriorComparator(k, particles=40_000, seed=seed + 100, tie=0.0)
    (gaps, weights, precision), lapse = prior.draws, prior.lapses
    scores, likelihoods = [], []
    tried = rng.dirichlet(np.ones(k), 20) - rng.dirichlet(np.ones(k), 20)
    for order in ((0, 1, 2, 3), (1, 0, 2, 3)):
        values = np.zeros((k, gaps.shape[1]))
        values[list(order[1:])] = np.cumsum(gaps, axis=0)
        right = (
            lapse / 2 + (1 - lapse) * expit(precision * (row @ values))
            for row in told.d * told.y[:, None]
        )
        likelihoods.append(weights * np.prod([*right], axis=0))
        scores.append(tried @ values > 0)
    evidence = np.sum(likelihoods, axis=1)
    assert known.order_probabilities[0] == pytest.approx(evidence[0] / evidence.sum(), abs=0.06)
    signs = sum(own @ part for own, part in zip(scores, likelihoods, strict=True)) / evidence.sum()
    assert known.probability(tried) == pytest.approx(signs, abs=0.08)


def test_an_answer_that_orders_the_two_levels_is_learned_and_one_slip_is_forgiven() -> None:
    known = OpenOrderPosterior(3, (0, 1), particles=FEW)
    apart = np.array([[-1.0, 1.0, 0.0]])
    assert known.order_probabilities.tolist() == [0.5, 0.5]
    assert known.compare(apart).tolist() == [Verdict.UNKNOWN]
    likely = []
    for y in (-1, -1, 1, -1, -1, -1, -1, -1):
        known = known.update(Answers(apart, [y]))
        likely.append(float(known.order_probabilities[1]))
    assert likely[0] > 0.5
    assert likely[2] < likely[1], "a contradiction makes it less certain"
    assert likely[-1] > 0.95
    assert known.compare(apart).tolist() == [Verdict.WORSE]
    assert known.values[1] < known.values[0] < known.values[2]
    assert "given order" in repr(known)


def test_a_taken_back_answer_was_never_there() -> None:
    rng = np.random.default_rng(3)
    d = rng.dirichlet(np.ones(4), 5) - rng.dirichlet(np.ones(4), 5)
    blank = OpenOrderPosterior(4, (1, 2), particles=FEW)
    both = blank.update(Answers(d, [1, -1, 1, 1, 0], list("abcde"))).retract("b", "e")
    rest = blank.update(Answers(d[[0, 2, 3]], [1, 1, 1], list("acd")))
    assert (both.draws.gaps == rest.draws.gaps).all()
    assert (both.order_probabilities == rest.order_probabilities).all()
    assert both.answers.ids == rest.answers.ids


def test_the_best_alternative_is_found_though_some_answers_are_wrong() -> None:
    rng, right = np.random.default_rng(5), 0
    for seed in range(4):
        values = scale(rng, 4, (0, 1), bool(seed % 2))
        options = rng.dirichlet(np.ones(4), 5)
        choice = elicit.choose(
            options, OpenOrderPosterior(4, (0, 1), particles=FEW, seed=seed), max_queries=40
        )
        while queries := choice.ask():
            signs = says(values, [query.d for query in queries], rng.random(len(queries)) < 0.1)
            choice.tell([elicit.Answer(q, int(s)) for q, s in zip(queries, signs, strict=True)])
        lost = (options @ values).max() - (options @ values)[choice.result().best]
        right += lost < 0.05
    assert right >= 3


def test_policy_iteration_proves_a_policy_of_either_order_and_others_refuse_it() -> None:
    kept = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        mdp, _ = qlearn.random_mdp(8, 3, 4, discount=0.8, seed=seed)
        values = scale(rng, 4, (0, 1), bool(seed % 2))
        known = OpenOrderPosterior(4, (0, 1), particles=FEW, seed=seed)
        learner = qlearn.InteractivePolicyIteration(mdp, known, tolerance=0.05, max_queries=60)
        while queries := learner.ask():
            signs = says(values, [q.d for q in queries], rng.random(len(queries)) < 0.05)
            learner.tell([elicit.Answer(q, int(s)) for q, s in zip(queries, signs, strict=True)])
        result = learner.result()
        best = max_values(mdp, values)
        lost = (1 - mdp.discount) * (best - values_under(mdp, result.policy, values)).max()
        kept.append(lost <= result.loss_bound + 1e-9)
        assert result.confidence == 0.95
    assert all(kept)
    with pytest.raises(ValueError, match="order of levels 1 and 2 open"):
        qlearn.InteractiveQLearning(mdp, known, seed=0)


def values_under(mdp: qlearn.OrdinalMDP, policy: Any, values: Any) -> Any:
    """The return (S,) of a policy where the levels are worth ``values``."""
    table = np.asarray(mdp.transitions.toarray()).reshape(mdp.n_states, mdp.n_actions, -1)
    at = np.arange(mdp.n_states), policy
    reward = values[mdp.levels[at]]
    return np.linalg.solve(np.eye(mdp.n_states) - mdp.discount * table[at], reward)


def max_values(mdp: qlearn.OrdinalMDP, values: Any) -> Any:
    """The greatest return (S,), by value iteration."""
    table = np.asarray(mdp.transitions.toarray()).reshape(mdp.n_states, mdp.n_actions, -1)
    found = np.zeros(mdp.n_states)
    for _ in range(400):
        found = (values[mdp.levels] + mdp.discount * table @ found).max(axis=1)
    return found


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda: OpenOrderPosterior(4, (0, 2)), "two neighbouring levels.*not \\(0, 2\\)"),
        (lambda: OpenOrderPosterior(4, level=0.4), "level must be strictly between 1/2 and 1"),
        (lambda: OpenOrderPosterior(3).update(Answers.none(4)), "4 levels.*k = 3"),
        (lambda: OpenOrderPosterior(3, particles=3), "particles must be a whole number"),
    ],
)
def test_bad_input_is_named(call: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        call()


def test_a_tutor_of_the_other_order_is_refused_by_others_but_not_here() -> None:
    with pytest.raises(ValueError, match="increase"):
        FlippingTutor([0.2, 0.0, 1.0], 0.1)


def test_bounds_of_all_rows_at_once_hold_under_the_level_of_the_draws() -> None:
    known = OpenOrderPosterior(4, (1, 2), particles=FEW)
    d = np.array([[-0.5, 1, 0, -0.5], [0, 1, -1, 0], [-0.3, 0, 1, -0.7]])
    high, confidence = known.simultaneous_bounds(d)
    gaps, weights, _ = known.draws
    holds = (np.cumsum(d[:, ::-1], axis=1)[:, -2::-1] @ gaps <= high[:, None] + 1e-12).all(axis=0)
    assert confidence == known.level
    held = weights[holds].sum()
    assert known.level - 1e-9 <= held <= known.level + weights.max()
