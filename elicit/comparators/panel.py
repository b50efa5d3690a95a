"""Several people as one comparator over the mean of their scales.

Each member has a comparator of their own, which learns only from that member's answers. The panel's
scale is the weighted mean e = w_1 e_1 + ... + w_n e_n. So d.e lies between the weighted sums of the
members' lower and upper bounds. A verdict is given if both sums have the same sign.

People may disagree about the sign of d.e. Then the sign of the mean depends on how far d.e is from
0 for each of them, which no answer about d itself says. So a member may be asked about d less c
times the step from the worst level to the best. The answer says whether d.e exceeds c.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.fixed_order import product
from elicit._support.hashing import name_code
from elicit._support.threads import one_thread
from elicit._support.validation import check_printable, is_number, require
from elicit.decision.comparator_rule import DecidesRest, Rule, compares_by_rule, nothing, unaided
from elicit.decision.verdicts import decide, decide_by_rule
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import (
    Comparator,
    Decisions,
    Tier,
    Verdicts,
    bounds_of,
    check_answers,
    check_comparator_made,
    offers,
)
from elicit.model.comparator_parts import (
    KeepsAnswers,
    PersonAsked,
    best_guess,
    draws_in,
    lapse_of,
    simultaneous_bounds,
    stated_confidence,
    tie_of,
    unordered_of,
)
from elicit.model.difference import as_differences, tail_sums
from elicit.model.pairs import same_pairs
from elicit.model.query import Answers, InconsistentAnswers, Verdict, as_who
from elicit.model.scale import Floats

_KEY = name_code("draws of a panel")
_ROUNDING = 1e-9  # times |d|_1: smaller sums of bounds have no sign
_RESOLUTION = (
    1e-7  # share of the value range: a member whose d.e is known as precisely can tell nothing more
)
_EVEN = 0.25  # share of a member's interval on either side of 0 from which d itself is asked about
_FORMS = 12  # questions about d in any form to a member who may err; fewer left problems unfinished
_STEPS = 64  # number of steps of c in the interval, about: c is the same on every processor
_GRID = 2.0**40  # weights are whole multiples of its inverse, coarser than their rounding errors


class Panel:
    """A comparator over the mean of several people's scales.

    It is a frozen value, as all comparators are. ``elicit.Comparator`` says what its methods take
    and return.

    Bounds are the weighted sums of the members' bounds. Their confidence is at least 1 minus the
    sum, over members, of (1 - confidence). If every member has draws on which its bounds depend, as
    ``PosteriorComparator`` has, the panel has draws of the mean scale: each combines one draw of
    each member, as if the members were independent. These draws then bound a policy's loss, at the
    lowest of the members' levels.

    With one member the panel gives that member's own questions, verdicts and bounds.

    Parameters
    ----------
    members : mapping of str to Comparator
        The comparator of each person. The panel starts with all that they know.
    weights : mapping of str to float, or sequence of float, optional
        Weight of each person's scale in the mean, above 0; only their ratios matter. Default: equal
        weights.
    aim : "mean" or "worst"
        The policy that ``qlearn.solve`` looks for: the best for the mean scale, or the one whose
        greatest loss to any member is the least. Verdicts and bounds are of the mean either way.

    Attributes
    ----------
    members : mapping of str to Comparator
    aim : "mean" or "worst"
    weights : mapping of str to float
        Of total 1.
    people : tuple of str
        The names, in their order.
    answers : Answers
        All answers, each with the person who gave it (``who``).

    Raises
    ------
    TypeError
        If a member is no comparator, or a name no text.
    ValueError
        If there is no member, their numbers of levels differ, a weight is not above 0, or ``aim``
        is neither.
    """

    def __init__(
        self,
        members: Mapping[str, Comparator],
        weights: Mapping[str, float] | Sequence[float] | None = None,
        aim: Literal["mean", "worst"] = "mean",
    ) -> None:
        require(aim in ("mean", "worst"), "aim", "'mean' or 'worst'", aim)
        self.aim: Literal["mean", "worst"] = aim
        if not isinstance(members, Mapping) or not members:
            raise ValueError(
                "a panel takes its members by name, at least one, such as "
                f"Panel({{'ann': PolytopeComparator(5), 'ben': ...}}), not {members!r}"
            )
        for name, member in members.items():
            if as_who(name) is None:
                raise TypeError("a member of a panel needs a name, not None")
            check_printable("names of members", [name])
            check_comparator_made(member)
            if isinstance(member, Panel) or unordered_of(member) is not None:
                kind = type(member).__name__
                raise ValueError(
                    f"member {name!r} has {kind}, but a panel takes each member as one person "
                    "who is certain of the order of the levels: give them a "
                    "PolytopeComparator or a PosteriorComparator"
                )
        levels = {name: member.k for name, member in members.items()}
        if len({*levels.values()}) > 1:
            raise ValueError(f"the members of a panel must have the same levels, not {levels}")
        self.k = next(iter(levels.values()))
        self.members: Mapping[str, Comparator] = MappingProxyType(dict(members))
        self.people = tuple(members)
        self.weights: Mapping[str, float] = MappingProxyType(_weights(self.people, weights))
        self.answers = Answers.none(self.k)
        for name, member in members.items():
            if offers(member, "answers"):
                own = cast(KeepsAnswers, member).answers
                self.answers = self.answers + Answers(own.d, own.y, own.ids, [name] * len(own))

    def __repr__(self) -> str:
        return f"Panel({', '.join(self.people)}; k={self.k}, {len(self.answers)} answers)"

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (dict(self.members), dict(self.weights), self.answers, self.aim)

    def __getattr__(self, name: str) -> Any:
        """Return an optional part, if every member has the part that it is made from."""
        if name.startswith("_") or "members" not in vars(self):
            raise AttributeError(name)
        if len(self.people) == 1 and name in _PARTS:
            return getattr(self._only, name)
        part = _PARTS.get(name)
        if part is None or not all(offers(member, part.of) for member in self._each):
            raise AttributeError(
                f"{type(self).__name__} of {', '.join(self.people)} has no {name!r}"
            )
        return part.made(self)

    @cached_property
    def values(self) -> Floats:
        """The weighted mean (k,) of the members' best guesses, from 0 to 1; read-only."""
        if len(self.people) == 1:
            return self._only.values
        total = self._summed([best_guess(member) for member in self._each])
        values: Floats = np.asarray(total / total[-1])
        values.flags.writeable = False
        return values

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return bounds on d.e: the weighted sums of the members' lower and upper bounds.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        lo, hi : (n,) each, in units of e_k - e_1
        """
        rows = as_differences(d, self.k)
        both = [bounds_of(member, rows) for member in self._each]
        return self._summed([low for low, _ in both]), self._summed([high for _, high in both])

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts on differences.

        The verdict is the one on which all members agree. If they do not, it is the sign that the
        weighted sums of bounds show.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,) int8 verdicts
        """
        return decide_by_rule(self.rule, as_differences(d, self.k), self.decide_rest).verdicts

    @property
    def rule(self) -> Rule:
        """The rule for compiled loops.

        With several members it is dominance alone. With one it is the member's rule. If that member
        has none, the rule decides nothing.
        """
        if len(self.people) > 1:
            return nothing()
        if compares_by_rule(type(self._only)):
            return cast(Rule, cast(Any, self._only).rule)
        return unaided()

    @one_thread
    def decide_rest(self, d: Floats) -> Decisions:
        """Decide differences that dominance does not decide.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        Decisions
            The verdicts (n,) and their tiers (n,).
        """
        if len(self.people) == 1:
            member = self._only
            by_rule = compares_by_rule(type(member)) and offers(member, "decide_rest")
            return cast(DecidesRest, member).decide_rest(d) if by_rule else decide(member, d)
        each = np.stack([decide(member, d).verdicts for member in self._each])
        up, down = (each == Verdict.BETTER).any(axis=0), (each == Verdict.WORSE).any(axis=0)
        verdicts = np.where(up, Verdict.BETTER, np.where(down, Verdict.WORSE, Verdict.EQUAL))
        split = np.flatnonzero((each == Verdict.UNKNOWN).any(axis=0) | (up & down))
        if len(split):
            low, high = self.bounds(d[split])
            room = _ROUNDING * np.abs(d[split]).sum(axis=1)
            verdicts[split] = np.where(
                low > room,
                Verdict.BETTER,
                np.where(high < -room, Verdict.WORSE, Verdict.UNKNOWN),
            )
        modelled = any(offers(member, "level") for member in self._each)
        tier = int(Tier.MODEL if modelled else Tier.LP)
        return Decisions(verdicts.astype(np.int8), np.full(len(d), tier, np.int8))

    def update(self, answers: Answers) -> Panel:
        """Return a panel that also knows these answers: each member learns those that they gave.

        Parameters
        ----------
        answers : Answers
            Each names the person who gave it (``who``). With one member that may be left out.

        Returns
        -------
        Panel

        Raises
        ------
        ValueError
            If an answer does not say who gave it, or names nobody of the panel.
        InconsistentAnswers
            If a member's comparator raises it. Its rows are then rows of the panel's answers.
        """
        check_answers(answers, self.k)
        members = dict(self.members)
        if len(self.people) == 1:
            members = {name: member.update(answers) for name, member in members.items()}
            return _again(members, self.weights, self.answers + answers, self.aim)
        for row, who in enumerate(answers.who):
            if who not in members:
                said = "does not say who gave it" if who is None else f"is one of {who!r}"
                raise ValueError(
                    f"the answer in row {row}, {answers.ids[row]!r}, {said}: each answer to this "
                    f"panel must be of {' or '.join(map(repr, self.people))} (Answer(..., who=))"
                )
        told = self.answers + answers
        for name in dict.fromkeys(answers.who):
            assert name is not None
            try:
                members[name] = members[name].update(answers.of_person(name))
            except InconsistentAnswers as error:
                raise _contradiction_of(name, error, told) from None
        return _again(members, self.weights, told, self.aim)

    def whom(self, d: ArrayLike, besides: Sequence[str] = ()) -> PersonAsked | None:
        """Return the member to ask about a difference d (k,), and the difference to ask them about.

        It is the member whose weighted interval of d.e is the widest. They are asked about d
        itself, unless the sign of d.e is nearly known for them. Then they are asked whether d.e
        exceeds a number c, by asking about d less c times the step from the worst level to the
        best. Nobody is asked the same twice. A member whose comparator allows for errors is asked
        at most 12 times about d in any form.

        Parameters
        ----------
        d : (k,)
        besides : sequence of str
            Members who are not to be asked.

        Returns
        -------
        PersonAsked or None
            None if no further answer would help.

        Raises
        ------
        TypeError
            If ``besides`` is a single name: it takes a list of names.
        """
        if isinstance(besides, str):
            raise TypeError(f"besides takes several names: put the one into a list, [{besides!r}]")
        row = as_differences(d, self.k)[0]
        if len(self.people) == 1:
            return None if self.people[0] in besides else PersonAsked(self.people[0], row)
        size = float(np.abs(tail_sums(row[None])).max())
        found: list[tuple[float, PersonAsked]] = []
        for name, member in self.members.items():
            if name in besides or size == 0:
                continue
            high = simultaneous_bounds(member, np.stack([row, -row]))[0]
            low, top = -float(high[1]), float(high[0])
            width = self.weights[name] * (top - low) / size
            asked = self._put_to(name, row, low, top)
            if width > _RESOLUTION and asked is not None:
                found.append((-float(np.round(width * _GRID)), asked))
        return min(found, key=lambda one: one[0], default=(0.0, None))[1]

    def _put_to(self, name: str, d: Floats, low: float, high: float) -> PersonAsked | None:
        """Return the difference to ask a member about, or None if they were asked enough.

        It is d (k,) itself, or a shifted d: the answer then says whether d.e is above some number
        between its bounds ``low`` and ``high``.
        """
        own = self.answers.of_person(name)
        tails = tail_sums(own.d)
        # with three levels all questions are about one number
        most = _FORMS if self.k > 3 else 8 * _FORMS
        if offers(self.members[name], "level") and _about(d, tails).sum() >= most:
            return None
        even = min(-low, high) >= _EVEN * (high - low)
        for form in (d, _less(d, low, high)) if even else (_less(d, low, high),):
            if not same_pairs(tail_sums(form[None])[0], tails).any():
                return PersonAsked(name, form)
        return None

    @property
    def _only(self) -> Comparator:
        return self.members[self.people[0]]

    @property
    def _each(self) -> list[Comparator]:
        return list(self.members.values())

    def _summed(self, of_each: Sequence[Floats]) -> Floats:
        """Return the weighted sum of arrays, each of which belongs to a member."""
        if len(of_each) == 1:
            return of_each[0]
        total = np.zeros_like(of_each[0])
        for weight, one in zip(self.weights.values(), of_each, strict=True):
            total = total + weight * one
        return total

    def _all_at_once(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e that hold for all rows at once, and their confidence.

        The bounds are weighted sums of the members' simultaneous bounds.
        """
        rows = as_differences(d, self.k)
        both = [simultaneous_bounds(member, rows) for member in self._each]
        lacking = sum(1.0 - confidence for _, confidence in both)
        return self._summed([high for high, _ in both]), max(0.0, 1.0 - lacking)

    @cached_property
    def _mean_draws(self) -> Draws | None:
        """Draws of the mean scale, or None if a member has no draws.

        Each member's draws are resampled to equal weight and shuffled before they are averaged.
        """
        own = [draws_in(member) for member in self._each]
        if any(draws is None for draws in own):
            return None
        m = max(len(draws[1]) for draws in own if draws is not None)
        gaps, precision = [], []
        for i, draws in enumerate(own):
            assert draws is not None
            chosen = _equally_likely(draws[1], m)
            order = np.random.Generator(np.random.Philox([_KEY, i])).permutation(m)
            gaps.append(draws[0][:, chosen[order]])
            precision.append(draws[2][chosen[order]])
        mean = self._summed(gaps)
        return Draws(mean / mean.sum(axis=0), np.full(m, 1.0 / m), self._summed(precision))


class _Combination:
    """An optional part that a panel has if all its members have the part ``of``.

    The function ``made`` makes it from the panel.
    """

    def __init__(self, of: str, made: Callable[[Panel], Any]) -> None:
        self.of, self.made = of, made


_PARTS: Mapping[str, _Combination] = {
    "simultaneous_bounds": _Combination("simultaneous_bounds", lambda panel: panel._all_at_once),
    "bounds_above": _Combination("", lambda panel: None),  # a mean's are of all members' bounds
    "bounds_after": _Combination("", lambda panel: None),  # an answer is one member's
    "draws": _Combination("draws", lambda panel: panel._mean_draws),
    "level": _Combination("level", lambda panel: min(cast(Any, one).level for one in panel._each)),
    "confidence": _Combination(
        "level",
        lambda panel: min(stated_confidence(one, cast(Any, one).level) for one in panel._each),
    ),
    "lapse": _Combination(
        "lapse",
        lambda panel: float(panel._summed([np.array(lapse_of(one)) for one in panel._each])),
    ),
    "tie": _Combination("k", lambda panel: max(map(tie_of, panel._each))),
    "probability": _Combination("", lambda panel: None),
    "cells": _Combination("", lambda panel: None),
    "wrong": _Combination("", lambda panel: None),
    "answers_to_next_step": _Combination("", lambda panel: None),
    "learned_in_loop": _Combination("", lambda panel: None),
}


def _again(
    members: Mapping[str, Comparator],
    weights: Mapping[str, float],
    answers: Answers,
    aim: Literal["mean", "worst"],
) -> Panel:
    """Return a panel of these members, who have already learned these answers."""
    panel = object.__new__(Panel)
    panel.aim = aim
    panel.k = answers.k
    panel.members, panel.people = MappingProxyType(dict(members)), tuple(members)
    panel.weights, panel.answers = MappingProxyType(dict(weights)), answers
    return panel


def _weights(
    people: Sequence[str], weights: Mapping[str, float] | Sequence[float] | None
) -> dict[str, float]:
    """Return the weight of each person, 1 in total. Raise ValueError if the weights do not fit."""
    given: list[Any] = []
    if isinstance(weights, Mapping):
        given = [weights.get(name) for name in people] if {*weights} == {*people} else []
    elif weights is None or isinstance(weights, Sequence):
        given = [1.0] * len(people) if weights is None else list(weights)
    fits = len(given) == len(people) and all(is_number(one, 0) and one > 0 for one in given)
    total = float(sum(given)) if fits else np.inf
    if not np.isfinite(total):
        raise ValueError(
            f"weights must give each of {', '.join(map(repr, people))} a number above 0, and have "
            f"a finite total, not {weights!r}"
        )
    return {name: float(one) / total for name, one in zip(people, given, strict=True)}


def _contradiction_of(name: str, error: InconsistentAnswers, told: Answers) -> InconsistentAnswers:
    """Return a member's InconsistentAnswers as the panel's, with the panel's row numbers.

    Its message is computed only when it is read.
    """

    def parts() -> tuple[str, tuple[tuple[int, str], ...], bool]:
        rows = [row for row, who in enumerate(told.who) if who == name]
        found = tuple((rows[row], id) for row, id in error.answers)
        return f"of the answers of {name!r}: {error}", found, error.margin

    return InconsistentAnswers(parts)


def _less(d: Floats, low: float, high: float) -> Floats:
    """Return d (k,) less c times the step from the worst level to the best.

    The number c is near the middle of the interval ``low`` to ``high`` of d.e.
    """
    _, exponent = np.frexp((high - low) / _STEPS)
    unit = float(np.ldexp(1.0, int(exponent)))
    form = d.copy()
    c = round(0.5 * (low + high) / unit) * unit
    form[-1] -= c
    form[0] += c
    return form


def _about(d: Floats, tails: Floats) -> NDArray[np.bool_]:
    """Return flags (n,) of those earlier questions that were about d (k,) or a shifted d.

    The questions are given by the tail sums (n, p) of their differences. See ``_put_to``.
    """
    t = tail_sums(d[None])[0]
    flat = t - t.mean()
    others = tails - tails.mean(axis=1, keepdims=True)
    along = product(others, flat) / max(float((flat * flat).sum()), 1e-300)
    apart = np.abs(others - along[:, None] * flat).max(axis=1, initial=0.0)
    return np.asarray((apart <= _ROUNDING * np.abs(tails).max(axis=1, initial=0.0)) & (along != 0))


def _equally_likely(weights: Floats, m: int) -> NDArray[np.int64]:
    """Return the indices (m,) of m draws, each repeated in proportion to its weight (n,)."""
    total = np.round(np.cumsum(weights) * _GRID) / _GRID
    at = (np.arange(m) + 0.5) / m
    return np.minimum(total.searchsorted(at), len(weights) - 1)
