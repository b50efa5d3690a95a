"""Comparators for a tutor who is always right, or nearly: all scales that fit the answers.

This folder imports from ``decision``, ``lp``, ``model`` and ``_support``.
"""
