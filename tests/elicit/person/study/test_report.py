"""The report of a study says of each person and of all what was found, and escapes it."""

import re
from dataclasses import replace
from typing import Any

import pytest

from elicit.person.report import ReportDetails, colour_of
from elicit.person.study.report import FollowingTable, PersonFound, study_page
from tests.page_parts import Parts

NAN = float("nan")


def end(answered: int, **more: Any) -> dict[str, Any]:
    """A person's end."""
    counts = dict.fromkeys(("equal", "cannot tell", "unused", "withdrawn", "repeated", "alike"), 0)
    counts |= {name: more.pop(name) for name in ("repeated", "alike") if name in more}
    counts |= {"agreeing": counts["alike"], "differing": counts["repeated"] - counts["alike"]}
    said = {"headline": f"Headline {answered}.", "caution": None, "sure": "", "before": "Before."}
    rest = {"settled": False, "remarks": [], "statements": [], "conflicts": []}
    return {"counts": {**counts, "answered": answered}, **said, **rest, **more}


def each(low: float, value: float, high: float, asked: bool = True) -> list[dict[str, Any]]:
    """Return a level's value to a person, as the report has it."""
    return [
        {"who": "a<b>n", "value": value, "low": low, "high": high, "asked": asked, "known": asked}
    ]


FEW = {"few": "Too few.", "levels": [], "certainty": "", "questions": [], "groups": []}
AGREED = {
    "few": "",
    "levels": [
        {"label": "well", "each": each(100, 100, 100)},
        {"label": "i<l>l", "each": each(20, 40.4, 61) + each(0, 50, 100, asked=False)},
        {"label": "died", "each": each(0, 0, 0)},
    ],
    "certainty": "for <sure>",
    "questions": [{"text": "A & B?", "prefers": [["a<b>n", 97], ["ben", 2]]}],
    "groups": ["Two groups.", "The rule."],
}
FOLLOWING = FollowingTable(
    ("ann", "ben", "chen"),
    ("ann", "ben", "chen", "the mean"),
    [[0, 0.1, 0, 0.05], [0.2, 0, 0, 0.05], [0.3, 0.4, 0, 0.01]],
    [[0, 0.15, 0, 0.07], [0.25, 0, 0, 0.09], [0.35, 0.45, 0, 0.02]],
    "Losses.",
)
PEOPLE = [
    PersonFound("a<b>n", end(5, repeated=4, alike=3, settled=True), 0.0381, "a.jsonl", "12ab"),
    PersonFound("ben", end(1, caution="Careful.", sure="Sure.", statements=[" One."]), NAN, "b"),
    PersonFound("chen", end(0, remarks=["Fast."], before=""), 0.0),
]


def text_of(page: str) -> str:
    """The text of a page, without its markup."""
    return Parts(page).text


def page_of(
    agreed: Any = AGREED, following: FollowingTable | None = FOLLOWING, **details: Any
) -> str:
    """The report of three people."""
    return study_page("C<a>re", "today", PEOPLE, agreed, following, ReportDetails(**details))


def test_a_report_has_a_row_and_the_words_for_each_person() -> None:
    text = text_of(page_of())
    assert "C<a>re: report of a study today. 3 people, 6 answers." in text
    assert "a<b>n 5 3 of 4 settled 3.9 in 100 ben 1 none not settled unknown" in text
    assert "unknown chen 0 none not settled 0 in 100" in text
    words = text.split("in the words of their own page ")[1]
    assert words.startswith(
        "a<b>n : 5 answers stand: 1 is learned from, 3 are repeats that agree (they confirm, and "
        "are not learned again) and 1 is a repeat that differs from the first answer, which "
        "counts. 3 of 4 repeated questions were answered as before. Headline 5. Before. "
        "ben : 1 answer stands: 1 is learned from. Headline 1. Careful. Sure. Before. One. "
        "chen : 0 answers. Headline 0. "
        "Fast. Technical details Log of a<b>n a.jsonl (checksum of the last line 12ab) Log of ben b"
    )
    assert "None" not in text
    alone = text_of(study_page("", "now", PEOPLE[1:2], FEW, None, ReportDetails()))
    assert "A study: report of a study now. 1 person, 1 answer." in alone


def test_a_report_says_how_sure_the_losses_are_unless_they_are_proven() -> None:
    for confidence, said in ((0.95, True), (1.0, False), (NAN, False)):
        people = [PersonFound("ann", end(5), 0.01, confidence=confidence)]
        text = text_of(study_page("", "now", people, FEW, None, ReportDetails()))
        assert ("Each holds with 95% probability." in text) == said
        people = [replace(one, confidence=confidence) for one in PEOPLE]
        text = text_of(study_page("", "now", people, AGREED, FOLLOWING, ReportDetails()))
        assert ("best guess, and with 95% probability at most 7 in 100." in text) == said


def test_a_report_draws_each_level_for_each_person() -> None:
    page = page_of()
    text = text_of(page)
    assert "well a<b>n 100 i<l>l a<b>n 40 (20 to 61) a<b>n not known yet (0 to 100) died" in text
    assert "The ranges hold for <sure>." in text
    assert page.count('stroke-dasharray="4 3"') == 1  # the level that no answer is about
    best, worst = colour_of(1.0), colour_of(0.0)
    assert best != worst
    assert page.index(best) < page.index("i&lt;l&gt;l") < page.index("died") < page.index(worst)
    assert "A & B? Chance that each prefers the first: a<b>n 97%, ben 2%. Groups" in text
    assert text.count("Two groups.") == 2  # in short, and in full
    assert text.count("The rule.") == 1


def test_a_report_says_whom_the_mean_costs_most_and_tabulates_the_rest() -> None:
    text = text_of(page_of())
    assert (
        "What is best for the mean of all scales costs ann the most: 5 in 100 of the value range "
        "by the best guess, and at most 7 in 100."
    ) in text  # the first of two
    assert "Who loses ann ben chen the mean ann 0.0 (0.0) 10.0 (15.0) 0.0 (0.0) 5.0 (7.0)" in text
    without = text_of(page_of(following=None))
    assert "Who loses" not in without
    assert "the mean of all scales" not in without


def test_a_report_of_too_few_says_so_in_place_of_agreement() -> None:
    text = text_of(page_of(FEW, None))
    assert "Too few. People Person" in text
    assert "Groups" not in text
    assert "worth to each" not in text


@pytest.mark.parametrize(
    ("details", "said"),
    [
        ({}, "Technical details"),
        ({"preamble": "Of <all>."}, "What was asked Of <all>. Technical details"),
        (
            {"legend": {"duration": "Long.", "levels": [{"label": "x", "meaning": "y"}]}},
            "What was asked Long. x y Technical details",
        ),
        ({"limits": ["Not this."]}, "What this does not say Not this. Technical details"),
        ({"facts": {"Seed": "3"}}, "Technical details Seed 3"),
    ],
)
def test_a_report_has_the_details_that_it_is_given(details: dict[str, Any], said: str) -> None:
    text = text_of(page_of(**details))
    assert f"Fast. {said} Log of" in text


def test_a_report_runs_nothing_and_needs_nothing_else() -> None:
    page = page_of(facts={"<script>": "<img src=x>"})
    assert not re.search(r"<script|<img|https?://|src=x[^&]", page)
