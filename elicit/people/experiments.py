"""Tables of real people's choices, loaded as answer logs, a log for each person.

Each loader names the experiment and where its numbers are. A table whose licence lets it be shipped
is in ``data/``. Any other table is read from a path.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.seeds import seed_of
from elicit.model.query import Answer, Query, Verdict
from elicit.people.lotteries import knots_of, shares_over
from elicit.tutors.answer_log import AnswerLog

Path_ = str | os.PathLike[str]
_SHIPPED = Path(__file__).with_name("data") / "gambles_20_times.csv"
_ORDER = name_code("order of answers that are only counted")
_COUNTS = ("participant", "set", "left", "right", "left_better", "right_better", "indifferent")
_ANSWERS = ("subject", "question", "rank", "a_on_top", "preferred")
_QUESTIONS = "lotteries_questions.csv"
_CHOICES = "lotteries_answers.csv"

GAMBLES: Mapping[int, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        1: {
            "a": (7 / 24, 28.0),
            "b": (8 / 24, 26.6),
            "c": (9 / 24, 25.2),
            "d": (10 / 24, 23.8),
            "e": (11 / 24, 22.4),
        },
        2: {
            "a": (0.28, 31.43),
            "b": (0.32, 27.5),
            "c": (0.36, 24.44),
            "d": (0.4, 22.0),
            "e": (0.44, 20.0),
        },
    }
)
"""The gambles of Regenwetter, Dana and Davis-Stober (2011): by set and name, the chance and the
prize in dollars; else nothing. Those of set 1 are Tversky's (1969) times 5.6. Those of set 2 have
equal expected values, $8.80. The numbers are quoted and agree with both facts; they were not
checked against the printed table."""

_GAMBLES_SOURCE = (
    "Regenwetter, Dana and Davis-Stober (2011), doi 10.1037/a0021150, or Regenwetter and "
    "Davis-Stober (2012), doi 10.1037/a0027372"
)
_LOTTERIES_SOURCE = "Baillon, Bleichrodt and Spinu (2020), Management Science 66(1), 93-112"


def repeated_gambles(
    path: Path_ | None = None, sets: Sequence[int] = (1, 2), seed: Seed | None = 0
) -> dict[str, AnswerLog]:
    """Return the answers of people who were asked about the same pairs of gambles many times.

    A gamble wins one prize or nothing. The levels are nothing and the prizes of the sets, so every
    gamble is a share vector without any approximation.

    Parameters
    ----------
    path : str or path, optional
        A table with the columns participant, set, left, right, left_better, right_better,
        indifferent, and a row for each pair. None: the shipped table, 18 people who answered each
        pair 20 times (Regenwetter, Dana and Davis-Stober 2011; indifference was not offered). The
        table of Regenwetter and Davis-Stober (2012), 30 people who answered 45 times and could say
        "indifferent", is the data set ``regenwetter2012`` of the R package multinomineq (GPL-3). It
        is not shipped, and has to be written in these columns.
    sets : sequence of int
        Sets of gambles, of ``GAMBLES``. Set 3 has no levels, because its prizes have no agreed
        order.
    seed : int, SeedSequence, Generator or None
        Draws the order of the answers: the tables only count them, without their times.

    Returns
    -------
    dict of str to AnswerLog
        By participant. "Indifferent" is EQUAL. The header has the labels, the amounts of the
        levels, and the source. The tables do not say which side was shown left.

    Raises
    ------
    ValueError
        If the table has other columns or gambles, or a count is no whole number.
    OSError
        If it cannot be read.
    """
    unknown = [each for each in sets if each not in GAMBLES]
    if unknown or not sets:
        raise ValueError(
            f"sets of gambles with levels are {', '.join(map(str, GAMBLES))}, not {tuple(sets)!r}"
        )
    chosen = {number: GAMBLES[number] for number in sets}
    knots = (0.0, *sorted({prize for gambles in chosen.values() for _, prize in gambles.values()}))
    shares = {
        (number, name): shares_over(knots, [0.0, prize], [1.0 - chance, chance])
        for number, gambles in chosen.items()
        for name, (chance, prize) in gambles.items()
    }
    labels, key = _labels(knots), key_of(seed_of(seed))
    found: dict[str, list[Answer]] = {}
    for line, row in _rows(_SHIPPED if path is None else Path(path), _COUNTS):
        who, number = row["participant"], _whole(row["set"], line)
        answers = found.setdefault(who, [])
        if number not in chosen:
            continue
        sides = (number, row["left"]), (number, row["right"])
        if not set(sides) <= shares.keys() or sides[0] == sides[1]:
            raise ValueError(
                f"{line}: there is no pair {row['left']!r}, {row['right']!r} in set {number}"
            )
        counts = [_whole(row[column], line) for column in _COUNTS[4:]]
        verdicts = np.repeat([Verdict.BETTER, Verdict.WORSE, Verdict.EQUAL], counts)
        for repeat, verdict in enumerate(verdicts.tolist(), 1):
            name = f"{number}:{row['left']}{row['right']}:{repeat}"
            answers.append(
                Answer(Query(name, shares[sides[0]], shares[sides[1]]), Verdict(verdict))
            )
    header = {"labels": labels, "amounts": knots, "source": _GAMBLES_SOURCE}
    logs = {}
    for number, (who, answers) in enumerate(found.items()):
        if answers:
            rng = np.random.Generator(np.random.PCG64(int(fold(key, _ORDER, number))))
            logs[who] = _log(
                (answers[i] for i in rng.permutation(len(answers))), len(knots), header
            )
    return logs


def lottery_choices(
    folder: Path_, levels: int = 6, knots: Sequence[float] | None = None
) -> dict[str, AnswerLog]:
    """Return 139 people's answers to 70 questions about pairs of lotteries.

    Five pairs were put twice, as two questions, the others once. The lotteries pay up to four
    amounts of money. An amount between two knots is split between them; see
    ``elicit.people.lotteries``.

    Parameters
    ----------
    folder : str or path
        Holds ``lotteries_questions.csv`` and ``lotteries_answers.csv``, made from the data of
        Baillon, Bleichrodt and Spinu (2020), https://github.com/vspinu/reference-point. That
        repository states no licence, so its numbers are not shipped.
    levels : int
        Number of levels, chosen among the amounts by ``knots_of``.
    knots : sequence of float, optional
        The amounts of the levels, instead of ``levels``.

    Returns
    -------
    dict of str to AnswerLog
        By subject, in the order in which the person answered. The left of a query is lottery a of
        the table; ``swapped`` says that b was shown first. Ids are "question 1" and so on.

    Raises
    ------
    FileNotFoundError
        If a table is missing. The message says where the numbers are.
    ValueError
        If a table has other columns or values.
    """
    place = Path(folder)
    for name in (_QUESTIONS, _CHOICES):
        if not (place / name).is_file():
            raise FileNotFoundError(
                f"there is no {name} in {place}. The choices of "
                f"{_LOTTERIES_SOURCE}, are not shipped, for they come without a licence: get "
                "them from https://github.com/vspinu/reference-point, write the two tables that "
                "docs/people.md describes, and give their folder"
            )
    lotteries = {}
    for line, row in _rows(place / _QUESTIONS, ("Choice", *_columns("a"), *_columns("b"))):
        lotteries[row["Choice"]] = _lottery(row, "a", line), _lottery(row, "b", line)
    paid = [x for pair in lotteries.values() for amounts, _ in pair for x in amounts]
    at = knots_of(paid, levels) if knots is None else tuple(float(x) for x in knots)
    labels = _labels(at)
    queries = {
        name: Query(f"question {name}", shares_over(at, *a), shares_over(at, *b))
        for name, (a, b) in lotteries.items()
    }
    found: dict[str, list[tuple[int, Answer]]] = {}
    for line, row in _rows(place / _CHOICES, _ANSWERS):
        if row["question"] not in queries:
            raise ValueError(f"{line}: {_QUESTIONS} has no question {row['question']!r}")
        if row["preferred"] not in ("a", "b") or row["a_on_top"] not in ("0", "1"):
            raise ValueError(f"{line}: preferred must be a or b, and a_on_top 0 or 1, not {row}")
        verdict = Verdict.BETTER if row["preferred"] == "a" else Verdict.WORSE
        answer = Answer(queries[row["question"]], verdict, swapped=row["a_on_top"] == "0")
        found.setdefault(row["subject"], []).append((_whole(row["rank"], line), answer))
    header = {"labels": labels, "amounts": at, "source": _LOTTERIES_SOURCE}
    return {
        who: _log(
            (answer for _, answer in sorted(answers, key=lambda item: item[0])), len(at), header
        )
        for who, answers in found.items()
    }


def _log(answers: Iterable[Answer], k: int, header: Mapping[str, object]) -> AnswerLog:
    """Return the answers as a log in memory."""
    log = AnswerLog(k=k, header=header)
    for answer in answers:
        log.append(answer)
    return log


def _labels(knots: Iterable[float]) -> tuple[str, ...]:
    """Return amounts as names of levels."""
    return tuple(f"{amount:g}" for amount in knots)


def _columns(side: str) -> tuple[str, ...]:
    """Return the names of a lottery's columns: first the amounts, then the probabilities."""
    return tuple(f"{what}{i}{side}" for what in "xp" for i in range(1, 5))


def _lottery(row: Mapping[str, str], side: str, line: str) -> tuple[list[float], list[float]]:
    """Return the amounts and probabilities of a row's lottery, without probabilities of 0."""
    amounts, chances = [], []
    for i in range(1, 5):
        amount, chance = (_number(row[f"{what}{i}{side}"], line) for what in "xp")
        if chance:
            amounts.append(amount)
            chances.append(chance)
    return amounts, chances


def _rows(path: Path, columns: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield each row of a table, with its place in the file for messages."""
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = [name for name in columns if name not in (reader.fieldnames or ())]
        if missing:
            raise ValueError(f"{path} has no column {', '.join(missing)}")
        for row in reader:
            line = f"{path.name}, line {reader.line_num}"
            if any(row[name] is None for name in columns):
                raise ValueError(f"{line}: the row has too few fields")
            yield line, row


def _number(text: str, line: str) -> float:
    """Return a number; an empty field is 0."""
    try:
        value = float(text or 0)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise ValueError(f"{line}: {text!r} is not a number")
    return value


def _whole(text: str, line: str) -> int:
    """Return a whole number of at least 0."""
    if not text.isdecimal():
        raise ValueError(f"{line}: {text!r} is not a whole number of at least 0")
    return int(text)
