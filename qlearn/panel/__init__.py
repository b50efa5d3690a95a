"""Policies for several people: one for the worst off, and what following another's costs each.

What a panel of people knows is an ``elicit.Panel``; learners take it as any other comparator.
"""
