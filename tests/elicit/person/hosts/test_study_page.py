"""The pages of a study in a real browser: who runs it, and one who answers."""

from typing import Any

import pytest

from elicit import AnswerLog, Session, Subject
from elicit.person.hosts.study_web import StudyServer
from elicit.person.study.study import Study
from tests.browser_cases import LABELS, QUESTIONS, WORDS, Listed, browser


def opened(chromium: Any, address: str, complaints: list[str], **how: Any) -> Any:
    page = chromium.new_context(**how).new_page()
    page.set_default_timeout(10_000)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(address)
    page.wait_for_selector("h1")
    return page


@pytest.mark.slow
def test_links_answers_and_the_end_as_they_are_seen() -> None:
    complaints: list[str] = []
    sessions = {
        who: Session(lambda known: Listed(QUESTIONS, known), AnswerLog(k=3, who=who), who=who)
        for who in ("ann", "ben")
    }
    with (
        browser() as chromium,
        Study(sessions, Subject(LABELS, WORDS, least=0), "qlearn report ...") as study,
        StudyServer(study) as server,
    ):
        narrow = {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark"}
        runner = opened(chromium, server.new_address(), complaints, **narrow)
        runner.get_by_role("button", name="New link for ann").click()
        runner.get_by_text("There is a new link for ann.").wait_for()
        links = [field.input_value() for field in runner.locator("input").all()]
        assert links == [*server.links().values()]
        ann = opened(chromium, links[0], complaints)
        assert "Whoever runs it sees your answers" in ann.inner_text(".body")
        ann.get_by_role("button", name="Start", exact=True).click()
        for at in ("Practice", "Question 1"):
            ann.locator(".place b", has_text=at).wait_for()
            ann.wait_for_selector(".sheet:not([aria-busy]) .pick:enabled")
            ann.click("[data-choice='a']")
        ann.get_by_text("1 answer saved for the study").wait_for()
        runner.locator(".person", has_text="ann").get_by_text("1 answer", exact=True).wait_for()
        assert runner.evaluate("document.documentElement.scrollWidth") <= 390
        runner.get_by_role("button", name="End the study").click()
        runner.get_by_role("button", name="Keep it open").click()
        assert not study.ended
        runner.get_by_role("button", name="End the study").click()
        runner.get_by_role("button", name="End the study now").click()
        runner.get_by_role("heading", name="The study has ended").wait_for()
        assert study.ended
        ann.wait_for_selector(".sheet:not([aria-busy]) .pick:enabled")
        ann.click("[data-choice='a']")
        ann.get_by_text("The study has ended, so no more answers are taken").wait_for()
        assert len(sessions["ann"].log) == 1
    assert not complaints
