"""What to ask, and what was answered: elicitations, the best of a list, and questions of simple bags.

Imports from ``tutors``, for the log of answers, ``comparators`` and below.
"""
