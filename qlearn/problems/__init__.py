"""Problems to learn on: random MDPs, ICU-Sepsis, Gymnasium's known tasks.

Imports from ``mdp`` and elicit.
"""
