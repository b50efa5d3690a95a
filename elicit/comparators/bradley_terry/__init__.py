"""The tutor who errs as Bradley and Terry say: a bootstrap of fits, and a posterior by particles.

Imports from ``decision``, ``lp``, ``model`` and ``_support``.
"""
