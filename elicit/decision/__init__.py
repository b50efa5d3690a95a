"""Decisions on differences, the same for Python and for compiled loops.

Imports from ``lp``, ``model`` and ``_support``.
"""
