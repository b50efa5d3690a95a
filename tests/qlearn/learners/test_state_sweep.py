"""Sweeps compiled, uncompiled, by NumPy, in blocks and threads: one and the same run."""

from __future__ import annotations

import hashlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import (
    Answer,
    BradleyTerryComparator,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    TruthfulTutor,
    Verdict,
)
from elicit.comparators.baselines import Dominance
from elicit.model.comparator import Comparator
from elicit.model.scale import Floats, dot, gaps, tail_sums
from elicit.model.tutor import Tutor
from qlearn import InteractiveValueIteration, OrdinalMDP, Result, drive, random_mdp
from qlearn.learners import state_sweep as competition
from qlearn.learners.learner import Status
from qlearn.learners.state_sweep_kernel import round_up
from qlearn.mdp import backup
from qlearn.mdp.backup import model_of, q_of
from qlearn.reference import interactive_value_iteration
from tests.mdp_cases import messy_mdp

ROOT = Path(__file__).parents[3]
HIDE_NUMBA = "import sys; sys.modules['numba'] = None\n"


def solve(mdp: OrdinalMDP, comparator: Comparator, tutor: Tutor, watched: bool = False, **settings: Any) -> Result:
    learner = InteractiveValueIteration(mdp, comparator, **{"tolerance": 0.01, **settings})
    if watched:  # sweeps then go by NumPy
        learner.watch(lambda d, decisions: None)
    return drive(learner, tutor)


def answers_of(result: Result) -> tuple[Any, ...]:
    """All but who settled what: which proof comes first may depend on the order of comparisons."""
    return (
        result.policy.tolist(), result.q.tobytes(), result.status, result.asked, result.rounds, result.compared,
        result.answers.d.tobytes(), result.answers.y.tobytes(), result.cannot_tell, result.decided["tutor"],
        result.decided["indifferent"], result.decided["guess"], result.decided["known"],
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
MODELS: dict[str, Callable[[int], Any]] = {
    "polytope": PolytopeComparator,
    "polytope without margin": lambda k: PolytopeComparator(k, margin=0.0),
    "dominance": Dominance,
    "Bradley-Terry": lambda k: BradleyTerryComparator(k, n_boot=20),
    "posterior": lambda k: PosteriorComparator(k, particles=60, seed=0),
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("tutor", TUTORS)
def test_compiled_sweeps_ask_what_sweeps_by_numpy_ask(model: str, tutor: str) -> None:
    for mdp, values in (random_mdp(12, 3, 4, discount=0.8, rng=0), messy_mdp(1, discount=0.5)):
        runs = [
            solve(mdp, MODELS[model](mdp.k), TUTORS[tutor](values), watched, max_sweeps=12) for watched in (False, True)
        ]
        assert answers_of(runs[0]) == answers_of(runs[1])
        assert runs[0].asked > 0


@pytest.mark.parametrize("settings", [{"max_queries": 3}, {"batch": 5}, {"audit": 0.3}, {"indifference": 0.03}])
def test_the_same_with_other_settings(settings: dict[str, Any]) -> None:
    for seed in range(2):
        mdp, values = random_mdp(12, 3, 5, discount=0.8, rng=seed)
        runs = [
            solve(mdp, PolytopeComparator(5), TruthfulTutor(values), watched, **settings) for watched in (False, True)
        ]
        assert answers_of(runs[0]) == answers_of(runs[1])
        assert runs[0].audited == runs[1].audited
    assert runs[0].audited > 0 or "audit" not in settings
    assert (runs[0].status is Status.GUESSED) == ("max_queries" in settings)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("tutor", ["truthful", "blunt"])
def test_asks_the_questions_of_the_reference_whatever_the_comparator(model: str, tutor: str) -> None:
    """States are judged in turn, each with all that is known by then, as in the reference: but for the first look
    at a block of states, which a model may settle before a later answer would have changed its mind."""
    mdp, values = random_mdp(9, 3, 4, discount=0.8, rng=3)
    result = solve(mdp, MODELS[model](4), TUTORS[tutor](values), max_sweeps=40)
    expected, _, told = interactive_value_iteration(mdp, MODELS[model](4), TUTORS[tutor](values), tolerance=0.01)
    if model in ("Bradley-Terry", "posterior"):
        assert abs(result.asked - len(told.answers)) <= 0.5 * len(told.answers)
        return
    assert result.asked == len(told.answers)
    assert [answer.query.d.tolist() for answer in told.answers] == result.answers.d.tolist()
    assert result.policy.tolist() == expected.best
    assert result.q.tobytes() == expected.q.tobytes()


def test_the_result_does_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    mdp, values = random_mdp(300, 4, 6, discount=0.9, rng=0)
    whole = solve(mdp, PolytopeComparator(6), TruthfulTutor(values))
    monkeypatch.setattr(competition, "BLOCK", 16)
    runs = [solve(mdp, PolytopeComparator(6), TruthfulTutor(values), jobs=jobs) for jobs in (1, 2, 5)]
    assert len({repr((answers_of(run), run.decided)) for run in runs}) == 1
    assert answers_of(runs[0]) == answers_of(whole)
    assert whole.asked > 20


@pytest.mark.parametrize("jobs", [0, 1.5, -1])
def test_bad_jobs_are_named(jobs: Any) -> None:
    mdp, _ = random_mdp(4, 2, 3, rng=0)
    with pytest.raises(ValueError, match=f"jobs.*{jobs}"):
        InteractiveValueIteration(mdp, PolytopeComparator(3), jobs=jobs)


def test_q_is_the_same_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    for mdp in (messy_mdp(0)[0], messy_mdp(1, n=30, m=4)[0], random_mdp(40, 3, 5, rng=0)[0]):
        v = np.random.default_rng(0).dirichlet(np.ones(mdp.k), mdp.n_states)
        v[mdp.terminal] = np.eye(mdp.k)[mdp.final_level[mdp.terminal]]
        some = np.array([5, 0, 3, mdp.n_states - 1, 3])
        compiled = q_of(some, v, model_of(mdp))
        with monkeypatch.context() as patch:
            patch.setattr(backup, "is_compiled", lambda: False)
            assert q_of(some, v, model_of(mdp)).tobytes() == compiled.tobytes()
        expected = (mdp.transitions @ v).reshape(mdp.n_states, mdp.n_actions, mdp.k)
        expected = (1 - mdp.discount) * mdp.vector_rewards() + mdp.discount * expected
        read = mdp.admissible & ~mdp.terminal[:, None]
        np.testing.assert_allclose(compiled[read[some]], expected[some][read[some]], atol=1e-15)


def report() -> str:
    """A hash of small runs, to the last bit: who settled what included."""
    digest = hashlib.blake2b(digest_size=8)
    for mdp, values in (random_mdp(6, 3, 4, discount=0.7, rng=0), messy_mdp(1, n=6, discount=0.5)):
        for model in MODELS:
            for tutor in ("flipping", "blunt"):
                result = solve(mdp, MODELS[model](mdp.k), TUTORS[tutor](values), tolerance=0.05, max_sweeps=9)
                digest.update(repr((answers_of(result), sorted(result.decided.items()))).encode())
    return digest.hexdigest()


def test_the_loops_are_the_same_uncompiled() -> None:
    code = (
        f"{HIDE_NUMBA}sys.path.insert(0, {str(ROOT)!r})\n"
        "from qlearn.learners import state_sweep as competition\n"
        "from tests.qlearn.learners.test_state_sweep import report\n"
        "assert not competition.is_compiled(); competition.is_compiled = lambda: True; print(report())"
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == report()


def test_a_result_keeps_its_q_while_the_learner_goes_on() -> None:
    mdp, values = random_mdp(30, 3, 5, discount=0.9, rng=0)
    learner = InteractiveValueIteration(mdp, PolytopeComparator(5), tolerance=0.01)
    tutor, lazy, read = TruthfulTutor(values), [], []
    while queries := learner.ask():
        read.append(learner.result().q)
        lazy.append(learner.result())
        learner.tell([tutor(query) for query in queries])
    assert [result.q.tobytes() for result in lazy] == [q.tobytes() for q in read]
    assert read[0].tobytes() != read[-1].tobytes()
    copy = pickle.loads(pickle.dumps(learner.result()))
    assert copy.q.tobytes() == learner.result().q.tobytes()


def test_only_v_is_kept() -> None:
    mdp, _ = random_mdp(500, 8, 10, rng=0)
    learner = InteractiveValueIteration(mdp, PolytopeComparator(10))
    arrays: list[Any] = [*vars(learner).values(), *vars(learner._states).values()]
    own = [a.nbytes for a in arrays if isinstance(a, np.ndarray)]
    assert sum(own) < 500 * 10 * (8 + 8 + 8 * 4 + 16)  # V twice, floors of half size, and the rest


def test_floors_are_never_too_low() -> None:
    numbers = np.concatenate([np.random.default_rng(0).normal(size=200) * 10.0 ** np.arange(-100, 100), [0.0, -0.0]])
    into = np.empty(len(numbers), dtype=np.float32)
    with np.errstate(over="ignore"):
        round_up(numbers, into)
    assert (into.astype(np.float64) >= numbers).all()
    usual = (np.abs(numbers) > 1e-30) & (np.abs(numbers) < 1e30)
    np.testing.assert_allclose(into[usual], numbers[usual], rtol=5e-7)
