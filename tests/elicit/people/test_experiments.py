"""Loaded answers are those of the tables: counts, sides, order, indifference.

The tables that may not be shipped are checked if ELICIT_PEOPLE names their folder.
"""

import csv
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import elicit
from elicit.model.pairs import pair_numbers
from elicit.people import GAMBLES, lottery_choices, repeated_gambles
from elicit.people import experiments as module

QUESTIONS = """Choice,x1a,x2a,x3a,x4a,p1a,p2a,p3a,p4a,x1b,x2b,x3b,x4b,p1b,p2b,p3b,p4b
1,10,20,,,0.5,0.5,,,15,,,,1,,,
2,0,40,30,,0.5,0.5,0,,10,20,30,40,0.25,0.25,0.25,0.25
"""
CHOICES = """subject,question,rank,a_on_top,preferred
x,1,2,1,a
x,2,1,0,b
y,1,1,0,a
"""
HEAD = "participant,set,left,right,left_better,right_better,indifferent\n"
FOLDER = os.environ.get("ELICIT_PEOPLE", "")
needs_folder = pytest.mark.skipif(not FOLDER, reason="ELICIT_PEOPLE names no folder of tables")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "lotteries_questions.csv").write_text(QUESTIONS)
    (tmp_path / "lotteries_answers.csv").write_text(CHOICES)
    return tmp_path


def check_counts(logs, path, sets):
    """Every count of the table is that of the log."""
    with open(path, newline="") as file:
        rows = [row for row in csv.DictReader(file) if int(row["set"]) in sets]
    assert {row["participant"] for row in rows} == logs.keys()
    counts = {
        who: Counter(
            (entry.answer.query.id.rsplit(":", 1)[0], int(entry.answer.verdict)) for entry in log
        )
        for who, log in logs.items()
    }
    for row in rows:
        pair = f"{row['set']}:{row['left']}{row['right']}"
        found = [counts[row["participant"]][pair, verdict] for verdict in (1, -1, 0)]
        assert found == [int(row[name]) for name in ("left_better", "right_better", "indifferent")]


def test_the_shipped_answers_are_those_of_the_table():
    logs = repeated_gambles()
    assert len(logs) == 18
    assert {len(log) for log in logs.values()} == {2 * 10 * 20}
    check_counts(logs, Path(module.__file__).with_name("data") / "gambles_20_times.csv", {1, 2})
    log = logs["1"]
    assert log.k == 11
    assert len(set(pair_numbers(log.answers().d))) == 20
    for entry in log:
        query = entry.answer.query
        number, pair, _ = query.id.split(":")
        for name, side in zip(pair, (query.left, query.right), strict=True):
            chance, prize = GAMBLES[int(number)][name]
            assert side.sum() == pytest.approx(1, abs=1e-12)
            assert side @ log.header["amounts"] == pytest.approx(chance * prize, abs=1e-9)
            assert side[0] == pytest.approx(1 - chance, abs=1e-12)
            assert np.count_nonzero(side) == 2


def test_one_set_has_the_levels_of_its_prizes():
    log = repeated_gambles(sets=[2])["3"]
    assert log.header["amounts"] == [0, 20, 22, 24.44, 27.5, 31.43]
    assert log.header["labels"][-1] == "31.43"
    assert len(log) == 200


def test_the_gambles_are_as_described():
    tversky = [5, 4.75, 4.5, 4.25, 4]
    for (chance, prize), old, times in zip(GAMBLES[1].values(), tversky, range(7, 12), strict=True):
        assert (chance, prize) == (times / 24, pytest.approx(5.6 * old))
    assert [chance * prize for chance, prize in GAMBLES[2].values()] == pytest.approx(
        [8.8] * 5, abs=0.005
    )


def test_the_order_of_counted_answers_is_of_the_seed():
    def said(seed, who="2"):
        return [
            (entry.answer.query.id, entry.answer.verdict)
            for entry in repeated_gambles(sets=[1], seed=seed)[who]
        ]

    five, six = said(5), said(6)
    assert said(5) == five
    assert five != six
    assert sorted(five) == sorted(six)


def test_indifferent_is_equal(tmp_path):
    table = tmp_path / "counts.csv"
    table.write_text(HEAD + "p,1,a,b,1,2,3\np,3,a,b,9,9,9\nq,3,a,b,9,9,9\n")
    logs = repeated_gambles(table)
    assert list(logs) == ["p"]  # q answered about no set with levels
    assert Counter(logs["p"].answers().y.tolist()) == {1: 1, -1: 2, 0: 3}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("participant,set\n", "has no column left, right, left_better, right_better, indifferent"),
        (HEAD + "p,1,a,z,1,2,3\n", "line 2: there is no pair 'a', 'z' in set 1"),
        (HEAD + "p,1,a,a,1,2,3\n", "there is no pair 'a', 'a'"),
        (HEAD + "p,1,a,b,1,-2,3\n", "line 2: '-2' is not a whole number"),
        (HEAD + "p,1,a,b,1\n", "line 2: the row has too few fields"),
    ],
)
def test_a_table_of_another_kind_is_refused(tmp_path, text, message):
    table = tmp_path / "counts.csv"
    table.write_text(text)
    with pytest.raises(ValueError, match=message):
        repeated_gambles(table)


def test_a_set_without_levels_is_refused():
    with pytest.raises(ValueError, match="sets of gambles with levels are 1, 2, not"):
        repeated_gambles(sets=[3])


def test_lottery_choices_keep_order_sides_and_preferences(folder):
    logs = lottery_choices(folder, knots=[0, 20, 40])
    assert list(logs) == ["x", "y"]
    first, second = (entry.answer for entry in logs["x"])
    assert (first.query.id, first.verdict, first.swapped) == (
        "question 2",
        elicit.Verdict.WORSE,
        True,
    )
    assert (second.query.id, second.verdict, second.swapped) == (
        "question 1",
        elicit.Verdict.BETTER,
        False,
    )
    assert second.query.left.tolist() == [0.25, 0.75, 0]  # 10 lies half way between 0 and 20
    assert second.query.right.tolist() == [
        0.25,
        0.75,
        0,
    ]  # of 15, three quarters: the spread is lost, the mean is not
    assert first.query.left.tolist() == [0.5, 0, 0.5]
    assert first.query.right == pytest.approx([0.125, 0.5, 0.375])


def test_knots_are_chosen_among_the_amounts(folder):
    assert lottery_choices(folder, levels=3)["y"].header["amounts"] == [0, 20, 40]


def test_a_missing_table_says_where_the_numbers_are(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"vspinu/reference-point.*docs/people\.md"):
        lottery_choices(tmp_path)


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ("x,3,1,1,a", "no question '3'"),
        ("x,1,1,1,c", "preferred must be a or b"),
        ("x,1,one,1,a", "'one' is not a whole number"),
    ],
)
def test_a_wrong_choice_is_refused_with_its_line(folder, choice, message):
    (folder / "lotteries_answers.csv").write_text(CHOICES + choice + "\n")
    with pytest.raises(ValueError, match=rf"lotteries_answers.csv, line 5: .*{message}"):
        lottery_choices(folder)


def test_a_log_of_a_person_goes_where_logs_go():
    log = repeated_gambles(sets=[1])["4"]
    report = elicit.tutor_report(log[:60], k=6)
    assert report.answers == 60
    scores = elicit.held_out(elicit.PosteriorComparator(6, particles=100), log[:60], folds=2)
    assert scores.scored == 60


@needs_folder
def test_the_real_tables_that_are_not_shipped_load():
    table = Path(FOLDER) / "gambles_45_times.csv"
    logs = repeated_gambles(table)
    check_counts(logs, table, {1, 2})
    assert {len(log) for log in logs.values()} == {2 * 10 * 45}
    people = lottery_choices(FOLDER)
    assert len(people) == 139
    assert sum(map(len, people.values())) == 9729
    swapped = np.mean([entry.answer.swapped for log in people.values() for entry in log])
    assert 0.48 < swapped < 0.52
