"""The Tutor protocol, of anything that answers a query; and tutors that answer many at once."""

from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit.model.query import Answer, Query, as_verdict


@runtime_checkable
class Tutor(Protocol):
    """Anything that answers queries.

    A tutor sees only the query: no comparator, no learner, no problem. Any function from a Query to
    an Answer is a tutor, whatever the name of its argument.
    """

    def __call__(self, query: Query, /) -> Answer:
        """Return the answer to this query.

        Parameters
        ----------
        query : Query
            The question.

        Returns
        -------
        Answer
            Its verdict is None if the tutor cannot tell.
        """


@runtime_checkable
class KnowsLevels(Tutor, Protocol):
    """A tutor for a fixed number of levels, which must be that of the questions."""

    @property
    def k(self) -> int:
        """Number of levels."""


@runtime_checkable
class TutorOfMany(Tutor, Protocol):
    """A tutor that can also answer many questions at once, without Query objects.

    Learners that ask millions of questions use it.
    """

    def signs(self, d: ArrayLike) -> NDArray[np.int8]:
        """Return answers (n,) in {-1, 0, +1} to questions about differences d (n, k).

        They are the same as to n queries in that order.
        """


@runtime_checkable
class CountsErrors(Tutor, Protocol):
    """A simulated tutor, which knows the true scale and counts its own wrong answers."""

    @property
    def realised_error_rate(self) -> float:
        """The share of the tutor's answers that were wrong; nan before the first."""


def answer_of(reply: Any, query: Query, who: str | None = None) -> Answer:
    """Return a tutor's reply as an Answer to the query, if the reply is a number.

    1, 0 and -1 are verdicts, also as floats, such as those of ``np.sign``. Any other reply is
    returned as it is. ``match`` refuses it if it is not an Answer.
    """
    whole = isinstance(reply, (float, np.floating)) and reply in (-1.0, 0.0, 1.0)
    if whole or isinstance(reply, (int, np.integer)):
        return Answer(query, as_verdict(int(reply) if whole else reply), who=who)
    return cast(Answer, reply)


def check_tutor_made(tutor: object, k: int) -> None:
    """Raise TypeError unless the object is a tutor. A tutor's class is not.

    Raises ValueError if the tutor is for another number of levels than k.
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
