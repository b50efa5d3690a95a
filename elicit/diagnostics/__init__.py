"""Reports on tutors and comparators, from answers.

Imports from ``asking``, ``tutors``, ``comparators`` and below.
"""
