"""Interviews with scripted persons come to an end, say why, and claim only what holds."""

from __future__ import annotations

import json
import random
import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import AnswerLog, Bags, Interview, Session
from elicit.model.outcomes import Status
from elicit.person.course.conduct import ORDER
from elicit.person.course.offers import NEARLY_FROM
from elicit.person.outlook import Prospects
from qlearn import (
    equal_gaps_policy,
    evaluate_policy,
    expected_bounds,
    policy_loss,
    random_mdp,
)
from qlearn.cli.teach_subjects import Taught, taught_by
from qlearn.cli.teach_terminal import report_lines
from tests.thoroughness import quick_first, scaled, thorough

MDP = random_mdp(30, 3, 5, 0.9, seed=0)[0]
Says = Callable[[dict[str, Any]], str]
MOST = 25  # questions after which an end must have come
ALIKE = ("a", "b", "equal", "cannot tell")


def taught(comparator: str = "polytope", tolerance: float = 0.01) -> Taught:
    return taught_by("random", comparator, 10, None, 0, tolerance)


def truthful(values: Any, errors: float = 0.0, seed: int = 0) -> Says:
    """One who answers by these values, but errs in this share of the questions."""
    chance = random.Random(seed)

    def says(question: dict[str, Any]) -> str:
        apart = sum(values[row["level"]] * (row["a"] - row["b"]) for row in question["rows"])
        if abs(apart) < 1e-9:
            return "equal"
        return "a" if (apart > 0) != (chance.random() < errors) else "b"

    return says


class Person:
    """A person in an interview: ``says`` answers a question, ``settle`` and ``option`` the others.

    ``offers`` gets the headings of offers.
    """

    def __init__(
        self,
        interview: Interview,
        says: Says,
        settle: int = 0,
        option: str = "on",
        offers: list[str] | None = None,
    ):
        self.interview, self.says, self.settle, self.option = interview, says, settle, option
        self.offers: list[str] = [] if offers is None else offers
        self.stages: list[str] = []
        self.screen = interview.handle({"do": "state"})

    def step(self) -> None:
        """Answer the present screen."""
        screen, handle = self.screen, self.interview.handle
        self.stages.append(screen["stage"])
        match screen["stage"]:
            case "welcome":
                self.screen = handle({"do": "start"})
            case "practice":
                self.screen = handle({"do": "practised", "choice": "a"})
            case "conflict":
                found = screen["conflict"]
                choice = found["choices"][self.settle]["choice"]
                self.screen = handle({"do": "settle", "id": found["id"], "choice": choice})
            case "offer":
                self.offers.append(screen["offer"]["heading"])
                self.screen = handle({"do": "choose", "option": self.option})
            case "question":
                question = screen["question"]
                told = {"id": question["id"], "choice": self.says(question)}
                self.screen = handle({"do": "answer", **told})

    def until(self, stage: str, questions: int = 100) -> dict[str, Any]:
        """Answer until this stage, or after so many questions; the screen then."""
        while self.screen["stage"] != stage and self.stages.count("question") < questions:
            self.step()
        return self.screen


def interviewed(says: Says, log: AnswerLog | None = None, until: str = "", **how: Any) -> Any:
    """The screen at the end of an interview, and the stages on the way there.

    With ``until`` the person wants the values, too.
    """
    told = taught("posterior" if until else "polytope")
    with (
        Session(told.make, log if log is not None else AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, says, **how)
        person.screen = interview.handle({"do": "start", "until": until})
        person.until("end", MOST)
        while person.screen["stage"] == "conflict":  # which the last answer may have made
            person.step()
        return person.screen, person.stages


@pytest.mark.parametrize("until", ["", "values"])
@pytest.mark.parametrize("choice", ALIKE)
def test_one_who_always_says_the_same_gets_an_end_that_says_so(choice: str, until: str) -> None:
    screen, stages = interviewed(lambda _: choice, until=until)
    assert screen["stage"] == "end"
    assert stages.count("question") <= MOST
    assert screen["end"]["caution"]
    assert screen["end"]["certainty"].endswith(", if every answer is meant as it was given")
    if changes := screen["end"]["changes"]:
        assert changes["note"].startswith("This holds only if every answer is meant")
    assert not screen["end"]["settled"]
    assert "settled" not in screen["end"]["headline"] or "not" in screen["end"]["headline"]


def test_most_who_answer_by_chance_get_an_end_that_says_so() -> None:
    said, seeds = 0, range(*scaled((2, 4), (0, 40)))
    for seed in seeds:
        chance = random.Random(seed)
        choices = ("a", "b") if seed % 2 else ALIKE
        screen, _ = interviewed(lambda _, chance=chance, of=choices: chance.choice(of))  # type: ignore[misc]
        assert screen["stage"] == "end"
        end = screen["end"]
        said += end["caution"] is not None
        # who passes all checks by chance cannot be told from one who means it
        assert "Guessing would do as well in " in end["by_chance"]
        if end["caution"] is None and end["settled"]:
            cases = int(re.search(r"in 1 of (\d+) interviews", end["by_chance"])[1])
            assert cases >= 25
    assert said >= 0.85 * len(seeds)


def test_a_truthful_person_is_told_nothing_of_the_kind() -> None:
    for seed in range(scaled(1, 3)):
        values = np.sort(np.random.default_rng(seed).random(5))
        offers: list[str] = []
        screen, stages = interviewed(truthful(values), offers=offers)
        assert screen["end"]["caution"] is None
        assert screen["end"]["settled"]
        assert "conflict" not in stages
        assert all(
            re.fullmatch(r"Your plan falls at most [\d.]+ in 100 short of your ideal plan", offer)
            for offer in offers
        )
        counts = screen["end"]["counts"]
        assert counts["answered"] - counts["cannot tell"] >= 5
        assert counts["repeated"] == counts["alike"] >= 1


def plausible(session: Session, n: int) -> Any:
    """Scales (m, k) that fit all answers of a session, from many drawn at random."""
    chance = np.random.default_rng(1)
    inside = np.sort(chance.dirichlet(np.full(4, 0.5), 60 * n).cumsum(axis=1)[:, :-1], axis=1)
    scales = np.hstack([np.zeros((len(inside), 1)), inside, np.ones((len(inside), 1))])
    fits = np.ones(len(scales), bool)
    for entry in session.log:
        worth, verdict = scales @ entry.answer.query.d, entry.answer.verdict
        if entry.used and verdict is not None:
            fits &= np.abs(worth) <= 0.01 if verdict == 0 else verdict * worth >= 0
    return scales[fits][:n]


@pytest.mark.parametrize("answers", [0, 1, 2])
@pytest.mark.parametrize("seed", quick_first(range(4), 1))
def test_after_few_answers_only_what_holds_for_every_plausible_scale_is_claimed(
    answers: int, seed: int
) -> None:
    told, values = taught(), np.sort(np.random.default_rng(seed).random(5))
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, truthful(values))
        person.until("question")
        for _ in range(answers):
            person.step()
        end = interview.handle({"do": "finish"})["end"]
        assert not end["settled"]
        scales = plausible(session, scaled(60, 400))
        assert len(scales) > 20
        bound = re.search(
            r"So far your plan comes within ([\d.]+) in 100 of your ideal plan\.", end["headline"]
        )
        assert (bound is None) == (answers == 0)
        plan = np.array([int(row["action"]) for row in interview.table("plan")])
        if bound:
            lost = max(policy_loss(MDP, plan, scale).max() for scale in scales)
            assert lost <= float(bound[1]) / 100
        equal = equal_gaps_policy(MDP)
        gained = (evaluate_policy(MDP, plan) - evaluate_policy(MDP, equal)) @ scales.T
        assert gained.min() >= -1e-9  # where nothing is decided it is the plan for equal steps
        for row, values_of in zip(reversed(end["scale"]), 100 * scales.T, strict=True):
            assert row["low"] <= values_of.min() + 1e-9
            assert values_of.max() - 1e-9 <= row["high"]
        asked = {level for e in session.log for level in np.flatnonzero(e.answer.query.d)} | {0, 4}
        assert [row["asked"] for row in reversed(end["scale"])] == [i in asked for i in range(5)]
        if answers == 0:
            assert "nothing is known about your values" in end["headline"].lower()
            assert end["changes"] is None
            assert not end["sure"]
        names = {MDP.state_name(s): s for s in range(MDP.n_states)}
        listed = end["changes"]["rows"] if end["changes"] else []
        q = action_values(plan)
        for state, other, mine, *_ in listed:
            s, (a, b) = names[state], (int(mine), int(other))
            assert plan[s] == a
            assert (((q[s, a] - q[s, b]) @ scales.T) > 0).all()
        table = {row["state"]: row["change"] for row in interview.table("plan")}
        certain = [state for state, change in table.items() if change == "certain"]
        assert certain == [row[0] for row in listed]
        unknown = [row["value"] is None for row in interview.table("scale")]
        assert unknown == [not (row["known"] or row["rough"]) for row in end["scale"]]


def action_values(plan: Any) -> Any:
    """The vector values (S, A, k) of each action of the MDP, before a plan."""
    after = (MDP.transitions @ evaluate_policy(MDP, plan)).reshape(*MDP.levels.shape, MDP.k)
    return (1 - MDP.discount) * np.eye(MDP.k)[MDP.levels] + MDP.discount * after


@pytest.mark.slow
def test_with_a_posterior_changes_are_listed_if_they_hold_with_its_confidence() -> None:
    told, listed = taught("posterior"), 0
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        Person(interview, truthful(np.array([0, 0.02, 0.1, 0.9, 1.0]))).until("end", MOST)
        end = interview.handle({"do": "finish"})["end"]
        result = session.result()
        names = {MDP.state_name(s): s for s in range(MDP.n_states)}
        q = action_values(np.array([int(row["action"]) for row in interview.table("plan")]))
        for state, other, mine, *_ in end["changes"]["rows"]:
            s, (a, b) = names[state], (int(mine), int(other))
            d = (q[s, a] - q[s, b])[None, :]
            assert result.comparator.probability(d)[0] >= 0.95 - 1e-9
            listed += 1
        assert listed
        assert end["sure"].startswith("With 95% probability, your plan falls at most ")
        assert "short of your ideal plan, the one for your exact values." in end["sure"]
        assert "for your exact values. That is as much as if " in end["sure"]


def test_where_nothing_is_at_stake_nothing_is_asked_and_that_is_said() -> None:
    told = taught(tolerance=0.9)
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        screen = interview.handle({"do": "state"})
        assert screen["stage"] == "end"
        assert screen["end"]["headline"].startswith("Your plan is settled")
        assert screen["end"]["before"].startswith("Without your answers, a loss of up to ")
        assert screen["end"]["caution"] is None
        screen = interview.handle({"do": "more"})  # who wants to can answer all the same
        assert screen["stage"] == "question"


def test_another_answer_to_the_same_question_is_brought_up_at_once_and_learned() -> None:
    values = np.array([0, 0.2, 0.45, 0.7, 1.0])
    for settle, meant in ((0, "first"), (1, "second"), (2, "equal"), (3, "cannot tell")):
        told, log = taught(), AnswerLog()
        with (
            Session(told.make, log, audit=0.1) as session,
            Interview(session, told.subject) as interview,
        ):
            person = Person(interview, truthful(values), settle=settle)
            while person.screen["stage"] != "question" or not session.is_repeat(
                person.screen["question"]["id"]
            ):
                person.step()
            question = person.screen["question"]
            other = {"a": "b", "b": "a"}[person.says(question)]
            told_other = {"do": "answer", "id": question["id"], "choice": other}
            person.screen = interview.handle(told_other)
            assert person.screen["stage"] == "conflict"
            assert interview.handle({"do": "state"}) == {**person.screen, "note": None}
            assert [one["name"] for one in person.screen["conflict"]["answers"]] == [
                "Before",
                "Now",
            ]
            first = next(e for e in log if e.answer.query.id == question["id"][: -len(" again")])
            again = log[-1].answer.verdict
            person.step()
            assert person.stages[-1] == "conflict"
            assert person.screen["stage"] != "conflict"
            stands = {
                e.answer.query.id.removeprefix("settled/"): e.answer.verdict
                for e in log
                if not e.retracted
            }
            expected = {"first": first.answer.verdict, "second": again, "equal": 0}.get(meant)
            assert stands[first.answer.query.id] == expected
            assert session.status().repeated - session.status().alike == 1
            known = dict(zip(session.result().answers.ids, session.result().answers.y, strict=True))
            ids = [first.answer.query.id, f"settled/{first.answer.query.id}"]
            assert [known[id_] for id_ in ids if id_ in known] == (
                [] if expected is None else [expected]
            )
            with Session(told.make, log, audit=0.1) as resumed:
                assert resumed.status() == session.status()


def test_an_answer_against_the_order_of_the_levels_is_brought_up_at_once() -> None:
    told, log = taught(), AnswerLog()
    honest = truthful(np.array([0, 0.2, 0.45, 0.7, 1.0]))

    def says(question: dict[str, Any]) -> str:
        choice = honest(question)
        return {"a": "b", "b": "a"}[choice] if question["id"].startswith(ORDER) else choice

    with (
        Session(told.make, log, audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        screen = Person(interview, says).until("conflict", MOST)
        assert screen["conflict"]["heading"].startswith("This answer goes against the order")
        assert screen["open_conflicts"] == 1
        told_later = {"do": "settle", "id": screen["conflict"]["id"], "choice": "later"}
        screen = interview.handle(told_later)
        assert screen["stage"] == "question"
        assert screen["note"].startswith("Nothing was changed.")


def test_after_three_cannot_tell_there_is_an_offer_and_another_kind_of_question() -> None:
    told, log = taught(), AnswerLog()
    with (
        Session(told.make, log, audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, lambda _: "cannot tell", option="other")
        screen = person.until("offer", MOST)
        assert [option["option"] for option in screen["offer"]["options"]] == [
            "other",
            "on",
            "pause",
            "finish",
        ]
        assert person.stages.count("question") == 3
        assert interview.handle({"do": "state"}) == {**screen, "note": None}
        person.step()
        assert person.screen["question"]["id"].startswith("level/")
        end = interview.handle({"do": "finish"})["end"]
        assert end["more"]
        assert interview.handle({"do": "more"})["stage"] == "question"
        with pytest.raises(ValueError, match="option must be"):
            interview.handle({"do": "choose", "option": "x"})


def test_a_budget_is_said_once_and_the_person_can_go_on() -> None:
    told = taught()
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        assert re.fullmatch(
            r"Without your answers, the program may choose wrongly for you. That costs at most as "
            r"much as if [\d.]+ in 100 \w+ "
            r"were at “.*” instead of “.*”\.",
            interview.handle({"do": "state"})["welcome"]["before"],
        )
        interview.handle({"do": "start", "who": "  Ann\x1b ", "budget": "3"})
        person = Person(interview, truthful(np.array([0, 0.2, 0.45, 0.7, 1.0])))
        screen = person.until("offer", MOST)
        assert screen["answered"] == 3
        assert screen["offer"]["heading"].startswith("You planned 3 questions")
        person.step()
        assert person.until("end", MOST)["end"]["settled"]
        assert person.stages.count("offer") == 1
        assert session.who == "Ann "
        html = interview.handle({"do": "report"})["html"]
        for said in (
            "Ann",
            "polytope",
            "Tolerance",
            "1 in 100",
            "Seed",
            "elicit-qlearn",
            "Answers of",
        ):
            assert said in html


def test_what_could_be_lost_before_the_first_answer_is_read_from_the_log(tmp_path: Any) -> None:
    path, ends = tmp_path / "log.jsonl", []
    for program in range(2):
        told, made = taught(), []

        def make(known: Any, told: Taught = told, made: list[int] = made) -> Any:
            made.append(len(known))
            return told.make(known)

        with (
            Session(make, path, audit=0.1) as session,
            Interview(session, told.subject) as interview,
        ):
            if not program:
                Person(interview, truthful(np.array([0, 0.2, 0.45, 0.7, 1.0]))).until("question")
            ends.append(interview.handle({"do": "finish"})["end"])
            assert made == [0]  # no second asker for what was known before the first answer
    assert ends[0] == ends[1]
    assert ends[0]["before"].startswith("Without your answers")


def test_who_stops_early_is_not_told_that_the_plan_is_settled() -> None:
    told = taught(tolerance=0.1)
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, truthful(np.array([0, 0.2, 0.45, 0.7, 1.0])))
        while person.screen["stage"] != "question" or not (
            told.subject.conclude(session.result(), None).settled
        ):
            person.step()
        end = interview.handle({"do": "finish"})["end"]
        assert not end["settled"]
        assert not end["finished"]
        assert "settled" not in end["headline"]
        assert "not checked yet" in end["headline"]


def test_after_the_end_more_is_asked_and_who_takes_answers_back_hears_if_it_is_settled() -> None:
    told, log = taught(tolerance=scaled(0.05, 0.01)), AnswerLog()
    with (
        Session(told.make, log, audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, truthful(np.array([0, 0.23, 0.48, 0.71, 1.0])))
        before = person.until("end")["end"]
        assert before["more"]
        after = before
        while after["more"]:  # until no range is wide, and then as far as questions tell
            person.screen = interview.handle({"do": "more"})
            after = person.until("end")["end"]

        def widths(end: dict[str, Any]) -> float:
            return sum(float(row["high"] - row["low"]) for row in end["scale"])

        assert after["counts"]["repeated"] > before["counts"]["repeated"]  # these are checked, too
        assert before["settled"]
        assert widths(after) < widths(before)
        assert after["settled"]
        assert not after["more"]
        for _ in range(2):  # with a question on the screen, before and after the second one
            last = session.log.standing[-1].answer.query.id
            screen = interview.handle({"do": "undo", "id": last})
            assert screen["question"]
            assert "The result is still settled" in screen["note"]
            assert interview.handle({"do": "result"})["end"]["settled"]


@pytest.mark.parametrize("until", ["", "values"])
def test_who_wants_the_values_is_asked_until_no_range_is_wide(until: str, tmp_path: Path) -> None:
    table = tmp_path / "care.csv"
    table.write_text(
        "option,dead,ill,fair,well\nrest,5,30,30,35\nsurgery,10,5,10,75\npills,2,38,40,20\n"
    )
    told, log = taught_by(str(table), "posterior", 10, None, 0, 0.01), AnswerLog()
    with (
        Session(told.make, log, audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, truthful(np.array([0, 0.23, 0.71, 1.0])))
        person.screen = interview.handle({"do": "start", "until": until})
        end = person.until("end")["end"]
        assert end["settled"]
        widest = max(row["high"] - row["low"] for row in end["scale"])
        if until:
            assert widest <= 20
            assert any(entry.answer.query.id.startswith("level/") for entry in log)
            assert re.fullmatch(r"Your values, from 0 to 100: fair \d+, ill \d+\.", end["headline"])
            assert end["follows"].startswith("By your answers “surgery” is best.")
            lines = "\n".join(report_lines(person.screen, 100))
            order = [end["headline"], end["certainty"], end["follows"], end["sure"]]
            assert sorted(order, key=lines.index) == order
        else:
            assert end["headline"].startswith("By your answers “surgery” is best.")
            assert not end["follows"]
            assert widest > 60
        roughly = "The values of the levels are known only roughly: about " in end["next"]
        assert roughly == (widest > 20)
        assert end["status"] == ("Settled" if not roughly else "Enough for this result")
        kept = [one.metadata.get("choices") for one in log.asked if one.metadata.get("choices")]
        assert kept[-1]["width"] == (
            20 if until else None
        )  # so a session that is resumed goes on as far
        if until and not thorough():  # another test goes on after narrow ranges
            return
        person.screen = interview.handle({"do": "more"})
        more = person.until("end")["end"]
        widths = [row["high"] - row["low"] for row in more["scale"]]
        assert max(widths) <= (10 if until else 20)  # pressed again, as far as questions tell
        assert more["settled"]


def test_taking_back_an_answer_says_what_became_of_the_result() -> None:
    told = taught()
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, truthful(np.array([0, 0.2, 0.45, 0.7, 1.0])))
        assert person.until("end")["end"]["settled"]
        for _ in range(4):
            before = interview.progress.settled
            last = session.log.standing[0].answer.query.id
            screen = interview.handle({"do": "withdraw", "id": last})
            settled = bool(screen["end"] and screen["end"]["settled"])
            assert ("The result is no longer settled" in screen["note"]) == (before and not settled)
            assert ("The result is still settled" in screen["note"]) == (before and settled)
            if settled:
                assert "that you took back" in screen["end"]["sure"]


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (None, "The figures are those of the file care.csv."),
        ("the hip <registry>.", "The figures come from the hip <registry>."),
    ],
)
def test_the_welcome_and_the_report_say_where_the_figures_come_from(
    tmp_path: Path, source: str | None, said: str
) -> None:
    path = tmp_path / "care.csv"
    path.write_text("name,died,ill,well\nnew,3,1,6\nold,1,5,4\n")
    if source is not None:
        path.with_suffix(".words.json").write_text(json.dumps({"source": source}))
    told = taught_by(str(path), "polytope", 10, None, 0, 0.01)
    with (
        Session(told.make, AnswerLog()) as session,
        Interview(session, told.subject) as interview,
    ):
        welcome = interview.handle({"do": "state"})["welcome"]
        assert welcome["source"] == said
        offered = welcome["offered"]
        assert offered["title"] == "The 2 alternatives"
        assert offered["columns"] == ("Alternative", "well", "ill", "died")
        assert offered["rows"] == (("new", "60", "10", "30"), ("old", "40", "50", "10"))
        assert escape(said) in interview.handle({"do": "report"})["html"]


def test_downloads_are_those_of_the_screens() -> None:
    told = taught()
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        screen = Person(interview, truthful(np.array([0, 0.2, 0.45, 0.7, 1.0]))).until("end")
        assert [d["what"] for d in screen["end"]["downloads"]] == ["scale", "plan", "answers"]
        rows = interview.table("answers")
        assert len(rows) == len(session.log)
        for row, entry in zip(rows, session.log, strict=True):
            shown = next(a for a in reversed(session.log.asked) if a.query.id == row["id"])
            by_level = [row[f"a: {label}"] for label in told.subject.labels]
            assert by_level == shown.metadata["shown"]["a"]
            kind = "check" if entry.repeat else "yes" if entry.used else "no"
            assert row["used"].split()[0].strip(":,") == kind
            assert row["chosen"] in ALIKE
            assert row["repeat"] == entry.repeat
        reply = interview.handle({"do": "download", "what": "plan", "format": "csv"})
        assert reply["name"].startswith("a-random-problem-plan-")
        assert reply["text"].count("\n") == 1 + np.count_nonzero(~MDP.terminal)
        for wrong in ({"what": "log", "format": "csv"}, {"what": "scale", "format": "xml"}):
            with pytest.raises(ValueError, match="what is scale"):
                interview.handle({"do": "download", **wrong})


def test_what_the_person_chose_is_known_after_a_restart(tmp_path: Any) -> None:
    told, path = taught(), tmp_path / "log.jsonl"
    honest = truthful(np.array([0, 0.2, 0.45, 0.7, 1.0]))

    def resumed(*messages: dict[str, str], steps: int = 0) -> dict[str, Any]:
        """The screen after these messages and steps, in a new program."""
        with (
            Session(told.make, path, audit=0.1) as session,
            Interview(session, told.subject) as interview,
        ):
            person = Person(interview, honest)
            for message in messages:
                person.screen = interview.handle(message)
            for _ in range(steps):
                person.step()
            return person.screen

    screen = resumed({"do": "start", "budget": "3"}, {"do": "practised", "choice": "a"}, steps=2)
    assert resumed()["budget"] == 3
    screen = resumed(steps=1)
    while screen["stage"] != "offer":
        screen = resumed(steps=1)
    assert resumed() == {**screen, "note": None}
    screen = resumed({"do": "choose", "option": "on"})
    assert screen["stage"] == "question"
    again = resumed()
    assert (again["stage"], again["budget"]) == ("question", None)
    assert again["question"] == screen["question"]
    end = resumed({"do": "finish"})
    assert resumed() == end
    size = path.stat().st_size
    assert resumed({"do": "result"}) == end
    assert path.stat().st_size == size
    assert resumed({"do": "more"})["stage"] == "question"
    assert resumed()["stage"] == "question"
    stands = {entry.answer.query.id for entry in AnswerLog.read(path)}  # repeats among them
    assert len(stands) == again["answered"]


def test_minutes_are_counted_in_questions_at_the_persons_own_pace() -> None:
    told, log = taught(), AnswerLog()
    honest = truthful(np.array([0, 0.2, 0.45, 0.7, 1.0]))
    with (
        Session(told.make, log, audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        budgets = interview.handle({"do": "state"})["welcome"]["budgets"]
        assert budgets[0] == {"minutes": 5, "questions": 15}
        screen = interview.handle({"do": "start", "minutes": "1"})
        assert (screen["budget"], screen["time"]["planned"]) == (3, 1)
        person = Person(interview, honest)
        person.until("question")
        said = log.append

        def slowly(answer: Any, used: bool = True, **metadata: Any) -> None:
            said(answer, used, **{**metadata, "latency": 25.0})

        log.append = slowly  # type: ignore[method-assign]
        screen = person.until("offer", MOST)
        assert person.stages.count("question") == 2  # 50 of 60 seconds are spent
        assert screen["offer"]["heading"].startswith("Your 1 minute is over, and you answered ")
        person.step()
        assert person.screen["budget"] is None
        person.step()
        assert person.screen["time"] == {"planned": None, "spent": 75.0, "pace": 21.0}
        assert person.until("end", MOST)["end"]["settled"]


def test_fast_answers_are_said_once_and_at_the_end() -> None:
    told = taught()
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, truthful(np.array([0, 0.2, 0.45, 0.7, 1.0])))
        notes = []
        while person.screen["stage"] != "end":
            person.step()  # at once
            notes.append(person.screen["note"])
        assert sum("under a second" in str(note) for note in notes) == 1
        end = person.screen["end"]
        assert end["settled"]  # a remark, no verdict
        assert [said.split(" came ")[1] for said in end["remarks"]] == [
            "in under a second, which is hardly enough to read a question."
        ]
        assert end["remarks"][0] in interview.handle({"do": "report"})["html"]


def test_the_welcome_says_what_each_budget_will_likely_prove() -> None:
    told = taught()
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        interview.handle({"do": "state"})
        until = time.monotonic() + 100
        while not (found := interview.handle({"do": "prospects"}))["ready"]:
            assert time.monotonic() < until
            time.sleep(0.05)
        assert len(found["budgets"]) == 3
        assert all(re.match(r"Settled in .* simulations\.", said) for said in found["budgets"])
        assert re.fullmatch(
            r"Half of the simulated sessions took at most \d+ questions, about \d+ minutes?\.",
            found["settled"],
        )
        assert re.fullmatch(
            r"In all it mostly takes \d+ to \d+ questions, about \d+ to \d+ minutes\.",
            found["values"],
        )


@pytest.mark.parametrize("seed", quick_first([1, 0, 2, 3, 4, 5], 1))
def test_most_learn_their_values_in_as_many_questions_as_the_welcome_says(seed: int) -> None:
    told, of = taught("posterior"), np.random.default_rng(seed)
    with (
        Session(told.make, AnswerLog(), audit=0.1, seed=seed) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, truthful(np.sort(np.r_[0, of.random(3), 1])))
        said = interview.handle({"do": "prospects"})["values"]
        least, most = map(int, re.findall(r"\d+", said)[:2])
        person.screen = interview.handle({"do": "start", "until": "values"})
        end = person.until("end")
        assert least <= end["answered"] <= most
        assert max(row["high"] - row["low"] for row in end["end"]["scale"]) <= 41


@pytest.mark.slow
def test_prospects_agree_with_expected_bounds() -> None:
    told = taught(tolerance=0.001)
    with Session(told.make, AnswerLog()) as session:
        asker = session.current_asker()
        found = Prospects(asker, [8, 10, 40], 0, lambda _: False)
        for _ in found.steps():
            pass
    few, more, all_ = found.found()
    assert few.settled <= more.settled <= all_.settled
    assert few.loss >= more.loss >= all_.loss
    for prospect, questions in ((few, 3), (more, 5)):  # besides the checks
        bounds = expected_bounds(
            MDP, asker.comparator, questions, runs=12, seed=1, tolerance=0.001, bags=Bags(days=10)
        )
        assert bounds.least <= prospect.loss <= bounds.most


@pytest.mark.parametrize("choice", range(4))
def test_each_choice_of_a_conflict_says_what_it_leaves(choice: int) -> None:
    told, log = taught(), AnswerLog()
    honest = truthful(np.array([0, 0.2, 0.45, 0.7, 1.0]))
    with (
        Session(told.make, log, audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, honest)
        while person.screen["stage"] != "question" or not session.is_repeat(
            person.screen["question"]["id"]
        ):
            person.step()
        question = person.screen["question"]
        other = {"a": "b", "b": "a"}[honest(question)]
        screen = interview.handle({"do": "answer", "id": question["id"], "choice": other})
        conflict, size = screen["conflict"], len(log)
        ask = {"do": "consequences", "id": conflict["id"]}
        until = time.monotonic() + 60
        while not (left := interview.handle(ask))["ready"]:
            assert time.monotonic() < until
            time.sleep(0.02)
        assert len(log) == size  # nothing was changed
        choices = [one["choice"] for one in conflict["choices"]]
        assert [*left["choices"]] == choices == ["first", "second", "equal", "cannot tell"]
        said = left["choices"][choices[choice]]
        interview.handle({"do": "settle", "id": conflict["id"], "choice": choices[choice]})
        used = sum(e.used and e.answer.verdict is not None for e in log)
        n = sum(e.answer.verdict is not None for e in log.standing if not e.repeat)
        left_out = f"{n - used} {'answer' if n - used == 1 else 'answers'} that you keep"
        assert (f"{left_out} would not be used." in said) == (used < n)
        rows = {row["label"]: row for row in interview.handle({"do": "result"})["end"]["scale"]}
        worth = re.findall(r"“([^“]+?)” would be worth [a-z]* ?\d+ \((\d+) to (\d+)\)\.", said)
        narrow = {label for label, row in rows.items() if row["high"] - row["low"] <= 50}
        assert {label for label, _, _ in worth} <= narrow
        levels = np.flatnonzero(log[0].answer.query.d[1:-1]) + 1
        assert worth or not {told.subject.labels[i] for i in levels} <= narrow
        for label, low, high in worth:
            assert (rows[label]["low"], rows[label]["high"]) == (int(low), int(high))
        assert not interview.handle(ask)["choices"]


def test_the_result_is_shown_while_a_conflict_waits() -> None:
    told, log = taught(), AnswerLog()
    honest = truthful(np.array([0, 0.2, 0.45, 0.7, 1.0]))

    def says(question: dict[str, Any]) -> str:
        choice = honest(question)
        return {"a": "b", "b": "a"}[choice] if question["id"].startswith(ORDER) else choice

    with (
        Session(told.make, log, audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        screen = Person(interview, says).until("conflict", MOST)
        result = interview.handle({"do": "result"})
        assert result["stage"] == "end"
        assert result["end"]["counts"]["answered"] == screen["answered"]
        assert interview.handle({"do": "state"}) == {**screen, "note": None}


@pytest.fixture
def care(tmp_path: Path) -> str:
    """The path of a table of five treatments."""
    path = tmp_path / "care.csv"
    path.write_text(
        "treatment,died,severe,mild,well\nsurgery,2,1,1,6\ndrugs,1,3,2,4\nboth,2,2,0,6\n"
        "rest,0,4,4,2\nwait,1,4,1,4\n"
    )
    return str(path)


@pytest.mark.parametrize("answers", [0, 1, 2, 99])
def test_a_choice_is_settled_only_if_no_other_alternative_is_better_by_the_tolerance(
    care: str, answers: int
) -> None:
    told = taught_by(care, "posterior", 10, None, 0, 0.01)
    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, truthful([0, 0.45, 0.9, 1]))
        person.until("end", answers)
        end = interview.handle({"do": "result"})["end"]
        assert end["settled"] == (answers == 99)
        most = "more than|at most" if answers else "as much as if"  # at first there is no guess
        said = f"{end['sure']} {end['next']} {end['before']}"
        bound = re.search(rf"(?:{most}) ([\d.]+) in 100", said)
        assert bound
        result = session.result()
        assert float(bound[1]) >= 100 * result.loss_bound
        assert (
            not end["settled"]
            or result.loss_bound <= 0.01 < 0.05 < told.make([]).result().loss_bound
        )
        if answers < 99:
            assert "is best" not in end["headline"]
            assert "the one to choose" not in end["headline"]
            assert "You can stop here" not in end["next"]


@pytest.mark.parametrize("number", quick_first([3, 5], 1))
def test_one_question_that_cannot_be_told_does_not_leave_a_choice_open(
    care: str, number: int
) -> None:
    told, asked = taught_by(care, "posterior", 10, None, 0, 0.01), []
    answer = truthful([0, 0.45, 0.9, 1])

    def says(question: dict[str, Any]) -> str:
        asked.append(question["id"])
        new = [id for id in asked if not id.endswith(" again")]  # checks are not learned from
        return "cannot tell" if len(new) == number and new[-1] == asked[-1] else answer(question)

    with (
        Session(told.make, AnswerLog(), audit=0.1) as session,
        Interview(session, told.subject) as interview,
    ):
        end = Person(interview, says).until("end")["end"]
        assert session.result().status is Status.UNSURE
        assert session.result().loss_bound <= 0.01
        assert end["settled"]
        assert "is the one to choose" in end["headline"]  # no more than that, after "cannot tell"
        assert len(asked) < 40
        assert "More answers help" not in end["next"]


@pytest.fixture
def ties(tmp_path: Path) -> str:
    """The path of a table of treatments, three of which nearly tie by the values below."""
    path = tmp_path / "ties.csv"
    path.write_text(
        "treatment,died,severe,mild,well\nsurgery,30,0,0,70\ndrug,5,40,25,30\n"
        "waiting,2,60,28,10\nradiation,10,28,20,42\nboth,40,2,1,57\n"
    )
    return str(path)


NEARLY_TIED = np.array([0, 0.5, 0.8, 1])


def about(width: float) -> Says:
    """One who answers by the values above, and calls equal what differs by less than a width."""

    def says(question: dict[str, Any]) -> str:
        rows = question["rows"]
        apart = sum(NEARLY_TIED[row["level"]] * (row["a"] - row["b"]) for row in rows)
        if abs(apart) <= width * question["of"]:
            return "equal"
        return "a" if apart > 0 else "b"

    return says


@pytest.mark.parametrize("option", quick_first(["finish", "on"], 1))
def test_of_alternatives_that_nearly_tie_that_is_said_early_and_stopping_is_offered(
    ties: str, option: str, tmp_path: Path
) -> None:
    told, path = taught_by(ties, "posterior", 10, None, 0, 0.01), tmp_path / "log.jsonl"
    with (
        Session(told.make, path) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, about(0.03), option=option)
        offer = person.until("offer", MOST)["offer"]
        assert person.stages.count("question") <= 16
        assert offer["heading"].endswith(" are nearly equal to you")
        said = re.search(r"no other \w+ is better by more than ([\d.]+) in 100", offer["text"])
        assert said
        vectors = np.array(  # of the file
            [[30, 0, 0, 70], [5, 40, 25, 30], [2, 60, 28, 10], [10, 28, 20, 42], [40, 2, 1, 57]]
        )
        names = ["surgery", "drug", "waiting", "radiation", "both"]
        worth = dict(zip(names, vectors @ NEARLY_TIED / 100, strict=True))
        named = re.findall(r"“(\w+)”", offer["heading"])
        assert len(named) >= 2
        assert max(worth.values()) - min(worth[name] for name in named) <= float(said[1]) / 100
        person.step()
        if option == "finish":
            end = person.screen["end"]
            assert end["status"] == "Nearly settled"
            assert not end["settled"]
            assert end["more"]
            assert end["headline"] == f"{offer['heading']}."
            assert end["sure"] in offer["text"]
            assert offer["heading"] in interview.handle({"do": "report"})["html"]
            person.screen = interview.handle({"do": "more"})
        assert person.screen["stage"] == "question"
        most = person.stages.count("question") + scaled(2, 9)
        while person.screen["stage"] == "question" and person.stages.count("question") < most:
            person.step()
        assert person.screen["stage"] in ("question", "end")  # it is not offered again at once
        before = person.screen
    with Session(told.make, path) as session, Interview(session, told.subject) as interview:
        assert interview.handle({"do": "state"})["stage"] == before["stage"]


@pytest.mark.slow
def test_where_little_is_left_to_gain_no_question_comes_whose_answer_is_known(ties: str) -> None:
    told = taught_by(ties, "posterior", 10, None, 0, 0.01)
    with (
        Session(told.make, AnswerLog()) as session,
        Interview(session, told.subject) as interview,
    ):
        person = Person(interview, about(0.03))
        screen = person.until("end", 40)
        assert screen["stage"] == "end"
        assert screen["end"]["status"] in ("Settled", "Enough for this result", "Nearly settled")
        assert person.stages.count("question") < 35  # 41 with those questions


def test_a_person_does_not_wait_for_what_was_found_beside_the_last_question(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("elicit.person.outlook._PLAYS", 0)
    told, looks = taught("posterior", 0.0001), []
    here = threading.current_thread()

    def nearly(result: Any, before: float | None) -> None:
        looks.append((threading.current_thread() is here, person.stages.count("question")))

    subject = replace(told.subject, nearly=nearly)
    with Session(told.make, AnswerLog()) as session, Interview(session, subject) as interview:
        person = Person(interview, truthful([0, 0.2, 0.7, 0.9, 1]))
        while person.stages.count("question") < NEARLY_FROM + scaled(1, 4):
            assert person.screen["stage"] != "end"
            person.step()
            if person.screen["stage"] == "question":
                id, until = person.screen["question"]["id"], time.monotonic() + 60
                while not interview.handle({"do": "outlook", "id": id})["ready"]:
                    assert time.monotonic() < until
                    threading.Event().wait(0.01)
    assert [at for waited, at in looks if not waited]
    assert not [at for waited, at in looks if waited]
