"""What a session needs of whatever asks: protocols, and how an answer is told."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

from elicit.asking.elicitation import OnConflict
from elicit.model.comparator import Comparator
from elicit.model.query import Answer, InconsistentAnswers, Query, Verdict
from elicit.tutors.answer_log import CONTRADICTS, Entry


@runtime_checkable
class Asker(Protocol):
    """Whatever asks and is told answers, such as a learner of qlearn, or what ``choose`` returns."""

    def ask(self) -> Sequence[Query]:
        """Return the pending queries, the same until they are answered; none when finished."""

    def tell(self, answers: Sequence[Answer], on_conflict: OnConflict = "raise") -> Any:
        """Take answers to pending queries.

        Raises InconsistentAnswers, unless ``on_conflict="drop"``. When it raises, nothing has changed."""

    def result(self) -> Any:
        """Return what is known so far."""


@runtime_checkable
class Audits(Protocol):
    """An asker that puts questions to the tutor whose answers it could infer."""

    @property
    def implied(self) -> Mapping[str, Verdict]:
        """The verdicts that the answers so far imply, by the id of the pending query."""


@runtime_checkable
class Compares(Protocol):
    """An asker that has a comparator."""

    @property
    def comparator(self) -> Comparator:
        """What is known of the scale."""


MakeAsker: TypeAlias = Callable[[list[Entry]], Asker]
"""Makes a new asker that knows these answers, such as
lambda known: qlearn.InteractiveValueIteration(mdp, comparator, known=known)."""


class AfterAnswer(NamedTuple):
    """An asker that was told an answer.

    ``contradicts`` has the ids of the answers that contradict each other, this one among them, if it had to be dropped;
    otherwise None."""

    asker: Asker
    contradicts: list[str] | None


def tell(asker: Asker, answer: Answer) -> list[str] | None:
    """Tell an asker an answer, and drop it if it contradicts the others.

    Returns the ids of the contradicting answers, None if there are none."""
    try:
        asker.tell([answer])
    except InconsistentAnswers as error:
        asker.tell([answer], "drop")
        return [name for _, name in error.answers]
    return None


def counts(entry: Entry) -> bool:
    """Return whether an answer stands and is used, or would be used if it contradicted no other."""
    return not entry.retracted and (entry.used or CONTRADICTS in entry.metadata)


def last_answer(entries: Sequence[Entry], id: str) -> Answer | None:
    """Return the last answer to the query of this id, None if there is none."""
    return next((entry.answer for entry in reversed(entries) if entry.answer.query.id == id), None)
