"""Drift is tested by Fisher's exact test, and said only if it is significant."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import fisher_exact

from elicit import Answer, AnswerLog, Query
from elicit.person.course.drift import Drift
from elicit.tutors.answer_log import EXPECTED, REPEATS

LEFT, RIGHT = np.array([0.0, 1.0, 0.0]), np.array([0.5, 0.0, 0.5])


def test_the_p_value_is_that_of_another_library() -> None:
    for first, second in product(range(1, 7), range(1, 7)):
        for a, b in product(range(first + 1), range(second + 1)):
            theirs = fisher_exact([[a, first - a], [b, second - b]]).pvalue
            assert Drift(first, a, second, b).p_value == pytest.approx(theirs)


def log_of(differs: list[bool]) -> AnswerLog:
    """A log of as many questions, each put again at once."""
    log = AnswerLog(k=3)
    for i, other in enumerate(differs):
        log.append(Answer(Query(f"q{i}", LEFT, RIGHT), 1))
        told = {REPEATS: f"q{i}", EXPECTED: 1}
        again = Query(f"q{i} again", LEFT, RIGHT)
        log.append(Answer(again, -1 if other else 1), used=False, **told)
    return log


def test_repeats_are_counted_by_half() -> None:
    assert Drift.of([*log_of([False, True, False, True, True, True])]) == Drift(3, 1, 3, 3)
    assert Drift.of([]).p_value == 1
    assert Drift.of([]).remark() is None


@pytest.mark.parametrize(
    ("differs", "said"),
    [
        ([False] * 4 + [True] * 4, "later answers may be less reliable"),
        ([True] * 4 + [False] * 4, "first answers may be less reliable"),
        ([False] * 3 + [True] * 3, None),  # by chance in one of ten cases
        ([True, False] * 6, None),
    ],
)
def test_only_a_significant_drift_is_said(differs: list[bool], said: str | None) -> None:
    remark = Drift.of([*log_of(differs)]).remark()
    assert (remark is None) == (said is None)
    if said is not None:
        assert said in str(remark)


def test_without_drift_it_is_hardly_ever_said() -> None:
    chance = np.random.default_rng(0)
    logs = chance.random((400, 12)) < 0.3
    said = sum(
        Drift(6, int(a), 6, int(b)).remark() is not None
        for a, b in zip(logs[:, :6].sum(axis=1), logs[:, 6:].sum(axis=1), strict=True)
    )
    assert said <= 0.05 * len(logs)
