"""Policies for several people: for the worst off, and the cost of following another's policy.

The people's knowledge is an ``elicit.Panel``. Learners take it as any other comparator.
"""
