"""This project's policy iteration, with the polytope or with the posterior, at its defaults.

Its default with the posterior asks about as great a multiple of a difference as two bags can have.
The entry "as they are" asks about the difference itself, as the default was before the contest.
"""

from __future__ import annotations

import elicit
import qlearn
from benchmarks.contest.harness import Question, Told
from benchmarks.contest.small_mdp import Policy
from elicit.asking.magnified import Shown
from qlearn.mdp.ordinal_mdp import OrdinalMDP

TOLERANCE = 0.01
"""The loss at the worst state below which it stops."""


class PolicyIteration:
    """``qlearn.solve`` step by step. Of the tutor it is told nothing: the posterior learns it."""

    def __init__(self, comparator: str, bags: Shown | None = None) -> None:
        self._name = comparator
        self._bags = bags

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        if self._name == "polytope":
            comparator: elicit.Comparator = elicit.PolytopeComparator(mdp.k)
        else:
            comparator = elicit.PosteriorComparator(mdp.k, seed=seed)
        self._learner = qlearn.InteractivePolicyIteration(
            mdp, comparator, tolerance=TOLERANCE, bags=self._bags, seed=seed
        )

    def question(self) -> Question | None:
        queries = self._learner.ask()
        if not queries:
            return None
        self._query = queries[0]
        return self._query.left, self._query.right

    def tell(self, verdict: int) -> None:
        self._learner.tell([elicit.Answer(self._query, verdict)])

    def policy(self) -> Policy:
        return self._learner.result().policy
