"""Tables to keep, as CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from elicit.person.course.conduct import choice_of, was_settled
from elicit.person.course.counts import status_of
from elicit.tutors.answer_log import Entry

_FORMULA = ("=", "+", "-", "@", "\t")  # with which a spreadsheet begins a formula


class ShowsCounts(Protocol):
    """Protocol of a question as it is shown, with counts."""

    @property
    def labels(self) -> Sequence[str]:
        """Names of the levels, worst first."""

    @property
    def as_seen(self) -> tuple[str, str, str]:
        """Both sides in words, and what they have in common."""

    def record(self) -> dict[str, Any]:
        """Return the counts as JSON."""


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows, all with the same columns, as CSV with a header.

    A text that a spreadsheet would take for a formula gets an apostrophe in front.

    Parameters
    ----------
    rows : sequence of {column: value}

    Returns
    -------
    str
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if rows:
        writer.writerow(rows[0])
    for row in rows:
        writer.writerow([_cell(value) for value in row.values()])
    return text.getvalue()


def as_json(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as a JSON list of objects."""
    return json.dumps([dict(row) for row in rows], indent=2, ensure_ascii=False) + "\n"


def answer_row(
    number: int,
    entry: Entry,
    shown: ShowsCounts,
    sentence: str,
    in_conflict: bool = False,
) -> dict[str, Any]:
    """Return an answer as a row of a table: the question as it was shown, and all its counts.

    The counts have a column for each side and level, best level first, such as ``a: well``.

    Parameters
    ----------
    number : int
        Of the question, from 1.
    entry : Entry
    shown : Shown
    sentence : str
        The answer in words.
    in_conflict : bool
        True if the answer contradicts others.

    Returns
    -------
    dict
    """
    counts = shown.record()
    seen_a, seen_b, same = shown.as_seen
    best_first = [*enumerate(shown.labels)][::-1]
    by_level = {f"{side}: {label}": counts[side][i] for side in "ab" for i, label in best_first}
    return {
        "number": number,
        "time": entry.metadata.get("time"),
        "who": entry.answer.who,
        **by_level,
        "of": counts["of"],
        "unit": counts["unit"],
        "shown_a": seen_a,
        "shown_b": seen_b,
        "same_in_both": same,
        "chosen": choice_of(entry.answer),
        "sentence": sentence,
        "seconds": entry.metadata.get("latency"),
        "status": status_of(entry),
        "used": use_of(entry, in_conflict),
        "taken_back": status_of(entry) == "taken back",
        "repeat": entry.repeat,
        "id": entry.answer.query.id,
    }


def use_of(entry: Entry, in_conflict: bool = False) -> str:
    """Return whether comparators learn an answer, and if not, why, as text.

    Parameters
    ----------
    entry : Entry
    in_conflict : bool
        True if the answer contradicts others.

    Returns
    -------
    str
        Begins with "yes", "no" or "check".
    """
    if entry.repeat and was_settled(entry) and status_of(entry) == "agrees":
        return "check: it differed from the first answer, and is what was meant"
    return {
        "taken back": "no: taken back",
        "not kept": "no: not kept, another answer counts",
        "agrees": "check: it agrees, so it confirms the answer that is learned from",
        "differs": "check: it differs from the first answer, which is the one learned from",
        "checks the order": "yes, as a check of the order of the levels",
        "cannot tell": "no: it says cannot tell",
        "ignored": "no: it contradicts others",
        "learned from": "yes, though it contradicts others" if in_conflict else "yes",
    }[status_of(entry)]


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        value = value.replace("\r", " ")  # which ends a line where it is read
        return f"'{value}" if value.startswith(_FORMULA) else value
    return "" if value is None else value
