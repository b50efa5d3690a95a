"""The conduct of a person is read from the log alone."""

import random
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from elicit import Answer, AnswerLog, Query, Verdict
from elicit.person.course.conduct import (
    IN_CONFLICT,
    ORDER,
    Conduct,
    Repeats,
    choice_of,
    differs,
    repeats_in,
)
from elicit.person.course.counts import Counts
from elicit.tutors.answer_log import EXPECTED, REPEATS, RESOLVED

LEFT, RIGHT = np.array([0.0, 1.0, 0.0]), np.array([0.5, 0.0, 0.5])


def log_of(*choices: str) -> AnswerLog:
    """A log of answers to questions of its own, every second one shown right to left."""
    log = AnswerLog(k=3)
    for i, choice in enumerate(choices):
        swapped = bool(i % 2)
        better = Verdict.BETTER if (choice == "a") != swapped else Verdict.WORSE
        verdict = {"equal": Verdict.EQUAL, "cannot tell": None}.get(choice, better)
        log.append(Answer(Query(f"q{i}", LEFT, RIGHT), verdict, swapped))
        assert choice_of(log[-1].answer) == choice
    return log


def repeated(log: AnswerLog, i: int, verdict: Verdict) -> None:
    """Answer question i again."""
    first = log[i].answer
    told: dict[str, Any] = {REPEATS: first.query.id, EXPECTED: int(first.verdict or 0)}
    log.append(Answer(Query(f"q{i} again", LEFT, RIGHT), verdict), used=False, **told)


def conduct(log: AnswerLog) -> Conduct:
    return Conduct.of([*log])


@pytest.mark.parametrize(
    ("choice", "fewer", "more", "said"),
    [
        ("cannot tell", 11, 12, "You could not tell in 12 questions in a row"),
        ("equal", 9, 10, "You called 10 pairs in a row equally good"),
        ("a", 11, 12, "You chose A 12 times in a row"),
        ("b", 11, 12, "You chose B 12 times in a row"),
    ],
)
def test_a_long_run_of_one_answer_is_said(choice: str, fewer: int, more: int, said: str) -> None:
    other = "a" if choice != "a" else "b"
    assert conduct(log_of(other, *[choice] * fewer)).caution() is None
    assert str(conduct(log_of(other, *[choice] * more)).caution()).startswith(said)
    assert conduct(log_of(*[choice] * more, other)).caution() is None


@pytest.mark.parametrize(
    ("clear", "checks", "differed", "said"),
    [(4, 5, 0, True), (5, 4, 0, True), (5, 5, 0, False), (5, 8, 2, True), (0, 9, 0, True)],
)
def test_close_pairs_may_be_called_equal_after_clear_answers_that_were_checked(
    clear: int, checks: int, differed: int, said: bool
) -> None:
    log = log_of(*"ab" * (clear // 2), *"a" * (clear % 2), *["equal"] * 30)
    found = replace(conduct(log), checks=checks, differed=differed)
    assert found.clear == clear
    assert ("equally good" in str(found.caution(at_end=True))) is said


def test_at_the_end_a_few_answers_are_enough_if_there_are_no_others() -> None:
    for choice, n in (("cannot tell", 3), ("equal", 3), ("a", 8)):
        alike, mixed = conduct(log_of(*[choice] * n)), conduct(log_of("b", *[choice] * n))
        assert alike.caution() is None
        assert alike.caution(at_end=True) is not None
        assert mixed.caution(at_end=True) is None


def test_an_offer_is_made_after_every_third_cannot_tell_in_a_row() -> None:
    for n, offers in ((2, False), (3, True), (4, False), (6, True)):
        assert conduct(log_of("a", *["cannot tell"] * n)).offers == offers
    assert not conduct(AnswerLog(k=3)).offers


def test_answers_that_differ_as_often_as_by_chance_are_said() -> None:
    log = log_of("a", "b", "a", "b", "equal", "a")
    repeated(log, 0, Verdict.BETTER)
    repeated(log, 1, Verdict.WORSE)
    assert (conduct(log).checks, conduct(log).differed) == (2, 1)
    assert conduct(log).caution() is None
    assert conduct(log).caution(at_end=True) is not None
    repeated(log, 2, Verdict.WORSE)
    assert "2 of 3 check questions" in str(conduct(log).caution())
    assert [differs(entry) for entry in repeats_in(log)] == [False, True, True]
    assert conduct(log).answered == 6


@pytest.mark.parametrize(
    ("alike", "differed", "passed", "chance", "cases"),
    [
        (4, 0, False, False, "at most 1 of 16 cases"),
        (5, 0, True, False, "at most 1 of 32 cases"),
        (6, 1, False, False, "at most 1 of 16 cases"),
        (7, 1, True, False, "at most 1 of 28 cases"),
        (9, 2, True, False, "at most 1 of 30 cases"),
        (3, 2, False, True, "at most 1 of 2 cases"),
        (4, 2, False, False, "at most 1 of 2 cases"),
        (1, 1, False, False, "half of the cases or more"),
        (8, 3, False, False, "at most 1 of 8 cases"),
    ],
)
def test_checks_are_passed_or_look_like_chance(
    alike: int, differed: int, passed: bool, chance: bool, cases: str
) -> None:
    checks = alike + differed
    one = Conduct(20, 20, checks, differed, "a", 1, against_order=differed)
    assert (one.passed, one.like_chance) == (passed, chance)
    order = (
        f"{checks} more questions checked the order of the levels, and {alike} were answered as "
    )
    many = "half of all interviews or more"
    if "half" not in cases:
        many = cases.replace("cases", "interviews")
    well = f"Guessing would do as well in {many}. "
    if {"32", "28", "30"} & {*cases.split()}:
        well += "That speaks well for your answers."
    elif {"16", "8"} & {*cases.split()}:
        well += "That speaks for your answers."
    else:
        well += "That does not show yet whether you meant your answers."
    assert one.by_chance == f"{order}expected. {well}"
    repeats = replace(one, repeated=checks)  # then the screen has counted them already
    assert repeats.by_chance == well
    one_more = replace(one, checks=checks + 1, repeated=checks, against_order=0)
    assert one_more.by_chance.startswith("One more question checked the order of the levels, and ")
    assert (one.caution() is not None) == (chance or (one.checks >= 11 and not passed))


@pytest.mark.parametrize(("back", "stand", "said"), [(4, 1, False), (5, 9, True), (3, 11, False)])
def test_many_answers_taken_back_as_contradictions_are_said(
    back: int, stand: int, said: bool
) -> None:
    log = log_of(*"ab" * 7)
    for entry in [*log][:back]:
        log.retract(entry.answer.query.id, **{IN_CONFLICT: True})
    for entry in [*log][back + stand :]:
        log.retract(entry.answer.query.id)
    assert (conduct(log).taken_back, conduct(log).given) == (back, back + stand)
    assert (conduct(log).caution() is not None) == said


@pytest.mark.parametrize(
    ("differ", "pass_them", "like_chance"),
    [(0.5, 0.06, 0.92), (0.05, 0.97, 0.025), (0.1, 0.885, 0.09)],
)
def test_few_pass_the_checks_by_chance_and_few_who_answer_alike_are_doubted(
    differ: float, pass_them: float, like_chance: float
) -> None:
    """The shares are those of docs/sessions.md."""
    chance, passed, doubted, n = random.Random(0), 0, 0, 4000
    for _ in range(n):
        checks = differed = 0
        while True:
            one = Conduct(20, 20, checks, differed, "a", 1)
            if one.passed or one.caution() is not None:
                break
            checks, differed = checks + 1, differed + (chance.random() < differ)
        passed += one.passed
        doubted += one.like_chance
    assert abs(passed / n - pass_them) < 0.015
    assert abs(doubted / n - like_chance) < 0.015


def test_a_repeat_that_the_person_settled_still_counts_and_one_taken_back_does_not() -> None:
    log = log_of("a", "b")
    repeated(log, 0, Verdict.WORSE)
    log.retract("q0 again", **{RESOLVED: 1})
    assert (conduct(log).checks, conduct(log).differed) == (1, 1)
    repeated(log, 1, Verdict.BETTER)
    log.retract("q1 again")
    assert (conduct(log).checks, conduct(log).differed) == (1, 1)


def test_an_answer_against_the_order_of_the_levels_is_a_check_that_differs() -> None:
    log = AnswerLog(k=3)
    for level, verdict in ((1, Verdict.BETTER), (2, Verdict.WORSE)):
        query = Query(f"{ORDER}{level}", np.eye(3)[level], np.eye(3)[level - 1])
        log.append(Answer(query, verdict))
    assert (conduct(log).checks, conduct(log).differed) == (2, 1)
    said = "2 answers stand: 2 are checks of the order of the levels."
    assert Counts.of(log).sentence == said
    log.append(Answer(Query("q", [1, 0, 0], [0, 0.5, 0.5]), Verdict.WORSE))
    found = Counts.of(log)
    assert (found.answered, found.learned, found.ordering) == (3, 1, 2)
    assert Counts.read(found.record()) == found


@pytest.mark.parametrize(
    ("back", "differed", "given", "said"),
    [(4, 1, 20, True), (4, 0, 12, False), (3, 1, 12, False), (4, 1, 25, False), (3, 2, 20, True)],
)
def test_answers_taken_back_and_checks_that_differ_count_together(
    back: int, differed: int, given: int, said: bool
) -> None:
    one = Conduct(given - back, given - back, 9, differed, "a", 1, taken_back=back)
    assert ("You took back" in str(one.caution())) == said


def test_checks_are_spread_over_a_short_session() -> None:
    """The five checks come before the thirteenth answer, so none is left for the end."""
    log, asked = AnswerLog(), []
    repeats = Repeats(log, 0.0, 1)
    repeats.regular = True
    for i in range(24):
        again = repeats.due(Conduct.of([*log]))
        if again is not None:
            first = repeats.first_answer(again)
            assert first is not None
            said = {REPEATS: first.query.id, EXPECTED: int(first.verdict or 0)}
            log.append(Answer(again, first.verdict), used=False, **said)
            asked.append(Conduct.of([*log]).answered)
            assert repeats.due(Conduct.of([*log])) is None  # never two in a row
        query = Query(f"new {i}", np.array([0, 1.0, 0]), np.array([1 - i / 30, 0, i / 30]))
        log.append(Answer(query, Verdict.BETTER))
    assert asked == [4, 6, 8, 10, 12]
    assert Conduct.of([*log]).passed


def test_a_check_does_not_come_between_answers_that_cannot_be_told() -> None:
    log = log_of("a", "b", "a", "b", "cannot tell")
    repeats = Repeats(log, 0.0, 1)
    repeats.regular = True
    assert repeats.due(conduct(log)) is None
    log.append(Answer(Query("q", LEFT, RIGHT), Verdict.BETTER))
    assert repeats.due(conduct(log)) is not None
