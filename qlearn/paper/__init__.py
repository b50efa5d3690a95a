"""The paper's figures 2, 3 and 4, and whether its claims hold. Imports from ``experiments`` and
below.
"""
