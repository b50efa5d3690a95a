"""Answers in a CSV file, as columns of numbers.

``Answers.from_csv`` reads them, and ``Answers.to_csv`` writes them.
"""

import csv
import math
import os
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Literal, NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from elicit.model.scale import Floats

WORDS = {"left": 1, "better": 1, "right": -1, "worse": -1, "equal": 0}
NO_ANSWER = ("", "cannot tell", "none", "null")
_LEVEL = re.compile(r"(left|right|d)_([0-9]+)")

File = str | os.PathLike[str] | TextIO


class AnswerColumns(NamedTuple):
    """The contents of a CSV file of answers: d (n, k), y (n,), and each row's id and person."""

    d: Floats
    y: NDArray[np.int8]
    ids: list[str]
    who: list[str | None]


def read_csv(file: File, k: int | None = None) -> AnswerColumns:
    """Read the answers in a CSV file, as ``Answers.from_csv`` describes it."""
    with _opened(file, "r") as text:
        name = str(getattr(text, "name", "the file"))
        # spreadsheets put a byte order mark at the beginning
        rows = csv.reader(
            (line.removeprefix("\ufeff" * (i == 0)) for i, line in enumerate(text)), strict=True
        )
        try:
            header = next((cells for cells in rows if any(map(str.strip, cells))), [])
            if not header:
                raise ValueError(f"{name} is empty: its first line must name the columns")
            names = [cell.strip().lower() for cell in header]
            levels = _level_columns(names, k, f"line {rows.line_num} of {name}")
            told: list[tuple[list[float], int, str, str | None]] = []
            for cells in rows:
                where = f"line {rows.line_num} of {name}"
                if not any(map(str.strip, cells)):
                    continue
                if len(cells) != len(names):
                    raise ValueError(
                        f"{where} has {len(cells)} cells, but the header has {len(names)} columns"
                    )
                verdict = _verdict(cells[names.index("answer")], where)
                if verdict is not None:
                    numbers = [
                        [_number(cells[i], names[i], where) for i in columns] for columns in levels
                    ]
                    row = (
                        numbers[0]
                        if len(numbers) == 1
                        else [a - b for a, b in zip(*numbers, strict=True)]
                    )
                    told.append(
                        (
                            row,
                            verdict,
                            cells[names.index("id")] if "id" in names else f"line {rows.line_num}",
                            (cells[names.index("who")].strip() or None) if "who" in names else None,
                        )
                    )
        except csv.Error as error:
            raise ValueError(f"line {rows.line_num} of {name} is no CSV: {error}") from None
        except UnicodeDecodeError as error:
            raise ValueError(f"{name} is not in UTF-8 ({error}): save it as such") from None
    d = np.array([row[0] for row in told], dtype=np.float64).reshape(len(told), len(levels[0]))
    y = np.array([row[1] for row in told], dtype=np.int8)
    return AnswerColumns(d, y, [row[2] for row in told], [row[3] for row in told])


def write_csv(
    file: File,
    d: Floats,
    y: NDArray[np.int8],
    ids: Sequence[str],
    who: Sequence[str | None],
) -> None:
    """Write the columns id, d_1, ..., d_k and answer, and the column who if any row names a person.

    Python writes floats so that reading gives the same number to the last bit.
    """
    named = any(name is not None for name in who)
    with _opened(file, "w") as text:
        rows = csv.writer(text)
        levels = [f"d_{i + 1}" for i in range(d.shape[1])]
        rows.writerow(["id", *levels, "answer", *(["who"] if named else [])])
        for name, row, sign, person in zip(ids, d.tolist(), y.tolist(), who, strict=True):
            rows.writerow([name, *map(repr, row), sign, *([person or ""] if named else [])])


def _level_columns(names: list[str], k: int | None, where: str) -> list[list[int]]:
    """Return the column numbers of d_1, ..., d_k.

    If there are none, return those of left_1, ..., left_k and of right_1, ..., right_k.
    """
    if twice := sorted({name for name in names if name and names.count(name) > 1}):
        raise ValueError(f"{where} names the column {twice[0]!r} twice")
    found = [match for match in map(_LEVEL.fullmatch, names) if match]
    kinds = {match[1] for match in found}
    if not kinds or ("d" in kinds and len(kinds) > 1) or "answer" not in names:
        raise ValueError(
            f"{where} must name the columns left_1, ..., left_k, right_1, ..., right_k, answer, or "
            "else d_1, ..., d_k, "
            f"answer, separated by commas; it names {', '.join(names)}"
        )
    for match in found:
        if match[2].startswith("0"):
            raise ValueError(
                f"{where} names the column {match[0]!r}: levels are counted 1, 2, ..., the worst "
                "being 1"
            )
    most = max(int(match[2]) for match in found)
    if k not in (None, most):
        raise ValueError(f"{where} has columns for {most} levels, not k = {k}")
    sides = ("d",) if "d" in kinds else ("left", "right")
    for name in (f"{side}_{level}" for side in sides for level in range(1, max(most, 2) + 1)):
        if name not in names:
            raise ValueError(f"{where} lacks the column {name!r}; it names {', '.join(names)}")
    return [[names.index(f"{side}_{level}") for level in range(1, most + 1)] for side in sides]


def _verdict(cell: str, where: str) -> int | None:
    word = cell.strip().lower()
    if word in NO_ANSWER:
        return None
    try:
        number = float(
            WORDS.get(word, word)
        )  # a column of whole numbers with holes is often written as 1.0
    except ValueError:
        number = math.nan
    if number not in (-1, 0, 1):
        raise ValueError(
            f"{where}, column 'answer': {cell!r} is none of -1, 0, 1, {', '.join(WORDS)}; where "
            "the tutor could not "
            'tell, leave it empty or say "cannot tell"'
        )
    return int(number)


def _number(cell: str, column: str, where: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        raise ValueError(f"{where}, column {column!r}: {cell!r} is no number") from None
    if not math.isfinite(number):
        raise ValueError(f"{where}, column {column!r}: {cell!r} is not finite")
    return number


def _opened(file: File, mode: Literal["r", "w"]) -> AbstractContextManager[TextIO]:
    """Return the file opened as text. A file that the caller has opened stays open afterwards."""
    if isinstance(file, (str, os.PathLike)):
        return open(file, mode, encoding="utf-8", newline="")
    return nullcontext(file)
