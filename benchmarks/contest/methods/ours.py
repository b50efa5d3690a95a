"""This project's policy iteration, with the polytope or with the posterior, at its defaults.

``Magnified`` is what the contest teaches it: to ask about as great a multiple of a difference as
two bags can have.
"""

from __future__ import annotations

import numpy as np

import elicit
import qlearn
from benchmarks.contest.harness import Question, Told
from benchmarks.contest.small_mdp import Policy
from elicit.asking.elicitation import Pair
from elicit.model.comparator import Tier
from qlearn.certificates.advantages import Advantages
from qlearn.mdp.ordinal_mdp import OrdinalMDP

TOLERANCE = 0.01
"""The loss at the worst state below which it stops."""


class Magnified(qlearn.InteractivePolicyIteration):
    """Asks about a power of two times each difference: the greatest that two bags can have.

    The common part of the two bags shrinks instead. All that a verdict says is the same, but a
    tutor whose errors depend on how much is at stake errs less. The published methods all ask so:
    whole policies, trajectories or gambles.
    """

    def _pair(self, over: Advantages, row: int, tier: int = Tier.TUTOR) -> Pair:
        pair = super()._pair(over, row, tier)
        common = np.minimum(pair.left, pair.right)
        apart = 1.0 - float(common.sum())
        times = 2.0 ** np.floor(np.log2(1.0 / apart))
        shrunk = common * ((1.0 - times * apart) / max(float(common.sum()), 1e-300))
        left, right = (times * (side - common) + shrunk for side in (pair.left, pair.right))
        return pair._replace(left=left, right=right)


class PolicyIteration:
    """``qlearn.solve`` step by step. Of the tutor it is told nothing: the posterior learns it."""

    def __init__(self, comparator: str, magnified: bool = False) -> None:
        self._name = comparator
        self._kind = Magnified if magnified else qlearn.InteractivePolicyIteration

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        if self._name == "polytope":
            comparator: elicit.Comparator = elicit.PolytopeComparator(mdp.k)
        else:
            comparator = elicit.PosteriorComparator(mdp.k, seed=seed)
        self._learner = self._kind(mdp, comparator, tolerance=TOLERANCE, seed=seed)

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
