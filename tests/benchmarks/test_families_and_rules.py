"""The page on strategies: its rows are paired differences, and its verdict counts what is sure."""

import numpy as np
import pytest

from benchmarks.comparing import families_and_rules as bench


def runs(**more):
    """Six runs in which the default asks 10, 11, ... and a rule so many more each time."""
    return [
        {"unasked": 0.1, "violated": 0, "spent": 0, bench.DEFAULT: 10 + i}
        | {name: 10 + i + more.get(name, (0,) * 6)[i] for name in bench.RULES[1:]}
        for i in range(6)
    ]


def test_a_row_has_the_default_and_paired_differences():
    some = runs(first_come=(5, 6, 7, 5, 6, 7), max_regret=(1, -1, 1, -1, 1, -1))
    row = dict(zip(bench.HEAD, bench.row("rover", some), strict=True))
    assert row["asked nothing"].startswith("10.0")
    assert row["default"].startswith("12.5")
    assert row["max regret"].startswith("+0.0")
    mean, half = bench.more(some, "first_come")
    assert (mean, half) == (
        pytest.approx(6),
        pytest.approx(2.5706 * np.std([5, 6, 7] * 2, ddof=1) / 6**0.5, rel=1e-4),
    )


def test_the_verdict_names_rules_that_ask_significantly_fewer():
    found = {"rover": runs(max_regret=(-2, -3, -2, -3, -2, -3)), "plant": runs(first_come=(4,) * 6)}
    said = bench.verdict(found)
    assert "fewer questions in 1 (max regret on rover)" in said
    assert "significantly more in 1." in said
    assert "0 of 72 bounds were violated" in said


def test_a_run_solves_one_problem_by_each_rule():
    found = bench.run({"problem": "career", "kind": "even", "seed": 400})
    assert found["violated"] == found["spent"] == 0
    assert all(found[rule] >= 1 for rule in bench.RULES)
    assert 0 < found["unasked"] <= 1
