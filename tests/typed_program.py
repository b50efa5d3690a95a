"""A user's program for a type checker: constructors accept more types than they store.

``make lint`` checks it, and that its last line is wrong."""

import elicit
import qlearn
from elicit import Answer, Query, Tutor, Verdict


def ask(q: Query) -> Answer:
    return Answer(q, Verdict.BETTER)


tutor: Tutor = ask
mdp = qlearn.OrdinalMDP(
    [[[0], [0]]],
    [[[1.0], [1.0]]],
    [[0, 1]],
    0.5,
    ["bad", "good"],
    initial=[1.0],
    action_names=["go", "stay"],
)
learner = qlearn.InteractivePolicyIteration(
    mdp, elicit.PolytopeComparator(2), strategy="max_regret", seed=None
)
result = qlearn.drive(learner, ask)
result = qlearn.solve(
    mdp, lambda q: 1 if q.left[1] > q.right[1] else Verdict.WORSE, "polytope", seed=None
)
training = qlearn.InteractiveTraining(
    elicit.PolytopeComparator(2), discount=0.5, optimality_gap=0.0
)
training.add("a policy", [0.5, 0.5])
bound: float = qlearn.drive(training, ask).loss_bound
loss: float = qlearn.policy_loss(mdp, [1], [0, 1]).max()
query = Query("q", [1, 0], [0, 1], labels=["bad", "good"])
answers = elicit.Answers([[1, -1]], [1])
name: str = answers[0].y.name
some: elicit.Answers = answers[:1]
entry = elicit.AnswerLog(k=2)[0].answer
pairs = qlearn.OrdinalMDP.from_pairs(
    [0], [[1.0]], [0], [0], 0.5, ["bad", "good"], state_names=["here"]
)


def wrong(q: str) -> Answer:
    raise LookupError


other: Tutor = wrong  # type: ignore[assignment]
