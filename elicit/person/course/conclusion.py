"""The conclusion of an interview: a headline with what is at stake, and tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple


@dataclass(frozen=True)
class ResultTable:
    """A table that can be folded and filtered.

    Attributes
    ----------
    title, note
        Texts above the table. Each line of ``note`` is a paragraph.
    columns
        The heads of the columns.
    rows
        The cells of each row, as texts.
    of, several
        What a row is about, in the singular, and in the plural. If ``several`` is "", the plural is
        ``of`` with an s.
    open
        A table of further rows that do not hold for certain, if there are any.
    unfolded
        True if the table stands open on the screen.
    marked, mark
        The number of the row that is marked, or None, and the word that marks it.
    """

    title: str
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    note: str = ""
    of: str = "state"
    open: ResultTable | None = None
    unfolded: bool = False
    several: str = ""
    marked: int | None = None
    mark: str = ""


class DataTable(NamedTuple):
    """A table to download, whose numbers stay numbers.

    Attributes
    ----------
    title : str
        The one name that screens and files give the table, such as "Plan".
    columns : tuple of str
        The heads of the columns.
    rows : tuple of tuple
        The cells of each row: texts, numbers, or None for a cell without a value.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float | None, ...], ...]


@dataclass(frozen=True)
class Conclusion:
    """Conclusions in words.

    Attributes
    ----------
    headline
        The conclusion, in a sentence or two.
    reason
        Why that is so, and by how much, as far as it holds for every plausible scale; "" if there
        is nothing to say of it.
    effect
        What the result does, in numbers such as how many of 1,000 patients recover; "" if there is
        nothing to say of it.
    size
        How much the loss in the headline is, in the problem's own unit; "" if unknown.
    sure
        How sure it is.
    next
        What to do now.
    more
        What more answers would do; it follows ``next`` if there is a question left.
    before
        What could be lost before the first answer; "" if unknown.
    statements
        Further sentences. An indented one is an item under the one before.
    changes
        What the answers change, as far as it holds for every plausible scale.
    plan
        The action in every state, as a table.
    result
        The result as a table to download.
    outcomes
        The numbers in ``effect`` as a table to download, or None.
    settled
        True if at most the tolerance can still be lost.
    early
        The headline in place of ``headline`` if it is settled, but the person stopped before there
        were enough answers and checks.
    """

    headline: str = ""
    reason: str = ""
    effect: str = ""
    size: str = ""
    sure: str = ""
    next: str = ""
    more: str = ""
    before: str = ""
    statements: tuple[str, ...] = ()
    changes: ResultTable | None = None
    plan: ResultTable | None = None
    result: DataTable | ResultTable | None = None
    outcomes: DataTable | None = None
    settled: bool = False
    early: str = ""


class NearlyEnough(NamedTuple):
    """A statement that little could be lost by stopping, although questions are left.

    ``heading`` has no full stop. ``text`` and ``size`` are sentences: how little it is and how sure
    that is, and how much this is in the problem's own unit.
    """

    heading: str
    text: str
    size: str


@dataclass(frozen=True)
class SessionFacts:
    """Facts about a session that its report names, as pairs of a name and a value.

    Attributes
    ----------
    of
        Such as ("Tolerance", "1 in 100").
    limits
        Sentences on what the result does not say.
    """

    of: tuple[tuple[str, str], ...] = ()
    limits: tuple[str, ...] = field(default=())


NO_LOSS = 1e-5
"""A loss below this share of the value range is shown as none: the least loss that
``per_hundred`` has a number for.
"""


def with_probability(confidence: float | None) -> str:
    """Return how sure a bound is, as "with 95% probability", or "" if there is no such number.

    There is none for a bound that is proven (1), and for one whose confidence is not known (None or
    nan).
    """
    if confidence is None or not 0.0 < confidence < 1.0:
        return ""
    return f"with {confidence:.0%} probability"


def up_to(loss: float, confidence: float | None) -> str:
    """Return the most that could be lost as a text: "up to 5 in 100 (with 95% probability)".

    How sure that is, is left out if there is no such number.
    """
    sure = with_probability(confidence)
    return f"up to {per_hundred(loss)}{f' ({sure})' if sure else ''}"


def capital(clause: str) -> str:
    """Return a clause with a capital letter at its start."""
    return f"{clause[0].upper()}{clause[1:]}"


def in_plural(noun: str) -> str:
    """Return the plural of an English noun that forms it as most nouns do.

    Examples
    --------
    >>> [in_plural(noun) for noun in ("treatment", "therapy", "dish", "day")]
    ['treatments', 'therapies', 'dishes', 'days']
    """
    if noun.endswith(("s", "x", "z", "ch", "sh")):
        return f"{noun}es"
    if noun.endswith("y") and noun[-2:-1] not in "aeiou":
        return f"{noun[:-1]}ies"
    return f"{noun}s"


def listed(names: Sequence[str]) -> str:
    """Return names in a sentence: "a, b and c"."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def per_hundred(share: float) -> str:
    """Return a share of the value range as a text such as "3.8 in 100".

    It has two digits, rounded up so that it is still a bound. The least number above 0 is 0.001.

    Parameters
    ----------
    share : float
        At least 0.

    Returns
    -------
    str
    """
    hundred = 100.0 * share
    if not hundred > 0:
        return "0 in 100"
    hundred = max(hundred, 100.0 * NO_LOSS)
    digits = max(0, 1 - math.floor(math.log10(hundred)))
    up = math.ceil(hundred * 10**digits - 1e-9) / 10**digits
    return f"{up:g} in 100"


def in_unit(share: float, unit: str, labels: Sequence[str], own: str = "") -> str:
    """Return a loss in the problem's own unit, as a text that follows "it loses at most".

    It is a comparison ("as if"), because a loss of value is no forecast of outcomes.

    Parameters
    ----------
    share : float
        A share of the value range.
    unit : str
        The thing counted, in the plural.
    labels : (k,) str
        Names of the levels, worst first.
    own : str
        The problem's own clause, in which "{n}" stands for a text such as "3.8 in 100".

    Returns
    -------
    str
        Such as "as much as if 3.8 in 100 days were at “worst” instead of “best”".
    """
    clause = own or f"{{n}} {unit} were at “{labels[0]}” instead of “{labels[-1]}”"
    return f"as much as if {clause.replace('{n}', per_hundred(share))}"
