"""Rounds of policy iteration: a policy, its advantages and its loss bound.

This folder imports from ``certificates``.
"""
