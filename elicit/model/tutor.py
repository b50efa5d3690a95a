"""The Tutor protocol: whatever answers a query; and one that answers many at once."""

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit.model.query import Answer, Query


@runtime_checkable
class Tutor(Protocol):
    """Answers queries. It sees only the query: no comparator, no learner, no problem. Any function from a Query to an
    Answer is one, whatever it calls the query."""

    def __call__(self, query: Query, /) -> Answer:
        """The answer to this query; its verdict is None where the tutor cannot tell."""


@runtime_checkable
class TutorOfMany(Tutor, Protocol):
    """One that can also answer many questions at once, without queries: learners that ask millions make use of it."""

    def signs(self, d: ArrayLike) -> NDArray[np.int8]:
        """Answers (n,) in {-1, 0, +1} to differences d (n, k), the same as to n queries in that order."""


@runtime_checkable
class CountsErrors(Tutor, Protocol):
    """A simulated one, which knows the truth and how often it did not tell it."""

    @property
    def realised_error_rate(self) -> float:
        """The share of its answers that were wrong; nan before the first."""
