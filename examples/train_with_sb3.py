"""Trains Stable-Baselines3's DQN on a mountain car whose outcomes are only ordered; you are asked.

    python examples/train_with_sb3.py              # answer l, r, = or nothing for "cannot tell"
    python examples/train_with_sb3.py --simulated  # a simulated tutor answers

It needs the extra: pip install 'elicit-qlearn[sb3]'.

What is better, a car that rests in the valley for ever, or one that wears itself out and is at the
top sooner? The levels say only that racing about is worst, then going gently, then resting, then
being at the top.
"""

import sys

import gymnasium as gym
from stable_baselines3 import DQN

import elicit
import qlearn

LABELS = ("racing", "going gently", "resting", "at the top")
DISCOUNT = 0.98


def level(observation, reward, info):
    """0 to 3 by where the car is and how fast."""
    position, speed = observation
    return 3 if position >= 0.5 else 0 if abs(speed) > 0.03 else 1 if abs(speed) > 0.005 else 2


def you(query):
    """The tutor is whoever sits before the screen."""
    print(query)
    said = input("left, right, = or nothing? ").strip().lower()
    return elicit.Answer(query, {"l": 1, "r": -1, "=": 0}.get(said[:1]))


def main(tutor, steps=60_000, episodes=50, tolerance=0.02, max_trainings=8):
    """Train and ask until nothing is left that would matter; the best model, and what is known of
    it.
    """
    comparator, car = elicit.PolytopeComparator(4), gym.make("MountainCar-v0")
    env = qlearn.OrdinalReward(car, comparator, level, after=3, discount=DISCOUNT)
    training = qlearn.InteractiveTraining(
        comparator,
        discount=DISCOUNT,
        tolerance=tolerance,
        labels=LABELS,
        max_trainings=max_trainings,
    )
    while not training.finished:
        if (values := training.to_train()) is not None:
            env.values = values
            model = DQN("MlpPolicy", env, gamma=DISCOUNT, learning_starts=200, seed=0).learn(steps)
            training.add(model, qlearn.rollout_shares(env, model, episodes=episodes))
        qlearn.drive(training, tutor)
    return training.result()


if __name__ == "__main__":
    result = main(elicit.TruthfulTutor([0, 2, 3, 10]) if "--simulated" in sys.argv else you)
    print(result.status.value)
    print(
        f"asked {result.asked}, trained {result.trained}; shares:",
        dict(zip(LABELS, result.shares.round(3).tolist(), strict=True)),
    )
