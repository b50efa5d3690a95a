"""Messages between learner, tutor and comparator: Verdict, Query, Answer, Answers, and errors."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from operator import index
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.validation import with_visible_controls
from elicit.model.difference import as_vectors
from elicit.model.pairs import whole_numbers
from elicit.model.scale import Floats, rounded_to_total

if TYPE_CHECKING:
    from elicit.model.answers_csv import File


class Verdict(IntEnum):
    """The outcome of a comparison of a left vector with a right one."""

    WORSE = -1
    EQUAL = 0
    BETTER = 1
    UNKNOWN = 2

    @property
    def flipped(self) -> Verdict:
        """The verdict after left and right are exchanged."""
        return self if self is Verdict.UNKNOWN else Verdict(-self)

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        wants_a_number = spec[-1:].isalpha() and spec[-1] != "s"
        return format(int(self) if wants_a_number else self.name, spec)


def as_verdict(code: Any) -> Verdict:
    """Return an answer's Verdict from its code -1, 0 or 1, an int of Python or NumPy.

    Raises TypeError and ValueError.
    """
    if isinstance(code, (bool, np.bool_)) or not isinstance(code, (int, np.integer)):
        raise TypeError(
            f"a verdict is Verdict.BETTER, WORSE or EQUAL (1, -1, 0), not {code!r}; a comparison "
            "of two numbers is written 1 if left > right else -1 if left < right else 0, and the "
            "answer of a tutor who cannot tell is elicit.Answer(query, None)"
        )
    if code not in (-1, 0, 1):
        raise ValueError(
            f"a verdict is 1 (left is better), -1 (right is) or 0 (equal), not {code!r}; of a pair "
            "that the tutor cannot tell apart, the answer is elicit.Answer(query, None)"
        )
    return Verdict(int(code))


def as_who(who: str | None) -> str | None:
    """Return the name of a person who answers, or None, after a check.

    Raises TypeError if it is neither text nor None, and ValueError for an empty name.
    """
    if who is not None and not isinstance(who, str):
        raise TypeError(f"who, the person who answers, must be a name, or None, not {who!r}")
    if who is not None and not who.strip():
        raise ValueError("who, the person who answers, must not be empty: give a name, or None")
    return who


class StaleAnswer(ValueError):
    """Error for an answer to no pending query: it was answered already, or is of another run."""


_Conflict: TypeAlias = tuple[str, tuple[tuple[int, str], ...], bool]


class InconsistentAnswers(ValueError):
    """Error raised if no scale satisfies the answers.

    Parameters
    ----------
    message : str or callable
        The sentence. Or a function that computes the sentence and the two other parts, called when
        one of them is first read: finding a minimal set can take long, and a learner that drops the
        latest answer needs none.
    answers : sequence of (row, id), optional
        A minimal contradictory set: drop any one of them and the rest are consistent.
    margin : bool, optional
        True if these answers would be consistent with a margin of zero.
    """

    def __init__(
        self,
        message: str | Callable[[], _Conflict],
        answers: Sequence[tuple[int, str]] = (),
        margin: bool = False,
    ) -> None:
        super().__init__()
        self._find = message if callable(message) else None
        self._found: _Conflict | None = None
        if not callable(message):
            self._found = message, tuple(answers), margin
            self.args = (message,)

    def _parts(self) -> _Conflict:
        if self._found is None and self._find is not None:
            message, answers, margin = self._find()
            self._found = message, tuple(answers), margin
            self.args = (message,)
        assert self._found is not None
        return self._found

    @property
    def answers(self) -> tuple[tuple[int, str], ...]:
        """A minimal contradictory set, as (row, id) pairs."""
        return self._parts()[1]

    @property
    def margin(self) -> bool:
        """True if these answers would be consistent with a margin of zero."""
        return self._parts()[2]

    def __str__(self) -> str:
        return self._parts()[0]

    def __repr__(self) -> str:
        return f"InconsistentAnswers({self._parts()[0]!r})"

    def __reduce__(self) -> tuple[type[InconsistentAnswers], _Conflict]:
        return InconsistentAnswers, self._parts()


@dataclass(frozen=True, eq=False)
class Query:
    """A question to the tutor: which of two share vectors (k,) is better, ``left`` or ``right``.

    ``print(query)`` shows the question as a person reads it.

    Parameters
    ----------
    id : str
        Names the query. An answer belongs to the pending query with its id.
    left, right : (k,)
        The two vectors, worst level first. They are kept as read-only floats.
    about : str
        A text for people, which stands above the two sides. Default: "", which shows a general
        question.
    labels : sequence of str, optional
        The k levels' names, worst first. None: levels go by number, and the worst is 1.
    who : str, optional
        The person to ask if there are several (``elicit.Panel``). None: anybody.

    Raises
    ------
    ValueError
        If the vectors are not finite or not of one shape (k,), if there are not k labels, or if
        ``who`` is empty.
    TypeError
        If ``who`` is neither a text nor None.
    """

    id: str
    left: Floats
    right: Floats
    about: str = ""
    labels: tuple[str, ...] | None = None
    who: str | None = None

    if TYPE_CHECKING:  # the types of arguments; the dataclass writes the method

        def __init__(
            self,
            id: str,
            left: ArrayLike,
            right: ArrayLike,
            about: str = "",
            labels: Sequence[str] | None = None,
            who: str | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        as_who(self.who)
        left, right = np.asarray(self.left, float), np.asarray(self.right, float)
        if left.ndim != 1 or left.shape != right.shape:
            raise ValueError(
                f"a query compares two vectors of shape (k,), not {left.shape} with {right.shape}"
            )
        pair = as_vectors(np.stack([left, right]), name="a query's vectors")
        pair.flags.writeable = False
        object.__setattr__(self, "left", pair[0])
        object.__setattr__(self, "right", pair[1])
        if self.labels is not None:
            names = tuple(self.labels)
            if isinstance(self.labels, str) or len(names) != len(left):
                raise ValueError(
                    f"labels must be {len(left)} names, one a level, not {self.labels!r}"
                )
            object.__setattr__(self, "labels", names)

    def __str__(self) -> str:
        """Return the question for people to read.

        Shares are in percent, and total 100 on each side. They are rounded to a tenth of the
        greatest difference or finer, so that sides that differ look different. Vectors that are no
        shares stay in their own unit. Without labels, levels go by number: the worst is 1.
        """
        both = np.stack([self.left, self.right])
        shares = bool((both >= 0).all() and (np.abs(both.sum(axis=1) - 1.0) <= 1e-9).all())
        unit, factor = ("%", 100.0) if shares else ("", 1.0)
        apart = factor * float(np.abs(self.d).max())
        digits = min(12, max(0, math.ceil(1.0 - math.log10(apart)))) if apart else 0
        names = self.labels or [f"level {i + 1}" for i in range(len(self.left))]
        names = [with_visible_controls(str(name)) for name in names]
        lines = [with_visible_controls(self.about) or "Which is better, left or right?"]
        for side, vector in (("left: ", self.left), ("right:", self.right)):
            shown = rounded_to_total(factor * vector, digits) if shares else vector
            said = [f"{share:.{digits}f}" for share in shown]
            parts = [f"{x}{unit} {name}" for x, name in zip(said, names, strict=True) if float(x)]
            lines.append(f"  {side} {', '.join(parts) or 'nothing'}")
        totals = self.left.sum(), self.right.sum()
        if abs(totals[0] - totals[1]) > 1e-9 * np.abs(both).sum():
            lines.append(
                f"  totals differ, {totals[0]:g} and {totals[1]:g}: {names[0]} is taken to be "
                "worth nothing"
            )
        return "\n".join(lines)

    @property
    def d(self) -> Floats:
        """The difference (k,) that the question is about, left minus right."""
        return self.left - self.right

    @staticmethod
    def make(
        fingerprint: str,
        number: int,
        left: ArrayLike,
        right: ArrayLike,
        about: str = "",
        labels: Sequence[str] | None = None,
        who: str | None = None,
    ) -> Query:
        """Return a query whose id is a hash of the problem, its running number and the vectors.

        Parameters
        ----------
        fingerprint : str
            Stands for the problem, such as ``OrdinalMDP.fingerprint``.
        number : int
            The query's running number.
        left, right : (k,)
            The two vectors, worst level first.
        about, labels, who
            As in ``Query``.

        Returns
        -------
        Query

        Raises
        ------
        ValueError, TypeError
            As in ``Query``.
        """
        return Query(query_id(fingerprint, number, left, right), left, right, about, labels, who)


def query_id(fingerprint: str, number: int, left: ArrayLike, right: ArrayLike) -> str:
    """Return the id of a query, as ``Query.make`` sets it."""
    vectors = (np.asarray(vector, dtype=np.float64).ravel() for vector in (left, right))
    return _hashed(fingerprint, number, *(_as_bytes(vector[None])[0] for vector in vectors))


def query_ids(fingerprint: str, first: int, left: Floats, right: Floats) -> list[str]:
    """Return the ids of queries about vectors left and right (n, k), numbered from ``first``."""
    pairs = enumerate(zip(_as_bytes(left), _as_bytes(right), strict=True), first)
    return [_hashed(fingerprint, number, *pair) for number, pair in pairs]


def _as_bytes(vectors: Floats) -> list[bytes]:
    """Return ``whole_numbers`` of each vector (n, k) as bytes, the same on every machine.

    The last bits of the vectors may differ on another machine.
    """
    numbers, exponents = whole_numbers(vectors)
    rows = zip(numbers.astype("<i8"), exponents.astype("<u2"), strict=True)
    return [row.tobytes() + exponent.tobytes() for row, exponent in rows]


def _hashed(fingerprint: str, number: int, left: bytes, right: bytes) -> str:
    """Return a hash of a problem's query by its vectors' bytes."""
    start = f"{fingerprint}/{number}".encode()
    return hashlib.blake2b(start + left + right, digest_size=8).hexdigest()


@dataclass(frozen=True)
class Answer:
    """A tutor's answer to a query: the verdict on ``query.left`` against ``query.right``.

    Parameters
    ----------
    query : Query
        The query that was asked.
    verdict : Verdict, {-1, 0, 1} or None
        Positive if left is better. None means "cannot tell".
    swapped : bool
        True if the person saw left and right exchanged. ``verdict`` is already flipped back.
        Default: False.
    who : str, optional
        The name or pseudonym of the person who answered. By default it is the query's; None if
        unknown.

    Raises
    ------
    TypeError
        If ``query`` is no Query, the verdict is no code, such as True or a float, or ``who`` is no
        text.
    ValueError
        If the verdict is another number, or ``who`` is empty.
    """

    query: Query
    verdict: Verdict | None
    swapped: bool = False
    who: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.query, Query):
            raise TypeError(
                f"an answer is to a Query, the one that was asked, not to {self.query!r}"
            )
        if self.verdict is not None:
            object.__setattr__(self, "verdict", as_verdict(self.verdict))
        object.__setattr__(self, "who", self.query.who if self.who is None else as_who(self.who))


@dataclass
class _Room:
    """Arrays with spare room behind the answers in them, so that adding one copies nothing."""

    d: Floats
    y: NDArray[np.int8]
    used: int = 0


class AnswerRow(NamedTuple):
    """A row of ``Answers``: the difference d (k,) = left - right, the verdict, and the id.

    ``Answers.who`` says who gave it.
    """

    d: Floats
    y: Verdict
    id: str


@dataclass(frozen=True, eq=False, repr=False)
class Answers:
    """The answers that comparators learn from, as arrays.

    ``answers[i]`` is an ``AnswerRow``, and a loop yields such rows. ``answers[i:j]`` are Answers
    again. The parameters are also the attributes, as read-only arrays and tuples.

    Parameters
    ----------
    d : (n, k)
        Differences left - right, a row for each answer. Without answers the shape is (0, k).
    y : (n,) int
        The verdicts -1, 0 or 1; 1 if left is better.
    ids : (n,) str, optional
        The id of each row. Default: its number, from "0" on.
    who : (n,) str or None, optional
        The name of the person who gave each answer, or None. Default: None for all.

    Raises
    ------
    ValueError
        If d is not finite or not (n, k), a verdict is another number, ``y``, ``ids`` or ``who``
        does not have n entries, or a name is empty.
    TypeError
        If a verdict is no int, such as True or a float, or a name is no text.
    """

    d: Floats
    y: NDArray[np.int8]
    ids: tuple[str, ...] = field(default=())
    who: tuple[str | None, ...] = field(default=())

    def __init__(
        self,
        d: ArrayLike,
        y: ArrayLike,
        ids: Sequence[str] | None = None,
        who: Sequence[str | None] | None = None,
    ) -> None:
        rows = as_vectors(d).copy() if np.size(d) else np.array(d, dtype=np.float64)
        if rows.ndim != 2:
            raise ValueError(
                f"no answers still need a shape: give d of shape (0, k), not {rows.shape}"
            )
        signs = np.atleast_1d(np.asarray(y))
        if signs.size and signs.dtype.kind not in "iu":
            as_verdict(
                next(
                    (code for code in signs.ravel().tolist() if type(code) is not int),
                    signs.flat[0],
                )
            )
        if signs.shape != (len(rows),):
            raise ValueError(
                f"y must have one entry a row of d: {len(rows)} rows, but y has shape {signs.shape}"
            )
        bad = (signs < -1) | (signs > 1)
        if bad.any():
            raise ValueError(
                f"y must be -1, 0 or +1, but row {int(np.argmax(bad))} is {signs[np.argmax(bad)]}"
            )
        names = tuple(str(i) for i in (ids if ids is not None else range(len(rows))))
        if len(names) != len(rows):
            raise ValueError(
                f"ids must have one entry a row of d: {len(rows)} rows, {len(names)} ids"
            )
        if isinstance(who, str) or (who is not None and len(who) != len(rows)):
            raise ValueError(
                f"who must have one name, or None, a row of d: {len(rows)} rows, but who is {who!r}"
            )
        people = (None,) * len(rows) if who is None else tuple(map(as_who, who))
        self._keep(rows, signs.astype(np.int8), names, people)

    def _keep(
        self,
        d: Floats,
        y: NDArray[np.int8],
        ids: tuple[str, ...],
        who: tuple[str | None, ...],
    ) -> Answers:
        """Set the attributes to these arrays, which are valid, without a copy; return self."""
        d.flags.writeable = y.flags.writeable = False
        for name, value in (("d", d), ("y", y), ("ids", ids), ("who", who)):
            object.__setattr__(self, name, value)
        return self

    @staticmethod
    def none(k: int) -> Answers:
        """Return empty Answers over k levels.

        Parameters
        ----------
        k : int
            Number of levels.

        Returns
        -------
        Answers
        """
        return Answers(np.empty((0, k)), np.empty(0, dtype=np.int8))

    @staticmethod
    def of(answers: Sequence[Answer], k: int) -> Answers:
        """Return a list of Answer objects as Answers, without those that have no verdict.

        "Cannot tell" teaches a comparator nothing.

        Parameters
        ----------
        answers : sequence of Answer
        k : int
            The number of levels that they are about.

        Returns
        -------
        Answers
            In the same order. Their ids are those of the queries.

        Raises
        ------
        ValueError
            If an answer with a verdict is about another number of levels.
        """
        told = [a for a in answers if a.verdict is not None]
        for query in (answer.query for answer in told):
            if len(query.left) != k:
                raise ValueError(
                    f"query {query.id} is about {len(query.left)} levels, but the answers are "
                    f"about {k}"
                )
        d = as_vectors(np.array([a.query.d for a in told]).reshape(len(told), k))
        y = np.array(
            [a.verdict for a in told], dtype=np.int8
        )  # an Answer's verdict is one of these
        ids, who = tuple(a.query.id for a in told), tuple(a.who for a in told)
        return object.__new__(Answers)._keep(d, y, ids, who)

    @staticmethod
    def from_csv(file: File, k: int | None = None) -> Answers:
        """Return the answers in a CSV file, in its order.

        The columns may come in any order and case. They are left_1, ..., left_k, right_1, ...,
        right_k and answer. Instead of left and right there may be d_1, ..., d_k, which is left -
        right. An optional column id names the rows, which are called "line 7" otherwise. An
        optional column who names the person who answered. Other columns and blank lines are
        ignored. An answer is -1, 0 or 1, or left, right, equal (better, worse), in terms of left.
        As with ``of``, rows without an answer (empty, none, null, "cannot tell") are left out.

        Parameters
        ----------
        file : path or text file
            A path, or text opened with ``newline=""``.
        k : int, optional
            The number of levels that there must be. None: any.

        Returns
        -------
        Answers
            The answers.

        Raises
        ------
        ValueError
            For a file of another form, also if there are not k levels. The message names the
            line and the column.
        OSError
            If the file cannot be read.
        """
        from elicit.model.answers_csv import read_csv

        return Answers(*read_csv(file, k))

    def to_csv(self, file: File) -> None:
        """Write the columns id, d_1, ..., d_k, answer to a file.

        If any row says who answered, there is a last column, ``who``. ``from_csv`` reads the file.

        Parameters
        ----------
        file : path or text file
            A path, or text that was opened for writing with ``newline=""``.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        from elicit.model.answers_csv import write_csv

        write_csv(file, self.d, self.y, self.ids, self.who)

    @property
    def k(self) -> int:
        """Number of levels."""
        return int(self.d.shape[1])

    def __len__(self) -> int:
        return len(self.d)

    def __add__(self, other: Answers) -> Answers:
        if other.k != self.k:
            raise ValueError(f"these answers are about {other.k} levels, not {self.k}")
        # The parts are valid, so checking the whole again would only cost time. A sum keeps room
        # behind its rows, which the next sum fills if it comes first: to add answers one by one
        # takes time in proportion to them, not squared.
        n, m = len(self), len(other)
        room: _Room | None = self.__dict__.get("_room")
        if room is None or room.used != n or n + m > len(room.d):
            room = _Room(np.empty((2 * (n + m), self.k)), np.empty(2 * (n + m), np.int8))
            room.d[:n], room.y[:n] = self.d, self.y
        room.d[n : n + m], room.y[n : n + m], room.used = other.d, other.y, n + m
        ids, who = self.ids + other.ids, self.who + other.who
        both = object.__new__(Answers)._keep(room.d[: n + m], room.y[: n + m], ids, who)
        object.__setattr__(both, "_room", room)
        return both

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_room"}

    @overload
    def __getitem__(self, rows: SupportsIndex) -> AnswerRow: ...

    @overload
    def __getitem__(self, rows: slice) -> Answers: ...

    def __getitem__(self, rows: SupportsIndex | slice) -> AnswerRow | Answers:
        if isinstance(rows, slice):
            return Answers(self.d[rows], self.y[rows], self.ids[rows], self.who[rows])
        row = index(rows)
        if not -len(self) <= row < len(self):
            raise IndexError(f"there is no answer {row}: there are {len(self)}, counted from 0")
        return AnswerRow(self.d[row], Verdict(int(self.y[row])), self.ids[row])

    def __iter__(self) -> Iterator[AnswerRow]:
        return (self[row] for row in range(len(self)))

    def __repr__(self) -> str:
        return f"Answers({len(self)} answers, k={self.k})"

    def without(self, ids: Iterable[str], who: str | None = None) -> Answers:
        """Return the answers, in the same order, without all rows that have one of these ids.

        Parameters
        ----------
        ids : iterable of str
            The ids to leave out.
        who : str, optional
            If several people answered the question of an id, only this person's answers are left
            out. None: those of all people.

        Returns
        -------
        Answers

        Raises
        ------
        ValueError
            For an id that no row has.
        TypeError
            For a bare string in place of several ids.
        """
        if isinstance(ids, str):
            raise TypeError(f"without takes several ids: put the one id into a list, [{ids!r}]")
        out = {str(name) for name in ids}
        own = [row for row, name in enumerate(self.who) if who is None or name == who]
        if unknown := ", ".join(map(repr, sorted(out.difference(self.ids[row] for row in own)))):
            reason = (
                "it was left out already, or belongs to another problem; `ids` lists those that "
                "are here"
            )
            whose = "" if who is None else f" of {who!r}"
            raise ValueError(f"no answer{whose} here has the id {unknown}: {reason}")
        gone = {row for row in own if self.ids[row] in out}
        return self.take([row for row in range(len(self)) if row not in gone])

    def take(self, rows: Sequence[int]) -> Answers:
        """Return the answers in these rows, in this order.

        Parameters
        ----------
        rows : sequence of int
            Row numbers, counted from 0.

        Returns
        -------
        Answers
        """
        ids, who = [self.ids[row] for row in rows], [self.who[row] for row in rows]
        return Answers(self.d[list(rows)], self.y[list(rows)], ids, who)

    def of_person(self, who: str | None) -> Answers:
        """Return the answers of a person, in their order.

        Parameters
        ----------
        who : str or None
            The person's name. None: the answers that name nobody.

        Returns
        -------
        Answers
        """
        return self.take([row for row, name in enumerate(self.who) if name == who])


def match(answers: Sequence[Answer], pending: Sequence[Query]) -> tuple[Answer, ...]:
    """Return the answers as a tuple, after a check that each is to another pending query.

    Raises TypeError for anything but Answers. Raises StaleAnswer for an unknown id, for vectors
    other than the query's, and for two answers to the same query.
    """
    if isinstance(answers, Answer):
        raise TypeError("tell takes a sequence of answers: put the one Answer into a list")
    told = tuple(answers)  # a generator can be read only once
    waiting = {query.id: query for query in pending}
    seen: set[str] = set()
    for answer in told:
        if not isinstance(answer, Answer):
            raise TypeError(
                f"{answer!r} is no answer: give elicit.Answer(query, verdict), or "
                "elicit.Answer(query, None) if the tutor cannot tell. A function given to "
                "qlearn.solve or drive may return 1 (left is better), -1 (right is) or 0 (equal): "
                "1 if left > right else -1 if left < right else 0"
            )
        name = answer.query.id
        if name in seen:
            raise StaleAnswer(f"two answers to one pending query: {name!r}")
        if name not in waiting:
            raise StaleAnswer(
                f"no pending query has the id {name!r}: it was answered already or belongs to "
                "another run; answer "
                "what ask() returns now"
            )
        asked = waiting[name]
        told_of = answer.query
        if told_of is not asked and not (
            np.array_equal(asked.left, told_of.left) and np.array_equal(asked.right, told_of.right)
        ):
            raise StaleAnswer(
                f"the answer with the id {name!r} is about other vectors than the pending query of "
                "that id; answer the "
                "very query that ask() returned (were its numbers rounded on the way?)"
            )
        seen.add(name)
    return told
