"""Eleven ways in which preference elicitation goes wrong without anyone noticing, each held off by
a test.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from elicit import (
    AlwaysAsk,
    Answer,
    AnswerLog,
    Answers,
    BradleyTerryComparator,
    BradleyTerryTutor,
    Comparator,
    Dominance,
    FlippingTutor,
    InconsistentAnswers,
    NotConverged,
    PolytopeComparator,
    Query,
    TruthfulTutor,
    Verdict,
)
from qlearn import (
    InteractiveQLearning,
    InteractiveValueIteration,
    OrdinalMDP,
    Result,
    Status,
    draw_values,
    drive,
    policy_loss,
    random_mdp,
)
from qlearn.learners.exploration import Exploration, Start
from tests.mdp_cases import messy_mdp
from tests.scale_arithmetic import Floats, dominance, tail_sums

Make = Callable[..., Any]


def q_learning(mdp: OrdinalMDP, comparator: Comparator, **settings: Any) -> InteractiveQLearning:
    return InteractiveQLearning(
        mdp, comparator, **{"steps": 600, "epsilon": Exploration(0.3), "rng": 1, **settings}
    )


def value_iteration(
    mdp: OrdinalMDP, comparator: Comparator, **settings: Any
) -> InteractiveValueIteration:
    """Return value iteration with the paper's sweeps.

    They ask more, so that each trap is met on a small problem.
    """
    paper = {"tolerance": 0.01, "rng": 1, "partial_sweeps": False}
    return InteractiveValueIteration(mdp, comparator, **paper | settings)


both = pytest.mark.parametrize("make", [q_learning, value_iteration])


def open_differences(k: int, n: int, seed: int) -> Floats:
    """Differences (n, k) of uniform distributions over levels that dominance does not decide."""
    pairs = np.random.default_rng(seed).dirichlet(np.ones(k), size=(20 * n, 2))
    d = pairs[:, 0] - pairs[:, 1]
    d = d[dominance(tail_sums(d)) == Verdict.UNKNOWN][:n]
    assert len(d) == n
    return d


def wrong_answers(result: Result, values: Floats) -> int:
    """Count the answers that contradict the hidden scale."""
    return int((TruthfulTutor(values).signs(result.answers.d) * result.answers.y < 0).sum())


class RawTutor:
    """Never wrong about the numeric rewards as they are, whose worst level is not worth 0."""

    def __init__(self, values: Floats) -> None:
        self.values = values

    def __call__(self, query: Query) -> Answer:
        return Answer(query, Verdict(int(np.sign(query.d @ self.values))))


def runs_with_raw_rewards(start: Start) -> list[tuple[Result, OrdinalMDP, Floats]]:
    runs = []
    for seed in range(4):
        mdp, values = random_mdp(8, 3, 4, discount=0.9, rng=seed)
        raw = values + 50.0
        learner = q_learning(
            mdp,
            PolytopeComparator(4),
            epsilon=Exploration(0.3, start=start),
            rng=seed,
            learning_rate=0.1,
        )
        runs.append((drive(learner, RawTutor(raw), on_conflict="drop"), mdp, values))
    return runs


def test_trap_1_totals_differ_from_the_zero_start_and_never_from_the_worst() -> None:
    mdp, values = random_mdp(10, 3, 5, rng=0)
    zero = drive(
        q_learning(mdp, PolytopeComparator(5), epsilon=Exploration(0.3, start="zero")),
        TruthfulTutor(values),
    )
    worst = drive(q_learning(mdp, PolytopeComparator(5)), TruthfulTutor(values))
    assert np.ptp(zero.q.sum(axis=2)) > 0.1
    np.testing.assert_allclose(worst.q.sum(axis=2), 1.0, rtol=0, atol=1e-13)
    totals = worst.answers.d.sum(axis=1)
    np.testing.assert_allclose(totals, 0.0, rtol=0, atol=1e-13)
    sweeps = drive(value_iteration(mdp, PolytopeComparator(5)), TruthfulTutor(values))
    np.testing.assert_allclose(sweeps.q.sum(axis=2), 1.0, rtol=0, atol=1e-12)
    # where e_1 = 0, mass on the worst level changes no preference
    assert (worst.q[:, :, 1:] == zero.q[:, :, 1:]).all()
    assert worst.policy.tolist() == zero.policy.tolist()
    assert worst.answers.y.tolist() == zero.answers.y.tolist()


def test_trap_1_from_the_zero_start_a_truthful_tutor_can_exclude_the_truth() -> None:
    # 50 e_1 times a difference in totals is nothing about the scale, but the polytope cannot know
    assert (
        sum(wrong_answers(result, values) for result, _, values in runs_with_raw_rewards("zero"))
        > 0
    )


def test_trap_1_from_the_worst_start_raw_rewards_are_as_good_as_normalised_ones() -> None:
    for result, mdp, values in runs_with_raw_rewards("worst"):
        assert wrong_answers(result, values) == 0
        normal = drive(
            q_learning(mdp, PolytopeComparator(4), learning_rate=0.1), TruthfulTutor(values)
        )
        assert result.status is normal.status is Status.DONE


@pytest.mark.parametrize("seed", range(4))
def test_trap_2_an_exact_oracle_for_free(seed: int) -> None:
    # which is Q-learning on the true values: tests/qlearn/learners/test_q_learning.py; and integers
    # drawn from 0..99 without replacement lie at least 1/99 of the range apart, above any of these
    # margins
    for mdp, values in (random_mdp(15, 4, 6, rng=seed), messy_mdp(seed, n=15, k=5)):
        oracle = drive(
            q_learning(mdp, AlwaysAsk(mdp.k), rng=seed, steps=1500), TruthfulTutor(values)
        )
        for margin in (1e-6, 0.009):
            made = q_learning(mdp, PolytopeComparator(mdp.k, margin=margin), rng=seed, steps=1500)
            fewer = drive(made, TruthfulTutor(values))
            assert fewer.q.tobytes() == oracle.q.tobytes()
            assert fewer.policy.tolist() == oracle.policy.tolist()
            assert fewer.asked < oracle.asked / 10
            assert fewer.compared == oracle.compared


def test_trap_2_interactive_value_iteration_is_value_iteration() -> None:
    mdp, values = random_mdp(12, 4, 6, discount=0.9, rng=0)
    for tolerance in (0.1, 0.001):
        result = drive(
            value_iteration(mdp, PolytopeComparator(6), tolerance=tolerance), TruthfulTutor(values)
        )
        assert policy_loss(mdp, result.policy, values).max() <= tolerance


def equal_actions() -> OrdinalMDP:
    """Three actions that do the same, in each of four states."""
    successors = np.repeat(np.array([[1], [2], [3], [0]])[:, None, :], 3, axis=1)
    levels = np.repeat(np.arange(4)[:, None], 3, axis=1)
    return OrdinalMDP(successors, np.ones((4, 3, 1)), levels, 0.9, ("a", "b", "c", "d"))


def test_trap_3_ties_keep_the_incumbent_and_ask_nothing() -> None:
    mdp = equal_actions()
    for comparator in (
        AlwaysAsk(4),
        PolytopeComparator(4),
        Dominance(4),
        BradleyTerryComparator(4, n_boot=10),
    ):
        learner = value_iteration(mdp, comparator)
        assert learner.ask() == ()
        result = learner.result()
        assert result.policy.tolist() == [0, 0, 0, 0]
        assert result.decided["equal"] == result.compared > 0


def test_trap_3_untouched_vectors_are_ties() -> None:
    # discount 0, rate 1, everything at the worst level: no update ever tells two actions apart
    mdp, _ = random_mdp(6, 3, 4, discount=0.0, rng=0)
    worst_only = OrdinalMDP(mdp.successors, mdp.probabilities, np.zeros((6, 3)), 0.0, mdp.labels)
    learner = q_learning(worst_only, AlwaysAsk(4), learning_rate=1.0)
    first = learner.result().policy.tolist()
    result = drive(learner, refuse)
    assert result.policy.tolist() == first
    assert result.decided["equal"] == result.compared > 0


def refuse(query: Query) -> Answer:
    raise AssertionError(f"nothing to ask: {query}")


@pytest.mark.parametrize("region", ["ensemble", "box"])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_trap_4_few_answers_leave_most_pairs_open(region: Any, n: int) -> None:
    for seed in range(3):
        d = open_differences(8, n + 500, seed)
        signs = TruthfulTutor(draw_values(8, seed)).signs(d)
        comparator = BradleyTerryComparator(8, region=region, n_boot=50, min_answers=1, seed=seed)
        fitted = comparator.update(Answers(d[:n], signs[:n]))
        low, high = fitted.bounds(d[n:])
        assert (high - low > 1e-3).all()  # spread, on every pair
        assert (fitted.compare(d[n:]) == Verdict.UNKNOWN).mean() > 0.5


@both
def test_trap_4_a_learner_with_few_answers_asks(make: Make) -> None:
    mdp, values = random_mdp(10, 3, 8, discount=0.9, rng=0)
    result = drive(make(mdp, BradleyTerryComparator(8, n_boot=50)), TruthfulTutor(values))
    assert result.asked > 10


def test_trap_5_a_learner_without_a_prior_says_so() -> None:
    mdp, values = random_mdp(6, 3, 5, discount=0.9, rng=0)
    learner = q_learning(mdp, BradleyTerryComparator(5, n_boot=10, prior_strength=0.0), steps=100)
    with pytest.warns(NotConverged):
        drive(learner, TruthfulTutor(values))


def test_trap_6_an_ensemble_decides_much_more_than_a_box_at_no_more_error() -> None:
    decided, wrong = {"box": 0, "ensemble": 0}, {"box": 0, "ensemble": 0}
    for seed in range(3):
        values = draw_values(10, seed)
        told, fresh = open_differences(10, 100, seed), open_differences(10, 500, seed + 9)
        tutor = BradleyTerryTutor.from_error_rate(values, 0.15, told, seed=seed)
        answers, truth = Answers(told, tutor.signs(told)), TruthfulTutor(values).signs(fresh)
        for region in decided:
            verdicts = (
                BradleyTerryComparator(10, region=region, seed=seed).update(answers).compare(fresh)
            )  # type: ignore[arg-type]
            said = np.abs(verdicts) == 1
            decided[region] += int(said.sum())
            wrong[region] += int((verdicts[said] != truth[said]).sum())
    assert decided["ensemble"] > 2 * decided["box"]
    assert decided["ensemble"] > 0.3 * 1500
    for region in decided:
        assert wrong[region] <= 0.05 * decided[region]


@both
def test_trap_7_without_audits_a_wrong_answer_never_shows(make: Make) -> None:
    excluded = 0
    for seed in range(8):
        mdp, values = random_mdp(8, 3, 5, discount=0.9, rng=seed)
        tutor = FlippingTutor(values, 0.15, seed=seed)
        result = drive(make(mdp, PolytopeComparator(5)), tutor)  # raises nothing
        excluded += wrong_answers(result, values) > 0
        assert result.audited == 0
    assert excluded >= 3  # though the truth was excluded, and every later verdict rests on that


@both
def test_trap_7_audits_find_a_wrong_answer(make: Make) -> None:
    found = 0
    for seed in range(4):
        mdp, values = random_mdp(8, 3, 5, discount=0.9, rng=seed)
        plain = drive(make(mdp, PolytopeComparator(5)), FlippingTutor(values, 0.15, seed=seed))
        learner = make(mdp, PolytopeComparator(5), audit=1.0)
        if not wrong_answers(plain, values):
            continue
        with pytest.raises(InconsistentAnswers) as raised:
            drive(learner, FlippingTutor(values, 0.15, seed=seed))
        (query,) = learner.ask()
        assert query.id in [
            name for _, name in raised.value.answers
        ]  # the audit's own error, perhaps
        assert not raised.value.margin or "margin" in str(raised.value)
        found += 1
    assert found


@both
def test_trap_7_dropping_a_contradiction_settles_its_pair_and_the_run_goes_on(make: Make) -> None:
    mdp, values = random_mdp(8, 3, 5, discount=0.9, rng=2)
    log = AnswerLog()
    learner, tutor = (
        make(mdp, PolytopeComparator(5), audit=0.3),
        FlippingTutor(values, 0.15, seed=2),
    )
    result = drive(learner, tutor, log=log, on_conflict="drop")
    unused = [entry for entry in log if not entry.used]
    assert unused
    # acting on a wrong audit now and then keeps the vectors of value iteration moving
    assert result.status in (Status.DONE, Status.CONVERGED, Status.SWEEP_LIMIT)
    assert len(log) == result.asked + result.audited
    assert len(result.answers) == len(log) - len(unused)
    assert {entry.answer.query.id for entry in unused} <= {
        audit.query.id for audit in result.audits
    }
    # what is left is consistent, told at once too
    PolytopeComparator(5).update(result.answers)


@both
def test_trap_8_a_margin_above_the_least_gap_is_named_when_the_truth_contradicts_it(
    make: Make,
) -> None:
    # gaps of (39, 57, 84, 87, 89) are .36, .54, .06, .04 of the range: equal gaps are far from the
    # truth
    mdp, values = random_mdp(8, 3, 5, discount=0.9, rng=0)
    assert np.diff(mdp.normalise(values)).min() < 0.25
    with pytest.raises(InconsistentAnswers, match=r"margin 0\.25") as raised:
        drive(make(mdp, PolytopeComparator(5, margin=0.25), audit=1.0), TruthfulTutor(values))
    assert raised.value.margin
    harmless = drive(
        make(mdp, PolytopeComparator(5, margin=0.009), audit=1.0), TruthfulTutor(values)
    )
    assert harmless.status is not Status.WAITING


def test_trap_9_a_precision_means_nothing_without_the_spread_of_differences() -> None:
    values, d = draw_values(6, 0), open_differences(6, 2000, 0)
    tutor = BradleyTerryTutor.from_error_rate(values, 0.1, d, seed=1)
    tutor.signs(d)
    assert abs(tutor.realised_error_rate - 0.1) < 0.03
    same_precision = BradleyTerryTutor(values, tutor.precision, seed=1)
    same_precision.signs(d / 20)  # near convergence vectors are that close
    assert same_precision.realised_error_rate > 0.3
    matched = BradleyTerryTutor.from_error_rate(values, 0.1, d / 20, seed=1)
    matched.signs(d / 20)
    assert abs(matched.realised_error_rate - 0.1) < 0.03
    assert matched.precision == pytest.approx(20 * tutor.precision, rel=1e-6)


@both
def test_trap_9_the_realised_error_rate_of_a_run_is_known(make: Make) -> None:
    mdp, values = random_mdp(10, 3, 5, discount=0.9, rng=0)
    tutor = FlippingTutor(values, 0.15, seed=0)
    result = drive(make(mdp, BradleyTerryComparator(5, n_boot=20), max_queries=60), tutor)
    assert tutor.realised_error_rate == wrong_answers(result, values) / result.asked


def test_trap_10_batches_cost_questions() -> None:
    asked = dict.fromkeys((1, 4, 1000), 0)
    for seed in range(4):
        mdp, values = random_mdp(20, 3, 8, discount=0.8, rng=seed)
        for batch in asked:
            learner = value_iteration(mdp, PolytopeComparator(8), batch=batch)
            asked[batch] += drive(learner, TruthfulTutor(values)).asked
    assert asked[1] < asked[4] <= asked[1000]
    mdp, values = random_mdp(20, 4, 8, discount=0.9, rng=0)
    assert len(value_iteration(mdp, PolytopeComparator(8)).ask()) == 1  # unless told otherwise


@both
def test_trap_11_what_dominance_settles_is_reported(make: Make) -> None:
    mdp, values = random_mdp(10, 3, 5, discount=0.9, rng=0)
    result = drive(make(mdp, PolytopeComparator(5)), TruthfulTutor(values))
    alone = drive(make(mdp, Dominance(5)), TruthfulTutor(values))
    assert 0 < result.decided["dominance"] < result.compared == sum(result.decided.values())
    assert result.decided["dominance"] == alone.decided["dominance"]
    settled = sum(alone.decided[tier] for tier in ("dominance", "equal", "known", "indifferent"))
    assert alone.asked == alone.compared - settled


@both
@pytest.mark.parametrize("region", ["ensemble", "box"])
def test_trap_11_a_model_of_noise_loses_little_where_the_tutor_errs_seldom(
    make: Make, region: Any
) -> None:
    limit = {"max_sweeps": 30} if make is value_iteration else {"steps": 400}
    for seed, (mdp, values) in enumerate(
        (random_mdp(8, 3, 5, discount=0.8, rng=0), messy_mdp(1, k=5, discount=0.8))
    ):
        d = open_differences(5, 300, seed)
        logistic = BradleyTerryTutor.from_error_rate(values, 0.05, d / 10, seed=seed)
        for tutor in (FlippingTutor(values, 0.05, seed=seed), logistic):
            result = drive(
                make(mdp, BradleyTerryComparator(5, n_boot=30, region=region), **limit), tutor
            )
            assert result.status in (Status.DONE, Status.CONVERGED, Status.SWEEP_LIMIT)
            assert mdp.admissible[np.arange(mdp.n_states), result.policy].all()
            assert policy_loss(mdp, result.policy, values).mean() < 0.1
