"""The table of what a person's answers change holds what is certain, and says how certain."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from elicit import (
    Answers,
    Bags,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    Status,
    Words,
    choose,
)
from elicit.model.comparator_parts import simultaneous_bounds
from elicit.person.course.conclusion import NO_LOSS
from qlearn import (
    InteractivePolicyIteration,
    OrdinalMDP,
    equal_gaps_policy,
    evaluate_policy,
    loss_bound,
    policy_loss,
    random_mdp,
)
from qlearn.cli.conclusions.choice import (
    choice_conclusion,
    choice_nearly,
    choice_stakes,
    most_short,
)
from qlearn.cli.conclusions.decided_plan import DecidedPlans
from qlearn.cli.conclusions.in_words import InWords
from qlearn.cli.conclusions.plan import policy_conclusion, policy_nearly, policy_stakes
from qlearn.learners.learner import Result

MAKERS: dict[str, tuple[Any, str]] = {
    "polytope": (PolytopeComparator, "for every scale that fits your answers"),
    "posterior": (
        lambda k: PosteriorComparator(k, particles=300, seed=0),
        "with 95% probability",
    ),
}


def share_vectors(mdp: OrdinalMDP, plan: Any) -> Any:
    """The vector values (S, A, k) of each action, before a plan."""
    after = np.einsum("sat,tk->sak", dense(mdp), evaluate_policy(mdp, plan))
    now = np.eye(mdp.k)[mdp.levels]
    return (1 - mdp.discount) * now + mdp.discount * after


def dense(mdp: OrdinalMDP) -> Any:
    return mdp.transitions.toarray().reshape(mdp.n_states, mdp.n_actions, mdp.n_states)


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("name", MAKERS)
def test_a_plan_changes_only_what_is_certain_and_says_what_is_not_decided(
    name: str, seed: int
) -> None:
    mdp, values = random_mdp(8, 3, 4, 0.9, seed=seed)
    make, sure = MAKERS[name]
    told, tutor = InWords(mdp.labels, Words(), 1e-4), FlippingTutor(values, 0.0)
    learner = InteractivePolicyIteration(mdp, make(4), tolerance=1e-4, bags=Bags(days=10))
    equal, found, clauses = equal_gaps_policy(mdp), set(), 0
    plans = DecidedPlans(mdp, told.tolerance)
    for _ in range(10):
        result = learner.result()
        found_now = policy_conclusion(told, plans, mdp.action_name, result, None)
        changes, plan, table = found_now.changes, found_now.plan, found_now.result
        assert changes is not None
        assert plan is not None
        assert table is not None
        taken = np.array([int(row[1]) for row in plan.rows])
        states = np.flatnonzero(equal != result.policy)
        q = share_vectors(mdp, taken)
        d = q[states, result.policy[states]] - q[states, equal[states]]
        certain = states[taken[states] == result.policy[states]]
        if len(certain):
            held = d[np.isin(states, certain)]
            assert (result.comparator.compare(held) == 1).all()
        others = np.setdiff1d(np.arange(8), certain)
        assert (taken[others] == equal[others]).all()
        assert [row[:3] for row in changes.rows] == [
            (mdp.state_name(s), mdp.action_name(equal[s]), mdp.action_name(result.policy[s]))
            for s in certain.tolist()
        ]
        n, rest = len(certain), len(states) - len(certain)
        said_of = dict.fromkeys(states.tolist(), "not decided")
        said_of |= dict.fromkeys(certain.tolist(), "changed")
        assert [row[2] for row in plan.rows] == [
            said_of.get(s, "as with equal steps") for s in range(8)
        ]
        to_keep = {"changed": "certain", "not decided": "not decided"}
        assert [(row[0], int(row[2]), row[4]) for row in table.rows] == [
            (mdp.state_name(s), taken[s], to_keep.get(said_of.get(s, ""), "none")) for s in range(8)
        ]
        still_open = [] if changes.open is None else [row[0] for row in changes.open.rows]
        assert still_open == [mdp.state_name(s) for s in states.tolist() if s not in certain]
        undecided = f" Your answers do not decide {rest} of 8 states: there the plan keeps "
        assert (undecided in found_now.sure) == (n > 0 and rest > 0)  # else the reason says it
        if changes.open is not None:
            assert ("“Why” names the level" in changes.open.note) == (n == 0)
            assert changes.open.title == f"Not decided by your answers in {rest} of 8 states"
            assert all(
                row[1] == mdp.action_name(equal[names_of(mdp)[row[0]]]) for row in changes.open.rows
            )
        found.add((min(n, 2), min(rest, 1)))
        held_so = "this change is better" if n == 1 else "each of these changes is better"
        title, note = {
            False: (
                f"{'So far your' if rest else 'Your'} answers do not change the plan",
                " In all 8 states the plan is the same.",
            ),
        }.get(
            n > 0,
            (
                f"In {n} of 8 states your answers change the plan",
                f" By your values {held_so} {sure}, if the rest of the plan is as here."
                + " More answers may still change this list." * (name == "posterior"),
            ),
        )
        if rest:
            some = f" In {rest} more, further answers might change it."
            keep = "one keeps it" if rest == 1 else "ones keep it"
            keep = f"the {'' if rest == 1 else f'{rest} '}undecided {keep} too."
            none = f" In {8 - rest} of 8 states the plan is the same, and {keep} Further answers "
            note = note + some if n else f"{none}might change that."
        else:
            assert "might change" not in note + found_now.reason
        if not n:  # nothing claims a change, and the first lines say so
            unchanged = "s the one for equal steps between the levels."
            assert unchanged in found_now.headline or not len(result.answers)
            same = "In all 8 states the plan is the one with equal steps "
            if rest:
                same = f"In {8 - rest} of 8 states your values lead to the same plan as equal steps"
            assert found_now.reason.startswith(same)
            assert ("More answers might change that." in found_now.reason) == (rest > 0)
        assert changes.title == title
        more = r"( In \d+ the plan is the same as with equal steps .* same there, too(: .*)?\.)?"
        reason = re.fullmatch(
            rf"{title}(?:, (mostly )?because it ([^.]*))?\.{more if rest else ''}", found_now.reason
        )
        assert (reason is not None) == (n > 0)
        if reason and reason[2]:
            same = sum(row[3] == reason[2] for row in changes.rows)
            assert n / 2 < same <= n
            assert (same == n) == (reason[1] is None)
        if n:
            note += (
                " “Why” names the level that matters most by the best guess. “Share of time” says "
                "at which levels there is more or less of all time, where later time counts less, "
                "and what that is worth by the best guess."
            )
        steps = "equal steps between the levels (each better than the one below it by the same "
        assert changes.note.strip() == f"Compared with {steps}amount).{note}"
        for state, row in zip(certain.tolist(), changes.rows, strict=True):
            why, more = row[3], d[states.tolist().index(state)]
            if why != "what follows in the rest of the plan":
                found_why = (
                    r"leads to (more|less) time at “(.*)”, which you( probably)? value at \1 than "
                )
                found_why += r"\d+ \(its value with equal steps\)"
                grows, label, _ = re.fullmatch(found_why, why).groups()
                level = mdp.labels.index(label)
                assert (more[level] > 0) == (grows == "more")
                if "probably" not in why:  # it holds for every plausible scale
                    apart = (
                        np.eye(4)[[level]]
                        - np.eye(4)[[0]]
                        - level / 3 * (np.eye(4)[[3]] - np.eye(4)[[0]])
                    )
                    assert result.comparator.compare(apart)[0] == (1 if grows == "more" else -1)
                    clauses += 1
        if not (queries := learner.ask()):
            break
        learner.tell([tutor(query) for query in queries])
    assert len(found) >= 3  # kinds of tables
    assert clauses


def names_of(mdp: OrdinalMDP) -> dict[str, int]:
    """The states by name."""
    return {mdp.state_name(s): s for s in range(mdp.n_states)}


def test_a_plan_that_leaves_states_open_is_not_said_to_be_settled() -> None:
    seen = set()
    for seed in (0, 3):
        mdp, values = random_mdp(8, 3, 4, 0.9, seed=seed)
        told, tutor = InWords(mdp.labels, Words(), 1.0), FlippingTutor(values, 0.0)
        learner = InteractivePolicyIteration(
            mdp, PolytopeComparator(4), tolerance=1e-4, bags=Bags(days=10)
        )
        plans = DecidedPlans(mdp, told.tolerance)
        while queries := learner.ask():
            learner.tell([tutor(query) for query in queries])
            found = policy_conclusion(told, plans, mdp.action_name, learner.result(), None)
            assert found.settled
            assert found.plan is not None
            kinds = [row[2] for row in found.plan.rows]
            n, rest = kinds.count("changed"), kinds.count("not decided")
            seen.add((n > 0, min(rest, 2)))
            assert found.headline.startswith("Your plan is settled") == (not rest)
            assert ("is the one for equal steps" in found.headline) == (not n)
            if rest:
                kept = kinds.count("as with equal steps")
                said = "Compared with equal steps between the levels, your answers change the plan "
                said += f"in {n} of 8 states."
                if not n:
                    said = "So far your plan is the one for equal steps between the levels. The "
                assert found.headline.startswith(said)
                other = "one" if rest == 1 else f"{rest}"
                little = (
                    f" In the other {other} your answers do not decide, so it is the same there, "
                    "too: on the whole it makes too little difference to go on asking."
                )
                assert found.reason.endswith(little) == (n > 0)
                same = f" In {kept} the plan is the same as with equal steps between the levels "
                assert (same in found.reason) == (n > 0)
    assert {(True, 1), (True, 2)} & seen
    assert len(seen) >= 3


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", MAKERS)
def test_the_bound_on_a_plan_of_what_is_decided_holds_and_it_beats_equal_steps(
    name: str, seed: int
) -> None:
    mdp, values = random_mdp(8, 3, 4, 0.9, seed=seed)
    learner = InteractivePolicyIteration(mdp, MAKERS[name][0](4), tolerance=0.01, bags=Bags(10))
    plans, tutor, mixed = DecidedPlans(mdp, 0.01), FlippingTutor(values, 0.0), 0
    for _ in range(8):
        result = learner.result()
        found = plans.of(result)
        bound, least = found.guarantee.loss_bound, loss_bound(mdp, found.policy, result.comparator)
        if name == "polytope":
            assert policy_loss(mdp, found.policy, values).max() <= bound + 1e-9
        assert least.loss_bound <= bound * 1.02 + 1e-9  # which is about as exact
        assert bound <= max(0.01, 1.1 * result.loss_bound, least.loss_bound) + 1e-9
        assert plans.of(learner.result()) is found  # it is made once
        better = evaluate_policy(mdp, found.policy) - evaluate_policy(mdp, found.equal)
        if name == "polytope":
            assert (simultaneous_bounds(result.comparator, -better)[0] <= 1e-9).all()
        mixed += bool(found.leaning)
        if not (queries := learner.ask()):
            break
        learner.tell([tutor(query) for query in queries])
    assert mixed or seed


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ([0.02, 0.02, 0.96], " Next best is “other” (97 against 100 of 100)."),
        ([0.1, 0.0, 0.9], ""),
    ],
)
def test_the_next_best_alternative_is_named_if_it_is_close(second: list[float], said: str) -> None:
    shares = np.array([[0.0, 0.0, 1.0], second, [0.5, 0.5, 0.0]])
    names = ["first", "other", "third"]
    result = choose(shares, PolytopeComparator(3), names=names).result()
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    found = choice_conclusion(told, names, shares, result, None)
    assert found.headline == f"By your answers “first” is best.{said}"
    assert found.sure.startswith("No other alternative is better. This holds ")


@pytest.mark.parametrize("name", MAKERS)
def test_how_sure_a_bound_is_stands_beside_it_unless_it_is_proven(name: str) -> None:
    mdp, _ = random_mdp(8, 3, 4, 0.9, seed=3)
    make, _ = MAKERS[name]
    told = InWords(mdp.labels, Words(), 1e-4)
    learner = InteractivePolicyIteration(mdp, make(4), tolerance=1e-4, bags=Bags(days=10))
    result, plans = learner.result(), DecidedPlans(mdp, told.tolerance)
    found = policy_conclusion(told, plans, mdp.action_name, result, 0.2)
    stakes = policy_stakes(told, result)
    assert stakes is not None
    if name == "posterior":
        assert "for your exact values. That is as much as if " in found.sure
        assert found.sure.startswith("With 95% probability, your plan falls at most ")
        assert (
            " up to 20 in 100 (with 95% probability) could not be ruled out: as much as if "
            in found.before
        )
        assert re.search(r" ideal plan by up to [\d.]+ in 100 \(with 95% probability\): ", stakes)
    else:
        assert " up to 20 in 100 could not be ruled out: as much as if " in found.before
        assert found.sure.startswith("If your answers are right, your plan falls at most ")
        assert "probability" not in f"{found.sure}{stakes}"
    shares = np.array([[0.0, 0.4, 0.6, 0.0], [0.1, 0.0, 0.5, 0.4], [0.0, 0.2, 0.6, 0.2]])
    names = ["first", "second", "third"]
    choice = choose(shares, make(4), names=names).result()
    chosen = choice_conclusion(told, names, shares, choice, 0.2)
    asked = choice_stakes(told, choice)
    assert asked is not None
    for said in (chosen.size, chosen.before, asked):
        assert ("with 95% probability" in said) == (name == "posterior"), said


def test_several_close_alternatives_are_named_with_their_worth_and_shown_in_an_open_table() -> None:
    shares = np.array([[0.0, 0.0, 1.0], [0.02, 0.02, 0.96], *[[0.01, 0.0, 0.99]] * 4])
    names = ["first", "other", "b", "c", "d", "e"]
    result = choose(shares, PolytopeComparator(3), names=names).result()
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    found = choice_conclusion(told, names, shares, result, None)
    assert found.headline.endswith(
        "Next best are “b” (worth 99 of 100), “c” (99) and “d” (99); “first” is worth 100. "
        "2 more are close too."
    )
    assert found.changes is not None
    assert found.changes.unfolded
    many = np.vstack([shares, *[[[0.5, 0.5, 0.0]]] * 7])
    names = [*names, *"tuvwxyz"]
    result = choose(many, PolytopeComparator(3), names=names).result()
    found = choice_conclusion(told, names, many, result, None)
    assert found.changes is not None
    assert not found.changes.unfolded


def test_no_size_is_given_to_a_loss_of_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    shares = np.array([[0.0, 0.0, 1.0], [0.02, 0.02, 0.96], [0.5, 0.5, 0.0]])
    names = ["first", "other", "third"]
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    sure = choose(shares, PolytopeComparator(3), names=names).result()
    mdp, _ = random_mdp(8, 3, 4, 0.9, seed=0)
    plan_told = InWords(mdp.labels, Words(), 0.01)
    plan = InteractivePolicyIteration(mdp, PolytopeComparator(4)).result()
    for loss in (0.0, 4e-6, 0.005):
        choice = replace(sure, guarantee=lambda loss=loss: (loss, 1.0))
        monkeypatch.setattr(Result, "loss_bound", loss)
        found = [
            choice_conclusion(told, names, shares, choice, 0.5),
            policy_conclusion(plan_told, DecidedPlans(mdp, 0.01), mdp.action_name, plan, 0.5),
        ]
        said = [
            choice_stakes(told, choice) or "",
            policy_stakes(plan_told, plan) or "",
            *(f"{one.headline} {one.early} {one.sure} {one.size}" for one in found),
        ]
        for text in said:
            assert " 0 in 100" not in text
        for text in said[2:]:
            assert bool(re.search("as much as if (0.5|1) in", text)) == (loss == 0.005)
        assert bool(found[0].size) == (loss == 0.005)


@pytest.mark.parametrize("scale", [1.0, 20.0, 1 / 3])
def test_an_alternative_that_was_called_equally_good_is_said_to_be(scale: float) -> None:
    shares = np.array([[0.1, 0.2, 0.7], [0.02, 0.35, 0.63], [0.5, 0.5, 0.0]])
    names = ["first", "other", "third"]
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    chosen = replace(
        choose(shares, PolytopeComparator(3), names=names).result(),
        best=0,
        name="first",
        status=Status.DONE,
    )
    rows = [scale * (shares[0] - shares[1]), [0.0, 1.0, 0.0]]
    for said, called in (([0, 1], True), ([1, 1], False), ([1, 0], False)):
        answers = Answers(rows, said)
        known = PolytopeComparator(3).update(Answers(rows[:1], [0]))
        found = replace(chosen, answers=answers, comparator=known)
        headline = choice_conclusion(told, names, shares, found, None).headline
        equal = headline.startswith("You called “first” and “other” equally good. By all your ")
        assert equal is called
        assert (" as good is “other” (" in headline) is not called


def test_what_was_called_as_good_as_the_choice_is_named_before_what_is_close() -> None:
    shares = np.array([[0.0, 0.0, 1.0], [0.02, 0.02, 0.96], [0.01, 0.0, 0.99]])
    names = ["first", "other", "b"]
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    done = choose(shares, PolytopeComparator(3), names=names).result()
    found = replace(done, answers=Answers([shares[0] - shares[1]], [0]))
    assert choice_conclusion(told, names, shares, found, None).headline == (
        "You called “first” and “other” equally good. By all your answers they are worth 100 and "
        "97 of 100. Next best is “b” (99 of 100)."
    )


@pytest.mark.parametrize("status", [Status.DONE, Status.CALLED_EQUAL, Status.UNSURE])
def test_a_choice_that_need_not_be_the_best_is_only_recommended(status: Status) -> None:
    shares = np.array([[0.1, 0.2, 0.7], [0.08, 0.23, 0.69], [0.12, 0.18, 0.7]])
    names = ["first", "other", "third"]
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    rows = [shares[0] - shares[1], shares[0] - shares[2]]
    found = replace(
        choose(shares, PolytopeComparator(3), names=names).result(),
        best=0,
        name="first",
        status=status,
        answers=Answers(rows, [1, 1]),
        guarantee=lambda: (0.005, 0.95),
    )
    conclusion = choice_conclusion(told, names, shares, found, None)
    word = "best" if status is Status.DONE else "the one to choose"
    assert conclusion.headline.startswith(f"By your answers “first” is {word}. ")
    equal = replace(found, answers=Answers(rows, [0, 0]))
    assert choice_conclusion(told, names, shares, equal, None).headline.startswith(
        "You called “first”, “other” and “third” equally good. By all your answers they are worth "
    )
    assert (
        conclusion.early == f"By your answers so far “first” is {word}. They are not checked yet."
    )
    none = "With 95% probability no other alternative is better by more than 1 in 100."
    assert conclusion.sure.startswith(f"{none} “middle” is known only roughly. ")


@pytest.mark.parametrize(("second", "together"), [([0.02, 0.8, 0.18], True), ([1, 0, 0], False)])
def test_ranges_that_overlap_although_one_is_ahead_are_explained(
    second: list[float], together: bool
) -> None:
    """Both contain the middle level, or only one does, and the other is worth nothing."""
    shares = np.array([[0.0, 0.8, 0.2], second])
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    result = choose(shares, PolytopeComparator(3), names=["first", "other"]).result()
    changes = choice_conclusion(told, ["first", "other"], shares, result, None).changes
    assert changes is not None
    assert ("The ranges of two alternatives may touch or overlap" in changes.note) is together


@pytest.mark.parametrize("name", MAKERS)
def test_the_lead_over_the_second_is_said_and_holds_for_every_plausible_scale(name: str) -> None:
    shares = np.array([[0.0, 0.4, 0.6, 0.0], [0.1, 0.0, 0.5, 0.4], [0.0, 0.7, 0.2, 0.1]])
    names, tutor = ["first", "second", "third"], FlippingTutor([0.0, 0.3, 0.45, 1.0], 0.0)
    told = InWords(("dead", "bad", "fair", "good"), Words("people"), 0.01, alternative="therapy")
    choosing = choose(shares, MAKERS[name][0](4), names=names)
    leads = set()
    for _ in range(20):
        result = choosing.result()
        found = choice_conclusion(told, names, shares, result, None)
        assert found.changes is not None
        best, rows = names.index(result.name), {row[0]: row for row in found.changes.rows}
        said = re.fullmatch(
            r"On the scale from 0 \(all “dead”\) to 100 \(all “good”\), "
            r"“(\w+)” is worth ([\d.]+|less than 0\.1) more than the second, “(\w+)” "
            r"\(best guess(?:; (at least as good|at least ([\d.]+) more), "
            r"(with 95% probability|for all values that fit your answers))?\)\. "
            r"In 100 people it has (.*) in place of (.*)\. "
            r"By (your answers|the best guess) that is better\.",
            found.reason,
        )
        assert said, found.reason
        second = names.index(said[3])
        d = shares[best] - shares[second]
        low = -simultaneous_bounds(result.comparator, -d[None, :])[0][0]
        assert (said[4] is None) == (low <= -NO_LOSS)  # then the other may be better
        if said[4] is not None:
            least = float(said[5] or 0)
            assert (least == 0) == (said[4] == "at least as good")
            assert least - 1e-9 <= 100 * low <= least + 0.1 + 1e-9
        assert (said[9] == "your answers") == (low > -NO_LOSS)
        guess = 0.0 if said[2] == "less than 0.1" else float(said[2])
        # the difference of two numbers that are rounded, as they stand in the table
        assert guess == pytest.approx(100 * d @ result.comparator.values, abs=0.101)
        both = (rows[result.name], rows[said[3]])
        worths, behind = [row[-3] for row in both], rows[said[3]][-1]
        rough = any(worth.startswith("about ") for worth in worths)
        first, other = (float(worth.removeprefix("about ")) for worth in worths)
        assert guess == pytest.approx(first - other, abs=1.01 if rough else 1e-9)
        assert rows[result.name][-1] == "-"
        assert found.changes.marked == [*rows].index(result.name)
        assert (found.changes.title, found.changes.several) == ("The 3 therapies", "therapies")
        assert behind == (f"about {guess:.0f}" if rough else f"{guess:.1f}")
        every = np.delete(shares, best, axis=0) - shares[best]
        most, note = 100 * max(simultaneous_bounds(result.comparator, every)[0]), found.changes.note
        assert ("none of the others is better." in note) == (most < 1e-3)
        if most >= 1e-3 and not found.settled:
            stated = re.search(r" may still be better, by at most (\d+)\.", note)
            assert int(stated[1]) - 1 <= most <= int(stated[1]) + 1e-9
        leads.add(found.changes.mark)
        if not (queries := choosing.ask()):
            break
        choosing.tell([tutor(query) for query in queries])
    assert leads == ({"best guess", "best"} if name == "polytope" else {"best guess"})


def test_a_lead_by_the_order_of_the_levels_alone_is_said_to_be_that() -> None:
    shares, names = np.array([[0.0, 0.5, 0.5], [0.2, 0.4, 0.4]]), ["x", "y"]
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    result = choose(shares, PolytopeComparator(3), names=names).result()
    found = choice_conclusion(told, names, shares, result, None)
    assert found.reason == (
        "On the scale from 0 (all “bad”) to 100 (all “good”), “x” is worth 15 more than the "
        "second, “y” (best guess; at least 10 more, for all values that fit your answers). In 100 "
        "days it has 10 more “good” and 10 more “middle” in "
        "place of 20 “bad”. By the order of the levels alone that is better."
    )
    alone = choose(shares[:1], PolytopeComparator(3), names=names[:1]).result()
    assert not choice_conclusion(told, names[:1], shares[:1], alone, None).reason


def test_a_settled_choice_with_wide_ranges_says_why_it_holds_all_the_same() -> None:
    shares, names = np.array([[0.0, 0.5, 0.5], [0.02, 0.4, 0.58]]), ["x", "y"]
    told = InWords(("bad", "middle", "good"), Words(), 0.01)
    row = np.array([[-0.5, 1.0, -0.5]])  # middle is worth 50 at least, so x is at most 3 behind y
    known = PolytopeComparator(3).update(Answers(row, [1]))
    result = choose(shares, known, names=names).result()
    best = names.index(result.name)
    settled = replace(result, status=Status.CALLED_EQUAL, guarantee=lambda: (0.003, 0.95))
    found = choice_conclusion(told, names, shares, settled, None)
    low, high = np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 1.0])
    d = shares[1 - best] - shares[best]
    most = max(0.0, d @ low, d @ high)
    assert most_short(shares, best, low, high) == pytest.approx(most)
    assert 0.0 < most < told.little
    assert found.sure.endswith(
        "“middle” is known only roughly. That is enough here: your answers rule out "
        "the combinations of values for which another alternative would be clearly better."
    )
    lax, bound = replace(told, tolerance=most), replace(settled, guarantee=lambda: (most, 0.95))
    lenient = choice_conclusion(lax, names, shares, bound, None)
    assert lenient.sure.endswith(
        "“middle” is known only roughly. Even so, whatever it is worth within the range below, "
        f"“{result.name}” is best, or nearly so."
    )
    strict = choice_conclusion(replace(told, tolerance=0.004), names, shares, settled, None)
    assert strict.sure.endswith(
        " That is enough here: your answers rule out the combinations of values for which another "
        "alternative would be clearly better."
    )
    narrow = known.update(Answers([[-0.5, 1.0, -0.5], [0.3, -1.0, 0.7]], [1, 1]))
    found = choice_conclusion(told, names, shares, replace(settled, comparator=narrow), None)
    assert "known only roughly" not in found.sure


def test_the_most_that_a_choice_falls_short_is_that_of_rising_values_in_the_ranges() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        k = int(rng.integers(3, 6))
        shares = rng.dirichlet(np.ones(k), 3)
        ends = np.sort(np.round(rng.random((2, k - 2)), 1), axis=1)
        low, high = ([0.0, *one, 1.0] for one in (ends.min(axis=0), ends.max(axis=0)))
        grid = np.array(np.meshgrid(*[np.arange(11) / 10] * (k - 2))).reshape(k - 2, -1).T
        values = np.hstack([np.zeros((len(grid), 1)), grid, np.ones((len(grid), 1))])
        inside = ((values > np.array(low) - 1e-9) & (values < np.array(high) + 1e-9)).all(axis=1)
        values = values[inside & (np.diff(values) > -1e-9).all(axis=1)]
        most = (values @ (shares - shares[0]).T).max()
        assert most_short(shares, 0, np.array(low), np.array(high)) == pytest.approx(most)


def test_alternatives_are_nearly_equal_only_if_that_holds_for_every_plausible_scale() -> None:
    shares = np.array([[0.1, 0.2, 0.7], [0.08, 0.24, 0.68], [0.5, 0.5, 0.0]])
    names, found = ["first", "other", "third"], set()
    told = InWords(("bad", "middle", "good"), Words("people"), 0.01)
    for low, high in ((0.0, 1.0), (0.4, 0.6), (0.1, 0.9)):
        rows = [[low - 1.0, 1.0, -low], [1.0 - high, -1.0, high]]
        known = PolytopeComparator(3).update(Answers(rows, [1, 1]))
        result = choose(shares, known, names=names).result()
        said = choice_nearly(told, names, shares, result, None)
        worst = {  # by how much another is better, at the ends of what is plausible
            name: max(max(shares @ [0, v, 1]) - shares[i] @ [0, v, 1] for v in (low, high))
            for i, name in enumerate(names)
        }
        assert said is not None
        bound = float(re.search(r"by more than ([\d.]+) in 100", said.text)[1]) / 100
        named = re.findall(r"“(\w+)”", said.heading)
        assert named
        assert all(worst[name] <= bound + 1e-9 <= 0.04 for name in named)
        assert "third" not in named
        assert said.text.count("if your answers are right") == 1
        assert f"{100 * bound:g} in 100 people were at “bad” instead of “good”" in said.size
        found.add(len(named))
    assert found == {2}
    far = np.array([[0.1, 0.2, 0.7], [0.0, 0.6, 0.4], [0.5, 0.5, 0.0]])
    result = choose(far, PolytopeComparator(3), names=names).result()
    assert choice_nearly(told, names, far, result, None) is None


def test_a_plan_is_close_only_if_the_loss_is_little_and_less_than_at_first() -> None:
    mdp, values = random_mdp(8, 3, 4, 0.9, seed=0)
    learner = InteractivePolicyIteration(
        mdp, PolytopeComparator(4), tolerance=1e-4, bags=Bags(days=10)
    )
    tutor = FlippingTutor(values, 0.0)
    for _ in range(3):
        learner.tell([tutor(query) for query in learner.ask()])
    result = learner.result()
    loss = DecidedPlans(mdp, 1e-4).of(result).guarantee.loss_bound
    assert loss > 0

    def said(tolerance: float, before: float | None) -> Any:
        told, plans = InWords(mdp.labels, Words(), tolerance), DecidedPlans(mdp, tolerance)
        return policy_nearly(told, plans, result, before)

    assert said(loss / 5, None) is None  # too much
    assert said(loss, None) is None  # the plan is settled
    assert said(loss / 2, 1.2 * loss) is None  # hardly anything was learned
    found = said(loss / 2, 2 * loss)
    stated = r"Your plan falls at most ([\d.]+) in 100 short of your ideal plan"
    assert 100 * loss <= float(re.fullmatch(stated, found.heading)[1]) <= 110 * loss
