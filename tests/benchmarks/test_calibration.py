"""The tables of the calibration benchmark: what is pooled, judged and called broken. No test looks
at a time.
"""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.fitting import calibration, calibration_questions
from benchmarks.fitting.calibration_tables import Row, report, summary


def rows(rule: str, sets: int, decided: int, wrong: int, setting: str = "some scales") -> list[Row]:
    return [
        Row("fresh", setting, rule, 5, 10, i, 300, decided, wrong, 0.1, 10) for i in range(sets)
    ]


def test_cells_pool_their_data_sets_and_few_are_not_judged() -> None:
    told = [
        *rows("b", 40, 100, 4),
        *rows("a", 40, 100, 6),
        *rows("few", 29, 100, 6),
        *rows("shy", 40, 4, 1),
    ]
    cells = summary(told)
    assert [c.rule for c in cells] == ["b", "a", "few", "shy"]  # as they came
    assert [c.judged for c in cells] == [True, True, False, False]
    assert [c.broken for c in cells] == [False, True, False, False]
    assert [c.share_wrong.at for c in cells] == pytest.approx([0.04, 0.06, 0.06, 0.25])
    assert cells[0].share_decided == pytest.approx((1 / 3, 1 / 3, 1 / 3))
    assert cells[0].ms_per_answer == pytest.approx(10.0)
    text = "\n".join(report(cells))
    assert "| 5 | 10 | 33 / 4.0 [4.0, 4.0] | **33 / 6.0 [6.0, 6.0]** | (33 / 6.0" in text
    assert "2 of 4 cells are judged; 1 break the promise." in text
    assert "- a; fresh pairs, some scales, k = 5, 10 answers: **33 / 6.0" in text


def test_intervals_are_over_data_sets() -> None:
    mixed = [*rows("a", 20, 100, 0), *rows("a", 20, 100, 10)]
    (cell,) = summary(mixed)
    spread = 0.05 / np.sqrt(40)
    assert cell.share_wrong.at == pytest.approx(0.05)
    assert cell.share_wrong.high - cell.share_wrong.low == pytest.approx(
        2 * 1.96 * spread, rel=0.15
    )


@pytest.mark.parametrize("setting", calibration.SETTINGS, ids=lambda s: s.name)
def test_every_setting_gives_a_row_for_each_rule_and_count(setting: calibration.Setting) -> None:
    size = calibration.QUICK._replace(most=10)
    found = calibration.on_fresh_pairs(setting, 5, 0, 0, size, list(calibration.RULES))
    assert [(r.rule, r.answers) for r in found] == [(name, 10) for name in calibration.RULES]
    assert (setting.flips > 0) == ("% flips" in setting.name)
    assert all(0 <= r.wrong <= r.decided <= r.open == calibration.FRESH for r in found)
    values = calibration.scale(setting.law, 20, np.random.default_rng(0))
    assert values[0] == 0
    assert values[-1] == 1
    assert (np.diff(values) > 0).all()


def test_who_calls_equal_what_is_close_flips_the_rest() -> None:
    values, rng = np.array([0.0, 0.3, 1.0]), np.random.default_rng(0)
    d = rng.dirichlet(np.ones(3), 200) - rng.dirichlet(np.ones(3), 200)
    sure, blurred = (calibration.Blurred(values, 0.1, 3, equal).signs(d) for equal in (0.0, 0.05))
    close = np.abs(d @ values) <= 0.05
    assert 5 < close.sum() < 100
    assert (blurred == np.where(close, 0, sure)).all()
    assert 0.02 < (sure != np.sign(d @ values)).mean() < 0.2


def test_questions_are_counted_with_the_lapse_learned_and_told() -> None:
    size = calibration_questions.QUICK._replace(steps=300, states=5)
    one = calibration_questions.run(0.1, 4, 0, size)
    assert min(one.asked, one.asked_told) > 0
    assert 0 < one.lapse < 1
    head, table = calibration_questions.report(size, [4], [0.1], 1)
    assert "2 seeds" in head[-1]
    assert table[-1].startswith("| 4 | 10% | ")


def test_a_stopped_calibration_goes_on_from_its_journal(tmp_path: Path) -> None:
    size = calibration.QUICK._replace(sets=2, runs=1, most=10, steps=50, budget=5)
    journal, chosen = tmp_path / "rows.jsonl", [s for s in calibration.SETTINGS if s.learners][:1]

    def measured(size: calibration.Size) -> list[Row]:
        return calibration.measure(size, 0, 1, chosen, ["posterior"], journal)

    few = measured(size._replace(sets=1))
    found = measured(size)
    assert set(few) < set(found)  # with the seconds that they took then
    assert [row._replace(seconds=0.0) for row in found] == [
        row._replace(seconds=0.0) for row in calibration.measure(size, 0, 1, chosen, ["posterior"])
    ]
    assert measured(size) == found
