"""The protocols of an asker, as a session needs them; telling an answer; which answers count."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

from elicit.asking.elicitation import OnConflict
from elicit.model.comparator import Comparator
from elicit.model.query import Answer, InconsistentAnswers, Query, Verdict
from elicit.tutors.answer_log import CONTRADICTS, Entry

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
