"""Advantages that are left out in a large model are worse under every plausible scale."""

import numpy as np
import pytest

from elicit import AlwaysAsk, Answers, PolytopeComparator, PosteriorComparator, TruthfulTutor
from qlearn import InteractivePolicyIteration, drive, evaluate_policy, policy_loss, random_mdp
from qlearn.certificates.advantages import advantages_over
from qlearn.certificates.box_bounds import bounds_of_many
from qlearn.certificates.loss_bound import collected
from qlearn.certificates.screening import screened
from qlearn.learners.rounds import sampled
from qlearn.mdp import warm_planning
from tests.mdp_cases import messy_mdp
from tests.thoroughness import scaled


def known(k, values, rounds, rng, **settings):
    """A comparator that has learned a few true answers."""
    comparator = PolytopeComparator(k, **settings)
    d = np.diff(rng.dirichlet(np.ones(k), size=2 * rounds).reshape(rounds, 2, k), axis=1)[:, 0]
    for number, each in enumerate(d):
        sign = np.sign(each @ values)
        answer = Answers(np.array([each]), np.array([int(sign)], dtype=np.int8), (f"a{number}",))
        comparator = comparator.update(answer)
    return comparator


@pytest.mark.parametrize("k", [2, 3, 6])
@pytest.mark.parametrize("wrong", [0.0, 1e-3])
@pytest.mark.parametrize("seed", range(scaled(3, 12)))
def test_what_is_left_out_has_bounds_that_hold_and_the_rest_is_computed(seed, wrong, k):
    rng = np.random.default_rng(seed)
    mdp, values = random_mdp(60, 4, k, rng=seed) if seed % 2 else messy_mdp(seed, n=40, k=k)
    values = mdp.normalise(values)
    comparator = known(k, values, 3 * k, rng)
    policy = np.argmax(mdp.admissible, axis=1)
    v = evaluate_policy(mdp, policy)
    if wrong:
        v = np.maximum(v + wrong * rng.standard_normal(v.shape), 0.0)
        v /= v.sum(axis=1, keepdims=True)
    every = advantages_over(mdp, policy, v)
    found = screened(mdp, policy, v, comparator, 0.0)
    listed = {place: row for row, place in enumerate(zip(every.states, every.actions, strict=True))}
    here = [
        listed[place]
        for place in zip(found.advantages.states, found.advantages.actions, strict=True)
    ]
    np.testing.assert_allclose(found.advantages.d, every.d[here], atol=1e-15)
    assert found.advantages.doubt == pytest.approx(every.doubt, abs=1e-14)
    others = np.setdiff1d(np.arange(len(every.d)), here)
    assert len(others) == found.left_out == np.isfinite(found.rest).sum()
    bounds = found.rest[every.states[others], every.actions[others]]
    assert (bounds <= 0).all()
    if len(others):
        assert (comparator.bounds(every.d[others])[1] <= bounds + 1e-9).all()
    assert seed % 2 == 0 or len(others)
    high, some = (bounds_of_many(comparator, each.d)[0] for each in (every, found.advantages))
    start = np.zeros(mdp.n_states)
    whole = collected(mdp, every, high, start, 1e-6)
    part = collected(mdp, found.advantages, some, start, 1e-6, found.rest)
    assert (part >= whole - 2e-6).all()


def test_a_comparator_without_a_proven_box_leaves_nothing_out():
    mdp, _ = random_mdp(20, 3, 4, rng=1)
    policy = np.zeros(20, dtype=np.int64)
    for comparator in (AlwaysAsk(4), PosteriorComparator(4, particles=60)):
        assert screened(mdp, policy, evaluate_policy(mdp, policy), comparator, 0.0) is None


@pytest.mark.parametrize("wrong", [0, 1])
def test_a_run_that_screens_asks_the_same_and_counts_every_alternative(monkeypatch, wrong):
    mdp, values = random_mdp(scaled(60, 300), 4, 5, rng=3)
    monkeypatch.setattr(warm_planning, "LARGE", 0)
    found = []
    for large in (10**12, 0):
        monkeypatch.setattr(sampled, "LARGE", large)
        learner = InteractivePolicyIteration(
            mdp, PolytopeComparator(5, wrong=wrong), tolerance=0.002, exact=False
        )
        result = drive(learner, TruthfulTutor(values))
        assert policy_loss(mdp, result.policy, values).max() <= result.loss_bound <= 0.002
        found.append(result)
    one, other = found
    assert one.asked == other.asked
    assert one.loss_bound == pytest.approx(other.loss_bound, abs=sampled.TUNING.error * 0.002)
    np.testing.assert_array_equal(one.policy, other.policy)
    assert sum(one.decided.values()) == sum(other.decided.values())
