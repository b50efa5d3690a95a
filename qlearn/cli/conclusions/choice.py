"""The conclusion about a choice among alternatives, in words, with the worth of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from elicit._support.fixed_order import product
from elicit.asking.choose_from_list import Choice
from elicit.model.comparator_parts import best_guess, simultaneous_bounds, unordered_of, wrong_of
from elicit.model.difference import tail_sums
from elicit.model.outcomes import Status, assumed_of_answers
from elicit.model.scale import Floats
from elicit.person.course.conclusion import (
    NO_LOSS,
    Conclusion,
    DataTable,
    NearlyEnough,
    ResultTable,
    capital,
    in_plural,
    listed,
    per_hundred,
    up_to,
    with_probability,
)
from elicit.person.course.level_questions import WIDE
from elicit.person.course.ranges import draws_again, ranges_of
from elicit.person.findings import scale_rows
from elicit.person.showing import printable
from qlearn.cli.conclusions.in_words import (
    InWords,
    is_little,
    size_and_end,
    size_of,
    sure_of,
    until,
)

_MOST_UNFOLDED = 12  # alternatives up to which their table stands open on the screen
_ROUNDED = 0.5  # of 100: less than that does not show in the ranges as they are shown
_FEW_NAMED = 3  # alternatives that are named in a sentence
_NARROW = (
    0.5  # width of a range, a share of the whole, beyond which a best guess is "about" so much
)
_MOST_LEVELS = 6  # levels up to which a sentence says how two alternatives differ
_EVERY = "for all values that fit your answers"
_BEST = "best"
_EACH_ROW = "Each row has the outcomes of 100 {unit}."
_NONE = "-"  # the cell of the best one, which is behind no other
_SAME = 1e-9  # outcomes of 100 by which two numbers differ by rounding only


class _Ahead(NamedTuple):
    """The lead of the choice over each alternative (n,), as a share of the value range.

    ``least`` are lower bounds, which hold for all alternatives together with ``confidence``.
    """

    guess: Floats
    least: Floats
    confidence: float


class _Worth(NamedTuple):
    """The value of each alternative (n,), from 0 to 1: the best guess, and its range.

    ``narrow`` says where the range is narrow enough for the best guess to be exact. ``order`` has
    the alternatives, best first.
    """

    guess: Floats
    low: Floats
    high: Floats
    narrow: list[bool]
    order: list[int]


def choice_conclusion(
    told: InWords, names: Sequence[str], shares: Floats, result: Choice, before: float | None
) -> Conclusion:
    """Return a choice among alternatives in words, with the value of each alternative.

    ``shares`` (n, k) has a row for each alternative.
    """
    loss = told.stated(result.loss_bound)
    most, sure, best = per_hundred(loss), sure_of(result), printable(result.name)
    settled, ahead = choice_holds(told, result), _ahead(names, shares, result)
    if settled:
        headline = _recommended(told, names, shares, result)
        if with_sure := with_probability(result.confidence):
            sure = f"{_at_least(with_sure, ahead, names, result)} {_none_better(told, loss)}."
        else:
            sure = f"{capital(_none_better(told, loss))}. {sure}"
        sure = f"{sure} {_although_wide(told, shares, result)}".strip()
        after = "You can stop here."
        more = "If you like, more answers make it surer." if result.loss_bound > 0 else ""
    else:
        headline = f"The best guess so far is “{result.name}”. The choice is still open."
        after = f"Another {told.alternative} may be better, by at most {most}. {sure}"
        if result.loss_bound < NO_LOSS:
            after = f"{capital(_none_better(told, loss))}. {sure}"
        more = "More answers help."
        sure = ""  # it belongs to that sentence, not to the headline
    unasked = (
        ""
        if before is None
        else f"Without your answers the choice could have lost {up_to(before, result.confidence)}: "
        f"{told.loss(before)}. {_by_steps(told, names, shares, result)}".strip()
    )
    mark = (_BEST if _best_word(result) == _BEST else "chosen") if settled else "best guess"
    worth = _worth_of(shares, result)
    return Conclusion(
        headline=headline,
        reason=_reason(told, names, shares, result, ahead),
        size=size_and_end(told, loss, _better(told), result.confidence, settled),
        sure=sure,
        next=after,
        more=more,
        before=unasked,
        changes=_worth(told, names, shares, result, ahead, worth, mark, settled),
        result=_to_keep(names, result, ahead, worth),
        settled=settled,
        early=f"By your answers so far “{best}” is {_best_word(result)}. They are not checked yet.",
    )


def offered_table(told: InWords, names: Sequence[str], shares: Floats) -> ResultTable:
    """Return a table of the outcomes of each alternative, as it is before the first answer."""
    rows = zip(map(printable, names), _outcomes(shares), strict=True)
    many = in_plural(told.alternative)
    return ResultTable(
        f"The {len(names)} {many}",
        (capital(told.alternative), *map(printable, told.labels[::-1])),
        tuple((name, *cells) for name, cells in rows),
        _EACH_ROW.format(unit=printable(told.words.unit)),
        told.alternative,
        several=many,
    )


def _outcomes(shares: Floats) -> list[tuple[str, ...]]:
    """Return the outcomes of 100 of each alternative (n, k), the best level first, as texts."""
    return [tuple(f"{100 * share:.3g}" for share in row[::-1]) for row in shares]


def choice_nearly(
    told: InWords, names: Sequence[str], shares: Floats, result: Choice, before: float | None
) -> NearlyEnough | None:
    """Return a statement that some alternatives can each lose little, or None.

    They are the best guess, and as many of those nearly as good by it as the statement holds for
    with the same certainty.
    """
    if not is_little(told, result.loss_bound, before):
        return None
    best, points = list(names).index(result.name), _points(shares, result)
    order = [i for i in np.argsort(-points, kind="stable").tolist() if i != best]
    near = [best, *(i for i in order[:_FEW_NAMED] if points[best] - points[i] <= told.little)]
    while True:
        apart = [shares[j] - shares[i] for i in near for j in range(len(names)) if j != i]
        high, confidence = simultaneous_bounds(result.comparator, np.array(apart))
        loss = max(0.0, float(high.max(initial=0.0)))
        if len(near) == 1 or is_little(told, loss, before):
            break
        near.pop()
    sure = _with_certainty(result, confidence)
    if sure is None or not is_little(told, loss, before):
        return None
    size = size_of(told, loss, _better(told), confidence)
    near.sort(key=lambda i: -points[i])
    near_names = listed([f"“{printable(names[i])}”" for i in near])
    if len(near) == 1:
        return NearlyEnough(
            f"{near_names} is the best for you, or nearly so",
            f"{sure} {_none_better(told, loss)}.",
            size,
        )
    return NearlyEnough(
        f"{near_names} are nearly equal to you",
        f"Whichever of them you choose, you lose little: {sure[0].lower()}{sure[1:]} "
        f"{_none_better(told, loss)}.",
        size,
    )


def _with_certainty(result: Choice, confidence: float) -> str | None:
    """Return the start of a sentence on how certain it is; None if that cannot be stated."""
    if confidence == 1.0:
        assumed = assumed_of_answers(wrong_of(result.comparator), "your")
        return f"{capital(assumed)},"
    sure = with_probability(confidence)
    return f"{capital(sure)}," if sure else None


def _best_word(result: Choice) -> str:
    """Return the words for a choice: "best", or a recommendation if another may be as good."""
    decided = result.status not in (Status.CALLED_EQUAL, Status.UNSURE) or result.loss_bound <= 0
    return _BEST if decided else "the one to choose"


def _recommended(told: InWords, names: Sequence[str], shares: Floats, result: Choice) -> str:
    """Return sentences that name the choice, and the next best alternatives if they are close.

    Those that the person called as good as the choice are named together with it.
    """
    points = _points(shares, result)
    best = list(names).index(result.name)
    close = np.flatnonzero(points >= points[best] - told.little)
    near = [i for i in close[np.argsort(-points[close], kind="stable")].tolist() if i != best]
    told_equal = _directions(result.answers.d[result.answers.y == 0])
    apart = _directions(shares[best] - shares)
    called = [i for i in near if _among(apart[i], told_equal)]
    quoted, worth = [f"“{printable(name)}”" for name in names], [f"{100 * p:.0f}" for p in points]
    name, top = quoted[best], worth[best]
    if called:
        equal = [best, *called]
        said = (
            f"You called {listed([quoted[i] for i in equal])} equally good. By all your answers "
            f"they are worth {listed([worth[i] for i in equal])} of 100."
        )
    else:
        said = f"By your answers {name} is {_best_word(result)}."
    others = [i for i in near if i not in called]
    named = others[:_FEW_NAMED]
    if not named:
        return said
    as_good = "About as good" if top in [worth[i] for i in named] else "Next best"
    if len(others) == 1:
        second = worth[named[0]]
        against = f"both {top}" if second == top else f"{second} against {top}"
        return f"{said} {as_good} is {quoted[named[0]]} ({second if called else against} of 100)."
    beside = "" if called else f"; {name} is worth {top}"
    each = [f"{quoted[named[0]]} (worth {worth[named[0]]} of 100)"]
    each += [f"{quoted[i]} ({worth[i]})" for i in named[1:]]
    more = len(others) - len(named)
    rest = f" {more} more {'is' if more == 1 else 'are'} close too." if more else ""
    return f"{said} {as_good} are {listed(each)}{beside}.{rest}"


def _directions(d: Floats) -> Floats:
    """Return tail sums (n, k-1) of differences d (n, k), each divided by its largest number."""
    t = tail_sums(d)
    directions: Floats = t / np.maximum(np.abs(t).max(axis=1, keepdims=True), 1e-300)
    return directions


def _among(direction: Floats, others: Floats) -> bool:
    """Return whether a direction (k-1,) or its opposite is among others (n, k-1)."""
    apart = [np.abs(others - way * direction).max(axis=1, initial=0.0) for way in (1, -1)]
    return bool((np.minimum(*apart) < 1e-6).any())


def _worth_of(shares: Floats, result: Choice) -> _Worth:
    """Return the value of each alternative as it is shown."""
    low, high = ranges_of(result.comparator, shares, draws_again(result.comparator))
    low, high, points = np.maximum(low, 0.0), np.minimum(high, 1.0), _points(shares, result)
    order = np.argsort(-points, kind="stable").tolist()
    return _Worth(points, low, high, (high - low <= _NARROW).tolist(), order)


def _points(shares: Floats, result: Choice) -> Floats:
    """Return the best guess (n,) at the value of each alternative, from 0 to 1."""
    return product(tail_sums(shares), np.diff(best_guess(result.comparator)))


def _ahead(names: Sequence[str], shares: Floats, result: Choice) -> _Ahead:
    """Return how much more the choice is worth than each alternative."""
    best, points = list(names).index(result.name), _points(shares, result)
    high, confidence = simultaneous_bounds(
        result.comparator, np.delete(shares, best, axis=0) - shares[best]
    )
    return _Ahead(points[best] - points, -np.insert(high, best, 0.0), confidence)


def _reason(
    told: InWords, names: Sequence[str], shares: Floats, result: Choice, ahead: _Ahead
) -> str:
    """Return sentences on how the choice differs from the next best, and what that is worth.

    Alternatives that the person called as good as the choice are passed over. The result is "" if
    there is no other one, or it has the same outcomes.
    """
    best, points = list(names).index(result.name), _points(shares, result)
    called = _directions(result.answers.d[result.answers.y == 0])
    apart = shares[best] - shares
    directions = _directions(apart)
    order = np.argsort(ahead.guess, kind="stable").tolist()
    others = [i for i in order if i != best and not _among(directions[i], called)]
    if not others or not directions[others[0]].any():
        return ""
    second = others[0]
    name, other = (f"“{printable(names[i])}”" for i in (best, second))
    more, sure = _more(_behind(points, best)[second]), _how_sure_of(ahead, second)
    worth = (
        f"On the scale from 0 (all “{printable(told.labels[0])}”) to 100 (all "
        f"“{printable(told.labels[-1])}”), {name} is worth {more} more than the second, {other} "
        f"(best guess{sure})."
    )
    differ = _differ(told, 100.0 * apart[second])
    if not differ:
        return worth
    by = "the order of the levels alone" if (directions[second] >= 0).all() else "your answers"
    by = by if ahead.least[second] > -NO_LOSS else "the best guess"
    return f"{worth} {capital(differ)}. By {by} that is better."


def _differ(told: InWords, more: Floats) -> str:
    """Return in words how many outcomes (k,) of 100 one alternative has in place of others.

    The result is "" if that would be too long.
    """
    at = [(n, f"“{printable(label)}”") for n, label in zip(more, told.labels, strict=True)][::-1]
    gained = [f"{n:.3g} more {label}" for n, label in at if n > _SAME]
    lost = [f"{-n:.3g} {label}" for n, label in at if n < -_SAME]
    if not gained or len(gained) + len(lost) > _MOST_LEVELS:
        return ""
    return f"in 100 {printable(told.words.unit)} it has {listed(gained)} in place of {listed(lost)}"


def _in_tenths(points: Floats) -> Floats:
    """Return values, shares of the value range, as numbers of 100 with one decimal."""
    tenths: Floats = np.rint(1000.0 * points) / 10.0 + 0.0  # which is never -0
    return tenths


def _behind(points: Floats, best: int) -> Floats:
    """Return how much less each alternative is worth than the choice, of 100, by the best guess.

    It is the difference of two numbers as the table has them, with one decimal.
    """
    shown = _in_tenths(points)
    behind: Floats = np.rint(10.0 * (shown[best] - shown)) / 10.0 + 0.0
    return behind


def _more(guess: float) -> str:
    """Return in words how much more the choice is worth than an alternative, of 100."""
    return f"{guess:.1f}".removesuffix(".0") if guess else "less than 0.1"


def _how_sure_of(ahead: _Ahead, i: int) -> str:
    """Return the rest of a bracket: how much more the choice is worth at least, and how sure.

    The result is "" if the alternative may be better. The number, of 100, is rounded down.
    """
    if math.isnan(ahead.confidence) or ahead.least[i] <= -NO_LOSS:
        return ""
    least = _rounded_down(ahead.least[i])
    by = f"at least {_more(least)} more" if least > 0 else "at least as good"
    return f"; {by}, {with_probability(ahead.confidence) or _EVERY}"


def _although_wide(told: InWords, shares: Floats, result: Choice) -> str:
    """Return sentences on why a settled choice holds although levels are known only roughly.

    The result is "" if no level's range is wide, or the order of the levels is open.
    """
    known = result.comparator
    if unordered_of(known) is not None:
        return ""
    rows = scale_rows(known, told.labels)[::-1]
    low = np.array([row.low for row in rows]) / 100.0
    high = np.array([row.high for row in rows]) / 100.0
    wide = [i for i in range(1, len(low) - 1) if 100.0 * (high[i] - low[i]) > WIDE + _SAME]
    if not wide:
        return ""
    name, few = f"“{printable(result.name)}”", len(wide) <= _FEW_NAMED
    named = listed([f"“{printable(told.labels[i])}”" for i in wide[::-1]])
    are = f"{named} {'is' if len(wide) == 1 else 'are'}" if few else f"{len(wide)} levels are"
    it = "it is" if len(wide) == 1 else "they are"
    most, loss = most_short(shares, result.best, low, high), told.stated(result.loss_bound)
    if most <= max(loss, NO_LOSS):
        return (
            f"{are} known only roughly. Even so, whatever {it} worth within "
            f"{'the range' if len(wide) == 1 else 'the ranges'} below, {name} is best"
            f"{', or nearly so' if most >= NO_LOSS else ''}."
        )
    clearly = "" if loss < NO_LOSS else "clearly "
    return (
        f"{are} known only roughly. That is enough here: your answers rule out the combinations of "
        f"values for which another {told.alternative} would be {clearly}better."
    )


def most_short(shares: Floats, best: int, low: Floats, high: Floats) -> float:
    """Return the most that one alternative falls short of another, for values in these ranges.

    Parameters
    ----------
    shares : (n, k)
        A row for each alternative, with a share for each level, worst first.
    best : int
        The row of the alternative.
    low, high : (k,)
        Ranges of the values of the levels, neither of which falls. The values rise in any case.

    Returns
    -------
    float
        At least 0.

    Notes
    -----
    The greatest d.v is found level by level, from the worst. At the vertices of the set of rising
    values in these ranges, each value is an end of some range.
    """
    d = shares - shares[best]
    ends = np.unique(np.concatenate([low, high]))
    most = np.zeros((len(d), len(ends)))
    for level in range(len(low)):
        inside = (ends >= low[level]) & (ends <= high[level])
        here = np.where(inside, most + d[:, [level]] * ends, -np.inf)
        most = np.maximum.accumulate(here, axis=1)
    return max(0.0, float(most[:, -1].max()))


def _better(told: InWords) -> str:
    """Return the start of a clause on how much better another alternative can be."""
    return f"if another {told.alternative} is better, it is better by"


def _by_steps(told: InWords, names: Sequence[str], shares: Floats, result: Choice) -> str:
    """Return a sentence on which alternative is best if the steps between the levels are equal."""
    first = names[int(np.argmax(shares @ np.linspace(0.0, 1.0, shares.shape[1])))]
    if first == result.name:
        return f"With equal steps between the levels, “{printable(first)}” would be best, too."
    return f"With equal steps between the levels, “{printable(first)}” would be best."


def _at_least(sure: str, ahead: _Ahead, names: Sequence[str], result: Choice) -> str:
    """Return "With 95% probability", or "With at least" so much if all others are clearly behind.

    If the lead is more than nothing with that probability, it is surer that there is one.
    """
    others = np.delete(ahead.least, list(names).index(result.name))
    clear = bool((others > NO_LOSS).all()) and len(others) > 0
    return capital(sure.replace("with ", "with at least ", 1) if clear else sure)


def _none_better(told: InWords, loss: float) -> str:
    """Return a clause that no other alternative is better, or not by more than this loss."""
    by = "" if loss < NO_LOSS else f" by more than {per_hundred(loss)}"
    return f"no other {told.alternative} is better{by}"


def choice_holds(told: InWords, result: Choice) -> bool:
    """Return whether no question is left, and no other alternative is better by the tolerance.

    The bound on the loss is looked at in addition, for two reasons. Each pair may be decided with
    95% probability while all of them together are not. And a pair that the person cannot tell apart
    need not matter.
    """
    decided = result.status in (Status.DONE, Status.CALLED_EQUAL)
    if decided and result.confidence == 1.0:
        return True
    return (decided or result.status is Status.UNSURE) and result.loss_bound <= told.tolerance


def _worth(
    told: InWords,
    names: Sequence[str],
    shares: Floats,
    result: Choice,
    ahead: _Ahead,
    worth: _Worth,
    mark: str,
    settled: bool,
) -> ResultTable:
    """Return a table of what each alternative consists of, and its value as far as it is known.

    The choice is marked by ``mark``.
    """
    labels = told.labels
    low, high = worth.low, worth.high
    points, order, narrow = worth.guess, worth.order, worth.narrow
    best, outcomes = list(names).index(result.name), _outcomes(shares)
    behind = _behind(points, best)
    rows = tuple(
        (
            printable(names[i]),
            *outcomes[i],
            _worth_in_tenths(100 * points[i], narrow[i]),
            f"{100 * low[i]:.0f} to {100 * high[i]:.0f}",
            _NONE if i == best else _worth_in_tenths(behind[i], narrow[i] and narrow[best]),
        )
        for i in order
    )
    above = np.delete(high, best) - low[best]
    apart = float(above.max(initial=-1.0))
    # shown where the ranges as they are shown overlap or touch, by more than the bound
    overlap = (
        f" The ranges of two {in_plural(told.alternative)} may touch or overlap although one is "
        "surely better, because both rise with the value of the same level."
        if 100.0 * (apart - result.loss_bound) > -_ROUNDED
        else ""
    )
    many = in_plural(told.alternative)
    none_ahead = _none_ahead(names, ahead, best, settled)
    return ResultTable(
        f"The {len(names)} {many}",
        (capital(told.alternative), *map(printable, labels[::-1]), "worth", "range", "behind"),
        rows,
        f"{_EACH_ROW.format(unit=printable(told.words.unit))} Worth is 0 if all were "
        f"“{printable(labels[0])}”, and 100 if all were “{printable(labels[-1])}”: the best guess, "
        f"and its range. “Behind” is how much less than “{printable(result.name)}”, by "
        "the best guess. Worth is computed from values before they are rounded."
        f"{none_ahead}{overlap}",
        told.alternative,
        unfolded=len(names) <= _MOST_UNFOLDED,
        several=many,
        marked=order.index(best),
        mark=mark,
    )


def _worth_in_tenths(number: float, exact: bool) -> str:
    """Return a number with one decimal, or, if it is not exact, as "about" so much."""
    return f"{number:.1f}" if exact else f"about {number:.0f}"


def _none_ahead(names: Sequence[str], ahead: _Ahead, best: int, settled: bool) -> str:
    """Return a sentence on the alternatives that may be better than the choice, or "".

    It holds for all of them together. If the choice is ``settled``, it was said how much better
    another one may be.
    """
    if math.isnan(ahead.confidence) or len(names) == 1:
        return ""
    may = [i for i in np.flatnonzero(ahead.least <= -NO_LOSS).tolist() if i != best]
    if not may:
        sure = with_probability(ahead.confidence) or _EVERY
        return f" {capital(sure)} none of the others is better."
    if settled:
        return ""
    by = math.ceil(100.0 * float(-ahead.least[may].min()) - _SAME)
    few = len(may) <= _FEW_NAMED
    who = listed([f"“{printable(names[i])}”" for i in may]) if few else f"{len(may)} of the others"
    return f" {who} may still be better, by at most {by}."


def _to_keep(names: Sequence[str], result: Choice, ahead: _Ahead, worth: _Worth) -> DataTable:
    """Return the worth of each alternative as a table to download. Numbers are of 100.

    ``worth`` is empty where the range is too wide for a best guess. ``behind_at_least`` is below 0
    where an alternative may be ahead of the choice, and empty where nothing bounds that.
    """
    best = list(names).index(result.name)
    tenths, behind = _in_tenths(worth.guess), _behind(worth.guess, best)
    rows = tuple(
        (
            printable(names[i]),
            float(tenths[i]) if worth.narrow[i] else None,
            _in_hundredths(worth.low[i]),
            _in_hundredths(worth.high[i]),
            float(behind[i]),
            None if math.isnan(ahead.confidence) else _rounded_down(ahead.least[i]),
            "chosen" if names[i] == result.name else "",
        )
        for i in worth.order
    )
    columns = ("alternative", "worth", "low", "high", "behind", "behind_at_least", "choice")
    return DataTable("Choice", columns, rows)


def _in_hundredths(share: float) -> float:
    """Return a share of the value range as a number of 100, to two decimals."""
    return round(100.0 * float(share), 2) + 0.0  # which is never -0


def _rounded_down(share: float) -> float:
    """Return a lower bound on a share of the value range as a number of 100, to one decimal."""
    return math.floor(1e3 * float(share) + 1e-9) / 10.0


def choice_stakes(told: InWords, result: Choice) -> str | None:
    """Return a sentence on what the choice can lose."""
    if np.isnan(result.loss_bound):
        return None
    if result.loss_bound < NO_LOSS:
        return f"So far {_none_better(told, result.loss_bound)}."
    return (
        f"So far another {told.alternative} could be better by "
        f"{up_to(result.loss_bound, result.confidence)}: {told.loss(result.loss_bound)}. "
        f"{until(told)}"
    )
