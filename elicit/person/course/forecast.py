"""Forecasts beside a question that do not jump: questions left, and why a stated loss rose."""

from __future__ import annotations

import math
from statistics import median
from typing import NamedTuple

from elicit.person.course.conclusion import per_hundred

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
