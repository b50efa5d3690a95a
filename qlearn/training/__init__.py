"""Interactive training: policies that other libraries train are brought in as share vectors.

This folder decides what to train on next and what to ask, and bounds the loss of the best policy.
It imports from ``learners`` and elicit.
"""
