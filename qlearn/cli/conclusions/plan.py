"""The conclusion about a policy, in words, with what a person's answers change in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping

import numpy as np

from elicit._support.fixed_order import product
from elicit.model.comparator_parts import best_guess
from elicit.model.outcomes import Status
from elicit.model.scale import Floats
from elicit.person.course.conclusion import (
    NO_LOSS,
    Conclusion,
    DataTable,
    NearlyEnough,
    ResultTable,
    capital,
    per_hundred,
    up_to,
    with_probability,
)
from elicit.person.course.ranges import draws_again, value_ranges
from elicit.person.showing import printable
from qlearn.cli.conclusions.decided_plan import DecidedPlan, DecidedPlans
from qlearn.cli.conclusions.in_words import (
    InWords,
    condition_of,
    is_little,
    sure_of,
    until,
)
from qlearn.cli.conclusions.outcomes import Effect, effects_of, outcomes_of
from qlearn.learners.learner import Result
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import evaluate_policy

_HARDLY = 0.02  # of the states: a plan that differs in no more is nearly the same
_SEEN = 5e-5  # the least change of a share of time that is shown
_REST = "what follows in the rest of the plan"
_IN_MODEL = "In the model"
_TOO_LITTLE = ": on the whole it makes too little difference to go on asking"
_STEPS_PLAN = "Your plan is settled. It is the one for equal steps between the levels."
_STEPS = "equal steps between the levels (each better than the one below it by the same amount)"


def policy_conclusion(
    told: InWords,
    plans: DecidedPlans,
    action_words: Callable[[int], str],
    result: Result,
    before: float | None,
) -> Conclusion:
    """Return a policy's result in words, with the states in which the answers change it.

    The answers change a state if the learned action there is better than that of equal steps, both
    followed by the plan, for every scale still plausible, or with the comparator's confidence. In
    all other states the plan keeps the action with equal steps.
    """
    found = plans.of(result)
    bound = found.guarantee.loss_bound
    settled = bound <= told.tolerance
    if settled:
        bound = told.stated(bound)
    more = ""
    same = len(result.answers) > 0 and not found.holds.any()
    if np.isnan(bound):
        headline = "How far your plan may fall short of your ideal plan cannot be stated."
        after = "Another comparator can state it."
    elif settled:
        headline = f"Your plan is settled. {_within(bound)}"
        if found.leaning:
            headline = f"{_decided(told, plans.mdp, found)} {_within(bound, 'the plan')}"
        elif same:
            headline = f"{_STEPS_PLAN} {_within(bound)}"
        after, more = "You can stop here.", "More answers would make the values more exact."
        if found.leaning:
            more = (
                f"More answers would make the values more exact, and may decide more {told.states}."
            )
    else:
        headline = f"{_within(bound, 'so far your plan')} It is not settled yet."
        if same:
            headline = f"{headline} It is the one for equal steps between the levels."
        after = {
            Status.CALLED_EQUAL: "What is still open, you called equally good.",
            Status.UNSURE: "What is still open, you could not tell.",
            Status.EXHAUSTED: "Every question that would help was answered, or you could not tell.",
        }.get(result.status, "")
        more = "" if after else f"More answers help. {until(told)}"
    unasked = (
        ""
        if before is None
        else f"Without your answers, a loss of {up_to(before, result.confidence)} could not be "
        f"ruled out: {told.loss(before)}. {_gain(told, plans.mdp, found, result)}".strip()
    )
    mdp, undecided = plans.mdp, len(found.leaning)
    open_still = ""
    if undecided and found.holds.any() and not settled:  # otherwise the reason says it
        live = int(np.count_nonzero(~mdp.terminal))
        open_still = (
            f" Your answers do not decide {undecided} of {live} {told.states}: there the plan "
            f"keeps what is best with {_STEPS}."
        )
    why = _reasons(told, result, found)
    effects = effects_of(told, mdp, found)
    changed = [state for state, held in found.certain.items() if held]
    traded = _trade(told, effects, changed, "the change")
    effect, outcomes = outcomes_of(told, mdp, found)
    return Conclusion(
        headline=headline,
        reason=_reason(told, mdp, found, why, traded, settled),
        effect=f"{effect} {told.caveat()}".strip(),
        sure=f"{_close(told, result, bound)}{open_still}",
        next=after,
        more=more,
        before=unasked,
        changes=_changes(told, mdp, action_words, result, found, why, effects),
        plan=_plan(told, mdp, action_words, result, found),
        result=_whole_policy(told, mdp, action_words, found, why),
        outcomes=outcomes,
        settled=settled,
        early=f"So far {_within(bound, 'your plan', False)} Your answers are not checked yet.",
    )


def _gain(told: InWords, mdp: OrdinalMDP, found: DecidedPlan, result: Result) -> str:
    """Return a sentence on what the plan is worth more than that of equal steps, or ""."""
    if not found.holds.any():
        return ""
    more = mdp.initial @ (evaluate_policy(mdp, found.policy) - evaluate_policy(mdp, found.equal))
    worth = 100.0 * float(product(more, best_guess(result.comparator)))
    return (
        f"By the best guess of your values, the {told.plan} with your answers is worth "
        f"{_signed(worth)} of 100 beside that of equal steps, from the start."
    )


def _within(loss: float, plan: str = "it", starts: bool = True) -> str:
    """Return a sentence on how close a plan comes to the ideal plan."""
    if loss < NO_LOSS:
        said = "no other plan can be better for you."
    else:
        said = f"{plan} comes within {per_hundred(loss)} of your ideal plan."
    return capital(said) if starts else said


def _decided(told: InWords, mdp: OrdinalMDP, found: DecidedPlan) -> str:
    """Return sentences on what the answers decide, if they leave some states open."""
    live, n = int(np.count_nonzero(~mdp.terminal)), int(found.holds.sum())
    said = f"change the {told.plan} in {n} of {live} {told.states}"
    if not n:
        return "So far your plan is the one for equal steps between the levels."
    if n <= _HARDLY * live:
        return (
            "Your values lead to nearly the same plan as equal steps between the levels: your "
            f"answers {said}."
        )
    return f"Compared with equal steps between the levels, your answers {said}."


def _close(told: InWords, result: Result, bound: float) -> str:
    """Return a sentence on how sure the bound on a plan's loss is, and how much that is."""
    if (when := condition_of(result)) is None:
        return sure_of(result)
    if bound < NO_LOSS:
        return f"{capital(when)}, no other plan is better for your exact values."
    return (
        f"{capital(when)}, your plan falls at most {per_hundred(bound)} short of your ideal plan, "
        f"the one for your exact values. That is {told.loss(bound)}."
    )


def _reason(
    told: InWords,
    mdp: OrdinalMDP,
    found: DecidedPlan,
    why: Mapping[int, str],
    traded: str,
    settled: bool,
) -> str:
    """Return sentences on what the answers change in the plan, and mostly why.

    ``traded`` is the sentence on changes with which fewer end well.
    """
    n, live = int(found.holds.sum()), int(np.count_nonzero(~mdp.terminal))
    if not n:
        rest = len(found.states)
        if not rest:
            return f"In all {live} {told.states} the plan is the one with {_STEPS}."
        return (
            f"In {live - rest} of {live} {told.states} your values lead to the same {told.plan} as "
            f"{_STEPS}. {capital(_undecided(rest))} too. More answers might change that."
        )
    given = Counter(why[state] for state, holds in found.certain.items() if holds)
    [(most, times)] = given.most_common(1)
    mostly = "" if times == n else "mostly "
    reason = f", {mostly}because it {most}" if 2 * times > n and most != _REST else ""
    said = f"In {n} of {live} {told.states} your answers change the {told.plan}{reason}.{traded}"
    if not (rest := len(found.leaning)):
        return said
    kept, other = live - n - rest, "one" if rest == 1 else f"{rest}"
    return (
        f"{said} In {kept} the plan is the same as with {_STEPS}. In the other {other} your "
        f"answers do not decide, so it is the same there, too{_TOO_LITTLE if settled else ''}."
    )


def _undecided(rest: int) -> str:
    """Return a clause on the states that are not decided: that the plan is the same there."""
    return "the undecided one keeps it" if rest == 1 else f"the {rest} undecided ones keep it"


def _reasons(told: InWords, result: Result, found: DecidedPlan) -> dict[int, str]:
    """Return a clause for each state that differs: the level that makes the learned action better.

    An action leads to more of some levels and less of others than that of equal steps. A level
    matters as much as the difference, times that of its value from its value with equal steps. The
    value is the best guess; "probably" says that its range, as it is shown, includes that of equal
    steps.
    """
    value, steps = best_guess(result.comparator), np.linspace(0.0, 1.0, len(told.labels))
    low, high = value_ranges(result.comparator, draws_again(result.comparator))
    why = {}
    for state, more in zip(found.states.tolist(), found.differences, strict=True):
        matters = more * (value - steps)
        level = int(np.argmax(matters))
        why[state] = _REST
        if matters[level] > 0 >= product(more, steps):
            grows = "more" if more[level] > 0 else "less"
            sure = low[level] > steps[level] or high[level] < steps[level]
            name, probably = printable(told.labels[level]), "" if sure else " probably"
            why[state] = (
                f"leads to {grows} time at “{name}”, which you{probably} value at {grows} than "
                f"{100 * steps[level]:.0f} (its value with equal steps)"
            )
    return why


def _changes(
    told: InWords,
    mdp: OrdinalMDP,
    action_words: Callable[[int], str],
    result: Result,
    found: DecidedPlan,
    why: Mapping[int, str],
    effects: Mapping[int, Effect],
) -> ResultTable:
    """Return the states in which the answers change the action, and those that they leave open.

    ``why`` has a reason for each of these states, and ``effects`` what becomes of their patients.
    """
    live, n = int(np.count_nonzero(~mdp.terminal)), int(found.holds.sum())
    rest = len(found.states) - n
    some = ""
    if n:
        title = f"In {n} of {live} {told.states} your answers change the {told.plan}"
        hold = "this change is better" if n == 1 else "each of these changes is better"
        some = f" By your values {hold} {_for_certain(result)}, if the rest of the {told.plan} is"
        some += " as here."
        if with_probability(result.confidence):
            some += " More answers may still change this list."
    else:
        so_far = "So far your" if rest else "Your"
        title = f"{so_far} answers do not change the {told.plan}"
        some = f" In all {live} {told.states} the plan is the same."
        if rest:
            some = f" In {live - rest} of {live} {told.states} the plan is the same, and "
            some += f"{_undecided(rest)} too. Further answers might change that."
    if rest and n:
        some += f" In {rest} more, further answers might change it."
    word = printable(told.words.ends[-1]) if effects else ""
    values = best_guess(result.comparator)
    why_note = (
        " “Why” names the level that matters most by the best guess. “Share of time” says at which "
        "levels there is more or less of all time, where later time counts less, and what that is "
        "worth by the best guess."
        if why
        else ""
    )
    certain, perhaps = (
        tuple(
            (
                told.state_words(mdp.state_name(s)),
                action_words(int(found.equal[s])),
                action_words(learned),
                why[s],
                *([effects[s].said(word)] if effects else []),
                _moved(told, moved, values),
            )
            for s, learned, held, moved in zip(
                found.states.tolist(),
                found.learned.tolist(),
                found.holds.tolist(),
                found.differences,
                strict=True,
            )
            if held is wanted
        )
        for wanted in (True, False)
    )
    more = (*((_IN_MODEL,) if effects else ()), "Share of time")
    not_decided = ResultTable(
        f"Not decided by your answers in {rest} of {live} {told.states}",
        ("State", "In the plan (equal steps)", "Perhaps better", "Why", *more),
        perhaps,
        "Another action is better here by the best guess of your values, but not for all values "
        "that fit your answers. So the plan keeps the action that is best with equal steps. "
        + (
            "More answers may decide for either, but on the whole that makes too little difference "
            "to go on."
            if _bound(found) <= told.tolerance
            else "More answers may decide for either."
        )
        + _trade(told, effects, found.leaning, "the other action")
        + ("" if n else why_note),
        "undecided state",
    )
    return ResultTable(
        title,
        ("State", "With equal steps", "With your values", "Why", *more),
        certain,
        f"Compared with {_STEPS}.{some}{why_note if n else ''}\n{told.legend}".strip(),
        open=not_decided if rest else None,
    )


def _moved(told: InWords, difference: Floats, values: Floats) -> str:
    """Return how the shares of time at the levels change, best first, and what that is worth.

    ``difference`` (k,) is of vector values, and ``values`` (k,) are those of the levels.
    """
    each = [
        f"{told.labels[level]}\u00a0{_signed(100.0 * difference[level])}%"
        for level in range(len(values))[::-1]
        if abs(difference[level]) >= _SEEN
    ]
    worth = 100.0 * float(product(difference, values))
    said = ", ".join(each) or "about the same"
    return f"{said}: worth {_signed(worth)} of 100"


def _signed(number: float) -> str:
    """Return a number with two decimals and its sign."""
    return f"{number:+.2f}".replace("-", "\u2212")


def _trade(
    told: InWords, effects: Mapping[int, Effect], states: Collection[int], action: str
) -> str:
    """Return a sentence on the states where fewer end well with an action, or ""."""
    n = sum(effects[s].is_fewer for s in states if s in effects)
    if not n:
        return ""
    where = "In all of these states" if n == len(states) > 1 else f"In {n} of these states"
    where = "Here" if n == len(states) == 1 else where
    unit, word = printable(told.words.unit), printable(told.words.ends[-1])
    return (
        f" {where} fewer {unit} would {word} with {action}: your answers also weigh the time in "
        "each condition before the end, and not only the end."
    )


def _bound(found: DecidedPlan) -> float:
    """Return the bound on the plan's loss."""
    return found.guarantee.loss_bound


def _for_certain(result: Result) -> str:
    """Return the end of a clause: how sure it is that an action is better than another."""
    return with_probability(result.confidence) or "for every scale that fits your answers"


def _plan(
    told: InWords,
    mdp: OrdinalMDP,
    action_words: Callable[[int], str],
    result: Result,
    found: DecidedPlan,
) -> ResultTable:
    """Return the action in every state that is not terminal, in words, for the screen."""
    change = found.certain
    words = {True: "changed", False: "not decided", None: "as with equal steps"}
    rows = tuple(
        (
            told.state_words(mdp.state_name(s)),
            action_words(int(found.policy[s])),
            words[change.get(s)],
        )
        for s in np.flatnonzero(~mdp.terminal).tolist()
    )
    notes = []
    if found.holds.any():
        notes.append(
            "“Changed” is another action than with equal steps. It is better "
            f"{_for_certain(result)}."
        )
    if found.leaning:
        notes.append(
            "“Not decided” is the action with equal steps, where another one is better by the "
            "best guess of your values, but not for certain."
        )
    notes.append(f"“As with equal steps” is the action that is best with {_STEPS}.")
    columns = ("State", "Action in the plan", "By your answers")
    return ResultTable("The whole plan", columns, rows, " ".join(notes))


def _whole_policy(
    told: InWords,
    mdp: OrdinalMDP,
    action_words: Callable[[int], str],
    found: DecidedPlan,
    why: Mapping[int, str],
) -> DataTable:
    """Return the action in every state that is not terminal, as a table to download."""
    change, leaning = found.certain, found.leaning
    words = {True: "certain", False: "not decided", None: "none"}
    rows = tuple(
        (
            mdp.state_name(s),
            told.state_words(mdp.state_name(s)),
            action_words(int(found.policy[s])),
            action_words(int(found.equal[s])),
            words[change.get(s)],
            action_words(leaning[s]) if s in leaning else "",
            why.get(s, ""),
        )
        for s in np.flatnonzero(~mdp.terminal).tolist()
    )
    columns = (
        "state",
        "state_in_words",
        "action",
        "action_with_equal_steps",
        "change",
        "perhaps_better",
        "why",
    )
    return DataTable("Plan", columns, rows)


def policy_stakes(told: InWords, result: Result) -> str | None:
    """Return a sentence on what the policy learned so far, the best guess, can lose."""
    if np.isnan(result.loss_bound):
        return None
    if result.loss_bound < NO_LOSS:
        return f"So far {_within(result.loss_bound, 'your plan', False)}"
    most = up_to(result.loss_bound, result.confidence)
    return (
        f"If the questions ended now, your plan could fall short of your ideal plan by {most}: "
        f"{told.loss(result.loss_bound)}. {until(told)}"
    )


def valuation(mdp: OrdinalMDP) -> str:
    """Return sentences on how a policy is valued, from the values of the levels."""
    ends = " The condition at the end counts as lasting." if mdp.terminal.any() else ""
    return (
        f"How a plan is valued: by the levels that it leads to, step after step.{ends} Each step "
        f"counts {mdp.discount:.4g} times as much as the one before. The questions do not use "
        "this: they compare only what they show."
    )


def policy_nearly(
    told: InWords, plans: DecidedPlans, result: Result, before: float | None
) -> NearlyEnough | None:
    """Return a statement that the plan so far can lose little, or None."""
    if np.isnan(result.confidence) or not is_little(told, result.loss_bound, before):
        return None
    bound = _bound(plans.of(result))
    if not told.tolerance < bound or not is_little(told, bound, before):
        return None
    return NearlyEnough(
        f"Your plan falls at most {per_hundred(bound)} short of your ideal plan",
        _close(told, result, bound),
        "",
    )


def policy_holds(told: InWords, plans: DecidedPlans, result: Result) -> bool:
    """Return whether the plan of what the answers decide is settled, if the learned policy is.

    The learned policy may lose as little while the plan still loses more.
    """
    return not result.loss_bound <= told.tolerance or _bound(plans.of(result)) <= told.tolerance
