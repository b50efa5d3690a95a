"""The page on headroom: its rows are what they say, and it renders."""

import numpy as np
import pytest

from benchmarks.asking import headroom
from benchmarks.quotes import table_rows
from qlearn import equal_gaps_policy, hidden_scales, policy_loss, random_mdp


def test_a_row_has_the_losses_of_its_draws():
    drawn = headroom.losses("random MDP, k = 5", [0, 1], ["skewed"])["skewed"]
    for seed in (0, 1):
        mdp, _ = random_mdp(100, 5, 5, seed=seed)
        loss = policy_loss(mdp, equal_gaps_policy(mdp), hidden_scales("skewed", 5, seed))
        assert drawn[seed] == pytest.approx([100 * loss.max(), 100 * loss.mean()])
    row = headroom.described("x", np.array([[0.5, 0.0], [2.5, 1.0]]))
    assert row == ["x", "1.5 ± 12.7", "2.3", "2.5", "50%", "0.5 ± 6.4", "0.9", "1.0", "100%"]
    assert len(row) == len(headroom.HEAD)


def test_the_summary_counts_families_that_lose_much(monkeypatch):
    monkeypatch.setattr(headroom, "FAMILIES", {"a": None, "b": None, "c": None})
    found = {
        name: {"even": np.array([[worst, start]])}
        for name, worst, start in [("a", 9, 4), ("b", 5, 1), ("c", 1, 1)]
    }
    assert headroom.summary(found) == (
        "On even scales 2 of 3 families lose 5% or more in the mean at the worst state, "
        "and 1 lose 3% or more from where episodes start."
    )


def test_the_page_has_a_row_for_each_problem_and_kind(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(headroom, "PROBLEMS", ("career", "plant", "random MDP, k = 5"))
    monkeypatch.setattr(
        headroom, "FAMILIES", {name: headroom.FAMILIES[name] for name in ("career", "plant")}
    )
    out = tmp_path / "page.md"
    headroom.main(["--problems", "2", "--out", str(out)])
    text = out.read_text()
    assert text.strip() in capsys.readouterr().out
    for kind in headroom.SCALES:
        rows = table_rows(text.split(f"## Hidden scale: {kind}\n")[1].split("## ")[0])
        assert [row[0] for row in rows[1:] if "-" not in row[0]] == [
            "career",
            "plant",
            "random MDP, k = 5",
        ]
    assert "| career | 43 | 3 | 3 | 4 | 0.95 |" in text
