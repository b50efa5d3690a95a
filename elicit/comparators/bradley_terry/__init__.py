"""Comparators for a tutor who errs by the Bradley-Terry model: a bootstrap, and particles.

Imports from ``decision``, ``lp``, ``model`` and ``_support``.
"""
