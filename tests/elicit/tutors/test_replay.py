"""A replayed log says what it said."""

import numpy as np
import pytest

from elicit import Answer, AnswerLog, FlippingTutor, NotInLog, Query, ReplayTutor, Verdict
from elicit.tutors.answer_log import Entry


def query(d, name):
    return Query(name, np.clip(d, 0, None), np.clip(np.negative(d), 0, None))


def test_what_was_retracted_is_not_replayed():
    asked = query([0.5, -1, 0.5], "q")
    log = AnswerLog()
    log.append(Answer(asked, Verdict.BETTER))
    log.retract("q")
    with pytest.raises(NotInLog):
        ReplayTutor(log)(asked)
    log.append(Answer(asked, Verdict.WORSE))
    assert ReplayTutor(log)(asked).verdict is Verdict.WORSE


def test_a_log_replays_by_id_and_by_pair():
    rng = np.random.default_rng(1)
    d = rng.dirichlet(np.ones(5), 30) - rng.dirichlet(np.ones(5), 30)
    tutor = FlippingTutor([3, 10, 11, 40, 99], 0.3, 1)
    answers = [tutor(query(row, f"id {i}")) for i, row in enumerate(d)]
    log = AnswerLog()
    for answer in answers:
        log.append(answer)
    replay = ReplayTutor(log)
    assert [replay(a.query).verdict for a in reversed(answers)] == [
        a.verdict for a in reversed(answers)
    ]
    by_pair = ReplayTutor(log)
    assert [by_pair(query(row, f"other {i}")).verdict for i, row in enumerate(d)] == [
        a.verdict for a in answers
    ]
    mirrored = ReplayTutor(answers)
    found = [mirrored(query(-row, f"other {i}")) for i, row in enumerate(d)]
    assert [a.verdict for a in found] == [a.verdict.flipped for a in answers]
    assert all(a.swapped for a in found)
    assert all(a.query.id.startswith("other") for a in found)


def test_repeated_pairs_replay_in_order_and_a_repeated_id_stays():
    d = [0.5, -1, 0, 0, 0.5]
    verdicts = [Verdict.BETTER, None, Verdict.EQUAL, Verdict.WORSE]
    log = [Answer(query(d, f"q{i}"), v) for i, v in enumerate(verdicts)]
    replay = ReplayTutor(log)
    assert [replay(query(d, f"r{i}")).verdict for i in range(4)] == verdicts
    assert [replay(query(d, f"r{i}")).verdict for i in (3, 0, 2)] == [
        verdicts[i] for i in (3, 0, 2)
    ]
    with pytest.raises(LookupError, match="all 4 answers"):
        replay(query(d, "r4"))
    # an id takes its own answer out of the queue of its pair
    mixed = ReplayTutor(log)
    assert mixed(query(d, "q0")).verdict is Verdict.BETTER
    assert mixed(query(d, "x")).verdict is None
    assert mixed(query(d, "q0")).verdict is Verdict.BETTER
    # and it has its own answer even where another query of the same pair came first
    taken = ReplayTutor(log[:1])
    assert [taken(query(d, name)).verdict for name in ("x", "q0", "q0", "x")] == [
        Verdict.BETTER
    ] * 4


def test_an_id_answered_twice_replays_twice():
    d = [0.5, -1, 0, 0, 0.5]
    replay = ReplayTutor(
        [Answer(query(d, "q"), Verdict.BETTER), Answer(query(d, "q"), Verdict.WORSE)]
    )
    assert [replay(query(d, "q")).verdict for _ in range(3)] == [
        Verdict.BETTER,
        Verdict.WORSE,
        Verdict.WORSE,
    ]


def test_signed_zeros_and_unused_entries_are_found():
    zero = Query("a", [0.5, 0.0, 0.5], [0.0, 1.0, 0.0])
    minus = Query("b", [0.5, -0.0, 0.5], [-0.0, 1.0, 0.0])
    replay = ReplayTutor([Entry(Answer(zero, Verdict.WORSE, swapped=True), used=False)])
    assert replay(minus) == Answer(minus, Verdict.WORSE, swapped=True)


def test_a_query_that_the_log_does_not_hold():
    replay = ReplayTutor([Answer(query([1, -1, 0, 0, 0], "known"), Verdict.WORSE)])
    with pytest.raises(NotInLog, match="stranger"):
        replay(query([0, 0, -1, 0.5, 0.5], "stranger"))
    with pytest.raises(NotInLog, match="other vectors"):
        replay(query([0, 0, -1, 0.5, 0.5], "known"))
