"""The benchmark of questions: every method runs, its rows are what it says, its tables render."""

import json

import pytest

from benchmarks.asking import certificates as certified
from benchmarks.asking import question_counts as questions


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
