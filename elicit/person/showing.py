"""A question as a person is shown it: whole numbers, nothing that is not asked, in the words of the problem.

``show`` turns a ``Query`` into a ``Shown``: the counts of two sides A and B, which of them is the query's left, and
whether the counts are the query itself or rounded. ``Shown.text`` writes it for a terminal; other hosts draw its rows.
"""

import hashlib
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from elicit._support.validation import is_list, is_whole, require
from elicit.model.query import Query, Verdict
from elicit.model.scale import Floats

Choice: TypeAlias = Literal["a", "b", "equal", "cannot tell"]

NARROWEST = 30
"""Columns that a text needs at least."""

_FIVE = 5
MOST_ICONS = 50
"""More in a row are not counted at a glance: then the numbers stand alone."""
_MOST = 1000  # of so many at most a query is looked for in whole numbers
_ROUNDED = (100, 1_000, 10_000, 100_000, 1_000_000)
_FINE = 0.1  # of the greatest difference: what rounding may change


@dataclass(frozen=True)
class Words:
    """Words in which a problem speaks of its outcomes.

    unit: what is counted, in the plural. verb: what the unit does, as in "975 of 1,000 patients fare the same". side: a
    number of units together, as in "Two groups of 10 patients", "Group A". question: what is asked about two sides.
    title and preamble: shown before the first question."""

    unit: str = "days"
    verb: str = "are"
    title: str = ""
    preamble: str = ""
    question: str = "which would you rather have?"
    side: str = "group"


class Row(NamedTuple):
    """The numbers of outcomes of side A and side B at a level, 0 the worst."""

    label: str
    level: int
    a: int
    b: int


@dataclass(frozen=True)
class Shown:
    """A query as it is shown. left, right: k counts each, worst level first, of equal totals; scale: what they are
    divided by to be the query's vectors; exact: whether they then are those vectors to the last bit, or rounded;
    swapped: whether side A is the query's right."""

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
        """The counts (k) that both sides have; ``rows`` leaves them out."""
        return tuple(min(pair) for pair in zip(self.left, self.right, strict=True))

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows beside ``common``, best level first, without levels that have no outcomes."""
        sides = (self.right, self.left) if self.swapped else (self.left, self.right)
        every = zip(self.labels, range(len(self.labels)), *sides, self.common, strict=True)
        rows = [Row(label, level, a - both, b - both) for label, level, a, b, both in every]
        return tuple(row for row in reversed(rows) if row.a or row.b)

    def sentence(self, verdict: Verdict | None) -> str:
        """Return the answer in words: "10 moderate rather than 4 recovered and 6 died"."""
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
        """Return the verdict on the query's left that a choice stands for; None is "cannot tell". Raises ValueError."""
        require(choice in ("a", "b", "equal", "cannot tell"), "choice", "'a', 'b', 'equal' or 'cannot tell'", choice)
        if choice == "cannot tell":
            return None
        if choice == "equal":
            return Verdict.EQUAL
        return Verdict.BETTER if (choice == "a") != self.swapped else Verdict.WORSE

    def record(self) -> dict[str, Any]:
        """Return what was shown, as JSON for a log."""
        a, b = (self.right, self.left) if self.swapped else (self.left, self.right)
        return {"a": list(a), "b": list(b), "of": self.of, "unit": self.words.unit, "exact": self.exact}

    def text(self, width: int = 80) -> str:
        """The question in plain text, in at most so many columns: two sides beside each other, or one above the other
        where that is too narrow. "+" is one at the best level, "x" at the worst, "o" between. Raises ValueError below
        ``NARROWEST`` columns."""
        wanted = f"a whole number of columns, at least {NARROWEST}"
        require(is_whole(width, NARROWEST), "width", wanted, width)
        lines: list[str] = []
        for sentence in self.sentences():
            lines += textwrap.wrap(sentence, width)
        return "\n".join([*lines, "", *self._table(width)])

    def sentences(self) -> tuple[str, ...]:
        """The sentences in front of the sides."""
        unit, verb, side, same = self.words.unit, self.words.verb, self.words.side, sum(self.common)
        asked = f"Two {side}s of {self.of:,} {unit}: {self.words.question}"
        said = []
        if same:
            parts = [f"{n:,} {label}" for label, n in zip(self.labels, self.common, strict=True) if n]
            rest = f" The other {self.of - same:,} are shown." if same < self.of else ""
            said.append(
                f"{same:,} of {self.of:,} {unit} {verb} the same in both {side}s: {', '.join(reversed(parts))}.{rest}"
            )
        if not self.exact:
            said.append(f"(Rounded to whole {unit}: what your answer is taken for is a little finer.)")
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
        # of the width go: an indent of 2, 2 after the label, 3 between the sides, and 1 after each number
        label = min(longest, 20)
        room = (width - 2 - label - 2 - 3) // 2 - number - 1
        if room >= 2 * _FIVE + 1:
            room = min(room, 4 * (_FIVE + 1) - 1)
            yield f"  {'':{label}}  {'A':>{number}} {'':{room}}   {'B':>{number}}"
            for row in rows:
                yield from _row(row, (row.a, row.b), len(self.labels), label, number, room if icons else 0, room)
            return
        label = min(longest, width - 2 - 2 - number - 1 - (2 * _FIVE + 1))
        room = 2 * _FIVE + 1
        for name in ("A", "B"):
            yield name
            for row in rows:
                yield from _row(
                    row, (row.b if name == "B" else row.a,), len(self.labels), label, number, room if icons else 0, room
                )


def show(
    query: Query, words: Words = Words(), of: int = 10, seed: int = 0, labels: Sequence[str] | None = None
) -> Shown:
    """A query in whole numbers. Shares are counted out of ``of`` where that is exact, else out of 10, of 100, or of the
    least number up to 1,000 that is; vectors that are whole already are taken as they are. What no such number gives is
    rounded, to the same totals, out of so many that no difference changes by more than a tenth of the greatest, and
    not ``exact``. ``seed`` and the query's id decide which side is A. ``labels``: the k levels' names, worst first,
    where the query has none. Raises ValueError where the two totals differ, or a number is below 0: such are no counts.
    """
    require(is_whole(of, 1), "of, how many are shown a side,", "a whole number of at least 1", of)
    both = np.stack([query.left, query.right])
    total = float(both[0].sum())
    if (both < 0).any() or total <= 0 or abs(both[1].sum() - total) > 1e-9 * total:
        raise ValueError(
            f"only two vectors of the same total, and no number below 0, can be shown as counts, not {query.left} and "
            f"{query.right} (query {query.id})"
        )
    scale, counts, exact = _whole(both, of, shares=abs(total - 1.0) <= 1e-9)
    names = query.labels or labels or [f"level {i + 1}" for i in range(both.shape[1])]
    require(is_list(names, both.shape[1]), "labels", f"{both.shape[1]} names, one a level", labels)
    digest = hashlib.blake2b(f"{seed}/{query.id}".encode(), digest_size=1).digest()
    left, right = (tuple(int(n) for n in side) for side in counts)
    return Shown(query.id, left, right, tuple(map(printable, names)), words, scale, exact, bool(digest[0] & 1))


def practice(labels: Sequence[str], words: Words = Words(), of: int = 10, seed: int = 0) -> Shown:
    """A question to try the keys with, about k labels, worst first: all at the best level, which is the query's left,
    or all at the worst."""
    ends = np.eye(len(labels))[[-1, 0]]
    return show(Query(f"practice/{seed}", ends[0], ends[1], labels=labels), words, of, seed)


def near_in_whole_numbers(query: Query) -> Iterator[Query]:
    """Queries near one of shares that ``show`` shows exactly: out of 100, 1,000, ..., 1,000,000, as far as no
    difference changes by more than a tenth of the greatest. The number is at the end of the id. Of other vectors there
    are none."""
    both = np.stack([query.left, query.right])
    if (both < 0).any() or (np.abs(both.sum(axis=1) - 1.0) > 1e-9).any():
        return
    for whole in _ROUNDED:
        counts = _rounded(both, whole)
        if _fine(both, counts, float(whole)):
            yield replace(query, id=f"{query.id} of {whole}", left=counts[0] / whole, right=counts[1] / whole)


def _whole(both: Floats, of: int, shares: bool) -> tuple[float, Floats, bool]:
    """Return the factor from vectors (2, k) to counts, the counts (2, k), and whether they are exact."""
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
    """Counts (2, k) of this total, in proportion to the vectors (2, k)."""
    return np.stack([_to_total(vector * (whole / vector.sum()), whole) for vector in both])


def _fine(both: Floats, counts: Floats, factor: float) -> bool:
    """Return whether counts divided by a factor have about the differences of the vectors."""
    d = both[0] - both[1]
    return bool(np.abs((counts[0] - counts[1]) / factor - d).max() <= _FINE * np.abs(d).max())


def _to_total(parts: Floats, total: int) -> Floats:
    """Whole numbers (k,) of this total, by the largest remainders."""
    counts = np.floor(parts)
    missing = total - int(counts.sum())
    counts[np.argsort(counts - parts, kind="stable")[:missing]] += 1
    return counts


def _row(row: Row, counts: Sequence[int], k: int, label: int, number: int, room: int, column: int) -> Iterator[str]:
    """The lines of a level, with as many icons a line as have ``room``, in columns of this width."""
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
    """Icons in groups of five, in lines of at most ``room`` columns."""
    fives = [icons[i : i + _FIVE] for i in range(0, len(icons), _FIVE)]
    a_line = (room + 1) // (_FIVE + 1)
    return [" ".join(fives[i : i + a_line]) for i in range(0, len(fives), a_line)]


def printable(text: str) -> str:
    """A name without what would steer a terminal, such as escapes and line feeds: spaces in their place."""
    return "".join(letter if letter.isprintable() else " " for letter in text)
