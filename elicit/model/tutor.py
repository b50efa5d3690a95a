"""The Tutor protocol: whatever answers a query."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from elicit.model.query import Answer, Query


@runtime_checkable
class Tutor(Protocol):
    """Answers queries. It sees only the query: no comparator, no learner, no problem."""

    def __call__(self, query: Query) -> Answer:
        """The answer to this query; its verdict is None where the tutor cannot tell."""
