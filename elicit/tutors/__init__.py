"""Tutors that are simulated or replay a log, and the log of answers.

This folder imports from ``lp``, ``model`` and below.
"""
