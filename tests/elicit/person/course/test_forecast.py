"""Forecasts of questions left do not jump, and a loss that rose says why."""

from dataclasses import replace

from elicit.person.course.conduct import Conduct
from elicit.person.course.forecast import AtQuestion, QuestionsLeft, QuestionsToCome, rise
from elicit.person.course.kept_in_log import Choices


def test_needed_questions_come_and_those_simulated_or_about_levels() -> None:
    coming = QuestionsToCome(Choices(), least=10, checks=False, asks_on=True, slow=False)
    now = AtQuestion(Conduct.of(()), needed=(9, 2))
    coming.go_on_to(now)
    reply = coming.reply(None, None)
    assert (reply["to_come"], reply["at_least"]) == (None, 11)
    assert reply["forecast"].startswith("“At least 11 more”")
    assert coming.until_settled(now) == (11, 11)
    assert coming.until_settled(now, (4, 20)) == (11, 22)
    assert coming.until_settled(replace(now, levels_left=(4, 9))) == (11, 17)
    assert coming.until_settled(replace(now, to_narrow=(3, 8))) == (14, 19)
    assert coming.reply((4, 20), None)["to_come"] == [11, 22]


def test_a_forecast_counts_down_and_changes_only_if_it_is_off_by_much() -> None:
    left = QuestionsLeft()
    assert left.shown(None, 0, 9) is None
    assert left.shown((8, 18), 0, 9) == (9, 18)
    assert left.shown((6, 16), 1, 8) == (8, 17)  # off by one
    assert left.shown(None, 2, 7) == (7, 16)
    assert left.shown((2, 9), 3, 0) == (2, 14)  # the lower end follows at once, ...
    assert left.shown((2, 9), 3, 0) == (2, 14)
    assert left.shown((2, 8), 4, 0) == (1, 8)  # ... and the upper one to two forecasts
    assert left.shown((1, 7), 5, 0) == (0, 7)
    assert not left.rose
    assert left.shown((1, 11), 6, 0) == (0, 6)  # a single long one is not shown, ...
    assert left.shown((1, 12), 7, 0) == (0, 10)  # ... but two of them are
    assert left.rose


def test_one_long_forecast_is_not_shown_and_two_are_bit_by_bit() -> None:
    left = QuestionsLeft()
    rose, most = [], []
    forecasts = [(0, 6), (0, 5), (2, 60), (0, 3), (2, 18), (2, 19), (2, 18), (0, 17)]
    for put, found in enumerate(forecasts):
        for _ in range(2):  # a page asks repeatedly
            shown = left.shown(found, put, 0)
            assert shown is not None
        rose.append(left.rose)
        most.append(shown[1])
    assert most == [6, 5, 4, 3, 7, 11, 15, 14]
    assert rose == [False, False, False, False, True, True, True, False]


def test_a_range_is_not_widened_while_one_question_is_read() -> None:
    left = QuestionsLeft()
    assert left.shown((4, 12), 0, 3, rough=True) == (4, 12)  # that of the welcome
    assert left.shown((2, 24), 0, 3) == (4, 12)
    assert left.shown(None, 1, 2) == (2, 16)  # at the next question, before its own forecast
    assert left.rose
    assert left.shown((1, 40), 1, 2) == (2, 16)
    assert left.shown((1, 2), 1, 2) == (3, 11)  # narrower, and so it stays
    assert left.shown((1, 40), 1, 2) == (3, 11)


def test_that_more_questions_come_is_said_only_where_the_number_shown_is_greater() -> None:
    left = QuestionsLeft()
    assert left.shown((4, 6), 0, 0) == (4, 6)
    assert left.shown((7, 7), 1, 7) == (7, 7)
    assert left.rose
    assert left.shown((7, 7), 2, 7) == (7, 7)  # one more in all, and the same number as before
    assert not left.rose


def test_without_forecasts_the_last_range_counts_down() -> None:
    left = QuestionsLeft()
    assert not left.known
    assert left.shown((5, 16), 0, 3, rough=True) == (5, 16)
    assert not left.known
    assert [left.shown(None, put, 0) for put in range(1, 4)] == [(4, 15), (3, 14), (2, 13)]
    assert left.shown((1, 6), 4, 0) == (1, 6)  # the rough one no longer counts
    assert left.known


def test_what_is_known_replaces_what_was_forecast() -> None:
    left = QuestionsLeft()
    assert left.shown((0, 12), 0, 0) == (0, 12)
    assert left.shown((3, 3), 1, 3, certain=True) == (3, 3)
    assert not left.rose
    assert left.shown((2, 2), 2, 2, certain=True) == (2, 2)
    assert left.shown((2, 5), 3, 0) == (2, 5)  # an answer that nobody expected
    assert left.rose


def test_a_forecast_is_never_below_what_must_come() -> None:
    left = QuestionsLeft()
    assert left.shown((0, 1), 0, 5) == (5, 5)
    for put, least in ((1, 4), (2, 5), (3, 0), (9, 2)):
        shown = left.shown(None, put, least)
        assert shown is None or shown[1] >= max(least, shown[0])
    assert QuestionsLeft().shown((3, 4), 10, 0) == (3, 4)


def test_a_loss_that_rose_says_why_it_can() -> None:
    same = (0.0201, 0.0205), (0.02004, 0.02001)  # that the person reads as the same number
    for loss, before in ((None, 0.1), (0.1, None), (0.02, 0.02), (0.02, 0.03), *same):
        assert rise(loss, before) is None
    assert "varies a little" in str(rise(0.0301, 0.03))
    assert "more values are plausible than it seemed" in str(rise(0.04, 0.03))
    exact = str(rise(0.0301, 0.03, exact=True))
    assert "changes the plan" in exact
    assert "estimated" not in exact
