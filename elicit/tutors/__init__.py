"""Whoever answers: simulated tutors, and the log of answers with its replay.

Imports from ``lp``, ``model`` and below.
"""
