"""How good a tutor or a comparator is, told from answers.

Imports from ``asking``, ``tutors``, ``comparators`` and below.
"""
