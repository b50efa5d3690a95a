"""Learners: solvers of an MDP that stop when they need the tutor, and resume with the answer.

This folder imports from ``mdp`` and elicit.
"""
