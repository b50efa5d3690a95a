"""Gymnasium environments whose steps have a level: rewards by an ordinal scale, and share vectors.

May import from elicit alone.
"""
