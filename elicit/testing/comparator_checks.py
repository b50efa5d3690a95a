"""Checks that a comparator fulfils its contract, including the optional parts that it has."""

from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed
from elicit._support.validation import is_number, is_whole
from elicit.comparators.baselines import AlwaysAsk
from elicit.decision.comparator_rule import (
    NO_ARRAYS,
    LearnsInLoops,
    Rule,
    compares_by_rule,
    rule_of,
)
from elicit.decision.verdicts import decide
from elicit.model.comparator import Comparator, Tier, is_comparator, offers
from elicit.model.comparator_parts import (
    ForeseesBounds,
    KeepsAnswers,
    PredictsAnswers,
    bounds_above,
    draws_in,
    simultaneous_bounds,
    unordered_of,
)
from elicit.model.difference import dominance, tail_sums
from elicit.model.query import Answers, InconsistentAnswers, Verdict
from elicit.model.scale import Floats
from elicit.testing.demands import TOLERANCE, demand, demand_near, demand_same, wanted
from elicit.testing.differences import sample_differences


def check_comparator(comparator: Comparator, seed: Seed | None = 0) -> None:
    """Check the whole ``Comparator`` contract, with all optional parts that the comparator has.

    The comparator is checked as it is, and after some answers of a tutor whose scale is
    ``comparator.values``. Dominance must decide first, unless the comparator's ``rule`` says that
    it does not (``AlwaysAsk``, Bradley-Terry with ``dominance=False``).

    Parameters
    ----------
    comparator : Comparator
    seed : int, SeedSequence, Generator or None

    Raises
    ------
    AssertionError
        If the comparator breaks the contract.
    """
    demand(is_comparator(comparator), "it must have k, values, bounds, compare and update")
    k = comparator.k
    demand(
        isinstance(k, (int, np.integer)) and k >= 2,
        f"k must be a whole number of at least 2, not {k!r}",
    )
    d = sample_differences(k, seed)
    _check_shapes(comparator, d)
    _check_errors(comparator, d)
    _check_all(comparator, d)
    _check_all(_check_update(comparator, d), d)


def _check_all(comparator: Comparator, d: Floats) -> None:
    _check_values(comparator)
    _check_verdicts(comparator, d)
    _check_bounds(comparator, d)
    _check_settings(comparator)
    _check_all_at_once(comparator, d)
    _check_draws(comparator)
    _check_probability(comparator, d)
    _check_rule(comparator, d)
    _check_learned_in_loop(comparator, d)


def _check_values(comparator: Comparator) -> None:
    values, k = np.asarray(comparator.values), comparator.k
    demand(values.shape == (k,), f"values must have shape ({k},), not {values.shape}")
    demand(
        abs(values.min()) <= 1e-9 and abs(values.max() - 1) <= 1e-9,
        f"values must run from 0 to 1, not {values}",
    )
    rising = np.diff(values) >= 0
    if (open_step := unordered_of(comparator)) is not None:
        rising[open_step[0]] = True
    demand(rising.all(), f"values must not decrease: {values}")
    demand((comparator.values == values).all(), "values must be the same each time")


def _check_shapes(comparator: Comparator, d: Floats) -> None:
    k = comparator.k
    for rows in (d, d[:1], d[:0]):
        found: list[tuple[str, str, NDArray[Any]]] = [("compare", "int8", comparator.compare(rows))]
        found += [("bounds", "float64", bound) for bound in comparator.bounds(rows)]
        for what, dtype, given in found:
            right = given.shape == (len(rows),) and given.dtype == dtype
            demand(
                right,
                f"{what} of d {rows.shape} must be ({len(rows)},) {dtype}, not {given.shape} "
                f"{given.dtype}",
            )
    demand(
        comparator.compare(d[0]).shape == (1,),
        f"compare must take one difference ({k},) as (1, {k})",
    )


def _check_errors(comparator: Comparator, d: Floats) -> None:
    k = comparator.k
    odd = {f"{value}": np.where(np.arange(k) == k - 1, value, d[:2]) for value in (np.nan, np.inf)}
    bad = {"too many levels": np.zeros((2, k + 1)), "three axes": np.zeros((1, 2, k)), **odd}
    calls: list[tuple[Any, Any, str]] = [
        (method, rows, f"{method.__name__} of differences with {what}")
        for method in (comparator.compare, comparator.bounds)
        for what, rows in bad.items()
    ]
    for method, argument, what in (
        *calls,
        (comparator.update, Answers.none(k + 1), f"update with {k + 1} levels"),
    ):
        try:
            method(argument)
        except (ValueError, TypeError):
            continue
        except Exception as error:
            raise AssertionError(
                f"{what} must raise ValueError or TypeError, not {type(error).__name__}: {error}; "
                "elicit.as_differences(d, k) checks differences for you"
            ) from error
        raise AssertionError(
            f"{what} must raise ValueError or TypeError; elicit.as_differences(d, k) checks "
            "differences for you"
        )


def _check_verdicts(comparator: Comparator, d: Floats) -> None:
    given = d.copy()
    given.flags.writeable = False
    verdicts = comparator.compare(given)
    known = np.isin(verdicts, list(Verdict))
    demand(known.all(), f"verdicts must be those of elicit.Verdict, not {verdicts[~known]}")
    plain = dominance(tail_sums(d))
    rule = rule_of(comparator)
    alone = (
        isinstance(rule, Rule) and rule.kind != NO_ARRAYS and not rule.dominance
    )  # with NO_ARRAYS ``decide_rest`` decides
    if alone or unordered_of(comparator) is not None:
        plain = np.where(plain == Verdict.EQUAL, plain, np.int8(Verdict.UNKNOWN))
    decided = plain != Verdict.UNKNOWN
    demand_same(
        "a verdict",
        verdicts[decided],
        "dominance, which holds for every scale",
        plain[decided],
        d[decided],
    )
    demand_same("compare", comparator.compare(d), "the same call before", verdicts, d)
    mirrored = np.where(verdicts == Verdict.UNKNOWN, verdicts, -verdicts)
    demand_same("compare(-d)", comparator.compare(-d), "-compare(d)", mirrored, d)
    for power in (-30, 1, 30):
        scaled = comparator.compare(d * 2.0**power)
        demand_same(
            f"compare(2^{power} d), which has the same sign,", scaled, "compare(d)", verdicts, d
        )
    single = np.concatenate([comparator.compare(row) for row in d])
    demand_same("a row compared alone", single, "the same row in a batch", verdicts, d)
    shuffled = np.random.default_rng(1).permutation(len(d))
    demand_same(
        "a shuffled batch",
        comparator.compare(d[shuffled]),
        "the batch",
        verdicts[shuffled],
        d[shuffled],
    )
    moved = d.copy()
    moved[:, 0] += 1.0
    demand_same(
        "compare with another level 1",
        comparator.compare(moved),
        "compare(d), for e_1 = 0,",
        verdicts,
        d,
    )


def _check_bounds(comparator: Comparator, d: Floats) -> None:
    low, high = comparator.bounds(d)
    demand(
        not (np.isnan(low) | np.isnan(high)).any(),
        "bounds must not be nan; nothing known is -inf and inf",
    )
    room = TOLERANCE * np.abs(d).sum(axis=1)
    zero = (tail_sums(d) == 0).all(axis=1)
    demand(
        ((low == 0) & (high == 0))[zero].all(), "bounds of two identical vectors must be 0 and 0"
    )
    verdicts = comparator.compare(d)
    wrong = {
        "lo <= hi": low > high + room,
        "BETTER goes with lo >= 0": (verdicts == Verdict.BETTER) & (low < -room),
        "WORSE goes with hi <= 0": (verdicts == Verdict.WORSE) & (high > room),
        "EQUAL goes with bounds of 0": (verdicts == Verdict.EQUAL)
        & ((low < -room) | (high > room)),
    }
    if not isinstance(comparator, AlwaysAsk):
        wrong["UNKNOWN goes with lo <= 0 <= hi"] = (verdicts == Verdict.UNKNOWN) & (
            (low > room) | (high < -room)
        )
    for rule, rows in wrong.items():
        i = int(np.argmax(rows))
        said = (
            f"on d = {d[i]} bounds are {low[i]}, {high[i]} and compare says "
            f"{Verdict(verdicts[i])!r}"
        )
        demand(not rows.any(), f"{rule}, but {said}")
    alone = np.array([np.concatenate(comparator.bounds(row)) for row in d]).T
    mirrored, doubled = comparator.bounds(-d), comparator.bounds(2 * d)
    for j, (name, bound) in enumerate((("lower", low), ("upper", high))):
        demand_near(
            f"the {name} bound of d must be minus the other one of -d", bound, -mirrored[1 - j], d
        )
        demand_near(f"the {name} bound of a row alone must be that in a batch", alone[j], bound, d)
        demand_near(f"the {name} bound of 2d must be twice that of d", doubled[j], 2 * bound, d)


def _check_settings(comparator: Comparator) -> None:
    """Check the values of optional members, such as ``lapse``, ``tie`` and ``answers``."""
    known: Any = comparator
    if offers(known, "lapse"):
        demand(
            is_number(known.lapse, 0, 1),
            f"lapse, a share of the answers, must be in 0..1, not {known.lapse!r}",
        )
    if offers(known, "tie"):
        right = is_number(known.tie, 0) and known.tie < 1
        demand(
            right,
            f"tie, a share of the value range, must be at least 0 and below 1, not {known.tie!r}",
        )
    if offers(known, "level") and offers(known, "draws"):
        right = is_number(known.level) and 0 < known.level < 1
        demand(
            right,
            f"level, a share of the draws' weight, must lie between 0 and 1, not {known.level!r}",
        )
    if offers(known, "confidence"):
        right = is_number(known.confidence, 0, 1) or np.isnan(known.confidence)
        demand(
            right,
            f"confidence, a probability, must be in 0..1, or nan for none, not {known.confidence!r}",  # noqa: E501
        )
    if offers(known, "answers_to_next_step"):
        more = known.answers_to_next_step
        demand(
            is_whole(more, 1),
            f"answers_to_next_step must be a whole number of at least 1, not {more!r}",
        )
    if offers(known, "wrong"):
        demand(
            is_whole(known.wrong, 0),
            f"wrong must be a whole number of at least 0, not {known.wrong!r}",
        )
    if offers(known, "unordered"):
        pair, k = known.unordered, comparator.k
        right = isinstance(pair, tuple) and len(pair) == 2 and all(is_whole(x, 0) for x in pair)
        demand(
            right and pair[1] == pair[0] + 1 < k,
            f"unordered must be two neighbouring levels below {k}, such as (0, 1), not {pair!r}",
        )
    if offers(known, "cells"):
        cells = known.cells
        right = len(cells) > 0 and all(
            is_comparator(cell.scales) and cell.scales.k == comparator.k for cell in cells
        )
        demand(
            right,
            f"cells must hold comparators over k = {comparator.k} levels, at least one, not {cells!r}",  # noqa: E501
        )
        total = sum(cell.weight for cell in cells)
        demand(abs(total - 1.0) <= 1e-9, f"the weights of the cells must total 1, not {total}")
    if offers(known, "people"):
        _check_people(known)
    elif offers(known, "whom"):
        demand(False, "whom goes with people, the names of those who may be asked")
    if offers(known, "answers"):
        right = isinstance(known.answers, Answers) and known.answers.k == comparator.k
        demand(
            right,
            f"answers must be elicit.Answers over k = {comparator.k} levels, not {known.answers!r}",
        )


def _check_people(known: Any) -> None:
    """Check a comparator's names of people, and whom it asks about what."""
    people, k = known.people, known.k
    named = all(isinstance(name, str) and name for name in people)
    right = len(people) and named and len({*people}) == len(people)
    demand(right, f"people must be names, at least one and each once, not {people!r}")
    demand(offers(known, "whom"), "people goes with whom(d, besides), which says whom to ask")
    asked = known.whom(np.eye(k)[-1] - 2.0 * np.eye(k)[k // 2], ())
    right = asked is None or (asked.who in people and np.shape(asked.d) == (k,))
    demand(right, f"whom(d) must be a PersonAsked of one of {people!r} and d ({k},), not {asked!r}")
    nobody = known.whom(np.eye(k)[-1] - np.eye(k)[0], people)
    demand(nobody is None, f"whom(d, besides=people) must be None, not {nobody!r}")


def _check_all_at_once(comparator: Comparator, d: Floats) -> None:
    if not offers(comparator, "simultaneous_bounds"):
        return
    high, confidence = wanted(lambda: simultaneous_bounds(comparator, np.concatenate([d, -d])))
    right = is_number(confidence, 0, 1) or np.isnan(confidence)
    demand(
        right,
        "the confidence of simultaneous_bounds must be in 0..1, or nan for none, not "
        f"{confidence!r}",
    )
    upper, lower = high[: len(d)], -high[len(d) :]
    crossed = lower > upper + TOLERANCE * np.abs(d).sum(axis=1)
    i = int(np.argmax(crossed))
    said = (
        f"on d = {d[i]} simultaneous_bounds of d and -d say that d.e is at most {upper[i]} and at "
        f"least {lower[i]}"
    )
    demand(
        not crossed.any(),
        f"bounds that hold for all rows at once leave room for some scale, but {said}",
    )
    if offers(comparator, "bounds_above"):
        _check_bounds_above(comparator, d, upper)
    if offers(comparator, "bounds_after"):
        _check_bounds_after(comparator, d)


def _check_bounds_above(comparator: Comparator, d: Floats, tight: Floats) -> None:
    """Check ``bounds_above`` of d (n, k) against the tight bounds.

    A bound may exceed the tight one only up to ``enough`` or 0. It must not be below a tight one
    that is positive.
    """
    room = TOLERANCE * np.abs(d).sum(axis=1)
    for enough in (float(np.median(tight)), np.maximum(tight, 0.0)):
        found, _ = wanted(partial(bounds_above, comparator, d, enough))
        wrong = (found < tight - room) & (tight > 0)
        wrong |= found > np.maximum(np.maximum(tight, enough), 0.0) + room
        j = int(np.argmax(wrong))
        said = (
            f"on d = {d[j]} bounds_above is {found[j]}, simultaneous_bounds {tight[j]}, and enough "
            f"{np.broadcast_to(enough, len(d))[j]}"
        )
        demand(not wrong.any(), f"bounds above enough must be as tight, but {said}")


def _check_bounds_after(comparator: Comparator, d: Floats) -> None:
    asked, enough = d[:3], 1e-3
    found = cast(ForeseesBounds, comparator).bounds_after(asked, d, enough)
    shape = (len(asked), 2, len(d))
    right = np.shape(found) == shape and np.asarray(found).dtype == np.float64
    demand(right, f"bounds_after of {len(asked)} questions must be {shape} float64, not {found!r}")
    for i, row in enumerate(asked):
        for part, verdict in enumerate((Verdict.WORSE, Verdict.BETTER)):
            try:
                told = comparator.update(Answers(row[None], [int(verdict)]))
            except InconsistentAnswers:
                continue
            tight = simultaneous_bounds(told, d)[0]
            # an estimate serves to choose questions, and may be a little off
            room = 1e-6 * np.abs(d).sum(axis=1)
            # a bound that is not found is inf
            wrong = (found[i, part] < tight - room) & (tight > enough + room)
            wrong |= np.isfinite(found[i, part]) & (
                found[i, part] > np.maximum(tight, enough) + room
            )
            j = int(np.argmax(wrong))
            said = (
                f"after {verdict.name} of {row} on d = {d[j]} bounds_after is "
                f"{found[i, part, j]}, and simultaneous_bounds {tight[j]}"
            )
            demand(not wrong.any(), f"bounds_after tells what an answer would leave, but {said}")


def _check_draws(comparator: Comparator) -> None:
    draws = wanted(lambda: draws_in(comparator))
    if draws is not None:
        ordered = draws[0]
        if (open_step := unordered_of(comparator)) is not None:
            values = np.vstack([np.zeros(ordered.shape[1]), np.cumsum(ordered, axis=0)])
            values[open_step[0] : open_step[1] + 1].sort(axis=0)
            ordered = np.diff(values, axis=0)
        least = float(ordered.min())
        demand(
            least >= -1e-9,
            "the gaps of draws must not be negative, for the scales are ordered, but one is "
            f"{least}",
        )


def _check_probability(comparator: Comparator, d: Floats) -> None:
    if not offers(comparator, "probability"):
        return
    probability = cast(PredictsAnswers, comparator).probability
    ends = [found if isinstance(found, tuple) else (found,) for found in map(probability, (d, -d))]
    for part in ends[0]:
        right = (
            np.shape(part) == (len(d),)
            and ((np.asarray(part) >= 0) & (np.asarray(part) <= 1)).all()
        )
        demand(
            right,
            f"probability of d {d.shape} must be ({len(d)},) numbers in 0..1, or a tuple of such, "
            f"not {part}",
        )
    both = ends[0][-1] + ends[1][-1]
    i = int(np.argmax(both))
    said = f"on d = {d[i]} they total {both[i]}"
    demand(
        both[i] <= 1 + 1e-9,
        "the probabilities that left and that right is said to be better total 1 at most, but "
        f"{said}",
    )


def _check_rule(comparator: Comparator, d: Floats) -> None:
    if compares_by_rule(type(comparator)):
        rule = rule_of(comparator)
        demand(
            isinstance(rule, Rule),
            f"rule must be an elicit.decision.comparator_rule.Rule, not {type(rule).__name__}",
        )
    verdicts, tiers = wanted(lambda: decide(comparator, d))
    demand_same(
        "what rule and decide_rest decide", verdicts, "compare(d)", comparator.compare(d), d
    )
    right = np.shape(tiers) == (len(d),) and np.isin(tiers, list(Tier)).all()
    demand(
        right,
        f"decide_rest must return a tier, of elicit.Tier, for each of the differences, not {tiers}",
    )


def _check_learned_in_loop(comparator: Comparator, d: Floats) -> None:
    """Check that ``learned_in_loop`` without answers gives an equal comparator."""
    if offers(comparator, "learned_in_loop"):
        made = cast(LearnsInLoops, comparator).learned_in_loop(
            Answers.none(comparator.k), rule_of(comparator)
        )
        demand(
            is_comparator(made),
            f"learned_in_loop must return a comparator, not {type(made).__name__}",
        )
        demand_same(
            "after learned_in_loop without answers, compare",
            made.compare(d),
            "what it said before",
            comparator.compare(d),
            d,
        )


def _check_update(comparator: Comparator, d: Floats) -> Comparator:
    """Return the comparator after some answers, and check the new one against the old.

    The answers are those of a tutor whose scale is the comparator's best guess.
    """
    before, bounds, values = comparator.compare(d), comparator.bounds(d), comparator.values.copy()
    kept = cast(KeepsAnswers, comparator).answers.ids if offers(comparator, "answers") else ()
    told = d[before == Verdict.UNKNOWN][:12]
    y = np.sign(tail_sums(told) @ np.diff(values)).astype(np.int8)
    told, y = told[y != 0], y[y != 0]
    answers = (
        Answers(told, y, [f"check {i}" for i in range(len(y))])
        if len(y)
        else Answers.none(comparator.k)
    )
    learned = comparator.update(answers)
    demand(is_comparator(learned), f"update must return a comparator, not {type(learned).__name__}")
    demand(
        learned.k == comparator.k, f"update must keep k = {comparator.k}, not make it {learned.k}"
    )
    demand_same(
        "after update, the old comparator's compare",
        comparator.compare(d),
        "what it said before",
        before,
        d,
    )
    for old, new in zip(bounds, comparator.bounds(d), strict=True):
        demand_near("after update, the old comparator's bounds must be what they were", new, old, d)
    demand(
        (comparator.values == values).all(), "update must not change the old comparator's values"
    )
    if offers(comparator, "answers") and offers(learned, "answers"):
        told_before, told_now = (
            cast(KeepsAnswers, comparator).answers,
            cast(KeepsAnswers, learned).answers,
        )
        demand(told_now.ids == kept + answers.ids, "answers must be all that it was told, in order")
        demand(told_before.ids == kept, "update must not change the old comparator's answers")
    one_by_one = comparator
    for i in range(len(answers)):
        one_by_one = one_by_one.update(answers[i : i + 1])
    after = learned.compare(d)
    demand_same(
        "answers told one by one", one_by_one.compare(d), "the same told together", after, d
    )
    demand_same(
        "compare after no answers",
        learned.update(Answers.none(comparator.k)).compare(d),
        "before",
        after,
        d,
    )
    return learned
