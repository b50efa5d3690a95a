"""The benchmark of questions: every method runs, its rows are what it says, its tables render."""

import functools
import json

import numpy as np
import pytest

from benchmarks.asking import certificates as certified
from benchmarks.asking import certify_at_scale as scale
from benchmarks.asking import hindsight, wrong_answers
from benchmarks.asking import person_sessions as sessions
from benchmarks.asking import question_counts as questions
from benchmarks.learning import scalar_solvers
from benchmarks.quotes import table_rows, tables
from elicit import PolytopeComparator, Query, TruthfulTutor
from qlearn import InteractivePolicyIteration, drive, random_mdp, unasked_loss
from qlearn.experiments.metrics import reference_differences
from tests.thoroughness import scaled, thorough


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(questions, "GRID", (0, 2, 6))
    monkeypatch.setattr(questions, "STEPS", 1500)
    monkeypatch.setattr(
        questions,
        "problem",
        lambda environment, seed: questions.random_mdp(10, 3, 4, discount=0.8, rng=seed),
    )


@pytest.mark.parametrize("method", dict.fromkeys((*questions.CERTIFY, *questions.METHODS)))
def test_every_method_is_measured_the_same_way(method, small):
    cell = {
        "environment": "",
        "method": method,
        "error": 0.1,
        "comparator": "posterior",
        "bounds": True,
        "seed": 1,
    }
    row = questions.run(cell)
    assert row == questions.run(cell)
    assert len(row["loss"]) == len(row["bound"]) == 3
    assert 0 <= row["asked"] <= 6
    assert all(0 <= loss <= 1 for loss in row["loss"])
    assert json.loads(json.dumps(row)) == row


def test_a_truthful_tutor_and_a_polytope_keep_every_bound(small):
    for method in (
        "policy iteration, telling violation",
        "value iteration",
        "Q-learning, late",
        "random pairs + fit",
    ):
        cell = {
            "environment": "",
            "method": method,
            "error": 0,
            "comparator": "polytope",
            "bounds": True,
            "seed": 2,
        }
        row = questions.run(cell)
        assert row["kept"]
        assert all(
            loss <= bound + 1e-9 for loss, bound in zip(row["loss"], row["bound"], strict=True)
        )


def test_the_report_says_how_many_questions():
    todo = questions.cells(["k = 5"], 2, ["policy iteration, telling violation"])
    assert {cell["comparator"] for cell in todo if cell["error"]} == {"posterior", "ensemble"}
    n = len(questions.GRID)
    same = {"status": "DONE", "end": 0.0, "kept": True, "loss": [0.01] * n, "bound": [0.02] * n}
    rows = [same | {"asked": 10 + 2 * cell["seed"]} for cell in todo]
    text = questions.report(list(zip(todo, rows, strict=True)))
    assert "How many questions will my expert have to answer?" in text
    assert "| k = 5 | 10% | posterior | 14 | 18 | 100% |" in text
    assert "1.00<br>≤ 2.00" in text
    assert "\n| asked nothing | equal gaps | 0 | " in text
    assert "11 ± 13" in text  # t = 12.7 of two seeds


def test_a_line_on_certificates_counts_questions_and_kept_bounds(monkeypatch):
    monkeypatch.setattr(
        certified, "problem", lambda name, seed: random_mdp(scaled(20, 100), 5, 5, rng=seed)
    )

    def line(who, errs):
        runs = [certified.plan("k = 5", who, errs, seed) for seed in range(2)]
        return certified.line(runs[0], [certified.certify(cell) for cell in runs])

    cells = line("policy iteration", certified.NEVER)
    assert cells[:5] == ["k = 5", "policy iteration", "never", "0.005%", "2"]
    losses = [unasked_loss(*certified.problem("k = 5", seed)).worst for seed in range(2)]
    assert float(cells[5].split()[0]) == pytest.approx(100 * sum(losses) / 2, abs=0.051)
    assert cells[8:11] == ["0", "100.0% [15.8, 100.0]", "0.0%"]
    fewer, more = (
        float(line(who, certified.NEVER)[6].split()[0])
        for who in ("policy iteration", "value iteration")
    )
    assert fewer < more
    for errs in certified.ERRING:
        assert line("policy iteration", errs)[2:5] == [errs, "1%", "2"]


def test_a_run_that_spends_its_budget_is_counted_with_its_wrong_answers(monkeypatch):
    monkeypatch.setattr(certified, "BUDGET", 8)
    cell = certified.plan("k = 5", "policy iteration", "eq. (6), 10%", 0)
    row = certified.certify(cell)
    assert (row["asked"], row["spent"], len(row["waits"])) == (8, True, 8)
    lines = certified.line(
        cell, [row, row | {"spent": False, "kept": False, "wrong": 3, "asked": 12}]
    )
    assert lines[6:11] == [
        "10.0 ± 25.4",
        "12",
        "1",
        "50.0% [1.3, 98.7]",
        f"{100 * (row['wrong'] + 3) / 20:.1f}%",
    ]


def test_the_tutors_of_equation_6_have_the_precision_that_the_page_says():
    mdp, values = certified.problem("k = 5", 0)
    one, tenth = (
        certified.ERRING[errs](mdp, values, 0) for errs in ("eq. (6), c = 1", "eq. (6), 10%")
    )
    range_of_shares, horizon = (
        values[-1] - values[0],
        20,
    )  # of discount .95: counts are shares times it
    assert one.precision == pytest.approx(range_of_shares * horizon)
    assert tenth.expected_error_rate(reference_differences(mdp, values)) == pytest.approx(0.1)


def test_hindsight_needs_no_more_than_greed_and_no_less_than_what_is_necessary():
    for seed in range(scaled(1, 3)):
        mdp, values = random_mdp(40, 3, 5, rng=seed)
        few = hindsight.hindsight(mdp, values, 1e-4)
        assert 0 < few["necessary"] <= few["pruned"] <= few["greedy"]
        result = drive(
            InteractivePolicyIteration(mdp, PolytopeComparator(5), tolerance=1e-4),
            TruthfulTutor(values),
        )
        assert few["greedy"] <= result.asked
        gap, current = (
            hindsight.bound_queries(mdp, values, 1e-4, choose)
            for choose in (hindsight.largest_gap, hindsight.current_solution)
        )
        assert few["greedy"] < min(gap, current) <= max(gap, current) < hindsight.MOST
        assert 0 < hindsight.hindsight_of_posterior(mdp, values, 0.02, seed) < 100


def test_bits_are_the_share_of_scales_that_agree():
    d = np.array(
        [[0.0, 1.0, 0.0, -1.0], [0.25, -1.0, 0.75, 0.0]]
    )  # the first always, the second where e2 is >= .75 e3
    rng = np.random.default_rng(0)
    e = np.sort(rng.random((200_000, 2)), axis=1)
    assert hindsight.bits(d) == pytest.approx(-np.log2((e[:, 0] >= 0.75 * e[:, 1]).mean()), abs=0.3)


@pytest.mark.slow
def test_the_page_on_certificates_is_made_in_parts_and_goes_on(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(
        certified, "problem", lambda name, seed: random_mdp(scaled(20, 100), 5, 5, rng=seed)
    )
    made = []
    certify = certified.certify
    monkeypatch.setattr(
        certified,
        "certify",
        functools.wraps(certify)(lambda cell: made.append(cell) or certify(cell)),
    )
    few = [
        "--problems",
        "2",
        "--erring",
        "2",
        "--limits",
        "2",
        "--journal",
        str(tmp_path / "journal.jsonl"),
    ]
    certified.main([*few, "--only", "k = 5"])
    first = list(made)
    assert len(first) == 10, "five rows of two problems"
    certified.main([*few, "--only", "k = 5", "limits", "--out", str(tmp_path / "page.md")])
    assert made == first, "the second table takes the same runs"
    table, limits = tables((tmp_path / "page.md").read_text())
    assert [row[2] for row in table[2:]] == ["never", *certified.ERRING]
    assert limits[1][1:4] == ["never", "policy iteration", "2"]
    assert sum(row[2].endswith("(Regan and Boutilier)") for row in limits) == 2
    assert [row[1] for row in limits if row[2] == "policy iteration"] == ["never", certified.FLIPS]
    assert [row[6] for row in limits if row[2] == "hindsight, greedy"] == ["1.00", "1.00"]
    assert [row[4] for row in limits if row[2] == "policy iteration"] == [table[2][6], table[3][6]]


def test_a_grid_has_five_ways_on_from_each_cell():
    mdp, values = scale.grid(4, 0.9, seed=1)
    assert (mdp.n_states, mdp.n_actions, mdp.k, len(values)) == (16, 5, 10, 10)
    table = mdp.transitions.toarray().reshape(16, 5, 16)
    np.testing.assert_allclose(
        table[5, :, 5], [1, 0, 0, 0, 0]
    )  # to stay; then north, east, south, west
    np.testing.assert_allclose(
        [table[5, way, to] for way, to in ((1, 1), (2, 6), (3, 9), (4, 4))], 0.8
    )
    np.testing.assert_allclose(table[5, 1, [6, 4]], 0.1)
    np.testing.assert_allclose(table[0, 1, [0, 1]], [0.9, 0.1])  # into the wall, or off to the west


@pytest.mark.slow
def test_a_run_at_scale_is_proven_and_the_page_says_so(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(scalar_solvers, "find_spec", lambda name: None)
    found = scale.run("grid", 36, 0.9, seed=1)
    assert found["loss"] <= found["bound"] <= scale.TOLERANCE
    ours, other, missing = scale.KNOWING
    assert list(found["known"]) == [ours], "the others are not installed"
    found |= {"seconds": 8.0, "known": {ours: 0.4, other: 0.5}}
    monkeypatch.setattr(
        scale, "apart", lambda task, *problem, limit: found | {"asked": 10 + problem[-1]}
    )
    scale.main(
        ["--states", "36", "--grids", "0.9", "--seeds", "3", "--out", str(tmp_path / "scale.md")]
    )
    text = (tmp_path / "scale.md").read_text()
    assert capsys.readouterr().out.strip() == text.strip()
    head, random, grid = table_rows(text)
    assert random[head.index("questions")] == "12.0 ± 2.5, at most 13"
    assert random[head.index("valid")] == "3 of 3"
    assert random[head.index("ratio")] == "20", "to the faster of those that know the values"
    assert random[head.index(f"values known: {other}")] == "0.500 ± 0.000"
    assert random[head.index(f"values known: {missing}")] == "not installed"
    assert (random[0], grid[0]) == ("36", "10,000 (100 x 100 grid)")
    monkeypatch.setattr(
        scale, "apart", lambda task, *problem, limit: found | {"loss": 2 * found["bound"] + 1e-6}
    )
    assert scale.row("random", 36, 0.9, 2, 1.0)[head.index("valid")] == "0 of 2"


@pytest.mark.slow
def test_a_line_on_sessions_counts_answers_and_broken_bounds():
    setting = sessions.Setting("polytope", 0.01)
    run = sessions.session(setting, 0)
    assert not thorough() or run == sessions.session(setting, 0)
    assert 0 < run.answered < 10
    assert run.loss <= run.bound <= 0.01
    assert run.confidence == 1
    cells = sessions.row_of(
        setting, [run, run._replace(answered=run.answered + 2, loss=run.bound + 0.001)]
    )
    assert cells[:5] == ["polytope", "0.01", "0%", "0", "2"]
    assert 0 < run.repeated < run.answered
    assert cells[7].startswith(f"{run.answered - run.repeated + 1}.0 ")
    assert cells[8:11] == [str(run.answered), str(run.answered + 1), str(run.answered + 2)]
    assert cells[-1] == "1 of 2"


def test_a_person_answers_by_the_counts_that_are_shown():
    says = sessions.person(np.array([0, 0.4, 1.0]), sessions.Setting("polytope", 0.01, tie=0.01), 0)
    rows = [
        {"level": 1, "a": 10, "b": 0},
        {"level": 2, "a": 0, "b": 4},
        {"level": 0, "a": 0, "b": 6},
    ]
    assert says({"rows": rows, "of": 10}) == "equal"
    assert says({"rows": [*rows[:1], {"level": 2, "a": 0, "b": 3}], "of": 10}) == "a"
    assert says({"rows": [*rows[:1], {"level": 2, "a": 0, "b": 5}], "of": 10}) == "b"
    always_wrong = sessions.person(
        np.array([0, 0.4, 1.0]), sessions.Setting("polytope", 0.01, flips=1.0), 0
    )
    assert always_wrong({"rows": [*rows[:1], {"level": 2, "a": 0, "b": 5}], "of": 10}) == "a"


def test_the_page_on_wrong_answers_counts_lies_and_what_was_violated():
    run = wrong_answers.Run(asked=5, seconds=1.0, wrong=0, noticed=False, bound=0.008, loss=0.001)
    lied = run._replace(wrong=1, loss=0.02)
    caught = run._replace(wrong=2, noticed=True, bound=0.5, loss=0.6)
    row = wrong_answers.row(4, "one lie", 0, [run, lied, caught])
    assert row[:5] == ("4", "one lie", "0", "3", "5.0 ± 0.0")
    assert row[6:] == ("2", "2", "1", "1", "0")
    assert wrong_answers.row(4, "one lie", 1, [run, lied])[6:] == ("2", "0", "0", "1", "1")
    values = np.array([0.0, 1.0, 3.0])
    liar, truth = wrong_answers.LyingOnce(values, 1), TruthfulTutor(values)
    query = Query.make("a test", 0, [0.0, 1.0, 0.0], [0.5, 0.0, 0.5])
    assert [liar(query).verdict == truth(query).verdict for _ in range(3)] == [True, False, True]


def test_a_run_that_allows_for_the_lie_keeps_its_bound():
    first = next(
        seed for seed in range(50) if np.random.default_rng([seed, 1]).integers(4) == 0
    )  # it lies at once
    found = wrong_answers.Run(
        **wrong_answers.run({"k": 4, "tutor": "one lie", "allowed": 1, "seed": first})
    )
    assert (found.wrong, found.noticed) == (1, False)
    assert found.loss <= found.bound <= wrong_answers.TOLERANCE
