"""A replayed person gives each of their answers once, in any order of questions."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import Answer, AnswerLog, Query, Tutor, Verdict
from elicit.people import NoRepeatLeft, RepeatedAnswersTutor, repeated_gambles

PAIRS = [([0, 1, 0], [0.5, 0, 0.5]), ([0, 1, 0], [0.3, 0, 0.7]), ([0.5, 0.5, 0], [0.7, 0, 0.3])]


def person(verdicts):
    """Answers to each pair in turn, by lists of verdicts."""
    return [
        Answer(Query(f"{pair}:{i}", *PAIRS[pair]), verdict)
        for pair, said in enumerate(verdicts)
        for i, verdict in enumerate(said)
    ]


def ask(tutor, pair, flipped=False):
    left, right = PAIRS[pair][::-1] if flipped else PAIRS[pair]
    return tutor(Query("asked", left, right))


@given(
    st.lists(st.lists(st.sampled_from([-1, 0, 1]), min_size=1, max_size=6), min_size=3, max_size=3),
    st.lists(st.tuples(st.integers(0, 2), st.booleans()), max_size=30),
    st.integers(0, 5),
)
def test_every_answer_is_given_once_whatever_is_asked(verdicts, questions, seed):
    tutor = RepeatedAnswersTutor(person(verdicts), seed)
    left = [Counter(said) for said in verdicts]
    for pair, flipped in questions:
        query = Query("asked", *(PAIRS[pair][::-1] if flipped else PAIRS[pair]))
        rest = left[pair].total()
        assert tutor.left_over(query) == rest
        most = max(left[pair].values(), default=0)
        winners = [verdict for verdict, count in left[pair].items() if count == most and most]
        truth = tutor.truth(query)
        assert truth == (winners[0] * (-1 if flipped else 1) if len(winners) == 1 else None)
        if not rest:
            with pytest.raises(NoRepeatLeft, match="were used"):
                tutor(query)
            continue
        answer = tutor(query)
        assert answer.query is query
        verdict = int(answer.verdict) * (-1 if flipped else 1)
        left[pair][verdict] -= 1
        assert left[pair][verdict] >= 0


def test_the_order_of_questions_does_not_change_what_a_pair_is_answered():
    log = person([[1, -1, 0, 1, 1, -1]] * 3)
    one, other = RepeatedAnswersTutor(log, 7), RepeatedAnswersTutor(log, 7)
    straight = [[ask(one, pair).verdict for _ in range(6)] for pair in range(3)]
    mixed = [[ask(other, pair).verdict for pair in (2, 0, 1)] for _ in range(6)]
    assert [list(row) for row in zip(*mixed, strict=True)] == [
        straight[2],
        straight[0],
        straight[1],
    ]
    assert straight != [
        [ask(RepeatedAnswersTutor(log, seed), pair).verdict for pair in range(3)]
        for seed in range(6)
    ]


def test_an_exchanged_pair_is_answered_the_other_way_and_keeps_its_side():
    log = [Answer(Query("q", *PAIRS[0]), Verdict.BETTER, swapped=True)]
    answer = ask(RepeatedAnswersTutor(log), 0, flipped=True)
    assert (answer.verdict, answer.swapped) == (Verdict.WORSE, False)
    answer = ask(RepeatedAnswersTutor(log), 0)
    assert (answer.verdict, answer.swapped) == (Verdict.BETTER, True)


def test_a_pair_of_both_directions_is_one_pair():
    log = [Answer(Query("q", *PAIRS[0]), 1), Answer(Query("r", *PAIRS[0][::-1]), -1)]
    tutor = RepeatedAnswersTutor(log)
    assert [ask(tutor, 0).verdict, ask(tutor, 0).verdict] == [1, 1]


def test_a_pair_that_was_never_put_is_an_error():
    tutor = RepeatedAnswersTutor(person([[1], [1], []]))
    with pytest.raises(NoRepeatLeft, match="never asked about the pair of query asked"):
        ask(tutor, 2)
    with pytest.raises(LookupError):
        tutor.truth(Query("asked", *PAIRS[2]))
    assert tutor.left_over(Query("asked", *PAIRS[2])) == 0
    with pytest.raises(ValueError, match="asked about 3 levels, but the query is about 2"):
        tutor(Query("asked", [0, 1], [1, 0]))


def test_what_cannot_be_replayed_is_left_out_or_refused():
    log = AnswerLog()
    for answer in person([[1, None, -1], [], []]):
        log.append(answer)
    log.retract("0:2")
    tutor = RepeatedAnswersTutor(log)
    assert repr(tutor) == "RepeatedAnswersTutor(1 answers about 1 pairs, 0 used)"
    assert isinstance(tutor, Tutor)
    assert tutor.k == 3
    with pytest.raises(ValueError, match="one number of levels are wanted, not about none"):
        RepeatedAnswersTutor([])
    with pytest.raises(ValueError, match=r"not about \[2, 3\]"):
        RepeatedAnswersTutor([*person([[1], [], []]), Answer(Query("q", [0, 1], [1, 0]), 1)])


def test_a_shipped_person_answers_all_pairs_and_the_truth_is_the_majority():
    log = repeated_gambles(sets=[1])["2"]
    tutor = RepeatedAnswersTutor(log, seed=None)
    assert (
        RepeatedAnswersTutor(log, tutor.seed)(log[0].answer.query).verdict
        is tutor(log[0].answer.query).verdict
    )
    fresh = RepeatedAnswersTutor(log)
    for entry in log:
        query = entry.answer.query
        votes = [e.answer.verdict for e in log if np.array_equal(e.answer.query.d, query.d)]
        majority = np.sign(sum(votes))
        assert fresh.truth(query) == (majority or None)
