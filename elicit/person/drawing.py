"""Drawings of a session: the parts of an interview's screens that only read it, as JSON."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from elicit._support.distribution import version
from elicit.model.difference import tail_sums
from elicit.model.pairs import same_pairs
from elicit.model.query import Query, Verdict
from elicit.person.asker import Compares, Supposed
from elicit.person.course.choices import Choices
from elicit.person.course.conclusion import Conclusion, SessionFacts, in_unit
from elicit.person.course.conduct import Conduct, Pace, choice_of
from elicit.person.course.drift import Drift
from elicit.person.course.files import answer_row, as_csv, as_json
from elicit.person.course.level_questions import known_question, level_question
from elicit.person.course.start import Before, Start
from elicit.person.findings import asked_levels, certainty, scale_rows
from elicit.person.outlook import Prospect
from elicit.person.report import ReportDetails, report_page
from elicit.person.session import Session
from elicit.person.showing import MOST_ICONS, Shown, Words, printable, show
from elicit.tutors.answer_log import Entry

MINUTES = (5, 10, 20)
"""Minutes that the welcome offers."""


def _no_more(_: Any) -> list[str]:
    return []


def _unsaid(_: Any) -> None:
    return None


def _nothing_concluded(_: Any, before: float | None) -> Conclusion:
    return Conclusion()


@dataclass(frozen=True, eq=False)
class Subject:
    """The subject of an interview, in words.

    Parameters
    ----------
    labels : (k,) str
        The levels, worst first.
    words : Words
        The words in which the problem speaks.
    of : int
        Number of outcomes on a side, if there is a choice.
    report : callable
        Returns sentences about the outcome of ``Session.result``.
    stakes : callable
        Returns from the same outcome a sentence on the purpose of more questions, or None.
    finer : str
        Advice for when no question in whole numbers is left.
    seed : int
        Decides which side is A, and other choices by chance.
    least : int
        Fewest answers, besides "cannot tell", before the interview says that it is finished, if
        anything was at stake before the first. Until then it asks about the levels of which most
        is open, and then it puts an earlier question again. 0: it ends with its asker.
    conclude : callable
        Returns the ``Conclusion`` of the outcome of ``Session.result``. Its second argument is the
        share of the value range that could be lost before the first answer, or None if unknown.
    facts : SessionFacts
        Facts that the report names.
    enough : callable, optional
        Returns whether the outcome of ``Session.result`` is sure enough to end once the asker has
        no question. Until then the interview asks about the levels of which most is open. Default:
        it always is.
    """

    labels: tuple[str, ...]
    words: Words = field(default_factory=Words)
    of: int = 10
    report: Callable[[Any], list[str]] = field(default=_no_more, repr=False)
    stakes: Callable[[Any], str | None] = field(default=_unsaid, repr=False)
    finer: str = ""
    seed: int = 0
    least: int = 5
    conclude: Callable[[Any, float | None], Conclusion] = field(
        default=_nothing_concluded, repr=False
    )
    facts: SessionFacts = field(default_factory=SessionFacts)
    enough: Callable[[Any], bool] | None = field(default=None, repr=False)


class Drawing:
    """Parts of the screens of an interview that only read its session.

    Parameters
    ----------
    session : Session
    subject : Subject
    """

    def __init__(self, session: Session, subject: Subject) -> None:
        self._session, self._subject = session, subject
        self._start: Start | Before | None = None  # found when it is first needed
        self._found: tuple[tuple[int, int], tuple[tuple[Entry, ...], ...]] | None = None
        self._chosen = Choices.of(session.log.asked)

    def _welcome(self) -> dict[str, Any]:
        words, start = self._subject.words, self._at_start()
        loss = None if start is None else start.loss
        compare = f"Each question shows two {words.side}s of {words.unit}. You choose one of them."
        return {
            "who": printable(self._session.who or ""),
            "compare": printable(compare),
            "purpose": printable(words.purpose),
            "before": "" if loss is None else printable(self._before(loss)),
            "least": self._subject.least,
            "budgets": [
                {"minutes": minutes, "questions": Pace.of(self._session.log).questions_in(minutes)}
                for minutes in MINUTES
            ],
        }

    def _in_prospect(self, found: Prospect) -> str:
        """Return a sentence on what so many questions will likely prove."""
        words, n = self._subject.words, found.sessions
        if found.settled == n:
            return f"In all of {n} simulated sessions the result was settled by then."
        said = f"In {found.settled} of {n} simulated sessions the result was settled by then."
        if 2 * found.settled > n or math.isnan(found.loss):
            return said
        most = in_unit(found.loss, words.unit, self._subject.labels, words.loss)
        return printable(f"{said} In half of them it could lose at most as much as {most}.")

    def _before(self, loss: float) -> str:
        """Return a sentence on what could be lost before the first answer."""
        words = self._subject.words
        most = in_unit(loss, words.unit, self._subject.labels, words.loss)
        return f"Before your first answer, the result could lose as much as {most}."

    def _at_start(self) -> Start | Before | None:
        """Return what was known before the first answer, or None if it can no longer be found."""
        facts = self._subject.facts.of
        if self._start is None and facts:
            self._start = Before.kept(self._session.log.asked, facts)
        if self._start is None:
            empty = not self._session.log.standing
            asker = self._session.current_asker() if empty else self._session.at_start()
            if asker is None:
                return None
            self._start = start = Start(asker)
            if empty:  # the asker goes on
                _ = start.loss, start.finished
        return self._start

    def _conflicts_found(self) -> tuple[tuple[Entry, ...], ...]:
        """Return ``Session.conflicts``, which are computed once for the same answers."""
        log = self._session.log
        state = len(log), sum(entry.retracted for entry in log)
        if self._found is None or self._found[0] != state:
            self._found = state, self._session.conflicts()
        return self._found[1]

    def _repeat_conflict(self, first: Entry, again: Entry) -> dict[str, Any]:
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

    def _contradiction(self, among: Sequence[Entry]) -> dict[str, Any]:
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
            text = "That can happen. Withdrawing any one of them fixes it."
            choices = [
                {
                    "choice": f"withdraw:{entry.answer.query.id}",
                    "label": f"Withdraw answer {numbers[entry.answer.query.id]}",
                }
                for entry in among
            ]
        if len(among) > 1:
            choices.append({"choice": "cannot tell", "label": "I am not sure"})
        choices.append({"choice": "later", "label": "Decide later"})
        return {
            "id": among[-1].answer.query.id,
            "heading": heading,
            "text": text,
            "answers": shown,
            "choices": choices,
        }

    def _left_by(self, levels: Sequence[int], after: Supposed) -> str:
        """Return what a choice in a conflict would say of some levels, and the answers it keeps.

        What the result could then lose is not said: people took the choice that lost least, and
        not the one they meant.
        """
        kept = f"Keeps {after.used} of {after.of} answers."
        if not isinstance(after.asker, Compares):
            return kept
        names = [printable(self._subject.labels[i]) for i in levels]
        worth = [
            f"Then “{row.label}” is worth {row.low:.0f} to {row.high:.0f}."
            if (row.low, row.high) != (0.0, 100.0)
            else f"Then “{row.label}” can be worth anything."
            for row in scale_rows(after.asker.comparator, self._subject.labels)
            if row.label in names
        ]
        return printable(" ".join([*worth, kept]))

    def _as_shown(self, entry: Entry, name: str) -> dict[str, Any]:
        shown = self._as_put(entry)
        return {
            "name": name,
            "sentence": self._sentence(entry),
            "chosen": choice_of(entry.answer),
            "question": self._drawn(shown, 0),
        }

    def _as_put(self, entry: Entry) -> Shown:
        """Return the question of an answer with the sides as the person saw them."""
        return replace(self._shown(entry.answer.query), swapped=entry.answer.swapped)

    def _level_question(self, known: bool = False) -> Query | None:
        """Return a question about a level that is open.

        If there is none, and ``known`` is True, one whose answer follows from others.
        """
        asker = self._session.current_asker()
        if not isinstance(asker, Compares):
            return None
        said = [tail_sums(e.answer.query.d) for e in self._session.log.standing]

        def answered(query: Query) -> bool:
            return bool(said) and bool(same_pairs(tail_sums(query.d), np.array(said)).any())

        asked = asked_levels(self._session.log)
        found = level_question(asker.comparator, self._subject.of, answered, asked)
        if found is None and known:
            return known_question(asker.comparator, self._subject.of, answered)
        return found

    def _numbers(self) -> dict[str, int]:
        """Return the number of each answer in lists and reports, by its query's id."""
        return {entry.answer.query.id: i for i, entry in enumerate(self._session.log, 1)}

    def _answers(self) -> dict[str, Any]:
        said = [
            {
                "id": entry.answer.query.id,
                "number": number,
                "sentence": self._sentence(entry),
                "shown": _in_words(self._as_put(entry)),
                "verdict": entry.answer.verdict,
                "time": entry.metadata.get("time"),
                "withdrawn": entry.retracted,
                "used": entry.used,
                "repeat": entry.repeat,
            }
            for number, entry in enumerate(self._session.log, 1)
        ]
        return {
            "answers": said,
            "conflicts": [[one["id"] for one in among] for among in self._conflicts()],
        }

    def _report(self) -> dict[str, Any]:
        query, log = self._session.question(), self._session.log
        whole = query is not None and self._shown(query).exact
        now = datetime.now(UTC)
        title = printable(self._subject.words.title)
        facts = {"Person": self._session.who or "not named", **dict(self._subject.facts.of)}
        html = report_page(
            title,
            f"{now.day} {now:%B %Y, %H:%M} UTC",
            self._end(query is not None and not whole),
            self._answers()["answers"],
            waiting=whole,
            details=ReportDetails(
                log=None if log.path is None else printable(log.path.name),
                checksum=log.checksum,
                preamble=printable(self._subject.words.preamble),
                legend=legend_of(self._subject),
                facts={**facts, "Version": f"elicit-qlearn {version()}"},
                limits=self._limits(),
            ),
        )
        return {"html": html, "name": self._file_name("report", "html", now)}

    def _file_name(self, what: str, ending: str, now: datetime) -> str:
        words = re.findall(r"\w+", printable(self._subject.words.title).lower())
        return "-".join([*words, what, f"{now:%Y-%m-%d}"]) + f".{ending}"

    def _download(self, what: str, format: str) -> dict[str, Any]:
        if format not in ("csv", "json") or what not in ("scale", "policy", "answers"):
            raise ValueError("what is scale, policy or answers, and format csv or json")
        rows = self.table(what)
        text = as_csv(rows) if format == "csv" else as_json(rows)
        now = datetime.now(UTC)
        return {
            "text": text,
            "type": "text/csv" if format == "csv" else "application/json",
            "name": self._file_name(what, format, now),
        }

    def table(self, what: str) -> list[dict[str, Any]]:
        """Return a table to keep, as a list of rows: {column: value}.

        Parameters
        ----------
        what : {"scale", "policy", "answers"}

        Returns
        -------
        list of dict
        """
        if what == "answers":
            return [
                answer_row(number, entry, self._as_put(entry), self._sentence(entry))
                for number, entry in enumerate(self._session.log, 1)
            ]
        if what == "scale":
            return [
                {
                    "level": row["label"],
                    "value": round(row["value"], 2) if row["asked"] else None,
                    "low": row["low"],
                    "high": row["high"],
                    "asked": row["asked"],
                }
                for row in self._end(False)["scale"]
            ]
        found = self._concluded().result
        if found is None:
            return []
        return [dict(zip(found.columns, row, strict=True)) for row in found.rows]

    def _concluded(self) -> Conclusion:
        start = self._at_start()
        return self._subject.conclude(self._session.result(), None if start is None else start.loss)

    def _end(self, open_still: bool) -> dict[str, Any]:
        session, subject = self._session, self._subject
        status = session.status()
        asker = session.current_asker()
        known = asker.comparator if isinstance(asker, Compares) else None
        found = self._concluded()
        conduct = Conduct.of([*session.log])
        over = session.question() is None
        # who asked for more after the last question may stop at any time
        enough = over or (self._chosen.more and conduct.with_verdict >= subject.least)
        enough = enough and (conduct.passed or not conduct.differed)
        may_add = bool(subject.least) and session.makes_askers
        left = (not over and not open_still) or (may_add and self._level_question() is not None)
        caution = conduct.caution(at_end=True) if subject.least else None
        headline, after, said = found.headline, found.next, [*found.statements]
        start = self._at_start() if found.headline else None
        sure, before, changes = found.sure, found.before, found.changes
        if not conduct.with_verdict and start is not None and not start.finished:
            sure, changes = "", None  # there is nothing yet that could hold or change
            before = "" if start.loss is None else self._before(start.loss)
            headline = (
                "You have not said yet which is better, so nothing is known about your values."
            )
        elif found.settled and not enough and caution is None:
            headline = found.early or f"You stopped early. {found.headline}"
            after = "More answers would show whether this holds."
        elif found.headline and caution is not None:
            headline = "Do not rely on this result."
            after = "Take back what you do not mean, or answer more questions."
            if_meant = f"If every answer is meant as it was given: {found.headline} {found.sure}"
            said.append(if_meant.strip())
            sure = before = ""
        scale = (
            []
            if known is None
            else [row._asdict() for row in scale_rows(known, subject.labels, session.log)]
        )
        return {
            "headline": printable(headline),
            "sure": printable(sure),
            "next": printable(after),
            "before": printable(before),
            "caution": caution,
            "remarks": self._remarks() if subject.least else [],
            "settled": found.settled and caution is None and enough,
            "more": left,
            "finished": over,
            "open": f"There is no finer question in whole numbers. {subject.finer}".strip()
            if open_still
            else None,
            "scale": scale,
            "by_chance": conduct.by_chance if subject.least else "",
            "certainty": None if known is None else certainty(known),
            "statements": [
                *map(printable, said),
                *map(printable, subject.report(session.result())),
            ],
            "changes": None if changes is None else asdict(changes),
            "downloads": [
                *(["scale"] if scale else []),
                *(["policy"] if found.result is not None else []),
                "answers",
            ],
            "facts": [list(pair) for pair in subject.facts.of],
            "limits": self._limits(),
            "counts": {
                "answered": status.answered,
                "equal": status.equal,
                "cannot tell": status.cannot_tell,
                "unused": status.unused,
                "withdrawn": status.withdrawn,
                "repeated": status.repeated,
                "alike": status.alike,
            },
            "conflicts": self._conflicts(),
        }

    def _remarks(self) -> list[str]:
        """Return sentences on answers that came very fast, and on drift, as far as there were."""
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
                    "sentence": self._sentence(entry),
                }
                for entry in among
            ]
            for among in self._conflicts_found()
        ]

    def _drawn(self, shown: Shown, number: int) -> dict[str, Any]:
        rows = shown.rows
        return {
            "id": shown.id,
            "number": number,
            "heading": shown.sentences()[-1],
            "sentences": list(shown.sentences()[:-1]),
            "sides": [printable(f"{shown.words.side.capitalize()} {name}") for name in "AB"],
            "of": shown.of,
            "unit": printable(shown.words.unit),
            "levels": len(shown.labels),
            "labels": list(shown.labels),
            "icons": max((n for row in rows for n in (row.a, row.b)), default=0) <= MOST_ICONS,
            "rows": [row._asdict() for row in rows],
        }

    def _shown(self, query: Query) -> Shown:
        return shown_of(self._subject, query)

    def _sentence(self, entry: Entry) -> str:
        return self._shown(entry.answer.query).sentence(entry.answer.verdict)


def legend_of(subject: Subject) -> dict[str, Any]:
    """Return what the levels mean, best first, and how long they last."""
    words, labels = subject.words, subject.labels
    meanings = words.levels if len(words.levels) == len(labels) else ("",) * len(labels)
    levels = [
        {"label": printable(label), "level": level, "meaning": printable(meaning)}
        for level, (label, meaning) in enumerate(zip(labels, meanings, strict=True))
    ]
    return {"duration": printable(words.duration), "levels": levels[::-1]}


def shown_of(subject: Subject, query: Query) -> Shown:
    """Return a question as the person sees it."""
    return show(query, subject.words, subject.of, subject.seed, subject.labels)


def _in_words(shown: Shown) -> str:
    """Return both sides of a question in words, as they were shown."""
    a = ", ".join(f"{row.a:,} {row.label}" for row in shown.rows if row.a)
    b = ", ".join(f"{row.b:,} {row.label}" for row in shown.rows if row.b)
    return f"A: {a or 'nothing'}. B: {b or 'nothing'}. (Of {shown.of:,} {shown.words.unit}.)"
