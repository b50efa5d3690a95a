"""Compiled loops of the learners, and the comparison of two actions that all loops share.

A loop runs until it is done or meets a comparison that only Python or the tutor can decide.
"""
