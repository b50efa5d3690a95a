"""What to ask, and what was answered: the best of a list, and questions of simple bags.

Imports from ``comparators`` and below.
"""
