"""Comparators for a tutor who is always right, or nearly: all scales that fit the answers.

Imports from ``decision``, ``lp``, ``model`` and ``_support``.
"""
