"""Solvers that stop when they need the tutor, and what a policy can still lose. Imports from
``mdp`` and elicit.
"""
