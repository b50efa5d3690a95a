"""Growth: slopes are those of the measurements, sizes that take too long are left out.

Page and picture show both."""

import re

import pytest

from benchmarks.learning import growth_by_size as growth
from tests.thoroughness import quick_first, scaled

pytest.importorskip("matplotlib")


def test_an_exponent_is_the_slope_over_the_largest_sizes():
    found = {
        n: {"seconds": [2e-3 * n**1.5] * 2, "bytes": [float(n**2)]} for n in (10, 100, 1000, 10_000)
    }
    found[10]["seconds"] = [7.0]
    assert growth.exponent(found, "seconds") == "1.50 ± 0.00"
    assert growth.exponent(found, "bytes") == ""  # only the last is more than a process's own noise
    found[10_000]["seconds"] = [2e-3 * 10_000**1.5, 3e-3 * 10_000**1.5]
    assert float(growth.exponent(found, "seconds").split(" ± ")[1]) > 0.01
    assert growth.exponent({10: {"asked": [5.0]}, 20: {"asked": [10.0]}}, "asked") == "1.00"


def test_a_size_that_would_take_too_long_is_left_out(monkeypatch):
    monkeypatch.setattr(growth, "measure", squared)
    there = growth.series("levels", "policy iteration", (10, 20, 40, 80), 100, 15.0)
    assert list(there.found) == [10, 20]
    assert there.left_out == "40 levels: some 16 s expected"
    assert not growth.series("levels", "policy iteration", (10, 20), 100, 15.0).left_out


def squared(cell):
    return {"cost": [(cell["size"] / 10) ** 2], "seconds": [1.0]}


def test_a_cell_that_fails_is_said_to(monkeypatch):
    monkeypatch.setattr(growth, "measure", lambda cell: "out of memory")
    assert growth.series("answers", "box", (10, 20), 0, 1.0).left_out == "10 answers: out of memory"


COSTLY = (
    "Q-learning, box",
    "Q-learning, posterior",
    "values known: QuantEcon, modified policy iteration",  # which compiles code of its own
)


@pytest.mark.parametrize(
    "who",
    [
        pytest.param(who, marks=[pytest.mark.slow] if who in COSTLY else [])
        for who in growth.LEARNERS
    ],
)
def test_every_learner_is_measured(who, monkeypatch):
    monkeypatch.setattr(growth, "PROBLEMS", scaled(1, growth.PROBLEMS))
    found = growth.learned(who, 6, 3)
    assert all(seconds > 0 for seconds in found["seconds"])
    assert ("asked" in found) == ("known" not in who)
    assert found["bytes"][0] >= 0


@pytest.mark.parametrize("who", quick_first(growth.COMPARATORS, 2))
def test_every_comparator_is_measured(who, monkeypatch):
    monkeypatch.setattr(growth, "JUDGED", 50)
    found = growth.informed(who, 5)
    assert all(0 <= count <= 50 for count in found["open"])
    assert all(seconds > 0 for seconds in found["update"] + found["judge"])


@pytest.mark.slow
def test_the_page_has_its_tables_and_the_picture_its_lines(tmp_path, monkeypatch):
    def quickly(cell):
        n = cell["size"]
        rest = (
            {"update": [n], "judge": [2 * n], "open": [n]}
            if cell["axis"] == "answers"
            else {"seconds": [n], "asked": [n]}
        )
        return rest | {"bytes": [n * 2**21], "cost": [0.1]}

    monkeypatch.setattr(growth, "measure", quickly)
    page = tmp_path / "page.md"
    growth.main(["--quick", "--out", str(page)])
    text, drawn = (
        page.read_text(encoding="utf-8"),
        (tmp_path / "page.svg").read_text(encoding="utf-8"),
    )
    assert "](page.svg)" in text
    assert "| policy iteration | 20, 40 | 1.00 | 1.00 | 1.00 |" in text
    assert "| policy iteration | 40 | 1 | 40 | 40 | 80 |" in re.sub(r"(\d)\.0+ \|", r"\1 |", text)
    assert "Left out" not in text
    for label in (*growth.LEARNERS, *growth.COMPARATORS, "states", "levels", "answers"):
        assert f">{label}</text>" in drawn
