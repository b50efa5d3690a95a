"""Earlier questions that are put again, to see whether the answers agree."""

from dataclasses import replace

from elicit._support.hashing import Seed, fold, key_of, name_code, uniform
from elicit.model.query import Answer, Query
from elicit.person.asker import last_answer
from elicit.tutors.answer_log import REPEATS, AnswerLog

_AGAIN = " again"  # suffix of the id of a query that is put again


class Repeats:
    """Chooses when an earlier question is put again, and which one.

    In front of a ``share`` of the questions one is put again. The choice depends on the seed and on
    the answers that stand, so that it is the same after a restart.
    """

    def __init__(self, log: AnswerLog, share: float, seed: Seed) -> None:
        self._log = log
        self._share = share
        self._key = fold(key_of(seed), name_code("questions put again"))

    def due(self) -> Query | None:
        """Return the question to put again now, as a query with an id of its own, or None."""
        standing = [entry for entry in self._log if not entry.retracted]
        if not standing or standing[-1].repeat:
            return None
        first = [entry.answer for entry in standing if not entry.repeat]
        chance, which = fold(self._key, len(first), [0, 1])
        if uniform(chance) >= self._share:
            return None
        again = {entry.metadata[REPEATS] for entry in standing if entry.repeat}
        # never the last question, which the person remembers
        may = [
            said.query
            for said in first[:-1]
            if said.verdict is not None and said.query.id not in again
        ]
        if not may:
            return None
        query = may[int(which) % len(may)]
        return replace(query, id=f"{query.id}{_AGAIN}")

    @staticmethod
    def names(id: str) -> bool:
        """Return whether an id is that of a question put again."""
        return id.endswith(_AGAIN)

    def first_answer(self, query: Query) -> Answer | None:
        """Return the answer that was given to a repeated query the first time."""
        standing = [entry for entry in self._log if not entry.retracted]
        return last_answer(standing, query.id.removesuffix(_AGAIN))
