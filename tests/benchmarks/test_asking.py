"""The benchmark of questions: every method runs, its rows are what it says, its tables render."""

import json

import numpy as np
import pytest

from benchmarks.asking import certificates as certified
from benchmarks.asking import certify_at_scale as scale
from benchmarks.asking import hindsight
from benchmarks.asking import person_sessions as sessions
from benchmarks.asking import question_counts as questions
from elicit import PolytopeComparator, TruthfulTutor
from qlearn import InteractivePolicyIteration, drive, random_mdp
from tests.report_cases import table_rows


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(questions, "GRID", (0, 2, 6))
    monkeypatch.setattr(questions, "STEPS", 1500)
    monkeypatch.setattr(
        questions, "problem", lambda environment, seed: questions.random_mdp(10, 3, 4, discount=0.8, rng=seed)
    )


@pytest.mark.parametrize("method", questions.METHODS)
def test_every_method_is_measured_the_same_way(method, small):
    cell = {"environment": "", "method": method, "error": 0.1, "comparator": "posterior", "bounds": True, "seed": 1}
    row = questions.run(cell)
    assert row == questions.run(cell)
    assert len(row["loss"]) == len(row["bound"]) == 3
    assert 0 <= row["asked"] <= 6
    assert all(0 <= loss <= 1 for loss in row["loss"])
    assert json.loads(json.dumps(row)) == row


def test_a_truthful_tutor_and_a_polytope_keep_every_bound(small):
    for method in ("certify, telling violation", "value iteration", "Q-learning, late", "random pairs + fit"):
        cell = {"environment": "", "method": method, "error": 0, "comparator": "polytope", "bounds": True, "seed": 2}
        row = questions.run(cell)
        assert row["kept"]
        assert all(loss <= bound + 1e-9 for loss, bound in zip(row["loss"], row["bound"], strict=True))


def test_the_report_says_how_many_questions():
    todo = questions.cells(["k = 5"], 2, ["certify, telling violation"])
    assert {cell["comparator"] for cell in todo if cell["error"]} == {"posterior", "ensemble"}
    n = len(questions.GRID)
    same = {"status": "DONE", "end": 0.0, "kept": True, "loss": [0.01] * n, "bound": [0.02] * n}
    rows = [same | {"asked": 10 + 2 * cell["seed"]} for cell in todo]
    text = questions.report(list(zip(todo, rows, strict=True)))
    assert "How many questions will my expert have to answer?" in text
    assert "| k = 5 | 10% | posterior | no | 11 | 12 | 100% |" in text
    assert "1.00<br>≤ 2.00" in text
    assert "11 ± 13" in text  # t = 12.7 of two seeds


def test_a_line_on_certificates_counts_questions_and_kept_bounds():
    def line(who, truthful):
        return certified.line("k = 5", who, certified.paper(5), certified.ENOUGH, truthful, 2)

    cells = line("policy iteration", truthful=True).strip("| ").split(" | ")
    assert cells[:5] == ["k = 5", "policy iteration", "never", "1%", "2"]
    assert cells[7] == "100.0%"
    fewer, more = (float(line(who, True).split(" | ")[5].split()[0]) for who in ("policy iteration", "value iteration"))
    assert fewer < more
    assert "| 10% | 1% |" in line("policy iteration", truthful=False)


def test_hindsight_needs_no_more_than_greed_and_no_less_than_what_is_necessary():
    for seed in range(3):
        mdp, values = random_mdp(40, 3, 5, rng=seed)
        few = hindsight.hindsight(mdp, values, 1e-4)
        assert 0 < few["necessary"] <= few["pruned"] <= few["greedy"]
        result = drive(InteractivePolicyIteration(mdp, PolytopeComparator(5), tolerance=1e-4), TruthfulTutor(values))
        assert few["greedy"] <= result.asked
        gap, current = (
            hindsight.bound_queries(mdp, values, 1e-4, choose)
            for choose in (hindsight.largest_gap, hindsight.current_solution)
        )
        assert few["greedy"] < min(gap, current) <= max(gap, current) < hindsight.MOST
        assert 0 < hindsight.hindsight_of_posterior(mdp, values, 0.02, 0.2, seed) < 100


def test_bits_are_the_share_of_scales_that_agree():
    d = np.array([[0.0, 1.0, 0.0, -1.0], [0.25, -1.0, 0.75, 0.0]])  # the first always, the second where e2 is >= .75 e3
    rng = np.random.default_rng(0)
    e = np.sort(rng.random((200_000, 2)), axis=1)
    assert hindsight.bits(d) == pytest.approx(-np.log2((e[:, 0] >= 0.75 * e[:, 1]).mean()), abs=0.3)


def test_the_table_of_limits_names_all_rules():
    rows = [row.strip("| ").split(" | ") for row in certified.limit("k = 4", certified.paper(4), 2)]
    assert {len(row) for row in rows} == {6}
    assert rows[0][1:3] == ["never", "hindsight, greedy"]
    assert sum(row[2].endswith("(Regan and Boutilier)") for row in rows) == 2
    assert sum(row[1] == "10%" for row in rows) == 2
    assert [row[5] for row in rows if row[2] == "hindsight, greedy"] == ["1.00", "1.00"]


def test_a_grid_has_five_ways_on_from_each_cell():
    mdp, values = scale.grid(4, 0.9, seed=1)
    assert (mdp.n_states, mdp.n_actions, mdp.k, len(values)) == (16, 5, 10, 10)
    table = mdp.transitions.toarray().reshape(16, 5, 16)
    np.testing.assert_allclose(table[5, :, 5], [1, 0, 0, 0, 0])  # to stay; then north, east, south, west
    np.testing.assert_allclose([table[5, way, to] for way, to in ((1, 1), (2, 6), (3, 9), (4, 4))], 0.8)
    np.testing.assert_allclose(table[5, 1, [6, 4]], 0.1)
    np.testing.assert_allclose(table[0, 1, [0, 1]], [0.9, 0.1])  # into the wall, or off to the west


def test_a_run_at_scale_is_proven_and_the_page_says_so(monkeypatch, tmp_path, capsys):
    found = scale.run("grid", 36, 0.9, seed=1)
    assert found["loss"] <= found["bound"] <= scale.TOLERANCE
    monkeypatch.setattr(scale, "apart", lambda task, *problem, limit: found | {"asked": 10 + problem[-1]})
    scale.main(["--states", "36", "--grids", "0.9", "--seeds", "3", "--out", str(tmp_path / "scale.md")])
    text = (tmp_path / "scale.md").read_text()
    assert capsys.readouterr().out.strip() == text.strip()
    head, random, grid = table_rows(text)
    assert random[head.index("questions")] == "12.0 ± 2.5, at most 13"
    assert random[head.index("valid")] == "3 of 3"
    assert (random[0], grid[0]) == ("36", "10,000 (100 x 100 grid)")
    monkeypatch.setattr(scale, "apart", lambda task, *problem, limit: found | {"loss": 2 * found["bound"] + 1e-6})
    assert scale.row("random", 36, 0.9, 2, 1.0)[head.index("valid")] == "0 of 2"


def test_a_line_on_sessions_counts_answers_and_broken_bounds():
    setting = sessions.Setting("polytope", 0.01)
    run = sessions.session(setting, 0)
    assert run == sessions.session(setting, 0)
    assert 0 < run.answered < 10
    assert run.loss <= run.bound <= 0.01
    assert run.confidence == 1
    cells = sessions.row_of(setting, [run, run._replace(answered=run.answered + 2, loss=run.bound + 0.001)])
    assert cells[:5] == ["polytope", "0.01", "0%", "0", "2"]
    assert cells[6:9] == [str(run.answered), str(run.answered + 1), str(run.answered + 2)]
    assert cells[-1] == "1 of 2"


def test_a_person_answers_by_the_counts_that_are_shown():
    says = sessions.person(np.array([0, 0.4, 1.0]), sessions.Setting("polytope", 0.01, tie=0.01), 0)
    rows = [{"level": 1, "a": 10, "b": 0}, {"level": 2, "a": 0, "b": 4}, {"level": 0, "a": 0, "b": 6}]
    assert says({"rows": rows, "of": 10}) == "equal"
    assert says({"rows": [*rows[:1], {"level": 2, "a": 0, "b": 3}], "of": 10}) == "a"
    assert says({"rows": [*rows[:1], {"level": 2, "a": 0, "b": 5}], "of": 10}) == "b"
    always_wrong = sessions.person(np.array([0, 0.4, 1.0]), sessions.Setting("polytope", 0.01, flips=1.0), 0)
    assert always_wrong({"rows": [*rows[:1], {"level": 2, "a": 0, "b": 5}], "of": 10}) == "a"
