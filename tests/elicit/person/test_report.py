"""The report that a person keeps: all that was said, in a page that needs nothing else."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import AnswerLog, Interview, Query, Session, Subject, Words
from elicit.person.report import COLOURS, ReportDetails, interval_picture, report_page
from tests.browser_cases import QUESTIONS, Listed
from tests.page_parts import Parts

LABELS = ("died & <i>gone</i>", 'not "well"', "well")


def asked(path: Path, *choices: str) -> dict[str, Any]:
    """The report of a session of three questions, of which so many were answered so."""
    subject = Subject(
        LABELS,
        Words("people", title="A <title>"),
        least=0,
        report=lambda _: ["It is", "  one <thing>", "All."],
    )
    with Session(lambda known: Listed(QUESTIONS[:3], known), path) as session:
        interview = Interview(session, subject)
        for choice in choices:
            question = session.question()
            assert question is not None
            interview.handle({"do": "answer", "id": question.id, "choice": choice})
        return interview.handle({"do": "report"})


def test_a_report_holds_every_answer_and_nothing_that_runs_or_is_elsewhere(tmp_path: Path) -> None:
    reply = asked(tmp_path / "mine.jsonl", "equal", "cannot tell")
    page = Parts(reply["html"])
    assert not {"script", "i", "thing", "link", "img", "iframe", "a"} & set(page.tags)
    assert not [
        name for name, _ in page.attributes if name in ("src", "href") or name.startswith("on")
    ]
    assert "http" not in reply["html"]
    assert reply["name"].startswith("a-title-report-")
    assert "A <title>: a report" in page.text
    kinds = "1 is learned from (1 of them “equally good”) and 1 is “cannot tell”"
    assert f"2 answers stand: {kinds}." in page.text
    assert "cannot tell" in page.text
    assert '10 not "well" as good as ' in page.text
    assert re.search(r"A: [^.]*\. B: [^.]*\. ", page.text)
    assert "died & <i>gone</i> " in page.text
    log = AnswerLog.read(tmp_path / "mine.jsonl")
    assert f"kept in mine.jsonl Checksum of its last line {log.checksum}" in page.text
    assert (tmp_path / "mine.jsonl").read_text().rstrip().endswith(f'"{log.checksum}"}}')


def test_bars_and_dots_of_a_report_are_in_the_middle_of_their_row_however_high_it_is() -> None:
    ranged, fixed = interval_picture(20.0, 30.0, 45.0, "red"), interval_picture(0, 0, 0, "red")
    assert 'y="50%" transform="translate(0 -7)" height="14"' in ranged
    assert 'cy="50%"' in ranged
    assert 'cy="50%"' in fixed


def test_a_report_says_whether_more_could_be_asked(tmp_path: Path) -> None:
    assert "Stopped early: more could be asked." in asked(tmp_path / "a", "equal")["html"]
    assert "Stopped early" not in asked(tmp_path / "b", *["cannot tell"] * 3)["html"]


@pytest.fixture
def end() -> dict[str, Any]:
    return {
        "open": "There is no finer question.",
        "scale": [
            {"label": "well", "value": 100.0, "low": 100.0, "high": 100.0},
            {"label": "ill", "value": 40.4, "low": 31.0, "high": 55.0},
            {"label": "died", "value": 0.0, "low": 0.0, "high": 0.0},
        ],
        "certainty": "if your answers are right",
        "statements": ["It is", "  one", "  two", "All.", "  three"],
        "counts": {"answered": 3, "equal": 0, "cannot tell": 0, "unused": 1, "withdrawn": 1},
        "conflicts": [
            [{"id": "x", "sentence": "x rather than y"}, {"id": "y", "sentence": "y rather than x"}]
        ],
    }


def test_a_report_marks_what_was_taken_back_repeated_or_does_not_go_together(
    end: dict[str, Any],
) -> None:
    one = {
        "verdict": 1,
        "time": "2026-01-02T03:04:05.678+00:00",
        "withdrawn": False,
        "used": True,
        "repeat": False,
        "stands": True,
        "remarks": ["contradicts others", "ignored"],
    }
    back = {"stands": False, "remarks": ["taken back"]}
    gone = {**one, "number": 3, "withdrawn": True, "used": False, **back}
    again = {"repeat": True, "time": None, "remarks": ["contradicts others", "asked again"]}
    answers = [
        {**one, "id": "x", "number": 1, "sentence": "x rather than y", "used": False},
        {**gone, "id": "z", "sentence": "z rather than y"},
        {**one, "id": "y", "number": 2, "sentence": "y rather than x", **again},
    ]
    page = Parts(report_page("", "today", end, answers, waiting=False))
    assert "1 x rather than y 2026-01-02 03:04 contradicts others; ignored 3 z " in page.text
    assert "ignored 3 z rather than y 2026-01-02 03:04 taken back 2 " in page.text
    assert page.text.endswith("2 y rather than x contradicts others; asked again")
    assert "Every answer, oldest first (3 that stand, 1 taken back)" in page.text
    assert page.tags.count("s") == 1
    assert "These 2 answers contradict each other" in page.text
    counted = "3 answers stand: 2 are learned from and 1 is ignored for contradicting others."
    assert f"{counted} Besides these, 1 was taken back." in page.text


def test_the_scale_of_a_report_is_drawn_to_its_numbers(end: dict[str, Any]) -> None:
    page = Parts(
        report_page("Mine", "today", end, [], False, ReportDetails(preamble="Of <patients> alike."))
    )
    assert "Of <patients> alike." in page.text
    assert "well 100 fixed ill 40 31 to 55 died 0 fixed" in page.text
    placed = [
        (name, value)
        for name, value in page.attributes
        if name in ("x", "width", "cx") and value != "100%"
    ]
    assert ("x", "31.0%") in placed
    assert ("width", "24.0%") in placed
    assert ("cx", "40.40%") in placed
    assert [page.tags.count(tag) for tag in ("svg", "rect", "circle", "ul", "li")] == [
        5,  # three levels, and the axis above them, or on a narrow page below them
        3,
        3,
        3,
        5,
    ]
    assert "nswers are kept" not in page.text


def test_the_chosen_row_of_a_report_is_marked_and_checks_come_after_the_conclusion(
    end: dict[str, Any],
) -> None:
    table = {
        "title": "T",
        "note": "One.\nTwo.",
        "columns": ["Way", "worth"],
        "of": "way",
        "open": None,
    }
    changes = {**table, "rows": [["x", "9"], ["y", "10"]], "marked": 1, "mark": "best"}
    found = {**end, "headline": "Y it is.", "reason": "By 1.", "next": "Stop."}
    found |= {"sure": "With luck.", "size": "By 2.", "before": "By 3.", "changes": changes}
    html = report_page("Mine", "today", found, [], False, ReportDetails(who="Ann"))
    text = Parts(html).text
    assert "Answers of Ann. “You” in this report is Ann. today. 3 answers." in text
    assert text.index("Y it is.") < text.index("By 1.") < text.index("and 1 is ignored")
    assert "y best 10" in text
    assert html.count('<tr class="marked">') == 1
    assert html.count('<td data-head="worth" class="number">') == 2
    assert "<p>One.</p>\n<p>Two.</p>" in html
    named = "By 1. How sure: With luck. How close: By 2. Before: By 3. "
    assert named in text
    assert "Stop." not in text  # what to do on the screen


def test_on_paper_long_tables_are_left_out_or_cut_off_and_it_is_said(end: dict[str, Any]) -> None:
    def table(n: int) -> dict[str, Any]:
        rows = [[f"{i}", "do"] for i in range(n)]
        return {"title": "T", "note": "", "columns": ["State", "Do"], "rows": rows, "of": "state"}

    for n, said in ((40, 0), (41, 2)):
        found = {**end, "changes": {**table(n), "open": None}, "plan": table(n)}
        html = report_page("Mine", "today", found, [], False)
        page = Parts(html)
        assert page.text.count("is not printed. It is on this page on a screen") == said
        assert html.count('<details class="long">') == html.count('many cut"') + said // 2
        assert html.count("<tr><td") == 2 * n  # on a screen all is there
    assert "The rest of this table (1 more rows) is not printed." in page.text
    assert "The table of all 41 states is not printed." in page.text


def test_the_counts_of_an_answer_add_up(tmp_path: Path) -> None:
    """The answer says who is the same on both sides, so that all people are there."""
    query = Query("q", [0.5, 0.1, 0.4], [0.3, 0.5, 0.2])
    subject = Subject(LABELS, Words("people"), least=0)
    with (
        Session(lambda known: Listed([query], known), tmp_path / "log.jsonl") as session,
        Interview(session, subject) as interview,
    ):
        interview.handle({"do": "answer", "id": "q", "choice": "equal"})
        shown = interview.handle({"do": "answers"})["answers"][0]["shown"]
    assert "(Of 10 people; 6 are the same in both: " in shown
    sides, same = shown.split("(Of 10 people; 6")
    for side in (sides[: sides.index("B: ")], sides[sides.index("B: ") :]):
        assert sum(map(int, re.findall(r"\d+", side))) == 4
    assert sum(map(int, re.findall(r"\d+", same))) == 6


# what people see who lack the cones for long, or for middle wavelengths (Machado and others, 2009)
SEEN = {
    "most people": np.eye(3),
    "protanopia": np.array(
        [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.052]]
    ),
    "deuteranopia": np.array(
        [[0.3673, 0.8606, -0.2279], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]]
    ),
}


@pytest.mark.parametrize("seen", SEEN)
@pytest.mark.parametrize("page", ["light", "dark"])
def test_the_colours_of_neighbouring_levels_differ_to_everybody(page: str, seen: str) -> None:
    """Distances in CIELAB, of which about 2 are just seen."""
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    rgb = np.array(COLOURS[page]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = np.clip(linear @ SEEN[seen].T, 0, 1) @ to_xyz.T / [0.9505, 1, 1.089]
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    lab = np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)]).T
    apart = np.linalg.norm(np.diff(lab, axis=0), axis=1)
    assert apart.min() >= (16 if page == "light" else 6)


def test_whoever_wanted_the_values_reads_them_before_what_follows(end: dict[str, Any]) -> None:
    said = {**end, "headline": "Your values: ill\u00a040.", "sure": "With 95% probability."}
    for follows, order in (
        ("", ["Your values: ill\u00a040.", "With 95% probability.", "What the levels are worth"]),
        (
            "The plan is this.",
            [
                "Your values: ill\u00a040.",
                "What the levels are worth",
                "<h2>The plan is this.</h2>",
                "With 95% probability.",
            ],
        ),
    ):
        html = report_page(
            "Mine", "today", {**said, "follows": follows}, [], False, ReportDetails()
        )
        assert sorted(order, key=html.index) == order


def test_a_plan_is_an_appendix_where_the_values_were_wanted_and_remarks_are_no_part_of_it(
    end: dict[str, Any],
) -> None:
    plan = {
        "title": "The whole plan",
        "note": "All.",
        "columns": ("State", "Action"),
        "of": "state",
    }
    said = {
        **end,
        "follows": "The plan is this.",
        "sure": "With 95% probability.",
        "remarks": ["Answers came fast."],
        "plan": {**plan, "rows": [("acute", "wait")]},
    }
    html = report_page("Mine", "today", said, [], False, ReportDetails())
    order = ["What the levels are worth", "Answers came fast.", "<h2>Answers and checks</h2>"]
    order += ["<h2>Appendix", "The plan is this.", "With 95% probability.", "The whole plan"]
    assert sorted(order, key=html.index) == order


def test_a_fraction_in_the_headline_stays_on_one_line(end: dict[str, Any]) -> None:
    said = {**end, "headline": "It comes within 1 in 100 of your ideal plan."}
    html = report_page("Mine", "today", said, [], False, ReportDetails())
    assert "It comes within 1\u00a0in\u00a0100 of your ideal plan." in html
