"""Play one method on one problem with one tutor, and note the losses after each answer.

A method is anything with the four functions of ``Method``. It makes up its own questions, holds its
own estimate, and says by itself when it is done.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

import elicit
from benchmarks.contest.small_mdp import Policy, SmallMDP
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP

Question = tuple[Floats, Floats]
"""Two share vectors (k,): which is better, left or right?"""


class Told(NamedTuple):
    """The law of the tutor as a method knows it: its name, and the two parameters that fit it best.

    A share ``lapse`` of the answers is random, the others follow a logistic law with ``precision``
    logits per unit of value. So 10% of flips are a lapse of 20%, with an infinite precision.
    """

    law: str
    precision: float
    lapse: float


class Method(Protocol):
    """A way to ask. ``start`` comes once, then questions and answers in turn.

    ``policy`` may be called at any time: (S,) actions, or (S, A) probabilities.
    """

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None: ...

    def question(self) -> Question | None:
        """Return the next question, or None if the method says that it is done."""

    def tell(self, verdict: int) -> None:
        """Take the answer: 1 if left is better, -1 if right is, 0 if the tutor calls them equal."""

    def policy(self) -> Policy: ...


def play(
    method: Method,
    mdp: OrdinalMDP,
    values: Floats,
    tutor: elicit.Tutor,
    told: Told,
    questions: int,
    seed: int,
) -> dict[str, Any]:
    """Let a method ask at most so many questions.

    Returns the losses at the worst state and from the start after 0, 1, ... answers, each rounded
    to 1e-9; after how many answers it said it was done, -1 for never; how many answers were wrong;
    and its CPU seconds a question, the time until the first one included. Who is done keeps its
    policy.
    """
    small = SmallMDP(mdp)
    optimum = small.shares(small.best_for(values[None])[0]) @ values
    worst, initial = [], []
    asked, done, wrong, spent = 0, -1, 0, 0.0

    def judge(policy: Policy) -> None:
        losses = small.losses(policy, values, optimum)
        worst.append(round(losses[0], 9))
        initial.append(round(losses[1], 9))

    begun = time.process_time()
    method.start(mdp, told, seed)
    policy = method.policy()
    spent += time.process_time() - begun
    judge(policy)
    while asked < questions:
        begun = time.process_time()
        question = method.question()
        spent += time.process_time() - begun
        if question is None:
            done = asked
            break
        query = elicit.Query.make(mdp.fingerprint, asked, *question)
        answer = tutor(query)
        verdict = int(answer.verdict)
        asked += 1
        gained = float((query.left - query.right) @ values)
        wrong += int(verdict * gained < -1e-12)
        begun = time.process_time()
        method.tell(verdict)
        policy = method.policy()
        spent += time.process_time() - begun
        judge(policy)
    else:
        begun = time.process_time()
        if method.question() is None:
            done = asked
        spent += time.process_time() - begun
    for curve in (worst, initial):
        curve += curve[-1:] * (questions + 1 - len(curve))
    return {
        "asked": asked,
        "done": done,
        "wrong": wrong,
        "seconds": round(spent / max(asked, 1), 6),
        "worst": worst,
        "initial": initial,
    }


def as_seed(cell: Mapping[str, Any]) -> int:
    """Return the seed of a method in a run, which is not that of the problem."""
    return int(np.random.SeedSequence([int(cell["seed"]), 33]).generate_state(1)[0])
