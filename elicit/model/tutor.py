"""The Tutor protocol: whatever answers a query; and one that answers many at once."""

from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit.model.query import Answer, Query, as_verdict


@runtime_checkable
class Tutor(Protocol):
    """Answers queries.

    It sees only the query: no comparator, no learner, no problem. Any function from a Query to an
    Answer is one, whatever it calls the query.
    """

    def __call__(self, query: Query, /) -> Answer:
        """The answer to this query; its verdict is None where the tutor cannot tell."""


@runtime_checkable
class KnowsLevels(Tutor, Protocol):
    """One made for a number of levels, which has to be that of the questions."""

    @property
    def k(self) -> int:
        """Number of levels."""


@runtime_checkable
class TutorOfMany(Tutor, Protocol):
    """A tutor that can also answer many questions at once, without queries.

    Learners that ask millions make use of it.
    """

    def signs(self, d: ArrayLike) -> NDArray[np.int8]:
        """Return answers (n,) in {-1, 0, +1} to differences d (n, k).

        They are the same as to n queries in that order.
        """


@runtime_checkable
class CountsErrors(Tutor, Protocol):
    """A simulated one, which knows the truth and how often it did not tell it."""

    @property
    def realised_error_rate(self) -> float:
        """The share of its answers that were wrong; nan before the first."""


def answer_of(reply: Any, query: Query, who: str | None = None) -> Answer:
    """Return a tutor's reply as an Answer to the query, where it is a number.

    1, 0 and -1 are verdicts, also as floats: ``np.sign`` of a float is one. Whatever else is no
    number is returned as it is, for ``match`` to refuse.
    """
    whole = isinstance(reply, (float, np.floating)) and reply in (-1.0, 0.0, 1.0)
    if whole or isinstance(reply, (int, np.integer)):
        return Answer(query, as_verdict(int(reply) if whole else reply), who=who)
    return cast(Answer, reply)


def check_tutor_made(tutor: object, k: int) -> None:
    """Raise TypeError for anything but a tutor, such as the class of one.

    Raises ValueError for one who was made for another number of levels than k.
    """
    if isinstance(tutor, type):
        raise TypeError(
            f"a tutor is wanted, not the class {tutor.__name__}: make one, such as "
            "TruthfulTutor(values=[0, 5, 6, 10])"
        )
    if not callable(tutor):
        raise TypeError(f"a tutor takes a query and returns an Answer; {tutor!r} cannot be called")
    if isinstance(tutor, KnowsLevels) and tutor.k != k:
        raise ValueError(
            f"the questions are about {k} levels, but the tutor was made for {tutor.k}: {tutor!r}"
        )
