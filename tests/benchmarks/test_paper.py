"""The benchmarks of exploration and of what the paper leaves open run, and their tables say what was measured."""

import numpy as np
import pytest

from benchmarks.paper import assumptions, exploration
from benchmarks.paper.ablation_table import table
from benchmarks.paper.figure_pages import with_rows
from qlearn import random_mdp
from qlearn.learners.exploration import EXPLORATIONS, Exploration
from tests.report_cases import table_rows


def test_exploration_measures_every_choice(capsys, tmp_path):
    out = tmp_path / "new" / "exploration.md"
    exploration.main(["--quick", "--out", str(out)])
    text = out.read_text()
    assert capsys.readouterr().out.rstrip() == text.rstrip()
    head, *table = table_rows(text)
    assert head == ["exploration", "loss", "at the start", "questions"]
    assert sorted(row[0] for row in table) == sorted(exploration.CHOICES)
    losses = [float(row[1].split()[0]) for row in table]
    assert losses == sorted(losses)


def test_a_loss_is_that_of_the_run():
    def problem(seed):
        return random_mdp(6, 2, 3, rng=seed)

    loss, start, asked = exploration.measure(problem, Exploration(0.0), 0, 3, True)
    assert (asked, loss) == (0, pytest.approx(start))  # the initial distribution is uniform
    better, _, asked = exploration.measure(problem, EXPLORATIONS["uniform"], 3000, 3, True)
    assert better < loss
    assert asked > 0
    assert np.isnan(exploration.measure(problem, EXPLORATIONS["uniform"], 10, 3, False)[2])


def test_assumptions_changes_one_choice_a_line(capsys, tmp_path):
    out = tmp_path / "assumptions.md"
    assumptions.main(["--quick", "--out", str(out)])
    text = out.read_text()
    assert capsys.readouterr().out.rstrip() == text.rstrip()
    _, *table = table_rows(text)
    assert [row[0] for row in table] == list(assumptions.choices())
    assert all(cell[0] in "+-" for row in table[1:] for cell in row[1:])
    # what only the comparator is told does not touch the oracle
    untouched = {row[0]: row[5] for row in table}
    assert untouched["m = 20"] == untouched["tutor never errs"] == "+0.00 ± 0.00"


def test_with_a_truthful_tutor_and_the_default_a_measure_is_a_run():
    found = assumptions.measure(assumptions.Choice(), 8, 3, 200, 1)
    assert found.shape == (len(assumptions.MEASURES),)
    assert 0 <= found[0] <= found[1] <= 100
    assert found[4] >= 0


def test_the_rows_behind_the_ablation_notebook_are_paired():
    tiny = {"seeds": 1, "steps": 60, "max_sweeps": 8, "states": 8, "actions": 2, "max_queries": 20, "n_boot": 5}
    rows = table(levels=(3, 4), tasks=(), particles=50, tolerance=0.05, error_rates=(0.0, 0.3), jobs=1, **tiny)
    assert sorted(rows.k.unique()) == [3, 4]
    audited = rows[rows.name == "polytope, audited"]
    assert (audited.audit > 0).all()
    assert (audited.rounds[audited.learner == "q-learning"] == 60).all()  # as long as the others
    assert (rows.questions == rows.asked + rows.audited).all()
    oracle = rows[(rows.comparator == "always") & (rows.error_rate == 0)]
    assert (oracle.excess == 0).all()
    for row in rows.itertuples():
        of = oracle[(oracle.k == row.k) & (oracle.learner == row.learner) & (oracle.seed == row.seed)]
        assert row.excess == pytest.approx(100 * (row.loss - of.loss.iloc[0]))


def test_rows_take_the_place_of_those_with_the_same_claim():
    page = "| claim | verdict |\n|---|---|\n| one | old |\n| one and more | old |\n"
    assert with_rows(page, ["| one | new |"]) == page.replace("| one | old |", "| one | new |")
    with pytest.raises(ValueError, match="must have one row that begins with"):
        with_rows(page, ["| two | new |"])
