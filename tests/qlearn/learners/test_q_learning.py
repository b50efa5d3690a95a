"""Interactive Q-learning against the reference, the exact oracles, and its own promises."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from elicit import (
    AlwaysAsk,
    Answer,
    AnswerLog,
    Answers,
    BradleyTerryComparator,
    BradleyTerryTutor,
    Comparator,
    Dominance,
    FlippingTutor,
    PolytopeComparator,
    Query,
    TruthfulTutor,
    Tutor,
    Verdict,
)
from elicit._support.hashing import key_of
from elicit.tutors.simulated_kernel import GIVEN
from qlearn import (
    InteractiveQLearning,
    InteractiveValueIteration,
    OrdinalMDP,
    Result,
    Status,
    drive,
    policy_loss,
    random_mdp,
)
from qlearn.experiments.metrics import Watch
from qlearn.learners.exploration import Exploration
from qlearn.learners.loops import q_learning_kernel as kernel
from qlearn.learners.q_learning import polynomial_rate, rescaled_linear_rate
from qlearn.reference import interactive_q_learning
from tests.mdp_cases import messy_mdp
from tests.noisy_cases import COMPARATORS
from tests.scalar_q_learning import scalar_q_learning
from tests.scale_arithmetic import Floats
from tests.thoroughness import covering, quick_first, scaled

TUTORS: dict[str, Callable[[Floats], Tutor]] = {
    "truthful": TruthfulTutor,
    "flipping": lambda values: FlippingTutor(values, 0.15, seed=4),
}
SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "zero start, rate 1": {"start": "zero", "learning_rate": 1.0},
    "episodes, constant rate": {"episode_length": 7, "learning_rate": 0.5},
    "greedy": {"epsilon": 0.0},
    "best start, decaying": {"start": "best", "epsilon": np.linspace(0.9, 0.1, 400)},
}


def learner_of(mdp: OrdinalMDP, comparator: Comparator, **settings: Any) -> InteractiveQLearning:
    """Return a learner with the settings of the reference.

    ``settings`` may have those of exploration beside the others.
    """
    chances = settings.pop("epsilon", 0.3)
    explored = {
        name: settings.pop(name) for name in ("start", "episode_length") if name in settings
    }
    exploration = Exploration(
        (lambda steps: chances[steps]) if isinstance(chances, np.ndarray) else chances, **explored
    )
    return InteractiveQLearning(
        mdp, comparator, **{"steps": 400, "epsilon": exploration, **settings}
    )


def learn(mdp: OrdinalMDP, comparator: Comparator, tutor: Tutor, **settings: Any) -> Result:
    return drive(learner_of(mdp, comparator, **settings), tutor)


def reference(mdp: OrdinalMDP, comparator: Comparator, tutor: Tutor, **settings: Any) -> Any:
    steps, seed = settings.pop("steps", 400), settings.pop("rng", 0)
    rate = settings.pop("learning_rate", None)
    rates = (
        rescaled_linear_rate(mdp.discount)(np.arange(steps))
        if rate is None
        else np.full(steps, rate)
    )
    return interactive_q_learning(
        mdp,
        comparator,
        tutor,
        **{"steps": steps, "epsilon": 0.3, "rates": rates, "key": key_of(seed), **settings},
    )


def compared_with_the_reference(
    mdp: OrdinalMDP, values: Floats, comparator: str, tutor: str, **settings: Any
) -> Result:
    """A run, which has been found to be the reference's."""
    make = COMPARATORS[comparator]
    result = learn(mdp, make(mdp.k), TUTORS[tutor](values), **settings)
    expected, model, told = reference(mdp, make(mdp.k), TUTORS[tutor](values), **settings)
    assert result.q.tobytes() == expected.q.tobytes()
    assert result.policy.tolist() == expected.best
    assert result.asked == len(told.answers)
    assert result.compared == len(expected.comparisons)
    assert result.status is Status.DONE
    if comparator == "always ask":
        assert (
            len(result.answers) == 0
        )  # a simulated tutor's answers to the oracle are only counted
    else:
        answers = Answers.of(told.answers, mdp.k)
        assert result.answers.d.tobytes() == answers.d.tobytes()
        assert result.answers.y.tolist() == answers.y.tolist()
    assert result.comparator.values.tolist() == model.values.tolist()
    return result


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize("tutor", quick_first(["flipping", "truthful"], 1))
@pytest.mark.parametrize(
    "comparator",
    quick_first(["polytope", "always ask", "dominance", "ensemble", "box"], 2, older=1),
)
def test_agrees_with_the_reference_to_the_last_bit(
    comparator: str, tutor: str, settings: str
) -> None:
    repeated = 0
    for seed, (mdp, values) in enumerate(
        (random_mdp(8, 3, 5, rng=0), messy_mdp(1), messy_mdp(2, k=2, discount=0.0))
    ):
        result = compared_with_the_reference(
            mdp,
            values,
            comparator,
            tutor,
            rng=seed,
            steps=scaled(200, 400),
            **SETTINGS[settings],
        )
        repeated += result.decided["known"]
    if comparator == "dominance" and settings == "zero start, rate 1":
        assert repeated > 0  # else this says nothing about pairs met again


@pytest.mark.parametrize(
    ("comparator", "seed"), covering(["polytope", "ensemble"], [10, 22, 34], together=1)
)
def test_judging_ahead_does_not_outlive_the_incumbent(comparator: str, seed: int) -> None:
    # with many actions dominance may change the best one between two comparisons that were judged
    # together
    mdp, values = random_mdp(3, 8, 4, discount=0.3, rng=seed)
    compared_with_the_reference(
        mdp, values, comparator, "truthful", rng=seed, learning_rate=0.9, epsilon=0.7
    )


@pytest.mark.parametrize("seed", quick_first(range(4), 2))
def test_always_asking_the_truth_is_scalar_q_learning(seed: int) -> None:
    for mdp, values in (random_mdp(15, 4, 6, rng=seed), messy_mdp(seed, n=15, k=5)):
        watched: list[int] = []
        learner = learner_of(mdp, AlwaysAsk(mdp.k), steps=1500, rng=seed)
        learner.watch(lambda d, decisions, seen=watched: seen.extend(decisions.verdicts.tolist()))
        result, rates = (
            drive(learner, TruthfulTutor(values)),
            rescaled_linear_rate(mdp.discount)(np.arange(1500)),
        )
        scalar = scalar_q_learning(
            mdp, values, steps=1500, epsilon=0.3, rates=rates, key=key_of(seed)
        )
        assert result.policy.tolist() == scalar.best
        assert result.compared == len(scalar.comparisons)
        np.testing.assert_allclose(result.q @ mdp.normalise(values), scalar.q, atol=1e-12)
        # identical vectors are equal without asking, so they are compared but not watched
        wins = [after == challenger for _, challenger, _, after in scalar.comparisons]
        assert len(watched) == len(wins) - result.decided["equal"]
        assert watched.count(Verdict.BETTER) == sum(wins)


def test_learns_a_good_policy() -> None:
    mdp, values = random_mdp(10, 3, 5, discount=0.8, rng=3)
    result = learn(mdp, PolytopeComparator(5), TruthfulTutor(values), steps=8000, epsilon=1.0)
    assert policy_loss(mdp, result.policy, values).max() < 0.02
    np.testing.assert_allclose(result.q.sum(axis=2), 1.0, atol=1e-12)
    assert (result.q >= 0).all()


def run_to(learner: InteractiveQLearning, tutor: Tutor, step: int) -> None:
    while queries := learner.run_to(step):
        learner.tell([tutor(query) for query in queries])


def trace(
    learner: InteractiveQLearning, tutor: Tutor, steps: int
) -> dict[tuple[int, int, int], int]:
    """The successor at each (state, action, visit), seen by letting the learner go one step at a
    time.
    """
    seen, now = {}, learner.state
    for step in range(1, steps + 1):
        before, state = now.visits.copy(), int(now.cursor[kernel.STATE])
        run_to(learner, tutor, step)
        ((s, a),) = np.argwhere(now.visits != before)
        assert s == state
        seen[int(s), int(a), int(before[s, a])] = int(now.cursor[kernel.STATE])
    return seen


def test_runs_that_share_a_seed_meet_the_same_transitions() -> None:
    mdp, values = random_mdp(6, 3, 5, rng=2)
    traces = [
        trace(learner_of(mdp, COMPARATORS[name](5), rng=9), tutor(values), 300)
        for name in scaled(("polytope", "always ask"), ("polytope", "ensemble", "always ask"))
        for tutor in TUTORS.values()
    ]
    for first in traces:
        for second in traces:
            shared = first.keys() & second.keys()
            assert len(shared) > 100
            assert all(first[visit] == second[visit] for visit in shared)
    assert any(first.keys() != traces[0].keys() for first in traces)  # they did take different ways


def test_exploration_does_not_depend_on_the_comparator() -> None:
    mdp, values = random_mdp(6, 3, 5, rng=2)
    ways = [
        trace(
            learner_of(mdp, make(5), epsilon=1.0, max_queries=budget, rng=9),
            TruthfulTutor(values),
            scaled(120, 300),
        )
        for make in COMPARATORS.values()
        for budget in (None, 0)  # with none, guesses decide
    ]
    assert all(way == ways[0] for way in ways)


def test_same_seed_same_run_and_another_seed_another() -> None:
    mdp, values = random_mdp(8, 3, 5, rng=0)

    def run(rng: Any) -> bytes:
        return learn(mdp, PolytopeComparator(5), TruthfulTutor(values), rng=rng).q.tobytes()

    assert run(5) == run(5) != run(6)
    assert run(np.random.SeedSequence(5)) == run(5)
    assert run(np.random.default_rng(5)) == run(np.random.default_rng(5))


def test_learning_rates_are_functions_of_the_visit() -> None:
    mdp, values = random_mdp(8, 3, 5, discount=0.75, rng=0)
    default = learn(mdp, PolytopeComparator(5), TruthfulTutor(values))
    as_function = learn(
        mdp, PolytopeComparator(5), TruthfulTutor(values), learning_rate=rescaled_linear_rate(0.75)
    )
    assert default.q.tobytes() == as_function.q.tobytes()
    np.testing.assert_allclose(
        rescaled_linear_rate(0.75)(np.arange(3)), [1.0, 5 / 6, 5 / 7], rtol=1e-15
    )
    np.testing.assert_allclose(polynomial_rate(np.arange(3)), [1.0, 2**-0.7, 3**-0.7], rtol=1e-15)
    slower = learn(mdp, PolytopeComparator(5), TruthfulTutor(values), learning_rate=polynomial_rate)
    assert slower.q.tobytes() != default.q.tobytes()


def test_episodes_restart_from_the_initial_distribution() -> None:
    mdp, _ = random_mdp(6, 2, 4, rng=1)
    at_three = OrdinalMDP(
        mdp.successors,
        mdp.probabilities,
        mdp.levels,
        mdp.discount,
        mdp.labels,
        initial=np.arange(6) == 3,
    )
    learner = learner_of(at_three, Dominance(4), steps=50, epsilon=1.0, episode_length=1)
    run_to(learner, TruthfulTutor([0, 1, 2, 3]), 50)
    assert learner.state.visits.sum() == learner.state.visits[3].sum() == 50


@pytest.mark.parametrize(
    ("name", "erring", "settings"),
    covering(
        ["box", "ensemble", "posterior"],
        ["flipping", "eq. (6)", "calls near pairs equal"],
        [{}, {"max_queries": 15}, {"indifference": 0.02}],
    ),
    ids=str,
)
def test_a_loop_that_asks_by_itself_comes_to_the_same_as_ask_and_tell(
    name: str, erring: str, settings: dict[str, Any]
) -> None:
    mdp, values = random_mdp(8, 3, 4, rng=3)
    tutors: dict[str, Callable[[], Any]] = {
        "flipping": lambda: FlippingTutor(values, 0.1, seed=4),
        "eq. (6)": lambda: BradleyTerryTutor(values, 100.0, seed=5),
        "calls near pairs equal": lambda: TruthfulTutor(values, tie=0.01),
    }

    def run(within: bool) -> tuple[Result, Any, Any]:
        tutor = tutors[erring]()
        several = {} if name == "posterior" else {"refit_growth": 0.5}  # answers at once
        learner = learner_of(mdp, COMPARATORS[name](4, tie=0.0, **several), **settings)
        watch = Watch(values, erred=lambda: tutor.realised_error_rate > 0)
        learner.watch(watch)
        return drive(learner, tutor if within else lambda query: tutor(query)), watch.counts, tutor

    (one, seen, asked), (other, also_seen, also_asked) = run(True), run(False)
    assert one.asked == other.asked == settings.get("max_queries", one.asked) > 5
    assert one.decided == other.decided
    assert (one.q == other.q).all()
    assert (one.policy == other.policy).all()
    assert (one.answers.d == other.answers.d).all()
    assert (one.answers.y == other.answers.y).all()
    assert one.answers.ids == other.answers.ids
    assert (one.comparator.values == other.comparator.values).all()
    assert seen == also_seen
    assert asked.realised_error_rate == also_asked.realised_error_rate


def test_a_loop_asks_by_itself_only_where_that_comes_to_the_same() -> None:
    mdp, values = random_mdp(8, 3, 4, rng=3)
    called: list[Any] = []

    class Called(FlippingTutor):
        def __call__(self, query: Query) -> Answer:
            called.append(query)
            return super().__call__(query)

    box = COMPARATORS["box"](4, tie=0.0)
    assert learner_of(mdp, box)._elicitation.room == 1  # a fit at each of the first answers
    assert learner_of(mdp, box, audit=0.5)._elicitation.room == 0
    assert learner_of(mdp, box, max_queries=0)._elicitation.room == 0
    assert (
        learner_of(mdp, COMPARATORS["box"](4))._elicitation.room == 0
    )  # near pairs that were called equal count
    assert (
        learner_of(mdp, PolytopeComparator(4, tie=0.0))._elicitation.room == 0
    )  # answers may contradict each other
    result = drive(learner_of(mdp, box), Called(values, 0.1))
    assert len(called) == result.asked > 0

    class Wrapped:
        def __init__(self, tutor: Any) -> None:
            self.tutor, self.asked = tutor, 0

        def __call__(self, query: Query) -> Answer:
            self.asked += 1
            return Answer(query, self.tutor(query).verdict)

        def __getattr__(self, name: str) -> Any:
            return getattr(self.tutor, name)

    wrapped = Wrapped(FlippingTutor(values, 0.1))
    assert drive(learner_of(mdp, box), wrapped).asked == wrapped.asked > 0


def test_a_loop_asks_a_tutor_only_while_he_drives_it_and_keeps_what_he_said_when_interrupted() -> (
    None
):
    mdp, values = random_mdp(8, 3, 4, rng=3)
    box = COMPARATORS["box"](4, tie=0.0, refit_growth=0.5)

    class Interrupted(Exception):
        pass

    def interrupt(d: Any, decisions: Any) -> None:
        raise Interrupted

    def counted(query: Query) -> Answer:
        called.append(query)
        return tutor(query)

    tutor, called = FlippingTutor(values, 0.1, seed=4), []
    whole = drive(learner_of(mdp, box), FlippingTutor(values, 0.1, seed=4))
    learner = learner_of(mdp, box)
    learner.watch(interrupt)
    with pytest.raises(Interrupted):
        drive(learner, tutor)
    learner._elicitation.watch = None
    before = learner.result().asked
    assert 0 < before == tutor._tally[GIVEN]
    result = drive(learner, counted)
    assert len(called) == result.asked - before > 0
    assert result.asked == whole.asked
    assert result.decided == whole.decided
    assert (result.q == whole.q).all()
    assert result.answers.ids == whole.answers.ids


@pytest.mark.parametrize("make", [learner_of, InteractiveValueIteration])
def test_who_drives_after_a_tutor_that_was_always_asked_is_asked_himself(make: Any) -> None:
    mdp, values = random_mdp(8, 3, 4, rng=3)
    called: list[Query] = []

    class Leaves(TruthfulTutor):
        def signs(self, d: Any) -> Any:
            raise KeyboardInterrupt

    learner = make(mdp, AlwaysAsk(4))
    with pytest.raises(KeyboardInterrupt):
        drive(learner, Leaves(values))
    tutor = TruthfulTutor(values)

    def counted(query: Query) -> Answer:
        called.append(query)
        return tutor(query)

    assert drive(learner, counted).asked == len(called) > 0


def test_answers_to_a_loop_outlast_an_update_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    mdp, values = random_mdp(8, 3, 4, rng=3)
    box, update = COMPARATORS["box"](4, tie=0.0, refit_growth=0.5), BradleyTerryComparator.update
    whole = drive(learner_of(mdp, box), FlippingTutor(values, 0.1, seed=4))
    left = [3]

    def failing(comparator: BradleyTerryComparator, answers: Answers) -> BradleyTerryComparator:
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt
        return update(comparator, answers)

    monkeypatch.setattr(BradleyTerryComparator, "update", failing)
    learner, tutor = learner_of(mdp, box), FlippingTutor(values, 0.1, seed=4)
    with pytest.raises(KeyboardInterrupt):
        drive(learner, tutor)
    result = drive(learner, tutor)
    assert result.asked == whole.asked == tutor._tally[GIVEN]
    assert result.decided == whole.decided
    assert result.answers.ids == whole.answers.ids
    assert (result.q == whole.q).all()


def test_draws_never_hit_what_has_no_probability() -> None:
    cumulative = np.cumsum([0.0, 0.25, 0.0, 0.5, 0.2, 0.0])  # to .95: as if rounding had lost some
    for u, index in (
        (0.0, 1),
        (0.24, 1),
        (0.25, 3),
        (0.74, 3),
        (0.75, 4),
        (0.94, 4),
        (0.96, 4),
        (1 - 2**-53, 4),
    ):
        assert kernel.draw(cumulative, u) == index
    counts = np.bincount(
        [kernel.draw(cumulative, u) for u in np.linspace(0.0, 0.95, 950, endpoint=False)],
        minlength=6,
    )
    np.testing.assert_allclose(counts, [0, 250, 0, 500, 200, 0], atol=1)


def test_no_steps() -> None:
    mdp, _ = messy_mdp(0)
    learner = InteractiveQLearning(mdp, PolytopeComparator(mdp.k), steps=0)
    assert learner.ask() == ()
    result = learner.result()
    assert (result.status, result.rounds, result.compared) == (Status.DONE, 0, 0)
    assert mdp.admissible[np.arange(mdp.n_states), result.policy].all()


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"learning_rate": lambda visits: 1.0 / visits[1:]}, r"\(9,\)"),
        ({"learning_rate": lambda visits: -1.0 - visits}, "-1.0"),
        ({"epsilon": lambda steps: steps - 4.0}, "-4.0"),
        ({"epsilon": lambda steps: 0.1 * steps[1:]}, r"\(9,\)"),
    ],
)
def test_schedules_that_make_no_sense_are_named(wrong: dict[str, Any], text: str) -> None:
    (name,) = wrong
    with pytest.raises(ValueError, match=rf"(?s){name}.*{text}"):
        InteractiveQLearning(
            random_mdp(4, 2, 3, rng=0)[0], PolytopeComparator(3), **{"steps": 10, **wrong}
        )


def test_what_copies_of_a_learner_share_cannot_be_written_to() -> None:
    mdp, _ = random_mdp(6, 2, 3, rng=0)
    learner = InteractiveQLearning(mdp, PolytopeComparator(3), steps=50)
    shared = [array for array in learner.model if isinstance(array, np.ndarray)]
    assert copy.deepcopy(learner).model is learner.model
    assert len(shared) == 9
    assert not any(array.flags.writeable for array in shared)


def wide_margin(k: int) -> PolytopeComparator:
    """One whose margin the truth contradicts: a level is worth less than that above the last."""
    return PolytopeComparator(k, margin=0.98 / (k - 1))


@pytest.mark.parametrize(
    ("make", "audit", "tie"),
    covering([wide_margin, PolytopeComparator], [0.3, 0.0], [0.0, 0.003]),
)
def test_answers_taken_at_once_are_as_good_as_asked_and_told(
    make: Callable[[int], Comparator], audit: float, tie: float
) -> None:
    """A tutor that is called by a function, and so asked and told, gives the same run."""
    mdp, _ = random_mdp(30, 3, 5, seed=3)
    values = np.array([0.0, 1.0, 3.0, 40.0, 100.0])
    told, seen = [], []
    for wrap in (False, True):
        tutor = TruthfulTutor(values, tie)
        learner = learner_of(mdp, make(5), audit=audit, steps=2000)
        watched: list[Any] = []
        learner.watch(lambda d, decisions, to=watched: to.append((d.copy(), decisions)))
        asked: Any = (lambda query, to=tutor: to(query)) if wrap else tutor
        result = drive(learner, asked, on_conflict="drop")
        seen.append(
            [
                np.concatenate(part)
                for part in zip(*((d, *found) for d, found in watched), strict=True)
            ]
        )
        told.append(result)
    at_once, usual = told
    assert at_once.asked == usual.asked > 0
    assert at_once.answers.ids == usual.answers.ids
    assert (at_once.answers.d == usual.answers.d).all()
    assert (at_once.answers.y == usual.answers.y).all()
    assert (at_once.q == usual.q).all()
    assert (at_once.decided, at_once.status) == (usual.decided, usual.status)
    assert [audit.query.id for audit in at_once.audits] == [a.query.id for a in usual.audits]
    for one, other in zip(*seen, strict=True):
        assert (one == other).all()
    if make is wide_margin and audit:
        assert len(usual.answers) < usual.asked + usual.audited  # some were dropped


@pytest.mark.parametrize("k", [4, 8])
@pytest.mark.parametrize("more", [{}, {"max_queries": 7}, {"indifference": 0.02}])
def test_a_loop_that_learns_does_what_a_tutor_asked_one_by_one_does(k, more) -> None:
    """A log makes every question go through Python: nothing else may differ."""
    mdp, values = random_mdp(20, 4, k, seed=k)
    tutor, results = TruthfulTutor(mdp.normalise(values)), []
    for log in (None, AnswerLog()):
        learner = InteractiveQLearning(mdp, PolytopeComparator(k), steps=3000, seed=1, **more)
        results.append((drive(learner, tutor, log), learner))
    (ours, learner), (plain, asking) = results
    assert ours.asked == plain.asked > 5
    assert ours.answers.ids == plain.answers.ids
    assert (ours.answers.d == plain.answers.d).all()
    assert (ours.answers.y == plain.answers.y).all()
    assert (learner.state.q == asking.state.q).all()
    assert (ours.policy == plain.policy).all()
    assert ours.decided == plain.decided
    mine, its = learner.comparator.region, asking.comparator.region
    assert (mine.rows == its.rows).all()
    mine, its = learner.comparator._set.region, asking.comparator._set.region
    assert (mine.rows == its.rows).all()
    assert (mine.owner == its.owner).all()
    assert len(mine.rows) < ours.asked  # the loop has left redundant rows out
    for name, one in learner.comparator.rule.known._asdict().items():
        if name != "inverses":
            np.testing.assert_array_equal(
                one, getattr(asking.comparator.rule.known, name), err_msg=name
            )
