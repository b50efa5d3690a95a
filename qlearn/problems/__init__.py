"""Problems to learn on: random MDPs, ICU-Sepsis, Gymnasium's known tasks, families of problems.

This folder imports from ``mdp`` and elicit.
"""

from qlearn.problems.families.catalogue import FAMILIES

__all__ = ["FAMILIES"]
