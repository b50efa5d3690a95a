"""The words in which each family puts its questions to a person."""

from __future__ import annotations

from collections.abc import Mapping

from elicit.person.showing import Words

_MEDICAL = " The numbers are made up; this is not medical advice."


def _words(unit: str, title: str, levels: str, note: str = "") -> Words:
    """Return a family's words: what is counted, a title, and a sentence on what the levels mean."""
    return Words(
        unit, title=title, preamble=f"{levels} Choose the {unit} you would rather see.{note}"
    )


WORDS: Mapping[str, Words] = {
    "rover": _words(
        "days",
        "A rover on soils that trap it",
        "You direct a rover. On a day it has no finds, some finds or many finds, or it is "
        "lost: it was trapped before, and never moves again.",
    ),
    "hazards": _words(
        "hours",
        "A walk home over a marsh",
        "You guide a walker. An hour is spent at home, on the path or in the mud, or the "
        "walker has drowned.",
    ),
    "side-effects": _words(
        "hours",
        "A delivery among vases",
        "A carrier brings a parcel through rooms full of other people's vases. In an hour the"
        " parcel is late or delivered, and none, one or two of the vases are broken. They "
        "stay broken.",
    ),
    "surgery": _words(
        "months",
        "To operate or to wait",
        "You decide for a patient. In a month the illness is severe, moderate or mild, or the"
        " patient is cured or dead.",
        _MEDICAL,
    ),
    "care": _words(
        "months",
        "How hard to treat an illness",
        "You decide for a patient. In a month the patient is in hospital, ill at home, well "
        "at home, cured or dead.",
        _MEDICAL,
    ),
    "career": _words(
        "years",
        "A steady post or a venture",
        "You decide about a working life. In a year one is in training, in a steady post, "
        "famous or ruined.",
    ),
    "plant": _words(
        "days",
        "A power plant in bad weather",
        "You run a power plant. On a day it runs at full or at half load, is off, or has an "
        "outage.",
    ),
    "fishery": _words(
        "years",
        "A fishery that can collapse",
        "You set the quota of a fishery. In a year the catch is rich, fair or small, there is"
        " none, or the stock has collapsed.",
    ),
    "reservoir": _words(
        "seasons",
        "A reservoir between drought and flood",
        "You run a reservoir. In a season the town has plenty of water, enough, rations or "
        "dry taps, or it is flooded.",
    ),
}
"""The words of each of ``FAMILIES``, by name."""
