"""Sweeps compiled and not, with and without Python, in blocks and threads: one and the same run."""

from __future__ import annotations

import hashlib
import tracemalloc
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
import pytest

import elicit
from elicit import (
    AlwaysAsk,
    Answer,
    Answers,
    Comparator,
    Decisions,
    FlippingTutor,
    PolytopeComparator,
    Query,
    Tier,
    TruthfulTutor,
    Tutor,
    Verdict,
    decide,
    simultaneous_bounds,
)
from elicit.decision.comparator_rule import weighted
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
from qlearn.learners import state_sweep
from qlearn.learners.loops import action_pair_kernel
from qlearn.learners.loops.action_pair_kernel import round_up
from qlearn.reference import interactive_value_iteration
from tests.interpreter import report_of
from tests.mdp_cases import messy_mdp
from tests.noisy_cases import COMPARATORS
from tests.scale_arithmetic import Floats, dot, gaps, tail_sums
from tests.thoroughness import covering, on_any_processor, quick_first, scaled


class ByPython:
    """A comparator without its rule: each pair that order does not settle goes through Python."""

    def __init__(self, inner: Comparator) -> None:
        self.inner, self.k, self.values, self.bounds = inner, inner.k, inner.values, inner.bounds
        if elicit.parts.offers(inner, "simultaneous_bounds"):
            self.simultaneous_bounds = lambda d: simultaneous_bounds(inner, d)

    def compare(self, d: Any) -> Any:
        return self.inner.compare(d)

    def decide(self, d: Any) -> Decisions:
        return decide(self.inner, d)

    def update(self, answers: Answers) -> ByPython:
        return ByPython(self.inner.update(answers))


def solve(
    mdp: OrdinalMDP, comparator: Comparator, tutor: Tutor, watched: bool = False, **settings: Any
) -> Result:
    learner = InteractiveValueIteration(mdp, comparator, **{"tolerance": 0.01, **settings})
    if watched:
        learner.watch(lambda d, decisions: None)
    return drive(learner, tutor)


def answers_of(result: Result) -> tuple[Any, ...]:
    """All but which proof settled what: it may depend on the order of comparisons."""
    return (
        result.policy.tolist(), result.q.tobytes(), result.status, result.asked, result.rounds,
        result.compared,
        result.answers.d.tobytes(), result.answers.y.tobytes(), result.cannot_tell, result.audited,
        *(result.decided[tier] for tier in ("tutor", "indifferent", "guess", "known", "equal")),
    )  # fmt: skip


def blunt(values: Floats, width: float, silent: float = 0.0) -> Callable[[Query], Answer]:
    """A tutor to whom near pairs are equal, and who cannot tell the nearest."""
    g = gaps(values)

    def answer(query: Query) -> Answer:
        at = float(dot(tail_sums(query.d), g))
        if abs(at) < silent:
            return Answer(query, None)
        return Answer(query, Verdict(int(np.sign(at)) if abs(at) > width else 0))

    return answer


TUTORS: dict[str, Callable[[Floats], Any]] = {
    "truthful": TruthfulTutor,
    "flipping": lambda values: FlippingTutor(values, 0.1, seed=1),
    "blunt": lambda values: blunt(values, 0.01),
    "blunt and silent": lambda values: blunt(values, 0.01, 0.003),
}
MODELS = ("polytope", "polytope, margin 0", "dominance", "ensemble", "posterior")
SETTINGS: list[dict[str, Any]] = [
    {"max_queries": 3},
    {"batch": 5},
    {"audit": 0.3},
    {"indifference": 0.03},
]


@pytest.mark.parametrize(
    ("model", "tutor"),
    [
        pytest.param(
            *each,
            marks=[] if "polytope" in each or "blunt and silent" in each else pytest.mark.slow,
        )
        for each in product(MODELS, TUTORS)
    ],
)
def test_python_is_asked_only_for_what_it_alone_can_tell(model: str, tutor: str) -> None:
    for mdp, values in (
        random_mdp(12, 3, 4, discount=0.8, rng=0),
        messy_mdp(1, n=12, discount=0.5),
    ):
        runs = [
            solve(
                mdp, make(COMPARATORS[model](mdp.k, tie=0.0)), TUTORS[tutor](values), max_sweeps=12
            )
            for make in (lambda known: known, ByPython)
        ]
        assert answers_of(runs[0]) == answers_of(runs[1])
        assert runs[0].asked > 0


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_neither_python_nor_a_watcher_changes_what_settings_do(
    settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        action_pair_kernel, "_KEPT_AT_ONCE", 5
    )  # the watcher is called in the midst of a sweep
    for seed in range(scaled(1, 2)):
        mdp, values = random_mdp(12, 3, 5, discount=0.8, rng=seed)
        plain = solve(mdp, PolytopeComparator(5), TruthfulTutor(values), **settings)
        watched = solve(mdp, PolytopeComparator(5), TruthfulTutor(values), watched=True, **settings)
        by_python = solve(mdp, ByPython(PolytopeComparator(5)), TruthfulTutor(values), **settings)
        assert answers_of(plain) == answers_of(watched) == answers_of(by_python)
        assert plain.decided == watched.decided
    assert plain.audited > 0 or "audit" not in settings
    assert (plain.status is Status.GUESSED) == ("max_queries" in settings)


@pytest.mark.parametrize(("model", "tutor"), covering(MODELS, ["truthful", "blunt"], together=1))
def test_asks_the_questions_of_the_reference_whatever_the_comparator(
    model: str, tutor: str
) -> None:
    """States are judged in turn, each with all that is known by then, as in the reference: but for
    the first look at a block of states, which a model may settle before a later answer would have
    changed its mind."""
    mdp, values = random_mdp(9, 3, 4, discount=0.8, rng=3)
    result = solve(
        mdp,
        COMPARATORS[model](4, tie=0.0),
        TUTORS[tutor](values),
        max_sweeps=40,
        partial_sweeps=False,
    )
    expected, _, told = interactive_value_iteration(
        mdp, COMPARATORS[model](4, tie=0.0), TUTORS[tutor](values), tolerance=0.01
    )
    if model in ("ensemble", "posterior"):
        assert abs(result.asked - len(told.answers)) <= 0.5 * len(told.answers)
        for policy in (result.policy, expected.best):
            assert policy_loss(mdp, policy, values).max() <= 0.03
        return
    assert result.asked == len(told.answers)
    assert [answer.query.d.tolist() for answer in told.answers] == result.answers.d.tolist()
    assert result.policy.tolist() == expected.best


def test_the_result_does_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    mdp, values = random_mdp(300, 4, 6, discount=0.9, rng=0)
    whole = solve(mdp, PolytopeComparator(6), TruthfulTutor(values))
    monkeypatch.setattr(state_sweep, "BLOCK", 16)
    runs = [
        solve(mdp, PolytopeComparator(6), TruthfulTutor(values), watched, jobs=jobs)
        for watched, jobs in ((False, 1), (False, 2), (False, 5), (True, 2))
    ]
    assert len({repr((answers_of(run), run.decided)) for run in runs}) == 1
    assert answers_of(runs[0]) == answers_of(whole)
    assert whole.asked > 20


@pytest.mark.parametrize("oracle", [False, True])
def test_a_watcher_or_an_oracle_takes_states_in_turn_whatever_the_threads(
    oracle: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(state_sweep, "BLOCK", 8)
    monkeypatch.setattr(action_pair_kernel, "_KEPT_AT_ONCE", 5)  # so that blocks are broken off
    mdp, values = random_mdp(40, 3, 4, discount=0.8, rng=0)
    comparator = AlwaysAsk(4) if oracle else PolytopeComparator(4)
    runs = []
    for jobs in (1, 3):
        seen: list[Any] = []
        tutor = FlippingTutor(values, 0.2, seed=1)
        learner = InteractiveValueIteration(
            mdp, comparator, tolerance=0.01, max_sweeps=4, jobs=jobs
        )
        if oracle:
            learner.consult(tutor.signs)
        else:
            learner.watch(lambda d, _, seen=seen: seen.extend(d.tolist()))
        result = drive(learner, tutor)
        runs.append((answers_of(result), seen))
        assert result.asked > 5
        assert len(seen) == (0 if oracle else result.compared)
    assert runs[0] == runs[1]


@pytest.mark.parametrize("make", [TruthfulTutor, lambda values: FlippingTutor(values, 0.2, seed=3)])
def test_an_oracle_answers_the_same_in_the_loop_and_outside(make: Callable[[Floats], Any]) -> None:
    mdp, values = random_mdp(40, 4, 5, discount=0.7, rng=2)
    runs = []
    for in_the_loop in (True, False):
        tutor = make(values)
        learner = InteractiveValueIteration(
            mdp, AlwaysAsk(5), tolerance=0.001, max_sweeps=6, partial_sweeps=False
        )
        seen = np.zeros(len(Tier), dtype=int)
        learner.watch(lambda d, decisions, count=seen: np.add.at(count, decisions.tiers, 1))
        learner.consult(tutor.signs if in_the_loop else lambda d, tutor=tutor: tutor.signs(d))
        assert learner.ask() == ()
        runs.append((answers_of(learner.result()), seen.tolist(), tutor.realised_error_rate))
    if (
        make is TruthfulTutor
    ):  # one who errs, errs elsewhere where equal pairs are met in another order
        assert runs[0] == runs[1]
    assert runs[0][1][Tier.TUTOR] == runs[0][0][3] > 500


class Swayed:
    """Three scales, whose votes must agree; after an answer all three are others."""

    k = 3

    def __init__(self, sides: tuple[float, ...] = (0.95, 0.9, 0.5)) -> None:
        self._gaps = np.array([sides, 1.0 - np.array(sides)])

    @property
    def values(self) -> Floats:
        return np.array([0.0, self._gaps[0].mean(), 1.0])

    @property
    def rule(self) -> Any:
        return weighted(self._gaps, np.full(3, 1 / 3), 0.9)

    def bounds(self, d: Any) -> tuple[Floats, Floats]:
        at = tail_sums(np.atleast_2d(d)) @ self._gaps
        return at.min(axis=1), at.max(axis=1)

    def compare(self, d: Any) -> Any:
        low, high = self.bounds(d)
        equal = (tail_sums(np.atleast_2d(d)) == 0).all(axis=1)
        return np.where(
            equal, 0, np.where(low > 0, 1, np.where(high < 0, -1, Verdict.UNKNOWN))
        ).astype(np.int8)

    def update(self, answers: Answers) -> Swayed:
        return Swayed((0.1, 0.1, 0.1))


@pytest.mark.parametrize("learner", [InteractiveValueIteration, InteractiveQLearning])
def test_what_an_earlier_verdict_certified_is_forgotten_with_the_answers_it_rested_on(
    learner: Any,
) -> None:
    changed = 0
    for seed in range(scaled(3, 6)):
        mdp, values = random_mdp(10, 3, 3, discount=0.9, rng=seed)
        settings = (
            {"max_sweeps": 30}
            if learner is InteractiveValueIteration
            else {"steps": 600, "rng": seed}
        )
        runs = [
            drive(learner(mdp, make(Swayed()), **settings), TruthfulTutor(values))
            for make in (lambda s: s, ByPython)
        ]
        assert runs[0].policy.tolist() == runs[1].policy.tolist()
        assert runs[0].q.tobytes() == runs[1].q.tobytes()
        changed += runs[0].asked > 0
    assert changed >= scaled(2, 3)


def short_report() -> list[str]:
    """Return the first part of the report, with one tutor."""
    return report(1, ["blunt"])


def report(mdps: int = 2, tutors: Sequence[str] = ("flipping", "blunt")) -> list[str]:
    """A hash of small runs, to the last bit: who settled what included."""
    digest = hashlib.blake2b(digest_size=8)
    small = messy_mdp(1, n=6, discount=0.5), random_mdp(6, 3, 4, discount=0.7, rng=0)
    for mdp, values in small[:mdps]:
        for model in MODELS:
            for tutor in tutors:
                result = solve(
                    mdp,
                    COMPARATORS[model](mdp.k, tie=0.0),
                    TUTORS[tutor](values),
                    tolerance=0.05,
                    max_sweeps=9,
                )
                digest.update(repr((answers_of(result), sorted(result.decided.items()))).encode())
        oracle = solve(
            mdp, AlwaysAsk(mdp.k), FlippingTutor(values, 0.1, seed=1), watched=True, max_sweeps=5
        )
        digest.update(repr((answers_of(oracle), sorted(oracle.decided.items()))).encode())
    return [digest.hexdigest()]


@on_any_processor
@pytest.mark.parametrize("name", quick_first(["short_report", "report"], 1))
def test_the_loops_are_the_same_uncompiled(name: str) -> None:
    assert report_of(__name__, name) == globals()[name]()


def test_only_v_is_kept() -> None:
    mdp, comparator = random_mdp(4000, 8, 10, rng=0)[0], PolytopeComparator(10)
    InteractiveValueIteration(mdp, comparator)  # makes what an MDP keeps of itself
    tracemalloc.start()
    learner = InteractiveValueIteration(mdp, comparator)
    used = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert learner.result().policy.shape == (4000,)
    assert used < 4000 * 10 * (
        8 + 8 + 8 * 4 + 16
    )  # V twice, certificates of half size, and the rest


def test_certificates_are_never_rounded_down() -> None:
    numbers = np.concatenate(
        [np.random.default_rng(0).normal(size=200) * 10.0 ** np.arange(-100, 100), [0.0, -0.0]]
    )
    into = np.empty(len(numbers), dtype=np.float32)
    with np.errstate(over="ignore"):
        round_up(numbers, into)
    assert (into.astype(np.float64) >= numbers).all()
    usual = (np.abs(numbers) > 1e-30) & (np.abs(numbers) < 1e30)
    np.testing.assert_allclose(into[usual], numbers[usual], rtol=5e-7)
