"""The consequences of each choice in a conflict: the values of levels, and the answers kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Generic, TypeVar

T = TypeVar("T")


class Consequences(Generic[T]):
    """The consequences of each choice in a conflict. One thread computes them while others read.

    Parameters
    ----------
    id : str
        Of the conflict.
    suppose : mapping
        For each choice, a function that returns the state after it.
    sentence : callable
        Takes such a state, and returns it in a few words.
    """

    def __init__(
        self,
        id: str,
        suppose: Mapping[str, Callable[[], T]],
        sentence: Callable[[T], str],
    ) -> None:
        self.id = id
        self._suppose, self._sentence = dict(suppose), sentence
        self._found: dict[str, str] = {}
        self.ready = False
        """True if nothing will be added."""

    def steps(self) -> Iterator[None]:
        """Compute the consequences of one choice in each step.

        A choice is left out if its function raises ValueError, as for answers that contradict each
        other.
        """
        try:
            for choice, suppose in self._suppose.items():
                with suppress(ValueError):  # also for answers that contradict each other
                    self._found[choice] = self._sentence(suppose())
                yield
        finally:
            self.ready = True

    def found(self) -> dict[str, str]:
        """Return the sentences that are known by now, by choice."""
        return dict(self._found)
