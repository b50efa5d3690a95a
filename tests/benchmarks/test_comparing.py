"""The benchmarks run, time what they say they time, and agree on every verdict. No test looks at a
time.
"""

import re

import numpy as np
import pytest

from benchmarks.comparing import big_batch as batch
from benchmarks.comparing import comparison_cost as lp
from benchmarks.comparing import lp_methods as methods
from benchmarks.comparing.recorded_streams import Recorder, Stream, cuts, needed_rows, record
from benchmarks.quotes import table_rows
from elicit import Answers, Comparator, PolytopeComparator, TruthfulTutor, Verdict
from qlearn import InteractiveQLearning, drive, random_mdp
from tests.report_cases import quick_report
from tests.scale_arithmetic import tail_sums

MARGIN = 1e-6


@pytest.fixture(scope="module")
def stream() -> Stream:
    return record("Q-learning", 4, seed=1, steps=1500)


@pytest.mark.slow
def test_the_quick_run_times_every_method_on_both_streams_without_disagreement(tmp_path):
    text = quick_report("benchmarks.comparing.comparison_cost", tmp_path)
    assert re.findall(r"^## (.*, k = \d+)$", text, re.MULTILINE) == [
        "Q-learning, k = 5",
        "IVI, k = 5",
    ]
    timed = [row for row in table_rows(text) if len(row) == 7 and row[0] != "method"]
    names = [*(entry.name for entry in lp.ENTRIES), "PolytopeComparator, the same segments again"]
    assert [row[0] for row in timed] == 2 * names
    assert [row[-1] for row in timed] == ["0"] * len(timed)
    assert all(int(row[1].replace(",", "")) > 0 for row in timed)
    assert [row[0] for row in table_rows(text) if len(row) == 4][1:] == [
        "PolytopeComparator, one fresh batch"
    ]


def test_a_method_that_errs_or_fails_is_shown_to(stream):
    class Wrong(methods.Ours):
        def compare(self, d):
            verdicts = super().compare(d)
            verdicts[0] = methods.FAILED
            return verdicts

    truth = lp.run(methods.Ours, stream).verdicts
    with_rows = sum(len(segment.d) > 0 for segment in stream.segments)
    found = lp.cost(lp.Entry("wrong", Wrong), stream, truth, 0.0, 1)
    assert found.wrong == with_rows
    assert found.rows == len(stream)


def test_a_method_without_an_optimum_has_failed():
    class NoOptimum(methods.TwoPrograms):
        def least(self, t):
            return np.nan

    assert NoOptimum(3, MARGIN).compare(np.array([[0.5, -1.0, 0.5]])).tolist() == [methods.FAILED]


@pytest.mark.parametrize(
    "make", [entry.make for entry in lp.ENTRIES], ids=[entry.name for entry in lp.ENTRIES]
)
def test_every_method_knows_better_worse_equal_unknown_and_ties(make):
    d = np.array(
        [[-1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 0.0], [1.0, -2.0, 1.0], [2.0, -3.0, 1.0]]
    )
    method = make(3, MARGIN)
    assert method.compare(d).tolist() == [1, -1, 0, 2, 2]
    method.learn(Answers(d[3:4], [1]))  # the middle level is worth at most a half
    assert method.compare(d).tolist() == [1, -1, 0, 1, 2]
    tied = make(3, MARGIN)
    tied.learn(Answers(d[3:4], [0]))
    assert tied.compare(d[4:]).tolist() == [-1]


def test_recording_changes_nothing_and_keeps_what_was_put_to_the_comparator_in_order(stream):
    mdp, values = random_mdp(100, 5, 4, rng=1)
    assert np.array_equal(values, stream.values)
    plain = drive(
        InteractiveQLearning(mdp, PolytopeComparator(4), steps=1500, epsilon=0.1, rng=1),
        TruthfulTutor(values),
    )
    assert np.array_equal(plain.answers.d, stream.answers.d)
    assert np.array_equal(plain.answers.y, stream.answers.y)
    assert [known for known, _ in stream.segments] == list(range(len(stream.answers) + 1))
    comparator = PolytopeComparator(4)
    for i, (new, d) in enumerate(stream.steps()):
        comparator = comparator.update(new)
        if i == len(stream.answers):
            break
        asked = (tail_sums(d) == tail_sums(stream.answers.d[i])).all(axis=1)
        assert (
            asked.any()
        )  # what was asked next had been put to this comparator, which could not tell
        assert comparator.compare(d)[asked].tolist() == [Verdict.UNKNOWN] * asked.sum()
    assert np.array_equal(comparator.answers.d, stream.answers.d)


def test_a_recorder_is_a_comparator():
    record_of_calls: list = []
    recorder = Recorder(PolytopeComparator(3), record_of_calls)
    assert isinstance(recorder, Comparator)
    recorder.compare([0.5, -1.0, 0.5])
    after = recorder.update(Answers([[0.5, -1.0, 0.5]], [1]))
    after.compare(np.eye(3))
    recorder.compare([[0.0, 1.0, -1.0]])  # the old one still answers, as what it was
    assert [(known, [len(d) for d in calls]) for known, calls in record_of_calls] == [
        (0, [1, 1]),
        (1, [3]),
    ]


def test_a_sample_is_spread_over_the_run_and_keeps_all_answers(stream):
    chosen = lp.sample(10_000, 500)
    assert chosen.sum() == 500
    assert chosen.reshape(4, -1).sum(axis=1) == pytest.approx([125, 125, 125, 125], abs=lp.BLOCK)
    assert chosen[: lp.BLOCK].all()
    assert chosen[-lp.BLOCK :].all()
    assert lp.sample(30, 100).all()
    part = stream.take(lp.sample(len(stream), 50))
    assert sum(len(new) for new, _ in part.steps()) == len(stream.answers)
    every = np.concatenate([d for _, d in stream.segments])
    assert np.array_equal(
        np.concatenate([d for _, d in part.segments]), every[lp.sample(len(stream), 50)]
    )


def test_needed_rows_do_not_count_what_follows_from_the_others():
    d = np.array([[0.5, -1.0, 0.5], [0.6, -1.0, 0.4], [0.5, -1.0, 0.5], [-1.0, 0.5, 0.5]])
    assert needed_rows(Answers(d[:1], [1]), MARGIN) == 1
    assert needed_rows(Answers(d, [1, 1, 1, 1]), MARGIN) == 1  # e_2 <= .4 alone
    assert needed_rows(Answers(d[:2], [1, -1]), MARGIN) == 2  # .4 <= e_2 <= .5


def test_cuts_say_what_the_answers_say():
    rows, limits = cuts(Answers([[2.0, -4.0, 2.0], [2.0, -4.0, 2.0], [-1.0, 0.5, 0.5]], [1, -1, 0]))
    assert rows.tolist() == [[-1, 1], [1, -1], [1, 0.5], [-1, -0.5]]
    assert limits.tolist() == [0, 0, -2e-9, -2e-9]


def test_the_batch_is_drawn_as_stated_and_its_answers_are_true(stream):
    few = len(stream.answers)
    answers = batch.just(few + 10, stream, MARGIN, seed=0)
    assert np.array_equal(answers.d[:few], stream.answers.d)
    assert len(answers) == few + 10
    assert np.array_equal(answers.y, TruthfulTutor(stream.values).signs(answers.d))
    assert len(batch.just(5, stream, MARGIN, seed=0)) == 5
    rows = batch.differences(stream, 1000, seed=0)
    recorded = {row.tobytes() for _, d in stream.segments for row in d}
    assert sum(row.tobytes() in recorded for row in rows) == 900
    assert rows.sum(axis=1) == pytest.approx(np.zeros(1000), abs=1e-12)
