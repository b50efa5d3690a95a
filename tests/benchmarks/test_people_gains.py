"""Parts of two programs: better predictions of people, and how often bounds hold with them."""

import numpy as np
import pytest

from benchmarks.people import gains, promise
from benchmarks.people.choices import Choices, choices_of
from elicit import Answer, AnswerLog, Query
from elicit.people import repeated_gambles


def test_a_gain_is_the_mean_over_people_of_log_probabilities_gained():
    said = np.array([[1.0, 0.0, np.nan], [1.0, 1.0, 1.0]])
    before, after = np.full((2, 3), 0.5), np.array([[0.8, 0.4, 0.9], [0.5, 0.5, 0.5]])
    wanted = (np.log(0.8 / 0.5) + np.log(0.6 / 0.5)) / 2 / 2
    assert gains.by_person(after, said).tolist() == pytest.approx(
        [(np.log(0.8) + np.log(0.6)) / 2, np.log(0.5)]
    )
    assert gains.gain(after, before, said).startswith(f"{wanted:.4f} [")


def test_a_calibration_curve_counts_every_answer_once():
    chance = np.array([[0.05, 0.07, 0.95, 1.0], [0.45, np.nan, 0.55, 0.51]])
    said = np.array([[0.0, 1.0, 1.0, 1.0], [0.0, 1.0, np.nan, 1.0]])
    rows = gains.curve(chance, said)
    assert [int(row[0]) for row in rows] == [2, 0, 0, 0, 1, 1, 0, 0, 0, 2]
    assert rows[0][1:] == ["0.06", "0.50"]
    assert rows[1][1:] == ["", ""]


def test_the_majority_of_a_half_is_theirs_alone():
    said = np.array([[1.0, 0.0], [1.0, np.nan], [0.0, 0.0]])
    bags = np.array([[0.5, 0.5], [1.0, 0.0]])
    some = Choices(["x", "y", "z"], bags, bags[::-1], np.array([0.0, 1.0]), said, np.ones((3, 2)))
    share = gains.by_the_half(some, np.array([True, True, False]))
    np.testing.assert_allclose(share, [[3 / 4, 1 / 3], [3 / 4, np.nan], [3 / 4, 1 / 3]])


def test_the_best_gamble_is_found_with_a_persons_own_answers():
    log = repeated_gambles(sets=[1])["1"]
    assert gains.bags_of(log).shape == (5, 6)
    asked, ended, preferred = gains.best_of(log, 6, None)
    assert 3 <= asked <= 10
    assert ended == 1
    assert 0 <= preferred <= 1


def test_a_run_is_the_same_again_and_its_row_says_whether_the_bound_held():
    cell = {"states": 15, "k": 5, "tutor": "PersonTutor", "seed": 3}
    row = promise.promised(cell)
    assert row == promise.promised(cell)
    assert row["held"] == (row["loss"] <= row["bound"] + 1e-12)
    assert 0 < row["asked"] <= promise.BUDGET
    assert promise.line(15, "PersonTutor", 5, [row, row | {"held": False}])[-1].startswith(
        "50.0% ["
    )


def test_the_runs_of_all_rows_go_side_by_side():
    plan = promise.cells(2)
    assert len(plan) == 2 * len(promise.STATES) * len(promise.MAKES) * len(promise.LEVELS)
    assert {cell["seed"] for cell in plan[:6]} == {promise.FIRST}
    assert promise.held([{"held": True}] * 95 + [{"held": False}] * 5) == "95.0% [88.7, 98.4]"


def test_drift_is_the_second_half_less_the_first_person_by_person():
    said = np.array([[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 1.0, np.nan]])
    chance = np.array([[0.5, 0.5, 0.2, 0.4], [0.9, 0.8, 0.9, 0.1]])
    when = np.array([[0.0, 1 / 3, 2 / 3, 1.0], [1.0, 0.0, 0.4, np.nan]])
    one = (np.log(0.8) + np.log(0.6)) / 2 - np.log(0.5)
    other = np.log(0.9) - (np.log(0.8) + np.log(0.9)) / 2
    assert gains.drift(chance, said, when).startswith(f"{(one + other) / 2:.4f} [")


def test_the_order_is_that_of_each_persons_log():
    logs = {}
    for who, order in {"x": (0, 1, 2), "y": (2, 0, 1)}.items():
        logs[who] = AnswerLog(k=2, header={"amounts": [0, 4]})
        for i in order:
            bags = [0.1 * i, 1 - 0.1 * i], [0.5, 0.5]
            logs[who].append(Answer(Query(f"question {i}", *bags), 1))
    when = gains.order_of(choices_of(logs), logs)
    assert when.tolist() == [[0.0, 0.5, 1.0], [0.5, 1.0, 0.0]]
