"""Outcomes of a plan are counted exactly, in words and as numbers, where that can be said."""

import re
from typing import Any

import numpy as np
import pytest

from elicit import Bags, FlippingTutor, PolytopeComparator, Words
from qlearn import InteractivePolicyIteration, OrdinalMDP
from qlearn.cli.conclusions.decided_plan import DecidedPlans
from qlearn.cli.conclusions.in_words import InWords
from qlearn.cli.conclusions.outcomes import effects_of, end_shares, outcomes_of
from qlearn.cli.conclusions.plan import policy_conclusion
from qlearn.cli.teach_subjects import taught_again

LABELS = ("dead", "bad", "fair", "well")
ENDS = ("die", "", "", "recover")


def ward(n: int = 7, seed: int = 0) -> OrdinalMDP:
    """Return a model of n states, the last two of which are death and recovery."""
    rng = np.random.default_rng(seed)
    moves = rng.dirichlet(np.full(n, 0.4), size=(n, 3))
    levels = rng.integers(1, 3, (n, 3))
    levels[-2], levels[-1] = 0, 3
    terminal = np.arange(n) >= n - 2
    return OrdinalMDP.from_dense(moves, levels, 0.95, LABELS, terminal=terminal.tolist())


def told_of(mdp: OrdinalMDP, ends: tuple[str, ...] = ENDS) -> InWords:
    return InWords(mdp.labels, Words("patients", ends=ends), 1e-3)


def learned(mdp: OrdinalMDP, values: Any) -> Any:
    learner = InteractivePolicyIteration(mdp, PolytopeComparator(4), bags=Bags(10), tolerance=1e-3)
    tutor = FlippingTutor(values, 0.0)
    while queries := learner.ask():
        learner.tell([tutor(query) for query in queries])
    return learner.result()


@pytest.mark.parametrize("seed", range(3))
def test_shares_are_those_of_many_steps(seed: int) -> None:
    mdp = ward(seed=seed)
    policy = np.random.default_rng(seed).integers(0, 3, 7)
    chain = mdp.transitions.toarray().reshape(7, 3, 7)[np.arange(7), policy]
    chain[5:] = np.eye(7)[5:]
    after = mdp.initial @ np.linalg.matrix_power(chain, 100_000)
    found = end_shares(mdp, policy)
    assert found is not None
    np.testing.assert_allclose(found, [after[5], 0, 0, after[6]], atol=1e-9)


def test_nothing_is_said_if_a_run_may_never_end_or_an_outcome_has_no_words() -> None:
    mdp = ward()
    plans = DecidedPlans(mdp, 1e-3)
    found = plans.of(learned(mdp, np.array([0, 0.9, 0.95, 1.0])))
    assert outcomes_of(told_of(mdp), mdp, found)[1] is not None
    for ends in ((), ("", "", "", "recover"), ("die", "recover")):
        assert outcomes_of(told_of(mdp, ends), mdp, found) == ("", None)
    moves = mdp.transitions.toarray().reshape(7, 3, 7)
    moves[2] = np.eye(7)[2]  # whoever comes there stays, although it is no end
    parts = {"terminal": mdp.terminal, "initial": mdp.initial}
    stuck = OrdinalMDP.from_dense(moves, mdp.levels, 0.95, LABELS, **parts)
    assert end_shares(stuck, found.policy) is None
    assert outcomes_of(told_of(stuck), stuck, found) == ("", None)
    parts["initial"] = np.eye(7)[0]
    moves[0] = np.eye(7)[6]  # then nobody comes there
    ends = end_shares(OrdinalMDP.from_dense(moves, mdp.levels, 0.95, LABELS, **parts), found.policy)
    assert ends is not None
    assert ends.tolist() == [0, 0, 0, 1]


def test_the_result_says_how_many_end_so_beside_equal_steps() -> None:
    kinds = set()
    for seed in range(12):
        mdp = ward(seed=seed)
        for values in ([0, 0.9, 0.95, 1.0], [0, 0.02, 0.9, 1.0], [0, 0.3, 0.6, 1.0]):
            result = learned(mdp, np.array(values))
            told, plans = told_of(mdp), DecidedPlans(mdp, 1e-3)
            said = policy_conclusion(told, plans, mdp.action_name, result, None)
            found = plans.of(result)
            plan, steps = end_shares(mdp, found.policy), end_shares(mdp, found.equal)
            assert plan is not None
            assert steps is not None
            assert said.outcomes is not None
            assert said.outcomes.rows == tuple(
                (LABELS[i], round(plan[i], 6), round(steps[i], 6)) for i in (3, 0)
            )
            apart = abs(plan[3] - steps[3])
            of = 100 if apart >= 0.02 else 1000
            start = f"In the model, of {of:,} patients about "
            mine, other = (
                f"{of * s[3]:.0f} recover and {of * s[0]:.0f} die" for s in (plan, steps)
            )
            rest = said.effect.removeprefix(f"{start}{mine} under this plan.")
            assert rest != said.effect
            if (found.policy == found.equal).all():
                kind = "the same plan"
                assert rest == ""
            elif of * apart < 0.5 or mine == other:
                kind = "as many"
                assert rest.endswith(" about the same if the steps between the levels were equal.")
            else:
                kind = "fewer" if plan[3] < steps[3] else "more"
                assert rest.startswith(
                    f" If the steps between the levels were equal, it would be: {other}."
                )
                assert ("before the end" in rest) == (kind == "fewer")
            kinds.add(kind)
    assert kinds >= {"the same plan", "fewer", "more"}, kinds


def test_counts_that_differ_by_rounding_only_are_called_the_same() -> None:
    mdp = ward()
    moves = mdp.transitions.toarray().reshape(7, 3, 7)
    moves[0, 2] = 0.9996 * moves[0, 1] + 0.0004 * np.eye(7)[6]
    moves[1:, 2] = moves[1:, 1]
    mdp = OrdinalMDP.from_dense(moves, mdp.levels, 0.95, LABELS, terminal=mdp.terminal)
    found = DecidedPlans(mdp, 1e-3).of(learned(mdp, np.array([0, 0.3, 0.6, 1.0])))
    found = found._replace(policy=np.full(7, 2), equal=np.full(7, 1))
    said, table = outcomes_of(told_of(mdp), mdp, found)
    assert table is not None
    assert table.rows[0][1] != table.rows[0][2]
    assert said.startswith("In the model, of 1,000 patients about ")
    assert said.endswith(
        " The numbers would be about the same if the steps between the levels were equal."
    )


def test_icu_sepsis_names_its_outcomes() -> None:
    made = taught_again({"problem": "icu-sepsis", "comparator": "polytope"})
    said = made.subject.conclude(made.make(()).result(), 0.04)
    assert said.effect.startswith("In the model, of 1,000 patients about 873 recover and 127 die")
    assert said.outcomes is not None
    assert said.outcomes.rows[0] == ("recovered", 0.873478, 0.873478)


def test_each_changed_state_says_how_many_runs_from_there_end_best() -> None:
    """One step by either action, and then very many by the plan."""
    states = 0
    for seed in range(4):
        mdp = ward(seed=seed)
        found = DecidedPlans(mdp, 1e-3).of(learned(mdp, np.array([0, 0.9, 0.95, 1.0])))
        said = effects_of(told_of(mdp), mdp, found)
        assert [*said] == found.states.tolist()
        moves = mdp.transitions.toarray().reshape(7, 3, 7)
        chain = moves[np.arange(7), found.policy]
        chain[5:] = np.eye(7)[5:]
        well = np.linalg.matrix_power(chain, 100_000)[:, 6]
        for state, action in zip(found.states.tolist(), found.learned.tolist(), strict=True):
            with_it, without = (1000 * moves[state, a] @ well for a in (action, found.equal[state]))
            ours = f"with it {with_it:.0f} of 1,000 recover"
            assert said[state].said("recover") == f"{ours}, with equal steps {without:.0f}"
            states += 1
        assert not effects_of(told_of(mdp, ("die", "", "", "")), mdp, found)
        assert not effects_of(told_of(mdp, ()), mdp, found)
    assert states > 2


def test_where_fewer_recover_with_an_action_a_sentence_says_what_is_traded() -> None:
    seen = set()
    for seed in (2, 5):
        mdp = ward(seed=seed)
        plans = DecidedPlans(mdp, 1e-3)
        learner = InteractivePolicyIteration(
            mdp, PolytopeComparator(4), bags=Bags(10), tolerance=1e-3
        )
        tutor = FlippingTutor(np.array([0, 0.02, 0.97, 1.0]), 0.0)
        while queries := learner.ask():
            learner.tell([tutor(query) for query in queries])
            told = told_of(mdp)
            found = policy_conclusion(told, plans, mdp.action_name, learner.result(), None)
            assert found.changes is not None
            still_open = found.changes.open
            for table, told_in, action in (
                (found.changes, found.reason, "the change"),
                (still_open, "" if still_open is None else still_open.note, "the other action"),
            ):
                if table is None:
                    continue
                said = re.search(
                    rf"(Here|In all of these states|In (\d+) of these states) fewer patients would "
                    rf"recover with {action}: your answers also weigh the time ",
                    told_in,
                )
                numbers = [
                    re.findall(r"with it (\d+) of .* steps (\d+)", row[4]) for row in table.rows
                ]
                fewer = sum(int(ours) < int(theirs) for [(ours, theirs)] in numbers)
                assert (said is not None) == (fewer > 0)
                if said is not None:
                    assert int(said[2] or len(table.rows)) == fewer
                    seen.add((action, said[1][:4]))
    assert {action for action, _ in seen} == {"the change", "the other action"}
