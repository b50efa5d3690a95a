"""Forecasts beside a question: how many questions are still to come, and why a stated loss rose.

``QuestionsToCome`` makes a forecast from all that is known at a question. ``QuestionsLeft`` decides
which range is shown, so that it does not jump from one question to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median
from typing import Any, NamedTuple, Protocol

from elicit.person.course.conclusion import per_hundred
from elicit.person.course.conduct import Conduct
from elicit.person.course.kept_in_log import Choices

_FEWEST = (
    "“At least {n} more” are the answers and checks without which no result is called settled."
)
_AFTER_THESE = "How many follow after them depends on what you answer, and cannot be said yet."
_ROSE = "more than said before"
_ROSE_BY_CHECK = "two answers differed"
_NO_FORECAST = (
    "How many more questions follow depends on what you answer, and cannot be said yet. You can "
    "finish at any time."
)
# a choice is mostly sure after the fewest questions about levels, and so many more. With a CSV of
# four levels 15 of 16 simulated sessions ended within the range said at their first question
_UNTIL_SURE = 2
# a plan is mostly settled after the learner's last question and so many about levels (none to six
# in nine simulated sessions, three of them on ICU-Sepsis)
_UNTIL_SETTLED = 3
_NEAR = 2  # questions still likely to come, with which the end is said to be close
_SLACK = 2  # questions, and a share of those left, by which a forecast may be off and stays:
_SHARE_OF_SLACK = 0.25
_RECENT = 2  # earlier questions whose forecasts count beside the newest
_RISE = 5  # questions by which the upper end rises at most from one question to the next
_ESTIMATE = 0.07
"""The share by which a loss varies, because it is estimated from a sample of plausible scales. It
was measured with ten answers about ICU-Sepsis, learned with four seeds: at most 7% from the least
to the greatest."""


class QuestionsLeft:
    """The range of the number of questions still to come, as it is shown.

    New forecasts come with every question, and vary. Of those of the last three questions, the
    shown range has the least lower end and the middle upper end. It is kept, and its ends count
    down, as long as it is not off by much: by two questions, or by a quarter of those left. Its
    upper end rises by five questions at most each time. While one question is on the screen, its
    range may become narrower, but not wider: a wider one is shown from the next question on.
    """

    def __init__(self) -> None:
        self._totals: list[_Total] = []  # the newest forecasts, each of another question
        self._asked = self._now = -1  # the question before, and the one that is asked
        self._before: tuple[int, int] | None = None  # as shown at the question before
        self._shown: tuple[int, int] | None = None  # questions in all, the least and the most
        self._here: tuple[int, int] | None = None  # as shown at this question before
        self.rose = False
        """True if more questions are said to follow than were said to follow at the question
        before."""

    @property
    def known(self) -> bool:
        """True if there was a forecast that was not a rough one."""
        return any(not one.rough for one in self._totals)

    def shown(
        self,
        to_come: tuple[int, int] | None,
        put: int,
        least: int,
        certain: bool = False,
        rough: bool = False,
    ) -> tuple[int, int] | None:
        """Return the range to show, or None if nothing is known.

        Parameters
        ----------
        to_come : (2,) int or None
            The newest forecast: the least and the greatest number of questions after this one.
        put : int
            Number of questions before this one.
        least : int
            Number of questions that must come after this one.
        certain : bool
            True if ``to_come`` is no forecast, but known. Earlier forecasts do not count then.
        rough : bool
            True if ``to_come`` was forecast without the answers. It counts until there is another
            forecast.

        Returns
        -------
        (2,) int or None
            The second one is at least ``least``.
        """
        now = put + 1
        if now != self._now:
            self._asked, self._now = self._now, now
            self._before, self._here = self._shown, None
        kept = before = self._before
        if kept is not None and kept[1] < now + least:
            kept = None  # more questions came than it said
        earlier = [one for one in self._totals if one.put < now][-_RECENT:]
        if to_come is not None:
            if certain:
                earlier = []
            elif not rough:
                earlier = [one for one in earlier if not one.rough]
            low, high = max(to_come[0], least), max(to_come[1], least)
            earlier.append(_Total(now, now + low, now + high, rough or certain))
            self._totals = earlier
        elif self._totals and self._totals[-1].put == now:
            earlier = self._totals
        recent = [one for one in earlier if one.high >= now + least]
        if recent:
            low = max(now + least, min(one.low for one in recent))
            high = math.ceil(median(one.high for one in recent))
            if kept is not None and not certain:
                high = min(high, kept[1] + _RISE)
            high = max(low, high)
            slack = 0.0 if certain else max(_SLACK, _SHARE_OF_SLACK * (high - now))
            off = kept is not None and max(abs(high - kept[1]), kept[0] - low) > slack
            if kept is None or off or low > kept[1]:
                kept = low, high
        if kept is not None and self._here is not None and not certain:
            high = max(self._here[0], min(kept[1], self._here[1]))
            kept = min(max(kept[0], self._here[0]), high), high
        self._here = self._shown = kept
        back = now <= self._asked  # after an answer was taken back more questions follow
        self.rose = bool(kept and before and not back and kept[1] - now > before[1] - self._asked)
        if kept is None:
            return None
        return max(kept[0] - now, least), kept[1] - now


class _Total(NamedTuple):
    """A forecast of the number of questions in all, made at a question."""

    put: int
    low: int
    high: int
    rough: bool = False


class SimulatedSessions(Protocol):
    """Protocol of the sessions that were simulated before the first answer."""

    @property
    def questions(self) -> tuple[int, ...]:
        """The numbers of questions that a person may plan, ascending."""

    def lengths(self) -> tuple[int, int] | None:
        """Return the least and the greatest length of the sessions, or None if unknown."""


@dataclass(frozen=True)
class AtQuestion:
    """Facts at a question on which the number of those after it depends.

    Attributes
    ----------
    conduct
        The conduct in the answers before the question.
    needed
        Numbers of answers, and of checks, that must still come after it.
    levels_left
        The fewest and the most questions about levels, this one included, that come after "ask me
        more" or until the result is sure enough. None if there are none, or it is not known.
    to_narrow
        The fewest and the most questions until no level's range is wide, if the person chose to go
        on so far.
    no_others
        True if no questions but the needed ones come after this one.
    may_change
        True if the answer to this question may make others needed.
    """

    conduct: Conduct
    needed: tuple[int, int] = (0, 0)
    levels_left: tuple[int, int] | None = None
    to_narrow: tuple[int, int] = (0, 0)
    no_others: bool = False
    may_change: bool = False


class QuestionsToCome:
    """The number of questions still to come in an interview, from all that is known of it.

    Parameters
    ----------
    chosen : Choices
        The person's choices, which may change.
    least : int
        Fewest answers before a result is settled. 0: the interview ends with its asker.
    checks : bool
        True if earlier questions are put again as checks.
    asks_on : bool
        True if a result may not be sure enough once the asker has no question.
    slow : bool
        True if it may take seconds to find whether it is.
    """

    def __init__(
        self, chosen: Choices, *, least: int, checks: bool, asks_on: bool, slow: bool
    ) -> None:
        self._chosen, self._least = chosen, least
        self._checks, self._asks_on, self._slow = checks, asks_on, slow
        self.now = AtQuestion(Conduct.of(()))
        """The facts at the question on the screen."""
        self.simulated: SimulatedSessions | None = None
        """The sessions that the forecast on the welcome screen comes from, if there are any."""
        self._differed = False  # the last answer from the one that it repeats
        self._left = QuestionsLeft()
        self._all_told = chosen.all_told  # when the range was last shown

    def go_on_to(self, now: AtQuestion) -> None:
        """Go on to the question that is on the screen from now on."""
        before = self.now.conduct
        if now.conduct.put != before.put:
            self._differed = now.conduct.differed > before.differed
        self.now = now

    def reply(self, played: tuple[int, int] | None, likely: int | None) -> dict[str, Any]:
        """Return the parts of a reply on the number of questions to come.

        Parameters
        ----------
        played : (2,) int or None
            The least and the greatest number of questions in sessions simulated from here on.
        likely : int or None
            The number in half of these sessions at most.
        """
        to_come, least = self.shown(played), sum(self.now.needed)
        near = to_come is not None and self._is_near_end(to_come, likely)
        rose = to_come is not None and self._left.rose
        said = (_ROSE_BY_CHECK if self._differed else _ROSE) if rose else ""
        if to_come is None and self._least:
            said = f"{_FEWEST.format(n=least)} {_AFTER_THESE}" if least else _NO_FORECAST
        return {
            "to_come": None if to_come is None else [*to_come],
            "at_least": least,
            "rose": rose and not near,
            "near": near,
            "forecast": said,
        }

    def shown(self, played: tuple[int, int] | None) -> tuple[int, int] | None:
        """Return the range of questions to come that is shown, or None if nothing is known.

        ``played`` is that of ``reply``.
        """
        put, least = self.now.conduct.put, sum(self.now.needed)
        if self.now.no_others:
            may = self.now.may_change or self.now.needed[0] or self.now.conduct.unresolved
            certain = not may or not self._asks_on
            most = least if certain else least + _UNTIL_SURE
            return self._left.shown((least, most), put, least, certain)
        if self._chosen.all_told != self._all_told:  # what was shown before was about less
            self._all_told, self._left = self._chosen.all_told, QuestionsLeft()
        if self._chosen.all_told and self.now.levels_left is None:
            return None
        found, rough = self._newest(played)
        return self._left.shown(found, put, least, rough=rough)

    def _newest(self, played: tuple[int, int] | None) -> tuple[tuple[int, int] | None, bool]:
        """Return the newest forecast, or None, and whether it is a rough one.

        It comes from sessions simulated from here on. Until there are any, it comes from the
        forecast on the welcome screen, and is rough. It never exceeds the largest number of
        questions there. If the person asked for more questions, it comes from the questions about
        levels that are likely still to come. If the result is not sure enough yet, some of these
        are added to its upper end.
        """
        now, simulated = self.now, self.simulated
        if self._chosen.all_told and now.levels_left is not None:
            fewest, most = (self._with_checks(now, max(0, n - 1)) for n in now.levels_left)
            return (fewest, most), False
        if played is not None or now.levels_left is not None or now.to_narrow[1]:
            fewest, most = self.until_settled(now, (0, 0) if played is None else played)
            if simulated is not None and not now.to_narrow[1]:
                most = min(most, max(simulated.questions[-1] - now.conduct.put - 1, fewest))
            return (fewest, most), False
        lengths = None if self._left.known or simulated is None else simulated.lengths()
        if lengths is None:
            return None, False
        fewest, most = (length - now.conduct.put - 1 for length in lengths)
        return ((max(0, fewest), most) if most >= max(1, sum(now.needed)) else None), True

    def until_settled(self, now: AtQuestion, played: tuple[int, int] = (0, 0)) -> tuple[int, int]:
        """Return a range of the questions to come until the result is settled and no range wide.

        Checks are among them.

        Parameters
        ----------
        now : AtQuestion
        played : (2,) int
            That of ``reply``.
        """
        further = 0
        if self._least and self._slow:
            further = _UNTIL_SETTLED
        elif now.levels_left is not None:
            further = now.levels_left[0] + _UNTIL_SURE
        fewest, most = max(now.needed[0], played[0]), max(now.needed[0], played[1]) + further
        return (
            self._with_checks(now, fewest + now.to_narrow[0]),
            self._with_checks(now, most + now.to_narrow[1]),
        )

    def _is_near_end(self, to_come: tuple[int, int], likely: int | None) -> bool:
        """Return whether the end is close in half of the sessions simulated from here on."""
        if likely is None or self._chosen.all_told or not to_come[0] <= _NEAR < to_come[1]:
            return False
        now = self.now
        further = 0 if now.levels_left is None else now.levels_left[0]
        further = max(further, now.to_narrow[0])
        return self._with_checks(now, max(now.needed[0], likely + further)) <= _NEAR

    def _with_checks(self, now: AtQuestion, number: int) -> int:
        """Return the number of questions to come: this number, and the checks that come with it."""
        checks = now.needed[1]
        if self._least and self._checks:
            checks = now.conduct.checks_beside(number + 1, checks)
        return number + checks


def rise(loss: float | None, before: float | None, exact: bool = False) -> str | None:
    """Return a sentence on why a loss is greater than the one stated before, or None if it is not.

    Parameters
    ----------
    loss : float or None
        The loss now; None if unknown.
    before : float, optional
        The loss that was last stated to the person.
    exact : bool
        True if the loss is proven for every scale that fits the answers, and not estimated.

    Returns
    -------
    str or None
    """
    if loss is None or before is None or not loss > before:
        return None
    if per_hundred(loss) == per_hundred(before):
        return None  # the number that is shown is the same
    if exact:
        return "This number can rise from one question to the next, if an answer changes the plan."
    if loss <= before * (1.0 + _ESTIMATE):
        return (
            "It is estimated from a sample of the values that fit your answers, and varies a "
            "little."
        )
    return (
        "This number can rise from one question to the next, if an answer shows that more values "
        "are plausible than it seemed."
    )
