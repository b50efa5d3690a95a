"""Policies that other libraries train, brought in as share vectors.

The folder decides what to train on next and what to ask, and bounds the loss of the best policy. It
imports from ``learners`` and elicit.
"""
