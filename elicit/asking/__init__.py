"""Questions and answers: elicitations, choices from a list, simple bags, and cuts.

Imports from ``tutors``, for the log of answers, ``comparators`` and below.
"""
