"""Notes beside a question (why it is asked, how many are to come); forecasts for the welcome."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from elicit._support.fixed_order import product
from elicit._support.hashing import fold, key_of, name_code
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import draws_in, lapse_of, trusted_share
from elicit.model.difference import tail_sums
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats
from elicit.person.asker import Asker, Compares, tell
from elicit.person.course.conclusion import listed
from elicit.person.course.conduct import LEAST_CHECKS
from elicit.person.course.forecast import rise
from elicit.person.course.ranges import value_ranges
from elicit.person.showing import Shown, printable
from elicit.tutors.erring_tutor import says_left

_PLAYS = 12  # simulated sessions
_FEWEST = 8  # least number of sessions that ended, to make a range of
_FEWEST_LIKELY = 4  # least number to say what is likely
_TAIL = 10  # one in so many is left out at either end, and the longest always: they are rare
_SECONDS = 15.0  # time limit of all this, except for a last step
_LONGEST = 60  # largest number of questions that are played
_RUNS = 12  # simulated sessions at most
_FEWEST_RUNS = 4  # sessions that are worth a sentence
_SECONDS_OF_PROSPECTS = 60.0  # time limit of all of them, except for a last step
# one question in so many is a check, which proves nothing new, and at least LEAST_CHECKS are
_CHECKS = 5
_NO_DIFFERENCE = 1e-12
_WIDEN = (
    "Any one answer may be a mistake: a range narrows once several agree, and may widen after an "
    "answer that was not expected."
)


@dataclass(eq=False)
class _Play:
    """A simulated session with a simulated tutor, from the present question on.

    It has its asker, its tutor and its answers so far.
    """

    asker: Asker
    says: Callable[[Query], Verdict]
    answers: list[Verdict | None] = field(default_factory=list)
    over: bool = False


class Outlook:
    """The notes shown with a question on the screen.

    One thread may compute them, by ``steps``, while others read.

    Parameters
    ----------
    twin : Asker
        A copy of the asker, which is not changed.
    shown : Shown
        The question.
    pending : Query
        The query that the asker waits for. It differs from the question on the screen if that is a
        repeat.
    stakes : callable
        Takes ``twin.result()``, and returns a sentence on the purpose of more questions, or None.
    ends : callable
        Returns whether a session would end in place of asking a query.
    seed : int
        Seed of the simulations.
    before : Outlook, optional
        The outlook of the last question.
    answered : sequence
        Verdicts that the asker was told since then. Of the simulated sessions, those with exactly
        these answers are continued.
    counted : bool
        True if the question is one of those that are counted.
    """

    def __init__(
        self,
        twin: Asker,
        shown: Shown,
        pending: Query,
        stakes: Callable[[Any], str | None],
        ends: Callable[[Query], bool],
        seed: int,
        before: Outlook | None = None,
        answered: Sequence[Verdict | None] = (),
        counted: bool = True,
    ) -> None:
        self.loss: float | None = None
        """What the result could lose, a share of the value range; None if unknown."""
        self.result: Any = None
        """The twin's result; None until it is computed."""
        self.near: bool | None = None
        """True if little could be lost by stopping; None if that is not known."""
        self.is_near: Callable[[Any], bool] | None = None
        """Takes ``twin.result()``, and returns ``near``. It is set before ``steps``, if at all."""
        self.if_near: Callable[[], Iterator[None]] = lambda: iter(())
        """Returns steps to go through if ``near``. It is set before ``steps``, if at all."""
        self.reason = ""
        """Why the question comes, if that is not what is open. It is set before ``steps``."""
        self.stated: float | None = None
        """The loss that was last stated to the person, if any. It is set before ``steps``."""
        self.why: tuple[str, ...] = ()
        """The reason why the question is asked, in sentences."""
        self.to_come: tuple[int, int] | None = None
        """The least and the greatest number of questions after this one, in the middle 80% of the
        simulated sessions. It is None if too few of these have ended."""
        self.likely: int | None = None
        """The number in half of the simulated sessions at most; None if unknown."""
        self.ready = False
        """True if nothing will be added."""
        since = [*answered]
        if (
            before is not None and (earlier := before._before) is not None
        ):  # ``before`` was given up before it began
            before, since = earlier, [*before._answered, *since]
        self._twin, self._shown, self._pending = twin, shown, pending
        self._stakes, self._ends, self._seed = stakes, ends, seed
        self._before: Outlook | None = before
        self._answered: list[Verdict | None] = since
        self.counted = counted
        self._plays: list[_Play] = []
        if (
            before is not None
        ):  # at once; the plays may be in use still, and go on only in ``steps``
            self._plays = before._going_on(self._answered)
            self._count()

    def steps(self) -> Iterator[None]:
        """Compute the notes in steps, after the steps of ``before`` have ended.

        If a step fails, the rest is left out.
        """
        try:
            yield from self._steps()
        finally:
            self.ready = True

    def _steps(self) -> Iterator[None]:
        until = time.monotonic() + _SECONDS
        if self._before is not None:
            self._plays = self._before._going_on(self._answered)
            self._before = None  # releases the earlier outlooks too
        known = self._twin.comparator if isinstance(self._twin, Compares) else None
        if self.reason:
            self.why = (self.reason,)
        elif known is not None:
            sentence = what_is_open(self._shown, known)
            self.why = () if sentence is None else (sentence,)
            yield
        self.result = result = copy.deepcopy(self._twin).result()
        stakes = self._stakes(result)
        if stakes is not None:
            self.loss = _stated_loss(result)
            exact = known is None or trusted_share(known) is None
            risen = rise(self.loss, self.stated, exact)
            self.why = (*self.why, stakes if risen is None else f"{stakes} {risen}")
        yield
        if self.is_near is not None:
            self.near = self.is_near(result)
            yield
            if self.near:
                yield from self.if_near()
        for play in self._all_plays(known):
            while not play.over and time.monotonic() < until:
                self._go_on(play)
                yield
            if not play.over:
                break
            self._count()

    def _going_on(self, answered: list[Verdict | None]) -> list[_Play]:
        """Return the simulated sessions that began with these answers, without these answers."""
        n = len(answered)
        same = [play for play in self._plays if play.answers[:n] == answered]
        return [_Play(play.asker, play.says, play.answers[n:], play.over) for play in same]

    def _all_plays(self, known: Comparator | None) -> Iterator[_Play]:
        """Return the simulated sessions that are continued, and new ones with plausible tutors."""
        yield from tuple(self._plays)
        numbers = range(len(self._plays), _PLAYS)
        for says in plausible_tutors(known, self._seed, self._pending.id, numbers):
            play = _Play(copy.deepcopy(self._twin), says)
            self._plays.append(play)
            yield play

    def _go_on(self, play: _Play) -> None:
        """Simulate one question and its answer."""
        query = next(iter(play.asker.ask()), None)
        if query is None or len(play.answers) == _LONGEST or self._ends(query):
            play.over = True
            return
        verdict = play.says(query)
        tell(play.asker, Answer(query, verdict))
        play.answers.append(verdict)

    def _count(self) -> None:
        played = sorted(len(play.answers) for play in self._plays if play.over)
        n = len(played)
        if n >= _FEWEST_LIKELY:
            self.likely = max(0, played[(n - 1) // 2] - self.counted)
        if n >= _FEWEST:
            least, most = played[n // _TAIL], played[-1 - max(1, n // _TAIL)]
            self.to_come = max(0, least - self.counted), max(0, most - self.counted)


def plausible_tutors(
    known: Comparator | None, seed: int, name: str, numbers: Iterable[int]
) -> Iterator[Callable[[Query], Verdict]]:
    """Return simulated tutors whose scales are drawn from a comparator's plausible scales.

    Parameters
    ----------
    known : Comparator or None
        There is no tutor if it is None, or has no draws.
    seed : int
    name : str
        The purpose of the tutors. Another name gives other tutors with the same seed.
    numbers : iterable of int
        The same number gives the same tutor again.
    """
    draws = None if known is None else draws_in(known)
    if known is None or draws is None:
        return
    gaps, weights, precision = draws
    lapse, key = lapse_of(known), fold(key_of(seed), name_code(name))
    for number in numbers:
        chance = np.random.default_rng([int(key), number])
        one = int(chance.choice(len(weights), p=weights / weights.sum()))
        yield _tutor(gaps[:, one], precision[one : one + 1], lapse, chance)


def _tutor(
    gaps: Floats, precision: Floats, lapse: float, chance: np.random.Generator
) -> Callable[[Query], Verdict]:
    """Return a tutor with a scale of gaps (p,), who errs by this precision (1,) and lapse."""

    def says(query: Query) -> Verdict:
        score = product(tail_sums(query.d[None, :]), gaps)
        if abs(score[0]) <= _NO_DIFFERENCE:
            return Verdict.EQUAL
        left = chance.random() < says_left(score[:, None], precision, lapse)[0, 0]
        return Verdict.BETTER if left else Verdict.WORSE

    return says


def what_is_open(shown: Shown, comparator: Comparator) -> str | None:
    """Return a sentence on what the comparator does not know about the levels in a question.

    Values are on the scale from 0 (the worst level) to 100 (the best). The result is None if the
    comparator bounds no value.
    """
    left, right = shown.vectors
    k = comparator.k
    low, high = (100.0 * bound for bound in value_ranges(comparator))
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return None
    labels = [f"“{printable(label)}”" for label in shown.labels]
    levels = [j for j in np.flatnonzero(left != right).tolist() if 0 < j < k - 1][::-1]
    scale = f"from 0 ({printable(shown.labels[0])}) to 100 ({printable(shown.labels[-1])})"
    ranges = {j: (max(0, _down(low[j])), min(100, _up(high[j]))) for j in levels}
    known = {j: found for j, found in ranges.items() if found != (0, 100)}
    named = [labels[j] for j in levels if j not in known]
    said = []
    if known:
        share = trusted_share(comparator)
        apiece = " each" if len(known) > 1 else ""
        sure = "" if share is None else f" (with {share:.0%} probability{apiece})"
        each = listed([f"{labels[j]} is between {a} and {b}" for j, (a, b) in known.items()])
        widen = "" if share is None else f" {_WIDEN}"
        said.append(f"So far {each}{sure}, on the scale {scale}.{widen}")
    if named:
        where = "on that scale" if known else scale.replace("from", "on the scale from", 1)
        said.insert(0, f"We don't yet know how good {listed(named)} {_is(named)}, {where}.")
        if known:
            said.reverse()
    return " ".join(said) or None


def _is(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _up(number: float) -> int:
    return int(np.ceil(number - 1e-6))


def _down(number: float) -> int:
    return int(np.floor(number + 1e-6))


@dataclass(frozen=True)
class Prospect:
    """Outcomes of simulated sessions that end after a number of questions.

    Attributes
    ----------
    questions : int
        The number of questions, including checks.
    sessions : int
        Number of simulated sessions.
    settled : int
        Number of these in which nothing was left to ask by then.
    loss : float
        Median of what could still be lost, a share of the value range. It is nan if unknown.
    """

    questions: int
    sessions: int
    settled: int
    loss: float


class Prospects:
    """Forecasts of what several numbers of questions will prove, by simulated sessions.

    One thread may compute them while others read.

    Parameters
    ----------
    twin : Asker
        A copy of the asker before its first answer. It is not changed.
    questions : sequence of int
        Numbers of questions, ascending.
    seed : int
        Seed of the simulations.
    ends : callable
        Returns whether a session would end in place of asking a query.
    enough : callable, optional
        Returns whether a result is sure enough to end. If it is not, the simulated session counts
        as one that did not end: an interview would go on with questions of its own, which are not
        simulated. If that happens in half of the sessions, there is no forecast.
    """

    def __init__(
        self,
        twin: Asker,
        questions: Sequence[int],
        seed: int,
        ends: Callable[..., bool],
        enough: Callable[[Any], bool] | None = None,
    ) -> None:
        self._twin, self._seed, self._ends, self._enough = twin, seed, ends, enough
        self.questions = tuple(questions)
        self._losses: list[list[float]] = []  # of each session, after each number of questions
        self._lengths: list[float] = []  # inf: the session did not end
        self._cut_off = 0  # sessions in which the interview would ask on by itself
        self.ready = False
        """True if nothing will be added."""

    def steps(self) -> Iterator[None]:
        """Compute the forecasts, one simulated answer in each step."""
        try:
            until = time.monotonic() + _SECONDS_OF_PROSPECTS
            known = self._twin.comparator if isinstance(self._twin, Compares) else None
            for says in plausible_tutors(known, self._seed, "prospects", range(_RUNS)):
                asker, asked, losses = copy.deepcopy(self._twin), 0, []
                for budget in self.questions:
                    while asked < _proving(budget):
                        query = next(iter(asker.ask()), None)
                        if query is None or self._ends(query):
                            break
                        tell(asker, Answer(query, says(query)))
                        asked += 1
                        yield
                        if time.monotonic() > until:
                            return
                    losses.append(_loss_of(asker))
                    yield
                ended = self._enough is None or self._enough(copy.deepcopy(asker).result())
                self._cut_off += not ended and asked < _proving(self.questions[-1])
                self._losses.append(losses)
                self._lengths.append(asked if ended else math.inf)
        finally:
            self.ready = True

    def found(self) -> list[Prospect]:
        """Return the forecasts known by now, for each number of questions, or an empty list."""
        lengths, losses = [*self._lengths], [*self._losses]
        n = len(lengths)
        if n < _FEWEST_RUNS or 2 * self._cut_off >= n:
            return []
        return [
            Prospect(
                budget,
                n,
                sum(length < _proving(budget) for length in lengths),
                sorted(one[i] for one in losses[:n])[n // 2],
            )
            for i, budget in enumerate(self.questions)
        ]

    def lengths(self) -> tuple[int, int] | None:
        """Return the least and the greatest length of the simulated sessions, or None.

        Lengths include checks. One session may have taken longer. The result is None if too few
        sessions were simulated, or more than one of them did not end.
        """
        lengths = sorted(self._lengths)
        if len(lengths) < _FEWEST_RUNS or lengths[-2] >= _proving(self.questions[-1]):
            return None
        return _with_checks(lengths[0]), _with_checks(lengths[-2])

    def length(self) -> int | None:
        """Return the number of questions, including checks, that suffices in half of the sessions.

        The result is None if too few sessions were simulated, or half of them did not end.
        """
        lengths = sorted(self._lengths)
        if len(lengths) < _FEWEST_RUNS:
            return None
        middle = lengths[len(lengths) // 2]
        if middle >= _proving(self.questions[-1]):
            return None
        return _with_checks(middle)


def _with_checks(questions: float) -> int:
    """Return the number of questions including checks, from the number without."""
    return int(questions) + max(LEAST_CHECKS, int(questions) // (_CHECKS - 1))


def _proving(questions: int) -> int:
    """Return the number of questions without checks, from the number including them."""
    return max(0, questions - max(LEAST_CHECKS, questions // _CHECKS))


def _loss_of(asker: Asker) -> float:
    loss = _stated_loss(copy.deepcopy(asker).result())
    return math.nan if loss is None else loss


def _stated_loss(result: Any) -> float | None:
    loss = getattr(result, "loss_bound", math.nan)
    known = isinstance(loss, int | float) and not math.isnan(loss)
    return float(loss) if known else None
