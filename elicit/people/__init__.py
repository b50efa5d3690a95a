"""Answers that real people gave in public experiments: loaders, and a tutor that replays them.

``lotteries`` turns a lottery over amounts into shares over levels. ``experiments`` loads tables of
choices as answer logs, a log for each person. ``repeated_answers`` replays a person who answered
the same questions many times, in any order. ``rankin`` has published weights of a medical scale.
This folder imports from ``model``, ``tutors`` and ``_support``.
"""

from elicit.people.experiments import GAMBLES, lottery_choices, repeated_gambles
from elicit.people.lotteries import knots_of, shares_over
from elicit.people.repeated_answers import NoRepeatLeft, RepeatedAnswersTutor

__all__ = [
    "GAMBLES",
    "NoRepeatLeft",
    "RepeatedAnswersTutor",
    "knots_of",
    "lottery_choices",
    "repeated_gambles",
    "shares_over",
]
