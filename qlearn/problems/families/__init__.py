"""Families of problems in which a wrong guess of the scale costs much.

This folder imports from ``mdp`` and elicit.
"""
