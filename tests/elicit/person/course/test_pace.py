"""The pace of a person by the times in a log."""

import numpy as np
import pytest

from elicit import Answer, AnswerLog, Query
from elicit.person.course.pace import SECONDS, Pace


def log_of(*latencies: float | None) -> AnswerLog:
    log = AnswerLog()
    for i, seconds in enumerate(latencies):
        query = Query(f"q{i}", np.array([0.0, 1, 0]), np.array([0.5, 0, 0.5]))
        log.append(Answer(query, 1), **({} if seconds is None else {"latency": seconds}))
    return log


@pytest.mark.parametrize(
    ("took", "seconds", "spent", "hasty"),
    [
        ((), SECONDS, 0, 0),
        ((4.0, 6.0), SECONDS, 10, 0),  # the pace is not known yet
        ((5.0, None, 5.0, 9.0), 17, 19, 0),  # another program's line has no time
        ((10.0, 10.0, 5000.0), 18, 38, 0),  # a break counts as one question
        ((*[10.0] * 6, 5000.0), 10, 70, 0),
        ((*[0.2] * 2, *[0.99] * 4, 1.0), 1, 5.36, 6),  # no pace is below a second
    ],
)
def test_the_pace_is_that_of_the_answers(
    took: tuple[float | None, ...], seconds: float, spent: float, hasty: int
) -> None:
    found = Pace.of(log_of(*took))
    assert found.seconds == seconds
    assert found.spent == pytest.approx(spent)
    assert found.hasty == hasty


def test_an_answer_that_was_taken_back_does_not_count() -> None:
    log = log_of(10.0, 0.1, 10.0, 30.0)
    log.retract("q1")
    assert Pace.of(log) == Pace(18.0, 50.0, 0, 3)


@pytest.mark.parametrize("seconds", [5.0, 11.0, 60.0])
def test_the_pace_comes_to_the_persons_own_without_a_jump(seconds: float) -> None:
    paces = [Pace.of(log_of(*[seconds] * n)).seconds for n in range(12)]
    assert paces[:3] == [SECONDS] * 3
    assert paces[7:] == [seconds] * 5
    assert np.abs(np.diff(paces)).max() <= 1.01 * abs(seconds - SECONDS) / 5
    if seconds < SECONDS:  # time falls where the number of questions falls
        minutes = [Pace.of(log_of(*[seconds] * n)).minutes_for(16 - n) for n in range(12)]
        assert minutes == sorted(minutes, reverse=True)


def test_three_fast_answers_are_said_and_fewer_are_not() -> None:
    assert Pace.of(log_of(0.5, 0.5, 9.0)).remark() is None
    assert str(Pace.of(log_of(0.5, 0.5, 0.5, 9.0)).remark()).startswith("3 of 4 answers came in")
    # it stays said, however many slower ones follow
    for slower in (13, 200):
        said = str(Pace.of(log_of(*[0.5] * 3, *[9.0] * slower)).remark())
        assert said.startswith(f"3 of {3 + slower} answers came in under a second")


def test_questions_that_fit_into_the_time_that_is_left() -> None:
    assert Pace().questions_in(5) == 15
    assert Pace(seconds=10.0, spent=250.0).questions_in(5) == 5
    assert Pace(seconds=10.0, spent=400.0).questions_in(5) == 0
    assert (Pace().minutes_for(9), Pace().minutes_for(0)) == (3, 1)
