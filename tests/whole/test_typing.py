"""What a type checker says of a user's program: what may be given is more than what is stored."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import elicit, qlearn
from elicit import Answer, Query, Tutor, Verdict

def ask(q: Query) -> Answer:
    return Answer(q, Verdict.BETTER)

tutor: Tutor = ask
mdp = qlearn.OrdinalMDP(
    [[[0], [0]]], [[[1.0], [1.0]]], [[0, 1]], 0.5, ["bad", "good"], initial=[1.0], action_names=["go", "stay"]
)
learner = qlearn.InteractivePolicyIteration(mdp, elicit.PolytopeComparator(2), strategy="max_regret", seed=None)
result = qlearn.drive(learner, ask)
training = qlearn.InteractiveTraining(elicit.PolytopeComparator(2), discount=0.5, optimality_gap=0.0)
training.add("a policy", [0.5, 0.5])
bound: float = qlearn.drive(training, ask).loss_bound
loss: float = qlearn.policy_loss(mdp, [1], [0, 1]).max()
query = Query("q", [1, 0], [0, 1], labels=["bad", "good"])
answers = elicit.Answers([[1, -1]], [1])
name: str = answers[0].y.name
some: elicit.Answers = answers[:1]
entry = elicit.AnswerLog(k=2)[0].answer
pairs = qlearn.OrdinalMDP.from_pairs([0], [[1.0]], [0], [0], 0.5, ["bad", "good"], state_names=["here"])
"""


def checked(program: str, folder: Path) -> list[str]:
    """What mypy says, strictly, of a program; [] where nothing."""
    pytest.importorskip("mypy")
    (folder / "program.py").write_text(program)
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", str(folder / "program.py")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240)
    assert not done.stderr, done.stderr
    return done.stdout.splitlines()


def test_plain_functions_lists_and_names_are_taken(tmp_path):
    assert checked(PROGRAM, tmp_path) == []
    wrong = "def ask(q: str) -> Answer:\n    raise LookupError\n\nother: Tutor = ask\n"
    said = checked("from elicit import Answer, Tutor\n" + wrong, tmp_path)
    assert "Incompatible types in assignment" in said[0]
