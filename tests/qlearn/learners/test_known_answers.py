"""Earlier answers are known: a learner starts from them and asks none of them again.

Audits have a limit."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import (
    Answer,
    AnswerLog,
    Answers,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    TruthfulTutor,
    Verdict,
)
from elicit.asking.options import MAX_AUDITS
from elicit.model.pairs import pair_numbers
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    InteractiveValueIteration,
    LateQLearning,
    LateValueIteration,
    Status,
    drive,
    random_mdp,
)
from tests.thoroughness import on_any_processor, quick_first

LEARNERS = {
    "policy iteration": InteractivePolicyIteration,
    "value iteration": InteractiveValueIteration,
    "late value iteration": LateValueIteration,
    "Q-learning": partial(InteractiveQLearning, steps=4000),
    "late Q-learning": partial(LateQLearning, steps=4000),
}
MDP, VALUES = random_mdp(30, 4, 5, rng=3)


def repeats(answers: Answers, before: int) -> bool:
    """Return whether an answer after the first so many is about a pair that one of these was
    about.
    """
    pairs = pair_numbers(answers.d)
    return bool(set(pairs[:before].tolist()) & set(pairs[before:].tolist()))


@pytest.mark.parametrize("name", LEARNERS)
def test_a_finished_run_starts_again_without_a_question(name, tmp_path):
    log = AnswerLog(tmp_path / "answers.jsonl")
    first = drive(LEARNERS[name](MDP, PolytopeComparator(5)), TruthfulTutor(VALUES), log)
    assert first.asked >= 3
    for known in (
        log,
        AnswerLog.read(tmp_path / "answers.jsonl"),
        first.answers,
        [entry.answer for entry in log],
    ):
        again = LEARNERS[name](MDP, PolytopeComparator(5), known=known)
        result = drive(again, TruthfulTutor(VALUES))
        assert result.asked == 0 or not repeats(result.answers, len(first.answers))
        assert result.asked <= (
            0 if "late" not in name and name != "Q-learning" else first.asked // 2
        )
        assert result.answers.ids[: len(first.answers)] == first.answers.ids


@pytest.mark.parametrize("name", LEARNERS)
def test_a_run_cut_off_goes_on_and_asks_nothing_twice(name):
    whole = drive(LEARNERS[name](MDP, PolytopeComparator(5)), TruthfulTutor(VALUES))
    half = whole.answers[: len(whole.answers) // 2]
    rest = drive(LEARNERS[name](MDP, PolytopeComparator(5), known=half), TruthfulTutor(VALUES))
    assert not repeats(rest.answers, len(half))
    assert rest.loss_bound <= whole.loss_bound + 0.02


def test_todays_answers_serve_tomorrows_comparator():
    told = drive(
        InteractivePolicyIteration(MDP, PolytopeComparator(5)), TruthfulTutor(VALUES)
    ).answers
    fresh = drive(
        InteractivePolicyIteration(MDP, PosteriorComparator(5), tolerance=0.005),
        TruthfulTutor(VALUES),
    )
    result = drive(
        InteractivePolicyIteration(MDP, PosteriorComparator(5), tolerance=0.005, known=told),
        TruthfulTutor(VALUES),
    )
    assert result.asked < fresh.asked
    assert not repeats(result.answers, len(told))


def test_an_answer_in_the_middle_is_taken_back():
    log = AnswerLog()
    drive(InteractivePolicyIteration(MDP, PolytopeComparator(5)), TruthfulTutor(VALUES), log)
    back = [entry.answer.query for entry in log][2]
    log.retract(back.id)
    learner = InteractivePolicyIteration(MDP, PolytopeComparator(5), known=log)
    result = drive(learner, TruthfulTutor(VALUES))
    kept = len(log) - 1
    assert len(result.answers) - result.asked == kept
    assert not repeats(result.answers, kept)


def test_a_comparator_that_knows_them_already_does_not_learn_them_twice():
    told = drive(
        InteractivePolicyIteration(MDP, PosteriorComparator(5)), TruthfulTutor(VALUES)
    ).answers[:6]
    learned = PosteriorComparator(5).update(told)
    assert InteractivePolicyIteration(MDP, learned, known=told).comparator is learned
    other = Answers(
        -told.d[:1], [-told.y[0]], [told.ids[0]]
    )  # another difference under the same id
    assert len(InteractivePolicyIteration(MDP, learned, known=other).comparator.answers) == 7


@pytest.mark.parametrize("name", ["policy iteration", "value iteration"])
def test_what_could_not_be_told_is_not_asked_again(name):
    learner: Any = LEARNERS[name](MDP, PolytopeComparator(5))
    query = learner.ask()[0]
    again = LEARNERS[name](MDP, PolytopeComparator(5), known=[Answer(query, None)])
    result = drive(again, TruthfulTutor(VALUES))
    assert not repeats(Answers([query.d], [1]) + result.answers, 1)
    assert result.status in (Status.UNSURE, Status.CONVERGED, Status.EXHAUSTED)
    assert result.cannot_tell == 0  # by this learner


def test_audits_count_when_a_run_goes_on():
    log = AnswerLog()
    settings = {"audit": 1.0, "max_audits": 7, "rng": 1}
    first = drive(
        InteractiveValueIteration(MDP, PolytopeComparator(5), **settings),
        TruthfulTutor(VALUES),
        log,
    )
    assert first.audited == 7
    again = drive(
        InteractiveValueIteration(MDP, PolytopeComparator(5), known=log, **settings),
        TruthfulTutor(VALUES),
    )
    assert again.audited == 7
    assert [(audit.query.id, audit.expected) for audit in again.audits] == [
        (audit.query.id, audit.expected) for audit in first.audits
    ]
    assert again.asked == 0


@on_any_processor
@pytest.mark.parametrize("batch", quick_first([1, 4], 1))
@pytest.mark.parametrize("name", quick_first(LEARNERS, 2))
def test_audits_have_a_limit(name, batch):
    def audited(**settings: Any) -> int:
        learner = LEARNERS[name](MDP, PolytopeComparator(5), audit=1.0, batch=batch, **settings)
        return drive(learner, FlippingTutor(VALUES, 0.02), on_conflict="drop").audited

    usual = audited()
    assert usual <= MAX_AUDITS
    assert audited(max_audits=3) <= 3
    assert audited(max_audits=0) == 0
    if name == "value iteration":
        assert audited(max_audits=MAX_AUDITS + 20) > MAX_AUDITS == usual


@pytest.mark.parametrize(
    ("known", "error", "says"),
    [
        ([1], TypeError, "list of elicit.Answer"),
        ([Answer(Query("q", [1.0, 0.0], [0.0, 1.0]), Verdict.BETTER)], ValueError, "other levels"),
        (Answers.none(3), ValueError, "3 levels"),
        (7, TypeError, "known"),
        (
            "answers.jsonl",
            TypeError,
            r"not the path of a file: open it, known=elicit.AnswerLog\('answers.jsonl'\)",
        ),
        (
            Path("answers.jsonl"),
            TypeError,
            r"or only read it, known=elicit.AnswerLog.read\(.*'answers.jsonl'\)",
        ),
    ],
)
def test_what_is_no_answer_is_refused(known, error, says):
    with pytest.raises(error, match=says):
        InteractivePolicyIteration(MDP, PolytopeComparator(5), known=known)


def test_more_audits_than_none_is_a_whole_number():
    with pytest.raises(ValueError, match="max_audits must be"):
        InteractivePolicyIteration(MDP, PolytopeComparator(5), max_audits=1.5)


def test_answers_are_of_their_codes():
    query = Query("q", np.array([0.5, 0.5]), np.array([1.0, 0.0]))
    for wrong in (True, np.True_, 1.0, np.float64(0.0), "better"):
        with pytest.raises(TypeError, match="is written 1 if left > right"):
            Answer(query, wrong)
        with pytest.raises(TypeError, match="is written 1 if left > right"):
            Answers([query.d], [wrong])
    for code in (1, np.int8(1), Verdict.BETTER):
        assert Answer(query, code).verdict is Verdict.BETTER
    with pytest.raises(ValueError, match="not 3"):
        Answer(query, 3)
