"""A person's conduct, from the log alone, and the earlier questions that are put again to check it.

A check is a question whose answer can be compared with something. It is an earlier question put
again, or a question about two neighbouring levels, whose order is known. Somebody who answers by
chance differs in about half of the checks. ``Conduct`` counts the checks. ``Repeats`` chooses when
to put which question again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from elicit._support.hashing import Seed, fold, key_of, name_code, uniform
from elicit.model.query import Answer, Query, Verdict
from elicit.tutors.answer_log import EXPECTED, REPEATS, RESOLVED, AnswerLog, Entry

Kind = Literal["a", "b", "equal", "cannot tell"]

ORDER = "order/"
"""Start of the id of a check question about two neighbouring levels."""
IN_CONFLICT = "in conflict"
"""The metadata of an answer that was taken back because it contradicted others."""
SETTLED = "settled/"
"""Start of the id of an answer that replaces two that differed."""
UNSURE_OFFER = 3
"""Answers "cannot tell" in a row after which the person is offered something else."""
_UNSURE = 12  # answers "cannot tell" in a row after which the questions are said not to work
_EQUAL = 10  # answers "equally good" in a row
_CLEAR = (Verdict.BETTER, Verdict.WORSE)
_CLEAR_BEFORE = 5  # clear answers after which pairs called equal are taken for close ones
_SIDE = 12  # choices of one side in a row: by chance 1 in 2,048, for sides are shuffled
_TAKEN_BACK = 5  # answers taken back as contradictions, and a share, after which that is said:
_SHARE_TAKEN_BACK = 1 / 4  # of those given. In 50 sessions with 10% or 15% errors none came so far
# a check answered differently counts for so many answers taken back. In 80 sessions by chance that
# was said within 25 questions in 80 (before: 77), and in 80 others with 2% or 7% errors never anew
_AS_TAKEN_BACK = 2
_FEW = 3  # answers of one kind that are worth a remark at the end
_SIDE_AT_END = 8
_DIFFERED = 2  # checks answered differently that are worth a remark
_LIKE_GUESSES = "Your answers cannot be told from guesses yet."
_BY_CHANCE = 0.5  # least share of checks that answers by chance answer differently
_BY_SLIPS = 0.15  # share that a person who means the answers answers differently
_LIKELIER = 2.0  # "by chance" must be this many times likelier to be said
LEAST_CHECKS = 5
"""Checks before the end. Answers by chance pass this many in at most 1 of 32 cases."""
MOST_CHECKS = 11
"""A person who has not passed after this many checks is told so."""
_SHOWS_LITTLE = "That does not show yet whether you meant your answers."
_SHOWS_SOME = "That speaks for your answers."
_SHOWS_MUCH = "That speaks well for your answers."
_RARE = 25  # cases: answers by chance that do so well in one of more are rare
_MORE_ALIKE = 2  # further checks that must be answered alike for each that was not
_EVERY = 4  # answers for each check, where the interview wants some
# the same until there are LEAST_CHECKS, without which it does not end: otherwise most of these
# would come in a row at the end
_EARLY = 2
_REMEMBERED = 4  # the newest answers, which the person may still have in mind
AGAIN = " again"  # suffix of the id of a query that is put again


def choice_of(answer: Answer) -> Kind:
    """Return which choice on the screen an answer was: "a", "b", "equal" or "cannot tell"."""
    if answer.verdict is None:
        return "cannot tell"
    if answer.verdict is Verdict.EQUAL:
        return "equal"
    return "a" if (answer.verdict is Verdict.BETTER) != answer.swapped else "b"


def repeats_in(log: Iterable[Entry]) -> list[Entry]:
    """Return the answers to repeated questions that count.

    Those are the ones that stand, those replaced when the person settled a difference, and those
    that differed and were taken back: a mistake that was mended on being asked is still one.
    """
    return [
        entry
        for entry in log
        if entry.repeat and (entry.stands or was_settled(entry) or differs(entry))
    ]


def was_settled(entry: Entry) -> bool:
    """Return whether the person has settled what they mean by this answer and its repeat."""
    return RESOLVED in (entry.retraction or {})


def differs(entry: Entry) -> bool:
    """Return whether a repeat was answered differently from the first time."""
    said = entry.answer.verdict
    return bool(entry.metadata.get(EXPECTED, said) != said)


@dataclass(frozen=True)
class Conduct:
    """Counts from a log of how a person has answered.

    Attributes
    ----------
    answered
        Answers that stand, without repeats.
    with_verdict
        Those among them that say which is better, or equal.
    checks, differed
        Number of checks. Number of these that were answered differently from before, or against the
        order of the levels.
    last
        The last choice on the screen; None if there is no answer.
    in_a_row
        Number of times that this choice was made in a row, up to now.
    taken_back
        Answers taken back because they contradicted others.
    repeated
        Answers to repeated questions.
    clear
        Answers that stand and say which side is better, without repeats.
    against_order
        Number of checks answered against the order of the levels, which are among ``differed``.
    """

    answered: int
    with_verdict: int
    checks: int
    differed: int
    last: Kind | None
    in_a_row: int
    taken_back: int = 0
    repeated: int = 0
    clear: int = 0
    against_order: int = 0

    @staticmethod
    def of(log: Sequence[Entry]) -> Conduct:
        """Return the conduct in the answers of a log."""
        standing = [entry for entry in log if entry.stands and not entry.repeat]
        repeats = repeats_in(log)
        order = [
            entry
            for entry in log
            if entry.answer.query.id.startswith(ORDER)
            and (entry.stands or was_settled(entry))
            and entry.answer.verdict is not None
        ]
        against = sum(entry.answer.verdict is Verdict.WORSE for entry in order)
        said = [choice_of(entry.answer) for entry in log if entry.stands]
        last = said[-1] if said else None
        row = 0
        while row < len(said) and said[-1 - row] == last:
            row += 1
        return Conduct(
            answered=len(standing),
            with_verdict=sum(entry.answer.verdict is not None for entry in standing),
            checks=len(repeats) + len(order),
            differed=sum(map(differs, repeats)) + against,
            last=last,
            in_a_row=row,
            taken_back=sum(IN_CONFLICT in (entry.retraction or {}) for entry in log),
            repeated=len(repeats),
            clear=sum(entry.answer.verdict in _CLEAR for entry in standing),
            against_order=against,
        )

    @property
    def put(self) -> int:
        """Number of questions answered, including repeats, as the screens count them."""
        return self.answered + self.repeated

    def checks_beside(self, more: int, least: int) -> int:
        """Return the number of checks that come with further answers, if all checks agree.

        Parameters
        ----------
        more : int
            Further answers, without repeats.
        least : int
            Fewest checks that must still come.
        """
        return max(least, (self.answered + more) // _EVERY + self.differed - self.checks)

    @property
    def given(self) -> int:
        """Answers that stand, without repeats, and answers taken back as contradictions."""
        return self.answered + self.taken_back

    @property
    def like_chance(self) -> bool:
        """True if the checks were answered about as well as by chance."""
        likelier = (_BY_CHANCE / _BY_SLIPS) ** self.differed
        likelier *= ((1 - _BY_CHANCE) / (1 - _BY_SLIPS)) ** (self.checks - self.differed)
        return self.differed >= _DIFFERED and likelier >= _LIKELIER

    @property
    def passed(self) -> bool:
        """True if there were enough checks, and enough of them were answered alike.

        About 6% of people who answer by chance pass, and 97% of those who answer one check in 20
        differently.
        """
        return self._alike_missing <= 0

    @property
    def _alike_missing(self) -> int:
        """Count the further checks, answered alike, that it takes to pass."""
        return LEAST_CHECKS + _MORE_ALIKE * self.differed - (self.checks - self.differed)

    @property
    def checks_left(self) -> int:
        """The fewest checks that must still come before the end, if there is enough to repeat."""
        if self.passed or self.like_chance:
            return 0
        return max(0, min(self._alike_missing, MOST_CHECKS - self.checks))

    @property
    def unresolved(self) -> bool:
        """True if some check was answered differently, and more checks could show why.

        It is False once the person has passed, or answers about as well as by chance, or has
        answered the greatest number of checks.
        """
        may = self.checks < MOST_CHECKS and not self.like_chance
        return self.differed > 0 and may and not self.passed

    @property
    def cases(self) -> int:
        """The n in "1 of n people who answer by chance does at least as well in the checks"."""
        as_well = sum(math.comb(self.checks, n) for n in range(self.differed + 1))
        return int(2**self.checks // as_well)

    @property
    def by_chance(self) -> str:
        """Sentences on checks other than repeats, and on how often guesses do as well, or ""."""
        if not self.checks:
            return ""
        said = []
        if n := self.checks - self.repeated:
            alike = n - self.against_order
            asked = "One more question checked" if n == 1 else f"{n} more questions checked"
            answered = (
                "was answered as expected" if n == 1 else f"{alike} were answered as expected"
            )
            if alike == n == 2:
                answered = "both were answered as expected"
            if n == 1 and not alike:
                answered = "was answered against it"
            said.append(f"{asked} the order of the levels, and {answered}.")
        cases, guessing = self.cases, "Guessing would do as well in"
        if cases < 2:
            said += [f"{guessing} half of all interviews or more.", _SHOWS_LITTLE]
            return " ".join(said)
        said.append(f"{guessing} at most 1 of {cases} interviews.")
        said.append(
            _SHOWS_MUCH if cases >= _RARE else _SHOWS_SOME if cases >= _FEW else _SHOWS_LITTLE
        )
        return " ".join(said)

    @property
    def offers(self) -> bool:
        """True if the person answered "cannot tell" several times in a row, up to now."""
        return (
            self.last == "cannot tell" and self.in_a_row > 0 and self.in_a_row % UNSURE_OFFER == 0
        )

    def caution(self, at_end: bool = False) -> str | None:
        """Return a sentence on why the answers say little, or None.

        Parameters
        ----------
        at_end : bool
            True if nothing more is asked: then fewer answers of one kind are worth a remark.

        Returns
        -------
        str or None
        """
        n, all_alike = self.in_a_row, at_end and self.in_a_row >= self.answered
        if self.last == "cannot tell" and n >= (_FEW if all_alike else _UNSURE):
            return (
                f"You could not tell in {n} questions in a row, so nothing can be concluded from "
                "them."
            )
        # late questions are about ever closer pairs: who was clear before, and means it, may say so
        close = self.passed and self.clear >= _CLEAR_BEFORE
        if self.last == "equal" and n >= (_FEW if all_alike else _EQUAL) and not close:
            return (
                f"You called {n} pairs in a row equally good. Either the conditions matter little "
                "to you, or the questions do not show what matters."
            )
        if self.last in ("a", "b") and n >= (_SIDE_AT_END if all_alike else _SIDE):
            side = self.last.upper()
            return (
                f"You chose {side} {n} times in a row, although the sides are shuffled. Answers "
                "that do not depend on the question would look the same."
            )
        return self._in_doubt(at_end)

    def _in_doubt(self, at_end: bool) -> str | None:
        """Return a sentence on why answers that differ look like guesses, or None.

        Answers differ if they were taken back because they contradicted others, or if a check was
        answered otherwise.
        """
        back, other = self.taken_back, self.differed
        both = back + _AS_TAKEN_BACK * other
        many_back = back >= _TAKEN_BACK and back >= _SHARE_TAKEN_BACK * self.given
        many_both = both > _TAKEN_BACK and both >= _SHARE_TAKEN_BACK * self.given
        many_both = many_both and other > 0 and back >= _FEW
        few_alike = 2 * other >= max(self.checks, 1) or (other >= _DIFFERED and not self.passed)
        failed = self.checks >= MOST_CHECKS and not self.passed
        many_other = self.like_chance or failed or (at_end and few_alike)
        if not (many_back or many_both or many_other):
            return None
        found = []
        if many_back or many_both:
            found.append(f"took back {back} answers because they contradicted others")
        if many_both or not found:
            found.append(f"answered {other} of {self.checks} check questions differently")
        perhaps = (
            "" if many_both or many_other else " Perhaps one that you kept is not what you mean."
        )
        return f"You {', and '.join(found)}.{perhaps} {_LIKE_GUESSES}"


class Repeats:
    """Chooses when an earlier question is put again, and which one.

    Before a ``share`` of the questions, an earlier question is put again. The choice depends
    on the seed and on the answers that were not withdrawn, so it is the same after a restart.
    """

    def __init__(self, log: AnswerLog, share: float, seed: Seed) -> None:
        self._log = log
        self._share = share
        self.regular = False
        """True if a question is also put again after every fourth answer, after every second one
        until there are five checks, and after each repeat that was answered otherwise."""
        self._key = fold(key_of(seed), name_code("questions put again"))

    def due(self, conduct: Conduct) -> Query | None:
        """Return the question to put again now, as a query with a new id, or None.

        Parameters
        ----------
        conduct : Conduct
            The conduct in the log so far.
        """
        standing = self._log.standing
        if not standing or standing[-1].repeat or self._settled_last():
            return None
        first = [entry.answer for entry in standing if not entry.repeat]
        chance, which = fold(self._key, len(first), [0, 1])
        if uniform(chance) >= self._share and not (self.regular and _behind(conduct)):
            return None
        return self._again(first, int(which))

    def confirming(self, conduct: Conduct) -> Query | None:
        """Return the question to put again before the end, or None.

        It is None if the checks suffice, or no question is left to put again.

        Parameters
        ----------
        conduct : Conduct
            The conduct in the log so far.
        """
        if conduct.passed or conduct.like_chance or conduct.checks >= MOST_CHECKS:
            return None
        standing = self._log.standing
        first = [entry.answer for entry in standing if not entry.repeat]
        _, which = fold(self._key, len(first), [0, 1])
        return self._again(first, int(which) + len(repeats_in(self._log)))

    def _settled_last(self) -> bool:
        """Return whether the last event in the log is that a repeat was settled."""
        again = repeats_in(self._log)
        return bool(again) and [*self._log][-1] is again[-1]

    def _again(self, first: Sequence[Answer], which: int) -> Query | None:
        """Return one of these answered queries, to be put again, or None.

        It is not one of the newest answers, which the person remembers. If there are no others, it
        is the oldest of these, but never the last one.
        """
        may = self._repeatable(first[:-_REMEMBERED]) or self._repeatable(first[:-1])[:1]
        if not may:
            return None
        query = may[which % len(may)]
        return replace(query, id=f"{query.id}{AGAIN}")

    def left(self) -> int:
        """Return how many of the answered questions, the last one among them, may be put again."""
        return len(self._repeatable([e.answer for e in self._log.standing if not e.repeat]))

    def _repeatable(self, said: Sequence[Answer]) -> list[Query]:
        """Return the queries among answers that may be put again."""
        again = {entry.metadata[REPEATS] for entry in repeats_in(self._log)}
        return [
            one.query
            for one in said
            if one.verdict is not None
            and one.query.id not in again
            and not one.query.id.startswith((ORDER, SETTLED))
        ]

    @staticmethod
    def names(id: str) -> bool:
        """Return whether an id belongs to a question put again."""
        return id.endswith(AGAIN)

    def first_answer(self, query: Query) -> Answer | None:
        """Return the answer that was given to a repeated query the first time."""
        standing = self._log.standing
        id = query.id.removesuffix(AGAIN)
        return next((e.answer for e in reversed(standing) if e.answer.query.id == id), None)


def _behind(conduct: Conduct) -> bool:
    """Return whether there were fewer checks than there should be by now.

    After "cannot tell" a check waits for another answer. Otherwise it would come between several of
    these in a row, after which the person is offered something else.
    """
    if conduct.last == "cannot tell":
        return False
    early = min(LEAST_CHECKS, (conduct.answered - 2) // _EARLY)
    return conduct.checks < max(early, conduct.answered // _EVERY) + conduct.differed
