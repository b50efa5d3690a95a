"""Questions and waiting times of a person in sessions of ICU-Sepsis: RESULTS-sessions.md.

    python -m benchmarks.asking.person_sessions --out benchmarks/RESULTS-sessions.md
        # an hour
    python -m benchmarks.asking.person_sessions --scales 1 --browser ""
        # without the browser; rough

Scripted persons with hidden scales answer what ``elicit.Interview`` shows, by the counts that are
shown. The waiting is measured in a browser (``--browser``: its program; Playwright drives it) in
front of ``qlearn teach --web``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.reporting import machine, markdown, publish, with_interval
from elicit import AnswerLog, Interview, Session
from elicit.model.scale import Floats
from elicit.person.course.counts import Counts
from qlearn import equal_gaps_policy, icu_sepsis, policy_loss, unasked_loss
from qlearn.cli.teach_subjects import taught_by
from qlearn.mdp.planning import Actions

PROBLEM, DAYS, READING = "icu-sepsis", 10, 1.0  # seconds of reading
Person = Callable[[dict[str, Any]], str]


class Setting(NamedTuple):
    """A comparator, its tolerance, and a person who turns so many answers round, and calls so much
    equal.
    """

    comparator: str
    tolerance: float
    flips: float = 0.0
    tie: float = 0.0


class Run(NamedTuple):
    """The result of a session.

    It has the number of answers, how many of them are to repeated questions, the bound that is
    stated and its confidence, the loss, and the loss of asking nothing.
    """

    answered: int
    repeated: int
    bound: float
    confidence: float
    loss: float
    unasked: float


SETTINGS = (
    Setting("polytope", 0.01),
    Setting("polytope", 0.001),
    Setting("polytope", 0.01, tie=0.01),
    Setting("polytope", 0.001, tie=0.01),
    Setting("posterior", 0.01, flips=0.1),
    Setting("posterior", 0.01, tie=0.01),
)
IN_BROWSER = (
    Setting("polytope", 0.01),
    Setting("polytope", 0.001),
    Setting("posterior", 0.01, flips=0.1),
)
HEAD = (
    "comparator",
    "tolerance",
    "flipped",
    "equal within",
    "runs",
    "asked nothing",
    "questions",
    "of them new",
    "least",
    "median",
    "most",
)
_GOES_ON = {  # the button of each other stage
    "welcome": ".form .pick",
    "conflict": "[data-keep]",
    "offer": ".options .alt:has-text('Go on')",
}
HEAD_END = ("bound, at most", "loss, at most", "bound violated")
WAITS = (
    "comparator",
    "tolerance",
    "flipped",
    "address s",
    "first question s",
    "questions",
    "median ms",
)
WAITS_END = ("95% ms", "most ms")


def scale(k: int, number: int) -> Floats:
    """A hidden scale (k,): uniform spacings."""
    inside = np.sort(np.random.default_rng(1000 + number).random(k - 2))
    return np.concatenate([[0.0], inside, [1.0]])


def person(values: Floats, setting: Setting, number: int) -> Person:
    """Return a person who answers a question as it is drawn: "a", "b" or "equal"."""
    rng = np.random.default_rng([number, 7])

    def says(question: dict[str, Any]) -> str:
        apart = (
            sum((row["a"] - row["b"]) * values[row["level"]] for row in question["rows"])
            / question["of"]
        )
        if abs(apart) <= max(setting.tie, 1e-12):
            return "equal"
        return "a" if (apart > 0) != (rng.random() < setting.flips) else "b"

    return says


def _reply(screen: dict[str, Any], says: Person) -> dict[str, str]:
    """Return the message with which the simulated person replies to a screen.

    They answer each question, keep their first answer in a conflict, and go on if offered to stop.
    """
    if screen["stage"] == "conflict":
        found = screen["conflict"]
        return {"do": "settle", "id": found["id"], "choice": found["choices"][0]["choice"]}
    if screen["stage"] == "offer":
        return {"do": "choose", "option": "on"}
    question = screen["question"]
    return {"do": "answer", "id": question["id"], "choice": says(question)}


def session(setting: Setting, number: int) -> Run:
    """One session, answered without waiting for what is computed beside."""
    mdp = icu_sepsis()
    values = scale(mdp.k, number)
    says = person(values, setting, number)
    taught = taught_by(PROBLEM, setting.comparator, DAYS, None, 0, setting.tolerance)
    with Session(taught.make, AnswerLog()) as one, Interview(one, taught.subject) as interview:
        screen = interview.handle({"do": "practised", "choice": "a"})
        while screen["stage"] != "end":
            screen = interview.handle(_reply(screen, says))
        result = one.result()
    loss = float(policy_loss(mdp, result.policy, values).max())
    unasked = unasked_loss(mdp, values, _equal_gaps()).worst
    repeated = Counts.of(one.log).repeated
    return Run(screen["answered"], repeated, result.loss_bound, result.confidence, loss, unasked)


@cache
def _equal_gaps() -> Actions:
    """Return the policy of somebody who asks nobody."""
    return equal_gaps_policy(icu_sepsis())


def row_of(setting: Setting, runs: list[Run]) -> list[str]:
    """A line of the table of questions."""
    asked = [run.answered for run in runs]
    broken = sum(run.loss > run.bound + 1e-9 for run in runs)
    return [
        *_named(setting)[:3],
        f"{setting.tie:g}",
        f"{len(runs)}",
        with_interval([run.unasked for run in runs], 4),
        with_interval(asked, 1),
        with_interval([run.answered - run.repeated for run in runs], 1),
        f"{min(asked)}",
        f"{np.median(asked):g}",
        f"{max(asked)}",
        f"{max(run.bound for run in runs):.4f}",
        f"{max(run.loss for run in runs):.4f}",
        f"{broken} of {len(runs)}",
    ]


def waits(setting: Setting, browser: str, folder: Path) -> list[str]:
    """A line of the table of waiting: a session in a browser, by the keyboard."""
    from playwright.sync_api import sync_playwright

    says = person(scale(icu_sepsis().k, 0), setting, 0)
    options = [
        "--comparator",
        setting.comparator,
        "--tolerance",
        f"{setting.tolerance:g}",
        "--log",
        "answers.jsonl",
    ]
    begun = time.monotonic()
    command = [sys.executable, "-m", "qlearn", "teach", "--web", *options]
    server = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert server.stdout is not None
    address, printed = server.stdout.readline().strip(), time.monotonic()
    try:
        with sync_playwright() as playwright:
            window = playwright.chromium.launch(
                executable_path=browser, args=["--no-sandbox", "--disable-gpu"]
            )
            page, screens = window.new_page(), []

            def seen(reply: Any) -> None:
                if reply.url.endswith("/api") and "stage" in (screen := reply.json()):
                    screens.append(screen)

            page.on("response", seen)
            page.goto(address)
            page.wait_for_selector(".pick")
            opened, each = time.monotonic(), []
            while (screen := screens[-1])["stage"] != "end":
                page.wait_for_timeout(1000 * READING)
                now, before = time.monotonic(), _place(screen)
                if screen["stage"] in ("practice", "question"):
                    key = {"a": "a", "b": "b", "equal": "ArrowDown"}[says(screen["question"])]
                    page.keyboard.press(key)
                else:
                    page.locator(_GOES_ON[screen["stage"]]).first.click()
                while _place(screens[-1]) == before:
                    page.wait_for_timeout(4)
                if screens[-1]["stage"] == "question":
                    each.append(1000 * (time.monotonic() - now))
            page.remove_listener("response", seen)
            window.close()
    finally:
        server.kill()
        server.wait()
    waited = [f"{x:.0f}" for x in np.quantile(each, [0.5, 0.95, 1.0])]
    return [
        *_named(setting)[:3],
        f"{printed - begun:.1f}",
        f"{opened - printed:.1f}",
        f"{len(each)}",
        *waited,
    ]


def report(scales: int, browser: str) -> Iterator[list[str]]:
    """The parts of the page."""
    yield ["# Sessions of a person", "", machine()]
    yield [
        "ICU-Sepsis, bags of 10 patients. A session goes on until the plan is settled. Hidden "
        "scales with uniform spacings, one a run. Questions: all that the person answers, mean "
        "with its 95% interval; how many of them are *new*, not put again to check an answer; "
        "least, median, most. *Asked nothing*: loss of the policy that is best if all gaps between "
        "levels are equal, mean. Bound and losses are shares of the value range, from all died to "
        "all recovered."
    ]
    rows = (
        row_of(setting, [session(setting, number) for number in range(scales)])
        for setting in SETTINGS
    )
    yield markdown([*HEAD, *HEAD_END], rows, 1)
    if browser:
        yield [
            "## Waiting",
            "",
            "In a browser (headless Chromium), from a key to the next question, by a person who "
            f"reads {READING:g} s. They are asked as the welcome screen proposes: until the values "
            "of the levels are known, which takes more questions than above. Address: from the "
            "command to the printed address; first question: from there.",
        ]
        with tempfile.TemporaryDirectory() as folder:
            places = [Path(folder) / str(i) for i in range(len(IN_BROWSER))]
            for place in places:
                place.mkdir()
            rows = (
                waits(setting, browser, place)
                for setting, place in zip(IN_BROWSER, places, strict=True)
            )
            yield markdown([*WAITS, *WAITS_END], rows, 1)


def _named(setting: Setting) -> list[str]:
    return [setting.comparator, f"{setting.tolerance:g}", f"{setting.flips:.0%}"]


def _place(screen: dict[str, Any]) -> tuple[str, str | None, int]:
    """Return what differs between a screen and the next one.

    The number of answers is part of it, since one answer may be in two conflicts in a row.
    """
    put = screen["question"] or screen["conflict"]
    return screen["stage"], put and put["id"], screen["answered"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--scales", type=int, default=50, help="hidden scales a setting [%(default)s]"
    )
    parser.add_argument(
        "--browser", default="/usr/bin/chromium-headless-shell", help="its program, or '' for none"
    )
    parser.add_argument("--out", type=Path, help="the page to write")
    given = parser.parse_args()
    publish(report(given.scales, given.browser), given.out, f"0-{given.scales - 1}")


if __name__ == "__main__":
    main()
