"""Decisions on differences, the same for Python and for compiled loops.

They import from ``lp``, ``model`` and ``_support``.
"""
