"""Earlier questions that are put again, to see whether the answers agree."""

from collections.abc import Sequence
from dataclasses import replace

from elicit._support.hashing import Seed, fold, key_of, name_code, uniform
from elicit.model.query import Answer, Query
from elicit.person.course.conduct import MOST_CHECKS, ORDER, SETTLED, Conduct, repeats_in
from elicit.tutors.answer_log import REPEATS, AnswerLog

_AGAIN = " again"  # suffix of the id of a query that is put again
_EVERY = 4  # answers for each check, where the interview wants some


class Repeats:
    """Chooses when an earlier question is put again, and which one.

    In front of a ``share`` of the questions one is put again. The choice depends on the seed and on
    the answers that stand, so that it is the same after a restart.
    """

    def __init__(self, log: AnswerLog, share: float, seed: Seed) -> None:
        self._log = log
        self._share = share
        self.regular = False
        """True if a question is also put again after every fourth answer, and after each repeat
        that was answered otherwise."""
        self._key = fold(key_of(seed), name_code("questions put again"))

    def due(self) -> Query | None:
        """Return the question to put again now, as a query with an id of its own, or None."""
        standing = self._log.standing
        if not standing or standing[-1].repeat or self._settled_last():
            return None
        first = [entry.answer for entry in standing if not entry.repeat]
        chance, which = fold(self._key, len(first), [0, 1])
        if uniform(chance) >= self._share and not (self.regular and self._behind()):
            return None
        return self._again(first, int(which))

    def confirming(self) -> Query | None:
        """Return the question to put again before the end, or None.

        None if the checks suffice, or nothing is left to put again.
        """
        log = [*self._log]
        conduct, again = Conduct.of(log), repeats_in(log)
        if conduct.passed or conduct.like_chance or conduct.checks >= MOST_CHECKS:
            return None
        standing = self._log.standing
        first = [entry.answer for entry in standing if not entry.repeat]
        _, which = fold(self._key, len(first), [0, 1])
        return self._again(first, int(which) + len(again))

    def _behind(self) -> bool:
        """Return whether there are fewer checks than there should be by now."""
        conduct = Conduct.of([*self._log])
        return conduct.checks < conduct.answered // _EVERY + conduct.differed

    def _settled_last(self) -> bool:
        """Return whether the last event was a repeat, which the person has settled."""
        again = repeats_in(self._log)
        return bool(again) and [*self._log][-1] is again[-1]

    def _again(self, first: Sequence[Answer], which: int) -> Query | None:
        """Return one of these answered queries as one to put again.

        It is never the last one, which the person remembers.
        """
        again = {entry.metadata[REPEATS] for entry in repeats_in(self._log)}
        may = [
            said.query
            for said in first[:-1]
            if said.verdict is not None
            and said.query.id not in again
            and not said.query.id.startswith((ORDER, SETTLED))
        ]
        if not may:
            return None
        query = may[which % len(may)]
        return replace(query, id=f"{query.id}{_AGAIN}")

    @staticmethod
    def names(id: str) -> bool:
        """Return whether an id is that of a question put again."""
        return id.endswith(_AGAIN)

    def first_answer(self, query: Query) -> Answer | None:
        """Return the answer that was given to a repeated query the first time."""
        standing = self._log.standing
        id = query.id.removesuffix(_AGAIN)
        return next((e.answer for e in reversed(standing) if e.answer.query.id == id), None)
