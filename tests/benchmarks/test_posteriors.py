"""The benchmark of posteriors: the samplers sample what they say, and the scores are what the page
says they are.
"""

import numpy as np
import pytest

from benchmarks.posteriors import gaussian_process as gp
from benchmarks.posteriors import markov_chains as chains
from benchmarks.posteriors import preference_posteriors as bench
from benchmarks.quotes import table_rows
from elicit import Answers, Verdict
from tests.report_cases import quick_report
from tests.scale_arithmetic import dominance, tail_sums


@pytest.fixture(scope="module")
def problem() -> bench.Problem:
    return bench.draw(4, 15, "logistic", 2)


def test_the_slope_of_the_density_is_its_slope(problem):
    density = chains.log_posterior(problem.answers)
    x = chains.start(4, 3, np.random.default_rng(0))
    slope = density(x)[1]
    for j in range(x.shape[1]):
        step = np.zeros(x.shape[1])
        step[j] = 1e-5
        np.testing.assert_allclose(
            (density(x + step)[0] - density(x - step)[0]) / 2e-5, slope[:, j], atol=1e-7
        )


@pytest.mark.slow
def test_without_answers_the_chains_find_the_prior():
    density = chains.log_posterior(Answers.none(4))
    kept, accepted = chains.hamiltonian(density, chains.start(4, 48, np.random.default_rng(1)), 400,
                                        600,
                                        np.random.default_rng(2))  # fmt: skip
    assert 0.6 < accepted < 0.95
    found = chains.scales(kept.reshape(-1, 5))
    np.testing.assert_allclose(found.gaps.sum(axis=1), 1)
    np.testing.assert_allclose(found.gaps.mean(axis=0), 1 / 3, atol=0.04)
    assert np.log(found.precision).mean() == pytest.approx(chains.PRECISION[0], abs=0.25)
    assert np.log(found.precision).std() == pytest.approx(chains.PRECISION[1], abs=0.25)
    assert found.lapse.mean() == pytest.approx(0.2, abs=0.02)  # of Beta(1, 4)


@pytest.mark.slow
def test_hamiltonian_ensemble_and_particles_agree(problem):
    long = bench.by_hamiltonian(problem, 0, 300, 600)[0]
    others = {
        "particles": bench.particles(problem, 1)[0],
        "short": bench.by_hamiltonian(problem, 1)[0],
    }
    if "emcee, same posterior" in bench.methods():
        others["emcee"] = bench.by_ensemble(problem, 1)[0]
    for name, found in others.items():
        apart = found.chance @ found.weights - long.chance @ long.weights
        assert np.sqrt((apart**2).mean()) < 0.03, name
    flat = bench.by_hamiltonian(problem._replace(y=-problem.y), 0)[0]
    assert (
        np.abs(flat.chance @ flat.weights - long.chance @ long.weights).max() > 0.1
    )  # else anything agreed


def test_intervals_are_weighted_quantiles():
    x = np.array([[3.0, 1.0, 2.0, 9.0]])
    low, high = bench.intervals(x, np.array([0.5, 0.02, 0.47, 0.01]))
    assert (low[0], high[0]) == (2.0, 3.0)
    low, high = bench.intervals(x, np.array([0.5, 0.03, 0.44, 0.03]))
    assert (low[0], high[0]) == (1.0, 9.0)


def test_who_knows_all_scores_best_and_who_is_surely_wrong_is_counted(problem):
    truth = (problem.fresh @ problem.values)[:, None]
    one = np.ones(1)
    knows = bench.score(problem, bench.Believed(one, problem.chances[:, None], truth))
    assert (knows["covered"], knows["chance_covered"], knows["wrong"], knows["decided"]) == (
        1,
        1,
        0,
        1,
    )
    fooled = bench.score(problem, bench.Believed(one, 1 - problem.chances[:, None], -truth))
    assert fooled["wrong"] == fooled["sure"] == bench.FRESH
    assert fooled["covered"] == 0
    assert fooled["loss"] > knows["loss"]
    half = bench.score(problem, bench.Believed(one, np.full((bench.FRESH, 1), 0.5), truth))
    assert half["loss"] == pytest.approx(np.log(2))


@pytest.mark.parametrize("tutor", ["logistic", "flips"])
def test_problems_are_open_pairs_and_their_chances_are_the_tutors(tutor):
    problem = bench.draw(5, 10, tutor, 1)
    assert len(problem.y) == 10
    assert len(problem.fresh_y) == len(problem.chances) == bench.FRESH
    agree = (problem.fresh_y > 0) == (problem.chances > 0.5)
    assert agree.mean() == pytest.approx(
        np.maximum(problem.chances, 1 - problem.chances).mean(), abs=0.08
    )
    assert ((problem.chances > 0.5) == (problem.fresh @ problem.values > 0)).all()
    assert (dominance(tail_sums(problem.fresh)) == Verdict.UNKNOWN).all()


@pytest.mark.slow
def test_the_page_says_who_is_better_first_and_what_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "LONG", (50, 50, 4))
    monkeypatch.setattr(bench.gaussian_process, "available", lambda: False)
    monkeypatch.setattr(bench, "find_spec", lambda name: None)
    bench.main(["--quick", "--out", str(tmp_path / "page.md")])
    text = (tmp_path / "page.md").read_text()
    assert "botorch is not installed: its rows are left out" in text
    assert text.index("predicting held-out answers") < text.index("## a tutor")
    rows = table_rows(text)
    assert [row[0] for row in rows] == [
        "method", "Hamiltonian, same posterior", "method", "PosteriorComparator", "Hamiltonian, "
                                                                                  "same posterior",
    ]  # fmt: skip


def test_a_method_that_is_better_beyond_the_interval_is_named_as_such():
    def rows(gain, held):
        base = {"seconds": 1.0, "more": 1.0}
        return [{"": {"loss": 0.0}, "ours": base | {"loss": 0.5, "chance_covered": 0.8},
                 "other": base | {"loss": 0.5 - gain * u, "chance_covered": 0.8 + held * u}}
                for u in (1.0, 1.1, 0.9)]  # fmt: skip

    def said(gain, held):
        return bench._wins({("t", 5, 9): rows(gain, held)}, ["ours", "other"])[0]

    assert "beyond the interval: other." in said(0.1, -0.1)
    assert "more often: none of the others." in said(0.1, -0.1)
    assert "beyond the interval: none of the others." in said(-0.1, 0.1)
    assert "more often: other." in said(-0.1, 0.1)


@pytest.mark.skipif(not gp.available(), reason="botorch is not installed")
@pytest.mark.parametrize("name", gp.KERNELS)
def test_a_gaussian_process_learns_what_it_is_told(name):
    problem = bench.draw(3, 60, "logistic", 0)
    believed, _ = bench.by_gaussian_process(name)(problem, 0)
    assert bench.score(problem, believed)["loss"] < np.log(2) - 0.03


@pytest.mark.slow
def test_the_quick_run_writes_its_page(tmp_path):
    text = quick_report("benchmarks.posteriors.preference_posteriors", tmp_path, "--seeds", "1")
    assert "## a tutor by eq. (6), k = 5, 20 answers" in text
