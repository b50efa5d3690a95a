"""Comparators: a folder for each model of the tutor, and the baselines that ignore answers.

This folder imports from ``decision``, ``lp``, ``model`` and ``_support``.
"""
