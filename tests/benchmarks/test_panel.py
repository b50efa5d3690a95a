"""The page on panels: its rows are what they say, and it renders."""

import numpy as np
import pytest

from benchmarks.people import panel
from benchmarks.quotes import table_rows
from qlearn import OrdinalMDP, random_mdp


def small(name: str, seed: int) -> OrdinalMDP:
    return random_mdp(6, 2, 3, discount=0.8, seed=seed)[0]


def test_a_row_says_what_its_runs_came_to():
    found = [
        panel.Run(10, 4.0, 0.002, 0.009, 1.0, True, True),
        panel.Run(20, 6.0, 0.02, 0.009, 1.0, False, True),
    ]
    row = panel.described("rover", "alike", "never", found)
    assert len(row) == len(panel.HEAD)
    assert row[:4] == ["rover", "alike", "never", "2"]
    assert row[6:9] == ["3.00", "1.100", "1 of 2"]
    assert row[10:] == ["1 of 2", "2 of 2"]
    said = panel.summary({("rover", "alike", "never"): found})
    assert "The bound for the mean was held in 1 of 2 (1.3 to 98.7%)" in said
    assert "2 of 2 runs ended within the tolerance" in said
    assert "3.00 to 3.00 times" in said
    assert "at most 2.5 times in 0 of 1 rows" in said


def test_times_are_of_the_runs_in_which_experts_were_asked_alone():
    found = [
        panel.Run(10, 4.0, 0.0, 0.01, 0.95, True, True),
        panel.Run(90, None, 0.0, 0.01, 0.95, True, True),
        panel.Run(0, None, 0.0, 0.01, 0.95, True, True),
    ]
    assert panel.times(found) == 2.5
    row = panel.described("care", "alike", "10% flipped", found)
    assert row[3:5] == ["3", "4.0"]
    assert row[6] == "2.50"
    said = panel.summary({("care", "alike", "10% flipped"): found})
    assert "held in 3 of 3 (29.2 to 100.0%)" in said
    assert "in which anything was asked, in 2 of 2 (15.8 to 100.0%)" in said


def test_scales_are_alike_or_not_as_said():
    for seed in range(3):
        alike = np.stack([*panel.scales("alike", 6, seed).values()])
        apart = np.stack([*panel.scales("independent", 6, seed).values()])
        assert alike.shape == apart.shape == (5, 6)
        assert (alike[:, [0, -1]] == [0, 1]).all()
        assert np.ptp(alike, axis=0).max() <= 0.1 + 1e-9
        assert np.ptp(apart, axis=0).max() > np.ptp(alike, axis=0).max()


@pytest.mark.parametrize("errs", [*panel.ERRORS])
def test_a_run_holds_its_bounds_and_is_kept_in_the_journal(monkeypatch, tmp_path, errs):
    monkeypatch.setattr(panel, "problem", small)
    setting = panel.ERRORS[errs]._replace(tolerance=0.05, alone=2)
    monkeypatch.setattr(panel, "ERRORS", {errs: setting})
    journal = tmp_path / "journal.jsonl"
    (run,) = panel.runs("any", "independent", errs, [1], journal)
    assert run.loss <= run.bound <= 0.05
    assert run.confidence == (0.95 if setting.rate else 1.0)
    assert run.alone > 0
    assert run.members_held
    monkeypatch.setattr(panel, "one_run", lambda *key: pytest.fail("it was made again"))
    assert panel.runs("any", "independent", errs, [1], journal) == [run]
    kept = journal.read_text(encoding="utf-8")
    journal.write_text(kept.replace(f"{run.alone}", "null"), encoding="utf-8")
    assert panel.runs("any", "independent", errs, [1], journal)[0].alone is None


def test_the_page_has_a_row_for_each_problem_scales_and_errors(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(panel, "PROBLEMS", ("any",))
    found = panel.Run(10, 4.0, 0.002, 0.009, 1.0, True, True)
    monkeypatch.setattr(panel, "one_run", lambda *key: found)
    out = tmp_path / "page.md"
    panel.main(["--runs", "2", "--out", str(out)])
    rows = table_rows(out.read_text(encoding="utf-8"))
    assert len([row for row in rows if row[0] == "any"]) == 4
    said = capsys.readouterr().out
    for errs in panel.ERRORS:
        assert f"Seeds 0 to 1 with experts whose errors are: {errs}." in said


def test_experts_are_asked_alone_in_the_first_runs_only(monkeypatch):
    monkeypatch.setattr(panel, "problem", small)
    setting = panel.ERRORS["never"]._replace(tolerance=0.05, most=5, alone=1)
    monkeypatch.setattr(panel, "ERRORS", {"never": setting})
    found = panel.runs("any", "independent", "never", [0, 1])
    assert [run.alone is None for run in found] == [False, True]
    assert max(run.asked for run in found) <= 5


@pytest.mark.parametrize("name", panel.PROBLEMS)
def test_problems_are_small(name):
    assert panel.problem(name, 0).n_states < 40


def test_no_way_of_asking_takes_fewer_questions_than_the_bound():
    assert panel.fewest_questions(1, 0.0, 2000) == pytest.approx(1.0)
    assert 5.3 < panel.fewest_questions(5, 0.01, 2000) < 5.6
    rng, asked = np.random.default_rng(1), 0
    for x in rng.uniform(-1, 1, (300, 2)):  # the widest interval is halved
        low, high = -np.ones(2), np.ones(2)
        while low.mean() < -0.1 and high.mean() > 0.1:
            i = int(np.argmax(high - low))
            middle = 0.5 * (low[i] + high[i])
            low[i], high[i] = (middle, high[i]) if x[i] > middle else (low[i], middle)
            asked += 1
    assert 1.5 < panel.fewest_questions(2, 0.1, 2000) < asked / 300
