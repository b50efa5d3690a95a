"""A tutor that replays a person who was asked the same questions many times."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.seeds import seed_of
from elicit.model.difference import tail_sums
from elicit.model.pairs import pair_numbers, same_pairs
from elicit.model.query import Answer, Query, Verdict
from elicit.tutors.answer_log import Entry, entries_of

_PURPOSE = name_code("order of a person's repeats")


class NoRepeatLeft(LookupError):
    """Error if the person was never asked about a pair, or all their answers to it were given."""


class RepeatedAnswersTutor:
    """A tutor that replays a person who answered each of a few pairs many times, in any order.

    Each call gives one of the person's answers to the pair that was not given before. So a learner
    may ask in any order, and ask again. Which answer comes depends on the seed, the pair, and how
    often the pair was asked before. It does not depend on the other questions.
    (``elicit.ReplayTutor`` replays the log of a run, in its order.)

    Parameters
    ----------
    log : AnswerLog, its entries, or Answers
        A person's answers, as the loaders of ``elicit.people`` return them. Retracted answers and
        "cannot tell" are left out. All answers are about the same number of levels.
    seed : int, SeedSequence, Generator or None

    Raises
    ------
    ValueError
        If there are no answers, or they are about different numbers of levels.
    """

    def __init__(self, log: Iterable[Entry | Answer], seed: Seed | None = 0) -> None:
        entries = [entry for entry in entries_of(log) if entry.stands]
        answers = [entry.answer for entry in entries if entry.answer.verdict is not None]
        levels = {len(answer.query.left) for answer in answers}
        if len(levels) != 1:
            raise ValueError(
                "answers about one number of levels are wanted, "
                f"not about {sorted(levels) or 'none'}"
            )
        self.seed = seed_of(seed)
        self._k = levels.pop()
        d = np.array([answer.query.d for answer in answers])
        numbers, key = pair_numbers(d), key_of(self.seed)
        first = np.unique(numbers, return_index=True)[1]
        self._sums = tail_sums(d[first])  # one row a pair
        ways = [
            int(same_pairs(self._sums[pair], tail_sums(row)[None])[0])
            for pair, row in zip(numbers, d, strict=True)
        ]
        self._repeats: list[list[tuple[int, bool]]] = [
            [] for _ in first
        ]  # verdict and side, by pair
        for pair, way, answer in zip(numbers, ways, answers, strict=True):
            self._repeats[pair].append((way * int(answer.verdict or 0), answer.swapped ^ (way < 0)))
        for pair, repeats in enumerate(self._repeats):
            rng = np.random.Generator(np.random.PCG64(int(fold(key, _PURPOSE, pair))))
            self._repeats[pair] = [repeats[i] for i in rng.permutation(len(repeats))]
        self._used = np.zeros(len(first), dtype=np.intp)

    def __repr__(self) -> str:
        answers = sum(map(len, self._repeats))
        pairs, used = len(self._repeats), int(self._used.sum())
        return f"RepeatedAnswersTutor({answers} answers about {pairs} pairs, {used} used)"

    @property
    def k(self) -> int:
        """Number of levels."""
        return self._k

    def __call__(self, query: Query) -> Answer:
        """Return one of the person's answers to the query's pair that was not given before.

        Parameters
        ----------
        query : Query

        Returns
        -------
        Answer
            In terms of the query's left vector.

        Raises
        ------
        NoRepeatLeft
            A LookupError: if the pair was never put, or has no answer left.
        """
        pair, way = self._find(query)
        used, repeats = int(self._used[pair]), self._repeats[pair]
        if used == len(repeats):
            raise NoRepeatLeft(
                f"all {used} answers to the pair of query {query.id} were used: ask about another "
                "pair, or start again with a new RepeatedAnswersTutor"
            )
        self._used[pair] += 1
        verdict, swapped = repeats[used]
        return Answer(query, Verdict(way * verdict), swapped ^ (way < 0))

    def left_over(self, query: Query) -> int:
        """Return how many answers to the query's pair were not given yet.

        Parameters
        ----------
        query : Query

        Returns
        -------
        int
            0 if the pair was never put.
        """
        try:
            pair, _ = self._find(query)
        except NoRepeatLeft:
            return 0
        return len(self._repeats[pair]) - int(self._used[pair])

    def truth(self, query: Query) -> Verdict | None:
        """Return the most frequent answer among those to the query's pair that were not given yet.

        Parameters
        ----------
        query : Query

        Returns
        -------
        Verdict or None
            In terms of the query's left vector. None if no answer is left, or if two verdicts are
            equally frequent.

        Raises
        ------
        NoRepeatLeft
            If the pair was never put.
        """
        pair, way = self._find(query)
        votes = np.bincount(
            [1 + way * verdict for verdict, _ in self._repeats[pair][self._used[pair] :]],
            minlength=3,
        )
        best = np.flatnonzero(votes == votes.max())
        return Verdict(int(best[0]) - 1) if len(best) == 1 else None

    def _find(self, query: Query) -> tuple[int, int]:
        """Return the number of the query's pair, and 1, or -1 if left and right are exchanged."""
        if len(query.left) != self._k:
            raise ValueError(
                f"the person was asked about {self._k} levels, "
                f"but the query is about {len(query.left)}"
            )
        ways = same_pairs(tail_sums(query.d), self._sums)
        if not ways.any():
            raise NoRepeatLeft(
                f"the person was never asked about the pair of query {query.id}: left "
                f"{query.left}, right {query.right}. Ask only about the {len(self._sums)} pairs of "
                "the experiment"
            )
        pair = int(np.flatnonzero(ways)[0])
        return pair, int(ways[pair])
