"""Askers, as a session needs them: their protocols, telling an answer, and which answers count.

``LookAhead`` tells each possible answer to a copy of an asker, while the person reads.
"""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

from elicit._support.background import MadeAhead
from elicit.asking.elicitation import OnConflict
from elicit.model.comparator import Comparator
from elicit.model.query import Answer, InconsistentAnswers, Query, Verdict
from elicit.tutors.answer_log import CONTRADICTS, Entry

_CLEAR = (Verdict.BETTER, Verdict.WORSE)
_LIKELY_FIRST = (Verdict.BETTER, Verdict.WORSE, Verdict.EQUAL, None)

ChooseReplacement: TypeAlias = Callable[[Query, Callable[[Query], bool]], Query | None]
"""Returns the query to put in place of another, or None for the query itself. Its second argument
tells whether a query's difference was answered before."""


@runtime_checkable
class Asker(Protocol):
    """Protocol of an asker: anything with ``ask``, ``tell`` and ``result``.

    Examples are a learner of qlearn, and the object that ``choose`` returns.
    """

    def ask(self) -> Sequence[Query]:
        """Return the pending queries, or none when finished.

        They stay the same until they are answered.
        """

    def tell(self, answers: Sequence[Answer], on_conflict: OnConflict = "raise") -> Any:
        """Take answers to pending queries.

        Parameters
        ----------
        answers : sequence of Answer
        on_conflict : {"raise", "drop"}
            Treatment of an answer that contradicts the others.

        Raises
        ------
        InconsistentAnswers
            Unless ``on_conflict="drop"``. When it raises, nothing has changed.
        """

    def result(self) -> Any:
        """Return what the asker has found so far."""


@runtime_checkable
class Audits(Protocol):
    """Protocol of an asker that also asks questions whose answers follow from others."""

    @property
    def implied(self) -> Mapping[str, Verdict]:
        """The verdicts that the answers so far imply for pending queries, by query id."""


@runtime_checkable
class Compares(Protocol):
    """Protocol of an asker that has a comparator."""

    @property
    def comparator(self) -> Comparator:
        """The comparator with all answers learned so far."""


MakeAsker: TypeAlias = Callable[[list[Entry]], Asker]
"""Makes a new asker that knows these answers, such as
lambda known: qlearn.InteractiveValueIteration(mdp, comparator, known=known)."""


class AfterAnswer(NamedTuple):
    """An asker that was told an answer.

    ``contradicts`` is None if the answer fits the others. Otherwise the asker has dropped it, and
    ``contradicts`` has the ids of the answers that contradict each other, including this one.
    """

    asker: Asker
    contradicts: list[str] | None


class Supposed(NamedTuple):
    """An asker that knows other answers than those in the log, to see what they would change.

    ``of`` is the number of these answers that have a verdict, and ``used`` how many of them the
    asker uses.
    """

    asker: Asker
    used: int
    of: int


def tell(asker: Asker, answer: Answer) -> list[str] | None:
    """Tell an asker an answer, and drop it if it contradicts the others.

    Parameters
    ----------
    asker : Asker
    answer : Answer

    Returns
    -------
    list of str or None
        The ids of the contradicting answers, None if there are none.
    """
    try:
        asker.tell([answer])
    except InconsistentAnswers as error:
        asker.tell([answer], "drop")
        return [name for _, name in error.answers]
    return None


def counts(entry: Entry) -> bool:
    """Return whether an answer stands, and is unused only if it contradicts others."""
    return entry.stands and (entry.used or CONTRADICTS in entry.metadata)


class LookAhead:
    """Copies of an asker, each told another possible answer, so that the next questions are ready.

    ``steps`` computes the copies. It may run in another thread than ``told``.

    Parameters
    ----------
    asker : Asker
        The asker that has the pending query.
    twin : Asker
        A copy of it, which nothing else uses.
    query : Query
        The pending query.
    swapped : bool
        True if the query is shown with left and right exchanged.
    who : str, optional
        The person who will answer.
    """

    def __init__(
        self, asker: Asker, twin: Asker, query: Query, swapped: bool, who: str | None = None
    ) -> None:
        self.asker, self.query = asker, query
        self._twin, self._swapped, self._who = twin, swapped, who
        self._ahead = MadeAhead[Verdict | None, AfterAnswer]()
        self._copies: list[tuple[Asker, Asker]] = []  # an asker that was made, and a copy of it
        self.is_near: Callable[[Any], bool] | None = None
        """Takes a result, and returns whether little could be lost by stopping. It is set before
        ``steps`` if ``results`` will be gone through."""
        self.found: tuple[tuple[Asker, Any], ...] = ()
        """Askers after an answer, each with its result."""

    def steps(self) -> Iterator[None]:
        """Compute the asker after a possible answer in each step. A step that fails is left out."""
        return self._ahead.steps(
            {verdict: partial(self._after, verdict) for verdict in _LIKELY_FIRST}
        )

    def _after(self, verdict: Verdict | None) -> AfterAnswer:
        asker = copy.deepcopy(self._twin)
        answer = Answer(self.query, verdict, self._swapped, self._who)
        found = AfterAnswer(asker, tell(asker, answer))
        asker.ask()
        if self.is_near is not None and verdict in _CLEAR:
            # it is copied here, because later the session goes on with the asker
            self._copies.append((asker, copy.deepcopy(asker)))
        return found

    def results(self) -> Iterator[None]:
        """Compute the result after each answer that says which side is better, in a step each.

        What the offer to stop would say is computed too. It is kept with the result, for the
        bounds in it take most of the time.
        """
        while self.is_near is not None and self._copies:
            asker, same = self._copies.pop(0)
            result = same.result()
            self.is_near(result)
            self.found = (*self.found, (asker, result))
            yield

    def waits_for(self, asker: Asker, query: Query) -> bool:
        """Return whether this object was made for this query of this asker."""
        return asker is self.asker and query.id == self.query.id

    def told(self, asker: Asker, answer: Answer) -> AfterAnswer | None:
        """Return the asker after this answer, or None if that was not computed.

        It is returned only once. If it is being computed, the call waits for it.

        Parameters
        ----------
        asker : Asker
        answer : Answer

        Returns
        -------
        AfterAnswer or None
        """
        if not self.waits_for(asker, answer.query) or answer.swapped != self._swapped:
            return None
        if answer.who != Answer(self.query, None, who=self._who).who:
            return None
        return self._ahead.take(answer.verdict)
