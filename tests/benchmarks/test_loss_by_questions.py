"""The page on loss against questions: its rows are losses of such runs, and it renders."""

import pandas as pd
import pytest

import elicit
import qlearn
from benchmarks.asking import loss_by_questions
from benchmarks.quotes import table_rows


@pytest.fixture(scope="module")
def frame():
    patch = pytest.MonkeyPatch()
    patch.setattr(loss_by_questions, "STEPS", 500)
    rows = list(loss_by_questions.curves("career", range(2), 3))
    patch.undo()
    return pd.DataFrame(rows)


def test_every_method_begins_with_question_zero(frame):
    first = frame[frame["asked"] == 0]
    assert len(first) == 2 * len(loss_by_questions.METHODS)
    for seed in (0, 1):
        mdp = loss_by_questions.problem("career", seed)
        values = qlearn.hidden_scales("even", mdp.k, seed)
        unasked = qlearn.unasked_loss(mdp, values).worst
        assert first.loc[first["seed"] == seed, "loss"].to_numpy() == pytest.approx([unasked] * 4)


def test_a_budget_is_a_run_of_its_own(frame):
    mdp = loss_by_questions.problem("career", 1)
    values = qlearn.hidden_scales("even", mdp.k, 1)
    made = loss_by_questions.learner("value-iteration", mdp, 1, 2)
    result = qlearn.drive(made, elicit.TruthfulTutor(values))
    rows = frame.query("method == 'value-iteration' and seed == 1 and asked == 2")
    assert result.asked <= 2
    loss = qlearn.policy_loss(mdp, result.policy, values).max()
    assert rows["loss"].to_numpy() == pytest.approx([loss])


def test_the_page_has_a_table_a_problem_and_the_picture_its_lines(frame, tmp_path):
    page = "\n".join(line for part in loss_by_questions.report(frame) for line in part)
    rows = table_rows(page)
    assert len([row for row in rows if row[0] == "proven"]) == 1
    loss_by_questions.draw(frame, tmp_path / "loss.svg")
    text = (tmp_path / "loss.svg").read_text(encoding="utf-8")
    assert "policy iteration, proven" in text
    assert text.count("career") == 1
