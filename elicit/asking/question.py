"""A pair to ask about, and the records of it when pending, answered or audited."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from elicit.model.comparator import Tier
from elicit.model.query import Query, Verdict
from elicit.model.scale import Floats

Place: TypeAlias = tuple[Hashable, ...]
"""The place where a pair is compared, such as a state and two of its actions. The pair's vectors
may still change a little there. A place has several names. One is the sentence that asks about the
pair, because a log keeps it. Another is the same sentence with left and right exchanged."""


class Pair(NamedTuple):
    """Two vectors (k,) to ask about, a text for people, and the place where they are compared.

    A ``tier`` other than TUTOR marks an audit: the answers had decided the pair by that tier.
    ``who`` is the person to ask. If it is None, a comparator of several people chooses one.
    """

    left: Floats
    right: Floats
    about: str
    place: Place = ()
    tier: int = int(Tier.TUTOR)
    who: str | None = None


class Pending(NamedTuple):
    """A pending query, its pair, and for an audit the verdict that the answers imply."""

    query: Query
    pair: Pair
    expected: Verdict | None


class AnsweredQuery(NamedTuple):
    """An answered query, and the verdict to act on."""

    pending: Pending
    verdict: Verdict


@dataclass(frozen=True)
class Audit:
    """A comparison that the answers had decided, put to the tutor all the same to find errors.

    Attributes
    ----------
    query : Query
        The question.
    expected : Verdict
        The verdict that the answers so far imply.
    answer : Verdict or None
        The tutor's verdict. None: the tutor cannot tell.
    """

    query: Query
    expected: Verdict
    answer: Verdict | None

    @property
    def contradicts(self) -> bool:
        """True if the tutor said the opposite of what the answers imply."""
        return self.answer is not None and self.expected * self.answer == -1
