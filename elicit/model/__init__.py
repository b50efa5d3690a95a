"""The words everything speaks in: scales, queries, answers, verdicts, and what comparators and
tutors are.

Imports from ``_support``.
"""
