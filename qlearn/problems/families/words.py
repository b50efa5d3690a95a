"""The words in which each family puts its questions to a person."""

from __future__ import annotations

from collections.abc import Mapping

from elicit.person.showing import Words

_NO_RIGHT = "There is no right or wrong answer."
_MEDICAL = f"{_NO_RIGHT} The numbers are made up; this is not medical advice."

WORDS: Mapping[str, Words] = {
    "rover": Words(
        unit="days",
        title="A rover on soils that trap it",
        preamble="You direct a rover. A day is one of: lost (the rover was trapped before, and does nothing any "
        "more), no finds, some finds, many finds. Choose the days that you would rather have from the mission. "
        + _NO_RIGHT,
    ),
    "hazards": Words(
        unit="hours",
        title="A walk home over a marsh",
        preamble="You direct a walker. An hour is spent on the path, in the mud, at home, or drowned (after a fall "
        f"into a hole). Choose the hours that you would rather see. {_NO_RIGHT}",
    ),
    "side-effects": Words(
        unit="deliveries",
        title="A delivery between vases",
        preamble="A carrier brings parcels through rooms full of other people's vases. Late means that the parcel is "
        "not there yet; broken vases stay broken. You look at all carriers at one moment. Choose the carriers that "
        f"you would rather have. {_NO_RIGHT}",
    ),
    "surgery": Words(
        unit="months",
        title="To operate or to wait",
        preamble="A patient's months are spent dead, with severe, moderate or mild complaints, or cured. Choose the "
        f"months that you would rather have. {_MEDICAL}",
    ),
    "care": Words(
        unit="months",
        title="How hard to treat an illness",
        preamble="A patient's months are spent dead, in hospital, ill at home, well at home, or cured. Choose the "
        f"months that you would rather have. {_MEDICAL}",
    ),
    "career": Words(
        unit="years",
        title="A steady post or a venture",
        preamble="Years of a working life are spent ruined, in training, in a steady post, or famous. Choose the "
        f"years that you would rather have. {_NO_RIGHT}",
    ),
    "plant": Words(
        unit="days",
        title="A power plant in bad weather",
        preamble="On a day the plant has an outage, is off on purpose, or runs at half or full load. Choose the days "
        f"that you would rather see. {_NO_RIGHT}",
    ),
    "fishery": Words(
        unit="years",
        title="A fishery that can collapse",
        preamble="In a year the stock is collapsed, or there is no catch, a small, a fair or a rich one. Choose the "
        f"years that you would rather see. {_NO_RIGHT}",
    ),
    "reservoir": Words(
        unit="seasons",
        title="A reservoir between drought and flood",
        preamble="In a season the town is flooded, its taps are dry, or its water is rationed, enough, or plenty. "
        f"Choose the seasons that you would rather see. {_NO_RIGHT}",
    ),
}
"""The words of each of ``FAMILIES``, by name."""
