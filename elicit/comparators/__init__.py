"""The comparators: a folder for each model of the tutor, and the baselines that learn nothing from answers.

Imports from ``decision``, ``lp``, ``model`` and ``_support``.
"""
