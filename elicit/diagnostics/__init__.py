"""Reports on tutors and comparators, made from answers.

This folder imports from ``asking``, ``tutors``, ``comparators`` and below.
"""
