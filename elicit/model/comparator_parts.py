"""The optional parts of a comparator: their table, their protocols, and functions that read them.

Each function says what it returns if the part is missing.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from elicit.model.comparator import Comparator, bounds_of, offers
from elicit.model.difference import as_differences, tail_sums
from elicit.model.query import Answers, InconsistentAnswers, Verdict
from elicit.model.scale import Floats, order_bounds


@runtime_checkable
class BoundsAllAtOnce(Protocol):
    """A comparator with bounds that hold together, and so can guarantee a policy."""

    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e that hold for all rows at once, and their confidence.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        hi : (n,) in units of e_k - e_1
        confidence : float
            The probability that all of them hold. It is 1 if they are certain as long as the
            answers are right, and nan if no probability can be stated.
        """


@runtime_checkable
class BoundsWhatMatters(Protocol):
    """A comparator that saves time if only bounds above some number must be exact."""

    def bounds_above(self, d: ArrayLike, enough: ArrayLike) -> tuple[Floats, float]:
        """Return ``simultaneous_bounds`` of d (n, k), but bounds up to ``enough`` may be loose.

        ``enough`` is a number or (n,). If the exact bound is at most this, the result may be any
        number between the two. The confidence is that of ``simultaneous_bounds``.
        """


@runtime_checkable
class ForeseesBounds(Protocol):
    """A comparator that can say which bounds an answer would leave, without learning the answer."""

    def bounds_after(self, asked: ArrayLike, d: ArrayLike, enough: ArrayLike) -> Floats:
        """Return roughly the simultaneous bounds on d.e that there would be after each answer.

        The result is (c, 2, n), for c questions ``asked`` (c, k), the answers worse and better, and
        n differences d (n, k). A bound is -inf if the answer contradicts earlier ones. If a bound
        is at most ``enough``, a number or (n,), any number up to ``enough`` may take its place.
        """


@runtime_checkable
class PredictsAnswers(Protocol):
    """A comparator with a model of the tutor's next answer."""

    def probability(self, d: ArrayLike) -> Floats | tuple[Floats, ...]:
        """Return the probability (n,) that the tutor says left is better, for d (n, k).

        The two posteriors have ``answer_probability`` for that: their ``probability`` leaves out
        the tutor's errors. If there are several arrays, such as the ends of an interval, the last
        is the best guess.
        """


class Part(NamedTuple):
    """An optional part of a comparator, described for the docs.

    Attributes
    ----------
    protocol : str
        The name of its type.
    signature : str
        How it is called.
    gives : str
        Its value, or the result of a call.
    use : str
        What is done with it, and without it.
    offered_by : tuple of str
        The comparators of elicit that have it.
    """

    protocol: str
    signature: str
    gives: str
    use: str
    offered_by: tuple[str, ...]

    @property
    def member(self) -> str:
        """The name of the part as a member of a comparator."""
        return self.signature.split("(")[0]


_PANEL = ("Panel",)
_OPEN = "OpenOrderComparator"
_POLYTOPE = "PolytopeComparator"
_MODELS = ("PosteriorComparator", "BradleyTerryComparator")
_DRAWING = (_POLYTOPE, *_MODELS)
_OPEN_MODEL = "OpenOrderPosterior"
_LEARNING = (*_DRAWING, _OPEN, _OPEN_MODEL)
_ALL = (*_LEARNING, "Dominance", "AlwaysAsk")

OPTIONAL_PARTS = (
    Part(
        "BoundsAllAtOnce",
        "simultaneous_bounds(d)",
        "upper bounds (n,) on d.e that hold for all rows at once, and the confidence that they do",
        "Bounds what a policy may lose. Without it `bounds` does, with a confidence of nan, and "
        "policy iteration and "
        "value iteration end BOUNDED, not CONVERGED.",
        _ALL + _PANEL,
    ),
    Part(
        "BoundsWhatMatters",
        "bounds_above(d, enough)",
        "beside `simultaneous_bounds`: the same, but bounds up to `enough` may be any up to that",
        "Saves time while a policy is far from proven. Without it `simultaneous_bounds` is used.",
        ("PolytopeComparator",),
    ),
    Part(
        "ForeseesBounds",
        "bounds_after(asked, d, enough)",
        "beside `simultaneous_bounds`: about these (c, 2, n), after the answers worse and better "
        "to c questions",
        "Cuts are chosen by it. Without it a comparator is told each answer on trial.",
        ("PolytopeComparator",),
    ),
    Part(
        "HasDraws",
        "draws",
        "plausible scales: gaps (k - 1, m), weights (m,), precisions (m,), or None for now",
        "Questions are chosen by it. Without it they are chosen by scales drawn from all ordered "
        "ones.",
        _LEARNING + _PANEL,
    ),
    Part(
        "TrustsDraws",
        "level",
        "beside `draws`, if the bounds depend on them: the weight of draws that a verdict needs",
        "The loss of a policy is bounded under that share of the draws.",
        (*_MODELS, _OPEN_MODEL, *_PANEL),
    ),
    Part(
        "StatesConfidence",
        "confidence",
        "beside `level`: the probability with which guarantees under the draws hold; nan for none",
        "Is a result's confidence. Without it `level` is.",
        ("BradleyTerryComparator", "Panel"),
    ),
    Part(
        "PredictsAnswers",
        "probability(d)",
        "(n,) the probability that the tutor says left is better; of several arrays the last is "
        "the best guess",
        "`held_out` scores it, and policy iteration asks about magnified differences (`bags`). "
        "Without it there is no log-likelihood.",
        (*_MODELS, _OPEN_MODEL),
    ),
    Part(
        "MadeOfCells",
        "cells",
        "`elicit.parts.Cell`s: comparators whose plausible scales together make up this one's",
        "The loss of a policy is bounded in each cell, and the greatest bound counts. Without it "
        "there is one cell.",
        ("PolytopeComparator",),
    ),
    Part(
        "AllowsWrong",
        "wrong",
        "the number of answers that may be wrong, from 0 on",
        "An open pair is asked about again until `wrong` + 1 answers agree. Without it one "
        "answer will do.",
        ("PolytopeComparator",),
    ),
    Part(
        "AllowsLapses",
        "lapse",
        "the share of answers given at random, 0 up to 1",
        "Questions are chosen by it. Without it 0 is taken.",
        ("PosteriorComparator", _OPEN_MODEL, *_PANEL),
    ),
    Part(
        "AllowsTies",
        "tie",
        "the largest |d.e|, a share of the value range, that the tutor may call equal",
        "Learners stop asking about pairs so near that were called equal. Without it EQUAL means "
        "equal.",
        _ALL + _PANEL,
    ),
    Part(
        "KeepsAnswers",
        "answers",
        "`elicit.Answers`, all it was told, in order",
        "It is not told again what it knows already.",
        _LEARNING + _PANEL,
    ),
    Part(
        "LearnsInSteps",
        "answers_to_next_step",
        "how many more answers, at least 1, it takes until verdicts may change; then `update` must "
        "take any answers",
        "Until then Q-learning's compiled loop asks a simulated tutor by itself.",
        _MODELS,
    ),
    Part(
        "Ruled",
        "rule",
        "an `elicit.decision.comparator_rule.Rule`: what it knows, as arrays",
        "Compiled loops decide by it. Without it they call `compare`.",
        _ALL + _PANEL,
    ),
    Part(
        "DecidesRest",
        "decide_rest(d)",
        "beside `rule`: verdicts and tiers (n,) of what the rule leaves open",
        "Compiled loops call it there.",
        (_POLYTOPE, _OPEN, *_PANEL),
    ),
    Part(
        "LearnsInLoops",
        "learned_in_loop(answers, rule)",
        "beside a `rule` that `grows`: itself after answers that the loop has added to that rule",
        "Q-learning's compiled loop asks a truthful simulated tutor by itself.",
        ("PolytopeComparator",),
    ),
    Part(
        "KnowsPeople",
        "people",
        "the names of those who answer, whose scales it combines",
        "With several, no answer of one of them decides a pair for all, and a cut is asked of one. "
        "Without it there is one tutor.",
        _PANEL,
    ),
    Part(
        "ChoosesWhom",
        "whom(d, besides)",
        "beside `people`: the name to ask about one d (k,), and what to ask them about, as an "
        "`elicit.parts.PersonAsked`; None if nobody can tell more",
        "A question is put to that person, who is its `Query.who`.",
        _PANEL,
    ),
    Part(
        "LeavesOrderOpen",
        "unordered",
        "the two neighbouring levels, counted from 0, of which either may be the better",
        "`choose` and policy iteration go by its verdicts and bounds alone. Other learners refuse "
        "it. Without it the order of the levels is certain.",
        (_OPEN, _OPEN_MODEL),
    ),
)
"""All optional parts. ``elicit.testing`` checks them, and docs/your-own-comparator.md is compared
with this table.
"""


def best_guess(comparator: Comparator) -> Floats:
    """Return ``comparator.values`` (k,), after a check.

    Raises TypeError unless these are numbers that rise from 0 to 1. They need not rise between two
    levels whose order the comparator leaves open.
    """
    values = np.asarray(comparator.values, dtype=np.float64)
    open_step = unordered_of(comparator)
    if open_step is not None and values.shape == (comparator.k,):
        low = open_step[0]
        values_in_order = values.copy()
        values_in_order[low : low + 2] = np.sort(values[low : low + 2])
    else:
        values_in_order = values
    ends = (
        values.shape == (comparator.k,)
        and abs(values_in_order[0]) < 1e-6
        and abs(values_in_order[-1] - 1.0) < 1e-6
    )
    if not (ends and (np.diff(values_in_order) >= -1e-9).all()):
        raise TypeError(
            f"{type(comparator).__name__}.values must be an array ({comparator.k},) that rises "
            "from 0 to 1, the best "
            f"single guess at the scale, not {comparator.values!r}"
        )
    return values


def simultaneous_bounds(comparator: Comparator, d: ArrayLike) -> tuple[Floats, float]:
    """Return upper bounds (n,) on d.e that hold for all rows of d (n, k), and their confidence.

    Bounds above those that the order of the levels gives are replaced by the latter.

    Parameters
    ----------
    comparator : Comparator
        Holds what is known of the scale. If it has no ``simultaneous_bounds``, its ``bounds`` are
        used, with a confidence of nan.
    d : (n, k)
        Differences left - right. A single difference (k,) counts as one row.

    Returns
    -------
    high : (n,)
        The upper bounds, in units of e_k - e_1.
    confidence : float
        The probability that all of them hold. It is 1 if they are proven, given that the answers
        are right, and nan if no probability can be stated.

    Raises
    ------
    ValueError
        If d has another shape or is not finite, as ``as_differences`` says.
    TypeError
        If the comparator returns anything but bounds (n,).
    """
    rows = as_differences(d, comparator.k)
    if offers(comparator, "simultaneous_bounds"):
        return _within_order(
            comparator, rows, cast(BoundsAllAtOnce, comparator).simultaneous_bounds(d)
        )
    return np.minimum(bounds_of(comparator, rows)[1], order_bounds(tail_sums(rows), 0.0)[1]), np.nan


def bounds_above(
    comparator: Comparator, d: ArrayLike, enough: float | Floats
) -> tuple[Floats, float]:
    """Return ``simultaneous_bounds`` of d (n, k), but bounds up to ``enough`` may be loose.

    ``enough`` is a number or (n,). If the exact bound is at most this, the result may be any number
    between the two. A comparator with ``bounds_above`` then takes less time.
    """
    if not offers(comparator, "bounds_above"):
        return simultaneous_bounds(comparator, d)
    rows = as_differences(d, comparator.k)
    return _within_order(
        comparator, rows, cast(BoundsWhatMatters, comparator).bounds_above(d, enough)
    )


def _within_order(
    comparator: Comparator, d: Floats, found: tuple[Floats, float]
) -> tuple[Floats, float]:
    """Return a comparator's bounds on d (n, k), after a check.

    Where the order of the levels gives a bound that is lower by more than rounding, that bound is
    returned instead.
    """
    high, confidence = _checked_bounds(found, type(comparator).__name__, len(d))
    if unordered_of(comparator) is not None:
        return high, confidence
    most = order_bounds(tail_sums(d), 0.0)[1]
    rounding = 1e-9 * np.maximum(np.abs(d).sum(axis=1), 1.0)
    return np.where(high > most + rounding, most, high), confidence


def bounds_after(
    comparator: Comparator, asked: Floats, d: Floats, enough: float | Floats
) -> Floats:
    """Return roughly the simultaneous bounds on d.e that there would be after each answer.

    The result is (c, 2, n), for c questions ``asked`` (c, k), the answers worse and better, and n
    differences d (n, k). A bound is -inf if the answer contradicts earlier ones. If a bound is at
    most ``enough``, a number or (n,), any number up to ``enough`` may take its place.
    """
    if offers(comparator, "bounds_after"):
        return cast(ForeseesBounds, comparator).bounds_after(asked, d, enough)
    return bounds_on_trial(comparator, asked, d)


def bounds_on_trial(comparator: Comparator, asked: Floats, d: Floats) -> Floats:
    """Compute ``bounds_after`` the slow way, by an update of the comparator with each answer.

    The comparator itself stays as it is.
    """
    out = np.full((len(asked), 2, len(d)), -np.inf)
    for i, row in enumerate(asked):
        for part, verdict in enumerate((Verdict.WORSE, Verdict.BETTER)):
            try:
                known = comparator.update(Answers(row[None], [int(verdict)]))
            except InconsistentAnswers:
                continue
            out[i, part] = simultaneous_bounds(known, d)[0]
    return out


def _checked_bounds(found: object, name: str, n: int) -> tuple[Floats, float]:
    """Return the result of ``simultaneous_bounds`` for n differences, after a check.

    Raises TypeError unless it is an array (n,) and a number.
    """
    if isinstance(found, tuple) and len(found) == 2:
        high, confidence = np.asarray(found[0]), found[1]
        if (
            high.shape == (n,)
            and high.dtype == np.float64
            and not np.isnan(high).any()
            and np.ndim(confidence) == 0
        ):
            return high, confidence
    raise TypeError(
        f"{name}.simultaneous_bounds(d) must return upper bounds (n,) on d.e that hold for all "
        "rows at once, and the "
        f"confidence in them, a number (nan where none can be stated), but of {n} differences it "
        f"returns {found!r}"
    )


@runtime_checkable
class HasDraws(Protocol):
    """A comparator with draws: weighted plausible scales, by which questions are chosen."""

    @property
    def draws(self) -> tuple[Floats, Floats, Floats] | None:
        """Weighted plausible scales, or None if there are none yet.

        They are gaps (p, m), weights (m,) of total 1, and the tutor's precision (m,) under each
        scale, as in ``elicit.lp.hit_and_run.Draws``.
        """


@runtime_checkable
class TrustsDraws(HasDraws, Protocol):
    """A comparator with draws: its bounds hold under a share, ``level``, of their total weight."""

    @property
    def level(self) -> float:
        """The share of the draws' weight under which a guarantee holds, below 1."""


@runtime_checkable
class StatesConfidence(Protocol):
    """A comparator that states the confidence of its guarantees.

    It is needed if draws are used and the confidence differs from the draws' share ``level``.
    """

    @property
    def confidence(self) -> float:
        """The probability with which guarantees hold; nan if none can be stated."""


@runtime_checkable
class AllowsLapses(Protocol):
    """A comparator whose model is that the tutor answers some questions at random."""

    @property
    def lapse(self) -> float:
        """The share of answers given at random."""


@runtime_checkable
class KeepsAnswers(Protocol):
    """A comparator that keeps the answers that it has learned."""

    @property
    def answers(self) -> Answers:
        """All answers learned, in the order in which they were told."""


@runtime_checkable
class LearnsInSteps(Protocol):
    """A comparator that may need several answers before its verdicts change.

    Its ``update`` takes any answers, also contradictory ones. Compiled loops keep using its arrays
    until verdicts may change.
    """

    @property
    def answers_to_next_step(self) -> int:
        """The number of further answers, at least 1, until verdicts may change."""


class Cell(NamedTuple):
    """Part of a comparator's plausible scales: those for which a given set of answers is wrong.

    Attributes
    ----------
    scales : Comparator
        A comparator whose plausible scales are the cell.
    wrong : tuple of int
        Rows of the answers that are wrong in the cell, in ascending order.
    weight : float
        How plausible the cell is, in total 1 over all cells. It serves to choose questions.
    """

    scales: Comparator
    wrong: tuple[int, ...]
    weight: float


@runtime_checkable
class MadeOfCells(Protocol):
    """A comparator whose plausible scales are the union of those of several comparators."""

    @property
    def cells(self) -> Sequence[Cell]:
        """The cells, at least one."""


@runtime_checkable
class AllowsWrong(Protocol):
    """A comparator for which a number of answers, without knowing which, may be wrong."""

    @property
    def wrong(self) -> int:
        """The largest number of answers that may be wrong."""


class PersonAsked(NamedTuple):
    """A person, and a difference (k,) to ask them about.

    Attributes
    ----------
    who : str
        The person's name.
    d : (k,)
        The difference left - right.
    """

    who: str
    d: Floats


@runtime_checkable
class KnowsPeople(Protocol):
    """A comparator that combines the answers of several people."""

    @property
    def people(self) -> Sequence[str]:
        """The people's names, at least one."""


@runtime_checkable
class ChoosesWhom(Protocol):
    """A comparator of several people that says which of them to ask."""

    def whom(self, d: ArrayLike, besides: Sequence[str] = ()) -> PersonAsked | None:
        """Return the person to ask about a difference d (k,), and the difference to ask them about.

        People in ``besides`` are not to be asked. The result is None if no further answer would
        help.
        """


@runtime_checkable
class LeavesOrderOpen(Protocol):
    """A comparator that does not know which of two neighbouring levels is the better."""

    @property
    def unordered(self) -> tuple[int, int]:
        """The two levels of unknown order, counted from 0, the lower number first."""


@runtime_checkable
class AllowsTies(Protocol):
    """A comparator for a tutor who may call equal two things that are only nearly so."""

    @property
    def tie(self) -> float:
        """The largest |d.e|, as a share of the value range, that the tutor may call equal."""


def trusted_share(comparator: object) -> float | None:
    """Return the share of a comparator's draws under which its bounds hold, or None.

    It is None if the bounds do not depend on draws. The draws themselves are not computed.
    """
    if not (offers(comparator, "level") and offers(comparator, "draws")):
        return None
    return float(cast(TrustsDraws, comparator).level)


def stated_confidence(comparator: Comparator, level: float) -> float:
    """Return the confidence of a comparator's guarantees, if its bounds depend on draws.

    It is the comparator's ``confidence`` if it has one, else ``level``.
    """
    return (
        cast(StatesConfidence, comparator).confidence if offers(comparator, "confidence") else level
    )


def draws_in(comparator: Comparator) -> tuple[Floats, Floats, Floats] | None:
    """Return a comparator's ``draws`` after a check: gaps (p, m), weights and precisions (m,).

    It is None if the comparator has none, or none yet. Raises TypeError that says what is wrong
    with them.
    """
    found = getattr(comparator, "draws", None)
    if found is None:
        return None
    p = comparator.k - 1
    parts = (
        [np.asarray(part) for part in found] if isinstance(found, tuple) and len(found) == 3 else []
    )
    wrong = f"it is {type(found).__name__}"
    if parts:
        (gaps, weights, precision), shapes = parts, ", ".join(str(part.shape) for part in parts)
        m = gaps.shape[-1] if gaps.ndim == 2 else 0
        totals = np.zeros(m)
        if m and gaps.dtype == np.float64:
            totals = _ranges(gaps) if offers(comparator, "unordered") else gaps.sum(axis=0)
        if not m or (gaps.shape, weights.shape, precision.shape) != ((p, m), (m,), (m,)):
            wrong = f"their shapes are {shapes}"
        elif not all(part.dtype == np.float64 for part in parts):
            wrong = f"their types are {', '.join(str(part.dtype) for part in parts)}, not float64"
        elif not (np.abs(totals - 1.0) <= 1e-6).all():  # also where one is nan
            wrong = (
                f"the gaps of draw {int(np.argmin(np.abs(totals - 1.0) <= 1e-6))} do not total 1"
            )
        elif not ((weights >= 0).all() and abs(weights.sum() - 1.0) <= 1e-6):
            wrong = f"the weights range from {weights.min()} and total {weights.sum()}"
        elif not (precision >= 0).all():
            wrong = f"the least precision is {precision.min()}"
        else:
            return gaps, weights, precision
    raise TypeError(
        f"{type(comparator).__name__}.draws must be None or a tuple: the gaps of m scales ({p}, "
        "m), each total 1, "
        f"their weights (m,) of total 1, and the tutor's precision (m,) under each, but {wrong}"
    )


def _ranges(gaps: Floats) -> Floats:
    """Return the value range (m,) of scales with gaps (p, m), some of which may be negative."""
    values = np.vstack([np.zeros(gaps.shape[1]), np.cumsum(gaps, axis=0)])
    return np.asarray(values.max(axis=0) - values.min(axis=0))


def tie_of(comparator: Comparator) -> float:
    """Return the largest |d.e| that a comparator's tutor may call equal; 0 if it does not say."""
    return float(cast(AllowsTies, comparator).tie) if offers(comparator, "tie") else 0.0


def cells_of(comparator: Comparator) -> Sequence[Cell]:
    """Return the comparator's cells. If it is not made of cells, it is itself the only cell."""
    cells = cast(MadeOfCells, comparator).cells if offers(comparator, "cells") else ()
    return cells if len(cells) > 1 else (Cell(comparator, (), 1.0),)


def unordered_of(comparator: Comparator) -> tuple[int, int] | None:
    """Return the two neighbouring levels whose order a comparator leaves open, or None."""
    if not offers(comparator, "unordered"):
        return None
    low, high = cast(LeavesOrderOpen, comparator).unordered
    return int(low), int(high)


def wrong_of(comparator: Comparator) -> int:
    """Return the number of answers that may be wrong; 0 if the comparator does not say."""
    return int(cast(AllowsWrong, comparator).wrong) if offers(comparator, "wrong") else 0


def people_of(comparator: object) -> tuple[str, ...]:
    """Return the names of the people whose answers a comparator combines; () if it does not say."""
    found = offers(comparator, "people") and offers(comparator, "whom")
    return tuple(cast(KnowsPeople, comparator).people) if found else ()


def whom_of(comparator: Comparator, d: Floats, besides: Sequence[str] = ()) -> PersonAsked | None:
    """Return the person to ask about d (k,), and the difference to ask them about.

    A comparator of several people chooses both. Raises TypeError if the person is none of its
    people.
    """
    asked = cast(ChoosesWhom, comparator).whom(d, besides)
    if asked is not None and asked.who not in people_of(comparator):
        raise TypeError(
            f"{type(comparator).__name__}.whom(d) must name one of its people, not {asked.who!r}"
        )
    return asked


def lapse_of(comparator: Comparator) -> float:
    """Return the share of answers that a comparator takes to be given at random.

    It is 0 if the comparator does not say.
    """
    return float(cast(AllowsLapses, comparator).lapse) if offers(comparator, "lapse") else 0.0
