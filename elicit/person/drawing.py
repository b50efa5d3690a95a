"""Drawings of a session, as JSON: its welcome, conflicts, end, report and tables."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from typing import Any

from elicit._support.distribution import version
from elicit.model.comparator_parts import tie_of, trusted_share
from elicit.model.query import Verdict
from elicit.person.asker import Compares, Supposed
from elicit.person.course.conclusion import (
    Conclusion,
    capital,
    in_unit,
    per_hundred,
    with_probability,
)
from elicit.person.course.conduct import ORDER, Conduct, choice_of
from elicit.person.course.counts import (
    Counts,
    in_answers,
    numbered,
    remarks_on,
    stands,
    status_of,
)
from elicit.person.course.drift import Drift
from elicit.person.course.files import answer_row, as_csv, as_json
from elicit.person.course.kept_in_log import Choices
from elicit.person.course.level_questions import WIDE
from elicit.person.course.pace import Pace
from elicit.person.findings import (
    ScaleRow,
    certainty,
    given_in,
    guess_in_words,
    narrowing,
    scale_notes,
    scale_rows,
    values_in_words,
)
from elicit.person.next_question import NextQuestion
from elicit.person.outlook import Prospect
from elicit.person.report import ENOUGH, NEARLY, ReportDetails, report_page
from elicit.person.session import Session
from elicit.person.showing import (
    Shown,
    Subject,
    about_questions,
    drawn,
    legend_of,
    printable,
    said_of,
    shown_of,
)
from elicit.tutors.answer_log import Entry

MINUTES = (5, 10, 20)
"""Minutes that the welcome offers."""

_TABLES = ("scale", "plan", "outcomes", "answers")  # that can be downloaded
_MOST_IN_HEADLINE = 6  # levels between the worst and the best whose values make a headline
_TELLS = 50  # width of a range, of 100, up to which it is said under a choice in a conflict
_IF_MEANT = "if every answer is meant as it was given"


class Drawing:
    """Draws screens that only read a session: welcome, conflict, end, report and tables.

    Parameters
    ----------
    session : Session
    subject : Subject
    chosen : Choices
        The person's choices, which may change.
    questions : NextQuestion
    """

    def __init__(
        self, session: Session, subject: Subject, chosen: Choices, questions: NextQuestion
    ) -> None:
        self._session, self._subject = session, subject
        self._chosen, self._questions = chosen, questions
        self._found: tuple[tuple[int, int], tuple[tuple[Entry, ...], ...]] | None = None

    def welcome(self) -> dict[str, Any]:
        """Return the fields of the welcome screen."""
        words, start = self._subject.words, self._questions.at_start()
        loss = None if start is None else start.loss
        compare = (
            f"Each question shows two {words.side}s of {words.unit}. You choose one of them, as if "
            "the decision were yours to make. “Equally good” is an answer too, and need not be "
            "exact. There is no right or wrong answer."
        )
        return {
            "who": printable(self._session.who or ""),
            "compare": printable(compare),
            "width": WIDE,
            "purpose": printable(words.purpose),
            "before": "" if loss is None else printable(self._before(loss)),
            "source": printable(self._subject.source),
            "offered": None if self._subject.offered is None else asdict(self._subject.offered),
            "least": self._least(),
            "budgets": [
                {"minutes": minutes, "questions": Pace.of(self._session.log).questions_in(minutes)}
                for minutes in MINUTES
            ],
        }

    def _least(self) -> int:
        """Return the fewest questions before a result is called settled, checks among them."""
        question = self._session.question()
        if question is None or not self._subject.least:
            return 0
        return 1 + sum(self._questions.still_needed(self._session.conduct(), question.id))

    def in_prospect(self, found: Prospect) -> str:
        """Return a sentence on what a number of questions is likely to prove."""
        n = found.sessions
        if found.settled == n:
            return f"Settled in all {n} simulations."
        said = f"Settled in {found.settled} of {n} simulations."
        if 2 * found.settled > n or math.isnan(found.loss):
            return said
        short = per_hundred(found.loss)
        return f"{said} In half of all {n} the result could still fall {short} short."

    def _before(self, loss: float) -> str:
        """Return a sentence on the loss that was possible before the first answer."""
        subject, asker = self._subject, self._session.current_asker()
        labels = [printable(label) for label in subject.labels]
        size = in_unit(loss, subject.words.unit, labels, subject.words.loss)
        level = trusted_share(asker.comparator) if isinstance(asker, Compares) else None
        sure = with_probability(level)
        costs = f"{capital(sure)}, that" if sure else "That"
        return (
            f"Without your answers, the program may choose wrongly for you. {costs} costs at most "
            f"{size}."
        )

    def _conflicts_found(self) -> tuple[tuple[Entry, ...], ...]:
        """Return ``Session.conflicts``, which are computed once for the same answers."""
        log = self._session.log
        state = len(log), sum(entry.retracted for entry in log)
        if self._found is None or self._found[0] != state:
            self._found = state, self._session.conflicts()
        return self._found[1]

    def repeat_conflict(self, first: Entry, again: Entry) -> dict[str, Any]:
        """Return the screen's conflict between a repeat's answer and the first answer."""
        choices = [
            {"choice": "first", "label": "What I said before"},
            {"choice": "second", "label": "What I said now"},
        ]
        if not self._session.makes_askers:
            choices = [{"choice": "first", "label": "Keep what I said before"}]
        else:
            said = {first.answer.verdict, again.answer.verdict}
            if Verdict.EQUAL not in said:
                choices.append({"choice": "equal", "label": "Both are about equal"})
            if None not in said:
                choices.append({"choice": "cannot tell", "label": "I am not sure"})
        return {
            "id": again.answer.query.id,
            "heading": "You answered this question differently before",
            "text": "That can happen. Which do you mean?",
            "answers": [
                self._as_shown(first, "Before"),
                self._as_shown(again, "Now"),
            ],
            "choices": choices,
        }

    def contradiction(self, among: Sequence[Entry]) -> dict[str, Any]:
        """Return the screen's conflict between answers that contradict each other."""
        numbers = self._numbers()
        shown = [
            self._as_shown(entry, f"Answer {numbers[id_]}")
            for entry in among
            for id_ in [entry.answer.query.id]
        ]
        if len(among) == 1:
            heading = "This answer goes against the order of the levels"
            used = "the program allows for it as a possible error"
            used = used if among[0].used else "it is not used"
            text = f"Do you mean it? While it stands, {used}."
            choices = [{"choice": f"withdraw:{among[0].answer.query.id}", "label": "Take it back"}]
        elif len(among) == 2:
            heading = "These two answers contradict each other"
            text = "That can happen. Which one do you mean now?"
            ids = [entry.answer.query.id for entry in among]
            choices = [
                {"choice": f"withdraw:{other}", "label": f"Keep answer {numbers[one]}"}
                for one, other in (ids, ids[::-1])
            ]
        else:
            heading = f"These {len(among)} answers contradict each other"
            text = "That can happen. Taking back any one of them fixes it."
            choices = [
                {
                    "choice": f"withdraw:{entry.answer.query.id}",
                    "label": f"Take back answer {numbers[entry.answer.query.id]}",
                }
                for entry in among
            ]
        if len(among) > 1:
            choices.append({"choice": "cannot tell", "label": "I am not sure"})
        keep = {1: "Keep it", 2: "Keep both"}.get(len(among), "Keep them all")
        choices.append({"choice": "later", "label": keep})
        return {
            "id": among[-1].answer.query.id,
            "heading": heading,
            "text": text,
            "answers": shown,
            "choices": choices,
        }

    def left_by(self, levels: Sequence[int], after: Supposed) -> str:
        """Return sentences on the result of a choice in a conflict.

        They give the range of each of these levels' values, unless that is so wide that it tells
        little, and the number of answers that are kept but not used. The possible loss is not among
        them: people took the choice with the least loss, and not the one they meant.
        """
        n = after.of - after.used
        kept = f"{in_answers(n).capitalize()} that you keep would not be used." if n > 0 else ""
        if not isinstance(after.asker, Compares):
            return kept
        names = [printable(self._subject.labels[i]) for i in levels]
        worth = [
            f"“{row.label}” would be worth {guess_in_words(row.value, row.known, row.rough)} "
            f"({row.low:.0f} to {row.high:.0f})."
            for row in scale_rows(after.asker.comparator, self._subject.labels)
            if row.label in names and row.high - row.low <= _TELLS
        ]
        return printable(" ".join([*worth, kept]).strip())

    def _as_shown(self, entry: Entry, name: str) -> dict[str, Any]:
        shown = self._as_put(entry)
        return {
            "name": name,
            "sentence": said_of(self._subject, entry.answer),
            "chosen": choice_of(entry.answer),
            "question": drawn(shown, 0),
        }

    def _as_put(self, entry: Entry) -> Shown:
        """Return the question of an answer, with its sides as the person saw them."""
        return replace(shown_of(self._subject, entry.answer.query), swapped=entry.answer.swapped)

    def number_of(self, id: str) -> int:
        """Return the number of an answer in lists and reports, by its query's id."""
        return self._numbers()[id]

    def _numbers(self) -> dict[str, int]:
        """Return the number of each answer in lists and reports, by its query's id."""
        return {entry.answer.query.id: number for number, entry in numbered(self._session.log)}

    def answers(self) -> dict[str, Any]:
        """Return the list of all answers, and the conflicts among them."""
        conflicts = self._conflicts()
        among = {one["id"] for entries in conflicts for one in entries}
        numbers = self._numbers()
        said = [
            {
                "id": entry.answer.query.id,
                "number": number,
                "sentence": said_of(self._subject, entry.answer),
                "shown": _in_words(self._as_put(entry)),
                "verdict": entry.answer.verdict,
                "time": entry.metadata.get("time"),
                "withdrawn": entry.retracted,
                "status": status_of(entry),
                "stands": stands(status_of(entry)),
                "remarks": remarks_on(entry, numbers, entry.answer.query.id in among),
                "used": entry.used,
                "repeat": entry.repeat,
                "order": entry.answer.query.id.startswith(ORDER),
            }
            for number, entry in numbered(self._session.log)
        ]
        return {
            "answers": said,
            "conflicts": [[one["id"] for one in entries] for entries in conflicts],
        }

    def report(self) -> dict[str, Any]:
        """Return a page to keep, and the name of its file."""
        query, log = self._session.question(), self._session.log
        whole = query is not None and shown_of(self._subject, query).exact
        now = datetime.now(UTC)
        title = printable(self._subject.words.title)
        end = self.end(query is not None and not whole)
        html = report_page(
            title,
            f"{now.day} {now:%B %Y, %H:%M} UTC",
            end,
            self.answers()["answers"],
            waiting=whole,
            details=ReportDetails(
                who=printable(self._session.who or ""),
                log=None if log.path is None else printable(log.path.name),
                checksum=log.checksum,
                preamble=about_questions(self._subject.words),
                legend=legend_of(self._subject),
                source=printable(self._subject.source),
                facts={**dict(end["facts"]), "Version": f"elicit-qlearn {version()}"},
                limits=self._limits(),
            ),
        )
        return {"html": html, "name": self._file_name("report", "html", now)}

    def _file_name(self, what: str, ending: str, now: datetime) -> str:
        words = re.findall(r"\w+", printable(self._subject.words.title).lower())
        return "-".join([*words, what, f"{now:%Y-%m-%d}"]) + f".{ending}"

    def download(self, what: str, format: str) -> dict[str, Any]:
        """Return a table as a file. Raises ValueError for another table or format."""
        if format not in ("csv", "json") or what not in _TABLES:
            raise ValueError("what is scale, plan, outcomes or answers, and format csv or json")
        rows = self.table(what)
        text = as_csv(rows) if format == "csv" else as_json(rows)
        now = datetime.now(UTC)
        return {
            "text": text,
            "type": "text/csv" if format == "csv" else "application/json",
            "name": self._file_name(self.name_of(what).lower(), format, now),
        }

    def name_of(self, what: str) -> str:
        """Return the name that screens and files give to a table."""
        found = self._concluded().result if what == "plan" else None
        return (found.title if found is not None else "") or what.capitalize()

    def table(self, what: str) -> list[dict[str, Any]]:
        """Return the rows of a table to keep (see ``Interview.table``)."""
        if what == "answers":
            among = {entry["id"] for entries in self._conflicts() for entry in entries}
            return [
                answer_row(
                    number,
                    entry,
                    self._as_put(entry),
                    said_of(self._subject, entry.answer),
                    entry.answer.query.id in among,
                )
                for number, entry in numbered(self._session.log)
            ]
        if what == "scale":
            return [self._scale_row(row) for row in self.end(False)["scale"]]
        concluded = self._concluded()
        found = concluded.result if what == "plan" else concluded.outcomes
        if found is None:
            return []
        return [dict(zip(found.columns, row, strict=True)) for row in found.rows]

    def _asked_until(self) -> str:
        """Return when the questions were to end, by the person's choice."""
        chosen = self._chosen
        if chosen.budget is not None:
            spent = "" if chosen.minutes is None else f", planned for {chosen.minutes} minutes"
            return f"{chosen.budget} questions{spent}, or a settled result"
        if chosen.width is None:
            return "a settled result"
        return (
            f"a settled result, and no level's range wider than {chosen.width:.0f} of 100 "
            f"({chosen.width / 2:g} if it reaches to 0 or 100)"
        )

    def _scale_row(self, row: dict[str, Any]) -> dict[str, Any]:
        """Return a level as a row to keep, with the names of the person and of the problem.

        The checksum of the log's last line tells interviews apart.
        """
        given, log = row["given"] or (None, None), self._session.log
        return {
            "who": printable(self._session.who or "") or None,
            "problem": printable(self._subject.words.title),
            "checksum": log.checksum,
            "program": f"elicit-qlearn {version()}",
            "asked_until": self._asked_until(),
            "level": row["label"],
            "value": round(row["value"], 2) if row["known"] or row["rough"] else None,
            "low": row["low"],
            "high": row["high"],
            "low_if_no_mistake": given[0],
            "high_if_no_mistake": given[1],
            "asked": row["asked"] and row["low"] < row["high"],  # the two ends are fixed
            "known": row["known"],
        }

    def _concluded(self) -> Conclusion:
        start = self._questions.at_start()
        return self._subject.conclude(self._session.result(), None if start is None else start.loss)

    def end(self, open_still: bool) -> dict[str, Any]:
        """Return the fields of the screen at the end, with the result.

        Parameters
        ----------
        open_still : bool
            True if a question is open that cannot be put in whole numbers.
        """
        session, subject = self._session, self._subject
        counts = Counts.of(session.log)
        asker = session.current_asker()
        known = asker.comparator if isinstance(asker, Compares) else None
        found = self._concluded()
        conduct = session.conduct()
        over, enough = session.question() is None, self._is_enough(conduct)
        may_add = bool(subject.least) and session.makes_askers
        addable = may_add and self._questions.about_a_level() is not None
        left = (not over and not open_still) or addable
        caution = self._caution(conduct)
        headline, said = found.headline, [*found.statements]
        after = f"{found.next} {found.more if left else ''}".strip()
        start = self._questions.at_start() if found.headline else None
        size, sure, before, reason = found.size, found.sure, found.before, found.reason
        effect = found.effect
        changes, plan = found.changes, found.plan
        may_be_near = found.headline and not found.settled and caution is None
        nearly = self._questions.nearly(conduct) if may_be_near else None
        if not conduct.with_verdict and start is not None and not start.finished:
            size = sure = reason = effect = ""
            changes, plan = None, None  # there is nothing yet that could hold or change
            after = found.more if left else ""
            before = "" if start.loss is None else self._before(start.loss)
            headline = (
                "You have not said yet which is better, so nothing is known about your values."
            )
        elif found.settled and not enough and caution is None:
            headline = found.early or f"You stopped early. {found.headline}"
            after = "More answers would show whether this holds."
        elif found.headline and caution is not None:
            headline = "Do not rely on this result."
            after = "Take back any answers that you do not mean."
            after = f"A few more answers can change that. {after}" if left else after
            if_meant = f"If every answer is meant as it was given: {found.headline} {found.sure}"
            said.append(if_meant.strip())
            size = sure = before = reason = effect = ""
        elif nearly is not None:
            headline, sure, size = f"{nearly.heading}.", nearly.text, nearly.size
            checks = "" if conduct.passed else " More answers would also check those you gave."
            after = f"You can stop here.{checks or f' {found.more}' if left else ''}".strip()
        back = counts.withdrawn + counts.not_kept
        if back and found.settled and enough and caution is None:
            those, did = "answer" if back == 1 else in_answers(back), "took back"
            if counts.not_kept:
                did = f"{did} or did not keep" if counts.withdrawn else "did not keep"
            sure = f"{sure} The result does not use the {those} that you {did}.".strip()
        if caution is not None:
            changes, plan = (
                table and replace(table, note=f"This holds only {_IF_MEANT}. {table.note}")
                for table in (changes, plan)
            )
        rows = [] if known is None else scale_rows(known, subject.labels, session.log)
        as_given = self._rows_as_given()
        scale = [row._replace(given=given_in(row, as_given))._asdict() for row in rows]
        settled = found.settled and caution is None and enough
        inner = rows[1:-1]
        wanted = self._chosen.width is not None and conduct.with_verdict > 0 and caution is None
        first = wanted and headline != "" and 0 < len(inner) <= _MOST_IN_HEADLINE
        follows = ""
        if first:
            follows, headline = headline, f"Your values, from 0 to 100: {values_in_words(inner)}"
        narrow = narrowing(rows, known) if known is not None and settled and left else ""
        if narrow:
            after = f"{found.next} {narrow}"
        rests = settled and (bool(narrow) or (changes is not None and changes.open is not None))
        status = "Settled" if settled else NEARLY if nearly else "Not settled"
        return {
            "headline": printable(headline),
            "follows": printable(follows),
            "effect": printable(effect),
            "reason": printable(reason),
            "source": printable(subject.source),
            "size": printable(size),
            "sure": printable(sure),
            "next": printable(after),
            "before": printable(before),
            "values": values_in_words(rows) if conduct.with_verdict and not first else "",
            "caution": caution,
            "remarks": self._remarks() if subject.least else [],
            "settled": settled,
            "status": ENOUGH if rests else status,
            "more": left,
            "finished": over,
            "open": f"There is no finer question in whole numbers. {subject.finer}".strip()
            if open_still
            else None,
            "scale": scale,
            "by_chance": conduct.by_chance if subject.least else "",
            "scale_notes": []
            if known is None
            else scale_notes(rows, known, settled, as_given, self._about_equal()),
            "certainty": None
            if known is None
            else f"{certainty(known)}{'' if caution is None else f', {_IF_MEANT}'}",
            "statements": [
                *map(printable, said),
                *map(printable, subject.report(session.result())),
            ],
            "changes": None if changes is None else asdict(changes),
            "plan": None if plan is None else asdict(plan),
            "downloads": [
                {"what": what, "name": name}
                for what, name in (
                    ("scale", "Scale" if scale else ""),
                    ("plan", found.result.title if found.result is not None else ""),
                    ("outcomes", found.outcomes.title if found.outcomes is not None else ""),
                    ("answers", "Answers"),
                )
                if name
            ],
            "facts": [
                *map(list, subject.facts.of),
                ["Asked until", self._asked_until()],
                ["Status", ENOUGH if rests else status],
            ],
            "limits": self._limits(),
            "counts": counts.record(),
            "given": counts.sentence,
            "checks": counts.checks,
            "conflicts": self._conflicts(),
        }

    def _rows_as_given(self) -> list[ScaleRow]:
        """Return the rows of the scale if each answer is as given; none if that cannot be."""
        given = self._session.as_given()
        return [] if given is None else scale_rows(given, self._subject.labels, self._session.log)

    def _about_equal(self) -> float:
        """Return within which share of the value range things called equal are taken to be.

        The result is 0 if nothing was called equal, or nothing is known if each answer is as given.
        """
        given, log = self._session.as_given(), self._session.log
        called = any(one.used and one.answer.verdict is Verdict.EQUAL for one in log)
        return tie_of(given) if called and given is not None else 0.0

    def is_settled(self) -> bool:
        """Return ``settled`` of the screen at the end, without drawing the rest of it."""
        conduct = self._session.conduct()
        if self._caution(conduct) is not None or not self._is_enough(conduct):
            return False
        return self._concluded().settled

    def _caution(self, conduct: Conduct) -> str | None:
        """Return a sentence on why the answers say little, or None."""
        return conduct.caution(at_end=True) if self._subject.least else None

    def _is_enough(self, conduct: Conduct) -> bool:
        """Return whether there are answers and checks enough to call a result settled."""
        over = self._session.question() is None
        # whoever wants more than the result may stop at any time once it has all it needs
        enough = over or self._questions.only_values(conduct)
        return enough and (conduct.passed or not conduct.differed)

    def _remarks(self) -> list[str]:
        """Return a sentence on very fast answers and one on drift, each only if there is any."""
        log = [*self._session.log]
        return [said for said in (Pace.of(log).remark(), Drift.of(log).remark()) if said]

    def _limits(self) -> list[str]:
        note = self._subject.words.note
        return [printable(one) for one in (*self._subject.facts.limits, *([note] if note else []))]

    def _conflicts(self) -> list[list[dict[str, Any]]]:
        numbers = self._numbers()
        return [
            [
                {
                    "id": entry.answer.query.id,
                    "number": numbers[entry.answer.query.id],
                    "sentence": said_of(self._subject, entry.answer),
                }
                for entry in among
            ]
            for among in self._conflicts_found()
        ]


def _in_words(shown: Shown) -> str:
    """Return both sides of a question in words, as they were shown."""
    a, b, same = shown.as_seen
    common = sum(shown.common)
    if not common:  # then the counts add up to all
        return f"A: {a}. B: {b}."
    rest = f"{common:,} are the same in both: {same}"
    return f"A: {a}. B: {b}. (Of {shown.of:,} {shown.words.unit}; {rest}.)"
