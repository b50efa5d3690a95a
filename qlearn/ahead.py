"""Small examples of what runs are made of, for the machine code that they leave behind: nothing but a moment where it
is there already, else half a minute and more. Side by side, neither part waits for what the other compiles."""

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

__all__ = ["comparators", "learners"]


def learners() -> None:
    """The loops of both learners, which hold all rules to judge by."""
    mdp, values = random_mdp(6, 3, 5, rng=0)
    drive(InteractiveQLearning(mdp, PolytopeComparator(5), steps=1000, rng=0), TruthfulTutor(values))
    drive(InteractiveValueIteration(mdp, PolytopeComparator(5), tolerance=0.1, rng=0), FlippingTutor(values, 0.1))


def comparators() -> None:
    """What comparators make of answers: the posterior's moves above all."""
    rows = np.random.default_rng(0).dirichlet(np.ones(5), size=20)
    tutor = TruthfulTutor(np.arange(5))
    models: tuple[Comparator, ...] = (PosteriorComparator(5, particles=50, seed=0), PolytopeComparator(5))
    for comparator in models:
        choice = choose(rows, comparator)
        while queries := choice.ask():
            choice.tell([tutor(query) for query in queries])
