"""Reports on tutors and comparators, made from answers.

Imports from ``asking``, ``tutors``, ``comparators`` and below.
"""
