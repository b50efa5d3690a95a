"""Policies that other libraries train, brought in as share vectors.

Decides what to train on next, what to ask, and what the best policy can still lose. Imports from
``learners`` and elicit.
"""
