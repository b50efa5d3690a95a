"""The loop that drives a learner: it asks the tutor, logs the answers, and tells them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.seeds import seed_of
from elicit._support.validation import require
from elicit.asking.elicitation import OnConflict
from elicit.comparators.baselines import AlwaysAsk
from elicit.model.comparator import Comparator
from elicit.model.query import Answer, InconsistentAnswers, Query, Verdict, match
from elicit.model.scale import Floats
from elicit.model.tutor import TutorOfMany, answer_of, check_tutor_made
from elicit.tutors.answer_log import EXPECTED, AnswerLog
from elicit.tutors.panel import as_one_tutor
from qlearn.learners.loops.action_pair_kernel import AnswersInLoops

R_co = TypeVar("R_co", covariant=True)

_SIDES = name_code("sides that a tutor is shown")
_TWO_SIDES = re.compile(r"((?:.*?: )?)(.*) \(left\)(,? or )(.*) \(right\)(.*)", re.DOTALL)
_ACTION = "action "

TutorLike: TypeAlias = Callable[[Query], Answer | int]
"""A ``Tutor``, or a function that returns a verdict on the query's left vector in place of an
Answer.
"""

Tutors: TypeAlias = TutorLike | Mapping[str, TutorLike]
"""One tutor, or the tutor of each person by name: see ``elicit.PanelTutor``."""


class Drivable(Protocol[R_co]):
    """Anything with ``ask``, ``tell`` and ``result``, such as a learner, that ``drive`` can run."""

    @property
    def comparator(self) -> Comparator:
        """The comparator with all answers learned so far."""

    @property
    def implied(self) -> dict[str, Verdict]:
        """The verdicts that the answers so far imply for pending audits, by query id."""

    def ask(self) -> tuple[Query, ...]:
        """Return the pending queries, the same until they are answered, or () if there are none."""

    def tell(
        self, answers: Sequence[Answer], on_conflict: OnConflict = "raise"
    ) -> tuple[Answer, ...]:
        """Take answers to pending queries. Return those that were dropped."""

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]] | None) -> None:
        """Have the function ``signs`` answer from now on, if the learner can use it.

        None: ask the tutor again.
        """

    def result(self) -> R_co:
        """Return the result so far."""


@runtime_checkable
class AsksWithin(Protocol):
    """A learner whose compiled loop can ask a simulated tutor directly."""

    def ask_within(self, tutor: AnswersInLoops | None) -> None:
        """Ask this tutor from within the loop from now on, if the results stay the same."""


def drive(
    learner: Drivable[R_co],
    tutor: Tutors,
    log: AnswerLog | None = None,
    progress: Callable[[R_co], None] | None = None,
    on_conflict: OnConflict = "raise",
    seed: Seed | None = 0,
) -> R_co:
    """Ask and tell until the learner asks no more.

    It has then finished, or waits for a policy to be trained.

    Parameters
    ----------
    learner : Drivable
        Anything with ``ask``, ``tell`` and ``result``, such as a learner.
    tutor : function, or mapping of str to function
        It takes a query and returns an Answer, or a verdict on the query's left vector: a Verdict,
        or 1, 0, -1. ``Answer(query, None)`` says "cannot tell". For several people, give the tutor
        of each by name: ``{"ann": tutor, "ben": another}``.
    log : AnswerLog, optional
        Every answer goes there before the learner is told. If the tutor raises an error, or is
        interrupted, at one of several questions (``batch``), the earlier answers are still logged
        and told. AlwaysAsk with a simulated tutor asks so much that only counts are kept.
    progress : function, optional
        Called with the Result so far after every round of questions.
    on_conflict : {"raise", "drop"}
        An answer that contradicts the others is marked unused in the log. Then it raises
        InconsistentAnswers, or with "drop" decides its own pair only.
    seed : optional
        Draws the sides. The tutor sees a random half of the pairs with left and right exchanged, so
        that a preference for one side favours no policy. Answers are told and logged in terms of
        the learner's own left, with ``swapped`` for exchanged pairs. None: the sides are drawn anew
        each time.

    Returns
    -------
    Result
        The learner's ``result()`` at the end. Other learners return their own kind, such as a
        TrainingResult.

    Raises
    ------
    TypeError
        If the learner cannot be asked and told, the tutor cannot be called, or ``log`` or
        ``progress`` is something else.
    StaleAnswer
        If the tutor answers another question, before any answer of the round is logged.
    InconsistentAnswers
        Unless ``on_conflict="drop"``.
    """
    require(on_conflict in ("raise", "drop"), "on_conflict", "'raise' or 'drop'", on_conflict)
    _check_learner(learner, tutor)
    if log is not None and not isinstance(log, AnswerLog):
        raise TypeError(
            "log must be None or an elicit.AnswerLog, such as AnswerLog('answers.jsonl'), not "
            f"{log!r}"
        )
    if progress is not None and not callable(progress):
        raise TypeError(
            f"progress must be None or a function that takes the result so far, not {progress!r}"
        )
    tutor = as_one_tutor(tutor, learner.comparator)
    check_tutor_made(tutor, learner.comparator.k)
    signs = _signs_of(tutor) if isinstance(learner.comparator, AlwaysAsk) else None
    if signs is not None:
        learner.consult(signs)
    quiet = log is None and progress is None
    own = hasattr(
        type(tutor), "respondent"
    )  # not passed on from a tutor that this one wraps, who must be called
    if quiet and own and isinstance(tutor, AnswersInLoops) and isinstance(learner, AsksWithin):
        learner.ask_within(tutor)
    try:
        return _driven(learner, _by_sides(tutor, seed), log, progress, on_conflict)
    finally:  # the next to ask the comparator must not get this tutor's answers
        if signs is not None:
            learner.consult(None)
        if isinstance(learner, AsksWithin):
            learner.ask_within(None)


def _check_learner(learner: object, tutor: object) -> None:
    """Raise TypeError unless the learner has ``ask``, ``tell`` and ``comparator``."""
    parts = ("ask", "tell", "comparator")
    lacking = [part for part in parts if not hasattr(learner, part)]
    if not lacking and not isinstance(learner, type):
        return
    swapped = not isinstance(tutor, type) and all(hasattr(tutor, part) for part in parts)
    raise TypeError(
        "the learner and the tutor are swapped: write drive(learner, tutor)"
        if swapped
        else f"drive(learner, tutor) wants a learner first, but {learner!r} is the class of one: "
        "make one of it"
        if not lacking
        else "drive(learner, tutor) wants a learner first, such as "
        f"InteractivePolicyIteration(mdp, comparator), but {learner!r} has no {lacking[0]}"
    )


def _signs_of(tutor: TutorLike) -> Callable[[ArrayLike], NDArray[np.int8]] | None:
    """Return the tutor's ``signs``, which answers many questions at once, or None.

    It is None if the tutor has none. It is also None if a derived class or a wrapper changes how a
    single question is answered, because ``signs`` would ignore that.
    """
    if isinstance(tutor, TutorOfMany):
        for place in (tutor, *type(tutor).__mro__):
            own = getattr(place, "__dict__", {})
            if "signs" in own:
                return tutor.signs
            if isinstance(place, type) and "__call__" in own:
                break
    return None


def _by_sides(tutor: TutorLike, seed: Seed | None) -> Callable[[Query], Answer]:
    """Return a tutor that shows the given tutor half of the queries with sides exchanged."""
    key = key_of(seed_of(seed))

    def ask(query: Query) -> Answer:
        if int(fold(key, _SIDES, name_code(query.id))) & 1:
            return answer_of(tutor(query), query)
        shown = exchanged(query)
        answer = answer_of(tutor(shown), shown)
        if not isinstance(answer, Answer) or answer.query.id != query.id:
            return answer  # refused by ``match``
        verdict = None if answer.verdict is None else answer.verdict.flipped
        # the rest of the answer, such as who gave it, stays
        return replace(answer, query=query, verdict=verdict, swapped=not answer.swapped)

    return ask


def exchanged(query: Query) -> Query:
    """Return the query with left and right exchanged, also in its text."""
    return replace(query, left=query.right, right=query.left, about=_exchanged_text(query.about))


def _exchanged_text(about: str) -> str:
    """Return "x: b (left) or a (right)?" for "x: a (left) or b (right)?".

    If the text has another form, or if a name in it contains ": ", "(left)" or "(right)", each
    "(left)" becomes "(right)", each "(right)" becomes "(left)", and all else stays.
    """
    found = _TWO_SIDES.fullmatch(about)
    if not found or about.count(": ") > 1 or len(re.findall(r"\((?:left|right)\)", about)) > 2:
        words = {"(left)": "(right)", "(right)": "(left)"}
        return re.sub(r"\((left|right)\)", lambda found: words[found[0]], about)
    place, left, either, right, end = found.groups()
    if left.startswith(_ACTION) and not right.startswith(_ACTION):  # it is said once, of the left
        left, right = left.removeprefix(_ACTION), _ACTION + right
    return f"{place}{right} (left){either}{left} (right){end}"


def _driven(
    learner: Drivable[R_co],
    tutor: Callable[[Query], Answer],
    log: AnswerLog | None,
    progress: Callable[[R_co], None] | None,
    on_conflict: OnConflict,
) -> R_co:
    while queries := learner.ask():
        given: list[Answer] = []
        try:
            for query in queries:
                given.append(tutor(query))
        except BaseException as error:  # also Ctrl+C: earlier answers of the tutor are kept
            try:
                _log_and_tell(learner, match(given, queries), log, on_conflict)
            except InconsistentAnswers as conflict:
                error.add_note(f"The answers given before were logged, but not learned: {conflict}")
            raise
        _log_and_tell(learner, match(given, queries), log, on_conflict)
        if progress is not None:
            progress(learner.result())
    return learner.result()


def _log_and_tell(
    learner: Drivable[Any],
    answers: Sequence[Answer],
    log: AnswerLog | None,
    on_conflict: OnConflict,
) -> None:
    """Log the answers, and then tell them to the learner."""
    if not answers:
        return
    if log is not None:
        _append(log, answers, learner.implied)
    try:
        dropped = learner.tell(answers, on_conflict)
    except InconsistentAnswers:
        _mark_unused(log, answers)
        raise
    _mark_unused(log, dropped)


def _append(log: AnswerLog, answers: Sequence[Answer], implied: Mapping[str, Verdict]) -> None:
    for answer in answers:
        audited: dict[str, Any] = (
            {EXPECTED: int(implied[answer.query.id])} if answer.query.id in implied else {}
        )
        log.append(answer, **audited)


def _mark_unused(log: AnswerLog | None, answers: Sequence[Answer]) -> None:
    if log is not None:
        for answer in answers:
            log.mark_unused(answer.query.id)
