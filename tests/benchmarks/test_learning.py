"""The learning benchmark: its rivals learn what the learner learns, its limit is what it says, its
tables render.
"""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.learning import learning_cost as learning
from benchmarks.learning import learning_growth, learning_runs
from benchmarks.learning import plain_q_learning as plain
from benchmarks.learning.known_values import Knowing
from benchmarks.learning.learning_runs import Setting
from benchmarks.learning.learning_tables import Kind, Limit, Row, Text, number, render, took
from benchmarks.own_process import Failed, apart
from benchmarks.quotes import table_rows
from elicit import Answers, PolytopeComparator, TruthfulTutor, Verdict
from elicit._support.hashing import key_of
from qlearn import InteractiveQLearning, drive, random_mdp
from qlearn.learners.q_learning import rescaled_linear_rate
from tests.scalar_q_learning import scalar_q_learning
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import covering, quick_first

STEPS = 150
TINY = Setting(k=4, states=8, actions=3, steps=STEPS, seeds=1, repeats=1)


@pytest.fixture(scope="module")
def problem():
    return learning_runs.problem(TINY, 3)


@pytest.fixture
def few_resamples(monkeypatch):
    monkeypatch.setattr(plain, "RESAMPLES", 20)


def made(mdp, epsilon=0.1):
    return InteractiveQLearning(mdp, PolytopeComparator(4), steps=STEPS, epsilon=epsilon, rng=3)


@pytest.mark.parametrize(
    ("make", "epsilon"), covering([plain.Rebuilt, plain.Careful], [0.1, 1.0], together=1)
)
def test_a_plain_loop_asks_the_learners_questions_and_ends_with_its_policy(make, epsilon, problem):
    mdp, values = problem
    ours = drive(made(mdp, epsilon), TruthfulTutor(values))
    theirs = plain.q_learning(
        mdp, make(4), TruthfulTutor(values), steps=STEPS, epsilon=epsilon, key=key_of(3)
    )
    assert len(ours.answers) > 3
    assert np.array_equal(theirs.asked, ours.answers.d)
    assert theirs.said == ours.answers.y.tolist()
    assert np.array_equal(theirs.best, ours.policy)
    assert np.array_equal(theirs.q, ours.q)
    assert theirs.compared == ours.compared
    assert theirs.opened == learning_runs.opened(ours)
    assert 0 < theirs.judging < theirs.seconds


@pytest.mark.parametrize("seed", quick_first(range(4), 2))
def test_the_loop_that_knows_is_scalar_q_learning_and_starts_where_the_learner_does(seed):
    mdp, values = random_mdp(8, 3, 4, rng=seed)
    learner = InteractiveQLearning(mdp, PolytopeComparator(4), steps=STEPS, epsilon=0.3, rng=seed)
    known = Knowing(learner, mdp.normalise(values)).run()
    rates = rescaled_linear_rate(mdp.discount)(np.arange(STEPS))
    scalar = scalar_q_learning(mdp, values, steps=STEPS, epsilon=0.3, rates=rates, key=key_of(seed))
    assert known.policy.tolist() == scalar.best
    assert known.q @ mdp.normalise(values) == pytest.approx(scalar.q, abs=1e-12)
    ours = drive(learner, TruthfulTutor(values))  # which the other run has not moved
    assert ours.rounds == STEPS
    assert ours.policy.tolist() == scalar.best
    assert np.array_equal(ours.q, known.q)


def test_the_loop_that_knows_refuses_a_learner_that_has_begun(problem):
    mdp, values = problem
    learner = made(mdp)
    drive(learner, TruthfulTutor(values))
    with pytest.raises(ValueError, match="150 steps already"):
        Knowing(learner, values)


def test_a_rival_stops_when_it_has_enough(problem):
    mdp, values = problem
    how = {"steps": STEPS, "epsilon": 0.1, "key": key_of(3), "enough": lambda run: run.opened >= 5}
    run = plain.q_learning(mdp, plain.Careful(4), TruthfulTutor(values), **how)
    assert 5 <= run.opened < 5 + mdp.n_actions
    assert run.steps < STEPS


def test_a_rivals_run_is_extrapolated_by_its_steps_and_its_open_comparisons():
    run = plain.Run(
        np.zeros(1, int), np.zeros((1, 1, 2)), steps=10, opened=4, judging=2.0, seconds=3.0
    )
    assert run.whole(10, 4) == 3.0
    assert run.whole(100, 6) == 10.0 + 3.0


def test_the_simulator_draws_what_the_learner_draws_however_often(problem):
    mdp, _ = problem
    world = plain.World(mdp, key_of(3), 10, 0.1)
    far = [world.successor(2, 1, visit) for visit in range(300)]
    assert [
        plain.World(mdp, key_of(3), 10, 0.1).successor(2, 1, visit) for visit in range(299, -1, -1)
    ] == far[::-1]
    shares = np.bincount(far, minlength=8)[mdp.successors[2, 1]] / 300
    assert shares == pytest.approx(mdp.probabilities[2, 1], abs=0.1)


@pytest.mark.parametrize("region", ["box", "ensemble"])
def test_the_bootstrap_learns_what_it_is_told(region, few_resamples):
    judge = plain.Bootstrap(3, region)
    d = np.array([0.5, -1.0, 0.5])
    t = np.array([-0.5, 0.5])
    assert judge.settle(t) == Verdict.UNKNOWN
    judge.learn(Answers(np.tile(d, (plain.FEW, 1)), [1] * plain.FEW))
    assert (
        judge.settle(t) == Verdict.UNKNOWN
    )  # all resamples agree, and would do so after one answer
    judge.learn(Answers(np.tile(d, (20, 1)), [1] * 20))
    assert judge.gamma.shape == (plain.RESAMPLES, 2)
    assert judge.settle(t) == Verdict.BETTER
    assert judge.settle(-t) == Verdict.WORSE
    judge.learn(Answers(np.tile(d, (30, 1)), [-1] * 30))
    assert judge.settle(t) == Verdict.UNKNOWN


def test_the_bootstraps_fit_is_the_ridged_maximum_of_eq_7():
    rng = np.random.default_rng(0)
    t, y = rng.normal(size=(40, 3)), rng.choice([-1, 1], 40).astype(np.int8)
    judge = plain.Bootstrap(4, "box")
    judge.model.set_params(tol=1e-10)
    gamma = judge.fit(t, y)
    slope = (y / (1 + np.exp(y * (t @ gamma)))) @ t - plain.RIDGE * gamma
    assert slope == pytest.approx(np.zeros(3), abs=1e-5)


def test_the_box_decides_less_than_the_ensemble(few_resamples):
    rng = np.random.default_rng(1)
    d = rng.dirichlet(np.ones(5), 60) - rng.dirichlet(np.ones(5), 60)
    answers = Answers(d, TruthfulTutor([0, 1, 2, 3, 4]).signs(d))
    decided = {}
    for region in ("box", "ensemble"):
        judge = plain.Bootstrap(5, region)
        judge.learn(answers)
        decided[region] = {
            i for i, t in enumerate(tail_sums(-d[::-1])) if judge.settle(t) != Verdict.UNKNOWN
        }
    assert decided["box"] < decided["ensemble"]


@pytest.mark.slow
def test_the_measurements_beside_the_loop_that_knows():
    found = learning_runs.beside_knowing(TINY)
    assert found["same"] == [True]
    assert found["loss"] == found["loss knowing"]
    assert found["ratio"][0] == pytest.approx(found["seconds"][0] / found["knowing"][0])
    assert found["asked"][0] > 0


@pytest.mark.slow
@pytest.mark.parametrize("rival", quick_first(["box", "programs", "careful", "ensemble"], 1))
def test_the_measurements_beside_a_rival(rival, few_resamples):
    noisy = {"comparator": "posterior", "particles": 50, "error": 0.1, "epsilon": 1.0}
    at = Setting(k=4, states=8, actions=3, steps=STEPS, repeats=1, fits=2, rival=rival, prefix=4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # few particles
        found = learning_runs.beside_plain(
            replace(at, **noisy) if rival in ("box", "ensemble") else at
        )
    reached = {"programs": "their opened", "careful": "their steps"}.get(rival, "their asked")
    assert 4 <= found[reached] < 8
    assert found["whole"] >= found["prefix seconds"] > 0
    if rival in ("programs", "careful"):
        assert found["same questions"]
    else:
        assert found["refit"] > 0
        assert found["sizes"][-1] == found["asked"]


@pytest.mark.slow
def test_the_growth_is_measured_for_every_answer():
    found = learning_growth.per_answer(TINY)
    ends = [(a, b) for a, b, _ in found["parts"]]
    assert ends[0][0] == 0
    assert ends[-1][1] == found["asked"]
    assert all(seconds > 0 for _, _, seconds in found["parts"])


@pytest.mark.slow
def test_memory_is_measured_apart():
    found = apart(learning_growth.memory_of_a_run, TINY)
    assert 10e6 < found["before"] <= found["peak"]
    with pytest.raises(Failed, match="n_levels"):
        apart(learning_growth.memory_of_a_run, Setting(k=1))


def test_the_report_renders_ratios_with_their_limits():
    parts = [
        Row("a", "b", "1 s", "2 s", 20.5, (1.0, 30.0), Limit(most=20), "so"),
        Row("c", "d", "1 s", "2 s", 1500.0, None, Limit(least=1000)),
        Row("e", "", "", "", None, remark="not measured: not installed"),
        Kind("a", "1 ms", 10, 20, 5, 0, 0.001, 0.001, "5 of 5"),
        Text(["## More", "", "words"]),
    ]
    lines = render(parts, ["about"])
    assert "| a | b | 1 s | 2 s | 20.5 | 1-30 | at most 20 | NO | so |" in lines
    assert "| c | d | 1 s | 2 s | 1,500 |  | at least 1,000 | yes |  |" in lines
    assert "| e |  |  |  |  |  |  |  | not measured: not installed |" in lines
    assert "| a | 1 ms | 10 | 20 | 5 | 0 | 0.00100 | 0.00100 | 5 of 5 |" in lines
    assert lines[-1] == "words"
    widths = [line.count("|") for line in lines if line.startswith("|")]
    assert set(widths) == {10}
    assert re.search(r"\d+ cores", "\n".join(lines))


def test_limits_hold_for_runs_of_the_size_they_were_set_for():
    assert learning.limited(Setting(k=5), Limit(most=6)) == Limit(most=6)
    assert learning.limited(TINY, Limit(most=6)) is None
    assert [Limit(most=6).kept(x) for x in (6.0, 6.1)] == [True, False]
    assert [Limit(least=50).kept(x) for x in (50.0, 49.9)] == [True, False]


def test_every_section_is_run_and_a_failure_is_told(monkeypatch, capsys, tmp_path):
    def row(plan):
        yield Row("fine", "", "", "", 2.0)

    def failing(plan):
        yield Row("first", "", "", "", 3.0)
        raise Failed("not installed")

    monkeypatch.setattr(learning, "SECTIONS", {"truthful": row, "peer": failing})
    out = tmp_path / "new" / "learning.md"
    learning.main(["--quick", "--out", str(out)])
    text = out.read_text()
    assert capsys.readouterr().out == text
    assert [row[0] for row in table_rows(text)][1:] == ["fine", "first", "peer"]
    assert "not measured: not installed" in text


def test_numbers_have_three_digits_and_durations_their_unit():
    assert [number(x) for x in (0.01234, 1.0, 99.95, 123.4, 12345.6)] == [
        "0.0123",
        "1",
        "100",
        "123",
        "12,346",
    ]
    assert [took(x) for x in (2.5, 0.0123456, 42e-6, 1234.5)] == [
        "2.5 s",
        "12.3 ms",
        "42 us",
        "1,234 s",
    ]
