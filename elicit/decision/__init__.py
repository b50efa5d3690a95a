"""Decisions on differences, the same for Python and for compiled loops.

This folder imports from ``lp``, ``model`` and ``_support``.
"""
