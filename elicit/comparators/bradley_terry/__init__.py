"""Comparators for a tutor who errs by the Bradley-Terry model: a bootstrap, and particles.

This folder imports from ``decision``, ``lp``, ``model`` and ``_support``.
"""
