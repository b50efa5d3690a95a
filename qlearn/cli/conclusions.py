"""The conclusions of ``qlearn teach``: a policy or a choice, in words and tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from elicit._support.fixed_order import product
from elicit.asking.choose_from_list import Choice
from elicit.decision.verdicts import decide
from elicit.model.comparator import bounds_of
from elicit.model.comparator_parts import best_guess, simultaneous_bounds, wrong_of
from elicit.model.difference import tail_sums
from elicit.model.outcomes import Status, assumed_of_answers
from elicit.model.query import Verdict
from elicit.model.scale import Floats
from elicit.person.course.conclusion import (
    NO_LOSS,
    Conclusion,
    NearlyEnough,
    ResultTable,
    in_unit,
    listed,
    no_more,
    per_hundred,
)
from elicit.person.showing import Words, printable
from qlearn.learners.learner import Result
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import optimal_policy


@dataclass(frozen=True)
class InWords:
    """The words of a problem, in which a result is told.

    Attributes
    ----------
    labels, words
        Those of the problem.
    tolerance
        The share of the value range at which questions end.
    states, plan
        What the problem calls states, in the plural, and a policy.
    legend
        What the names of states and actions mean, in sentences.
    state_words
        A function that returns a state in words, from its name.
    """

    labels: tuple[str, ...]
    words: Words
    tolerance: float
    states: str = "states"
    plan: str = "plan"
    legend: str = ""
    state_words: Callable[[str], str] = str

    @property
    def little(self) -> float:
        """The share of the value range that counts as little.

        Stopping is offered if no more can be lost, and alternatives that are worth so much less
        than the best are named beside it.
        """
        return _LITTLE * self.tolerance

    def loss(self, share: float) -> str:
        """Return a loss in the problem's own unit, as a text that follows "it loses at most"."""
        return in_unit(share, self.words.unit, self.labels, self.words.loss)


def policy_conclusion(
    told: InWords,
    mdp: OrdinalMDP,
    action_words: Callable[[int], str],
    result: Result,
    before: float | None,
) -> Conclusion:
    """Return a policy's result in words, with the states in which the answers change it.

    The answers change a state if the policy's action there is better than that of equal steps, both
    followed by the policy, for every scale still plausible, or with the comparator's confidence.
    """
    bound = result.loss_bound
    settled = bound <= told.tolerance
    most, more = per_hundred(bound), ""
    if np.isnan(bound):
        headline = "How far your plan may fall short of your ideal plan cannot be stated."
        after = "Another comparator can state it."
    elif settled:
        headline = f"Your plan is settled. {_within(bound)}"
        after, more = "You can stop here.", "More answers would narrow the values below."
    else:
        headline = f"Your plan is not settled. It could still fall {most} short of your ideal plan."
        after = {
            Status.CALLED_EQUAL: "What is still open, you called equally good.",
            Status.UNSURE: "Where you could not tell, the plan follows the best guess.",
            Status.EXHAUSTED: "Every question that would help was answered, or you could not tell.",
        }.get(result.status, "")
        more = "" if after else f"More answers help. We stop below {per_hundred(told.tolerance)}."
    unasked = (
        ""
        if before is None
        else f"Before your first answer the plan could have fallen {per_hundred(before)} short"
        f"{no_more(result.confidence)}."
    )
    differing = _differing(told, mdp, result)
    return Conclusion(
        headline=headline,
        size=_size_and_end(told, bound, _SHORT, result.confidence),
        sure=f"{_sure(result)} The ideal plan is the one for your exact values.",
        next=after,
        more=more,
        before=unasked,
        changes=_changes(told, mdp, action_words, result, differing),
        plan=_plan(told, mdp, action_words, result, differing),
        result=_whole_policy(told, mdp, action_words, result, differing),
        settled=settled,
        early=f"{_within(bound, so_far=True)} Your answers are not checked yet.",
    )


_LITTLE = 4.0  # tolerances that count as little (see InWords.little)
_OF_BEFORE = 2 / 3  # a loss is not little if it is a larger share of that before the first answer
_MOST_UNFOLDED = 12  # alternatives up to which their table stands open on the screen
_ROUNDED = 0.5  # of 100: less than that cannot be told from the ranges as they are shown
_FEW_NAMED = 3  # alternatives that are named in a sentence
_NARROW = 0.5  # width of a range, a share of the whole, up to which a best guess is said

_SHORT = "your plan falls short of your ideal plan by"
_BETTER = "another alternative is better by"


def _within(loss: float, so_far: bool = False) -> str:
    """Return a sentence on how close a plan comes to the ideal plan."""
    start = "So far " if so_far else ""
    if loss < NO_LOSS:
        said = "no other plan can be better for you."
    else:
        plan = "your plan" if so_far else "it"
        said = f"{plan} comes within {per_hundred(loss)} of your ideal plan."
    return f"{start}{said}" if so_far else _capital(said)


def _size(told: InWords, loss: float, what: str, confidence: float | None) -> str:
    """Return sentences on how much a loss is, in the problem's own unit, or "" if unknown.

    Nothing is said of a loss that is shown as none, because "as if 0 in 100 patients died" has no
    size. ``what`` is the loss in words, between "At most" and its size. ``confidence`` is None if
    it is said elsewhere how sure that is.
    """
    if np.isnan(loss) or loss < NO_LOSS:
        return ""
    unsure = confidence is not None and 0.0 < confidence < 1.0
    sure = f" (with {confidence:.0%} probability)" if unsure else ""
    return f"At most{sure}, {what} {told.loss(loss)}. This is a measure of size, not a forecast."


def _size_and_end(told: InWords, loss: float, what: str, confidence: float) -> str:
    """Return ``_size`` and when questions end, which is beside the point if nothing can be lost."""
    if loss < NO_LOSS:
        return ""
    return f"{_size(told, loss, what, confidence)} {_until(told)}".strip()


def _until(told: InWords) -> str:
    """Return a sentence on when questions end."""
    return f"We stop asking below {per_hundred(told.tolerance)}."


class _Differing(NamedTuple):
    """A comparison of the learned policy with the policy for equal steps between levels.

    It holds the latter (S,), the ``states`` where the two differ, and in ``holds`` for each of
    these whether the learned action is certainly better. ``why`` has a clause for each of them.
    """

    equal: Any
    states: Any
    holds: Any
    why: dict[int, str]

    @property
    def certain(self) -> dict[int, bool]:
        """Map each state to what ``holds`` says of it."""
        return dict(zip(self.states.tolist(), self.holds.tolist(), strict=True))


def _differing(told: InWords, mdp: OrdinalMDP, result: Result) -> _Differing:
    """Compare the learned policy with the one for equal steps between levels."""
    equal = optimal_policy(mdp, np.linspace(0.0, 1.0, mdp.k), result.policy)
    states = np.flatnonzero((equal != result.policy) & ~mdp.terminal)
    d = result.q[states, result.policy[states]] - result.q[states, equal[states]]
    holds = decide(result.comparator, d).verdicts == Verdict.BETTER if len(states) else states > 0
    return _Differing(equal, states, holds, _reasons(told, result, states.tolist(), d))


def _reasons(
    told: InWords, result: Result, states: Sequence[int], differences: Floats
) -> dict[int, str]:
    """Return a clause for each state that differs: the level that makes the learned action better.

    An action leads to more of some levels and less of others than that of equal steps. A level
    matters as much as the difference, times that of its value from its value with equal steps. The
    value is the best guess; "may" says that its range includes that of equal steps.
    ``differences`` (n, k) are the learned action's vector value less that of equal steps.
    """
    value, steps = best_guess(result.comparator), np.linspace(0.0, 1.0, len(told.labels))
    ends = np.eye(len(told.labels)) - np.eye(len(told.labels))[0]
    low, high = bounds_of(result.comparator, ends)
    found = {}
    for state, more in zip(states, differences, strict=True):
        matters = more * (value - steps)
        level = int(np.argmax(matters))
        found[state] = "what follows in the rest of the plan"
        if matters[level] > 0 >= product(more, steps):
            grows = "more" if more[level] > 0 else "less"
            sure = low[level] > steps[level] or high[level] < steps[level]
            found[state] = (
                f"{grows} “{printable(told.labels[level])}”, which you "
                f"{'value' if sure else 'may value'} {grows} than {100 * steps[level]:.0f}"
            )
    return found


def _changes(
    told: InWords,
    mdp: OrdinalMDP,
    action_words: Callable[[int], str],
    result: Result,
    differing: _Differing,
) -> ResultTable:
    """Return the states in which the answers change the action, for certain or perhaps."""
    equal, states, holds, why = differing
    live, n = int(np.count_nonzero(~mdp.terminal)), int(holds.sum())
    rest = len(states) - n
    some = ""
    if n:
        title = f"In {n} of {live} {told.states} your answers change the {told.plan}"
        hold = "This change holds" if n == 1 else "These changes hold"
        sure = (
            "for every scale that fits your answers"
            if result.confidence == 1.0
            else f"{'' if n == 1 else 'each '}with {result.confidence:.0%} probability"
        )
        some = f" {hold} {sure}."
    elif rest:
        title = f"In {rest} of {live} {told.states} your answers may change the {told.plan}"
        some = " None of these changes is certain yet."
    else:
        title = f"Your answers do not change the {told.plan}"
    if n and rest:
        some += f" In {rest} more your answers may change it, but that is still open."
    why_note = " “Why” names the level that matters most, and its value with equal steps."
    note = f"Compared with equal steps between the levels.{some}{why_note if why else ''}"
    certain, perhaps = (
        tuple(
            (
                told.state_words(mdp.state_name(s)),
                action_words(int(equal[s])),
                action_words(int(result.policy[s])),
                why[s],
            )
            for s in some_states.tolist()
        )
        for some_states in (states[holds], states[~holds])
    )
    still_open = ResultTable(
        f"Still open in {rest} of {live} {told.states}",
        ("State", "With equal steps", "By the best guess so far", "Why"),
        perhaps,
        "Here the best guess so far differs from equal steps, but your answers do not decide it."
        + (" It matters too little to ask more." if result.loss_bound <= told.tolerance else ""),
        "open state",
    )
    return ResultTable(
        title,
        ("State", "With equal steps", "With your values", "Why"),
        certain,
        f"{note} {told.legend}",
        open=still_open if rest else None,
    )


def _plan(
    told: InWords,
    mdp: OrdinalMDP,
    action_words: Callable[[int], str],
    result: Result,
    differing: _Differing,
) -> ResultTable:
    """Return the action in every state that is not terminal, in words, for the screen."""
    change = differing.certain
    sure = (
        "for every scale that fits your answers"
        if result.confidence == 1.0
        else f"with {result.confidence:.0%} probability each"
    )
    words = {True: "changed, certain", False: "changed, not certain", None: "not changed"}
    rows = tuple(
        (
            told.state_words(mdp.state_name(s)),
            action_words(int(result.policy[s])),
            words[change.get(s)],
        )
        for s in np.flatnonzero(~mdp.terminal).tolist()
    )
    return ResultTable(
        "The whole plan",
        ("State", "Action in the plan", "By your answers"),
        rows,
        "“Changed” means other than with equal steps between the levels. “Certain” means that this "
        f"action is better than that one {sure}.",
    )


def _whole_policy(
    told: InWords,
    mdp: OrdinalMDP,
    action_words: Callable[[int], str],
    result: Result,
    differing: _Differing,
) -> ResultTable:
    """Return the action in every state that is not terminal, as a table to download."""
    equal, change, why = differing.equal, differing.certain, differing.why
    words = {True: "certain", False: "open", None: "none"}
    rows = tuple(
        (
            mdp.state_name(s),
            action_words(int(result.policy[s])),
            action_words(int(equal[s])),
            words[change.get(s)],
            why.get(s, ""),
        )
        for s in np.flatnonzero(~mdp.terminal).tolist()
    )
    columns = ("state", "action", "action_with_equal_steps", "change", "why")
    return ResultTable("Plan", columns, rows)


def icu_state(name: str) -> str:
    """Return a state of ICU-Sepsis in words, with its SOFA score as a whole number.

    Examples
    --------
    >>> icu_state("12 (mean SOFA 6.5)")
    'State 12, SOFA score about 7'
    """
    number, _, score = name.removesuffix(")").partition(" (mean SOFA ")
    return f"State {number}, SOFA score about {math.floor(float(score) + 0.5)}" if score else name


def icu_dose(action: int) -> str:
    """Return an action of ICU-Sepsis in words.

    Examples
    --------
    >>> icu_dose(20)
    'very high fluids, no vasopressor'
    """
    words = ("no", "low", "medium", "high", "very high")
    return f"{words[action // 5]} fluids, {words[action % 5]} vasopressor"


def policy_stakes(told: InWords, result: Result) -> str | None:
    """Return a sentence on what the policy learned so far can lose."""
    if np.isnan(result.loss_bound):
        return None
    if result.loss_bound < NO_LOSS:
        return _within(result.loss_bound, so_far=True)
    return (
        f"So far the plan could fall {per_hundred(result.loss_bound)} short of your ideal plan"
        f"{no_more(result.confidence)}. That is {told.loss(result.loss_bound)}. {_until(told)}"
    )


def _is_little(told: InWords, loss: float, before: float | None) -> bool:
    """Return whether so little can be lost that more questions may not be worth it."""
    return loss <= (told.little if before is None else min(told.little, _OF_BEFORE * before))


def policy_nearly(told: InWords, result: Result, before: float | None) -> NearlyEnough | None:
    """Return a statement that the policy so far can lose little, or None."""
    bound = result.loss_bound
    if np.isnan(result.confidence) or not told.tolerance < bound:
        return None
    if not _is_little(told, bound, before):
        return None
    return NearlyEnough(
        f"Your plan falls at most {per_hundred(bound)} short of your ideal plan",
        f"{_sure(result)} More questions can bring it below {per_hundred(told.tolerance)}.",
        _size(told, bound, _SHORT, None),
    )


def choice_nearly(
    told: InWords, names: Sequence[str], shares: Floats, result: Choice, before: float | None
) -> NearlyEnough | None:
    """Return a statement that some alternatives can each lose little, or None.

    They are the best guess, and as many of those nearly as good by it as the statement holds for
    with the same certainty.
    """
    if not _is_little(told, result.loss_bound, before):
        return None
    best, points = list(names).index(result.name), _points(shares, result)
    order = [i for i in np.argsort(-points, kind="stable").tolist() if i != best]
    near = [best, *(i for i in order[:_FEW_NAMED] if points[best] - points[i] <= told.little)]
    while True:
        apart = [shares[j] - shares[i] for i in near for j in range(len(names)) if j != i]
        high, confidence = simultaneous_bounds(result.comparator, np.array(apart))
        loss = max(0.0, float(high.max(initial=0.0)))
        if len(near) == 1 or _is_little(told, loss, before):
            break
        near.pop()
    sure = _with_certainty(result, confidence)
    if sure is None or not _is_little(told, loss, before):
        return None
    size = _size(told, loss, _BETTER, confidence)
    near.sort(key=lambda i: -points[i])
    near_names = listed([f"“{printable(names[i])}”" for i in near])
    if len(near) == 1:
        return NearlyEnough(
            f"{near_names} is the best for you, or nearly so",
            f"{sure} {_none_better(loss)}.",
            size,
        )
    return NearlyEnough(
        f"{near_names} are nearly equal to you",
        f"Whichever of them you choose, you lose little: {sure[0].lower()}{sure[1:]} "
        f"{_none_better(loss)}.",
        size,
    )


def _with_certainty(result: Result | Choice, confidence: float) -> str | None:
    """Return the start of a sentence on how certain it is; None if that cannot be stated."""
    if np.isnan(confidence):
        return None
    if confidence == 1.0:
        assumed = assumed_of_answers(wrong_of(result.comparator), "your")
        return f"{_capital(assumed)},"
    return f"With {confidence:.0%} probability,"


def _sure(result: Result | Choice) -> str:
    """Return a sentence on how certain the bound on the loss is."""
    if result.confidence == 1.0:
        return f"This holds {assumed_of_answers(wrong_of(result.comparator), 'your')}."
    if np.isnan(result.confidence):
        return "How sure this is cannot be stated."
    return f"This holds with {result.confidence:.0%} probability."


def choice_conclusion(
    told: InWords, names: Sequence[str], shares: Floats, result: Choice, before: float | None
) -> Conclusion:
    """Return a choice among alternatives in words, with the value of each alternative.

    ``shares`` (n, k) has a row for each alternative.
    """
    most, sure, best = per_hundred(result.loss_bound), _sure(result), printable(result.name)
    settled = choice_holds(told, result)
    if settled:
        headline = f"By your answers “{best}” is {_best_word(result)}."
        headline = f"{headline} {_next_best(told, names, shares, result)}".strip()
        if 0.0 < result.confidence < 1.0:
            sure = f"With {result.confidence:.0%} probability {_none_better(result.loss_bound)}."
        else:
            sure = f"{_capital(_none_better(result.loss_bound))}. {sure}"
        after = "You can stop here."
        more = "More answers would make it surer." if result.loss_bound > 0 else ""
    else:
        headline = f"The choice is open. The best guess so far is “{result.name}”."
        after = f"Another alternative may be better, by at most {most}. {sure}"
        if result.loss_bound < NO_LOSS:
            after = f"{_capital(_none_better(result.loss_bound))}. {sure}"
        more = "More answers help."
        sure = ""  # it belongs to that sentence, not to the headline
    unasked = (
        ""
        if before is None
        else f"Before your first answer another alternative could have been better by "
        f"{per_hundred(before)}{no_more(result.confidence)}."
    )
    worth = _worth(told, names, shares, result)
    rows = tuple((row[0], *row[-2:], "chosen" if row[0] == best else "") for row in worth.rows)
    return Conclusion(
        headline=headline,
        size=_size_and_end(told, result.loss_bound, _BETTER, result.confidence),
        sure=sure,
        next=after,
        more=more,
        before=unasked,
        changes=worth,
        result=ResultTable("Choice", ("alternative", "worth", "range", "choice"), rows),
        settled=settled,
        early=f"By your answers so far “{best}” is {_best_word(result)}. They are not checked yet.",
    )


def _best_word(result: Choice) -> str:
    """Return the words for a choice: "best", or a recommendation if another may be as good."""
    decided = result.status not in (Status.CALLED_EQUAL, Status.UNSURE) or result.loss_bound <= 0
    return "best" if decided else "the one to choose"


def _next_best(told: InWords, names: Sequence[str], shares: Floats, result: Choice) -> str:
    """Return sentences that name the next best alternatives, if they are close; otherwise ""."""
    points = _points(shares, result)
    best = list(names).index(result.name)
    close = np.flatnonzero(points >= points[best] - told.little)
    near = [i for i in close[np.argsort(-points[close], kind="stable")].tolist() if i != best]
    if not near:
        return ""
    named = near[:_FEW_NAMED]
    worth = [f"{100 * points[i]:.0f}" for i in named]
    some = [f"“{printable(names[i])}”" for i in named]
    name, top = f"“{printable(names[best])}”", f"{100 * points[best]:.0f}"
    as_good = "About as good" if top in worth else "Nearly as good"
    if len(near) == 1:
        said = f"{as_good} is {some[0]}: worth {worth[0]} of 100, {name} {top}."
    else:
        each = [f"{some[0]} (worth {worth[0]} of 100)"]
        each += [f"{one} ({value})" for one, value in zip(some[1:], worth[1:], strict=True)]
        more = len(near) - len(named)
        rest = f" {more} more {'is' if more == 1 else 'are'} close too." if more else ""
        said = f"{as_good} are {listed(each)}; {name} is worth {top}.{rest}"
    told_equal = _directions(result.answers.d[result.answers.y == 0])
    apart = _directions(shares[best] - shares)
    called = [f"“{printable(names[i])}”" for i in near if _among(apart[i], told_equal)]
    if not called:
        return said
    if len(near) == 1:
        return f"{said} You called these two equally good."
    return f"{said} You called {name} as good as {listed(called)}."


def _directions(d: Floats) -> Floats:
    """Return tail sums (n, k-1) of differences d (n, k), each divided by its largest number."""
    t = tail_sums(d)
    directions: Floats = t / np.maximum(np.abs(t).max(axis=1, keepdims=True), 1e-300)
    return directions


def _among(direction: Floats, others: Floats) -> bool:
    """Return whether a direction (k-1,) or its opposite is among others (n, k-1)."""
    apart = [np.abs(others - way * direction).max(axis=1, initial=0.0) for way in (1, -1)]
    return bool((np.minimum(*apart) < 1e-6).any())


def _points(shares: Floats, result: Choice) -> Floats:
    """Return the best guess (n,) at the value of each alternative, from 0 to 1."""
    return product(tail_sums(shares), np.diff(best_guess(result.comparator)))


def _none_better(loss: float) -> str:
    """Return a clause that no other alternative is better, or not by more than this loss."""
    by = "" if loss < NO_LOSS else f" by more than {per_hundred(loss)}"
    return f"no other alternative is better{by}"


def _capital(clause: str) -> str:
    """Return a clause with a capital letter at its start."""
    return f"{clause[0].upper()}{clause[1:]}"


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


def _worth(told: InWords, names: Sequence[str], shares: Floats, result: Choice) -> ResultTable:
    """Return a table of what each alternative consists of, and its value as far as it is known."""
    labels = told.labels
    low, high = bounds_of(result.comparator, shares)
    points = _points(shares, result)
    order = np.argsort(-points, kind="stable").tolist()
    narrow = np.minimum(high, 1.0) - np.maximum(low, 0.0) <= _NARROW
    rows = tuple(
        (
            printable(names[i]),
            *(f"{100 * share:.3g}" for share in shares[i, ::-1]),
            f"{100 * points[i]:.0f}" if narrow[i] else "not known yet",
            f"{100 * max(low[i], 0.0):.0f} to {100 * min(high[i], 1.0):.0f}",
        )
        for i in order
    )
    unknown = (
        "" if narrow.all() else " The worth is not known yet where the range is wider than 50."
    )
    best = list(names).index(result.name)
    apart = max(0.0, float((np.minimum(np.delete(high, best), 1.0) - max(low[best], 0.0)).max()))
    # shown where the ranges alone would allow a greater loss than the bound
    together = (
        " The ranges move together, because the same values of the levels go into each. So the "
        "difference between two alternatives is known better than their ranges show."
        if 100.0 * (apart - result.loss_bound) >= _ROUNDED
        else ""
    )
    return ResultTable(
        f"The {len(names)} alternatives",
        ("Alternative", *map(printable, labels[::-1]), "worth", "range"),
        rows,
        f"In 100 {printable(told.words.unit)} of each. Worth is from 0, if all were "
        f"“{printable(labels[0])}”, to 100, if all were “{printable(labels[-1])}”: the best guess, "
        f"and its range.{unknown}{together}",
        "alternative",
        unfolded=len(names) <= _MOST_UNFOLDED,
    )


def choice_stakes(told: InWords, result: Choice) -> str | None:
    """Return a sentence on what the choice can lose."""
    if np.isnan(result.loss_bound):
        return None
    if result.loss_bound < NO_LOSS:
        return f"So far {_none_better(result.loss_bound)}."
    return (
        f"So far another alternative could be better by {per_hundred(result.loss_bound)}"
        f"{no_more(result.confidence)}. That is {told.loss(result.loss_bound)}. {_until(told)}"
    )
