"""Rounds of policy iteration: a policy, its advantages and its loss bound. Imports from
``certificates``.
"""
