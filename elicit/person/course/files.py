"""Tables to keep, as CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from elicit.person.course.conduct import choice_of
from elicit.tutors.answer_log import Entry

_FORMULA = ("=", "+", "-", "@", "\t")  # with which a spreadsheet begins a formula


class ShowsCounts(Protocol):
    """A question as it is shown."""

    @property
    def as_seen(self) -> tuple[str, str, str]:
        """Both sides in words, and what they have in common."""

    def record(self) -> dict[str, Any]:
        """Return its counts."""


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows of the same columns as CSV, with a header.

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
    number: int | None, entry: Entry, shown: ShowsCounts, sentence: str
) -> dict[str, Any]:
    """Return an answer as a row of a table: the question as it was shown, and all its counts.

    Parameters
    ----------
    number : int or None
        Of the answer, from 1. None if it was taken back.
    entry : Entry
    shown : Shown
    sentence : str
        The answer in words.

    Returns
    -------
    dict
    """
    counts = shown.record()
    seen_a, seen_b, same = shown.as_seen
    return {
        "number": number,
        "time": entry.metadata.get("time"),
        "who": entry.answer.who,
        "a": " ".join(map(str, counts["a"])),
        "b": " ".join(map(str, counts["b"])),
        "of": counts["of"],
        "unit": counts["unit"],
        "shown_a": seen_a,
        "shown_b": seen_b,
        "same_in_both": same,
        "chosen": choice_of(entry.answer),
        "sentence": sentence,
        "seconds": entry.metadata.get("latency"),
        "used": entry.used,
        "withdrawn": entry.retracted,
        "repeat": entry.repeat,
        "id": entry.answer.query.id,
    }


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        value = value.replace("\r", " ")  # which ends a line where it is read
        return f"'{value}" if value.startswith(_FORMULA) else value
    return "" if value is None else value
