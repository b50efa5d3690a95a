"""Policies that other libraries train, brought in as share vectors: what to train on next, what to ask, and what the
best of them can still lose. Imports from ``learners`` and elicit."""
