"""A tutor that replays a log of answers."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from elicit.model.difference import tail_sums
from elicit.model.pairs import same_pairs
from elicit.model.query import Answer, Query
from elicit.tutors.answer_log import Entry, entries_of


class NotInLog(LookupError):
    """Error for a query that the replayed log has no answer to."""


class ReplayTutor:
    """Replays the answers of a log.

    A query is looked up by its id. If no answer has that id, it is looked up by its pair: the same
    difference but for rounding, or its opposite. A query with ``who`` gets answers of that person
    only, in both cases.

    Answers to the same pair are replayed in the order of the log. A query asked again gets the next
    answer of the log with that id, or the same answer again if there is none.

    Parameters
    ----------
    log : AnswerLog, or iterable of Entry or Answer
        Answers that the recorded run did not use are replayed too. Retracted answers are not.
    """

    def __init__(self, log: Iterable[Entry | Answer]) -> None:
        self._answers = [entry.answer for entry in entries_of(log) if entry.stands]
        self._by_id: dict[str, list[int]] = {}
        levels = np.array([len(answer.query.left) for answer in self._answers])
        self._rows = {k: np.flatnonzero(levels == k) for k in set(levels.tolist())}
        self._sums = {
            k: tail_sums(np.array([self._answers[i].query.d for i in rows]))
            for k, rows in self._rows.items()
        }
        for i, answer in enumerate(self._answers):
            self._by_id.setdefault(answer.query.id, []).append(i)
        self._replayed: set[int] = set()
        self._last: dict[tuple[str, str | None], int] = {}

    def __repr__(self) -> str:
        return f"ReplayTutor({len(self._answers)} answers)"

    def __call__(self, query: Query) -> Answer:
        """Return the log's answer to this query.

        Parameters
        ----------
        query : Query

        Returns
        -------
        Answer
            In terms of the query's left vector. Its verdict is None if the person could not tell.

        Raises
        ------
        NotInLog
            A LookupError: if the log has no answer to it.
        """
        ways = self._ways(query)
        own = self._of_person(self._by_id.get(query.id, []), query.who)
        last = self._last.get((query.id, query.who), own[-1] if own else None)
        same_pair = self._of_person(np.flatnonzero(ways).tolist(), query.who)
        candidates = same_pair if last is None else own
        fresh = next((i for i in candidates if i not in self._replayed), last)
        if fresh is None:
            person = "" if query.who is None else f" by {query.who!r}"
            raise NotInLog(
                f"the log has no answer{person} to query {query.id}"
                + (
                    f": all {len(candidates)} answers to this pair were replayed already"
                    if candidates
                    else ""
                )
                + ". Its problem, seed or settings may differ from those of the recorded run; "
                "replay the run that was recorded, or put this query to a tutor and append the "
                "answer to the log"
            )
        found = self._answers[fresh]
        if not ways[fresh]:
            raise NotInLog(
                f"the log's query {query.id} is about other vectors: left {found.query.left}, "
                "right "
                f"{found.query.right}, not left {query.left}, right {query.right}. The log is of "
                "another problem"
            )
        self._replayed.add(fresh)
        self._last[query.id, query.who] = fresh
        if ways[fresh] > 0:
            return Answer(query, found.verdict, found.swapped, found.who)
        verdict = None if found.verdict is None else found.verdict.flipped
        return Answer(query, verdict, not found.swapped, found.who)

    def _of_person(self, rows: list[int], who: str | None) -> list[int]:
        """Return those of the rows whose answer is from ``who``; all of the rows if it is None."""
        return [i for i in rows if who is None or self._answers[i].who == who]

    def _ways(self, query: Query) -> NDArray[np.int8]:
        """Return for each answer (n,): 1 if it is about the query's pair, -1 if flipped, else 0."""
        found, k = np.zeros(len(self._answers), np.int8), len(query.left)
        if k in self._rows:
            found[self._rows[k]] = same_pairs(tail_sums(query.d), self._sums[k])
        return found
