"""Families of problems in which a wrong guess of the scale costs much.

Imports from ``mdp`` and elicit.
"""
