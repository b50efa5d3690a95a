"""The page in a real browser: whatever the person does there, each answer is in the log once."""

import itertools
import re
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import AnswerLog, Session, Subject, Verdict, Words
from elicit.person.course.conclusion import Conclusion, ResultTable
from elicit.person.hosts.study_web import StudyServer
from elicit.person.report import colour_of
from elicit.person.study.study import Study
from tests.browser_cases import (
    LABELS,
    QUESTIONS,
    WORDS,
    Listed,
    bags,
    browser,
    executable,
    says,
    served,
)

WIDE = {"width": 1100, "height": 760}
NARROW = {"width": 390, "height": 844}
# the quarter of a second in which no button works is a short one, and so is the second between two
# looks at what is computed beside
HURRY = """
const later = setTimeout
window.setTimeout = (done, ms) => later(done, ms < 300 || ms === 1000 ? ms / 10 : ms)
"""
CONFLICTING = (
    "4 recovered and 6 died rather than 10 moderate",
    "10 moderate as good as 5 recovered and 5 died",
)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as one:
        yield one


class Windows:
    """The windows of one person's browser, and what they complain of."""

    def __init__(self, chromium: Any, log: Path) -> None:
        self.log = log
        self.complaints: list[str] = []
        self._chromium = chromium
        self._context: Any = None

    def open(
        self,
        server: Any,
        size: dict[str, int] = WIDE,
        *,
        hurry: bool = True,
        until: str = "h1",
        **how: Any,
    ) -> Any:
        """A window of the page. The first one of a server is let in by its address; later ones have
        the cookie. Its pauses are short, unless ``hurry`` is False. until: what is waited for.
        """
        if self._context is None:
            self._context = self._chromium.new_context(
                viewport=size, reduced_motion="reduce", **how
            )
            if hurry:
                self._context.add_init_script(HURRY)
        page = self._context.new_page()
        page.set_viewport_size(size)
        page.set_default_timeout(20_000)  # of a busy machine
        page.on("console", lambda said: self.complaints.append(said.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("dialog", lambda dialog: self.complaints.append(dialog.message))
        page.goto(server.new_address())
        page.wait_for_selector(until)
        return page

    def context(self, **how: Any) -> Any:
        """Another browser, which was not let in."""
        return self._chromium.new_context(**how)

    def forget(self) -> None:
        """Close them, and open the next in another browser."""
        self.close()
        self._context = None

    def close(self) -> None:
        if self._context is not None:
            self._context.close()

    def entries(self) -> list[tuple[str, Verdict | None, bool]]:
        """The query, the verdict, and whether it stands, of every answer in the log."""
        return [
            (e.answer.query.id, e.answer.verdict, not e.retracted) for e in AnswerLog.read(self.log)
        ]


@pytest.fixture
def windows(chromium: Any, tmp_path: Path) -> Iterator[Windows]:
    one = Windows(chromium, tmp_path / "log.jsonl")
    yield one
    one.close()
    # a page that asks how many questions are left may find its server ended before its window
    assert not [said for said in one.complaints if "ERR_CONNECTION_REFUSED" not in said]


def at(page: Any, name: str) -> None:
    """Wait until the page is there, and takes answers."""
    page.locator(".place b", has_text=re.compile(f"^{name}$")).wait_for()
    page.wait_for_selector(".sheet:not([aria-busy]) .pick:enabled")


def click(page: Any, choice: str) -> None:
    page.click(f"[data-choice='{choice}']")


def answer(page: Any, choice: str) -> None:
    """Answer, and wait until something else is there and takes answers."""
    was = page.inner_text(".place b")
    click(page, choice)
    page.wait_for_function("was => document.querySelector('.place b').innerText != was", arg=was)
    page.wait_for_selector(".sheet:not([aria-busy]) .body button:enabled")


def start(page: Any) -> None:
    at(page, "Welcome")
    name(page, "Start").click()
    at(page, "Practice")


def practise(page: Any) -> None:
    start(page)
    click(page, "a")
    at(page, "Question 1")


def practised(
    windows: Windows,
    server: Any,
    size: dict[str, int] = WIDE,
    verdicts: Sequence[int] = (),
    **how: Any,
) -> Any:
    """Return a window at a question: the practice and these answers were before it was opened."""
    server._interview.handle({"do": "practised", "choice": "a"})
    session = server._interview._session
    for verdict in verdicts:
        session.answer(session.question().id, verdict)
    page = windows.open(server, size, **how)
    at(page, f"Question {1 + len(verdicts)}")
    return page


def name(page: Any, words: str) -> Any:
    return page.get_by_role("button", name=words, exact=True)


def truthfully(page: Any) -> str:
    """Return the choice of a person to whom moderate is worth 55 of 100, read off the page."""
    worth = []
    for card in page.locator(".card").all():
        rows = dict(
            row.split(" ", 1)[::-1] for row in map(clean, card.locator(".row").all_inner_texts())
        )
        worth.append(
            sum(
                {"recovered": 100, "moderate": 55, "died": 0}[label] * int(n)
                for label, n in rows.items()
            )
        )
    return "equal" if worth[0] == worth[1] else "a" if worth[0] > worth[1] else "b"


def clean(row: str) -> str:
    return " ".join(row.replace("✓", "").replace("✕", "").split())


TRUTH = [("q0", 1), ("q1", -1), ("q2", 1), ("q3", -1), ("q4", -1)]


def test_a_session_by_mouse(windows: Windows) -> None:
    with served(windows.log) as server:
        page = windows.open(server)
        start(page)
        click(page, truthfully(page))
        at(page, "Question 1")
        assert page.inner_text(".note") == "That is how it works. Now the real questions."
        for n in range(1, 6):
            at(page, f"Question {n}")
            assert page.title() == f"Question {n} - ICU-Sepsis"
            assert page.inner_text(".saved").endswith(
                "Nothing answered yet" if n == 1 else "saved where the program runs"
            )
            click(page, truthfully(page))
        at(page, "Result")
        assert page.evaluate("document.activeElement.tagName") == "H1"
        assert "The plan rests on 5 answers and may lose at most 0.8%." in page.inner_text(".body")
        assert page.locator(".worth tbody tr").all_inner_texts()[0].split() == [
            "recovered",
            "100",
            "fixed",
        ]
        with page.expect_download() as kept:
            name(page, "Download report").click()
        page.locator("button:focus", has_text="Download report").wait_for()
        said = f"Given to your browser as {kept.value.suggested_filename}: look among"
        assert page.locator(".kept").first.inner_text().startswith(said)
        assert re.fullmatch(
            r"icu-sepsis-report-\d{4}-\d\d-\d\d\.html", kept.value.suggested_filename
        )
        assert (
            "10 moderate rather than 4 recovered and 6 died" in Path(kept.value.path()).read_text()
        )
    assert [(id, verdict) for id, verdict, _ in windows.entries()] == TRUTH


def test_a_session_by_keyboard(windows: Windows) -> None:
    keys = {"a": ("ArrowLeft", "a"), "b": ("ArrowRight", "B"), "equal": ("ArrowDown",)}
    with served(windows.log) as server:
        page = windows.open(server)
        start(page)
        page.keyboard.press(keys[truthfully(page)][0])
        for n in range(1, 6):
            at(page, f"Question {n}")
            page.keyboard.press(keys[truthfully(page)][n % 2])
        at(page, "Result")
        page.keyboard.press("u")
        at(page, "Question 5")
        page.keyboard.press("Control+z")
        at(page, "Question 4")
        page.keyboard.press("Shift+?")
        at(page, "Question 5")
        page.keyboard.press("ArrowDown")
        at(page, "Result")
        # what is no key is reached by Tab, from the heading on
        for _ in range(10):
            page.keyboard.press("Tab")
            if page.evaluate("document.activeElement.textContent") == "Your answers":
                break
        page.keyboard.press("Enter")
        at(page, "Your answers")
    stands = [(id, verdict) for id, verdict, stands in windows.entries() if stands]
    assert stands == [*TRUTH[:3], ("q3", None), ("q4", 0)]


def test_keys_that_are_held_or_meant_for_something_else_do_not_answer(windows: Windows) -> None:
    with served(windows.log) as server:
        page = practised(windows, server, hurry=False)
        for key in (
            "Control+a",
            "Alt+a",
            "Shift+ArrowLeft",
            "Meta+b",
            "Backspace",
            "Control+Shift+z",
            "u",
            "x",
        ):
            page.keyboard.press(key)
        at(page, "Question 1")
        page.keyboard.down("a")
        at(page, "Question 2")
        for _ in range(5):
            page.keyboard.down("a")  # which repeats
        page.keyboard.up("a")
        page.locator(".pick").first.dblclick()
        at(page, "Question 3")
        page.evaluate("document.querySelector('.pick').click()")
        page.keyboard.press("b")
        page.keyboard.press("b")
        at(page, "Question 4")
        page.set_viewport_size({"width": 390, "height": 500})
        page.keyboard.press("ArrowDown")  # scrolls: the buttons are below
        at(page, "Question 4")
    assert [id for id, _, _ in windows.entries()] == ["q0", "q1", "q2"]


def test_a_reload_goes_on_where_it_was(windows: Windows) -> None:
    with served(windows.log) as server:
        page = practised(windows, server)
        click(page, "b")
        at(page, "Question 2")
        before = page.inner_text(".body")
        page.reload()
        at(page, "Question 2")
        assert page.inner_text(".body") == before
        assert "1 answer saved" in page.inner_text(".saved")
    with served(windows.log) as server:  # and so does tomorrow
        page.goto(server.new_address())
        at(page, "Question 2")
        assert page.inner_text(".body") == before


def test_the_browsers_back_closes_what_is_looked_at_beside_a_question(windows: Windows) -> None:
    with served(windows.log) as server:
        page = practised(windows, server)
        click(page, "b")
        at(page, "Question 2")
        for name, heading in (("Your answers", "Your answers"), ("Pause", "Paused")):
            page.get_by_role("button", name=name).click()
            at(page, heading)
            page.go_back()
            at(page, "Question 2")
            page.get_by_role("button", name=name).click()
            at(page, heading)
            page.get_by_role("button", name="Back to the question").click()
            at(page, "Question 2")
        assert page.evaluate("history.state?.beside ?? null") is None
        click(page, "b")
        at(page, "Question 3")


def test_undo_and_taking_back_an_old_answer(windows: Windows) -> None:
    with served(windows.log) as server:
        page = practised(windows, server)
        assert name(page, "Take back last answer").is_disabled()
        for n in (2, 3, 4):
            click(page, truthfully(page))
            at(page, f"Question {n}")
        assert re.match(
            "Takes back: .* (5 recovered|10 moderate)",
            name(page, "Take back last answer").get_attribute("title"),
        )
        name(page, "Take back last answer").click()
        at(page, "Question 3")
        assert page.inner_text(".note") == "Taken back."
        name(page, "Your answers").click()
        at(page, "Your answers")
        items = page.locator(".list li").all_inner_texts()
        assert len(items) == 3
        assert "taken back" in items[0]
        last = page.locator(".list li").last
        last.get_by_role("button").click()
        last.get_by_role("button", name="No, keep it").click()  # nothing is taken back at once
        assert page.locator(".gone").count() == 1
        last.get_by_role("button", name="Take back").click()
        assert page.evaluate("document.activeElement.textContent") == "Yes, take it back"
        violated(page)
        last.get_by_role("button", name="Yes, take it back").click()
        page.locator(".gone").nth(1).wait_for()
        assert [item[:3] for item in page.locator(".list li").all_inner_texts()] == [
            "3. ",
            "2. ",
            "1. ",
        ]
        name(page, "Back to the question").click()
        at(page, "Question 1")  # the same question has the same number
        assert page.inner_text(".check").startswith("This is the same question again, because you ")
    assert [(id, stands) for id, _, stands in windows.entries()] == [
        ("q0", False),
        ("q1", True),
        ("q2", False),
    ]


def test_a_question_in_two_tabs_is_answered_once(windows: Windows) -> None:
    with served(windows.log) as server:
        one = practised(windows, server)
        other = windows.open(server, NARROW)
        at(other, "Question 1")
        click(one, "a")
        at(one, "Question 2")
        click(other, "b")
        at(other, "Question 2")
        assert other.inner_text(".note").startswith(
            "That question was already answered, perhaps in another window: "
        )
        click(other, "a")
        at(other, "Question 3")
        one.evaluate("window.dispatchEvent(new Event('focus'))")  # the person comes back to it
        at(one, "Question 3")
    assert [id for id, _, _ in windows.entries()] == ["q0", "q1"]


def test_what_does_not_go_together_is_said_and_mended(windows: Windows) -> None:
    with served(windows.log, QUESTIONS[:3]) as server:
        page = practised(windows, server)
        click(page, "b" if truthfully(page) == "a" else "a")
        at(page, "Question 2")
        click(page, truthfully(page))
        at(page, "Question 3")
        click(page, "equal")
        at(page, "Result")
        box = page.locator(".conflict")
        assert box.locator("h2").inner_text() == "These two answers contradict each other"
        assert box.locator("li span").all_inner_texts() == list(CONFLICTING)
        box.get_by_role("button", name=f"Take back: {CONFLICTING[0]}").click()
        box.get_by_role("button", name=f"Yes, take it back: {CONFLICTING[0]}").click()
        at(page, "Question 1")
        click(page, truthfully(page))
        at(page, "Result")
        assert not page.locator(".conflict").count()
    stands = [(id, verdict) for id, verdict, stands in windows.entries() if stands]
    assert stands == [("q1", -1), ("q2", 0), ("q0", 1)]


@pytest.mark.parametrize("size", [{"width": 1280, "height": 900}, NARROW], ids=["wide", "narrow"])
def test_the_answers_stay_at_one_place(windows: Windows, size: dict[str, int]) -> None:
    with served(windows.log) as server:
        page = practised(windows, server, size)
        places = []
        for number in range(2, 5):
            click(page, "a")
            at(page, f"Question {number}")
            places.append(
                page.evaluate(
                    "[...document.querySelectorAll('[data-choice]')]"
                    ".map((one) => one.getBoundingClientRect().top + scrollY)"
                )
            )
    assert len(places[0]) == 4
    assert np.ptp(places, axis=0).max() <= 1.5  # px


def test_neither_many_circles_nor_notes_nor_why_move_an_answer_or_change_a_size(
    windows: Windows, tmp_path: Path
) -> None:
    """Questions of ten and of a hundred, in another order in each of two sessions."""
    labels = ("died", "needs daily care", "limited", "no complaints")
    few, many = ((0, 0, 10, 0), (4, 0, 0, 6)), ((1, 24, 45, 30), (1, 10, 69, 20))
    most = ((0, 6, 69, 25), (5, 0, 20, 75))

    def found() -> Any:
        return page.evaluate(
            "[...document.querySelectorAll('[data-choice]')].map((one) => "
            "one.getBoundingClientRect().top + scrollY).concat("
            "[document.querySelector('.pair .icon').offsetWidth, "
            "parseFloat(getComputedStyle(document.querySelector('.pair .n')).fontSize)])"
        )

    seen = []
    for name_of_log, order in (("one", (few, many, most)), ("two", (most, few, many))):
        log = tmp_path / f"{name_of_log}.jsonl"
        words = replace(WORDS, duration="Each patient stays in the condition shown.")
        with served(log, bags(*order), labels, words) as server:
            page = windows.open(server, {"width": 1200, "height": 850})
            practise(page)
            seen.append(found())
            page.click(".why summary")
            seen.append(found())
            click(page, "a")
            at(page, "Question 2")
            seen.append(found())
            name(page, "Take back last answer").click()
            at(page, "Question 1")
            note = page.locator(".note").bounding_box()
            assert note["y"] + note["height"] <= page.locator("h1").bounding_box()["y"]
            seen.append(found())
            click(page, "a")
            at(page, "Question 2")
            click(page, "a")
            at(page, "Question 3")
            seen.append(found())
            why = page.locator(".why summary").bounding_box()
            assert why["y"] + why["height"] <= 850
            page.close()
        windows.forget()
    assert np.ptp(seen, axis=0).max() <= 1.5, seen  # px


@pytest.mark.parametrize("size", [{"width": 1280, "height": 864}, NARROW], ids=["wide", "narrow"])
def test_all_answers_are_seen_close_below_the_words_and_notes_share_a_box(
    windows: Windows, size: dict[str, int]
) -> None:
    """Four levels, of which a question shows two, three or all."""
    labels = ("died", "needs daily care", "limited", "no complaints")
    questions = bags(((0, 0, 10, 0), (4, 0, 0, 6)), ((0, 3, 0, 7), (2, 0, 8, 0)))
    words = replace(WORDS, duration="Each patient stays in the condition shown for five years.")
    box = "(s) => document.querySelector(s).getBoundingClientRect().toJSON()"
    tops = []
    with served(windows.log, questions, labels, words) as server:
        page = windows.open(server, size)
        start(page)
        for stage in ("Practice", "Question 1", "Question 2", "Question 1 again"):
            if stage == "Question 1 again":
                name(page, "Take back last answer").click()
                at(page, "Question 1")
                words_of_box = " ".join(page.inner_text(".said").split())
                assert words_of_box.startswith("Taken back. This is the same question again, ")
            else:
                at(page, stage)
            said, heading, pair, lead, last = (
                page.evaluate(box, one) for one in (".said", "h1", ".pair", ".lead", ".mid")
            )
            assert page.locator(".said").is_visible() == (stage != "Question 2")
            if stage != "Question 2":
                assert heading["top"] - said["bottom"] >= 8  # px
            assert pair["top"] - lead["bottom"] <= 20
            assert last["bottom"] <= size["height"]
            tops.append((pair["top"], last["top"]))
            if stage in ("Practice", "Question 1"):
                click(page, "a")
    assert np.ptp(tops, axis=0).max() <= 1.5, tops


def test_nothing_looks_chosen_under_a_pointer_that_rests(windows: Windows) -> None:
    colour = "getComputedStyle(document.querySelector('[data-choice=a]')).backgroundColor"
    with served(windows.log) as server:
        page = practised(windows, server)
        usual = page.evaluate(colour)
        click(page, "a")
        at(page, "Question 2")
        assert page.evaluate(colour) == usual
        place = page.locator("[data-choice=a]").bounding_box()
        page.mouse.move(place["x"] + 30, place["y"] + 10)
        page.mouse.move(place["x"] + 40, place["y"] + 12)
        assert page.evaluate(colour) != usual


def test_long_words_in_the_head_move_no_answer(windows: Windows) -> None:
    """On a phone they take two lines, from the room above the answers."""
    to_come: list[list[int] | None] = [None]

    def outlook(route: Any) -> None:
        message = route.request.post_data_json
        if message["do"] != "outlook":
            route.continue_()
        else:
            ready = to_come[0] is not None
            why = ["It is far." if ready else "It is near."]
            route.fulfill(json={"id": "q0", "why": why, "to_come": to_come[0], "ready": ready})

    def places() -> tuple[int, int]:
        found = page.evaluate(
            "['.head', '.pair'].map((one) => document.querySelector(one))"
            ".map((one) => [one.offsetHeight, one.getBoundingClientRect().top])"
        )
        return round(found[0][0]), round(found[1][1])

    with served(windows.log) as server:
        page = windows.open(server, NARROW)
        page.route("**/api", outlook)
        practise(page)
        page.get_by_text("It is near.").wait_for(state="attached")
        head, pair = places()
        to_come[0] = [1_000_000, 2_000_000]
        page.get_by_text("It is far.").wait_for(state="attached")
        assert places()[0] > head
        assert places()[1] == pair


def test_a_note_of_one_line_moves_nothing(windows: Windows) -> None:
    def places() -> Any:
        return page.evaluate(
            "['h1', '.pair', '.mid'].map((one) => document.querySelector(one).offsetTop)"
        )

    with served(windows.log) as server:
        page = practised(windows, server)
        assert not page.inner_text(".note")
        before = places()
        click(page, "a")
        at(page, "Question 2")
        name(page, "Take back last answer").click()
        at(page, "Question 1")
        assert page.locator(".note").is_visible()
        assert places() == before


@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_circles_stand_in_tens_or_else_in_fives(windows: Windows, size: dict[str, int]) -> None:
    lines = """
    [...document.querySelectorAll(".icons")].map((all) => {
      const tops = [...all.querySelectorAll(".icon")].map((one) => one.offsetTop);
      return [...new Set(tops)].map((top) => tops.filter((one) => one === top).length);
    }).filter((all) => all.length)
    """
    labels = ("died", "needs daily care", "recovered")
    questions = bags(((0, 18, 0), (5, 0, 13)), ((0, 18, 0), (7, 0, 11)))
    with served(windows.log, questions, labels, least=1, of=18) as server:
        page = practised(windows, server, size)
        found = page.evaluate(lines)
        assert sorted(map(sum, found)) == [5, 13, 18]
        click(page, "a" if "18" in page.locator(".card").first.inner_text() else "b")
        at(page, "Question 2")
        click(page, "b" if "18" in page.locator(".card").first.inner_text() else "a")
        stage(page, "conflict")
        found += page.evaluate(lines)
        assert len(found) == 9
        for numbers in found:
            assert set(numbers[:-1]) <= {max(numbers)}
            assert max(numbers) in (5, 10) or len(numbers) == 1


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_better_level_is_lighter_and_each_stands_out(windows: Windows, scheme: Any) -> None:
    labels = ("died", "critical", "severe", "moderate", "mild", "recovered")
    questions = bags(((0, 0, 0, 10, 0, 0), (5, 0, 0, 0, 0, 5)))
    with served(windows.log, questions, labels) as server:
        page = windows.open(server, color_scheme=scheme)
        at(page, "Welcome")
        behind, *colours = (
            [float(x) for x in re.findall(r"[\d.]+", colour)]
            for colour in page.evaluate(
                "[document.querySelector('.panel'), ...document.querySelectorAll('.legend .icon')]"
                ".map((one) => getComputedStyle(one).backgroundColor)"
            )
        )
    expected = [
        re.search(f"--{scheme}: rgb\\(([\\d,]+)\\)", colour_of(i / 5)).group(1)  # type: ignore[union-attr]
        for i in range(6)
    ]
    assert [",".join(f"{x:.0f}" for x in colour) for colour in colours[::-1]] == expected
    light = [luminance(colour) for colour in colours]  # best first
    assert all(contrast(one, luminance(behind)) >= 3 for one in light)
    assert all(one > next for one, next in itertools.pairwise(light))
    least = {"light": 1.35, "dark": 1.15}[scheme]
    assert min(contrast(one, next) for one, next in itertools.pairwise(light)) > least


def luminance(colour: Sequence[float]) -> float:
    """Return the relative luminance of a colour, as WCAG defines it."""
    x = np.array(colour) / 255
    linear = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: float, other: float) -> float:
    """Return the contrast of two luminances."""
    return (max(one, other) + 0.05) / (min(one, other) + 0.05)


def test_levels_stand_in_line_on_both_sides(windows: Windows) -> None:
    with served(windows.log) as server:
        page = windows.open(server)
        start(page)
        rows = page.locator(".card")
        for stage in ("Practice", "Question 1", "Question 2"):
            at(page, stage)
            tops = [
                [row.bounding_box()["y"] for row in rows.nth(side).locator(".label").all()]
                for side in (0, 1)
            ]
            assert len(tops[0]) >= 2
            assert np.ptp(tops, axis=0).max() < 1, stage  # px
            click(page, "a")


def test_nothing_is_lost_when_the_program_stops(windows: Windows) -> None:
    with served(windows.log) as server:
        page = practised(windows, server)
        port = server.port
    assert not windows.complaints
    click(page, "a")
    banner = page.locator(".banner:visible")
    banner.wait_for()
    assert banner.inner_text().startswith(
        "Your answer (Group A is better) has not been saved yet. The program on this "
    )
    assert "Try again" in page.evaluate("document.activeElement.textContent")
    violated(page)
    with served(windows.log, port=port) as server:
        name(page, "Try again").click()
        banner.get_by_text("was restarted").wait_for()
        again = windows.open(server)  # which is let in, and with it the whole browser
        at(again, "Welcome")
        again.close()  # it asks for prospects, also when the program has stopped
        name(page, "Try again").click()
        at(page, "Question 2")
        assert not banner.count()
        name(page, "Take back last answer").click()
        at(page, "Question 1")
    assert [(id, stands) for id, _, stands in windows.entries()] == [("q0", False)]
    assert all(said.startswith("Failed to load resource") for said in windows.complaints)
    windows.complaints.clear()


@pytest.mark.slow
class FailsOnce(Listed):
    """An asker that fails once when it is asked after so many answers."""

    due: int | None = None

    def ask(self) -> Any:
        if len(self._told) == FailsOnce.due:
            FailsOnce.due = None
            raise RuntimeError("a planted failure")
        return super().ask()

    def __deepcopy__(self, memo: Any) -> Any:
        raise TypeError("so no question is computed ahead, where a failure is left out")


@pytest.mark.parametrize("several", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_failure_in_choosing_a_question_is_said_and_tried_again(
    windows: Windows, several: bool, caplog: pytest.LogCaptureFixture
) -> None:
    with ExitStack() as stack:
        FailsOnce.due = 0
        stack.callback(setattr, FailsOnce, "due", None)
        server: Any
        if several:
            people = ("ann", "ben")
            sessions = {
                who: stack.enter_context(
                    Session(lambda known: FailsOnce(QUESTIONS, known), path, who=who)
                )
                for who, path in zip(people, (windows.log, None), strict=True)
                for path in [AnswerLog(path, 3, who=who)]
            }
            FailsOnce.due = 0  # not while the session is made
            subject = Subject(LABELS, WORDS, report=says, least=0)
            study = stack.enter_context(Study(sessions, subject))
            server = stack.enter_context(StudyServer(study))
            server.new_address = lambda: server.links()["ann"]
            who, where = "ann", "for the study"
        else:
            server = stack.enter_context(served(windows.log, ask=FailsOnce))
            who, where = "a person without a name", "where the program runs"
        FailsOnce.due = 0
        page = windows.open(server, NARROW, until=".banner:visible")
        banner = page.locator(".banner:visible")
        assert banner.inner_text().startswith(
            "This cannot be shown yet. Something went wrong in the program."
        )
        assert f"the page of {who}: the message 'state'" in caplog.text
        assert "a planted failure" in caplog.text
        violated(page)
        name(page, "Try again").click()
        practise(page)
        FailsOnce.due = 1
        click(page, "a")
        banner.wait_for()
        assert banner.inner_text().startswith(  # and not that it was not saved
            "Your answer is saved, but what comes next could not be worked out."
        )
        assert "planted" not in page.inner_text("body")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        violated(page)
        page.evaluate("document.activeElement.click()")  # Try again has the focus
        at(page, "Question 2")
        assert not banner.count()
        assert f"1 answer saved {where}" in page.inner_text(".saved")
        for n in range(2, 6):
            at(page, f"Question {n}")
            click(page, truthfully(page))
        at(page, "Result")
    assert [(id, stands) for id, _, stands in windows.entries()] == [
        (f"q{i}", True) for i in range(5)
    ]
    assert len(windows.complaints) == 2
    assert all(said.startswith("Failed to load resource") for said in windows.complaints)
    windows.complaints.clear()


def test_the_page_for_who_is_not_let_in_looks_like_the_others(windows: Windows) -> None:
    with served(windows.log) as server:
        used = server.new_address()
        server.new_address()
        for scheme, colour in (("light", "rgb(20, 32, 43)"), ("dark", "rgb(232, 238, 243)")):
            context = windows.context(viewport=NARROW, color_scheme=scheme)
            page = context.new_page()
            reply = page.goto(used)
            assert reply.status == 403
            assert page.locator("h1").inner_text() == "Not open to this browser"
            assert page.locator(".panel p").count() == 2
            assert page.evaluate("getComputedStyle(document.querySelector('h1')).color") == colour
            assert page.evaluate("document.documentElement.scrollWidth") <= 390
            violated(page)
            context.close()


def test_what_is_computed_beside_is_asked_for_until_it_is_there(windows: Windows) -> None:
    replies = [
        {"why": [], "to_come": None, "ready": False},
        {
            "why": ["We don't know how <i>you</i> weigh this."],
            "to_come": [10, 20],
            "ready": True,
        },
    ]

    def outlook(route: Any) -> None:
        message = route.request.post_data_json
        if message["do"] != "outlook":
            route.continue_()
        elif message["id"] == "q0":
            route.fulfill(json={"id": "q0", **(replies.pop(0) if len(replies) > 1 else replies[0])})
        else:  # of the next question nothing is known while this one looks
            route.fulfill(json={"id": message["id"], "why": [], "to_come": None, "ready": False})

    with served(windows.log) as server:
        page = windows.open(server)
        page.route("**/api", outlook)
        practise(page)
        page.get_by_text("about 10 to 20 more, up to ").wait_for()
        page.click("summary")
        assert page.inner_text(".why p") == "We don't know how <i>you</i> weigh this."
        click(page, "a")
        at(page, "Question 2")
        assert "more" not in page.inner_text(".place")


def test_the_welcome_says_if_nothing_can_be_foreseen(windows: Windows) -> None:
    seen: list[str] = []

    def prospects(route: Any) -> None:
        if route.request.post_data_json["do"] != "prospects":
            route.continue_()
        else:
            route.fulfill(json={"budgets": [], "settled": "", "ready": bool(seen)})

    with served(windows.log) as server:
        page = windows.open(server)
        page.route("**/api", prospects)
        page.reload()
        waiting = page.get_by_text("Trying to foresee how far each choice").first
        waiting.wait_for()
        seen.append(waiting.inner_text())
        page.get_by_text("How far each choice of time gets cannot be foreseen here.").wait_for()
        assert page.inner_text(".likely").endswith("You will see it as you go.")


@pytest.mark.parametrize(
    "size",
    [
        pytest.param(WIDE, id="wide", marks=pytest.mark.slow),
        pytest.param({"width": 900, "height": 760}, id="mid"),
        pytest.param(NARROW, id="narrow"),
    ],
)
def test_start_stays_where_it_is_when_forecasts_come_or_go(
    windows: Windows, size: dict[str, int]
) -> None:
    likely = (
        "Settled in 10 of 12 simulations. "
        "In half of all 12 the result could still fall 0.53 in 100 short."
    )
    length = "Half of the simulated sessions took at most 24 questions, about 8 minutes."
    nothing = {"budgets": [], "settled": ""}
    replies = [
        {**nothing, "ready": False},
        {"budgets": [likely] * 3, "settled": length, "ready": False},
        {**nothing, "ready": True},
    ]

    def prospects(route: Any) -> None:
        if route.request.post_data_json["do"] != "prospects":
            route.continue_()
        else:
            route.fulfill(json=replies[min(len(tops), 2)])

    tops: list[float] = []
    with served(windows.log) as server:
        page = windows.open(server, size)
        page.route("**/api", prospects)
        page.reload()
        for words in ("Trying to foresee how far", length, "How far each choice of time gets"):
            page.get_by_text(words).first.wait_for()
            tops.append(name(page, "Start").bounding_box()["y"] + page.evaluate("scrollY"))
        page.locator(".choice").first.click()
        tops.append(name(page, "Start").bounding_box()["y"] + page.evaluate("scrollY"))
    assert max(tops) - min(tops) < 1, tops


def test_after_a_slip_the_practice_question_can_be_tried_again(windows: Windows) -> None:
    with served(windows.log) as server:
        page = windows.open(server)
        start(page)
        all_best = page.locator(".card").first.locator(".row").first.inner_text().startswith("10")
        right, wrong = ("a", "b") if all_best else ("b", "a")
        for again in (lambda: name(page, "Try again").click(), lambda: page.keyboard.press("u")):
            click(page, wrong)
            at(page, "Question 1")
            page.get_by_text("You can try again, or go on").wait_for()
            again()
            at(page, "Practice")
            assert not page.get_by_text("Try again").count()
        click(page, right)
        at(page, "Question 1")
        assert not page.get_by_text("Try again").count()
        assert not windows.entries()


def test_the_bar_says_what_the_words_say_never_jumps_and_goes_back_with_an_answer(
    windows: Windows,
) -> None:
    to_come = {"q0": [3, 3], "q1": [1, 2], "q2": [7, 17], "q3": None, "q4": [0, 0]}

    def outlook(route: Any) -> None:
        message = route.request.post_data_json
        if message["do"] != "outlook":
            route.continue_()
        else:
            known = {"why": [], "to_come": to_come[message["id"]], "at_least": 0, "ready": True}
            route.fulfill(json={"id": message["id"], **known})

    def width() -> float:
        return float(page.evaluate("parseFloat(document.querySelector('.meter span').style.width)"))

    widths = []
    with served(windows.log) as server:
        page = windows.open(server)
        page.route("**/api", outlook)
        practise(page)
        for n in range(1, 6):
            at(page, f"Question {n}")
            page.locator(".why p").first.wait_for(state="attached")  # the reply is drawn
            widths.append(width())
            assert page.locator(".meter").is_visible()
            if n == 3:
                name(page, "Take back last answer").click()
                at(page, "Question 2")
                assert width() == widths[1]
                answer(page, "cannot tell")
                at(page, "Question 3")
                page.locator(".why p").first.wait_for(state="attached")
                assert width() == widths[2]
            click(page, "cannot tell")
        at(page, "Result")
        widths.append(width())
    # 1 of 4, and no less when more are expected; then half the way to 4 of 5
    assert widths == [0, 25, 25, 25, 52.5, 100]


@pytest.mark.slow
def test_a_slow_question_says_so(windows: Windows) -> None:
    ready = threading.Event()

    class Slow(Listed):
        def ask(self) -> Any:
            ready.wait(30)
            return super().ask()

    with served(windows.log, ask=Slow) as server:
        ready.set()
        page = practised(windows, server)
        ready.clear()
        click(page, "a")
        page.get_by_text("Working out what comes next ...").wait_for()
        assert all(one.is_disabled() for one in page.get_by_role("button").all())
        page.keyboard.press("a")
        ready.set()
        at(page, "Question 2")
    assert len(windows.entries()) == 1


def violated(page: Any) -> None:
    """Fails where axe-core finds what keeps somebody out."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page)
    assert not found.violations_count, found.generate_report()


def fits(page: Any) -> None:
    """Fails where there is something to scroll sideways."""
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


@pytest.mark.parametrize(
    "size",
    [pytest.param(WIDE, id="wide", marks=pytest.mark.slow), pytest.param(NARROW, id="narrow")],
)
def test_every_screen_is_open_to_everybody_and_fits(windows: Windows, size: dict[str, int]) -> None:
    """The screens until a result; those after it have a test of their own."""

    def check() -> None:
        violated(page)
        fits(page)

    with served(windows.log, QUESTIONS[:3]) as server:
        page = windows.open(server, size)
        at(page, "Welcome")
        check()
        practise(page)
        page.click("summary")
        check()
        page.click("summary")
        assert page.evaluate(
            "document.querySelector('.mid').getBoundingClientRect().bottom < window.innerHeight"
        )
        click(page, "a")
        at(page, "Question 2")
        click(page, "cannot tell")
        at(page, "Question 3")
        name(page, "Pause").click()
        at(page, "Paused")
        assert "start the same command again" in page.inner_text(".body")
        check()
        name(page, "Back to the question").click()
        at(page, "Question 3")
        name(page, "Take back last answer").click()
        at(page, "Question 2")


@pytest.mark.parametrize(
    "size",
    [pytest.param(WIDE, id="wide", marks=pytest.mark.slow), pytest.param(NARROW, id="narrow")],
)
def test_every_screen_of_a_result_in_conflict_is_open_to_everybody_and_fits(
    windows: Windows, size: dict[str, int]
) -> None:
    def check() -> None:
        violated(page)
        fits(page)

    with served(windows.log, QUESTIONS[:3]) as server:
        page = practised(windows, server, size, [1, 1])  # moderate is better than 6 in 10
        click(page, "equal")
        at(page, "Result")
        check()
        name(page, "Your answers 1 in conflict").click()
        at(page, "Your answers")
        check()
        name(page, "Back to the result").click()
        with page.expect_download() as kept:
            name(page, "Download report").click()
        report = windows.log.with_name(kept.value.suggested_filename)
        kept.value.save_as(report)
        page.goto(report.as_uri())
        check()


LONG = '<b>bold</b> & "quoted"', "Supercalifragilisticexpialidocious", "a long name with many words"
ODD = tuple(f"{LONG[i % 3]} {i}" for i in range(20))
ODD_WORDS = Words(
    '<i>units</i> of "much"', "go", "<script>alert(1)</script>", "<img src=x onerror=alert(1)>"
)


@pytest.mark.slow
@pytest.mark.parametrize("total", [30, 2_000_000])
def test_odd_names_many_levels_and_large_numbers_are_only_shown(
    windows: Windows, total: int
) -> None:
    rng = np.random.default_rng(0)
    questions = bags(
        *(
            (rng.multinomial(total, np.ones(20) / 20), total * np.eye(20, dtype=int)[7])
            for _ in range(2)
        )
    )
    with ExitStack() as stack:
        server = stack.enter_context(
            served(
                windows.log,
                [type(q)(q.id, q.left * total, q.right * total) for q in questions],
                ODD,
                ODD_WORDS,
            )
        )
        page = practised(windows, server)
        for size in (WIDE, NARROW):
            page.set_viewport_size(size)
            fits(page)
            tops = [
                [row.bounding_box()["y"] for row in card.locator(".row").all()]
                for card in page.locator(".card").all()
            ]
            assert (tops[0] == tops[1]) == (size == WIDE)
        assert ODD[0] in page.inner_text(".body")
        assert ODD_WORDS.title == page.inner_text(".brand b")
        assert not page.locator(".elicit :is(i:not(.icon), img, script)").count()
        assert bool(page.locator(".icon").count()) == (total == 30)
        click(page, "a")
        at(page, "Question 2")
        name(page, "Take back last answer").click()
        at(page, "Question 1")
        click(page, "b")
        at(page, "Question 2")
        click(page, "cannot tell")
        at(page, "Result")
        page.set_viewport_size(NARROW)
        fits(page)
        violated(page)


def test_the_sides_are_named_as_the_problem_says(windows: Windows) -> None:
    with served(windows.log, labels=LABELS, words=Words("days", side="holiday")) as server:
        page = windows.open(server)
        start(page)
        assert page.inner_text("h1").endswith(
            "Two holidays of 10 days: which would you rather have?"
        )
        assert page.locator(".card h2").all_inner_texts() == ["Holiday A", "Holiday B"]


def test_where_the_browser_is_missing_a_user_is_told_and_ci_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match="apt-get install chromium-headless-shell"):
        executable()
    monkeypatch.delenv("CI")
    with pytest.raises(pytest.skip.Exception, match="apt-get install chromium-headless-shell"):
        executable()


def test_an_answer_against_the_order_of_the_levels_stands_alone(windows: Windows) -> None:
    with served(windows.log, bags(((0, 0, 10), (10, 0, 0)))) as server:
        page = practised(windows, server)
        click(
            page, "b" if "10 recovered" in clean(page.locator(".card").first.inner_text()) else "a"
        )
        at(page, "Result")
        assert page.inner_text(".conflict h2").startswith(
            "This answer goes against the order of the levels"
        )
        page.locator(".conflict").get_by_role("button").click()
        page.locator(".conflict").get_by_role("button", name="Yes, take it back").click()
        at(page, "Question 1")


DARK = {"color_scheme": "dark"}


def stage(page: Any, wanted: str) -> None:
    """Wait until this stage is drawn and takes answers."""
    page.wait_for_selector(f".sheet[data-stage={wanted}]:not([aria-busy]) .body button:enabled")


@pytest.mark.parametrize(
    ("size", "how"),
    [
        pytest.param(WIDE, {}, id="wide", marks=pytest.mark.slow),
        pytest.param(WIDE, DARK, id="dark"),
        pytest.param(NARROW, DARK, id="narrow", marks=pytest.mark.slow),
    ],
)
def test_a_conflict_an_offer_and_an_early_end_are_open_to_everybody_and_fit(
    windows: Windows, size: dict[str, int], how: dict[str, str]
) -> None:
    def check() -> None:
        violated(page)
        fits(page)

    with served(windows.log, QUESTIONS[:2] + QUESTIONS[3:], least=5) as server:
        page = windows.open(server, size, **how)
        check()
        practise(page)
        answer(page, "b" if truthfully(page) == "a" else "a")  # worse than 4 in 10
        at(page, "Question 2")
        answer(page, truthfully(page))
        at(page, "Question 3")
        for _ in range(3):
            answer(page, "cannot tell")
        stage(page, "offer")
        check()
        name(page, "Finish now and show the result").click()
        stage(page, "end")
        check()
        name(page, "Ask me more").click()
        stage(page, "question")
        name(page, "Finish now").click()
        stage(page, "end")
        if size == NARROW:
            page.click("text=Downloads")
        with page.expect_download() as kept:
            page.get_by_role("button", name="Scale as CSV").click()
        assert "moderate" in Path(kept.value.path()).read_text()


def contradicts(page: Any) -> None:
    """Say that moderate is worse than 4 in 10, and then that it is better than 6 in 10."""
    for _ in range(2):
        rows = " ".join(page.locator(".card").first.inner_text().split())
        moderate_is_a = "10 moderate" in rows
        worse = "4 recovered" in page.inner_text(".pair").replace("\n", " ")
        answer(page, "a" if moderate_is_a != worse else "b")


@pytest.mark.parametrize("size", [WIDE, pytest.param(NARROW, marks=pytest.mark.slow)])
def test_a_contradiction_is_brought_up_at_once_and_mended_with_one_tap(
    windows: Windows, size: dict[str, int]
) -> None:
    with served(windows.log, QUESTIONS[:2], least=1) as server:
        page = practised(windows, server, size, **DARK)
        contradicts(page)
        stage(page, "conflict")
        assert page.inner_text("h1") == "These two answers contradict each other"
        assert page.locator(".panel .card.chosen").count() == 2
        assert "1 in conflict" in page.inner_text(".nav")
        violated(page)
        fits(page)
        page.reload()
        stage(page, "conflict")
        buttons = page.locator("section.panel")  # each answer has its button below it
        assert [one.locator("[data-keep]").inner_text() for one in buttons.all()] == [
            "Keep answer 1",
            "Keep answer 2",
        ]
        if size == WIDE:
            tops = [one.bounding_box()["y"] for one in page.locator("[data-keep]").all()[:2]]
            assert tops[0] == tops[1]
        for answered in page.locator(".panel .pair").all():  # both sides beside each other
            tops = [one.bounding_box()["y"] for one in answered.locator(".card").all()]
            assert len(tops) == 2
            assert tops[0] == tops[1]
        page.locator("[data-keep]").nth(1).click()
        page.wait_for_selector(".sheet:not([data-stage=conflict])")
        assert "conflict" not in page.inner_text(".nav")
    assert [(id, stands) for id, _, stands in windows.entries()][:2] == [
        ("q0", False),
        ("q1", True),
    ]


def test_the_whole_card_answers(windows: Windows) -> None:
    with served(windows.log) as server:
        page = practised(windows, server)
        page.locator(".card").nth(1).click(position={"x": 30, "y": 60})
        at(page, "Question 2")
    assert len(windows.entries()) == 1


def test_the_second_click_of_a_double_click_does_not_answer_the_next_question(
    windows: Windows,
) -> None:
    """Even if it is so slow that the next question takes answers already."""
    with served(windows.log) as server:
        page = practised(windows, server)
        for n, answers in ((1, 1), (2, 1)):
            at(page, f"Question {n}")
            box = page.locator("[data-choice='a']").bounding_box()
            page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            page.mouse.down(click_count=n)
            page.mouse.up(click_count=n)
            at(page, "Question 2")
            assert len(windows.entries()) == answers
        answer(page, truthfully(page))
        assert len(windows.entries()) == 2


def test_a_button_shows_its_arrow_and_its_letter_and_a_narrow_page_no_keys(
    windows: Windows,
) -> None:
    with served(windows.log) as server:
        page = practised(windows, server)
        keys = page.locator(".pick kbd")
        assert keys.all_text_contents() == ["←", "A", "→", "B"]
        said = page.locator("#elicit-letters")
        assert said.is_visible()
        assert all(key.is_visible() for key in keys.all())
        page.set_viewport_size(NARROW)
        assert not said.is_visible()
        assert name(page, "Letter keys: on").is_visible()  # who zooms in may have a keyboard
        assert not any(key.is_visible() for key in keys.all())


def test_the_first_question_with_bars_instead_of_circles_says_why(windows: Windows) -> None:
    few, many = ((0, 10, 0), (6, 0, 4)), ((0, 100, 0), (43, 0, 57))
    questions = bags(few, many, ((0, 100, 0), (47, 0, 53)))
    with served(windows.log, questions) as server:
        page = practised(windows, server)
        for n, said in ((1, 0), (2, 1), (3, 0)):
            at(page, f"Question {n}")
            assert page.locator(".bars").count() == said
            click(page, "equal")


def test_single_letters_can_be_switched_off_and_stay_off(windows: Windows) -> None:
    with served(windows.log) as server:
        page = practised(windows, server)
        said = page.locator(".letters")  # beside the switch, not only under a pointer
        assert said.text_content() == "Letter keys: on A, B, ? and U work"
        name(page, "Letter keys: on").click()
        assert page.evaluate("document.activeElement.textContent") == "Letter keys: off"
        assert said.text_content() == "Letter keys: off only the arrow keys work"
        for key in ("a", "b", "?", "u"):
            page.keyboard.press(key)
        page.reload()
        at(page, "Question 1")
        page.keyboard.press("a")
        at(page, "Question 1")
        page.keyboard.press("ArrowLeft")
        at(page, "Question 2")
    assert len(windows.entries()) == 1


def test_a_name_and_the_minutes_are_sent_with_the_start(windows: Windows) -> None:
    words = Words("patients", levels=("Gone", "", "Well <again>"), duration="Each for a year.")
    with served(windows.log, words=words, least=1) as server:
        page = windows.open(server)
        at(page, "Welcome")
        assert "Well <again>" in page.inner_text(".legend")
        assert "Each for a year." in page.inner_text(".panel")
        page.fill("#elicit-who", "Ann")
        page.get_by_label("5 minutes").check()
        start(page)
        click(page, "a")
        at(page, "Question 1")
        answer(page, "a")
    assert AnswerLog.read(windows.log)[0].metadata["who"] == "Ann"


def test_what_was_typed_on_the_welcome_stays_there(windows: Windows) -> None:
    with served(windows.log, words=replace(WORDS, duration="Each for a year."), least=1) as server:
        page = windows.open(server)
        at(page, "Welcome")
        assert page.get_by_label("Until your values are known").is_checked()
        page.fill("#elicit-who", "Ann")
        page.get_by_label("10 minutes").check()
        for leave in (lambda: page.keyboard.press("Escape"), page.go_back):
            name(page, "What the levels mean").click()
            at(page, "What the levels mean")
            leave()
            at(page, "Welcome")
            assert page.input_value("#elicit-who") == "Ann"
            assert page.get_by_label("10 minutes").is_checked()
        start(page)
        click(page, "a")
        at(page, "Question 1")
        answer(page, "a")
    assert AnswerLog.read(windows.log)[0].metadata["who"] == "Ann"


def test_until_the_first_screen_is_there_the_page_says_that_it_takes_seconds(
    windows: Windows,
) -> None:
    held: list[Any] = []
    with served(windows.log) as server:
        page = windows.open(server)
        at(page, "Welcome")
        page.route("**/api", lambda route: held.append(route))
        page.reload()
        page.locator("h1", has_text="Getting ready").wait_for()
        assert page.inner_text(".brand") == "Your judgement"
        assert page.inner_text(".body p >> nth=0").startswith("This takes a few seconds.")
        page.unroute("**/api")
        for route in held:
            with suppress(Exception):  # the page before this one may have asked for something, too
                route.continue_()
        at(page, "Welcome")


def test_a_bar_says_what_the_answers_say_if_none_is_a_mistake(windows: Windows) -> None:
    """The whole range is then the thin bar around it."""
    labels = ("died", "critical", "moderate", "recovered")
    known = {"moderate": ([55, 65], 34, 100, 61, False), "critical": ([0, 39], 0, 39, 6, True)}
    given: list[Any] = [None]

    def api(route: Any) -> None:
        reply = route.fetch()
        screen = reply.json()
        for row in (screen.get("end") or {}).get("scale", []):
            if row["label"] in known:
                taken, low, high, value, sure = known[row["label"]]
                row.update(low=low, high=high, value=value, known=sure, rough=not sure, asked=True)
                row["given"] = taken if given[0] else None
        route.fulfill(response=reply, json=screen)

    def rows() -> list[list[str]]:
        return [
            one.locator("> *:not(.drawn)").all_inner_texts()
            for one in page.locator(".worth tbody tr").all()
        ]

    def bars(i: int) -> list[float]:
        rects = page.locator(".worth tbody tr").nth(i).locator("rect")
        return [one.bounding_box()["height"] for one in rects.all()]

    with served(windows.log, bags(((0, 0, 10, 0), (4, 0, 0, 6))), labels) as server:
        page = practised(windows, server)
        page.route("**/api", api)
        answer(page, "a")
        at(page, "Result")
        assert rows() == [
            ["recovered", "100", "fixed"],
            ["moderate", "about\u00a061", "34 to 100"],
            ["critical", "6", "0 to 39"],
            ["died", "0", "fixed"],
        ]
        assert [len(bars(i)) for i in (1, 2)] == [1, 1]
        given[0] = True
        page.reload()
        at(page, "Result")
        assert page.locator(".worth thead .meant").inner_text() == "If no answer is a mistake"
        assert rows() == [
            ["recovered", "100", "", "fixed"],
            ["moderate", "about\u00a061", "55 to 65", "34 to 100"],
            ["critical", "6", "0 to 39", "0 to 39"],
            ["died", "0", "", "fixed"],
        ]
        thin, thick = bars(1)
        assert thick >= 2 * thin
        assert len(bars(2)) == 1
        assert "Thick bar: range if no answer is a mistake." in page.inner_text(".worth caption")
        violated(page)
        page.set_viewport_size(NARROW)
        page.reload()
        at(page, "Result")
        assert rows()[1] == ["moderate", "about\u00a061", "55 to 65", "34 to 100"]
        moderate = page.locator(".worth tbody tr").nth(1)
        picture, line = (moderate.locator(one).bounding_box() for one in (".drawn", ".meant"))
        assert picture["width"] == line["width"]
        assert line["y"] > picture["y"]
        fits(page)
        violated(page)


def test_who_stops_early_sees_no_bar_and_times_of_24_hours(windows: Windows) -> None:
    with served(windows.log) as server:
        page = practised(windows, server, timezone_id="Europe/Berlin")
        before = page.locator("h1").bounding_box()["y"]
        answer(page, "a")
        name(page, "Finish now").click()
        at(page, "Result")
        assert not page.locator(".meter").is_visible()
        assert page.locator("h1").bounding_box()["y"] < before  # the room for notes is gone
        name(page, "Your answers").click()
        at(page, "Your answers")
        assert re.search(r", \d\d:\d\d GMT\+[12]$", page.inner_text(".list time"))
        name(page, "Back to the result").click()
        at(page, "Result")


def test_on_a_phone_numbers_stand_in_two_columns(windows: Windows) -> None:
    levels = ("no complaints", "limited", "needs daily care", "died")
    offered = ResultTable(
        columns=("treatment", *levels),
        rows=(("Surgery now", "70", "20", "4", "6"), ("Wait and see", "30", "36", "30", "4")),
        title="The treatments",
        of="treatment",
    )
    shown = replace(
        offered,
        columns=(*offered.columns, "worth", "range", "behind"),
        rows=tuple((*row, "86", "81 to 93", "0") for row in offered.rows),
        marked=0,
        mark="chosen",
        unfolded=True,
    )
    concluded = Conclusion(headline="Surgery now is best.", changes=shown, settled=True)
    parts = {"offered": offered, "conclude": lambda *_: concluded}

    def places() -> list[tuple[int, int]]:
        boxes = [one.bounding_box() for one in page.locator(".changes tr >> nth=1 >> td").all()]
        columns = sorted({box["x"] for box in boxes})
        lines = sorted({box["y"] for box in boxes})
        return [(lines.index(box["y"]), columns.index(box["x"])) for box in boxes]

    with served(windows.log, QUESTIONS[:1], **parts) as server:
        page = windows.open(server, NARROW)
        at(page, "Welcome")
        page.click("text=Show the 2 treatments")
        assert places() == [(0, 0), (0, 1), (1, 0), (1, 1)]
        practise(page)
        click(page, truthfully(page))
        at(page, "Result")
        page.locator(".fold > summary", has_text="The treatments").click()
        assert places() == [(i // 2, i % 2) for i in range(7)]
        heads = page.locator(".changes .chosen td")
        assert heads.evaluate_all("all => all.every((one) => one.offsetHeight < 30)")
        fits(page)


def test_a_long_table_of_changes_is_folded_and_filtered(windows: Windows) -> None:
    rows = tuple((f"state {i}", "old", f"new {i % 7}") for i in range(40))
    table = ResultTable(
        "In 40 of 99 states your answers change the plan",
        ("State", "A", "B"),
        rows,
        open=ResultTable(
            "Still open in 1 of 99 states",
            ("State", "A", "By the best guess so far"),
            (("state 98", "old", "perhaps"),),
            "Your answers do not decide it.",
            "open state",
        ),
    )
    table = replace(table, marked=2, mark="best")
    concluded = Conclusion(
        headline="Your plan is settled.", reason="By 3.", changes=table, settled=True
    )
    with served(windows.log, QUESTIONS[:1], conclude=lambda *_: concluded) as server:
        page = practised(windows, server)
        click(page, truthfully(page))
        at(page, "Result")
        assert page.inner_text("h1") == "Your plan is settled."
        assert page.inner_text(".reason") == "By 3."
        assert not page.is_visible(".changes")
        page.click("text=Show the 40 states")
        page.get_by_text("Hide the 40 states").wait_for()
        assert page.locator(".chosen").inner_text().split() == [
            "state",
            "2",
            "best",
            "old",
            "new",
            "2",
        ]
        page.fill("#elicit-filter", "new 3")
        assert page.inner_text(".filter p") == "6 of 40 shown"
        assert page.locator(".changes tbody tr:visible").count() == 6
        page.click("text=Show the open state")
        assert "Your answers do not decide it." in page.inner_text("details[open] >> nth=1")
        assert page.locator(".changes tbody tr:visible").last.inner_text().split() == [
            *("state", "98", "old", "perhaps")
        ]
        violated(page)


@pytest.mark.parametrize("size", [WIDE, NARROW])
def test_whoever_wanted_the_values_sees_them_before_what_follows(
    windows: Windows, size: dict[str, int]
) -> None:
    concluded = Conclusion(headline="Your plan is settled.", settled=True, sure="With 95%.")
    with served(windows.log, conclude=lambda *_: concluded) as server:
        server._interview.handle({"do": "start", "until": "values"})
        page = practised(windows, server, size, [1])
        name(page, "Finish now").click()
        at(page, "Result")
        assert page.locator("h1").inner_text().startswith("Your values, from 0 to\u00a0100: ")
        follows = "You stopped early. Your plan is settled."
        tops = [
            page.locator(which).first.bounding_box()["y"]
            for which in ("h1", ".status", ".worth", f"h2:text-is('{follows}')", ".facts")
        ]
        assert tops == sorted(tops)
        violated(page)
        fits(page)


def test_on_a_phone_the_first_two_screens_of_a_result_say_all_that_matters(
    windows: Windows,
) -> None:
    rows = tuple((f"state {i}", "old", f"new {i % 7}") for i in range(4))
    table = ResultTable("In 4 of 99 states your answers change the plan", ("State", "A", "B"), rows)
    concluded = Conclusion(
        headline="Your plan is settled.",
        reason="By 3.",
        changes=table,
        settled=True,
        size="At most 1.",
        sure="With 95% probability.",
        before="It was 4.",
        next="You can stop here.",
    )
    labels = ("died", "critical", "severe", "moderate", "mild", "recovered")
    questions = bags(((0, 0, 0, 10, 0, 0), (5, 0, 0, 0, 0, 5)))
    with served(windows.log, questions, labels, conclude=lambda *_: concluded) as server:
        page = practised(windows, server, NARROW)
        click(page, "a")
        at(page, "Result")
        assert page.locator(".facts:visible dt").all_inner_texts() == [
            "Your values, from 0 to 100",
            "How sure",
            "How close",
            "Next",
        ]
        tops = [
            page.get_by_text(words, exact=True).first.bounding_box()["y"]
            for words in (
                "Your plan is settled.",
                "By 3.",
                "With 95% probability.",
                "You can stop here.",
                "What the levels are worth to you",
                *("died", table.title, "What else follows", "Your answers and their checks"),
                *("Downloads",),
            )
        ]
        assert tops == sorted(tops)
        assert tops[5] < 2 * NARROW["height"]
        assert page.evaluate("document.documentElement.scrollHeight") < 2 * NARROW["height"]
        assert not page.locator("details[open]").count()
        assert not page.get_by_text("It was 4.").is_visible()
        violated(page)
        for summary in page.locator(".fold > summary").all():
            summary.click()
        assert page.get_by_text("It was 4.").is_visible()
        assert name(page, "Answers as CSV").is_visible()
        violated(page)
        fits(page)
        page.set_viewport_size(WIDE)
        page.reload()
        at(page, "Result")
        assert not page.locator(".fold").count()
        assert name(page, "Answers as CSV").is_visible()


@pytest.mark.parametrize("of", [10, 50])
def test_on_a_phone_all_answers_to_ten_circles_are_in_the_window(windows: Windows, of: int) -> None:
    """Whatever came before."""
    labels = ("died", "needs daily care", "limited", "no complaints")
    first = (0, of, 0, 0), (of // 5, 0, 0, of - of // 5)
    later = (3, 2, 4, 1), (1, 3, 3, 3)
    words = replace(WORDS, duration="Each patient stays in the condition shown for five years.")
    with served(windows.log, bags(first, later), labels, words) as server:
        page = practised(windows, server, NARROW)
        click(page, "a")
        at(page, "Question 2")
        assert page.locator(".card").first.locator(".row").count() == 4
        answers = page.locator("[data-choice]").all()
        assert len(answers) == 4
        boxes = [one.bounding_box() for one in answers]
        assert max(box["y"] + box["height"] for box in boxes) <= NARROW["height"]


def test_an_offer_leads_back_to_itself_and_an_early_end_has_no_bar(windows: Windows) -> None:
    with served(windows.log, least=7) as server:
        page = practised(windows, server, NARROW)
        for _ in range(3):
            answer(page, "cannot tell")
        stage(page, "offer")
        assert {
            button.evaluate("one => getComputedStyle(one).textAlign")
            for button in page.locator(".body button").all()
        } == {"left"}
        name(page, "Your answers").click()
        at(page, "Your answers")
        when = page.locator("time").first.inner_text()
        assert re.fullmatch(r"\w+ \d+, \d{4}, ([01]\d|2[0-3]):[0-5]\d \S+", when)
        name(page, "Back").click()
        stage(page, "offer")
        name(page, "Finish now and show the result").click()
        stage(page, "end")
        assert not page.locator(".meter").is_visible()


def test_why_is_at_every_question_also_where_the_note_above_says_it(windows: Windows) -> None:
    note = "This is the same question again, because you took back your answer to it."

    def outlook(route: Any) -> None:
        message = route.request.post_data_json
        if message["do"] != "outlook":
            route.continue_()
        else:
            reply = {"id": message["id"], "why": [note], "to_come": None, "ready": True}
            route.fulfill(json=reply)

    with served(windows.log) as server:
        page = windows.open(server)
        page.route("**/api", outlook)
        practise(page)
        click(page, "a")
        at(page, "Question 2")
        page.click("summary")
        page.get_by_text(note).wait_for()  # no note says it
        page.keyboard.press("u")
        at(page, "Question 1")
        page.click("summary")
        page.get_by_text("The note above the question says why.").wait_for()
        assert page.get_by_text(note).count() == 1
