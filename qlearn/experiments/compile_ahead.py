"""Tiny runs that fill numba's cache before workers start.

Each run takes a moment if the machine code is there already, and otherwise a quarter or half a
minute. They are quicker side by side than one after another, although processes that begin together
compile some functions twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from elicit._support import jit
from elicit.asking.answered_pairs import AnsweredPairs
from elicit.asking.choose_from_list import choose
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator
from elicit.model.difference import tail_sums
from elicit.model.query import Answers, Verdict
from elicit.model.scale import Floats
from elicit.tutors.simulated import FlippingTutor, TruthfulTutor
from qlearn.experiments.catalogue import COMPARATORS, LEARNERS
from qlearn.experiments.parallel import Cell
from qlearn.learners.driving import drive
from qlearn.learners.policy_iteration import InteractivePolicyIteration
from qlearn.learners.q_learning import InteractiveQLearning
from qlearn.learners.value_iteration import InteractiveValueIteration
from qlearn.mdp.warm_planning import run_compiled
from qlearn.problems.random_mdp import random_mdp


def parts(cells: Iterable[Cell]) -> tuple[Callable[[], None], ...]:
    """Return the tiny runs that compile all that these cells need."""
    named = {name for cell in cells for name in (cell["comparator"], cell["learner"])}
    needed = {entry.compiles for entry in COMPARATORS.values() if entry.name in named}
    needed |= {entry.compiles for entry in LEARNERS.values() if entry.name in named}
    return tuple(part for part in ALL if part.__name__ in needed)


@jit.compiling()
def proofs() -> None:
    """Compile the polytope's proofs: let a polytope learn answers."""
    _choose(PolytopeComparator(5))


@jit.compiling()
def moves() -> None:
    """Compile the posterior's moves: it learns answers of one and two people, and with a prior.

    What it shares with ``proofs`` comes last, so that processes that begin together seldom compile
    the same.
    """
    rows = np.diff(_rows(21), axis=0)
    answers = Answers(rows, [1, -1] * 10, who=["ann", "ann", "ben", "ben"] * 5)
    PosteriorComparator(5, particles=50, seed=0, prior=["e3 >= 0.2"]).update(answers)
    PosteriorComparator(5, particles=50, seed=0, raters=True).update(answers)
    _choose(PosteriorComparator(5, particles=50, seed=0))


@jit.compiling()
def loops() -> None:
    """Compile Q-learning's loop, by a run.

    The loop contains all rules by which it decides. The tutor remembers the pairs that it was asked
    about.
    """
    mdp, values = random_mdp(6, 3, 5, seed=0)
    drive(
        InteractiveQLearning(mdp, PolytopeComparator(5), steps=1000, seed=0), TruthfulTutor(values)
    )
    FlippingTutor(values, 0.1).signs(np.diff(_rows(1000), axis=0))


@jit.compiling()
def sweeps() -> None:
    """Compile value iteration's sweep and the parts of its result, by a run."""
    mdp, values = random_mdp(6, 3, 5, seed=0)
    drive(
        InteractiveValueIteration(mdp, PolytopeComparator(5), tolerance=0.1), TruthfulTutor(values)
    )


@jit.compiling()
def certificates() -> None:
    """Compile the loss bound of policy iteration, and the lookup of answered pairs."""
    mdp, values = random_mdp(6, 3, 5, seed=0)
    drive(InteractivePolicyIteration(mdp, PolytopeComparator(5)), TruthfulTutor(values))
    run_compiled(mdp)
    answered, d = AnsweredPairs(5), np.diff(_rows(3), axis=0)
    answered.add(d[0], Verdict.BETTER, binding=False)
    answered.said(tail_sums(d))


ALL = (proofs, moves, loops, sweeps, certificates)
"""The tiny runs for all that users meet. With a process for each core, this order compiles them
soonest."""


def _choose(comparator: Comparator) -> None:
    choice, tutor = choose(_rows(20), comparator), TruthfulTutor(np.arange(5))
    while queries := choice.ask():
        choice.tell([tutor(query) for query in queries])


def _rows(n: int) -> Floats:
    return np.random.default_rng(0).dirichlet(np.ones(5), size=n)
