"""The paper's figures 2, 3 and 4, and whether its claims hold.

This folder imports from ``experiments`` and below.
"""
