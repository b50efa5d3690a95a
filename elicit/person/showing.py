"""The subject of an interview in words, and a question as a person is shown it, in whole numbers.

``show`` turns a ``Query`` into a ``Shown``: the counts of two sides A and B, which of them is the
query's left, and whether the counts are the query itself or rounded. It shows nothing that is not
asked. ``Shown.text`` writes it for a terminal. Other hosts draw its rows.
"""

import hashlib
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from elicit._support.validation import is_list, is_whole, require
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats
from elicit.person.course.conclusion import Conclusion, NearlyEnough, ResultTable, SessionFacts

Choice: TypeAlias = Literal["a", "b", "equal", "cannot tell"]

NARROWEST = 30
"""Least number of columns that a text needs."""

_FIVE = 5
MOST_ICONS = 50
"""With more icons in a row people cannot count them at a glance. Then only the numbers are
shown."""
_MOST = 1000  # largest total of whole numbers that a query is looked for in
_ROUNDED = (100, 1_000, 10_000, 100_000, 1_000_000)
_FINE = 0.1  # largest change by rounding, as a share of the greatest difference


@dataclass(frozen=True)
class Words:
    """Words in which an interview speaks of a problem's outcomes.

    Attributes
    ----------
    unit
        The thing counted, in the plural.
    verb
        The verb of the unit, as in "975 of 1,000 patients fare the same".
    side
        A number of units together, as in "Two groups of 10 patients", "Group A".
    question
        The question about two sides.
    title, preamble
        Texts shown before the first question.
    duration
        A sentence on how long an outcome lasts.
    levels
        What each of the k levels means, worst first; none if their names say it.
    purpose
        A sentence on what the answers are for.
    note
        A text beside every result, such as "Not medical advice."
    loss
        A loss in the problem's own unit, as a clause that follows "as much as it would matter to
        you if", such as "{n} patients died instead of recovering". "{n}" stands for a text such as
        "3.8 in 100".
    source
        Where the problem's figures come from, as words that follow "The figures come from", such as
        "the 2019 hip registry".
    ends
        What becomes of a unit that ends at each of the k levels, worst first, as words that follow
        a number of units, such as "die". "" for a level at which nothing ends. With them the result
        of a plan says how many end so.
    """

    unit: str = "days"
    verb: str = "are"
    title: str = ""
    preamble: str = ""
    question: str = "which would you rather have?"
    side: str = "group"
    duration: str = ""
    levels: tuple[str, ...] = ()
    purpose: str = ""
    note: str = ""
    loss: str = ""
    source: str = ""
    ends: tuple[str, ...] = ()

    @property
    def source_sentence(self) -> str:
        """A sentence on where the figures come from, or ""."""
        source = self.source.strip().rstrip(".")
        return f"The figures come from {source}." if source else ""


def _no_more(_: Any) -> list[str]:
    return []


def _unsaid(_: Any) -> None:
    return None


def _nothing_is_near(_: Any, before: float | None) -> None:
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
    enough_is_slow : bool
        True if ``enough`` may take seconds. Then it is asked only once the asker has no question.
    nearly : callable
        Takes what ``conclude`` takes. Returns a statement that little could be lost by stopping,
        although questions are left, or None. The interview then offers to stop.
    source : str
        A sentence on where the figures of the problem come from, or "".
    offered : ResultTable, optional
        The alternatives that there are to choose among, with their outcomes. The welcome shows it.
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
    enough_is_slow: bool = False
    nearly: Callable[[Any, float | None], NearlyEnough | None] = field(
        default=_nothing_is_near, repr=False
    )
    source: str = ""
    offered: ResultTable | None = None


class Row(NamedTuple):
    """The numbers of outcomes of side A and side B at a level, 0 the worst.

    Attributes
    ----------
    label : str
        The level's name.
    level : int
        The level's number.
    a, b : int
        The numbers of outcomes on side A and on side B, without those that both sides have.
    """

    label: str
    level: int
    a: int
    b: int


@dataclass(frozen=True)
class Shown:
    """A query as it is shown.

    Attributes
    ----------
    id : str
        The query's id.
    left, right : (k,) int
        Counts, worst level first, of equal totals.
    labels : (k,) str
        The levels' names, worst first.
    words : Words
        The words in which the question is put.
    scale : float
        The number that divides the counts to give the query's vectors.
    exact : bool
        True if they then equal those vectors to the last bit, and False if they are rounded.
    swapped : bool
        True if side A is the query's right.
    """

    id: str
    left: tuple[int, ...]
    right: tuple[int, ...]
    labels: tuple[str, ...]
    words: Words
    scale: float
    exact: bool
    swapped: bool

    @property
    def of(self) -> int:
        """The number of outcomes on either side."""
        return sum(self.left)

    @property
    def common(self) -> tuple[int, ...]:
        """The counts (k,) that both sides have; ``rows`` leaves them out."""
        return tuple(min(pair) for pair in zip(self.left, self.right, strict=True))

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows beside ``common``, best level first, without levels that have no outcomes."""
        sides = (self.right, self.left) if self.swapped else (self.left, self.right)
        every = zip(self.labels, range(len(self.labels)), *sides, self.common, strict=True)
        rows = [Row(label, level, a - both, b - both) for label, level, a, b, both in every]
        return tuple(row for row in reversed(rows) if row.a or row.b)

    @property
    def as_seen(self) -> tuple[str, str, str]:
        """Both sides as they are on the screen, and the part that they have in common, in words."""
        common = zip(self.labels, self.common, strict=True)
        sides = (
            [(row.a, row.label) for row in self.rows],
            [(row.b, row.label) for row in self.rows],
            [(n, label) for label, n in reversed([*common])],
        )
        a, b, same = (", ".join(f"{n:,} {label}" for n, label in side if n) for side in sides)
        return a or "nothing", b or "nothing", same

    def sentence(self, verdict: Verdict | None) -> str:
        """Return an answer in words: "10 moderate rather than 4 recovered and 6 died".

        Parameters
        ----------
        verdict : Verdict or None
            The verdict on the query's left. None: cannot tell.

        Returns
        -------
        str
        """
        said = []
        for side in (self.left, self.right):
            rest = [n - both for n, both in zip(side, self.common, strict=True)]
            parts = [f"{n:,} {label}" for n, label in zip(rest, self.labels, strict=True) if n]
            said.append(" and ".join(reversed(parts)) or "nothing")
        if verdict is None:
            return f"cannot tell {said[0]} from {said[1]}"
        if verdict is Verdict.EQUAL:
            return f"{said[0]} as good as {said[1]}"
        return " rather than ".join(said if verdict is Verdict.BETTER else reversed(said))

    @property
    def vectors(self) -> tuple[Floats, Floats]:
        """The left and the right vector (k,) as shown: the query's own, if ``exact``."""
        return np.array(self.left) / self.scale, np.array(self.right) / self.scale

    def verdict(self, choice: Choice) -> Verdict | None:
        """Return the verdict on the query's left that a choice stands for; None is "cannot tell".

        Parameters
        ----------
        choice : {"a", "b", "equal", "cannot tell"}

        Returns
        -------
        Verdict or None

        Raises
        ------
        ValueError
            For any other choice.
        """
        require(
            choice in ("a", "b", "equal", "cannot tell"),
            "choice",
            "'a', 'b', 'equal' or 'cannot tell'",
            choice,
        )
        if choice == "cannot tell":
            return None
        if choice == "equal":
            return Verdict.EQUAL
        return Verdict.BETTER if (choice == "a") != self.swapped else Verdict.WORSE

    def record(self) -> dict[str, Any]:
        """Return the counts on the screen, as JSON for a log.

        Returns
        -------
        dict
            The counts of both sides, worst level first, as "a" and "b"; their total as "of"; the
            "unit"; and "exact".
        """
        a, b = (self.right, self.left) if self.swapped else (self.left, self.right)
        return {
            "a": list(a),
            "b": list(b),
            "of": self.of,
            "unit": self.words.unit,
            "exact": self.exact,
        }

    def text(self, width: int = 80) -> str:
        """Return the question in plain text.

        The two sides are beside each other, or one above the other if the width is too small for
        that. "+" is one outcome at the best level, "x" at the worst, "o" between.

        Parameters
        ----------
        width : int
            Largest number of columns.

        Returns
        -------
        str

        Raises
        ------
        ValueError
            Below ``NARROWEST`` columns.
        """
        wanted = f"a whole number of columns, at least {NARROWEST}"
        require(is_whole(width, NARROWEST), "width", wanted, width)
        lines: list[str] = []
        for sentence in self.sentences():
            lines += textwrap.wrap(sentence, width)
        return "\n".join([*lines, "", *self._table(width)])

    def sentences(self) -> tuple[str, ...]:
        """Return the sentences in front of the sides.

        Returns
        -------
        tuple of str
        """
        unit, verb, side, same = self.words.unit, self.words.verb, self.words.side, sum(self.common)
        asked = f"Two {side}s of {self.of:,} {unit}: {self.words.question}"
        said = []
        if same:
            parts = [
                f"{n:,} {label}" for label, n in zip(self.labels, self.common, strict=True) if n
            ]
            rest = f" The other {self.of - same:,} are shown." if same < self.of else ""
            said.append(
                f"{same:,} of {self.of:,} {unit} {verb} the same in both {side}s: "
                f"{', '.join(reversed(parts))}.{rest}"
            )
        if not self.exact:
            said.append(
                f"(Rounded to whole {unit}: what your answer is taken for is a little finer.)"
            )
        if same == self.of:
            differ = "are the same" if self.exact else f"differ by less than 1 in {self.of:,}"
            asked = f"The two {side}s {differ}: {self.words.question}"
        return tuple(map(printable, [*said, asked]))

    def _table(self, width: int) -> Iterator[str]:
        rows = self.rows
        counts = [n for row in rows for n in (row.a, row.b)]
        number = max((len(f"{n:,}") for n in counts), default=1)
        longest = max((len(row.label) for row in rows), default=1)
        icons = max(counts, default=0) <= MOST_ICONS
        # the width includes an indent of 2, 2 after the label, 3 between the sides, and 1 after
        # each number
        label = min(longest, 20)
        room = (width - 2 - label - 2 - 3) // 2 - number - 1
        if room >= 2 * _FIVE + 1:
            room = min(room, 4 * (_FIVE + 1) - 1)
            yield f"  {'':{label}}  {'A':>{number}} {'':{room}}   {'B':>{number}}"
            for row in rows:
                yield from _row(
                    row, (row.a, row.b), len(self.labels), label, number, room if icons else 0, room
                )
            return
        label = min(longest, width - 2 - 2 - number - 1 - (2 * _FIVE + 1))
        room = 2 * _FIVE + 1
        for name in ("A", "B"):
            yield name
            for row in rows:
                yield from _row(
                    row,
                    (row.b if name == "B" else row.a,),
                    len(self.labels),
                    label,
                    number,
                    room if icons else 0,
                    room,
                )


def show(
    query: Query,
    words: Words = Words(),
    of: int = 10,
    seed: int = 0,
    labels: Sequence[str] | None = None,
) -> Shown:
    """Return a query in whole numbers.

    Shares are counted out of ``of`` if that is exact, else out of 10, of 100, or of the least
    number up to 1,000 that is. Vectors that are whole already are taken as they are. If no such
    number is exact, the counts are rounded, to the same totals, out of so many that no difference
    changes by more than a tenth of the greatest. They are then not ``exact``.

    Parameters
    ----------
    query : Query
    words : Words
    of : int
        Number of outcomes on a side.
    seed : int
        With the query's id it decides which side is A.
    labels : (k,) str, optional
        Names of the levels, worst first, if the query has none.

    Returns
    -------
    Shown

    Raises
    ------
    ValueError
        If the two totals differ, or a number is below 0: such vectors are no counts.
    """
    require(is_whole(of, 1), "of, how many are shown a side,", "a whole number of at least 1", of)
    both = np.stack([query.left, query.right])
    total = float(both[0].sum())
    if (both < 0).any() or total <= 0 or abs(both[1].sum() - total) > 1e-9 * total:
        raise ValueError(
            "only two vectors of the same total, and no number below 0, can be shown as counts, "
            f"not {query.left} and "
            f"{query.right} (query {query.id})"
        )
    scale, counts, exact = _whole(both, of, shares=abs(total - 1.0) <= 1e-9)
    names = query.labels or labels or [f"level {i + 1}" for i in range(both.shape[1])]
    require(is_list(names, both.shape[1]), "labels", f"{both.shape[1]} names, one a level", labels)
    digest = hashlib.blake2b(f"{seed}/{query.id}".encode(), digest_size=1).digest()
    left, right = (tuple(int(n) for n in side) for side in counts)
    return Shown(
        query.id,
        left,
        right,
        tuple(map(printable, names)),
        words,
        scale,
        exact,
        bool(digest[0] & 1),
    )


def practice(labels: Sequence[str], words: Words = Words(), of: int = 10, seed: int = 0) -> Shown:
    """Return a practice question, for the person to try the keys with.

    One side has all outcomes at the best level, which is the query's left, and the other all at the
    worst.

    Parameters
    ----------
    labels : (k,) str
        Names of the levels, worst first.
    words : Words
    of : int
        Number of outcomes on a side.
    seed : int
        Decides which side is A.

    Returns
    -------
    Shown
    """
    ends = np.eye(len(labels))[[-1, 0]]
    return show(Query(f"practice/{seed}", ends[0], ends[1], labels=labels), words, of, seed)


def shown_of(subject: Subject, query: Query) -> Shown:
    """Return a question as the person sees it."""
    return show(query, subject.words, subject.of, subject.seed, subject.labels)


def said_of(subject: Subject, answer: Answer) -> str:
    """Return an answer in words, as ``Shown.sentence`` has it."""
    return shown_of(subject, answer.query).sentence(answer.verdict)


def drawn(shown: Shown, number: int) -> dict[str, Any]:
    """Return a question as JSON for a front end, which draws it.

    Parameters
    ----------
    shown : Shown
    number : int
        Of the question, from 1; 0 for one that is not counted.
    """
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


def about_questions(words: Words) -> str:
    """Return what every question asked, and the text that stood before the first one."""
    asked = (
        f"Each question showed two {words.side}s of {words.unit}: {words.question} The answer was "
        "to be given as if the decision were one's own to make."
    )
    return printable(f"{asked} {words.preamble}".strip())


def legend_of(subject: Subject) -> dict[str, Any]:
    """Return what the levels mean, best first, and how long they last."""
    words, labels = subject.words, subject.labels
    meanings = words.levels if len(words.levels) == len(labels) else ("",) * len(labels)
    levels = [
        {"label": printable(label), "level": level, "meaning": printable(meaning)}
        for level, (label, meaning) in enumerate(zip(labels, meanings, strict=True))
    ]
    return {"duration": printable(words.duration), "levels": levels[::-1]}


def near_in_whole_numbers(query: Query) -> Iterator[Query]:
    """Return queries near a query of shares that ``show`` shows exactly.

    They are out of 100, 1,000, ..., 1,000,000, as far as no difference changes by more than a tenth
    of the greatest. The number is at the end of the id. For other vectors there are none.

    Parameters
    ----------
    query : Query

    Returns
    -------
    iterator of Query
    """
    both = np.stack([query.left, query.right])
    if (both < 0).any() or (np.abs(both.sum(axis=1) - 1.0) > 1e-9).any():
        return
    for whole in _ROUNDED:
        counts = _rounded(both, whole)
        if _fine(both, counts, float(whole)):
            yield replace(
                query, id=f"{query.id} of {whole}", left=counts[0] / whole, right=counts[1] / whole
            )


def _whole(both: Floats, of: int, shares: bool) -> tuple[float, Floats, bool]:
    """Return a factor, the counts (2, k) that it makes of vectors (2, k), and if they are exact."""
    for scale in (of if shares else 1, 10, 100, *range(1, _MOST + 1), *_ROUNDED):
        counts = np.rint(both * scale)
        if (counts / scale == both).all() and counts[0].sum() == counts[1].sum():
            return float(scale), counts, True
    for whole in _ROUNDED:
        factor, counts = whole / float(both[0].sum()), _rounded(both, whole)
        if _fine(both, counts, factor):
            break
    return factor, counts, False


def _rounded(both: Floats, whole: int) -> Floats:
    """Return counts (2, k) of this total, in proportion to the vectors (2, k)."""
    return np.stack([_to_total(vector * (whole / vector.sum()), whole) for vector in both])


def _fine(both: Floats, counts: Floats, factor: float) -> bool:
    """Return whether counts divided by a factor have about the differences of the vectors."""
    d = both[0] - both[1]
    return bool(np.abs((counts[0] - counts[1]) / factor - d).max() <= _FINE * np.abs(d).max())


def _to_total(parts: Floats, total: int) -> Floats:
    """Return whole numbers (k,) of this total, by the largest remainders."""
    counts = np.floor(parts)
    missing = total - int(counts.sum())
    counts[np.argsort(counts - parts, kind="stable")[:missing]] += 1
    return counts


def _row(
    row: Row, counts: Sequence[int], k: int, label: int, number: int, room: int, column: int
) -> Iterator[str]:
    """Return the lines of text that show a level: its name, and its ``counts`` with icons.

    ``label``, ``number`` and ``column`` are the widths of the name, of a count and of its icons.
    ``room`` is the width that the icons of a line may take; 0: no icons.
    """
    icon = "+" if row.level == k - 1 else "x" if row.level == 0 else "o"
    names = textwrap.wrap(row.label, label) or [""]
    icons = [_in_fives(icon * n, room) if room else [] for n in counts]
    for i in range(max(len(names), *map(len, icons))):
        cells = [
            f"{f'{n:,}' if i == 0 else '':>{number}} {mine[i] if i < len(mine) else '':{column}}"
            for n, mine in zip(counts, icons, strict=True)
        ]
        yield f"  {names[i] if i < len(names) else '':{label}}  {'   '.join(cells)}".rstrip()


def _in_fives(icons: str, room: int) -> list[str]:
    """Return icons in groups of five, in lines of at most ``room`` columns."""
    fives = [icons[i : i + _FIVE] for i in range(0, len(icons), _FIVE)]
    a_line = (room + 1) // (_FIVE + 1)
    return [" ".join(fives[i : i + a_line]) for i in range(0, len(fives), a_line)]


def printable(text: str) -> str:
    """Return a name with spaces in place of terminal controls, such as escapes and line feeds.

    Parameters
    ----------
    text : str
        The name, such as one that a person typed.

    Returns
    -------
    str
        A text of the same length, in which every character can be printed.
    """
    return "".join(letter if letter.isprintable() else " " for letter in text)
