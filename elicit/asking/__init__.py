"""Questions and answers: elicitations, choices from a list, simple bags, and cuts.

This folder imports from ``tutors``, for the log of answers, ``comparators`` and below.
"""
