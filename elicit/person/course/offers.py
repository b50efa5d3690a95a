"""Offers to a person between two questions: to stop, to go on, or to try another kind."""

from __future__ import annotations

from typing import Any

from elicit.person.course.conclusion import NearlyEnough
from elicit.person.course.conduct import Conduct

NEARLY_FROM = 12
"""Answers, repeats among them, from which on little loss is reason enough to offer the end."""
NEARLY_AGAIN = 10
"""Further answers after an offer until the end is offered again for that reason."""
_CASES = 4  # people who answer by chance, of whom at most one does so well in the checks

_STOP = {"option": "finish", "label": "Finish now and show the result"}


def after_unsure(in_a_row: int, nearly: NearlyEnough | None) -> dict[str, Any]:
    """Return the offer after several answers "cannot tell".

    Parameters
    ----------
    in_a_row : int
        Number of these answers.
    nearly : NearlyEnough or None
        A statement that little could be lost by stopping, if that is so.
    """
    return {
        "heading": f"You could not tell {in_a_row} times in a row",
        "text": f"That is fine. {_little(nearly)}What would you like to do?",
        "options": [
            {"option": "other", "label": "Try another kind of question"},
            {"option": "on", "label": "Go on as before"},
            {"option": "pause", "label": "Take a break"},
            _STOP,
        ],
    }


def after_plan(over: str, nearly: NearlyEnough | None) -> dict[str, Any]:
    """Return the offer when the planned questions or minutes are over; ``over`` says which."""
    return {
        "heading": over,
        "text": f"{_little(nearly)}You can see the result now, or go on for a smaller uncertainty.",
        "options": [_STOP, {"option": "on", "label": "Go on until it is settled"}],
    }


def _little(nearly: NearlyEnough | None) -> str:
    """Return the statement as sentences before others, or ""."""
    return "" if nearly is None else f"{nearly.heading}. {nearly.text} "


def after_little_loss(
    nearly: NearlyEnough, to_come: tuple[int, int] | None, planned: bool = False
) -> dict[str, Any]:
    """Return the offer to stop because little could be lost by it.

    Stopping comes first only if the person ``planned`` an end. Otherwise they wanted to go on until
    the result is settled.

    Parameters
    ----------
    nearly : NearlyEnough
    to_come : (2,) int, optional
        The least and the greatest number of questions that are likely left until it is settled.
    planned : bool
    """
    more = "You can stop here, or go on until the result is settled."
    if to_come is not None and to_come[1] > 0:
        least, most = to_come
        number = f"about {least} to {most}" if least < most else f"about {most}"
        if least == 0:
            number = f"up to about {most}"
        more = f"You can stop here, or go on until the result is settled: {number} more."
    options = [_STOP, {"option": "on", "label": "Go on until it is settled"}]
    return {
        "heading": nearly.heading,
        "text": f"{nearly.text} {nearly.size} {more}",
        "options": options if planned else options[::-1],
    }


def nearly_is_due(conduct: Conduct, offered: int) -> bool:
    """Return whether the end may be offered now because little could be lost by it.

    Parameters
    ----------
    conduct : Conduct
    offered : int
        Number of answers at the last offer; 0 if there was none.
    """
    return conduct.put >= nearly_from(offered)


def nearly_from(offered: int) -> int:
    """Return the number of answers from which on the end may be offered for that reason."""
    return max(NEARLY_FROM, offered + NEARLY_AGAIN * (offered > 0))


def may_be_near(conduct: Conduct, least: int) -> bool:
    """Return whether there are answers and checks enough to say that little could be lost.

    If the person stopped then, the end would have no caution.
    """
    checked = conduct.cases >= _CASES and conduct.caution(at_end=True) is None
    return checked and conduct.with_verdict >= least
