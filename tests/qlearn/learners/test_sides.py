"""``drive`` shows the tutor either side first, by chance."""

import numpy as np
import pytest

import elicit
import qlearn
from elicit import Answer, AnswerLog, Query, Verdict
from qlearn.learners.driving import exchanged
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import scaled

MDP, VALUES = qlearn.random_mdp(20, 3, 5, seed=2)


def learner(max_queries: int = 30) -> qlearn.InteractivePolicyIteration:
    comparator = elicit.PosteriorComparator(5, particles=200)
    return qlearn.InteractivePolicyIteration(MDP, comparator, max_queries=max_queries)


def sides(seed: int) -> list[bool]:
    log = AnswerLog(k=5)
    qlearn.drive(learner(), elicit.TruthfulTutor(VALUES), log, seed=seed)
    return [entry.answer.swapped for entry in log]


def test_half_of_the_pairs_are_exchanged_as_the_seed_says() -> None:
    drawn = [sides(seed) for seed in range(scaled(3, 8))]
    assert 0.35 < np.mean([swapped for run in drawn for swapped in run]) < 0.65
    assert sides(1) == drawn[1] != drawn[2]


def test_what_a_tutor_says_of_the_side_it_sees_is_told_in_terms_of_the_learners_left() -> None:
    shown: dict[str, Query] = {}

    def left(query: Query) -> int:
        shown[query.id] = query
        return 1

    log = AnswerLog(k=5)
    qlearn.drive(learner(12), left, log)
    answers = [entry.answer for entry in log]
    assert {answer.verdict for answer in answers} == {Verdict.BETTER, Verdict.WORSE}
    for answer in answers:
        seen = shown[answer.query.id]
        assert answer.swapped == (answer.verdict is Verdict.WORSE)
        own = (seen.right, seen.left) if answer.swapped else (seen.left, seen.right)
        assert (np.stack(own) == np.stack([answer.query.left, answer.query.right])).all()


def test_a_simulated_tutor_says_the_same_of_either_side() -> None:
    by_hand, tutor = learner(), elicit.BradleyTerryTutor(VALUES, 30.0, seed=4)
    while queries := by_hand.ask():
        by_hand.tell([tutor(query) for query in queries])
    for seed in (0, 1):
        driven = qlearn.drive(learner(), elicit.BradleyTerryTutor(VALUES, 30.0, seed=4), seed=seed)
        assert (driven.answers.d == by_hand.result().answers.d).all()
        assert (driven.answers.y == by_hand.result().answers.y).all()


def test_a_replayed_log_keeps_the_sides_that_were_shown() -> None:
    log, again = AnswerLog(k=5), AnswerLog(k=5)
    qlearn.drive(learner(), elicit.BradleyTerryTutor(VALUES, 30.0, seed=4), log, seed=1)
    qlearn.drive(learner(), elicit.ReplayTutor(log), again, seed=2)
    pairs = [(entry.answer.verdict, entry.answer.swapped) for entry in log]
    assert [(entry.answer.verdict, entry.answer.swapped) for entry in again] == pairs


def test_a_tutor_who_cannot_tell_is_heard() -> None:
    result = qlearn.drive(learner(5), lambda query: Answer(query, None))
    assert result.cannot_tell > 0


@pytest.mark.parametrize(
    ("about", "wanted"),
    [
        ("state 3: 0 (left) or 2 (right)?", "state 3: 2 (left) or 0 (right)?"),
        (
            "state 3: action 0 (left) or action 2 (right)?",
            "state 3: action 2 (left) or action 0 (right)?",
        ),
        (
            "state 3: action go (left) or stay (right)?",
            "state 3: action stay (left) or go (right)?",
        ),
        ("of 9 days: 9 b (left), or 5 a (right)?", "of 9 days: 5 a (left), or 9 b (right)?"),
        ("new (left) or old, the best (right)?", "old, the best (left) or new (right)?"),
        ("state a: b: c (left) or d (right)?", "state a: b: c (right) or d (left)?"),
        ("to the (left) (left) or on (right)?", "to the (right) (right) or on (left)?"),
        ("which?", "which?"),
    ],
)
def test_the_words_are_exchanged_with_the_sides(about: str, wanted: str) -> None:
    query = Query("a", [0.5, 0.5], [0.2, 0.8], about)
    other = exchanged(query)
    assert other.about == wanted
    assert other.id == query.id
    assert (tail_sums(other.d) == -tail_sums(query.d)).all()
    assert exchanged(other).about == about
