"""Small examples of what runs are made of, for the machine code that they leave behind: nothing but a moment where it
is there already, else half a minute and more. Side by side, the second finds compiled what it has in common with the
first."""

from __future__ import annotations

import numpy as np

from elicit.choose import choose
from elicit.comparator import Comparator
from elicit.polytope import PolytopeComparator
from elicit.posterior import PosteriorComparator
from elicit.tutor import FlippingTutor, TruthfulTutor
from qlearn.environments import random_mdp
from qlearn.ivi import InteractiveValueIteration
from qlearn.learner import drive
from qlearn.q_learning import InteractiveQLearning

__all__ = ["learners", "proofs"]


def proofs() -> None:
    """What a polytope makes of answers."""
    _choose(PolytopeComparator(5))


def learners() -> None:
    """The posterior's moves; then the loops of both learners, which hold all rules to judge by."""
    _choose(PosteriorComparator(5, particles=50, seed=0))
    mdp, values = random_mdp(6, 3, 5, rng=0)
    drive(InteractiveQLearning(mdp, PolytopeComparator(5), steps=1000, rng=0), FlippingTutor(values, 0.0))
    drive(InteractiveValueIteration(mdp, PolytopeComparator(5), tolerance=0.1, rng=0), TruthfulTutor(values))


def _choose(comparator: Comparator) -> None:
    rows = np.random.default_rng(0).dirichlet(np.ones(5), size=20)
    choice, tutor = choose(rows, comparator), TruthfulTutor(np.arange(5))
    while queries := choice.ask():
        choice.tell([tutor(query) for query in queries])
