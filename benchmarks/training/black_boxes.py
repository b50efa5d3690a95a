"""Trainers that show nothing of themselves, random MDPs solved exactly or badly on purpose, and
runs with them.
"""

from collections.abc import Callable

import numpy as np

from elicit import Comparator, Tutor
from elicit.model.scale import Floats, normalise
from qlearn import InteractiveTraining, OrdinalMDP, TrainingResult, evaluate_policy, value_iteration
from qlearn.mdp.planning import Actions, optimal_policy

Trainer = Callable[[Floats], Actions]


def exact(mdp: OrdinalMDP) -> Trainer:
    """Trains to the optimum."""
    start = np.argmax(mdp.admissible, axis=1)
    return lambda values: optimal_policy(mdp, values, start)


def poor(mdp: OrdinalMDP, seed: int, share: float = 0.5) -> Trainer:
    """Trains to the optimum and forgets it in a share of the states, differently each time."""
    best, rng = exact(mdp), np.random.default_rng(seed)

    def train(values: Floats) -> Actions:
        forgets = rng.random(mdp.n_states) < share
        return np.where(forgets, rng.integers(mdp.n_actions, size=mdp.n_states), best(values))

    return train


def shares_of(mdp: OrdinalMDP, policy: Actions) -> Floats:
    """The share vector from where episodes start."""
    return np.asarray(mdp.initial @ evaluate_policy(mdp, policy))


def run(
    training: InteractiveTraining, mdp: OrdinalMDP, train: Trainer, tutor: Tutor
) -> TrainingResult:
    """Train and ask until it has finished."""
    while not training.finished:
        values = training.to_train()
        if values is not None:
            policy = train(values)
            training.add(policy, shares_of(mdp, policy))
        while queries := training.ask():
            training.tell([tutor(query) for query in queries])
    return training.result()


def loss_of(mdp: OrdinalMDP, result: TrainingResult, values: Floats) -> float:
    """Return the loss of a result's policy at the initial states, a share of the value range."""
    best = float(mdp.initial @ value_iteration(mdp, values)[0])
    return best - float(shares_of(mdp, result.policy) @ normalise(values))


def training_of(comparator: Comparator, mdp: OrdinalMDP, **settings: object) -> InteractiveTraining:
    """Return a training with the MDP's discount."""
    return InteractiveTraining(comparator, discount=mdp.discount, **settings)  # type: ignore[arg-type]
