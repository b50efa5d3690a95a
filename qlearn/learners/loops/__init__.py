"""Compiled loops of the learners, and the pair step that they share.

A loop runs until only Python, a proof or the tutor can tell.
"""
