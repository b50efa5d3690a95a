"""The comparators that learn from answers, a folder for each model of the tutor.

Imports from ``decision``, ``lp``, ``model`` and ``_support``.
"""
