"""Learners in a session, which is killed, and picked up again, at any moment."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from elicit import (
    AnswerLog,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    Session,
    TruthfulTutor,
)
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    InteractiveValueIteration,
    drive,
    policy_loss,
    random_mdp,
)
from tests.thoroughness import on_any_processor, quick_first, scaled

ROOT = Path(__file__).parents[3]
K = scaled(5, 8)
MDP, VALUES = random_mdp(scaled(6, 15), 3, K, discount=0.9, rng=3)
LEARNERS: dict[str, Any] = {
    "q-learning": lambda known: InteractiveQLearning(
        MDP, PolytopeComparator(K), steps=150, rng=0, known=known
    ),
    "value iteration": lambda known: InteractiveValueIteration(
        MDP, PolytopeComparator(K), tolerance=0.05, audit=0.3, max_audits=8, rng=1, known=known
    ),
    "policy iteration": lambda known: InteractivePolicyIteration(
        MDP, PolytopeComparator(K), tolerance=0.001, batch=2, known=known
    ),
}


@pytest.mark.parametrize("name", LEARNERS)
def test_a_session_left_after_every_answer_ends_like_an_undisturbed_run(
    name: str, tmp_path: Path
) -> None:
    make, path, plain = LEARNERS[name], tmp_path / "log", AnswerLog()
    undisturbed = drive(make(()), FlippingTutor(VALUES, 0.15, seed=2), plain, on_conflict="drop")
    tutor = FlippingTutor(VALUES, 0.15, seed=2)
    while True:
        with Session(make, path) as session:
            if (query := session.question()) is None:
                result = session.result()
                break
            session.answer(query.id, tutor(query).verdict)
    log = AnswerLog.read(path)
    assert log.restarted == 0
    assert [(e.answer.query.id, e.answer.verdict, e.used) for e in log] == [
        (e.answer.query.id, e.answer.verdict, e.used) for e in plain
    ]
    assert [e.metadata.get("expected") for e in log] == [e.metadata.get("expected") for e in plain]
    assert len(log) > 4
    if name == "value iteration":
        assert any(not e.used for e in log)
    assert result.policy.tolist() == undisturbed.policy.tolist()
    assert result.q.tobytes() == undisturbed.q.tobytes()
    assert (result.status, result.asked, result.audited) == (
        undisturbed.status,
        undisturbed.asked,
        undisturbed.audited,
    )


@pytest.mark.parametrize("name", LEARNERS)
def test_undo_withdraw_and_another_comparator(name: str, tmp_path: Path) -> None:
    make, path, tutor = LEARNERS[name], tmp_path / "log", TruthfulTutor(VALUES)
    with Session(make, path) as session:
        for _ in range(4):
            query = session.question()
            assert query is not None
            session.answer(query.id, tutor(query).verdict)
        session.undo()
        again = session.question()
        assert again is not None
        assert again.id == query.id
        session.answer(query.id, tutor(query).verdict)
        ids = [entry.answer.query.id for entry in session.log if not entry.retracted]
        session.withdraw(ids[1])
        assert session.result().answers.ids == (ids[0], *ids[2:])

    def with_posterior(known: Any) -> Any:
        return InteractivePolicyIteration(
            MDP, PosteriorComparator(K, particles=200), tolerance=0.05, known=known
        )

    with Session(with_posterior, path) as session:
        assert session.result().answers.ids == (ids[0], *ids[2:])
    with Session(make, path) as session:
        while query := session.question():
            session.answer(query.id, tutor(query).verdict)
        result = session.result()
        assert set(ids) - {ids[1]} <= set(result.answers.ids)
        assert session.conflicts() == ()
    if name != "q-learning":
        assert policy_loss(MDP, result.policy, VALUES).max() <= 0.05


@on_any_processor
@pytest.mark.skipif(
    not hasattr(os, "fork"), reason="forks, so that each try need not import everything"
)
@pytest.mark.parametrize(
    ("kills", "seed", "size"),
    quick_first([(2, 0, "small"), (2, 0, "large"), (300, 1, "large")], 1, names=3),
)
def test_killed_at_random_moments_no_answer_is_lost_or_doubled(
    kills: int, seed: int, size: str, tmp_path: Path
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.killed_sessions", f"{tmp_path}", f"{kills}", f"{seed}", size],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert not done.returncode, done.stderr
    found = json.loads(done.stdout)
    assert found["wrong"] == []
    assert found["killed"] >= kills
    assert found["answers"] > (10 if size == "small" else 20)
    assert found["unused"] > 0  # contradictions among them
