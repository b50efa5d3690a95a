"""Gymnasium environments whose steps have a level: rewards made of an ordinal scale, and share vectors from rollouts.

May import from elicit alone.
"""
