"""Questions and their answers: elicitations, the best of a list, questions of simple bags, and
cuts.

Imports from ``tutors``, for the log of answers, ``comparators`` and below.
"""
