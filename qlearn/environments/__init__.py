"""Gymnasium environments whose steps have levels: rewards by an ordinal scale, and share vectors.

This folder may import from elicit alone.
"""
