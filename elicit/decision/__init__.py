"""How a difference is judged, one decision for Python and for compiled loops.

Imports from ``lp``, ``model`` and ``_support``.
"""
