"""Whoever answers: simulated tutors, and the log of answers with its replay. Imports from ``model``
and below.
"""
