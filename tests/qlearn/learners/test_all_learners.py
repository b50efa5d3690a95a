"""Properties of all learners, or of Q-learning and value iteration alike."""

import re
from collections.abc import Callable, Iterator
from functools import partial
from inspect import getmro, signature
from typing import Any

import numpy as np
import pytest

from elicit import (
    AlwaysAsk,
    Answer,
    AskingOptions,
    Decisions,
    Dominance,
    FlippingTutor,
    PolytopeComparator,
    Tier,
    TruthfulTutor,
    Verdict,
    choose,
)
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    InteractiveValueIteration,
    LateQLearning,
    LateValueIteration,
    OrdinalMDP,
    Status,
    drive,
    evaluate_policy,
    policy_loss,
    random_mdp,
)
from tests.mdp_cases import messy_mdp
from tests.scale_arithmetic import Floats
from tests.thoroughness import on_any_processor, quick_first

Make = Callable[..., Any]
LEARNERS = (
    InteractivePolicyIteration,
    InteractiveValueIteration,
    LateValueIteration,
    InteractiveQLearning,
    LateQLearning,
)
NAN, INF = float("nan"), float("inf")
WRONG: dict[str, list[Any]] = {
    "audit": ["x", 1.5, NAN, INF],
    "bags": [True],
    "batch": ["x", 0, 1.5, NAN, INF],
    "epsilon": ["bold", 1.25, NAN, [0.1], ["constant"]],
    "indifference": ["x", -0.125, NAN, INF],
    "jobs": [0, 1.5, -1],
    "learning_rate": ["a", 0.0, 1.5, NAN, [0.5]],
    "max_loss": ["x", 0.0, -1.0, 1, 1.5, NAN, INF],
    "max_queries": ["x", -2, 2.5, NAN, INF],
    "max_sweeps": [0, 2.5],
    "steps": ["x", -1, 1.5],
    "strategy": ["x", NAN, INF],
    "tolerance": [0.0, -0.5, 1.0, 5, NAN, INF],
}


@pytest.fixture(
    params=[
        partial(InteractiveQLearning, steps=400, epsilon=0.3),
        partial(InteractiveValueIteration, tolerance=0.01),
    ],
    ids=["Q-learning", "value iteration"],
)
def make(request: pytest.FixtureRequest) -> Make:
    chosen: Make = request.param
    return chosen


def settings_of(learner: Make) -> set[str]:
    """The keywords that a learner takes, also those that it hands on to the one it derives from."""
    parameters = [p for kind in getmro(learner) for p in signature(kind).parameters.values()]  # type: ignore[arg-type]
    own = {parameter.name for parameter in parameters if parameter.kind is parameter.KEYWORD_ONLY}
    return own | AskingOptions.__annotations__.keys()


def wrong_settings() -> Iterator[Any]:
    for learner in LEARNERS:
        for name in WRONG.keys() & settings_of(learner):
            for value in WRONG[name]:
                yield pytest.param(learner, name, value, id=f"{learner.__name__} {name} {value!r}")


@pytest.mark.parametrize(
    ("learner", "name", "value"), sorted(wrong_settings(), key=lambda case: str(case.id))
)
def test_a_setting_that_makes_no_sense_is_refused_by_name(
    learner: Make, name: str, value: Any
) -> None:
    mdp, _ = random_mdp(6, 2, 3, rng=0)
    with pytest.raises(ValueError, match=rf"(?s){name}.* must .*{re.escape(repr(value))}"):
        learner(
            mdp,
            PolytopeComparator(3),
            **({"steps": 10} if "steps" in settings_of(learner) else {}) | {name: value},
        )


@pytest.mark.parametrize("learner", LEARNERS)
def test_learners_have_few_settings_and_check_the_levels(learner: Make) -> None:
    assert len(settings_of(learner) - AskingOptions.__annotations__.keys()) <= 7
    mdp, _ = random_mdp(4, 2, 3, rng=0)
    with pytest.raises(TypeError, match=r"has no keyword 'stpes'\. The nearest is '"):
        learner(mdp, PolytopeComparator(3), stpes=10)
    with pytest.raises(ValueError, match=r"3 levels.*k = 5"):
        learner(mdp, PolytopeComparator(5))


def test_a_question_is_about_two_admissible_actions_of_its_state(make: Make) -> None:
    mdp, values = messy_mdp(3)
    learner, tutor, number = make(mdp, Dominance(mdp.k), batch=4), TruthfulTutor(values), 0
    while queries := learner.ask():
        q = learner.result().q
        for query in queries:
            s, left, right = (
                int(word.strip(":?")) for word in query.about.split() if word.strip(":?").isdigit()
            )
            assert mdp.admissible[s, [left, right]].all()
            assert q[s, left].tolist() == query.left.tolist()
            assert q[s, right].tolist() == query.right.tolist()
            number += 1
        learner.tell([tutor(query) for query in queries])
    assert number == learner.result().asked > 0


def test_terminal_states_and_inadmissible_actions(make: Make) -> None:
    mdp, values = messy_mdp(5, n=12, discount=0.95)
    audited = make(mdp, PolytopeComparator(mdp.k), audit=0.1, max_queries=10)
    limited = drive(audited, FlippingTutor(values, 0.1, seed=5), on_conflict="drop")
    assert limited.status is not Status.WAITING
    assert limited.asked <= 10
    assert mdp.admissible[np.arange(mdp.n_states), limited.policy].all()
    result = drive(make(mdp, PolytopeComparator(mdp.k)), TruthfulTutor(values))
    assert mdp.admissible[np.arange(mdp.n_states), result.policy].all()
    for s in np.flatnonzero(mdp.terminal):
        assert (result.q[s] == np.eye(mdp.k)[mdp.final_level[s]]).all()
    live = ~mdp.terminal
    assert (result.q[~mdp.admissible & live[:, None]] == np.eye(mdp.k)[0]).all()
    if isinstance(make, partial) and make.func is InteractiveValueIteration:
        vectors = result.q[np.arange(mdp.n_states), result.policy]
        np.testing.assert_allclose(vectors, evaluate_policy(mdp, result.policy), atol=0.01)


def test_small_problems(make: Make) -> None:
    mdp, values = random_mdp(5, 1, 4, rng=0)
    one_action = drive(make(mdp, AlwaysAsk(4)), TruthfulTutor(values))
    assert (one_action.compared, one_action.asked) == (0, 0)
    assert one_action.status in (Status.DONE, Status.CONVERGED)
    one_state = OrdinalMDP(
        np.zeros((1, 3, 1)), np.ones((1, 3, 1)), [[0, 2, 1]], 0.9, ("bad", "fair", "good")
    )
    assert drive(
        make(one_state, PolytopeComparator(3)), TruthfulTutor([0, 1, 2])
    ).policy.tolist() == [1]
    # with e_1 = 0 and e_2 = 1 nothing is hidden: dominance decides all
    mdp, values = random_mdp(8, 3, 2, discount=0.9, rng=0)
    two_levels = drive(make(mdp, PolytopeComparator(2)), TruthfulTutor(values))
    assert two_levels.asked == 0
    assert two_levels.decided["equal"] + two_levels.decided["dominance"] == two_levels.compared > 0
    assert policy_loss(mdp, two_levels.policy, values).max() <= 0.1


@on_any_processor
@pytest.mark.parametrize("comparator", [PolytopeComparator, AlwaysAsk, Dominance])
@pytest.mark.parametrize(
    "settings",
    [{}, {"audit": 0.3}, {"max_queries": 4}, {"indifference": 0.01}, {"batch": 4}],
    ids=str,
)
def test_watching_sees_every_comparison_once(
    make: Make, comparator: Any, settings: dict[str, Any]
) -> None:
    mdp, values = random_mdp(10, 3, 5, discount=0.9, rng=0)
    tiers = np.zeros(len(Tier), dtype=int)

    def watcher(d: Floats, decisions: Decisions) -> None:
        assert len(d) == len(decisions.verdicts) == len(decisions.tiers) > 0
        assert not (decisions.verdicts == Verdict.UNKNOWN).any()
        np.add.at(tiers, decisions.tiers, 1)

    learner = make(mdp, comparator(5), **settings)
    learner.watch(watcher)
    result = drive(learner, TruthfulTutor(values))
    wanted = np.array(list(result.decided.values()))
    if isinstance(learner, InteractiveQLearning):
        wanted[[Tier.EQUAL, Tier.DOMINANCE]] = 0
    assert tiers.tolist() == wanted.tolist()


def test_an_interruption_while_judging_does_no_harm(make: Make) -> None:
    # Ctrl-C in the middle of a linear program: asking again must go on as if nothing had happened
    class Interrupted(Dominance):
        calls = 0

        def compare(self, d: Any) -> Any:
            type(self).calls += 1
            if type(self).calls % 4 == 0:
                raise KeyboardInterrupt
            return super().compare(d)

    mdp, values = random_mdp(6, 3, 5, discount=0.8, rng=0)
    learner, tutor = make(mdp, Interrupted(5)), TruthfulTutor(values)
    while True:
        try:
            queries = learner.ask()
        except KeyboardInterrupt:
            continue
        if not queries:
            break
        learner.tell([tutor(query) for query in queries])
    undisturbed = drive(make(mdp, Dominance(5)), tutor)
    assert learner.result().q.tobytes() == undisturbed.q.tobytes()
    assert learner.result().decided == undisturbed.decided


def test_a_person_and_the_comparator_that_always_asks(make: Make) -> None:
    # with a tutor that is only a function: questions come one by one, and no pair twice
    mdp, values = random_mdp(4, 2, 4, rng=0)
    truth = TruthfulTutor(values)
    settings = {"indifference": 0.0}

    def person(query: Any) -> Answer:
        return truth(query)

    result = drive(make(mdp, AlwaysAsk(4), **settings), person)
    assert result.asked == len(result.answers)
    assert result.q.tobytes() == drive(make(mdp, AlwaysAsk(4), **settings), truth).q.tobytes()


def asked_by(asker: Any, values: Floats, look: bool) -> list[str]:
    """The ids of all questions, answered one at a time; with ``look`` a result is read before and
    after each.
    """
    ids: list[str] = []
    tutor = TruthfulTutor(values)
    while queries := asker.ask():
        ids += [query.id for query in queries]
        for query in queries:
            if look:
                assert asker.result().loss_bound >= 0
            asker.tell([tutor(query)])
            if look:
                assert asker.result().asked <= len(ids)
    return ids


@pytest.mark.parametrize("batch", quick_first([3, 1], 1))
@pytest.mark.parametrize(
    "learner",
    [
        InteractivePolicyIteration,
        partial(InteractivePolicyIteration, exact=False),
        InteractiveValueIteration,
        LateValueIteration,
        partial(InteractiveQLearning, steps=400, epsilon=0.3),
        partial(LateQLearning, steps=2000),
    ],
    ids=[
        "policy iteration",
        "on large models",
        "value iteration",
        "asking late",
        "Q-learning",
        "Q-learning late",
    ],
)
def test_a_result_changes_no_later_question(learner: Make, batch: int) -> None:
    mdp, values = random_mdp(12, 3, 5, discount=0.9, rng=1)
    runs = [
        asked_by(learner(mdp, PolytopeComparator(5), batch=batch, max_queries=12), values, look)
        for look in (False, True)
    ]
    assert len(runs[0]) > 2
    assert runs[0] == runs[1]


def test_a_result_changes_no_later_question_about_a_sample_of_states() -> None:
    mdp, values = random_mdp(1500, 2, 7, discount=0.9, rng=0)
    runs = [
        asked_by(
            InteractivePolicyIteration(
                mdp, PolytopeComparator(7), tolerance=0.05, exact=False, batch=4
            ),
            values,
            look,
        )
        for look in (False, True)
    ]
    assert len(runs[0]) > 4
    assert runs[0] == runs[1]


@pytest.mark.parametrize("order", [False, True])
def test_a_result_of_a_choice_changes_no_later_question(order: bool) -> None:
    vectors, values = (
        np.random.default_rng(0).dirichlet(np.ones(5), 9 if order else 60),
        np.array([0.0, 0.1, 0.5, 0.6, 1.0]),
    )
    runs = [
        asked_by(choose(vectors, PolytopeComparator(5), order=order), values, look)
        for look in (False, True)
    ]
    assert len(runs[0]) > 2
    assert runs[0] == runs[1]
